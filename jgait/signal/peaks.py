"""Maxima of a signal, on the host: those of `scipy.signal.find_peaks`, which takes longer to import than to run."""

import numpy as np
from jaxtyping import Float, Int

from jgait.types import AnyArray, as_float


def peaks(
    x: Float[AnyArray, "time"], *, height: float = -np.inf, distance: int = 1, prominence: float = 0.0
) -> Int[np.ndarray, "peak"]:
    """Samples of the local maxima of a signal (T,), of a plateau the middle one.

    Args:
        x: the signal.
        height: least value of a maximum, in the signal's unit.
        distance: least distance of two maxima [samples]; of nearer ones the higher is kept.
        prominence: least height of a maximum above the higher one of the lowest values on both sides, up to a value
            that is higher than the maximum, or to the end; in the signal's unit.
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
