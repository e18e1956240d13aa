"""The page of one recording by all its sensors."""

import jax
import pytest
from made.command import run

import jgait
from jgait import io, simulate
from jgait.report import Made, of_analysis
from jgait.simulate.sensors import OPAL


@pytest.fixture(scope="module")
def analysed():
    """A simulated walk with sensors on both feet and shanks, and all of them together."""
    placements = ("foot_right", "foot_left", *simulate.FOUR)
    key, route = jax.random.key(3), simulate.straight(6.0)
    ((recording, _),) = simulate.cohort(key, 1, route, OPAL, 100.0, placements)
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
    means = {row["name"]: row["all"]["mean"] for row in page.numbers["means"]}
    table = io.analysis_to_dataframes(analysis)["strides"].query("regular")
    for name, column in (("knee_flexion_deg", "knee_flexion_max_deg"), ("hip_extension_deg", "hip_flexion_min_deg")):
        assert means[name] == pytest.approx(table[column].mean(), abs=1.0)


def test_a_page_of_all_sensors_from_the_command_line(analysed, tmp_path):
    recording, _ = analysed
    file = io.write_csv(recording, tmp_path / "walk.csv")
    code, said = run("report", file, "--height", "1.75", "--out", tmp_path / "page.html")
    assert code == 0, said
    assert "What each sensor says" in (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "from the height of 1.75 m" in said
