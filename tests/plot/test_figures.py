"""Every figure is called from one place; rates that sleep, and the ankle's way relative to the hip."""

import numpy as np
import pytest

from jgait import plot
from jgait.types import Estimate, Legs, LegTrajectory

N = 40


@pytest.fixture
def slept():
    """A shank whose gyroscope sleeps from 2 to 4 s; there the filter's rate is a tenth too large."""
    time = np.arange(500) / 50.0
    rate, how = np.sin(2.0 * np.pi * time), np.where((time >= 2.0) & (time < 4.0), 1, 0)
    awake = Estimate(time, Legs(None, None), None, None, np.ones(500, bool), {
        "rate_shank_left": rate, "gyro_shank_left": rate + 0.01, "how_shank_left": 0 * how})  # fmt: skip
    told = {**awake.diagnostics, "rate_shank_left": np.where(how, 1.1 * rate, rate), "how_shank_left": how}
    return awake._replace(diagnostics=told), awake


def test_rates_with_and_without_sleep(slept, tmp_path):
    asleep, awake = slept
    figure = plot.filtered_rates(asleep, awake, seconds=(2.0, 3.98))
    rates, error = figure.axes
    assert rates.get_ylabel() == "shank, left\nrate [rad/s]" and error.get_ylabel() == "error [rad/s]"
    assert len(rates.patches) == 1 and len(error.patches) == 1
    assert error.get_title(loc="right") == "root mean square 10 % of the rate's"
    np.testing.assert_allclose(error.lines[1].get_ydata(), 0.1 * rates.lines[0].get_ydata(), atol=1e-12)
    (alone,) = plot.filtered_rates(awake, placement="shank_left").axes
    np.testing.assert_allclose(alone.lines[0].get_ydata() - alone.lines[1].get_ydata(), 0.01, atol=1e-12)
    assert not alone.patches
    assert plot.save(figure, tmp_path / "rates.png").stat().st_size > 20_000


def test_rates_that_do_not_belong_together_are_refused(slept):
    asleep, awake = slept
    with pytest.raises(ValueError, match="has no gyroscope of 'thigh_left'"):
        plot.filtered_rates(asleep, placement="thigh_left")
    with pytest.raises(ValueError, match="same recording; the one that is awake has other times"):
        plot.filtered_rates(asleep, awake._replace(time=awake.time + 1.0))
    with pytest.raises(ValueError, match="the one that is awake does not have shank_left"):
        plot.filtered_rates(asleep, awake._replace(diagnostics={}))


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
