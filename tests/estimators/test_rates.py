"""Rates of a shoe or a shank, or a sampling rate, with a wrong scale."""

import jax
import numpy as np
import pytest

import jgait
from jgait import simulate
from jgait.estimators import ankle_stride, foot_ins
from jgait.estimators.notes import RATES_OFF
from jgait.simulate.sensors import MPU6000
from jgait.types import SIDES

FEET, SHANKS = (tuple(f"{kind}_{side}" for side in SIDES) for kind in ("foot", "shank"))
PLACES = {foot_ins: FEET, ankle_stride: SHANKS}


@pytest.fixture(scope="module")
def walk():
    person = simulate.Person(gait=simulate.gait(speed=1.25, stature=1.75)._replace(steps=20.0))
    return simulate.recording(jax.random.key(6), person, errors=MPU6000, placements=(*FEET, *simulate.FOUR))


def changed(recording, placements, clock=1.0, rates=1.0):
    """The recording whose clock, and the rates of some of its sensors, are too large by factors."""
    sensors = {
        name: imu._replace(time=imu.time / clock, gyr=imu.gyr * (rates if name in placements else 1.0))
        for name, imu in recording.sensors.items()
    }
    return recording._replace(sensors=sensors, sampling_rate_hz=recording.sampling_rate_hz * clock)


def estimated(method, recording):
    sensors = {name: recording.sensors[name] for name in PLACES[method]}
    return method.estimate(method.estimator().params, recording._replace(sensors=sensors))


def factors_of(estimate):
    """Placement → factor of the notes on rates."""
    notes = estimate.diagnostics["notes"]
    return {note.values["placement"]: note.values["factor"] for note in notes if note.code == RATES_OFF.code}


@pytest.mark.parametrize(
    ("method", "wrong"), [(foot_ins, 0), (foot_ins, 1), (ankle_stride, 0)], ids=["feet", "one foot", "shanks"]
)
def test_only_a_sensor_with_a_wrong_scale_is_named(walk, method, wrong):
    placements = PLACES[method][:wrong]
    assert set(factors_of(estimated(method, changed(walk[0], placements, rates=0.8)))) == set(placements)


@pytest.mark.parametrize(
    ("method", "change", "factor"),
    [
        (foot_ins, {"clock": 1.28}, 1.28), (foot_ins, {"rates": 0.8}, 1.25),
        (ankle_stride, {"clock": 1.28}, 1.28), (ankle_stride, {"rates": 1.18}, 0.85),
    ],
    ids=["clock of feet", "rates of feet", "clock of shanks", "rates of shanks"],
)  # fmt: skip
def test_a_wrong_sampling_rate_or_scale_is_noted_and_lengths_are_as_uncertain(walk, method, change, factor):
    recording, truth = walk
    estimate = estimated(method, changed(recording, PLACES[method], **change))
    factors = factors_of(estimate)
    assert set(factors) == set(PLACES[method])
    assert max(abs(value / factor - 1.0) for value in factors.values()) < (0.06 if method is foot_ins else 0.08)
    off = abs(float(estimate.distance[-1] - truth.estimate.distance[-1]))
    assert off < 2.0 * float(estimate.diagnostics["distance_stddev"][-1])
    if method is foot_ins:
        valid = np.asarray(estimate.strides.valid)
        assert off > 0.5 and np.all((estimate.strides_stddev.length / estimate.strides.length)[valid] > 0.35)


def of_legs(recording):
    sensors = {name: recording.sensors[name] for name in simulate.FOUR}
    return jgait.analyse(recording._replace(sensors=sensors), {"height": 1.75}).estimate


def test_of_two_shanks_the_one_with_the_wrong_scale_is_named_and_its_angles_are_not_usable(walk):
    estimate = of_legs(changed(walk[0], SHANKS[:1], rates=0.85))
    assert set(factors_of(estimate)) == {"shank_right"}
    assert not estimate.diagnostics["angles_valid_right"] and estimate.diagnostics["angles_valid_left"]


def test_a_wrong_rate_of_all_sensors_makes_the_distance_of_the_legs_uncertain_too(walk):
    recording, truth = walk
    estimate = of_legs(changed(recording, (), clock=1.28))
    off = abs(float(estimate.distance[-1] - truth.estimate.distance[-1]))
    assert off < 2.0 * float(np.ravel(estimate.diagnostics["distance_stddev"])[-1])
    assert not estimate.diagnostics["angles_valid_left"]
