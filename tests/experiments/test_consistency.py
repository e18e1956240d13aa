"""A filter that is right is called so as often as asked for; one whose noise is wrong is not."""

import numpy as np
import pytest
from scipy import stats

from experiments.common import consistency

Q, R, STEPS, RUNS = np.diag([0.02, 0.05]), 0.4, 120, 200
F, H = np.array([[1.0, 0.1], [0.0, 0.95]]), np.array([1.0, 0.0])


def filtered(scale=1.0, runs=RUNS):
    """Kalman filter with `scale` times the true noise covariances on runs of its own model, all at once.

    Returns innovation over its standard deviation (runs, T), last error (runs, 2), its covariance (2, 2).
    """
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(runs, 2))
    mean, P = np.zeros((runs, 2)), np.eye(2)
    white = np.zeros((runs, STEPS))
    for step in range(STEPS):
        truth = truth @ F.T + rng.normal(size=(runs, 2)) * np.sqrt(np.diag(Q))
        seen = truth @ H + np.sqrt(R) * rng.normal(size=runs)
        mean, P = mean @ F.T, F @ P @ F.T + scale * Q
        S = H @ P @ H + scale * R
        gain = P @ H / S
        innovation = seen - mean @ H
        white[:, step] = innovation / np.sqrt(S)
        mean, P = mean + innovation[:, None] * gain, P - np.outer(gain, gain) * S
    return white, mean - truth, P


def near(rate, nominal, runs):
    return abs(rate - nominal) < 6.0 * np.sqrt(nominal * (1.0 - nominal) / runs)


def test_a_filter_of_its_own_model_is_consistent_at_the_nominal_rate():
    level = 0.95
    white, error, P = filtered()
    results = [consistency.nis_consistency(run**2, 1) for run in white]
    assert near(np.mean([one.consistent for one in results]), level, RUNS)
    assert np.mean([one.mean for one in results]) == pytest.approx(1.0, abs=0.03)
    assert np.mean([one.share_inside for one in results]) == pytest.approx(level, abs=0.02)
    tests = [consistency.whiteness(run) for run in white]
    assert near(np.mean([one.consistent for one in tests]), level, RUNS)
    # the last instant of 200 runs, in 20 groups of 10
    groups = [
        consistency.nees_consistency(part, covariance=np.broadcast_to(P, (10, 2, 2)))
        for part in error.reshape(20, 10, 2)
    ]
    assert near(np.mean([one.consistent for one in groups]), level, 20)
    assert all(one.freedom == 20 and one.n == 10 for one in groups)


@pytest.mark.parametrize("scale", [1.0 / 16.0, 16.0])
def test_a_filter_whose_noise_is_four_times_wrong_is_found_out(scale):
    # in variance and in standard deviation; both noises alike, so that the gain is right and only the size is not
    white, error, P = filtered(scale, runs=50)
    results = [consistency.nis_consistency(run**2, 1) for run in white]
    assert not any(one.consistent for one in results)
    assert np.mean([one.mean for one in results]) == pytest.approx(1.0 / scale, rel=0.15)
    nees = consistency.nees_consistency(error, covariance=np.broadcast_to(P, (50, 2, 2)))
    assert not nees.consistent and (nees.mean > nees.high) == (scale < 1.0)


def test_whiteness_without_gaps_is_the_textbook_s():
    values = np.random.default_rng(0).normal(size=60)
    result = consistency.whiteness(values)
    r = np.array([values[k:] @ values[:-k] / (values @ values) for k in range(1, 21)])
    n, k = 60, np.arange(1, 21)
    assert result.statistic == pytest.approx(n * (n + 2) * np.sum(r**2 / (n - k)))
    assert result.p_value == pytest.approx(stats.chi2.sf(result.statistic, 20))
    np.testing.assert_allclose(result.autocorrelation[:, 0], r * n / (n - k))
    np.testing.assert_allclose(result.band[:, 0], stats.norm.ppf(0.975) / np.sqrt(n - k))
    assert result.share_inside == np.mean(np.abs(result.autocorrelation) <= result.band)
