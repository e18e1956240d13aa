"""Moving means and spreads over centred windows of an odd number of samples, stretches of True, and maxima.

`samples`, `moving_mean`, `between_samples` and `vertex` compute by the library of their arrays, other functions on the
host.
"""

from collections.abc import Sequence
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Bool, Float, Int, Num

from jgait.geometry.arrays import of_jax, xp
from jgait.types import AnyArray, Values, as_float


def samples(x: AnyArray, least: int = 1) -> Float[AnyArray, "time *rest"]:
    """Samples (T, ...) of a signal. Raises ValueError if they are not floating point, or fewer than `least`."""
    values = xp.asarray(x)
    if not jnp.issubdtype(values.dtype, jnp.floating):
        raise ValueError(f"x must be floating point; got {values.dtype}")
    if values.ndim == 0 or values.shape[0] < least:
        raise ValueError(f"x must have at least {least} samples along its first axis; got shape {values.shape}")
    return values


def moving_mean(x: Float[AnyArray, "time *rest"], size: int) -> Float[AnyArray, "time *rest"]:
    """Mean over a centred window, y_k = Σ x_{k+i} / size, i = -h … h with h = (size-1)/2; size [samples] is odd.

    The ends are continued by reflection that does not repeat the edge.

    Raises:
        ValueError: if the size is even or not positive, or there are fewer than (size+1)/2 samples.
    """
    if size < 1 or size % 2 == 0:
        raise ValueError(f"size must be odd and positive, so that the window has a middle; got {size}")
    half = size // 2
    if x.ndim == 0 or x.shape[0] <= half:
        raise ValueError(f"a window of {size} samples needs more than {half} samples; got shape {x.shape}")
    if not of_jax(x):
        return (window_sum(x, size, "reflect") / size).astype(x.dtype)
    values = jnp.asarray(x)
    padded = jnp.pad(values, [(half, half)] + [(0, 0)] * (values.ndim - 1), mode="reflect")
    window = (size,) + (1,) * (padded.ndim - 1)
    # A window sum: in float32 the difference of two cumulative sums loses precision on long recordings.
    zero = np.zeros((), padded.dtype)
    return lax.reduce_window(padded, zero, lax.add, window, (1,) * padded.ndim, "valid") / size


def between_samples(x: Float[AnyArray, "time *rest"], place: Float[AnyArray, "*places"]) -> Float[AnyArray, "..."]:
    """The signal at places between its samples [samples], by straight lines; constant before and after the samples."""
    values, at = (x, place) if not of_jax(x, place) else (jnp.asarray(x), jnp.asarray(place))
    last = values.shape[0] - 1
    low = xp.clip(xp.floor(at), 0, max(last - 1, 0)).astype(np.int32)
    share = xp.clip(at - low.astype(at.dtype), 0.0, 1.0).reshape(at.shape + (1,) * (values.ndim - 1))
    return values[low] * (1.0 - share) + values[xp.minimum(low + 1, last)] * share


def window_sum(
    values: Float[AnyArray, "time *rest"], size: int, ends: Literal["edge", "reflect"] = "edge"
) -> np.ndarray:
    """(T, ...) sum over a centred window of an odd `size` [samples]; the ends are continued as `numpy.pad` does.

    NumPy alone: SciPy's filters take longer to import than a recording takes to filter.
    """
    given = np.asarray(values, np.float64)
    half = size // 2
    padded = np.pad(given, [(half, half)] + [(0, 0)] * (given.ndim - 1), mode=ends)
    columns = padded.reshape(len(padded), -1).T
    return np.stack([np.convolve(column, np.ones(size), "valid") for column in columns], axis=-1).reshape(given.shape)


def window_maximum(values: Float[AnyArray, "time"], size: int) -> np.ndarray:
    """(T,) maximum over a centred window of an odd `size` [samples]; the first and the last sample are repeated."""
    largest, span = np.pad(np.asarray(values, np.float64), size // 2, mode="edge"), 1
    while span < size:  # maxima over 2, 4, 8 … samples
        further = min(span, size - span)
        largest, span = np.maximum(largest[:-further], largest[further:]), span + further
    return largest


def held_mean(values: Float[AnyArray, "time *rest"], size: int) -> np.ndarray:
    """(T, ...) mean over a centred window of an odd `size` [samples]; the first and the last sample are repeated."""
    return window_sum(values, size) / size


def held_spread(values: Float[AnyArray, "time axis"], size: int) -> np.ndarray:
    """(T,) standard deviation over a centred window, of all columns together, in the signal's unit; as `held_mean`."""
    centred = values - np.median(values, axis=0)
    return np.sqrt(np.maximum(held_mean(centred**2, size) - held_mean(centred, size) ** 2, 0.0).sum(axis=1))


def window_size(window_s: float, sampling_rate_hz: float) -> int:
    """The odd number of samples that covers a window [s], at least 1."""
    return 2 * int(np.ceil(window_s * sampling_rate_hz / 2)) + 1 if window_s > 0 else 1


def true_runs(flags: Bool[AnyArray, "time"] | Sequence[bool]) -> list[tuple[int, int]]:
    """Stretches of True as (start, end) [samples], half-open; on the host."""
    edges = np.diff(np.concatenate([[0], np.asarray(flags, bool).astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(int(start), int(end)) for start, end in zip(starts, ends, strict=True)]


def over_losses(
    time: Num[AnyArray, "time"], values: Float[AnyArray, "time axis"], measured: Bool[AnyArray, "time"]
) -> np.ndarray:
    """The signal with lines in `time` over the rows that were not measured, constant at the ends; one must be."""
    if np.all(measured):
        return as_float(values)
    known = np.asarray(time)[measured]
    return np.stack([np.interp(time, known, column[measured]) for column in as_float(values).T], axis=1)


def vertex(before: Values, here: Values, after: Values) -> Values:
    """Position of the maximum, −1/2 to 1/2, of the parabola through three samples; `here` is the greatest sample."""
    bend = 2.0 * here - before - after
    return xp.where(bend > 0.0, 0.5 * (after - before) / xp.where(bend > 0.0, bend, 1.0), 0.0).clip(-0.5, 0.5)


def peaks(
    x: Float[AnyArray, "time"], *, height: float = -np.inf, distance: int = 1, prominence: float = 0.0
) -> Int[np.ndarray, "peak"]:
    """Samples of the local maxima of a signal (T,), of a plateau the middle one; on the host.

    As `scipy.signal.find_peaks`, which takes longer to import than to run: `height` and `prominence` are in the
    signal's unit, `distance` is in samples.
    """
    x = as_float(x)
    begin = np.flatnonzero(np.append(True, x[1:] != x[:-1])[: len(x)])  # of runs of equal values
    end = np.append(begin[1:], len(x)) - 1
    level = x[begin]
    inner = np.flatnonzero((level[1:-1] > level[:-2]) & (level[1:-1] > level[2:])) + 1
    maxima = (begin[inner] + end[inner]) // 2
    maxima = maxima[x[maxima] >= height]
    kept = np.ones(len(maxima), bool)
    for highest in np.argsort(x[maxima])[::-1]:
        if kept[highest]:
            kept &= (np.abs(maxima - maxima[highest]) >= distance) | (maxima == maxima[highest])
    return np.array([at for at in maxima[kept] if _prominence(x, at) >= prominence], int)


def _prominence(x: np.ndarray, at: int) -> float:
    """Height of a maximum above its surroundings."""
    higher = np.flatnonzero(x > x[at])
    place = np.searchsorted(higher, at)
    first = higher[place - 1] + 1 if place else 0
    last = higher[place] if place < len(higher) else len(x)
    return float(x[at] - max(x[first : at + 1].min(), x[at:last].min()))
