"""Filters on the host, for references."""

import numpy as np
from scipy.signal import butter, filtfilt


def low_pass(values: np.ndarray, cutoff_hz: float, rate_hz: float) -> np.ndarray:
    """Second-order Butterworth forwards and backwards, along the first axis."""
    numerator, denominator = butter(2, min(cutoff_hz, 0.45 * rate_hz) / (rate_hz / 2))
    return filtfilt(numerator, denominator, np.asarray(values, np.float64), axis=0)
