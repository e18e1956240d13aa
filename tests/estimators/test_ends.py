"""Recordings that begin or end in walking: what is cut off is noted, and counts in the distance of all sensors."""

import numpy as np
import pytest
from made.shank import shank
from made.trunk import cut, imu_of

import jgait
from jgait.estimators import ankle_stride
from jgait.estimators.ends import WALKING_AFTER, WALKING_BEFORE

PERIOD_S, LENGTH = 1.1, 1.2


def cuts(notes):
    """Seconds that are cut off before and after."""
    kinds = [kind.code for kind in (WALKING_BEFORE, WALKING_AFTER)]
    found = {note.code: note.values["seconds"] for note in notes if note.code in kinds}
    return [found.get(code, 0.0) for code in kinds]


@pytest.mark.parametrize("at", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_what_is_cut_off_counts_in_the_distance(at):
    """The walk is the same in each period, so five periods are five strides, wherever they begin."""
    first = 2.5 + at
    found = jgait.analyse(cut(shank(strides=8).recording, first, first + 5 * PERIOD_S - 0.01))
    distance, deviation = found.estimate.distance[-1], found.estimate.diagnostics["distance_stddev"][-1]
    assert abs(distance - 5 * LENGTH) < 2.0 * deviation < 1.0
    before, after = cuts(found.notes)
    whole = len(found.strides.first) * PERIOD_S
    assert before + after == pytest.approx(5 * PERIOD_S - whole, abs=0.2)
    assert any(note.code == "distance_extended" for note in found.notes)
    assert found.estimate.distance[0] == pytest.approx(0.0, abs=1e-9)
    assert np.all(np.diff(found.estimate.distance) > -1e-9)


def test_standing_at_both_ends_cuts_nothing():
    made = shank(strides=5)
    found = jgait.analyse(made.recording)
    assert cuts(found.notes) == [0.0, 0.0]
    np.testing.assert_allclose(found.estimate.distance[-1], 5 * LENGTH, atol=0.02)


def test_one_end():
    made = shank(strides=6).recording
    for first, last, number in ((2.75, np.inf, 0), (0.0, imu_of(made).time[-1] - 2.8, 1)):
        estimate = ankle_stride.estimate(ankle_stride.AnkleParams(), cut(made, first, last))
        found = cuts(estimate.diagnostics["notes"])
        assert found[number] > 0.2 and found[1 - number] == 0.0
