"""A shank in plain NumPy: its ankle stands while the shank rolls over it, then swings forward, and stands again.

The pitch is piecewise straight, smoothed, slowest in the middle of a stance, where the shank is upright; the ankle's
way has three derivatives that vanish at both ends of a swing.
Sensors read derivatives of a track ten times as fine.
"""

from typing import NamedTuple

import numpy as np

from jgait.types import Imu, Recording

GRAVITY = 9.80665
FINE = 10
SWING, STANCE, REST = 0.4, 0.7, 1.0
LEAN, UPRIGHT = 0.5, 0.1


class Made(NamedTuple):
    """What was made: a recording, and of every stride length [m], rise [m], turn [rad], start and end of swing [s]."""

    recording: Recording
    length: np.ndarray
    rise: np.ndarray
    turn: np.ndarray
    leaves: np.ndarray
    lands: np.ndarray


def _step(s):
    s = np.clip(s, 0.0, 1.0)
    return s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)


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
        mount: (3, 3) sensor's axes in the shank's, in columns.
        bias: of the gyroscope [rad/s].
        placement: what the sensor is called.
        seed: of white noise; None: none.
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
    yaw, ankle, heading = np.zeros(t.size), np.zeros((t.size, 3)), 0.0
    for k, start in enumerate(begin):
        r = _step((t - start) / SWING)
        way = heading + 0.5 * turns[k]
        ankle += r[:, None] * np.array([lengths[k] * np.cos(way), lengths[k] * np.sin(way), rises[k]])
        s = np.clip((t - start) / SWING, 0.0, 1.0)
        ankle[:, 2] += 0.1 * 256.0 * (s * (1.0 - s)) ** 4
        yaw += r * turns[k]
        heading += turns[k]
    c, s, cy, sy = np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    axes = np.moveaxis(np.array([[cy * c, -sy, cy * s], [sy * c, cy, sy * s], [-s, 0.0 * s, c]]), -1, 0)
    place = ankle + axes @ np.asarray(lever, float)
    dt = t[1] - t[0]
    force = np.gradient(np.gradient(place, dt, axis=0), dt, axis=0) + np.array([0.0, 0.0, GRAVITY])
    spin = np.einsum("tji,tjk->tik", axes, np.gradient(axes, dt, axis=0))
    gyr = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)[::FINE]
    acc = np.einsum("tji,tj->ti", axes, force)[::FINE]
    if seed is not None:
        noise = np.random.default_rng(seed).normal(size=(2, n, 3))
        gyr, acc = gyr + 0.005 * noise[0], acc + 0.05 * noise[1]
    if mount is not None:
        gyr, acc = gyr @ mount, acc @ mount
    imu = Imu(np.arange(n) / hz, gyr + np.asarray(bias, float), acc, np.ones(n, bool))
    return Made(Recording({placement: imu}, hz, "made"), lengths, rises, turns, begin, begin + SWING)
