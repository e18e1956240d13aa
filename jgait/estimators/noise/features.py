"""Features of a sensor's signals from which noise models compute variances; NumPy, on the host.

Logarithms of magnitudes, so that a linear function of them is a product of powers. Windows end at the sample that they
describe, but `jolt`, `jerk` and `since_contact` use up to 8 ms after it, and `stance` is that of a detector which sees
the whole recording. Only magnitudes are used, so the sensor may be mounted in any orientation.

| feature | logarithm of | over |
|---|---|---|
| `rate`, `rate_long` | root mean square of the angular rate | 25 ms, 0.1 s |
| `shake`, `shake_long` | spread of the specific force | 25 ms, 0.1 s |
| `weight`, `weight_long` | difference of the mean force's length from gravity | 25 ms, 0.1 s |
| `speed` | root mean square of the angular rate | 1.5 s, about a stride |
| `jolt`, `jerk` | change of the specific force and of the rate from sample to sample | 15 ms |
| `stance` | no logarithm: ½ in a stance of the detector, −½ elsewhere | |
| `since_contact` | no logarithm: exp(−t / 0.1 s), t the time since the last jolt of a contact | |
| `clipped` | no logarithm: 1 where a sample was lost or clipped | |
"""

import numpy as np

from jgait.geometry.vectors import GRAVITY
from jgait.types import AnyArray

FEATURES = (
    "rate", "shake", "weight", "rate_long", "shake_long", "weight_long", "speed", "jolt", "jerk", "stance",
    "since_contact", "clipped",
)  # fmt: skip
"""Names of the features, in the order of the columns."""

SHORT, LONG, STRIDE = 0.025, 0.105, 1.5
"""[s] Windows."""

FLOOR = 0.1
"""[rad/s], [m/s²] Added in quadrature to magnitudes, so that sensors at rest have no infinite logarithm."""

RATE, FORCE = 0.4, 0.5
"""[rad/s], [m/s²] Magnitudes in stance, whose logarithm is 0."""

CONTACT, AFTER = 20.0, 0.1
"""[m/s²] Change of the force from sample to sample at a contact; [s] time constant of `since_contact`."""


def features(
    gyr: np.ndarray, acc: np.ndarray | None, jumps: tuple[AnyArray, AnyArray], stands: AnyArray, doubtful: AnyArray,
    sampling_rate_hz: float,
) -> np.ndarray:  # fmt: skip
    """The features (T, F) of a sensor, in the order of `FEATURES`.

    Args:
        gyr: (T, 3) angular rate without bias [rad/s], finite.
        acc: (T, 3) specific force [m/s²], finite.
        jumps: (T,) change of the rate [rad/s] and of the force [m/s²] from sample to sample.
        stands: (T,) bool, stances of the detector.
        doubtful: (T,) bool, lost or clipped samples.
        sampling_rate_hz: rate of the samples [Hz].

    Raises:
        ValueError: without an accelerometer.
    """
    if acc is None:
        raise ValueError("a noise model with features needs an accelerometer; the sensor has a gyroscope alone")
    turning = (gyr**2).sum(axis=1)
    centred = acc - acc.mean(axis=0)

    def of_window(seconds: float) -> list[np.ndarray]:
        size = max(2, round(seconds * sampling_rate_hz))
        mean = _trailing(centred, size)
        spread = np.maximum(_trailing(centred**2, size) - mean**2, 0.0).sum(axis=1)
        off = np.linalg.norm(mean + acc.mean(axis=0), axis=1) - GRAVITY
        return [_half_log(_trailing(turning, size), RATE), _half_log(spread, FORCE), _half_log(off**2, FORCE)]

    jolts = np.asarray(jumps[1])
    at = np.arange(len(gyr))
    last = np.maximum.accumulate(np.where(jolts > CONTACT, at, -(10**9)))
    columns = [
        *of_window(SHORT), *of_window(LONG),
        _half_log(_trailing(turning, max(2, round(STRIDE * sampling_rate_hz))), 1.0),
        np.log(jolts + 0.05), np.log((np.asarray(jumps[0]) + 0.01) / 0.1), np.where(stands, 0.5, -0.5),
        np.exp(-(at - last) / (AFTER * sampling_rate_hz)), np.asarray(doubtful, np.float64),
    ]  # fmt: skip
    return np.stack(columns, axis=1)


def _half_log(square: np.ndarray, typical: float) -> np.ndarray:
    return 0.5 * np.log((square + FLOOR**2) / typical**2)


def _trailing(values: np.ndarray, size: int) -> np.ndarray:
    """Mean over the `size` samples up to each sample; before the start the first sample is repeated."""
    total = np.cumsum(np.concatenate([np.repeat(values[:1], size, axis=0), values]), axis=0)
    return (total[size:] - total[:-size]) / size
