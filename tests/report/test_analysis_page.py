"""The page of one recording by all its sensors, beside the tables and the words of the terminal."""

import json
import re

import jax
import pandas as pd
import pytest
from made.command import run

from jgait import io, simulate
from jgait.io import flags
from jgait.simulate.sensors import OPAL


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    """A simulated walk with sensors on feet, thighs and shanks: the folder of its results, and what was printed."""
    placements = ("foot_right", "foot_left", *simulate.FOUR)
    key, route = jax.random.key(3), simulate.straight(6.0)
    ((recording, _),) = simulate.cohort(key, 1, route, OPAL, 100.0, placements, recorded=False)
    folder = tmp_path_factory.mktemp("walk")
    file, person = io.write_csv(recording, folder / "walk.csv"), ("--height", "1.75")
    words = ("--out", folder / "out", "--json", folder / "estimate.json", "--notes")
    code, said = run("estimate", file, *person, *words)
    assert code == 0, said
    run("report", file, *person, "--out", folder / "page.html", "--json", folder / "page.json")
    return folder, said


def test_a_page_of_all_sensors_compares_them(walked):
    folder, _ = walked
    text, numbers = (folder / "page.html").read_text(), json.loads((folder / "page.json").read_text())
    for words in ("What each sensor says", "Bouts of walking", "feet by foot_ins", "shanks by ankle_stride"):
        assert words in text
    assert "combined" in text
    distances = pd.read_csv(folder / "out" / "walk_sources.csv").query("quantity == 'distance'")["value"]
    assert len(distances) > 2 and all(f">{value:.2f}<" in text for value in distances)
    table = pd.read_csv(folder / "out" / "walk_strides.csv")
    assert numbers["strides"] == len(table)
    means = {f"{row['measure']}_{row['unit']}": row["mean"] for row in numbers["means"]}
    table = table.query("regular")
    summary = pd.read_csv(folder / "out" / "walk_summary.csv").set_index("measure")
    length = f"{summary.loc['stride_length', 'median']:.3f}"  # one number in all places
    assert f"{length} ±" in walked[1] and f">{length}<" in text
    for column in ("knee_flexion_max_deg", "hip_flexion_min_deg"):
        assert means[column] == pytest.approx(table[column].mean(), abs=1.0)


def test_tables_of_an_analysis_have_headings_in_words_and_no_box_that_hides_rows(walked):
    text = (walked[0] / "page.html").read_text()
    assert "wb_id" not in text and "walking_speed_mps" not in text
    for heading in ("no.", "start [s]", "distance [m]", "walking speed [m/s]", "cadence [steps/min]"):
        assert f">{heading}</th>" in text
    boxes = re.findall(r'<div class="(scroll[^"]*)".*?<table( class="sortable")?', text, re.DOTALL)
    assert len(boxes) > 3
    assert all(("long" in box) == bool(sorts) for box, sorts in boxes)  # only a long table of strides


def test_the_terminal_and_the_page_have_the_same_doubts(walked):
    folder, said = walked
    estimated, page = (json.loads((folder / f"{name}.json").read_text()) for name in ("estimate", "page"))
    (told,) = estimated["recordings"].values()
    assert told["flags"] == page["flags"]
    doubts = [flag for flag in page["flags"] if flag["grade"] in flags.DOUBTS]
    assert any(flag["text"].startswith("Only ") for flag in doubts)
    assert f"walk.csv: {flags.verdict(flags.Flag(**flag) for flag in page['flags'])}" in said
    for flag in doubts:
        assert all(line in said for line in (*flag["text"].splitlines(), flag["meaning"]))
