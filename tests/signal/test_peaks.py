"""Maxima of a signal, as `scipy.signal.find_peaks` finds them."""

import numpy as np
import pytest
from scipy import signal

from jgait.signal.peaks import peaks


@pytest.mark.parametrize("seed", range(8))
def test_peaks_are_those_of_scipy(seed):
    random = np.random.default_rng(seed)
    x = random.integers(0, 9, 300).astype(float) if seed % 2 else random.normal(size=300).cumsum()
    limits = {"height": float(np.median(x)), "prominence": float(random.uniform(0.0, 3.0))}
    if not seed % 2:  # of equal heights, SciPy does not state which one it keeps
        limits["distance"] = int(random.integers(1, 30))
    np.testing.assert_array_equal(peaks(x, **limits), signal.find_peaks(x, **limits)[0])


def test_a_signal_without_maxima_has_no_peaks():
    for x in (np.zeros(0), np.ones(1), np.ones(5), np.arange(9.0)):
        assert len(peaks(x)) == 0
