"""A foot in plain NumPy: it stands, swings forward with its heel first up and then its toes, and stands again.

Positions are polynomials whose first three derivatives vanish at both ends of a swing, so that it starts and ends at
rest; sensors read the derivatives of a track ten times as fine.
"""

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


def _rise(s):
    """0 to 1, three derivatives zero at both ends."""
    return s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)


def _rotation(yaw, pitch):
    """(T, 3, 3) axes of the sensor in the world, in columns: pitch about y (toes up positive), then yaw about z."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    zero = np.zeros_like(yaw)
    rows = [[cy * cp, -sy, -cy * sp], [sy * cp, cy, -sy * sp], [sp, zero, cp]]
    return np.moveaxis(np.array(rows), -1, 0)


def foot(
    strides=5, length=1.2, swing=0.5, stance=0.6, hz=100.0, turns=None, rises=None, rest=1.5, mount=None,
    bias=(0, 0, 0), side="right", roll=0.0, seed=None,
):  # fmt: skip
    """A walk of one foot.

    Args:
        strides: how many.
        length: of each [m], or a list.
        swing: duration of a swing [s].
        stance: between swings [s].
        hz: sampling rate [Hz].
        turns: change of heading in each swing [rad].
        rises: change of height in each [m].
        rest: standing before and after [s].
        mount: (3, 3) sensor's axes in the foot's, in columns.
        bias: of the gyroscope [rad/s].
        side: of the placement.
        roll: from toes up to toes down by twice this the foot turns about the ground below it between swings [rad].
        seed: of white noise, turned with the sensor; None: none.
    """
    lengths = np.broadcast_to(np.asarray(length, float), strides)
    turns = np.zeros(strides) if turns is None else np.asarray(turns, float)
    rises = np.zeros(strides) if rises is None else np.asarray(rises, float)
    begin = rest + (swing + stance) * np.arange(strides)
    duration = begin[-1] + swing + rest
    n = round(duration * hz)
    t = np.arange(n * FINE) / (hz * FINE)
    yaw, pitch, place = np.zeros(t.size), np.zeros(t.size), np.zeros((t.size, 3))
    heading = 0.0
    for k, start in enumerate(begin):
        s = np.clip((t - start) / swing, 0.0, 1.0)
        r = _rise(s)
        heading_then = heading + turns[k]
        way = 0.5 * (heading + heading_then)
        place += r[:, None] * np.array([lengths[k] * np.cos(way), lengths[k] * np.sin(way), rises[k]])
        place[:, 2] += 0.12 * 256.0 * (s * (1.0 - s)) ** 4
        yaw += r * turns[k]
        # heel up first, then toes up; both gone at the end
        pitch += 900.0 * (s * (1.0 - s)) ** 4 * (s - 0.55)
        heading = heading_then
    # between two swings the foot rolls from toes up to toes down, and back within the swing
    for k in range(strides - 1):
        pitch -= 2.0 * roll * _rise(np.clip((t - begin[k] - swing) / stance, 0.0, 1.0))
        pitch += 2.0 * roll * _rise(np.clip((t - begin[k + 1]) / swing, 0.0, 1.0))
    pitch += roll * _rise(np.clip((t - begin[0]) / swing, 0.0, 1.0))
    axes = _rotation(yaw, pitch)
    dt = t[1] - t[0]
    velocity = np.gradient(place, dt, axis=0)
    force = np.gradient(velocity, dt, axis=0) + np.array([0.0, 0.0, GRAVITY])
    spin = np.einsum("tji,tjk->tik", axes, np.gradient(axes, dt, axis=0))
    rate = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    acc = np.einsum("tji,tj->ti", axes, force)
    gyr, acc = rate[::FINE], acc[::FINE]
    if seed is not None:
        noise = np.random.default_rng(seed).normal(size=(2, n, 3))
        gyr, acc = gyr + 0.005 * noise[0], acc + 0.05 * noise[1]
    if mount is not None:
        gyr, acc = gyr @ mount, acc @ mount
    time = np.arange(n) / hz
    imu = Imu(time, gyr + np.asarray(bias, float), acc, np.ones(n, bool))
    return Made(Recording({f"foot_{side}": imu}, hz, "made"), lengths, rises, turns, begin, begin + swing)
