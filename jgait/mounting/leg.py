"""Orientation of the sensors on thighs and shanks, from walking and, where there is one, a standing; on the host.

A leg in straight walking turns about one axis, the sagittal axis of each segment; gravity gives the vertical. The axes
are forward, left and up, as of a standing segment; the forward swing is a negative rate about the axis to the left.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.mounting.cycle import WALKING_RATE, Cycle, cycle_of, mean_force, sagittal_axis
from jgait.mounting.places import Places, places_of
from jgait.mounting.pose import WALKING_POSE, Pose, pose_from_walking, standing_probability
from jgait.notes import Kind, Note
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Imu, RecordingError, as_float

SHORTEST_S, LONG_S = 0.5, 1.0
"""[s] Shortest rest that can calibrate a leg, and duration from which on the first standing calibrates."""

UPRIGHT = 0.5
"""[1] Probability of standing from which on a rest is standing."""

SITS = Kind(
    "sits",
    "info",
    "at rest from {begin_s:.3g} s to {end_s:.3g} s a leg is tilted by {degrees:.0f}° from its mean direction in "
    "walking, as of a person who sits; not taken for standing",
    "The zero of the angles is that of upright standing and of walking.",
)


class LegMounting(NamedTuple):
    """Orientation of the sensors of one leg; dictionaries by segment ("thigh", "shank")."""

    placements: dict[str, str]  #: placement whose sensor is on the segment.
    rows: dict[
        str, np.ndarray
    ]  #: (3, 3) forward, left and up in the sensor's axes [1]; `gyr @ rows.T` in the segment's
    gyr_bias: dict[str, np.ndarray]  #: (3,) gyroscope bias, in the sensor's axes [rad/s].
    gravity: dict[str, float]  #: specific force at rest, or over whole strides [m/s²]; 0 without an accelerometer.
    pose: Pose  #: hip and knee in the pose from which angles count.
    notes: list[Note]  #: on segments of which it is not sure which way is forward.


class WornLegs(NamedTuple):
    """The sensors on a person's legs."""

    legs: dict[str, LegMounting]  #: side → orientation.
    places: Places  #: which sensor is where.
    cycle: Cycle  #: how the sensors turn over a stride.
    upright: np.ndarray  #: (T,) bool, the person stands.
    standing: tuple[int, int] | None  #: samples of the standing from which angles count; None: they count from walking.
    rest: tuple[int, int] | None  #: samples of the rest that calibrates the gyroscopes: the standing, or the longest.
    notes: list[Note]


def segment_axes(right: np.ndarray, up: np.ndarray | None) -> np.ndarray:
    """(3, 3) rows forward, left, up in sensor axes, from the sagittal axis to the right and the vertical."""
    if up is None:
        up = np.eye(3)[np.argmin(np.abs(right))]
    forward = np.cross(up, right)
    forward = forward / np.linalg.norm(forward)
    return np.stack([forward, -right, np.cross(right, forward)])


def measured(imu: Imu, standing: slice) -> np.ndarray:
    """The samples of a standing that were measured; all samples if none was."""
    samples = np.arange(len(imu.mask))[standing]
    there = samples[np.asarray(imu.mask, bool)[samples]]
    return there if there.size else samples


def _direction(imu: Imu, samples: slice) -> np.ndarray | None:
    """(3,) mean specific force at rest [m/s²]; None without an accelerometer."""
    return None if imu.acc is None else np.asarray(as_float(imu.acc)[measured(imu, samples)].mean(axis=0))


def worn_legs(
    sensors: Mapping[str, Imu], still: np.ndarray, sampling_rate_hz: float, *, perpendicular: bool = True,
    estimator: str,
) -> WornLegs:  # fmt: skip
    """How sensors on thighs and shanks, all at the same times, are worn; sensors on feet witness it.

    Args:
        sensors: `thigh_SIDE`, `shank_SIDE`, and `foot_SIDE`.
        still: (T,) bool, where no leg moves.
        sampling_rate_hz: sampling rate [Hz].
        perpendicular: make the sagittal axes perpendicular to gravity.
        estimator: its name, for the error.

    Raises:
        RecordingError: if nobody walks.
    """
    cycle = cycle_of(sensors, perpendicular=perpendicular)
    still_ones = {name for name in sensors if not name.startswith("foot")} - set(cycle.turning if cycle else ())
    if cycle is None or still_ones:
        raise RecordingError(
            f"{estimator} found no walking: {' and '.join(sorted(still_ones))} turn at less than {WALKING_RATE:g} "
            "rad/s RMS; is the gyroscope in rad/s, or the walk very slow?"
        )
    places = places_of(cycle)
    segments = {
        name: (sensors[label], places.right[name] * cycle.turning[label].axis, cycle.turning[label].up)
        for name, label in places.worn.items() if not name.startswith("foot")
    }  # fmt: skip
    every = {name: segment_axes(right, up) for name, (_, right, up) in segments.items()}
    walks = {name: mean_force(segments[name][0], rows, cycle) for name, rows in every.items()}
    rests = [run for run in true_runs(still) if run[1] - run[0] >= SHORTEST_S * sampling_rate_hz]
    stands, notes = [], list[Note]()
    for first, after in rests:
        tilts = [_tilt(name, imu, every[name], walks[name], slice(first, after))
                 for name, (imu, _, _) in segments.items() if imu.acc is not None]  # fmt: skip
        stands.append(standing_probability(tilts))
        if stands[-1] < UPRIGHT:
            largest = max((abs(tilt) for _, *both in tilts for tilt in both), default=0.0)
            begin, end = first / sampling_rate_hz, after / sampling_rate_hz
            notes.append(SITS(begin_s=begin, end_s=end, degrees=np.rad2deg(largest)))
    upright = still.copy()
    for (first, after), probability in zip(rests, stands, strict=True):
        upright[first:after] &= probability >= UPRIGHT
    likely = [run for run, probability in zip(rests, stands, strict=True) if probability >= UPRIGHT]
    long = [run for run in likely if run[1] - run[0] >= LONG_S * sampling_rate_hz]
    longest = max(rests, key=lambda run: run[1] - run[0], default=None)
    standing = long[0] if long else max(likely, key=lambda run: run[1] - run[0], default=None)
    probability = 0.0 if standing is None else stands[rests.index(standing)]
    rest = standing or longest
    legs = {}
    for side in SIDES:
        if names := {name.partition("_")[0]: name for name in segments if name.endswith(side)}:
            legs[side] = _leg(names, segments, cycle, places, standing, rest, probability, sampling_rate_hz,
                              perpendicular=perpendicular)  # fmt: skip
    return WornLegs(legs, places, cycle, upright, standing, rest, [*places.notes(), *notes])


def _tilt(name: str, imu: Imu, rows: np.ndarray, walks: complex | None, rest: slice) -> tuple[str, float, float]:
    """Segment, and its inclinations forward and sideways at rest [rad], if it walks as usual."""
    segment, force = name.partition("_")[0], _direction(imu, rest)
    assert force is not None
    forward, left, up = rows @ force
    usual = WALKING_POSE[0] - (WALKING_POSE[1] if segment == "shank" else 0.0)
    mean = 0.0 if walks is None else float(np.angle(walks))
    return segment, float(np.arctan2(forward, up)) - mean + usual, float(np.arctan2(left, np.hypot(forward, up)))


def _leg(
    names: Mapping[str, str], segments: Mapping[str, tuple[Imu, np.ndarray, np.ndarray | None]], cycle: Cycle,
    places: Places, standing: tuple[int, int] | None, rest: tuple[int, int] | None, stands: float, rate: float, *,
    perpendicular: bool,
) -> LegMounting:  # fmt: skip
    """The orientation of one leg's sensors; `names` are its placements by segment."""
    rows, bias, gravity, means = {}, {}, {}, {}
    for segment, name in names.items():
        imu, right, up = segments[name]
        label = places.worn[name]
        if standing is not None and (force := _direction(imu, slice(*standing))) is not None:
            up = force / max(float(np.linalg.norm(force)), 1e-9)
            axis = sagittal_axis(as_float(imu.gyr), up, cycle.walks & np.asarray(imu.mask, bool), rate,
                                 perpendicular=perpendicular)  # fmt: skip
            right = axis if axis @ right > 0.0 else -axis
        rows[segment] = segment_axes(right, up)
        bias[segment] = cycle.turning[label].bias
        if rest is not None:
            bias[segment] = as_float(imu.gyr)[measured(imu, slice(*rest))].mean(axis=0)
        walked = mean_force(imu, rows[segment], cycle)
        means[segment] = None if walked is None else float(np.angle(walked))
        at_rest = None if rest is None else _direction(imu, slice(*rest))
        gravity[segment] = float(np.linalg.norm(at_rest)) if at_rest is not None else abs(walked or 0.0)
    pose = pose_from_walking(means.get("thigh"), means.get("shank"), stands)
    notes = [note for name in names.values() for note in places.unsure(name)]
    return LegMounting({k: places.worn[name] for k, name in names.items()}, rows, bias, gravity, pose, notes)
