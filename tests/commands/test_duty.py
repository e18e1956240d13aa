"""Sleeping gyroscopes on the command line: tables, totals, the figure, and what is refused."""

import json

import numpy as np
import pandas as pd
import pytest
from made import command
from made.notes import note

from jgait import io, plot
from jgait.commands.console import console
from jgait.commands.pipeline import Choice
from jgait.duty_cycle.fillers.base import FILLED, HELD, MEASURED
from jgait.estimators import duty_cycled_gyro
from jgait.estimators.duty_cycled_gyro import about
from jgait.types import Estimate, Imu, Legs, LegTrajectory, Recording, as_float

RATE = 50.0


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


def made(how, *, joints=True, samples=2000):
    """An estimate as `duty_cycled_gyro` gives it."""
    time = np.arange(samples) / RATE
    wave = np.sin(2.0 * np.pi * time)
    told = {"gyro_energy_saved": 0.4, "usable_share": 0.5, "mean_power": 0.02, "battery_life": 7200.0,
            "battery_life_always_on": 3600.0, "latency": 0.0, "notes": (note("a fact"),),
            "standing": (0, 50)}  # fmt: skip
    for name in ("thigh_right", "shank_right") if joints else ("shank_right",):
        flags = how if name == "shank_right" else np.full(samples, MEASURED)
        told |= {f"angle_{name}": 0.3 * wave, f"angle_stddev_{name}": np.full(samples, 0.02), f"gyro_{name}": wave,
                 f"how_{name}": flags}  # fmt: skip
    trajectory = LegTrajectory(0.3 * wave, 0.6 * wave, wave, wave) if joints else None
    spread = LegTrajectory(*(np.full(samples, 0.02),) * 4) if joints else None
    valid = np.ones(samples, bool)
    return Estimate(time, Legs(trajectory, None), Legs(spread, None) if joints else None, None, valid, told)


def flags(samples=2000):
    how = np.full(samples, MEASURED)
    how[500:600], how[800:1000] = HELD, FILLED
    return how


def test_tables_totals_and_a_figure(csv, tmp_path, monkeypatch):
    seen = {}

    def estimate(choice, p, recording):
        # The estimator itself is tried in its own tests, and takes long to compile.
        options = choice.settings["options"]
        seen.update(options=options, sensors=set(recording.sensors), p=p)
        assert duty_cycled_gyro.prepared(recording, options).options.gaps
        return made(flags())

    monkeypatch.setattr(Choice, "estimate", estimate)
    out = tmp_path / "out"
    words = ("--method", "duty_cycled_gyro", "--thigh", 0.4)
    words += tuple(word for text in ("duty=0.5", "filler=ridge", "warm-up=5") for word in ("--option", text))
    code, said = run(csv, *words, "--out", out, "--json", out / "numbers.json", "--notes")
    assert code == 0, said
    assert seen["options"].schedule == 0.5 and seen["options"].warm_up == 5.0 and seen["options"].filler == "ridge"
    assert seen["sensors"] == {"thigh_right", "shank_right"} and seen["p"].thigh_length.right == 0.4
    assert type(seen["p"].filler).__name__ == "Ridge"
    shown = (
        "hip right │ -17 … 17 °", "knee right │ -34 … 34 °", "measured │ 50 %", "held │ 2 %", "energy saved │ 40 %",
        "battery life │ × 2.00", "gaps filled by ridge",
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


def test_without_a_leg_of_both_segments_there_is_no_table_of_legs(csv, tmp_path, monkeypatch):
    monkeypatch.setattr(Choice, "estimate", lambda *_: made(flags(), joints=False))
    code, said = run(csv, "--estimator", "duty_cycled_gyro", "--paper", "--out", tmp_path / "out", "--notes")
    assert code == 0 and "no --duty: gyroscopes sleep only where the file has no samples" in said, said
    assert "gaps filled by replicate" in said and "hip right" not in said
    assert {path.name for path in (tmp_path / "out").glob("[!.]*")} == {"walk_segments.csv", "walk_gyroscopes.png"}


def test_the_figure_tells_measured_from_filled_and_shades_the_sleep():
    estimate = made(flags())
    figure = plot.sleeping_gyroscopes(estimate, title="walk")
    angles, thigh, shank = figure.axes
    assert angles.get_ylabel() == "flexion [°]" and shank.get_ylabel() == "shank rate [rad/s]"
    names = {text.get_text() for text in figure.legends[0].get_texts()}
    assert names == {"gyroscope asleep, or sample lost", "hip flexion, ±2σ", "knee flexion, ±2σ", "measured", "filled",
                     "held, not used"}  # fmt: skip
    assert len(thigh.lines) == 1 and len(shank.lines) == 3
    for line, kind in zip(shank.lines, (MEASURED, FILLED, HELD), strict=True):
        drawn = np.isfinite(as_float(line.get_ydata()))
        assert np.all(drawn[flags() == kind])
        assert drawn.sum() - np.sum(flags() == kind) in (0, 1)  # a piece begins at the sample before it
    assert len({line.get_color() for line in shank.lines}) == 3
    np.testing.assert_allclose(sorted(patch.get_x() for patch in shank.patches), [10.0, 16.0])
    assert not thigh.patches and len(angles.patches) == 2
    assert about.shown(estimate) == (13.0, 28.0)
    unknown = flags() == HELD
    for line in plot.sleeping_gyroscopes(estimate._replace(valid=~unknown)).axes[0].lines:
        np.testing.assert_array_equal(np.isnan(as_float(line.get_ydata())), unknown)
    part = plot.sleeping_gyroscopes(made(flags(), joints=False), seconds=(13.0, 28.0))
    assert part.axes[0].get_ylabel() == "angle [°]" and part.axes[1].lines[0].get_xdata()[0] == 13.0
    with pytest.raises(ValueError, match="has no gyroscope that may sleep"):
        plot.sleeping_gyroscopes(estimate._replace(diagnostics={}))
