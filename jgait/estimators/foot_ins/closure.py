r"""The scale of a foot's gyroscope, from strides that begin and end at rest.

With rates s ω, the specific force of a stride, in axes of its first foothold, integrates to the velocity v(s) at the
next one. A foot that rests at both has v = 0; near s = 1, v ≈ v(1) + (s − 1) v′, and each stride gives

    s = 1 − v(1)·v′ / v′·v′.

A wrong interval between samples turns the foot by too much or too little as well: s is the scale of the rates times the
interval.
"""

import numpy as np

from jgait.geometry.rotation import Quaternion, conjugate, rotated
from jgait.geometry.vectors import GRAVITY, as_array, vector
from jgait.signal.strapdown import integrated

SHORTEST_S, LONGEST_S = 0.5, 2.5
"""[s] Limits of the strides that count."""

FEWEST_STRIDES, MOST = 5, 200
"""[1] Least number of strides, and largest number of those that are integrated, evenly spread over a longer walk."""

MOST_BAD = 0.1
"""[1] Largest share of a stride's samples that were not measured or are clipped; chosen."""

LEAST_EFFECT = 1.5
"""[m/s] Least velocity v′, median over strides: a foot that hardly turns does not show the scale of its rates."""

UNEVEN = 0.25
"""[1] Largest quartile range of s over strides."""

OFF_FROM = 0.15
"""[1] Least logarithm of the scale that is noted; undamaged recordings, public and simulated, have up to 0.13."""

STEP = 0.05
"""[1] Change of s over which v is differentiated; chosen."""

AROUND_S = 0.03
"""[s] Half of the time about a foothold in which the specific force points up."""


def gyroscope_scale(
    gyr: np.ndarray, acc: np.ndarray, footholds: np.ndarray, bad: np.ndarray, hz: float
) -> float | None:
    """Factor of the rates [1] with which strides end at rest, median over strides; None if it cannot be computed.

    Args:
        gyr: (T, 3) [rad/s], without bias.
        acc: (T, 3) [m/s²].
        footholds: (n,) samples at which the foot rests.
        bad: (T,) bool, samples that were not measured, or are clipped; strides with many do not count.
        hz: sampling rate [Hz].
    """
    first, last = footholds[:-1], footholds[1:]
    so_far = np.concatenate([[0], np.cumsum(bad)])
    seconds = (last - first) / hz
    good = so_far[last + 1] - so_far[first] <= MOST_BAD * (last - first)
    counts = (seconds > SHORTEST_S) & (seconds < LONGEST_S) & good
    if counts.sum() < FEWEST_STRIDES:
        return None
    at = np.flatnonzero(counts)
    at = at[np.linspace(0.0, len(at) - 1.0, min(len(at), MOST)).round().astype(int)]
    first, last, seconds = first[at], last[at], seconds[at]
    width = max(round(AROUND_S * hz), 1)
    up = np.stack([acc[max(at - width, 0) : at + width + 1].mean(axis=0) for at in first])
    size = np.linalg.norm(up, axis=1, keepdims=True)
    # the specific force in units of that at the foothold, which has no scale then
    gained = [_gained(factor * gyr, acc, first, last, hz) / size for factor in (1.0, 1.0 + STEP)]
    rest, other = (GRAVITY * (velocity - up / size * seconds[:, None]) for velocity in gained)
    slope = (other - rest) / STEP
    effect = np.sum(slope * slope, axis=1)
    if not np.median(effect) > LEAST_EFFECT**2:
        return None
    each = 1.0 - np.sum(rest * slope, axis=1) / np.maximum(effect, 1e-9)
    low, middle, high = np.percentile(each, [25.0, 50.0, 75.0])
    return float(middle) if high - low < UNEVEN else None


def _gained(gyr: np.ndarray, acc: np.ndarray, first: np.ndarray, last: np.ndarray, hz: float) -> np.ndarray:
    """(n, 3) integral of the specific force from one sample to another, in axes of the first [m/s]."""
    attitude, force = integrated(gyr, acc, hz)
    back = conjugate(Quaternion(*(part[first] for part in attitude)))
    return np.asarray(as_array(rotated(back, vector(force[last] - force[first]))))
