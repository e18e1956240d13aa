"""Stride width on a real walk: a range made from motion capture, first headings that are wrong, and the errors.

`gaitmap_example` has both feet and markers on them, but no range sensor. So a range is simulated: 30 Hz, 2 mm of noise,
available only while one foot passes the other (within 5 cm along the left foot's stride) and up to half a metre away;
whether the feet turn, the estimators have to detect. The sensors' places are taken to be the mean of heel, toe and
fifth metatarsal, and widths are judged at the same points: the line through two stances of a foot, and the stance of
the other between.
"""

import itertools
from typing import Any, NamedTuple

import numpy as np

from experiments.common.recordings import foot_centres, walks
from jgait.types import Estimate, RangeReadings, Recording

PING_HZ, PING_NOISE = 30.0, 0.002
HEARD_ALONG, HEARD_ACROSS = 0.05, 0.5
WRONG = (5.0, -5.0, 10.0, -10.0, 15.0, -15.0)
"""[deg] By how much the left foot's heading is wrong at the start."""

TURN = np.radians(15.0)


class Capture(NamedTuple):
    """A walk with markers.

    Attributes:
        recording: sensors on both feet.
        time: (m,) of the markers, on the sensors' clock [s].
        feet: right and left, (m, 2) [m].
    """

    recording: Recording
    time: np.ndarray
    feet: tuple[np.ndarray, np.ndarray]

    def at(self, side: int, times: Any) -> np.ndarray:
        """(…, 2) [m]."""
        return np.stack([np.interp(times, self.time, self.feet[side][:, axis]) for axis in (0, 1)], axis=-1)


def capture() -> Capture:
    """The walk of `gaitmap_example` with markers."""
    walk = walks("gaitmap_example")[0]
    feet = []
    for centre in foot_centres(walk).values():
        known = np.isfinite(centre[:, 0])
        index = np.arange(len(centre))
        feet.append(np.stack([np.interp(index, index[known], centre[known, axis]) for axis in (0, 1)], axis=1))
    return Capture(walk.recording, walk.info["mocap_time"], (feet[0], feet[1]))


def stances(walk: Capture, side: int) -> np.ndarray:
    """When a foot is slowest between its swings [s]."""
    speed = np.hypot(*np.gradient(walk.feet[side], walk.time, axis=0).T)
    swings = np.flatnonzero(np.diff((speed > 0.6).astype(int)))
    edges = np.concatenate([[0], swings, [len(speed)]])
    slow = [(a, b) for a, b in itertools.pairwise(edges) if b - a > 8 and speed[(a + b) // 2] < 0.6]
    smooth = np.convolve(speed, np.ones(5) / 5, mode="same")
    smooth[:2], smooth[-2:] = np.inf, np.inf
    return walk.time[[a + int(np.argmin(smooth[a:b])) for a, b in slow]]


def headings(walk: Capture, side: int, times: np.ndarray) -> np.ndarray:
    """Direction of a foot's stride at some times [rad]."""
    stood = stances(walk, side)
    way = np.diff(walk.at(side, stood), axis=0)
    long = np.flatnonzero(np.hypot(*way.T) > 0.15)
    angle = np.unwrap(np.arctan2(way[long, 1], way[long, 0]))
    return angle[np.clip(np.searchsorted(stood[long], times, side="right") - 1, 0, len(long) - 1)]


def simulated_range(walk: Capture, seed: int) -> RangeReadings:
    """Readings of a simulated range sensor."""
    rng = np.random.default_rng(seed)
    time = np.arange(walk.time[0] + rng.uniform(0.0, 1.0 / PING_HZ), walk.time[-1], 1.0 / PING_HZ)
    way = walk.at(0, time) - walk.at(1, time)
    heading = headings(walk, 1, time)
    across = way[:, 0] * np.sin(heading) - way[:, 1] * np.cos(heading)
    along = way[:, 0] * np.cos(heading) + way[:, 1] * np.sin(heading)
    heard = (np.abs(along) < HEARD_ALONG) & (across > 0.02) & (across < HEARD_ACROSS)
    distance = np.hypot(across, along) + PING_NOISE * rng.normal(size=time.size)
    return RangeReadings(time, np.where(heard, distance, 0.0), heard)


def with_range(walk: Capture, seed: int) -> Recording:
    """The recording, a range with it."""
    return walk.recording._replace(feet_range=simulated_range(walk, seed))


def start_heading(walk: Capture, wrong_deg: float) -> tuple[float, float]:
    """Heading of the first right and left stride, that of the left one wrong [rad]."""
    first = [float(headings(walk, side, np.zeros(1))[0]) for side in (0, 1)]
    return 0.0, first[1] - first[0] + float(np.radians(wrong_deg))


class Errors(NamedTuple):
    """Of every stride that does not turn and whose width is known.

    Attributes:
        width: error [m].
        stddev: that the estimate states [m].
        true: width [m].
        step: error of the step length [m].
        length: error of the stride length [m].
        end: when the strides end [s].
    """

    width: np.ndarray
    stddev: np.ndarray
    true: np.ndarray
    step: np.ndarray
    length: np.ndarray
    end: np.ndarray


def errors(walk: Capture, estimate: Estimate) -> Errors:
    """The estimate beside the markers."""
    s, spread = estimate.strides, estimate.strides_stddev
    rows = []
    for k in range(len(s.side)):
        side = int(s.side[k])
        start, end = walk.at(side, float(s.standing[k])), walk.at(side, float(s.standing_end[k]))
        stood = stances(walk, 1 - side)
        between = stood[(stood > s.standing[k]) & (stood < s.standing_end[k])]
        around = np.array([s.standing[k] - 0.5, s.standing[k] + 0.3, s.standing_end[k] + 0.3])
        turns = np.ptp([headings(walk, foot, around) for foot in (0, 1)]) > TURN
        way = end - start
        length = np.hypot(*way)
        if len(between) != 1 or turns or length < 0.5 or not np.isfinite(s.width[k]):
            continue
        other = walk.at(1 - side, between[0]) - start
        sign = 1.0 if side == 0 else -1.0
        width = sign * (way[0] * other[1] - way[1] * other[0]) / length
        step = way @ other / length
        rows.append((s.width[k] - width, spread.width[k], width, s.step_length[k] - step, s.length[k] - length,
                     s.standing_end[k]))  # fmt: skip
    return Errors(*np.array(rows, float).reshape(-1, 6).T)
