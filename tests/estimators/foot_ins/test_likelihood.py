"""The likelihood by which a foot is tuned without a reference: sparse in time, and of heavy tails."""

import jax
import numpy as np
import pytest
from made.foot import foot

from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import FootParams

ESTIMATOR = foot_ins.estimator()
LIKELIHOOD = jax.jit(ESTIMATOR.likelihood, static_argnums=2)


@pytest.fixture(scope="module")
def recording():
    return foot(strides=4, hz=100.0).recording


def blow(recording, size):
    """The recording with a blow of so many m/s² over five samples in the last swing."""
    imu = recording.sensors["foot_right"]
    inputs = ESTIMATOR.prepare(recording).inputs.right
    at = int(inputs.foothold[int(inputs.count) - 1]) - 60  # in the swing before it
    acc = np.array(imu.acc)
    acc[at : at + 5, 0] += size * np.array([0.9, 1.1, 1.2, 1.0, 0.8])  # not flat, as a clipped one would be
    return recording._replace(sensors={"foot_right": imu._replace(acc=acc)})


def test_one_sample_in_a_tenth_of_a_second_counts(recording):
    made = ESTIMATOR.prepare(recording)
    whole = made.inputs._replace(time=made.inputs.time + 0.003)  # no sample at a multiple of .1 s
    stands, first = whole.right.stands, np.diff(np.floor(whole.time / 0.1), prepend=-1.0) != 0.0
    sparse, other = (whole._replace(right=whole.right._replace(stands=stands & some)) for some in (first, ~first))
    values = [LIKELIHOOD(FootParams(), inputs, made.options) for inputs in (whole, sparse, other)]
    assert np.isfinite(values[0])
    np.testing.assert_allclose(values[1], values[0], rtol=1e-12)
    assert values[2] == pytest.approx(0.0, abs=1e-12)


def test_a_blow_counts_by_its_logarithm(recording):
    """With a normal density, its cost would grow with the square of its size."""
    gaussian, heavy = [], []
    for size in (100.0, 200.0):
        made = ESTIMATOR.prepare(blow(recording, size))
        p = FootParams(acc_jump_noise=1e-9)
        heavy.append(float(LIKELIHOOD(p, made.inputs, made.options)))
        gaussian.append(float(ESTIMATOR.solve(p, made).diagnostics["log_likelihood_right"]))
    assert gaussian[0] - gaussian[1] > 1000.0
    assert 0.0 < heavy[0] - heavy[1] < 0.01 * (gaussian[0] - gaussian[1])
