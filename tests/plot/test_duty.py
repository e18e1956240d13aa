"""The figure of sleeping gyroscopes."""

import numpy as np
import pytest
from made.notes import note

from jgait import plot
from jgait.duty_cycle.fillers.base import FILLED, HELD, MEASURED
from jgait.estimators.duty_cycled_gyro import about
from jgait.types import Estimate, Legs, LegTrajectory, as_float

RATE = 50.0


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
