"""A shank in plain NumPy: its ankle stands while the shank rolls over it, then swings forward, and stands again.

The pitch is piecewise straight, smoothed, slowest in the middle of a stance, where the shank is upright; the ankle's
way has three derivatives that vanish at both ends of a swing.
"""

import numpy as np
from made.track import FINE, Made, read, swung

SWING, STANCE, REST = 0.4, 0.7, 1.0
LEAN, UPRIGHT = 0.5, 0.1


def _smooth(values, count):
    kernel = np.hanning(count + 2)[1:-1]
    kernel /= kernel.sum()
    padded = np.pad(values, count, mode="edge")
    return np.convolve(padded, kernel, mode="same")[count:-count]


def shank(
    strides=4, length=1.2, hz=100.0, lever=(0.0, 0.0, 0.18), turns=0.0, rises=0.0, mount=None, bias=(0, 0, 0),
    placement="shank_right", seed=None,
):  # fmt: skip
    """A walk of one shank.

    Args:
        strides: how many.
        length: of each [m], or a list; so are `turns`, changes of heading [rad], and `rises` [m].
        hz: sampling rate [Hz].
        lever: from the ankle to the sensor, forward, left and up along the shank [m].
        placement, mount, bias, seed: as of `read`.
    """
    lengths, turns, rises = (np.broadcast_to(np.asarray(v, float), strides) for v in (length, turns, rises))
    begin = REST + 0.3 + (SWING + STANCE) * np.arange(strides)
    n = round((begin[-1] + SWING + 0.3 + REST) * hz)
    t = np.arange(n * FINE) / (hz * FINE)
    knots, values = [0.0, REST], [0.0, 0.0]
    for start in begin:
        lands = start + SWING
        knots, values = [*knots, start, lands], [*values, LEAN, -LEAN]
        if start < begin[-1]:
            knots += [lands + 0.3 * STANCE, lands + 0.7 * STANCE]
            values += [-UPRIGHT, UPRIGHT]
    knots, values = [*knots, begin[-1] + SWING + 0.3, t[-1] + 1.0], [*values, 0.0, 0.0]
    pitch = _smooth(np.interp(t, knots, values), round(0.1 * hz * FINE))
    ankle, yaw = swung(t, begin, SWING, lengths, turns, rises, 0.1)
    c, s, cy, sy = np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    axes = np.moveaxis(np.array([[cy * c, -sy, cy * s], [sy * c, cy, sy * s], [-s, 0.0 * s, c]]), -1, 0)
    place = ankle + axes @ np.asarray(lever, float)
    recording = read(t, place, axes, placement, hz, mount, bias, seed)
    return Made(recording, lengths, rises, turns, begin, begin + SWING)
