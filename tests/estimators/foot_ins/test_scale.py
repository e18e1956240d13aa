"""What strides show of a shoe's sensor: the scale of its gyroscope."""

import jax
import numpy as np
import pytest
from made.rates import changed, factors_of

from jgait import simulate
from jgait.estimators import foot_ins
from jgait.simulate.sensors import MPU6000

FEET = ("foot_right", "foot_left")


@pytest.fixture(scope="module")
def walk():
    person = simulate.Person(gait=simulate.gait(speed=1.25, stature=1.75)._replace(steps=20.0))
    return simulate.recording(jax.random.key(4), person, errors=MPU6000, placements=(*FEET, "pelvis"))


@pytest.mark.parametrize("wrong", [(), FEET[:1]], ids=["none", "right"])
def test_only_a_foot_with_a_wrong_scale_is_named(walk, wrong):
    estimate = foot_ins.estimate(foot_ins.FootParams(), changed(walk[0], wrong, rates=0.8))
    assert set(factors_of(estimate)) == set(wrong)


@pytest.mark.parametrize(("change", "factor"), [({"clock": 1.28}, 1.28), ({"rates": 0.8}, 1.25)])
def test_a_wrong_sampling_rate_or_scale_is_noted_and_lengths_are_as_uncertain(walk, change, factor):
    recording, truth = walk
    estimate = foot_ins.estimate(foot_ins.FootParams(), changed(recording, FEET, **change))
    factors = factors_of(estimate)
    assert set(factors) == set(FEET)
    assert max(abs(value / factor - 1.0) for value in factors.values()) < 0.06
    short = abs(float(estimate.distance[-1] - truth.estimate.distance[-1]))
    assert short > 0.5
    assert short < 2.0 * float(estimate.diagnostics["distance_stddev"][-1])
    valid = np.asarray(estimate.strides.valid)
    shares = np.asarray(estimate.strides_stddev.length)[valid] / np.asarray(estimate.strides.length)[valid]
    assert (shares > 0.35).all()
