"""Two feet that walk, their tracks and their strides by formulas, as an estimate: for tables that other libraries read.

A foot stands, swings along x with its toes first down and then up, rises a little with each stride and turns to the
left. All begins and ends at rest, and a swing's shape is a polynomial.
"""

from typing import NamedTuple

import numpy as np

from jgait.types import Estimate, Legs, Strides

RATE = 100.0
CYCLE, SWING = 1.1, 0.5  # [s]
LENGTH, RISE, TURN = 1.2, 0.04, 0.15  # [m], [m], [rad] of each stride
STRIDES, AFTER = 8, 4  # of each foot, and after how many it may pause
LIFT = 0.1  # [m] in the middle of a swing


class Track(NamedTuple):
    """(T,) where a foot is: along its way [m], up [m], pitch [rad] toes up positive, heading [rad] left positive."""

    along: np.ndarray
    up: np.ndarray
    pitch: np.ndarray
    heading: np.ndarray


def _share(s):
    return s**3 * (10 - 15 * s + 6 * s**2)


def _up(s):
    return RISE * _share(s) + LIFT * 64 * (s * (1 - s)) ** 3


def _pitch(s):
    """Toes down before the first third of the swing, up after it; level at both ends."""
    return 30.0 * (s * (1 - s)) ** 2 * (s - 1 / 3)


HIGHEST = float(_up(np.linspace(0, 1, 10001)).max())
LEAVES, LANDS = 0.1, 0.9  # of the swing: the toes leave, the heel lands


def swings(side, pause=0.0):
    """(STRIDES,) [s] when each swing begins."""
    number = np.arange(STRIDES)
    return 1.0 + CYCLE * number + pause * (number >= AFTER) + (0.5 * CYCLE if side else 0.0)


def track(side, time):
    """Where a foot is at times (T,)."""
    s = np.clip((np.asarray(time)[:, None] - swings(side)) / SWING, 0.0, 1.0)
    done = _share(s).sum(axis=1)
    up = _up(s).sum(axis=1)
    return Track(LENGTH * done, up, _pitch(s).sum(axis=1), TURN * done)


def estimate(pause=0.0, **changed):
    """The strides of both feet; those that come first in time have a contact before them, as if they had walked."""
    parts = []
    for side in (0, 1):
        begin = swings(side, pause)
        end = begin + LANDS * SWING
        fresh = np.concatenate([[True], np.diff(begin) > CYCLE + 1e-6])
        start = np.where(fresh, end - CYCLE, np.concatenate([[0.0], end[:-1]]))
        standing = np.where(fresh, begin - 0.3, np.concatenate([[0.0], begin[:-1] + SWING + 0.25]))
        parts.append({
            "side": np.full(STRIDES, side), "start": start, "final_contact": begin + LEAVES * SWING, "end": end,
            "length": np.full(STRIDES, LENGTH), "width": np.full(STRIDES, np.nan), "height": np.full(STRIDES, RISE),
            "valid": np.ones(STRIDES, bool), "standing": standing, "standing_end": begin + SWING + 0.25,
            "speed": np.full(STRIDES, LENGTH / CYCLE), "turn": np.full(STRIDES, TURN),
            "lift": np.full(STRIDES, HIGHEST - RISE), "contact_angle": np.full(STRIDES, _pitch(LANDS)),
            "push_off_angle": np.full(STRIDES, _pitch(LEAVES)),
        })  # fmt: skip
    fields = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    own = Strides(**fields | changed)
    return Estimate(np.arange(1200) / RATE, Legs(None, None), None, None, np.ones(1200, bool), {}, own)
