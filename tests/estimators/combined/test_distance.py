"""Losses in all sensors: what is walked in them is in the distance, and in its deviation."""

import numpy as np
import pytest
from made.estimators import without
from made.shank import shank

import jgait

LENGTH, STRIDES = 1.2, 16


def over_losses(found):
    return [note.values for note in found.notes if note.code == "distance_over_loss"]


@pytest.mark.parametrize("seconds", [1.5, 4.0])
@pytest.mark.parametrize("begin", [6.0, 6.5])
def test_a_loss_in_walking_is_walked_through(begin, seconds):
    made = shank(strides=STRIDES)
    found = jgait.analyse(without(made.recording, begin, seconds))
    distance, deviation = found.estimate.distance[-1], found.estimate.diagnostics["distance_stddev"][-1]
    assert abs(distance - STRIDES * LENGTH) < deviation < 0.15 * STRIDES * LENGTH
    (values,) = over_losses(found)
    missing = STRIDES - len(found.strides.first)
    assert values["metres"] == pytest.approx(missing * LENGTH, rel=0.1)
    assert deviation > 0.25 * values["metres"]
    assert np.all(np.diff(found.estimate.distance) > -1e-9)


@pytest.mark.parametrize("seconds", [0.15, 0.2, 0.3, 0.45])
def test_a_short_loss_at_any_phase_of_a_stride_takes_nothing_away(seconds):
    """A stance that is lost, or that is cut off between push-off and swing, begins and ends no stride."""
    made = shank(strides=STRIDES)
    for begin in np.arange(6.0, 7.3, 0.08):
        found = jgait.analyse(without(made.recording, begin, seconds)).estimate
        distance, deviation = found.distance[-1], found.diagnostics["distance_stddev"][-1]
        assert abs(distance - STRIDES * LENGTH) < 3.0 * deviation < 0.3 * STRIDES * LENGTH, begin


def test_a_loss_after_the_last_stride_counts_in_the_deviation_alone():
    made = shank(strides=STRIDES)
    whole = jgait.analyse(made.recording).estimate
    found = jgait.analyse(without(made.recording, made.contact[-1] + 0.4, 0.6))
    assert not over_losses(found)
    assert found.estimate.distance[-1] == pytest.approx(whole.distance[-1], abs=0.05)
    assert found.estimate.diagnostics["distance_stddev"][-1] > whole.diagnostics["distance_stddev"][-1] + 0.3


@pytest.mark.parametrize("begin", [2.0, 2.6, 3.2])
def test_few_strides_beside_a_loss_state_a_speed_all_the_same(begin):
    """Of strides from and to standing no speed is known; then the usual one is taken."""
    made = shank(strides=6, length=[0.6, 1.2, 1.2, 1.2, 1.2, 0.6])
    found = jgait.analyse(without(made.recording, begin, 2.5))
    distance, deviation = found.estimate.distance[-1], found.estimate.diagnostics["distance_stddev"][-1]
    assert abs(distance - 6.0) < 2.0 * deviation
