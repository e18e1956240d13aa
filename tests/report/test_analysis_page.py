"""The page of one recording by all its sensors."""

import json
import re

import jax
import pytest
from made.command import run

import jgait
from jgait import io, simulate
from jgait.report import Made, flags, of_analysis
from jgait.simulate.sensors import OPAL


@pytest.fixture(scope="module")
def analysed():
    """A simulated walk with sensors on both feet and shanks, and all of them together."""
    placements = ("foot_right", "foot_left", *simulate.FOUR)
    key, route = jax.random.key(3), simulate.straight(6.0)
    ((recording, _),) = simulate.cohort(key, 1, route, OPAL, 100.0, placements, recorded=False)
    return recording, jgait.analyse(recording, {"height": 1.75})


def test_a_page_of_all_sensors_compares_them(analysed):
    recording, analysis = analysed
    page = of_analysis(analysis, recording, made=Made("all sensors together", file="walk.csv"))
    text = page.html
    for words in (
        "What each sensor says",
        "Bouts of walking",
        "feet by foot_ins",
        "shanks by ankle_stride",
        "combined",
    ):
        assert words in text
    for one in analysis.comparisons:
        if one.quantity == "distance":
            assert f">{one.value:.2f}<" in text
    assert page.numbers["strides"] == len(analysis.strides.first)
    length = io.analysis_to_dataframes(analysis)["summary"].set_index("measure").loc["stride_length", "median"]
    (total,) = (total for total in io.Results(analysis).totals if total.words == "stride length")
    assert total.text.startswith(f"{length:.3f} ±") and f">{length:.3f}<" in text  # one number in all places
    means = {f"{row['measure']}_{row['unit']}": row["mean"] for row in page.numbers["means"]}
    table = io.analysis_to_dataframes(analysis)["strides"].query("regular")
    for column in ("knee_flexion_max_deg", "hip_flexion_min_deg"):
        assert means[column] == pytest.approx(table[column].mean(), abs=1.0)


def test_tables_of_an_analysis_have_headings_in_words_and_no_box_that_hides_rows(analysed):
    recording, analysis = analysed
    text = of_analysis(analysis, recording).html
    assert "wb_id" not in text and "walking_speed_mps" not in text
    for heading in ("no.", "start [s]", "distance [m]", "walking speed [m/s]", "cadence [steps/min]"):
        assert f">{heading}</th>" in text
    boxes = re.findall(r'<div class="(scroll[^"]*)".*?<table( class="sortable")?', text, re.DOTALL)
    assert len(boxes) > 3
    assert all(("long" in box) == bool(sorts) for box, sorts in boxes)  # only a long table of strides


def test_the_terminal_and_the_page_have_the_same_doubts(analysed, tmp_path):
    recording, _ = analysed
    file, numbers = io.write_csv(recording, tmp_path / "walk.csv"), [tmp_path / name for name in ("a.json", "b.json")]
    code, said = run("estimate", file, "--height", "1.75", "--out", tmp_path / "out", "--json", numbers[0], "--notes")
    assert code == 0, said
    run("report", file, "--height", "1.75", "--out", tmp_path / "page.html", "--json", numbers[1])
    estimated, page = (json.loads(path.read_text()) for path in numbers)
    (told,) = estimated["recordings"].values()
    assert told["flags"] == page["flags"]
    doubts = [flag for flag in page["flags"] if flag["grade"] in flags.DOUBTS]
    assert any(flag["text"].startswith("Only ") for flag in doubts)
    assert f"walk.csv: {flags.verdict(flags.Flag(**flag) for flag in page['flags'])}" in said
    for flag in doubts:
        assert all(line in said for line in (*flag["text"].splitlines(), flag["meaning"]))
