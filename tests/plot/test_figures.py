"""Every figure is called from one place; the ankle's way relative to the hip."""

import numpy as np
import pytest

from jgait import plot
from jgait.types import Estimate, Legs, LegTrajectory

N = 40


def test_the_ankle_relative_to_the_hip_over_time():
    time = np.arange(100) / 50.0
    leg = LegTrajectory(0.0 * time, 0.0 * time, 0.3 * np.sin(time), -0.8 + 0.1 * time)
    spread = LegTrajectory(*(np.full(100, 0.01) for _ in range(4)))
    estimate = Estimate(time, Legs(None, leg), Legs(None, spread), None, np.ones(100, bool), {})
    known = estimate._replace(legs=Legs(None, leg._replace(x=leg.x + 0.02)), stddev=None)
    figure = plot.foot_displacement(estimate, known)
    forward, up = figure.axes
    assert (forward.get_ylabel(), up.get_ylabel()) == ("ankle forward of hip [cm]", "ankle above hip [cm]")
    np.testing.assert_allclose(forward.lines[0].get_ydata() - forward.lines[1].get_ydata(), 2.0)
    np.testing.assert_allclose(up.lines[1].get_ydata(), 100.0 * leg.y)
    band = forward.collections[0].get_paths()[0].vertices
    assert np.ptp(band[:, 1]) == pytest.approx(np.ptp(30.0 * np.sin(time)) + 4.0, rel=1e-6)


def test_every_figure_is_called_from_one_place():
    for name in plot.__all__:
        assert callable(getattr(plot, name)) and getattr(plot, name).__doc__, name
    from jgait.plot import cohort as plot_cohort
    from jgait.plot import tuning as plot_tuning

    assert plot.bland_altman is plot_cohort.bland_altman and plot.profile is plot_tuning.profile
    with pytest.raises(AttributeError, match="has no attribute 'pie'"):
        _ = plot.pie
