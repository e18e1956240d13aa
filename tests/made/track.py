"""What a sensor reads on a track that is known, in plain NumPy; the readings are derivatives of a track ten times as
fine."""

from typing import NamedTuple

import numpy as np

from jgait.types import Imu, Recording

GRAVITY = 9.80665
FINE = 10


class Made(NamedTuple):
    """What was made: a recording, and of every stride length [m], rise [m], turn [rad], start and end of swing [s]."""

    recording: Recording
    length: np.ndarray
    rise: np.ndarray
    turn: np.ndarray
    lift_off: np.ndarray
    contact: np.ndarray


def step(s):
    """0 to 1, three derivatives zero at both ends."""
    s = np.clip(s, 0.0, 1.0)
    return s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)


def swung(t, begin, swing, lengths, turns, rises, lift):
    """Positions (T, 3) [m] and heading (T,) [rad] of what swings: each stride in the middle between two headings."""
    place, yaw, heading = np.zeros((t.size, 3)), np.zeros(t.size), 0.0
    for k, start in enumerate(begin):
        s = np.clip((t - start) / swing, 0.0, 1.0)
        way = heading + 0.5 * turns[k]
        place += step(s)[:, None] * np.array([lengths[k] * np.cos(way), lengths[k] * np.sin(way), rises[k]])
        place[:, 2] += lift * 256.0 * (s * (1.0 - s)) ** 4
        yaw += step(s) * turns[k]
        heading += turns[k]
    return place, yaw


def read(t, place, axes, placement, hz, mount, bias, seed):
    """The recording of a sensor.

    Args:
        t: (n FINE,) [s].
        place: (n FINE, 3) of the sensor [m].
        axes: (n FINE, 3, 3) of the sensor in the world, in columns.
        placement: what the sensor is called.
        hz: sampling rate [Hz].
        mount: (3, 3) the sensor's axes in those, in columns; None: the same.
        bias: (3,) of the gyroscope [rad/s].
        seed: of white noise, turned with the sensor; None: none.
    """
    dt = t[1] - t[0]
    force = np.gradient(np.gradient(place, dt, axis=0), dt, axis=0) + np.array([0.0, 0.0, GRAVITY])
    spin = np.einsum("tji,tjk->tik", axes, np.gradient(axes, dt, axis=0))
    gyr = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)[::FINE]
    acc = np.einsum("tji,tj->ti", axes, force)[::FINE]
    n = len(gyr)
    if seed is not None:
        noise = np.random.default_rng(seed).normal(size=(2, n, 3))
        gyr, acc = gyr + 0.005 * noise[0], acc + 0.05 * noise[1]
    if mount is not None:
        gyr, acc = gyr @ mount, acc @ mount
    imu = Imu(np.arange(n) / hz, gyr + np.asarray(bias, float), acc, np.ones(n, bool))
    return Recording({placement: imu}, hz, "made")
