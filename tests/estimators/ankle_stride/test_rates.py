"""Rates of a shank, or a sampling rate, with a wrong scale."""

import jax
import numpy as np
import pytest
from made.rates import changed, factors_of

import jgait
from jgait import simulate
from jgait.estimators import ankle_stride
from jgait.simulate.sensors import MPU6000

SHANKS = ("shank_right", "shank_left")


@pytest.fixture(scope="module")
def walk():
    person = simulate.Person(gait=simulate.gait(speed=1.25, stature=1.75)._replace(steps=20.0))
    worn = (*SHANKS, "thigh_right", "thigh_left")
    return simulate.recording(jax.random.key(6), person, errors=MPU6000, placements=worn)


def test_undamaged_shanks_have_no_wrong_rates(walk):
    assert not factors_of(ankle_stride.estimate(ankle_stride.AnkleParams(), walk[0]))


@pytest.mark.parametrize(("change", "factor"), [({"clock": 1.28}, 1.28), ({"rates": 1.18}, 0.85)])
def test_a_wrong_sampling_rate_or_scale_is_noted_and_lengths_are_as_uncertain(walk, change, factor):
    recording, truth = walk
    estimate = ankle_stride.estimate(ankle_stride.AnkleParams(), changed(recording, SHANKS, **change))
    factors = factors_of(estimate)
    assert set(factors) == set(SHANKS)
    assert max(abs(value / factor - 1.0) for value in factors.values()) < 0.08
    off = abs(float(estimate.distance[-1] - truth.estimate.distance[-1]))
    assert off < 2.0 * float(estimate.diagnostics["distance_stddev"][-1])


def test_of_two_shanks_the_one_with_the_wrong_scale_is_named_and_its_angles_are_not_usable(walk):
    gait = jgait.analyse(changed(walk[0], SHANKS[:1], rates=0.85), {"height": 1.75})
    assert set(factors_of(gait.estimate)) == {"shank_right"}
    assert not gait.estimate.diagnostics["angles_valid_right"]
    assert gait.estimate.diagnostics["angles_valid_left"]


def test_a_wrong_rate_of_all_sensors_makes_the_distance_of_the_legs_uncertain_too(walk):
    recording, truth = walk
    gait = jgait.analyse(changed(recording, SHANKS, clock=1.28), {"height": 1.75})
    off = abs(float(gait.estimate.distance[-1] - truth.estimate.distance[-1]))
    assert off < 2.0 * float(np.ravel(gait.estimate.diagnostics["distance_stddev"])[-1])
    assert not gait.estimate.diagnostics["angles_valid_left"]
