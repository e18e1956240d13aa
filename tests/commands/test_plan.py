"""`jgait explain` and `jgait plan`: what moves a number, and which sensors a study needs, on a waist's short walk."""

import json

import jax
import pytest
from made import command

from jgait import io, simulate
from jgait.simulate import sensors


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    sensor = sensors.MPU6000._replace(packet_loss=0.0)
    recording, _ = simulate.recording(jax.random.key(3), None, simulate.straight(15.0), sensor, placements=("waist",))
    return io.write_csv(recording, tmp_path_factory.mktemp("walk") / "walk.csv")


def test_explain_ranks_assumptions_and_draws_them(walk, tmp_path):
    numbers, figure = tmp_path / "numbers.json", tmp_path / "moves.png"
    code, said = command.run("explain", walk, "--height", "1.75", "--json", numbers, "--figure", figure)
    assert code == 0, said
    assert "what moves the stride length, by waist" in said and "height of the sensor" in said
    made = json.loads(numbers.read_text())
    assert made["estimator"] == "waist"
    shares = [row["share"] for row in made["assumptions"]]
    assert shares == sorted(shares, reverse=True)
    assert figure.exists()


@pytest.mark.release
def test_the_page_has_what_moves_a_number(walk, tmp_path):
    page = tmp_path / "page.html"
    code, said = command.run("report", walk, "--height", "1.75", "--explain", "stride_length", "--out", page)
    assert code == 0, said
    assert "What moves this number" in page.read_text()


def test_explain_names_what_it_cannot(walk):
    code, said = command.run("explain", walk, "--measure", "stride_duration")
    assert code == 2
    assert "no 'stride_duration' with a gradient" in said


def test_plan_of_a_recording_and_of_simulated_people(walk, tmp_path):
    numbers, figure = tmp_path / "numbers.json", tmp_path / "plan.png"
    of_file = ("--height", "1.75", "--gyr-unit", "deg/s", "--acc-unit", "m/s^2")
    code, said = command.run("plan", walk, "--places", "waist,feet", "--rates", "50,100", "--json", numbers, *of_file)
    assert code == 0, said
    rows = json.loads(numbers.read_text())["setups"]
    assert {row["name"] for row in rows} == {"waist, 50 Hz", "waist, 100 Hz"}
    assert {row["sd"] for row in rows} == {None}  # of one person
    assert any(row["expected_sd"] > 0.0 for row in rows)
    assert "bias: mean error, which more people do not reduce" in said
    some = ("--simulated", "2", "--metres", "12", "--places", "waist", "--rates", "100", "--people", "9")
    code, said = command.run("plan", *some, "--within", "0.5", "--figure", figure)
    assert code == 0, said
    assert "within 50 cm: waist, 100 Hz" in said
    assert figure.exists()
