"""The figure of sleeping gyroscopes."""

import numpy as np
import pytest
from made.duty import flags, made

from jgait import plot
from jgait.duty_cycle.filling import FILLED, HELD, MEASURED
from jgait.estimators.duty_cycled_gyro import about
from jgait.types import as_float


def test_the_figure_tells_measured_from_filled_and_shades_the_sleep():
    estimate = made()
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
    part = plot.sleeping_gyroscopes(made(joints=False), seconds=(13.0, 28.0))
    assert part.axes[0].get_ylabel() == "angle [°]" and part.axes[1].lines[0].get_xdata()[0] == 13.0
    with pytest.raises(ValueError, match="has no gyroscope that may sleep"):
        plot.sleeping_gyroscopes(estimate._replace(diagnostics={}))
