"""Signal processing: medians, moving statistics, and standing still told from the gyroscope.

Everything but `longest_still` is JAX: usable under `jit` and `vmap`, along the first axis, and differentiable wherever
the operation itself is (a median has the gradient of the sample it picks; a comparison has none). Windows are centred,
of an odd number of samples, and the ends are continued by reflection that does not repeat the edge.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike

STILL_RATE = 0.2
"""[rad/s] Root mean square rate below which a segment stands: swing reaches 3–7, stance of a shank 0.5–1.5,
a standing leg with its gyroscope's bias stays under 0.1."""

STILL_WINDOW_S = 0.5
"""[s] Window over which stillness is judged: longer than the quiet part of a stance phase."""


def _reflected(x: ArrayLike, size: int) -> Array:
    """The samples with both ends continued by reflection, so that every window of `size` is full."""
    values = jnp.asarray(x)
    if size < 1 or size % 2 == 0:
        raise ValueError(f"size must be odd and positive, so that the window has a middle; got {size}")
    half = size // 2
    if values.ndim == 0 or values.shape[0] <= half:
        raise ValueError(f"a window of {size} samples needs more than {half} samples; got shape {values.shape}")
    return jnp.pad(values, [(half, half)] + [(0, 0)] * (values.ndim - 1), mode="reflect")


def median_filter(x: ArrayLike, size: int) -> Array:
    """Median over a centred window, y_k = median(x_{k-h} … x_{k+h}) with h = (size-1)/2.

    Args:
        x: (T, ...) samples, any unit.
        size: window [samples], odd; 1 changes nothing.

    Returns:
        The same shape and unit.

    Raises:
        ValueError: if the size is even or not positive, or there are fewer than (size+1)/2 samples.
    """
    padded = _reflected(x, size)
    count = padded.shape[0] - size + 1
    return jnp.median(jnp.stack([padded[shift : shift + count] for shift in range(size)]), axis=0)


def moving_mean(x: ArrayLike, size: int) -> Array:
    """Mean over a centred window, y_k = Σ x_{k+i} / size, i = -h … h.

    Args:
        x: (T, ...) samples, floating point, any unit.
        size: window [samples], odd.

    Returns:
        The same shape and unit.

    Raises:
        ValueError: as `median_filter`.
    """
    padded = _reflected(x, size)
    window = (size,) + (1,) * (padded.ndim - 1)
    # A window sum, not the difference of two cumulative sums: those lose float32's digits on long recordings.
    zero = np.zeros((), padded.dtype)
    return lax.reduce_window(padded, zero, lax.add, window, (1,) * padded.ndim, "valid") / size


def moving_std(x: ArrayLike, size: int) -> Array:
    """Standard deviation over a centred window, y_k = √(mean x² - (mean x)²), of the window itself (no n-1).

    Its gradient is zero where the window is constant.

    Args:
        x: (T, ...) samples, floating point, any unit.
        size: window [samples], odd.

    Returns:
        The same shape and unit.

    Raises:
        ValueError: as `median_filter`.
    """
    values = jnp.asarray(x)
    centred = values - values.mean(axis=0, keepdims=True)
    mean = moving_mean(centred, size)
    variance = moving_mean(centred * centred, size) - mean * mean
    # The two terms cancel; what is left below their rounding is nothing.
    positive = variance > jnp.finfo(variance.dtype).eps * (mean * mean)
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, variance, 1.0)), 0.0)


def still_mask(
    gyr: ArrayLike,
    sampling_rate_hz: float,
    *,
    mask: ArrayLike | None = None,
    threshold: float = STILL_RATE,
    window_s: float = STILL_WINDOW_S,
) -> Array:
    """Where a segment stands still: the gyroscope's root mean square over a window is below a threshold.

    √(Σ m |ω|² / Σ m) < threshold over the centred window, m the mask.

    Args:
        gyr: (T, 3) angular rate [rad/s], finite.
        sampling_rate_hz: rate of the samples [Hz]; static under jit.
        mask: (T,) bool, False where a sample is to be ignored; None: all count.
        threshold: root mean square rate below which it stands [rad/s].
        window_s: window [s], rounded up to an odd number of samples; static under jit.

    Returns:
        (T,) bool; False where a window has no sample that counts.

    Raises:
        ValueError: if the recording is shorter than half a window.
    """
    rate = jnp.asarray(gyr)
    power = (rate * rate).sum(axis=-1)
    counts = jnp.ones_like(power) if mask is None else jnp.asarray(mask).astype(power.dtype)
    size = window_size(window_s, sampling_rate_hz)
    weight = moving_mean(counts, size)
    return (moving_mean(power * counts, size) < threshold**2 * weight) & (weight > 0.0)


def window_size(window_s: float, sampling_rate_hz: float) -> int:
    """Seconds to an odd number of samples, at least 1."""
    return 2 * int(np.ceil(window_s * sampling_rate_hz / 2)) + 1 if window_s > 0 else 1


def longest_still(
    gyr: Any,
    sampling_rate_hz: float,
    *,
    mask: Any = None,
    threshold: float = STILL_RATE,
    window_s: float = STILL_WINDOW_S,
    at_least_s: float = 0.0,
) -> tuple[int, int] | None:
    """The longest stretch in which a segment stands still; on the host, not under jit.

    Args:
        gyr: (T, 3) angular rate [rad/s].
        sampling_rate_hz: rate of the samples [Hz].
        mask: (T,) bool, False where a sample is to be ignored; None: all count.
        threshold: as in `still_mask` [rad/s].
        window_s: as in `still_mask` [s].
        at_least_s: shorter stretches are ignored [s].

    Returns:
        (start, end) [samples], half-open; None if there is no such stretch, or the recording is shorter than a window.
    """
    rate = np.asarray(gyr)
    if len(rate) < window_size(window_s, sampling_rate_hz):
        return None
    still = np.asarray(still_mask(rate, sampling_rate_hz, mask=mask, threshold=threshold, window_s=window_s))
    runs = [run for run in true_runs(still) if run[1] - run[0] >= max(1.0, at_least_s * sampling_rate_hz)]
    return max(runs, key=lambda run: run[1] - run[0], default=None)


def true_runs(flags: Any) -> list[tuple[int, int]]:
    """Stretches of True as (start, end) [samples], half-open; on the host."""
    edges = np.diff(np.concatenate([[0], np.asarray(flags, bool).astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(int(start), int(end)) for start, end in zip(starts, ends, strict=True)]
