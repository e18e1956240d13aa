"""What strides show of a shoe's sensor: the scale of its gyroscope, and that it was put on anew."""

import jax
import numpy as np
import pytest
from made.notes import of_code
from made.rates import changed, factors_of
from made.trunk import worn
from scipy.spatial.transform import Rotation

from jgait import simulate
from jgait.estimators import foot_ins
from jgait.simulate.sensors import MPU6000, OPAL

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


def pause_of(truth):
    ends = np.sort(truth.strides.end[np.asarray(truth.strides.valid)])
    return ends[np.argmax(np.diff(ends))] + 2.5


@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_a_sensor_that_was_put_on_anew_is_named_and_one_that_stays_is_not(degrees):
    person = simulate.person_of(simulate.population(jax.random.key(3), 1, recorded=False), 0)
    walked, truth = simulate.with_breaks(
        jax.random.key(4), person, [simulate.straight(15.0)] * 2, [5.0], OPAL, placements=("foot_right",)
    )
    imu = walked.sensors["foot_right"]
    at = pause_of(truth)
    turn, later = Rotation.from_euler("x", degrees, degrees=True), (imu.time > at)[:, None]
    gyr, acc = (np.where(later, turn.apply(values), values) for values in (imu.gyr, imu.acc))
    found = foot_ins.estimate(foot_ins.FootParams(), worn(walked, gyr=gyr, acc=acc))
    notes = of_code(found.diagnostics["notes"], "leans_otherwise")
    assert len(notes) == (degrees > 0.0)
    for note in notes:
        assert note.values["degrees"] == pytest.approx(degrees, abs=1.0)
        assert note.values["at_s"] == pytest.approx(at, abs=6.0)
