"""Missing samples in the comparisons of sensors: short gaps are bridged, and what lies in a long gap does not count."""

import numpy as np

from jgait.signal.windows import over_losses, true_runs
from jgait.types import Imu

LONG_GAP_S = 0.1
"""[s] Shortest gap whose samples do not count."""


def bridged(imu: Imu, rate_hz: float) -> Imu:
    """The sensor with its gyroscope interpolated over short gaps; it is 0 in long ones."""
    mask = np.asarray(imu.mask)
    if mask.all() or not mask.any():
        return imu
    gyr = over_losses(np.arange(len(mask)), imu.gyr, mask)
    return imu._replace(gyr=np.where(in_long_gaps(imu, rate_hz)[:, None], 0.0, gyr))


def in_long_gaps(imu: Imu, rate_hz: float) -> np.ndarray:
    """(T,) bool, samples in gaps longer than `LONG_GAP_S`."""
    mask = np.asarray(imu.mask)
    lost = np.zeros(len(mask), bool)
    for start, end in true_runs(~mask):
        lost[start:end] = end - start > LONG_GAP_S * rate_hz
    return lost
