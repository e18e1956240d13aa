"""Windows, medians, moving statistics, and telling standing from walking."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage

from jgait.signal import windows as signal

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("size", [1, 3, 5, 11])
def test_median_equals_scipy_with_the_same_edges(size):
    x = RNG.normal(size=(40, 3))
    expected = ndimage.median_filter(x, size=(size, 1), mode="mirror")
    np.testing.assert_allclose(signal.median_filter(x, size), expected, rtol=1e-14)


def test_median_removes_a_spike_and_keeps_a_step():
    x = np.r_[np.zeros(10), np.ones(10)]
    spiked = x.copy()
    spiked[[4, 14]] = 100.0, -100.0
    np.testing.assert_array_equal(signal.median_filter(spiked, 5), x)


def test_median_gradient_is_that_of_the_sample_picked():
    x = jnp.asarray([3.0, 1.0, 2.0, 5.0, 4.0])
    gradient = jax.grad(lambda x: signal.median_filter(x, 3)[2])(x)  # median of 1, 2, 5
    np.testing.assert_array_equal(gradient, [0.0, 0.0, 1.0, 0.0, 0.0])


@pytest.mark.parametrize("size", [0, -3, 4])
def test_size_must_be_odd_and_positive(size):
    with pytest.raises(ValueError, match=f"size must be odd and positive.*got {size}"):
        signal.median_filter(np.zeros(20), size)


def test_too_short_for_the_window():
    with pytest.raises(ValueError, match=r"a window of 9 samples needs more than 4 samples; got shape \(4,\)"):
        signal.moving_mean(np.zeros(4), 9)
    assert signal.moving_mean(np.zeros(5), 9).shape == (5,)


@pytest.mark.parametrize("size", [1, 7])
def test_moving_statistics_equal_a_loop(size):
    x = RNG.normal(size=(25, 2)) + 3.0
    half = size // 2
    padded = np.pad(x, [(half, half), (0, 0)], mode="reflect")
    windows = np.stack([padded[k : k + size] for k in range(len(x))])
    np.testing.assert_allclose(signal.moving_mean(x, size), windows.mean(axis=1), rtol=1e-12)
    np.testing.assert_allclose(signal.moving_std(x, size), windows.std(axis=1), rtol=1e-6, atol=1e-7)


def test_moving_std_in_float32_under_gravity():
    noise = RNG.normal(scale=0.01, size=2000)
    x = (9.81 + noise).astype(np.float32)
    found = np.asarray(signal.moving_std(x, 21))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, np.asarray(signal.moving_std(x.astype(float), 21)), rtol=1e-3)


def test_moving_std_gradient_equals_finite_differences_and_is_zero_where_constant():
    x = RNG.normal(size=12)
    weight = RNG.normal(size=12)

    def total(x):
        return (signal.moving_std(x, 5) * weight).sum()

    step = 1e-6
    expected = [(total(x + step * e) - total(x - step * e)) / (2 * step) for e in np.eye(12)]
    np.testing.assert_allclose(jax.grad(total)(jnp.asarray(x)), expected, rtol=1e-5, atol=1e-8)
    np.testing.assert_array_equal(jax.grad(total)(jnp.full(12, 2.5)), np.zeros(12))


def test_window_size_is_odd():
    assert signal.window_size(0.5, 100.0) == 51
    assert signal.window_size(0.05, 100.0) == 7
    assert signal.window_size(0.0, 100.0) == 1


def test_true_runs():
    assert signal.true_runs([True, False, True, True]) == [(0, 1), (2, 4)]
    assert signal.true_runs([]) == []
    assert signal.true_runs([False, False]) == []
