"""Figures show what is valid, with gaps where it is not; all are called from one place."""

import numpy as np
import pytest

from jgait import plot
from jgait.types import Estimate, Legs, LegTrajectory


@pytest.fixture
def padded():
    """Five seconds of standing, and five of padding full of nonsense."""
    t = np.arange(100) / 10.0
    valid = t < 5.0
    wild = np.where(valid, 0.1, 1e3)
    leg = LegTrajectory(wild, wild, wild, wild)
    return Estimate(t, Legs(leg, None), Legs(leg, None), np.where(valid, t, 1e6), valid, {})


@pytest.mark.parametrize("draw", [plot.joint_angles, plot.foot_path, plot.distance])
def test_padding_is_not_drawn(padded, draw):
    figure = draw(padded, padded._replace(stddev=None))
    for axis in figure.axes:
        for line in axis.get_lines():
            x, y = (np.asarray(values, float) for values in line.get_data())
            drawn = np.isfinite(x) & np.isfinite(y)
            assert drawn.sum() == 50
            assert np.abs(y[drawn]).max() < 20.0
        figure.canvas.draw()
        assert np.abs(axis.get_ylim()).max() < 60.0


@pytest.mark.parametrize("draw", [plot.joint_angles, plot.foot_path, plot.foot_displacement])
def test_legs_whose_angles_are_not_usable_are_marked(padded, draw):
    both = padded._replace(legs=Legs(padded.legs.right, padded.legs.right), stddev=None)
    figure = draw(both._replace(diagnostics={"angles_valid_right": False, "angles_valid_left": True}))
    titles = [axis.get_title(loc) for axis in figure.axes for loc in ("left", "center")]
    assert [title for title in titles if title] == ["right leg: do not use", "left leg"]


def test_figures_of_what_an_estimate_lacks_are_refused_in_words(padded):
    nobody = padded._replace(legs=Legs(None, None), stddev=None, distance=None)
    with pytest.raises(ValueError, match="the estimate has no distance: no walking was found"):
        plot.distance(nobody)
    for draw in (plot.joint_angles, plot.foot_path):
        with pytest.raises(ValueError, match="the estimate has no joint angles; they need walking"):
            draw(nobody)


def test_the_band_of_a_distance_with_one_deviation_grows_with_the_way():
    t = np.arange(100) / 10.0
    way = np.clip(t - 2.0, 0.0, 5.0)
    walk = Estimate(t, Legs(None, None), None, way, t >= 0.0, {"distance_stddev": np.array([0.5])})
    (band,) = plot.distance(walk).axes[0].collections
    corners = band.get_paths()[0].vertices
    for at, spread in ((1.0, 0.0), (4.5, 0.5), (9.0, 1.0)):
        y = corners[np.isclose(corners[:, 0], at), 1]
        np.testing.assert_allclose([y.min(), y.max()], np.interp(at, t, way) + [-spread, spread])


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
