"""Doubt about strides and recordings, on simulated feet that stand as the model says and on feet that do not."""

import jax.numpy as jnp
import numpy as np
import pytest
from made.foot import foot

from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import FootParams
from jgait.estimators.stride_flags import DOUBTFUL
from jgait.estimators.trust import STANCES_RARE, doubtful, judged, nis_between, trust
from jgait.types import Estimate, Legs, Strides


def strides(height: list[float], length: list[float]) -> Strides:
    n = len(height)
    return Strides(
        np.zeros(n, int), None, None, None, np.array(length), np.full(n, np.nan), np.array(height), np.ones(n, bool)
    )


def test_the_nis_of_a_stride_is_the_mean_over_its_observations():
    nis = jnp.array([9.0, 0.0, 2.0, 0.0, 4.0, 0.0, 30.0])
    count = jnp.array([3.0, 0.0, 3.0, 0.0, 3.0, 0.0, 3.0])
    found = nis_between(nis, count, jnp.array([0, 4, 4]), jnp.array([4, 6, 5]))
    np.testing.assert_allclose(found, [6.0 / 6.0, 30.0 / 3.0, 0.0])


def test_a_stride_is_in_doubt_for_its_innovations_its_rise_or_its_deviation():
    own = strides([0.0, 0.3, 0.3, 0.0, 0.0], [1.0] * 5)
    spread = strides([0.02] * 5, [0.02, 0.02, 0.02, 0.02, 0.4])
    nis = np.array([0.05, 0.05, 1.0, 9.0, 0.05])
    # stairs are measured with small innovations
    assert doubtful(own, spread, nis).tolist() == [False, False, True, True, True]


@pytest.fixture(scope="module")
def walk():
    return foot(strides=4, roll=0.03, seed=1).recording


def test_a_foot_that_stands_is_trusted(walk):
    found = trust(foot_ins.estimate(FootParams(), walk))
    assert found.recording and found.strides is not None and found.strides.all() and found.reasons == ()


def test_of_a_foot_in_doubt_strides_with_a_large_nis_are_in_doubt():
    own, nis = strides([0.0] * 3, [1.0] * 3), np.array([0.02, 0.2, 1.0])
    estimate = Estimate(
        np.arange(3.0), Legs(None, None), None, None, np.ones(3, bool), {"stride_nis": nis}, own,
        strides_stddev=strides([0.02] * 3, [0.02] * 3),
    )  # fmt: skip
    for mean, flagged in ((0.14, [False, False, False]), (0.4, [False, False, True])):
        found = judged(estimate, {0: "foot_right"}, 0.15, {0: mean})
        assert found.diagnostics["doubtful"].tolist() == flagged
        assert trust(found).recording != any(flagged)


def test_a_foot_that_slides_in_stance_is_in_doubt(walk):
    imu = walk.sensors["foot_right"]
    # the ground moves to and fro by some centimetres, twice a second
    shaken = np.array(imu.acc) + 3.0 * np.sin(4.0 * np.pi * np.asarray(imu.time))[:, None] * np.array([1.0, 0.0, 0.0])
    estimate = foot_ins.estimate(FootParams(), walk._replace(sensors={"foot_right": imu._replace(acc=shaken)}))
    found = trust(estimate)
    assert not found.recording and found.strides is not None and not found.strides.all()
    assert {note.code for note in found.reasons} <= {"inconsistent_stances", "strides_doubtful", STANCES_RARE.code}
    np.testing.assert_array_equal(DOUBTFUL.read(estimate), ~found.strides)


@pytest.mark.parametrize("slides", [False, True])
def test_a_gap_puts_no_stances_in_doubt_but_sliding_does(slides):
    made = foot(strides=8, roll=0.03, seed=1)
    imu = made.recording.sensors["foot_right"]
    time = np.asarray(imu.time)
    lost = (time >= 4.9) & (time < 5.5)
    shaken = 6.0 * slides * np.sin(4.0 * np.pi * time)[:, None] * np.array([1.0, 0.0, 0.0])
    gyr, acc = (np.where(lost[:, None], 0.0, values) for values in (imu.gyr, imu.acc + shaken))
    walk = made.recording._replace(sensors={"foot_right": imu._replace(gyr=gyr, acc=acc, mask=~lost)})
    estimate = foot_ins.estimate(FootParams(), walk)
    assert estimate.diagnostics["nis_right"] > 0.15
    assert {note.code for note in trust(estimate).reasons} == ({"strides_doubtful"} if slides else set())
    assert any("60 samples of foot_right are lost, at most 0.60 s in a row" in str(note)
               for note in estimate.diagnostics["notes"])  # fmt: skip
