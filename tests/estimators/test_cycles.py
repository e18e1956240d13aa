"""Cycles of a leg are those of its knee, where it is known and the person walks."""

import numpy as np

from jgait.estimators.cycles import swing_cycles
from jgait.types import LegTrajectory

TIME = np.linspace(0.0, 10.0, 1001)
KNEE = np.deg2rad(30.0 - 30.0 * np.cos(2.0 * np.pi * TIME))
"""Largest at 0.5, 1.5 … 9.5 s."""


def cycles(knee, valid=True):
    leg = LegTrajectory(0.0 * TIME, knee, 0.0 * TIME, 0.0 * TIME)
    return swing_cycles(TIME, leg, np.broadcast_to(valid, TIME.shape))


def test_cycles_go_from_swing_to_swing():
    assert cycles(KNEE) == [(50 + 100 * k, 150 + 100 * k) for k in range(9)]
    assert cycles(KNEE, TIME < 3.0) == [(50, 150), (150, 250)]
    assert cycles(np.where(np.abs(TIME - 2.0) < 0.01, np.nan, KNEE)) == [(50, 150), *cycles(KNEE)[2:]]


def test_small_swings_and_pauses_are_no_cycles():
    assert cycles(0.3 * KNEE) == []
    assert cycles(np.where((TIME > 4.0) & (TIME < 7.0), 0.0, KNEE)) == [
        (50, 150), (150, 250), (250, 350), (750, 850), (850, 950)
    ]  # fmt: skip
    assert swing_cycles(TIME[:1], LegTrajectory(*(TIME[:1],) * 4), np.ones(1, bool)) == []
