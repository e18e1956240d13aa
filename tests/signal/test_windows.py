"""Moving means, sizes of windows, stretches of True, and maxima."""

import numpy as np
import pytest
from scipy import ndimage
from scipy import signal as scipy_signal

from jgait.signal import windows as signal

RNG = np.random.default_rng(0)


def test_a_size_must_be_odd_and_positive_and_the_signal_not_too_short():
    for size in (0, -3, 4):
        with pytest.raises(ValueError, match=f"size must be odd and positive.*got {size}"):
            signal.moving_mean(np.zeros(20), size)
    with pytest.raises(ValueError, match=r"a window of 9 samples needs more than 4 samples; got shape \(4,\)"):
        signal.moving_mean(np.zeros(4), 9)
    assert signal.moving_mean(np.zeros(5), 9).shape == (5,)


@pytest.mark.parametrize("size", [1, 7])
def test_moving_mean_equals_a_loop(size):
    x = RNG.normal(size=(25, 2)) + 3.0
    half = size // 2
    padded = np.pad(x, [(half, half), (0, 0)], mode="reflect")
    windows = np.stack([padded[k : k + size] for k in range(len(x))])
    np.testing.assert_allclose(signal.moving_mean(x, size), windows.mean(axis=1), rtol=1e-12)


def test_the_size_of_a_window_is_odd_and_runs_are_of_true():
    assert [signal.window_size(seconds, 100.0) for seconds in (0.5, 0.05, 0.0)] == [51, 7, 1]
    assert signal.true_runs([True, False, True, True]) == [(0, 1), (2, 4)]
    assert signal.true_runs([]) == []
    assert signal.true_runs([False, False]) == []


def test_between_samples_is_numpys_interpolation_over_the_samples_numbers():
    x = np.random.default_rng(0).normal(size=(7, 2))
    place = np.array([[-1.0, 0.0, 0.25], [3.0, 5.9, 6.0], [6.5, 100.0, 2.5]])
    found = signal.between_samples(x, place)
    for k in range(2):
        np.testing.assert_allclose(found[..., k], np.interp(place, np.arange(7), x[:, k]), rtol=1e-14)
    np.testing.assert_array_equal(signal.between_samples(x[:1], np.array([-1.0, 0.0, 2.0])), x[[0, 0, 0]])


@pytest.mark.parametrize(("ends", "mode"), [("edge", "nearest"), ("reflect", "mirror")])
def test_sums_and_maxima_over_windows_are_scipys(ends, mode):
    x = np.random.default_rng(1).normal(size=(40, 2))
    for size in (1, 7, 39):
        expected = ndimage.convolve1d(x, np.ones(size), axis=0, mode=mode)
        np.testing.assert_allclose(signal.window_sum(x, size, ends), expected, rtol=0, atol=1e-13)
        highest = ndimage.maximum_filter1d(x[:, 0], size, mode="nearest")
        np.testing.assert_array_equal(signal.window_maximum(x[:, 0], size), highest)


@pytest.mark.parametrize("seed", range(8))
def test_peaks_are_those_of_scipy(seed):
    random = np.random.default_rng(seed)
    x = random.integers(0, 9, 300).astype(float) if seed % 2 else random.normal(size=300).cumsum()
    limits = {"height": float(np.median(x)), "prominence": float(random.uniform(0.0, 3.0))}
    if not seed % 2:  # of equal heights, SciPy does not state which one it keeps
        limits["distance"] = int(random.integers(1, 30))
    np.testing.assert_array_equal(signal.peaks(x, **limits), scipy_signal.find_peaks(x, **limits)[0])


def test_a_signal_without_maxima_has_no_peaks():
    for x in (np.zeros(0), np.ones(1), np.ones(5), np.arange(9.0)):
        assert len(signal.peaks(x)) == 0
