"""One sensor at an ankle or on a shank on the command line: strides, totals, flags, and what it says of bad files."""

import json

import numpy as np
import pandas as pd
import pytest
from made import command
from made import shank as made_shank

from jgait import io

LENGTHS = np.r_[0.7, np.full(4, 1.2), 0.7]
TURNS, RISES = np.r_[0.0, 0.0, 0.6, 0.0, 0.0, 0.0], np.r_[0.0, 0.0, 0.0, 0.17, 0.0, 0.0]
HEIGHT = 0.04


def run(*words):
    return command.run("estimate", *words)


def walked(placement="ankle_right", **options):
    return made_shank.shank(
        6, LENGTHS, lever=(0.0, 0.0, HEIGHT), turns=TURNS, rises=RISES, placement=placement, **options
    )


@pytest.fixture
def csv(tmp_path):
    """A walk, or what `change` makes of its sensor, as a user's file."""

    def write(change=None, placement="ankle_right", **options):
        recording = walked(placement, **options).recording
        if change is not None:
            recording = recording._replace(sensors={n: change(imu) for n, imu in recording.sensors.items()})
        return io.write_csv(recording, tmp_path / "walk.csv")

    return write


def strides_of(tmp_path):
    return pd.read_csv(tmp_path / "out" / "walk_strides.csv", keep_default_na=False)


@pytest.fixture
def words(tmp_path):
    return ("--estimator", "ankle_stride", "--out", tmp_path / "out")


def test_strides_totals_flags_and_figures_of_a_leg(csv, tmp_path, words):
    numbers = tmp_path / "made" / "numbers.json"
    code, said = run(csv(), *words, "--option", f"lever={HEIGHT}", "--json", numbers)
    assert code == 0, said
    assert "│ walk │ strides │ 6, 2 regular" in said and "distance │ 6.2" in said
    assert said.index("distance │") < said.index("walk.csv: Usable with care: ") < said.index("remarks: --notes prints")
    assert "2 of 6 strides: half-step" not in said
    assert (
        "lever: a sensor" not in said and "does not walk" not in said and "clips" not in said and "upside" not in said
    )
    assert {path.name for path in (tmp_path / "out").glob("[!.]*")} == {
        "walk_strides.csv", "walk_strides.png", "walk_distance.png",
    }  # fmt: skip
    strides = strides_of(tmp_path)
    np.testing.assert_allclose(strides["stride_length_m"], LENGTHS, atol=0.02)
    assert list(strides["special"]) == ["half-step", "", "turning", "stairs", "", "half-step"]
    assert list(strides["regular"]) == [False, True, False, False, True, False]
    (told,) = json.loads(numbers.read_text())["recordings"].values()
    assert told["distance_m"] == pytest.approx(LENGTHS.sum(), abs=0.06)
    assert abs(told["lever_right_m"] - HEIGHT) < 2.0 * told["lever_std_right_m"] < 0.04
    assert told["notes"] == [
        note.to_dict() for note in io.read_csv(tmp_path / "walk.csv").notes
    ]  # and nothing of the estimator's
    assert [one["special"] for one in told["strides"]] == list(strides["special"])
    assert all(one["stride_length_std_m"] > 0.0 for one in told["strides"])


def test_no_walking_is_an_empty_table(csv, tmp_path, words):
    def stand(imu):
        return imu._replace(gyr=0.02 * imu.gyr, acc=np.tile(imu.acc[:1], (len(imu.time), 1)))

    code, said = run(csv(stand), *words, "--json", tmp_path / "numbers.json")
    assert code == 0, said
    assert "walk.csv: Do not use: ankle_right does not walk" in said and "│ strides │ 0, 0 regular" in said
    assert len(strides_of(tmp_path)) == 0 and "special" in strides_of(tmp_path)
    assert not list((tmp_path / "out").glob("*.png"))
    (told,) = json.loads((tmp_path / "numbers.json").read_text())["recordings"].values()
    assert told["strides"] == [] and told["distance_m"] == 0.0
