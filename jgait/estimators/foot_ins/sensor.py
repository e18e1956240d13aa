r"""What a foot's strides show of its sensor: the scale of its gyroscope.

`gyroscope_scale` takes strides that begin and end at rest. With rates s ω, the specific force of a stride, in axes of
its first foothold, integrates to the velocity v(s) at the next one. A foot that rests at both has v = 0; near s = 1,
v ≈ v(1) + (s − 1) v′, and each stride gives

    s = 1 − v(1)·v′ / v′·v′,

the first of Newton's steps. What is left of v across v′ does not come from a scale; its share of v′ is how uncertain s
is: feet of runners do not rest. A wrong interval between samples turns the foot by too much or too little as well: s is
the scale of the rates times the interval.
"""

import numpy as np

from jgait.geometry.rotation import Quaternion, conjugate, integrated, rotated
from jgait.geometry.vectors import GRAVITY, as_array, vector

OFF_FROM, SCALES = 2.0, 0.03
"""[1] Least size of the logarithm of the scale over its deviation that is noted, chosen so that none of 52 shoes of
public sets is noted as measured (`experiments.unseen2.scales`); and deviation of the scale where all strides end at
rest: of a gyroscope, and by rates that are sampled 50 times a second, whose peaks are lower."""


def gyroscope_scale(
    gyr: np.ndarray, acc: np.ndarray, footholds: np.ndarray, bad: np.ndarray, hz: float
) -> tuple[float, float] | None:
    """Factor of the rates with which strides end at rest [1], and the deviation of its logarithm [1], medians over
    strides; None if they cannot be computed.

    Args:
        gyr: (T, 3) [rad/s], without bias.
        acc: (T, 3) [m/s²].
        footholds: (n,) samples at which the foot rests.
        bad: (T,) bool, samples that were not measured, or are clipped; strides with many do not count.
        hz: sampling rate [Hz].
    """
    first, last = footholds[:-1], footholds[1:]
    seconds, so_far = (last - first) / hz, np.concatenate([[0], np.cumsum(bad)])
    good = so_far[last + 1] - so_far[first] <= 0.1 * (last - first)
    at = np.flatnonzero((seconds > 0.5) & (seconds < 2.5) & good)
    if len(at) < 5:
        return None
    at = at[np.linspace(0.0, len(at) - 1.0, min(len(at), 200)).round().astype(int)]
    first, last, seconds = first[at], last[at], seconds[at, None]
    width = max(round(0.03 * hz), 1)
    up = np.stack([acc[max(at - width, 0) : at + width + 1].mean(axis=0) for at in first])
    size = np.linalg.norm(up, axis=1, keepdims=True)

    def at_rest(factor: float) -> np.ndarray:
        """(n, 3) velocity at the next foothold [m/s], where the force at the first one is gravity, and has no scale."""
        attitude, force = integrated(factor * gyr, acc, hz)
        back = conjugate(Quaternion(*(part[first] for part in attitude)))
        gained = as_array(rotated(back, vector(force[last] - force[first])))
        return np.asarray(GRAVITY * (gained - up * seconds) / size)

    scale, step = 1.0, 0.05
    for _ in range(2):  # Newton's steps
        rest = at_rest(scale)
        slope = (at_rest(scale + step) - rest) / step
        effect = np.maximum(np.sum(slope * slope, axis=1), 1e-9)
        more = -np.sum(rest * slope, axis=1) / effect
        across = np.linalg.norm(rest + more[:, None] * slope, axis=1) / np.sqrt(effect)
        scale = float(np.clip(scale + np.median(more), 0.3, 3.0))
    return scale, float(np.hypot(SCALES, np.median(across) / scale))
