"""The readings of one sensor on a foot or a shank, without holes and clipped peaks."""

from typing import NamedTuple

import numpy as np

from jgait.estimators.lagged import JUMP_S
from jgait.estimators.notes import CLIPPED
from jgait.geometry.arrays import xp
from jgait.notes import Note
from jgait.signal import clipping
from jgait.signal.windows import over_losses, window_maximum
from jgait.types import Imu, Values, as_float


class RepairedReadings(NamedTuple):
    """Readings of a sensor whose lost samples are interpolated and whose clipped peaks are restored, leaves (T, …)."""

    gyr: np.ndarray  #: (3,) angular rate [rad/s].
    acc: np.ndarray  #: (3,) specific force [m/s²].
    lost: np.ndarray  #: bool, the sample was not measured, or comes late.
    gyr_clipped: np.ndarray  #: bool, the gyroscope clipped.
    acc_clipped: np.ndarray  #: bool, the accelerometer clipped.
    gyr_doubt: np.ndarray  #: standard deviation of the rate where it clipped, else 0 [rad/s].
    acc_doubt: np.ndarray  #: standard deviation of the specific force where it clipped, else 0 [m/s²].

    def notes(self, placement: str) -> list[Note]:
        """Notes on signals that clipped."""
        signals = {"accelerometer": self.acc_clipped, "gyroscope": self.gyr_clipped}
        return [
            CLIPPED(signal=signal, placement=placement, samples=clipped.sum())
            for signal, clipped in signals.items() if clipped.any()
        ]  # fmt: skip


def readings(
    imu: Imu, time: np.ndarray, clips_above: tuple[float, float], doubt: tuple[float, float], least: int = 2
) -> RepairedReadings:
    """The readings of a sensor with an accelerometer, of which at least one sample was measured at `time` (T,) [s].

    `least` equal samples or more at the maximum of an axis clip above `clips_above` [rad/s, m/s²]; `doubt` are standard
    deviations of clipped samples that cannot be restored [rad/s, m/s²].
    """
    mask = np.asarray(imu.mask, bool)
    gyr, acc = (over_losses(time, values, mask) for values in (imu.gyr, imu.acc))
    as_read = [np.where(mask[:, None], as_float(values), 0.0) for values in (imu.gyr, imu.acc)]
    peaks = clipping.restored(gyr)
    equal = clipping.at_limit(as_read[0], clips_above[0], least) & ~peaks.clipped
    clipped = clipping.forces_clipped(as_read[1], clips_above[1], least)
    forces = clipping.restored_forces(acc, clipped | ~mask)
    step = np.diff(time, prepend=time[0])
    return RepairedReadings(
        peaks.signal, forces.signal, ~mask | (step > 1.5 * np.median(step[1:])), equal | peaks.clipped, clipped,
        np.maximum(peaks.doubt, doubt[0] * equal), np.where(forces.clipped, forces.doubt, doubt[1] * clipped),
    )  # fmt: skip


def jumps(gyr: np.ndarray, acc: np.ndarray, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """(T,) largest change of rate and of force from sample to sample, over `JUMP_S` before and after each sample."""
    size = max(3, 2 * round(JUMP_S * rate_hz) + 1)
    gyr_jump, acc_jump = (
        window_maximum(np.linalg.norm(np.gradient(values, axis=0), axis=1), size) for values in (gyr, acc)
    )
    return gyr_jump, acc_jump


def mean_over_interval(values: Values) -> Values:
    """(T, …) mean of each sample and the one before it; the first sample is as it is."""
    return xp.concatenate([values[:1], 0.5 * (values[1:] + values[:-1])])
