"""A late thigh is named although its rate hardly shows the stride's frequency; a limp and a run are no late clocks."""

import numpy as np
import pytest

from jgait.estimators.combined.phases import swing_phases
from jgait.types import Imu

STRIDE_S, TIME = 1.1, np.arange(0.0, 20.0, 0.01)


def rate(late, *bumps):
    """A sensor that turns in bumps: share of the stride at which each is, and its height [rad/s]."""
    phase = (TIME - late) / STRIDE_S
    size = sum(height * np.exp(8.0 * (np.cos(2.0 * np.pi * (phase - at)) - 1.0)) for at, height in bumps)
    gyr = np.stack([0.0 * TIME, size, 0.0 * TIME], axis=1)
    return Imu(TIME, gyr, None, np.ones(TIME.size, bool))


SWING, THIGH = ((0.0, 5.0),), ((-0.245, 3.0), (0.145, 2.8))


def walk(right=THIGH, left=THIGH, late=(0.0, 0.0)):
    half = 0.5 * STRIDE_S
    return {
        "shank_right": rate(0.0, *SWING), "shank_left": rate(half, *SWING),
        "thigh_right": rate(late[0], *right), "thigh_left": rate(half + late[1], *left),
    }  # fmt: skip


@pytest.mark.parametrize(("late", "off"), [((0.45, 0.0), "thigh_right"), ((0.0, -0.4), "thigh_left")])
def test_a_late_thigh_is_named_by_the_other_thigh(late, off):
    (note,), doubtful = swing_phases(walk(late=late))
    assert note.values["placement"] == off and doubtful == {off}
    assert note.values["seconds"] == pytest.approx(max(map(abs, late)), abs=0.05)


def test_thighs_that_move_in_another_way_or_shift_a_little_are_not_named():
    assert swing_phases(walk()) == ([], set())
    assert swing_phases(walk(right=((-0.12, 2.0), (0.2, 2.5), (0.5, 3.0)))) == ([], set())
    assert swing_phases(walk(late=(0.15, 0.0))) == ([], set())
