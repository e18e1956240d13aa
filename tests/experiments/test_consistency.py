"""A filter that is right is called so as often as asked for; one whose noise is wrong is not."""

import numpy as np
import pytest
from scipy import stats

from experiments.common import consistency

Q, R, STEPS, RUNS = np.diag([0.02, 0.05]), 0.4, 120, 200
F, H = np.array([[1.0, 0.1], [0.0, 0.95]]), np.array([1.0, 0.0])


def filtered(scale=1.0, scale_seen=None, runs=RUNS, steps=STEPS, seed=0):
    """Kalman filter, told `scale` times the true noise covariances, on runs of its own model, all at once.

    `scale_seen` is for the observation's noise where that differs.

    Returns innovation over its standard deviation (runs, T), last error (runs, 2), its covariance (2, 2).
    """
    rng = np.random.default_rng(seed)
    scale_seen = scale if scale_seen is None else scale_seen
    truth = rng.normal(size=(runs, 2))
    mean, P = np.zeros((runs, 2)), np.eye(2)
    white = np.zeros((runs, steps))
    for step in range(steps):
        truth = truth @ F.T + rng.normal(size=(runs, 2)) * np.sqrt(np.diag(Q))
        seen = truth @ H + np.sqrt(R) * rng.normal(size=runs)
        mean, P = mean @ F.T, F @ P @ F.T + scale * Q
        S = H @ P @ H + scale_seen * R
        gain = P @ H / S
        innovation = seen - mean @ H
        white[:, step] = innovation / np.sqrt(S)
        mean, P = mean + innovation[:, None] * gain, P - np.outer(gain, gain) * S
    return white, mean - truth, P


@pytest.fixture(scope="module")
def right():
    return filtered()


def near(rate, nominal, runs):
    return abs(rate - nominal) < 6.0 * np.sqrt(nominal * (1.0 - nominal) / runs)


def test_a_filter_of_its_own_model_is_consistent_at_the_nominal_rate(right):
    level = 0.95
    white, error, P = right
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


@pytest.mark.parametrize("scale", [1.0 / 16.0, 0.25, 4.0, 16.0])
def test_a_filter_whose_noise_is_four_times_wrong_is_found_out(scale):
    # in variance and in standard deviation; both noises alike, so that the gain is right and only the size is not
    white, error, P = filtered(scale, runs=50)
    results = [consistency.nis_consistency(run**2, 1) for run in white]
    assert not any(one.consistent for one in results)
    assert np.mean([one.mean for one in results]) == pytest.approx(1.0 / scale, rel=0.15)
    nees = consistency.nees_consistency(error, covariance=np.broadcast_to(P, (50, 2, 2)))
    assert not nees.consistent and (nees.mean > nees.high) == (scale < 1.0)


@pytest.mark.parametrize("process, seen", [(16.0, 1.0 / 16.0), (1.0 / 64.0, 4.0)])
def test_a_filter_whose_gain_is_wrong_leaves_colour(process, seen):
    white, _, _ = filtered(process, seen, runs=50, steps=400)
    assert np.mean([consistency.whiteness(run).consistent for run in white]) < 0.1
    first = np.mean([consistency.whiteness(run).autocorrelation[0] for run in white])
    assert (first > 0.0) == (process < seen)  # a filter too slow to follow errs the same way twice


def test_an_autoregressive_series_is_not_white():
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(200, 300))
    coloured = noise.copy()
    for step in range(1, 300):
        coloured[:, step] += 0.4 * coloured[:, step - 1]
    assert np.mean([consistency.whiteness(run).consistent for run in coloured]) < 0.05
    result = consistency.whiteness(coloured.T[:, :3])
    np.testing.assert_allclose(result.autocorrelation[:3].mean(axis=1), 0.4 ** np.arange(1, 4), atol=0.12)
    assert not result.consistent and result.p_value < 1e-6
    assert near(np.mean([consistency.whiteness(run).consistent for run in noise]), 0.95, 200)


def test_a_bias_shows():
    biased = np.random.default_rng(0).normal(0.5, 1.0, 400)
    assert not consistency.whiteness(biased).consistent


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


def test_lost_samples_are_no_part_of_any_pair():
    rng = np.random.default_rng(3)
    values = rng.normal(size=(200, 2))
    mask = rng.random((200, 2)) < 0.7
    expected = consistency.whiteness(np.where(mask, values, np.nan))
    k, (x, m) = 3, (values[:, 1], mask[:, 1])
    pairs = [(x[t], x[t + k]) for t in range(200 - k) if m[t] and m[t + k]]
    by_hand = np.mean([a * b for a, b in pairs]) / np.mean(x[m] ** 2)
    assert expected.autocorrelation[k - 1, 1] == pytest.approx(by_hand)
    assert expected.band[k - 1, 1] == pytest.approx(1.959964 / np.sqrt(len(pairs)))
    assert expected.n.tolist() == mask.sum(axis=0).tolist()


def test_a_lag_that_no_two_samples_are_apart_has_no_correlation():
    every_third = np.where(np.arange(300) % 3 == 0, 0.0, np.nan)
    rate = []
    for seed in range(100):
        result = consistency.whiteness(every_third + np.random.default_rng(seed).normal(size=300))
        assert np.isnan(result.autocorrelation[[0, 1, 3, 4, 18, 19], 0]).all()
        assert np.isfinite(result.autocorrelation[2::3, 0]).all()
        rate.append(result.consistent)
    assert near(np.mean(rate), 0.95, 100)


def test_normalised_squares_by_hand_and_only_of_steps_that_count():
    nis, count = np.array([1.0, 5.0, np.nan, 4.0]), np.array([1, 2, 3, 0])
    result = consistency.nis_consistency(nis, count)
    assert (result.n, result.freedom, result.mean) == (2, 3, 2.0)
    np.testing.assert_allclose([result.low, result.high], stats.chi2.ppf([0.025, 0.975], 3) / 3)
    inside = [0.00098 < 1.0 < 5.02, 0.0506 < 5.0 < 7.38]
    assert result.share_inside == np.mean(inside)
    assert result.consistent


def test_errors_by_covariance_and_by_stddev():
    rng = np.random.default_rng(0)
    error = rng.normal(size=(30, 2)) * [2.0, 0.1]
    spread = np.broadcast_to([2.0, 0.1], (30, 2))
    square = np.broadcast_to(np.diag([4.0, 0.01]), (30, 2, 2))
    one = consistency.nees_consistency(error, stddev=spread)
    assert one.mean == pytest.approx(np.sum((error / spread) ** 2) / 60)
    np.testing.assert_allclose(one, consistency.nees_consistency(error, covariance=square), rtol=1e-12)
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    np.testing.assert_allclose(
        one, consistency.nees_consistency(error @ turn.T, covariance=turn @ square @ turn.T), rtol=1e-9
    )
    single = consistency.nees_consistency(error[:, 0], stddev=spread[:, 0])
    assert single.mean == pytest.approx(np.mean((error[:, 0] / 2.0) ** 2))
    holes = np.where(np.arange(30)[:, None] < 5, np.nan, error)
    left = consistency.nees_consistency(holes, covariance=square)
    assert left.n == 25
    assert left.mean == pytest.approx(np.sum((error[5:] / spread[5:]) ** 2) / 50)


def test_refusals_state_what_was_wrong():
    with pytest.raises(ValueError, match=r"got \(3,\) and \(2,\)"):
        consistency.nis_consistency([1.0, 2.0, 3.0], [1, 1])
    with pytest.raises(ValueError, match="no step of nis counts"):
        consistency.nis_consistency([1.0, np.nan], [0, 1])
    with pytest.raises(ValueError, match="exactly one of covariance and stddev"):
        consistency.nees_consistency(np.ones((3, 2)))
    with pytest.raises(ValueError, match=r"covariance must be \(3, 2, 2\); got \(2, 2\)"):
        consistency.nees_consistency(np.ones((3, 2)), covariance=np.eye(2))
    with pytest.raises(ValueError, match="positive definite"):
        consistency.nees_consistency(np.ones((1, 2)), covariance=-np.eye(2)[None])
    with pytest.raises(ValueError, match="stddev must be positive; the smallest is 0"):
        consistency.nees_consistency(np.ones(2), stddev=[1.0, 0.0])
    with pytest.raises(ValueError, match=r"stddev must be \(3, 2\)"):
        consistency.nees_consistency(np.ones((3, 2)), stddev=np.ones(3))
    with pytest.raises(ValueError, match=r"T > 20; got \(10,\)"):
        consistency.whiteness(np.ones(10))
    with pytest.raises(ValueError, match=r"\[1\] has none"):
        consistency.whiteness(np.stack([np.ones(30), np.zeros(30)], axis=1))
    with pytest.raises(ValueError, match="nothing to correlate"):
        consistency.whiteness(np.where(np.arange(30) % 25 == 0, 1.0, np.nan))
