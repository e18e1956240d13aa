"""The paper's walk in simulation: 50 m, a corner, 25 m, on marks 0.30 m apart; both feet's sensors, and the range.

Truth is where the sensors are. z₁ and z₂ are judged as in the paper, at double support and outside of turns, in three
sections: the first 28 m, the rest before the corner, and behind it.
"""

from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.common import protocols
from jgait.simulate import Body
from jgait.types import Estimate, Recording

SECTION = 28.0
"""[m]"""

SECTIONS = ("section1", "section2", "section3")
PAPER = {
    "z1_mean": (0.2461, 0.0437, 0.0331), "z1_sd": (0.0014, 0.0179, 0.0184),
    "z2_mean": (0.2157, 0.0480, 0.0082), "z2_sd": (0.0032, 0.0673, 0.5542),
}  # fmt: skip
"""Table I: errors of the paper's filter, the means without their signs [m]."""


class Marked(NamedTuple):
    """One simulated walk.

    Attributes:
        recording: both feet's sensors and the range.
        time: (T,) [s].
        feet: where the sensors are, right and left, (T, 2) [m].
        way: (T,) along the route [m].
        corner: from where to where the route turns [m].
        offset: distance of the sensors minus the range while the person stands [m].
        strides: the truth's.
    """

    recording: Recording
    time: np.ndarray
    feet: tuple[np.ndarray, np.ndarray]
    way: np.ndarray
    corner: tuple[float, float]
    offset: float
    strides: Any


def walks(seed: int, people: int, straight: float = 50.0, after: float = 25.0) -> list[Marked]:
    """Simulated people on the paper's route."""
    found = []
    for one in protocols.potter(jax.random.key(seed), people, straight=straight, after=after):
        truth, extra = one.truth, one.extra
        feet = tuple(_sensor(truth.motion.pose, side) for side in ("right", "left"))
        apart = float(np.linalg.norm(feet[0][0] - feet[1][0]))
        found.append(
            Marked(
                one.recording,
                np.asarray(truth.estimate.time),
                feet,
                np.asarray(truth.estimate.distance),
                extra["corner"],
                apart - float(extra["range_distance"][0]),
                jax.tree.map(np.asarray, truth.estimate.strides),
            )
        )
    return found


def _sensor(pose: Any, side: str) -> np.ndarray:
    """(T, 2) where the sensor on the instep is: ahead of the ankle along the foot."""
    frame = getattr(pose, f"foot_{side}")
    ahead = 0.4 * Body().ball_length
    return np.stack([np.asarray(frame.origin[i]) + ahead * np.asarray(frame.x[i]) for i in (0, 1)], axis=1)


class Apart(NamedTuple):
    """Errors of z₁ and z₂ at double support, by section; each a list of arrays [m]."""

    z1: list[np.ndarray]
    z2: list[np.ndarray]


def apart(walk: Marked, estimate: Estimate) -> Apart:
    """z₁ and z₂ beside the truth, whose heading is that of the left foot's stride."""
    told = estimate.diagnostics
    time = np.asarray(told["moment_time"]) if "moment_time" in told else np.asarray(estimate.time)
    chosen = np.asarray(told["double_support"], bool) & ~np.asarray(told["turning"], bool)
    time, z1, z2 = time[chosen], np.asarray(told["z1"])[chosen], np.asarray(told["z2"])[chosen]
    right, left = (np.stack([np.interp(time, walk.time, foot[:, i]) for i in (0, 1)], axis=1) for foot in walk.feet)
    s = walk.strides
    of_left = np.flatnonzero(s.valid & (s.side == 1))
    stood = np.append(s.start[of_left[0]], s.end[of_left]) + 0.3
    places = np.stack([np.interp(stood, walk.time, walk.feet[1][:, i]) for i in (0, 1)], axis=1)
    heading = np.unwrap(np.arctan2(*np.diff(places, axis=0).T[::-1]))
    angle = heading[np.clip(np.searchsorted(stood, time) - 1, 0, len(heading) - 1)]
    way = right - left
    true1 = way[:, 0] * np.sin(angle) - way[:, 1] * np.cos(angle)
    true2 = way[:, 0] * np.cos(angle) + way[:, 1] * np.sin(angle)
    along = np.interp(time, walk.time, walk.way)
    near = 1.5  # [m] strides that reach into the corner
    inside = [along < SECTION, (along >= SECTION) & (along < walk.corner[0] - near), along > walk.corner[1] + near]
    return Apart([(z1 - true1)[i] for i in inside], [(z2 - true2)[i] for i in inside])


def width_errors(walk: Marked, estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the widths of strides outside of turns, and their standard deviations [m]."""
    s, spread, true = estimate.strides, estimate.strides_stddev, walk.strides
    rows = []
    for k in range(len(s.side)):
        same = np.flatnonzero(true.valid & (true.side == s.side[k]))
        nearest = same[np.argmin(np.abs(true.end[same] - s.end[k]))]
        along = np.interp([s.standing[k], s.standing_end[k]], walk.time, walk.way)
        turns = along[1] > walk.corner[0] - 1.5 and along[0] < walk.corner[1] + 1.5
        if turns or abs(true.end[nearest] - s.end[k]) > 0.3 or not np.isfinite(s.width[k]) or s.length[k] < 0.5:
            continue
        rows.append((_width(walk, int(s.side[k]), s.standing[k], s.standing_end[k]), s.width[k], spread.width[k]))
    values = np.array(rows).reshape(-1, 3)
    known = np.isfinite(values).all(axis=1)
    return (values[:, 1] - values[:, 0])[known], values[known, 2]


def _width(walk: Marked, side: int, start: float, end: float) -> float:
    """How far the other foot's sensor stands from the line between two places of this one's [m]."""
    own, other = walk.feet[side], walk.feet[1 - side]

    def place(foot: np.ndarray, at: float) -> np.ndarray:
        return np.array([np.interp(at, walk.time, foot[:, i]) for i in (0, 1)])

    inside = (walk.time > start) & (walk.time < end)
    speed = np.hypot(*np.gradient(other[inside], walk.time[inside], axis=0).T)
    if inside.sum() < 5:
        return float("nan")
    stands = walk.time[inside][int(np.argmin(speed))]
    way, there = place(own, end) - place(own, start), place(other, stands) - place(own, start)
    sign = 1.0 if side == 0 else -1.0
    return float(sign * (way[0] * there[1] - way[1] * there[0]) / np.linalg.norm(way))
