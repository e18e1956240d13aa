"""Sleeping gyroscopes on the command line: tables, totals, the figure, and what is refused."""

import json

import numpy as np
import pandas as pd
import pytest
from made import command
from made.duty import RATE, made

from jgait import io
from jgait.commands.console import console
from jgait.commands.pipeline import Choice
from jgait.estimators import duty_cycled_gyro
from jgait.types import Imu, Recording


def run(*words):
    return command.run("estimate", *words)


@pytest.fixture(autouse=True)
def _wide(monkeypatch):
    """The console took its width when it was imported, in a worker that of no terminal."""
    monkeypatch.setattr(console, "_width", 200)


def leg() -> Recording:
    """A pendulum of a leg that stands for two seconds, swings for nine and stands again: enough for tables."""
    time = np.arange(0.0, 13.0, 1.0 / RATE)
    phase = np.where((time > 2.0) & (time < 11.0), 2.0 * np.pi * (time - 2.0), 0.0)
    sensors, rng = {}, np.random.default_rng(0)
    for name, size, late in (("thigh_right", 1.0, 0.0), ("shank_right", 2.0, 1.0)):
        # Fast forward and slow back, as a leg swings; the axis to the left turns the other way.
        rate = size * (
            np.cos(phase - late) + 0.5 * np.cos(2.0 * (phase - late)) - np.cos(late) - 0.5 * np.cos(2 * late)
        )
        rate = np.where(phase > 0.0, rate - rate[phase > 0.0].mean(), 0.0)
        angle = np.cumsum(rate) / RATE
        # Noise, for a sensor that never changes counts as stuck.
        noise = 1e-3 * rng.normal(size=(rate.size, 3))
        gyr = np.column_stack([np.zeros_like(rate), -rate, np.zeros_like(rate)]) + noise
        acc = 9.81 * np.column_stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)])
        sensors[name] = Imu(time, gyr, acc, np.ones(time.size, bool))
    return Recording(sensors, RATE)


@pytest.fixture
def csv(tmp_path):
    return io.write_csv(leg(), tmp_path / "walk.csv")


def test_tables_totals_and_a_figure(csv, tmp_path, monkeypatch):
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
    code, said = run(csv, *words, "--out", out, "--json", out / "numbers.json", "--notes")
    assert code == 0, said
    assert seen["options"].schedule == 0.5 and seen["options"].warm_up == 5.0 and seen["options"].filler == "replicate"
    assert seen["sensors"] == {"thigh_right", "shank_right"} and seen["p"].thigh_length.right == 0.4
    assert type(seen["p"].filler).__name__ == "Replicate"
    shown = (
        "hip right │ -17 … 17 °", "knee right │ -34 … 34 °", "measured │ 50 %", "held │ 2 %", "energy saved │ 40 %",
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
