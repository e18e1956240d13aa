"""Sleeping gyroscopes on the command line: tables, totals, the figure, and what is refused."""

import json

import numpy as np
import pandas as pd
import pytest
from made import command
from made.duty import made

from jgait.commands.console import console
from jgait.commands.options import Choice
from jgait.estimators import duty_cycled_gyro


def run(*words):
    return command.run("estimate", *words)


@pytest.fixture(autouse=True)
def _wide(monkeypatch):
    """The console took its width when it was imported, in a worker that of no terminal."""
    monkeypatch.setattr(console, "_width", 200)


def test_tables_totals_and_a_figure(walk, tmp_path, monkeypatch):
    seen = {}

    def estimate(choice, p, recording):
        # The estimator itself is tried in its own tests, and takes long to compile.
        options = choice.settings["options"]
        seen.update(options=options, sensors=set(recording.sensors), p=p)
        assert duty_cycled_gyro.prepared(recording, options).options.gaps
        return made()

    monkeypatch.setattr(Choice, "estimate", estimate)
    out = tmp_path / "out"
    words = ("--method", "duty_cycled_gyro", "--thigh", 0.4)
    words += tuple(word for text in ("duty=0.5", "filler=replicate", "warm-up=5") for word in ("--option", text))
    code, said = run(walk, *words, "--out", out, "--json", out / "numbers.json", "--notes")
    assert code == 0, said
    assert seen["options"].schedule == 0.5 and seen["options"].warm_up == 5.0 and seen["options"].filler == "replicate"
    assert seen["sensors"] == {"thigh_right", "shank_right"} and seen["p"].thigh_length.right == 0.4
    assert type(seen["p"].filler).__name__ == "Replicate"
    shown = (
        "hip right │ −17 … 17 °", "knee right │ −34 … 34 °", "measured │ 50 %", "held │ 2 %", "energy saved │ 40 %",
        "battery life │ × 2.00", "gaps filled by replicate",
    )  # fmt: skip
    assert all(text in said for text in shown), said
    assert "For information: A fact" in said and "no --duty" not in said
    assert {path.name for path in out.glob("[!.]*")} == {
        "walk_segments.csv", "walk_legs.csv", "walk_gyroscopes.png", "numbers.json",
    }  # fmt: skip
    table = pd.read_csv(out / "walk_segments.csv")
    assert table["shank_right_gyr_is"].value_counts().to_dict() == {"measured": 1700, "filled": 200, "held": 100}
    assert table["shank_right_angle_deg"].max() == pytest.approx(np.degrees(0.3), rel=5e-3)
    (told,) = json.loads((out / "numbers.json").read_text())["recordings"].values()
    assert told["samples"]["shank_right"] == {"measured": 1700, "filled": 200, "held": 100}
    assert told["battery_h_per_wh"] == 2.0 and told["battery_always_on_h_per_wh"] == 1.0
    assert told["gyroscope_energy_saved"] == 0.4 and told["distance_m"] is None
