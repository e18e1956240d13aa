"""Two feet on the paper's marks, in plain NumPy: places, stances, ranges, and trajectories that drift."""

from typing import NamedTuple

import numpy as np

from jgait.types import Feet, FootTrajectory, RangeReadings

RATE, STRIDE_TIME, STRIDE, WIDTH = 128.0, 1.12, 1.22, 0.30  # no whole number of pings in a stride
OFFSET = 0.08  # the range is this much shorter than the distance of the feet


class Footsteps(NamedTuple):
    """A walk: times (T,), right and left places (T, 3), middles of stances, a range, and true headings of strides."""

    time: np.ndarray
    places: tuple[np.ndarray, np.ndarray]
    mids: tuple[np.ndarray, np.ndarray]
    read: RangeReadings

    @property
    def feet(self) -> Feet:
        return Feet(*(FootTrajectory(p, None, None) for p in self.places))


def path(strides: np.ndarray, before: float, turn: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 2) and headings along a route with one corner, s in strides."""
    radius = STRIDE * turn / (0.5 * np.pi)
    bent = np.clip((strides - before) / turn, 0.0, 1.0) * -0.5 * np.pi
    first = np.minimum(strides, before) * STRIDE
    last = np.maximum(strides - before - turn, 0.0) * STRIDE
    x = first - radius * np.sin(bent) + last * np.cos(bent)
    y = -radius * (1.0 - np.cos(bent)) + last * np.sin(bent)
    return np.stack([x, y], axis=1), bent


def footsteps(seed: int = 0, before: int = 41, turn: int = 3, after: int = 20, scatter: float = 0.005) -> Footsteps:
    """50 m, a corner of 90° to the right, 25 m; the left foot first. Ranges while |z₂| < 6 cm, 30 Hz, 2 mm."""
    rng = np.random.default_rng(seed)
    count = before + turn + after
    time = np.arange(int((count + 1.5) * STRIDE_TIME * RATE)) / RATE
    places, mids = [], []
    for sign, phase in ((-1.0, 0.5), (1.0, 0.0)):
        s = np.arange(count + 1) + phase
        at, heading = path(s, before, turn)
        aside = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
        at = at + 0.5 * sign * WIDTH * aside + scatter * rng.normal(size=at.shape)
        stood = np.round((s + 0.3) * STRIDE_TIME * RATE).astype(int)
        share = np.clip((np.arange(time.size)[:, None] - stood[None, :-1]) / np.diff(stood)[None, :], 0.0, 1.0)
        tau = np.clip((share - 0.25) / 0.5, 0.0, 1.0)
        moved = at[0] + (tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2)) @ np.diff(at, axis=0)
        lift = 0.1 * np.sum(np.sin(np.pi * tau) ** 2, axis=1)
        places.append(np.concatenate([moved, lift[:, None]], axis=1))
        mids.append(stood)
    walk = Footsteps(time, tuple(places), tuple(mids), RangeReadings(time, 0 * time, time < 0))
    across, along = distances(walk, time)
    pings = np.unique(np.searchsorted(time, np.arange(rng.uniform(0, 1 / 30), time[-1], 1 / 30)))
    heard = np.isin(np.arange(time.size), pings) & (np.abs(along) < 0.06) & (across > OFFSET)
    read = np.hypot(across, along) - OFFSET + 0.002 * rng.normal(size=time.size)
    return walk._replace(read=RangeReadings(time, np.where(heard, read, 0.0), heard))


def distances(walk: Footsteps, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The true z₁ and z₂ at any times."""
    right, left = (np.stack([np.interp(times, walk.time, p[:, k]) for k in (0, 1)], axis=1) for p in walk.places)
    stood = walk.places[1][walk.mids[1], :2]
    way = np.diff(stood, axis=0)
    stride = np.clip(np.searchsorted(walk.time[walk.mids[1]], times - 1e-9) - 1, 0, len(way) - 1)
    heading = np.arctan2(way[:, 1], way[:, 0])[stride]
    x, y = (right - left).T
    return x * np.sin(heading) - y * np.cos(heading), x * np.cos(heading) + y * np.sin(heading)


def drifting(walk: Footsteps, seed: int) -> Footsteps:
    """The walk as each foot's own trajectory has it: any world, a drifting heading, strides too long or short."""
    rng = np.random.default_rng(seed)
    told = []
    for place, mids in zip(walk.places, walk.mids, strict=True):
        stride = np.clip(np.searchsorted(mids, np.arange(walk.time.size - 1), side="right") - 1, 0, len(mids) - 1)
        turn = rng.uniform(-np.pi, np.pi) + np.cumsum(0.005 * rng.normal(size=len(mids)))
        size = (1.0 + 0.005 * rng.normal()) * (1.0 + 0.01 * rng.normal(size=len(mids)))
        c, s = (size * np.cos(turn))[stride], (size * np.sin(turn))[stride]
        dx, dy = np.diff(place[:, :2], axis=0).T
        step = np.stack([c * dx - s * dy, s * dx + c * dy], axis=1)
        told.append(np.column_stack([np.concatenate([[[0.0, 0.0]], np.cumsum(step, axis=0)]), place[:, 2]]))
    return walk._replace(places=tuple(told))


def widths(walk: Footsteps, strides) -> tuple[np.ndarray, np.ndarray]:
    """The true width and step length of strides, given by side and times of standing; NaN where there is none."""
    found = []
    for side, first, last in zip(*map(np.asarray, (strides.side, strides.standing, strides.standing_end)), strict=True):
        own, other = walk.places[side], walk.places[1 - side]
        a, b = (own[np.argmin(np.abs(walk.time - t)), :2] for t in (first, last))
        between = [k for k in walk.mids[1 - side] if first < walk.time[k] < last]
        if len(between) != 1:
            found.append((np.nan, np.nan))
            continue
        way, there = b - a, other[between[0], :2] - a
        across = way[0] * there[1] - way[1] * there[0]
        found.append(((1.0 if side == 0 else -1.0) * across / np.hypot(*way), way @ there / np.hypot(*way)))
    return tuple(np.array(found).reshape(-1, 2).T)
