"""What a curve of energy and error costs at one error, by hand."""

import numpy as np
import pytest

from experiments.udaya2010.triggered import Curve


@pytest.fixture(scope="module")
def curve():
    """Three settings of two legs begun at two places, in no order of their energies."""
    energy = np.array([0.5, 0.9, 0.1])
    error = np.array([0.2, 0.05, 0.4])
    spread = np.array([[0.6, 1.0], [1.0, 1.4]])  # of squares: a mean of 1
    return Curve(
        energy[:, None, None] * np.array([[0.8, 1.2], [0.9, 1.1]]), error[:, None, None] ** 2 * spread,
    )  # fmt: skip


def test_between_neighbours_on_the_curve_the_energy_is_on_the_line(curve):
    # From 0.2 at 0.5 to 0.05 at 0.9: 0.1 is two thirds of the way.
    assert curve.at(0.1) == pytest.approx(0.5 + 0.4 * 2.0 / 3.0)
    assert curve.at(0.2) == pytest.approx(0.5)
    assert curve.at(0.3) == pytest.approx(0.3)


def test_beyond_the_ends_of_the_curve(curve):
    assert curve.at(0.5) == pytest.approx(0.1)  # the least energy does already
    assert np.isnan(curve.at(0.04))  # and none does


def test_the_median_is_of_legs_and_places(curve):
    middle = 1.0  # of roots of 0.6, 1, 1, 1.4
    assert curve.at(0.1, median=True) == pytest.approx(0.5 + 0.4 * (0.2 * middle - 0.1) / (0.15 * middle))
