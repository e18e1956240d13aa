"""Instants of stances that the begin or the end of a recording cuts off."""

import numpy as np
import pytest

from jgait.events import shank_stance

RATE_HZ, STRIDE, SWING = 100.0, 110, 42
NEAR = 8
"""[samples] In the valley a rate is as low as within this time beside its least."""


def rates(strides=6):
    """A sagittal rate with a landing and a push-off about the valley of each stance, where the swings begin and end."""
    swing = -6.0 * np.sin(np.pi * np.arange(SWING) / SWING)
    share = np.linspace(0.0, 1.0, STRIDE - SWING)
    stance = 1.0 - np.cos(4.0 * np.pi * share) + 2.2 * np.exp(-(((share - 0.85) / 0.08) ** 2))
    stance[[0, -1]] = 0.0
    rate = np.concatenate([np.zeros(100), *[swing, stance] * strides, np.zeros(100)])
    start = 100 + STRIDE * np.arange(strides)
    return rate, start, start + SWING


@pytest.mark.parametrize("cut", range(300, 300 + STRIDE))
def test_a_stance_that_is_cut_off_rests_in_its_valley_or_not_at_all(cut):
    """The rate also passes zero between push-off and swing, and between swing and landing."""
    rate, start, end = rates()
    whole = shank_stance.stances(rate, np.abs(rate), start, end, RATE_HZ)
    ends, begins = end < cut, start >= cut
    before = shank_stance.stances(rate[:cut], np.abs(rate[:cut]), start[ends], end[ends], RATE_HZ)
    after = shank_stance.stances(rate[cut:], np.abs(rate[cut:]), start[begins] - cut, end[begins] - cut, RATE_HZ)
    if before.rests[-1, 1]:
        assert abs(before.end[-1] - whole.end[ends][-1]) <= NEAR
    if after.rests[0, 0]:
        assert abs(after.begin[0] + cut - whole.begin[begins][0]) <= NEAR
