"""Figures of estimates show what is valid, and leave gaps where it is not."""

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


def test_the_band_of_a_distance_with_one_deviation_grows_with_the_way():
    t = np.arange(100) / 10.0
    way = np.clip(t - 2.0, 0.0, 5.0)
    walk = Estimate(t, Legs(None, None), None, way, t >= 0.0, {"distance_stddev": np.array([0.5])})
    (band,) = plot.distance(walk).axes[0].collections
    corners = band.get_paths()[0].vertices
    for at, spread in ((1.0, 0.0), (4.5, 0.5), (9.0, 1.0)):
        y = corners[np.isclose(corners[:, 0], at), 1]
        np.testing.assert_allclose([y.min(), y.max()], np.interp(at, t, way) + [-spread, spread])
