r"""Zero-velocity detectors: the samples at which a foot with a sensor stands still. On the host, in NumPy and SciPy.

Each is a statistic over a centred window, in physical units, that is small while the foot stands; `zero_velocity`
compares it with a threshold. With ⟨·⟩ the mean over the window's samples that count, f the specific force, g gravity:

| name | statistic | unit |
|---|---|---|
| `ared` | √⟨abs(ω)²⟩, the angular rate | rad/s |
| `variance` | √⟨abs(f − ⟨f⟩)²⟩, the standard deviation of the force | m/s² |
| `magnitude` | √⟨(abs(f) − g)²⟩, the difference of the force's length from gravity | m/s² |
| `shoe` | √(⟨abs(ω)²⟩ + (σ_ω/σ_a)² ⟨abs(f − g ⟨f⟩/abs(⟨f⟩))²⟩), rate and force together | rad/s |

All statistics use vector lengths only, so the sensor may be mounted in any orientation. Masked samples do not count.

The square of `shoe` is the likelihood ratio of its source times σ_ω²; so only the threshold and the ratio of the scales
σ_ω and σ_a matter. The force's part is computed as ⟨|f − ⟨f⟩|²⟩ + (|⟨f⟩| − g)², which is equal and loses no precision.

Source: I. Skog et al., "Zero-velocity detection: an algorithm evaluation", IEEE Trans. Biomed. Eng. 57(11), 2010, with
scales in place of the sensors' noise.
"""

import numpy as np

from jgait.geometry.vectors import GRAVITY
from jgait.signal.windows import window_size, window_sum

WINDOW_S = 0.1
"""[s] Window of a detector: shorter than the stillest part of a fast stance, longer than a zero crossing in swing."""

GYR_SCALE = 0.1
"""[rad/s] σ_ω of `shoe`: the angular rate that weighs as much as a force of `ACC_SCALE`."""

ACC_SCALE = 0.5
"""[m/s²] σ_a of `shoe`: the force that weighs as much as an angular rate of `GYR_SCALE`."""


DETECTORS = {"shoe": 1.0, "ared": 0.8, "variance": 1.0, "magnitude": 0.8}
"""Detector → its threshold, in its unit: the foot stands where the statistic is lower. With these a moving foot rarely
counts as still; the ends of stances are missed."""


def statistic(detector: str, gyr: np.ndarray, acc: np.ndarray, sampling_rate_hz: float, mask: np.ndarray) -> np.ndarray:
    """A detector's statistic (T,) in its unit; infinite where a window has no sample that counts.

    Args:
        detector: a name in `DETECTORS`.
        gyr: (T, 3) angular rate [rad/s].
        acc: (T, 3) specific force [m/s²].
        sampling_rate_hz: rate of the samples [Hz].
        mask: (T,) bool, False where a sample does not count.

    Raises:
        ValueError: if there is no such detector.
    """
    if detector not in DETECTORS:
        raise ValueError(f"detector must be one of {', '.join(DETECTORS)}; got {detector!r}")
    size = window_size(WINDOW_S, sampling_rate_hz)

    def summed(values: np.ndarray) -> np.ndarray:
        return window_sum(values, size, "reflect")

    weight = summed(mask.astype(np.float64))
    rate, force = (np.where(mask[:, None], values, 0.0) for values in (gyr, acc))
    # Values relative to the mean of the recording: with gravity in them, the difference would lose precision.
    middle = force.sum(axis=0) / max(mask.sum(), 1)
    centred = np.where(mask[:, None], force - middle, 0.0)
    share = np.maximum(weight, 1.0)
    turning = summed(_squared(rate)) / share
    off = np.where(mask, np.sqrt(_squared(force)) - GRAVITY, 0.0)
    mean = summed(centred) / share[:, None]
    spread = np.maximum(summed(_squared(centred)) / share - _squared(mean), 0.0)
    square = {
        "ared": turning,
        "variance": spread,
        "magnitude": summed(off * off) / share,
        "shoe": turning + (GYR_SCALE / ACC_SCALE) ** 2 * (spread + (np.sqrt(_squared(mean + middle)) - GRAVITY) ** 2),
    }[detector]
    return np.where(weight > 0.0, np.sqrt(square), np.inf)


def zero_velocity(
    gyr: np.ndarray, acc: np.ndarray, sampling_rate_hz: float, mask: np.ndarray, detector: str = "shoe"
) -> np.ndarray:
    """Where a foot stands still (T,): a detector's statistic is below its threshold; arguments as of `statistic`."""
    return statistic(detector, gyr, acc, sampling_rate_hz, mask) < DETECTORS[detector]


def _squared(vectors: np.ndarray) -> np.ndarray:
    return (vectors * vectors).sum(axis=-1)
