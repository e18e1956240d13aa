"""The distance between the legs, as a range sensor at an ankle measures it."""

import jax
import numpy as np
import pytest

from jgait import simulate
from jgait.simulate.ranged import SKIN
from jgait.simulate.sensors import HC_SR04


def test_the_range_between_the_legs_and_their_skin_make_the_step_width():
    gait = simulate.RECORDED._replace(step_width=0.3, steps=8.0)
    _, truth = simulate.recording(
        jax.random.key(0), simulate.Person(gait=gait), simulate.straight(6.0), rate=128.0, placements=("foot_left",)
    )
    read, apart = simulate.feet_range(jax.random.key(1), truth)
    time, heard = truth.estimate.time, np.asarray(read.mask)
    np.testing.assert_allclose(np.diff(time[heard]).min(), 1.0 / 30.0, atol=0.008)
    error = read.distance[heard] - apart[heard]
    late = error > 0.05
    assert np.mean(late) < 0.1
    assert np.std(error[~late]) < 0.004
    # While the legs pass each other.
    inside = heard & (truth.estimate.distance > 1.0) & (truth.estimate.distance < truth.estimate.distance[-1] - 1.0)
    assert np.median(apart[inside]) + 2.0 * SKIN == pytest.approx(0.30, abs=0.04)
    with pytest.raises(ValueError, match="outlier"):
        simulate.feet_range(jax.random.key(1), truth, HC_SR04._replace(outlier=2.0))
