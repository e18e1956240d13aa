r"""Zero-velocity detectors: the samples at which a foot with a sensor stands still.

Each is a statistic over a centred window, in physical units, that is small while the foot stands; `zero_velocity`
compares it with a threshold. With ⟨·⟩ the mean over the window's samples that count, f the specific force, g gravity:

| name | statistic | unit |
|---|---|---|
| `ared` | √⟨abs(ω)²⟩, the angular rate | rad/s |
| `variance` | √⟨abs(f − ⟨f⟩)²⟩, the standard deviation of the force | m/s² |
| `magnitude` | √⟨(abs(f) − g)²⟩, the difference of the force's length from gravity | m/s² |
| `shoe` | √(⟨abs(ω)²⟩ + (σ_ω/σ_a)² ⟨abs(f − g ⟨f⟩/abs(⟨f⟩))²⟩), rate and force together | rad/s |

All statistics use vector lengths only, so the sensor may be mounted in any orientation. Masked samples do not count.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jgait.geometry.vectors import GRAVITY, root
from jgait.signal.windows import moving_mean, window_size

WINDOW_S = 0.1
"""[s] Window of a detector: shorter than the stillest part of a fast stance, longer than a zero crossing in swing."""

GYR_SCALE = 0.1
"""[rad/s] σ_ω of `shoe`: the angular rate that weighs as much as a force of `ACC_SCALE`."""

ACC_SCALE = 0.5
"""[m/s²] σ_a of `shoe`: the force that weighs as much as an angular rate of `GYR_SCALE`."""


def ared(
    gyr: ArrayLike, sampling_rate_hz: float, *, window_s: float = WINDOW_S, mask: ArrayLike | None = None
) -> Array:
    """Angular rate energy: root mean square of the angular rate, √⟨|ω|²⟩.

    Args:
        gyr: (T, 3) angular rate [rad/s], finite.
        sampling_rate_hz: rate of the samples [Hz]; static under jit.
        window_s: window [s], rounded up to an odd number of samples; static under jit.
        mask: (T,) bool, False where a sample does not count; None: all count.

    Returns:
        (T,) [rad/s]; infinite where a window has no sample that counts.

    Raises:
        ValueError: if the shapes do not fit, or the recording is not longer than half a window.

    Source: I. Skog et al., "Zero-velocity detection: an algorithm evaluation", IEEE Trans. Biomed. Eng. 57(11), 2010.
    """
    window = _Window.of(_vectors("gyr", gyr), sampling_rate_hz, window_s, mask)
    return window.root(window.mean(_squared(window.values)))


def variance(
    acc: ArrayLike, sampling_rate_hz: float, *, window_s: float = WINDOW_S, mask: ArrayLike | None = None
) -> Array:
    """Moving variance of the accelerometer, as a standard deviation: √⟨|f − ⟨f⟩|²⟩ over all three axes.

    As `ared`, of the specific force (T, 3) [m/s²]; (T,) [m/s²].
    """
    window = _Window.of(_vectors("acc", acc), sampling_rate_hz, window_s, mask)
    return window.root(_spread(window)[0])


def magnitude(
    acc: ArrayLike, sampling_rate_hz: float, *, window_s: float = WINDOW_S, mask: ArrayLike | None = None,
    gravity: float = GRAVITY,
) -> Array:  # fmt: skip
    """Root mean square difference of the force's length from gravity: √⟨(|f| − g)²⟩.

    As `ared`, of the specific force (T, 3) [m/s²]; (T,) [m/s²]. `gravity` is the reading of the accelerometer at rest
    [m/s²], which is not gravity if its scale has an error.
    """
    window = _Window.of(_vectors("acc", acc), sampling_rate_hz, window_s, mask)
    off = root(_squared(window.values)) - gravity
    return window.root(window.mean(off * off))


def shoe(
    gyr: ArrayLike, acc: ArrayLike, sampling_rate_hz: float, *, window_s: float = WINDOW_S,
    mask: ArrayLike | None = None, gravity: float = GRAVITY, gyr_scale: float = GYR_SCALE,
    acc_scale: float = ACC_SCALE,
) -> Array:  # fmt: skip
    """Stance hypothesis optimal estimation, a likelihood ratio: √(⟨|ω|²⟩ + (σ_ω/σ_a)² ⟨|f − g u|²⟩), u = ⟨f⟩/|⟨f⟩|.

    The likelihood ratio of the source is this statistic squared over σ_ω²; so only the threshold and the ratio of the
    scales σ_ω [rad/s] and σ_a [m/s²] matter. The force's part is computed as ⟨|f − ⟨f⟩|²⟩ + (|⟨f⟩| − g)², which is
    equal and loses no precision. As `ared` and `magnitude`; (T,) [rad/s], never below `ared`.

    Source: as `ared`, with scales in place of the sensors' noise.
    """
    rate, force = _both(gyr, acc)
    window = _Window.of(force, sampling_rate_hz, window_s, mask)
    spread, mean = _spread(window)
    off = root(_squared(mean)) - gravity
    turning = window.mean(_squared(rate))
    return window.root(turning + (gyr_scale / acc_scale) ** 2 * (spread + off * off))


class RestDetector(NamedTuple):
    """A zero-velocity detector.

    Attributes:
        statistic: function of gyr, acc, sampling_rate_hz, window_s, mask, gravity.
        threshold: default threshold; the foot stands where the statistic is lower [the statistic's unit].
        unit: unit of the statistic and of the threshold.
    """

    statistic: Callable[..., Array]
    threshold: float
    unit: str


DETECTORS = {
    "shoe": RestDetector(shoe, 1.0, "rad/s"),
    "ared": RestDetector(lambda gyr, acc, hz, *, gravity, **others: ared(gyr, hz, **others), 0.8, "rad/s"),
    "variance": RestDetector(lambda gyr, acc, hz, *, gravity, **others: variance(acc, hz, **others), 1.0, "m/s²"),
    "magnitude": RestDetector(lambda gyr, acc, hz, **others: magnitude(acc, hz, **others), 0.8, "m/s²"),
}
"""Detectors by name. With these thresholds a moving foot rarely counts as still; the ends of stances are missed."""


def zero_velocity(
    gyr: ArrayLike, acc: ArrayLike, sampling_rate_hz: float, *, detector: str = "shoe",
    threshold: ArrayLike | None = None, window_s: float = WINDOW_S, mask: ArrayLike | None = None,
    gravity: float = GRAVITY,
) -> Array:  # fmt: skip
    """Where a foot stands still: a detector's statistic is below a threshold; False where a window has no sample.

    Args:
        gyr: (T, 3) angular rate [rad/s], finite.
        acc: (T, 3) specific force [m/s²], finite.
        sampling_rate_hz: rate of the samples [Hz]; static under jit.
        detector: "shoe", "ared", "variance" or "magnitude"; static under jit.
        threshold: in the detector's unit, see `DETECTORS`; None: its default.
        window_s: window [s], rounded up to an odd number of samples; static under jit.
        mask: (T,) bool, False where a sample does not count; None: all count.
        gravity: reading of the accelerometer at rest [m/s²].

    Raises:
        ValueError: if there is no such detector, the shapes do not fit, or the recording is not longer than half a
            window.
    """
    if detector not in DETECTORS:
        raise ValueError(f"detector must be one of {', '.join(DETECTORS)}; got {detector!r}")
    rate, force = _both(gyr, acc)
    statistic, default, _ = DETECTORS[detector]
    value = statistic(rate, force, sampling_rate_hz, window_s=window_s, mask=mask, gravity=gravity)
    return value < jnp.asarray(default if threshold is None else threshold, value.dtype)


class _Window(NamedTuple):
    """Means over a centred window of the samples that count; the others are zero in `values`."""

    size: int
    counts: Array
    values: Array
    weight: Array

    @classmethod
    def of(cls, values: Array, sampling_rate_hz: float, window_s: float, mask: ArrayLike | None) -> "_Window":
        counts = jnp.ones(values.shape[:1], bool) if mask is None else jnp.asarray(mask)
        if counts.shape != values.shape[:1] or counts.dtype != jnp.bool_:
            raise ValueError(f"mask must be ({len(values)},) bool; got {counts.shape} of {counts.dtype}")
        size = window_size(window_s, sampling_rate_hz)
        weight = moving_mean(counts.astype(values.dtype), size)
        return cls(size, counts, jnp.where(counts[:, None], values, 0.0), weight)

    def mean(self, values: Array) -> Array:
        """Mean of (T,) or (T, n) over the samples that count; 0 where a window has none."""
        counts, share = self.counts, jnp.where(self.weight > 0.0, self.weight, 1.0)
        if values.ndim == 2:
            counts, share = counts[:, None], share[:, None]
        return moving_mean(jnp.where(counts, values, 0.0), self.size) / share

    def root(self, square: Array) -> Array:
        """The square root of a mean; infinite where a window has no sample that counts."""
        return jnp.where(self.weight > 0.0, root(square), jnp.inf)


def _spread(window: _Window) -> tuple[Array, Array]:
    """Variance in each window (T,), summed over the axes, and the mean vector (T, 3)."""
    # Values relative to the mean of the recording: with gravity in them, the difference would lose precision.
    number = jnp.maximum(window.counts.sum(dtype=window.values.dtype), 1.0)
    middle = window.values.sum(axis=0, keepdims=True) / number
    centred = window.values - middle
    mean, power = window.mean(centred), window.mean(_squared(centred))
    spread = power - _squared(mean)
    # The two terms cancel. A difference below their rounding error is set to 0: its root would have a huge gradient.
    return jnp.where(spread > 4.0 * jnp.finfo(power.dtype).eps * power, spread, 0.0), mean + middle


def _both(gyr: ArrayLike, acc: ArrayLike) -> tuple[Array, Array]:
    rate, force = _vectors("gyr", gyr), _vectors("acc", acc)
    if rate.shape != force.shape or rate.dtype != force.dtype:
        raise ValueError(
            f"gyr and acc must have one shape and type; got {rate.shape} {rate.dtype} and {force.shape} {force.dtype}"
        )
    return rate, force


def _vectors(name: str, values: ArrayLike) -> Array:
    found = jnp.asarray(values)
    if found.ndim != 2 or found.shape[1] != 3 or not jnp.issubdtype(found.dtype, jnp.floating):
        raise ValueError(f"{name} must be (T, 3), floating point; got {found.shape} of {found.dtype}")
    return found


def _squared(vectors: Array) -> Array:
    return (vectors * vectors).sum(axis=-1)
