"""Orientation of the sensors on thighs and shanks, and the zero of hip and knee angles, from walking and, where there
is one, a standing; on the host.

A leg in straight walking turns about one axis, the sagittal axis of each segment; gravity gives the vertical. The axes
are forward, left and up, as of a standing segment; the forward swing is a negative rate about the axis to the left.

A rest may be standing, sitting, lying or leaning; how far each segment is inclined then, over its mean inclination in
walking, gives the probability that the person stands. People stand with nearly straight legs (`standing_hip`,
`standing_knee` of an estimator), and walk with thighs and knees that are on average bent alike; who never stands has
the second alone.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jgait.events.rest import LEGS_RATE, LEGS_SHORTEST_S
from jgait.geometry.arrays import xp
from jgait.geometry.vectors import GRAVITY
from jgait.mounting.cycle import WALKING_RATE, Cycle, cycle_of, mean_force, sagittal_axis, smooth
from jgait.mounting.places import Places, places_of
from jgait.notes import FEW_RESTS, Kind, Note
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Imu, RecordingError, Values, as_float

QUIET_RATE = 0.02
"""[rad/s] Root mean square of the turns of a segment in quiet standing, as `InclinationNoise.standing_rate`. Chosen by
hand."""

WALKING_POSE = np.deg2rad([9.0, 25.0])
"""[rad] Usual mean over strides of the hip's angle from the vertical, and of the knee's flexion: 8.5 and 18.6° from
standing on `walking5m`, 5 and 22° on `neura_sparse` (Vicon), 11 and 30° in simulated people."""

POSTURES = {
    "stands": (0.6, (0.0, 0.0, 0.0), (8.0, 8.0, 8.0)),
    "sits": (0.2, (85.0, 0.0, 0.0), (15.0, 20.0, 20.0)),
    "lies": (0.1, (90.0, 80.0, 0.0), (30.0, 40.0, 60.0)),
    "leans": (0.1, (15.0, -5.0, 0.0), (30.0, 30.0, 30.0)),
}
"""Posture → prior probability; mean and standard deviation of the inclinations of thigh and shank, positive with the
distal end forward, and of both sideways [deg]. Chosen by hand."""

SITS = Kind(
    "sits", "info",
    "at rest from {begin_s:.3g} s to {end_s:.3g} s a leg is tilted by {degrees:.0f}° from its mean direction in "
    "walking, as of a person who sits; not taken for standing",
    "The zero of the angles is that of upright standing and of walking.",
)  # fmt: skip
STANDING_MOVES = Kind(
    "standing_moves", "check",
    "{side}: hip and knee angles are less certain: in the standing from which they count, the leg moves at up to "
    "{rate:.2f} rad/s",
    FEW_RESTS,
)  # fmt: skip


class Pose(NamedTuple):
    """What walking states of a leg's hip and knee angle in the pose from which its sensors' angles count."""

    mean: np.ndarray  #: (2,) hip angle from the vertical and knee flexion [rad], with the deviations of walking.
    walks: np.ndarray  #: 1.0 if walking states them, else 0.0.
    stands: np.ndarray  #: probability that the person stands in that pose [1].


class SegmentMounting(NamedTuple):
    """Mounting and errors of the sensor of one segment, from a recording."""

    placement: str  #: placement of the sensor; another one if sensors have changed places.
    axes: np.ndarray  #: (3, 3) forward, left and up in the sensor's axes [1]; `gyr @ axes.T` is in the segment's.
    scale: float  #: factor on the accelerometer, so that it reads standard gravity [1]; 0 without one.
    bias: np.ndarray  #: (3,) gyroscope bias at rest, in the segment's axes [rad/s].
    variance: np.ndarray  #: sagittal gyroscope variance at rest [rad²/s²].
    unrest: np.ndarray  #: variance of its turns at rest, over that of quiet standing [rad²/s²].


class LegMounting(NamedTuple):
    """Orientation of the sensors of one leg."""

    segments: dict[str, SegmentMounting]  #: "thigh", "shank" → its sensor.
    pose: Pose  #: hip and knee in the pose from which angles count.


class WornLegs(NamedTuple):
    """The sensors on a person's legs."""

    legs: dict[str, LegMounting]  #: side → orientation.
    places: Places  #: which sensor is where.
    cycle: Cycle  #: how the sensors turn over a stride.
    upright: np.ndarray  #: (T,) bool, the person stands.
    standing: tuple[int, int] | None  #: samples of the standing from which angles count; None: they count from walking.
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


def worn_legs(sensors: Mapping[str, Imu], still: np.ndarray, sampling_rate_hz: float, *, estimator: str) -> WornLegs:
    """How sensors on thighs and shanks, all at the same times, are worn; sensors on feet witness it. `still` (T,) is
    True where no leg moves; `estimator` is a name for the error.

    Raises:
        RecordingError: if nobody walks.
    """
    cycle = cycle_of(sensors)
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
    rests = [run for run in true_runs(still) if run[1] - run[0] >= LEGS_SHORTEST_S * sampling_rate_hz]
    upright, likely, notes = still.copy(), dict[tuple[int, int], float](), list[Note]()
    for first, after in rests:
        tilts = [_tilt(name, imu, every[name], walks[name], slice(first, after))
                 for name, (imu, _, _) in segments.items() if imu.acc is not None]  # fmt: skip
        if (stands := standing_probability(tilts)) >= 0.5:
            likely[first, after] = stands
        else:
            upright[first:after] = False
            largest = max((abs(tilt) for _, *both in tilts for tilt in both), default=0.0)
            begin, end = first / sampling_rate_hz, after / sampling_rate_hz
            notes.append(SITS(begin_s=begin, end_s=end, degrees=np.rad2deg(largest)))
    long = [run for run in likely if run[1] - run[0] >= 1.0 * sampling_rate_hz]  # [s] the first long one calibrates
    standing = long[0] if long else max(likely, key=lambda run: run[1] - run[0], default=None)
    probability = 0.0 if standing is None else likely[standing]
    rest = standing or max(rests, key=lambda run: run[1] - run[0], default=None)
    notes = [*places.notes(), *notes]
    legs = {}
    for side in SIDES:
        if names := [name for name in segments if name.endswith(side)]:
            each: dict[str, tuple[SegmentMounting, float | None]] = {}
            for name in names:
                worn = _segment(places.worn[name], *segments[name], cycle, standing, rest, sampling_rate_hz)
                each[name.partition("_")[0]] = worn
            thigh, shank = (each[segment][1] if segment in each else None for segment in ("thigh", "shank"))
            pose = Pose(WALKING_POSE, np.asarray(float(standing is None)), np.asarray(probability))
            if thigh is not None and shank is not None:  # else walking states nothing of a standing
                pose = pose._replace(mean=WALKING_POSE - np.array([thigh, thigh - shank]), walks=np.ones(()))
            legs[side] = LegMounting({segment: worn for segment, (worn, _) in each.items()}, pose)
            notes += [note for name in names for note in places.unsure(name)]
            if standing is not None:
                imus = [segments[name][0] for name in names]
                rates = (as_float(imu.gyr)[measured(imu, slice(*standing))] for imu in imus)
                fastest = max(float(np.linalg.norm(rate, axis=1).max()) for rate in rates)
                notes += [STANDING_MOVES(side=side, rate=fastest)] if fastest > LEGS_RATE else []
    return WornLegs(legs, places, cycle, upright, standing, notes)


def _tilt(name: str, imu: Imu, rows: np.ndarray, walks: complex | None, rest: slice) -> tuple[str, float, float]:
    """Segment, and its inclinations forward and sideways at rest [rad], if it walks as usual."""
    segment, force = name.partition("_")[0], _direction(imu, rest)
    assert force is not None
    forward, left, up = rows @ force
    usual = WALKING_POSE[0] - (WALKING_POSE[1] if segment == "shank" else 0.0)
    mean = 0.0 if walks is None else float(np.angle(walks))
    return segment, float(np.arctan2(forward, up)) - mean + usual, float(np.arctan2(left, np.hypot(forward, up)))


def _segment(
    label: str, imu: Imu, right: np.ndarray, up: np.ndarray | None, cycle: Cycle, standing: tuple[int, int] | None,
    rest: tuple[int, int] | None, rate: float,
) -> tuple[SegmentMounting, float | None]:  # fmt: skip
    """The mounting of one sensor, which is called `label`, and the segment's mean inclination in walking [rad]. `right`
    and `up` are its axes by walking; `standing` calibrates them, and `rest` the gyroscope.
    """
    if standing is not None and (force := _direction(imu, slice(*standing))) is not None:
        up = force / max(float(np.linalg.norm(force)), 1e-9)
        axis = sagittal_axis(as_float(imu.gyr), up, cycle.walks & np.asarray(imu.mask, bool), rate)
        right = axis if axis @ right > 0.0 else -axis
    rows = segment_axes(right, up)
    walked = mean_force(imu, rows, cycle)
    bias, gravity = cycle.turning[label].bias, abs(walked or 0.0)
    variance, unrest = np.asarray(QUIET_RATE**2), np.asarray(QUIET_RATE**2)
    if rest is not None:
        samples = measured(imu, slice(*rest))
        gyr, acc = as_float(imu.gyr)[samples], None if imu.acc is None else as_float(imu.acc)[samples]
        bias = gyr.mean(axis=0)
        variance = np.asarray(max(np.var((gyr @ rows.T)[:, 1]), 1e-8))  # a coarse gyroscope reads a constant
        unrest = _unrest(gyr, acc, rate)
        gravity = gravity if acc is None else float(np.linalg.norm(acc.mean(axis=0)))
    scale = GRAVITY / gravity if gravity else 0.0
    mean = None if walked is None else float(np.angle(walked))
    return SegmentMounting(label, rows, scale, rows @ bias, variance, unrest), mean


def _unrest(gyr: np.ndarray, acc: np.ndarray | None, rate: float) -> np.ndarray:
    """By how much the variance of the turns of a segment at rest is above that of quiet standing [rad²/s²].

    Turns are those of the gyroscope (T, 3) [rad/s] over a tenth of a second about its mean, and the mean turn that the
    direction of gravity shows, from the force (T, 3) in the first quarter and in the last one.
    """
    variance = np.stack([smooth(column, 0.1, rate) for column in gyr.T], axis=1).var(axis=0).sum()
    if acc is not None:
        quarter = max(1, len(acc) // 4)
        ups = np.stack([acc[:quarter].mean(axis=0), acc[-quarter:].mean(axis=0)])
        ups = ups / np.maximum(np.linalg.norm(ups, axis=1, keepdims=True), 1e-9)
        variance += np.sum((ups[1] - ups[0]) ** 2) * (rate / max(1, len(acc) - quarter)) ** 2
    return np.asarray(max(variance - QUIET_RATE**2, 0.0))


def standing_probability(inclinations: Sequence[tuple[str, float, float]]) -> float:
    """The probability that a person at rest stands, from segment ("thigh", "shank"), its inclination, and its
    inclination sideways [rad] for each sensor, over the usual pose of walking; 1 if there is none. Shanks alone tell
    lying from standing: they are upright in a chair, too.
    """
    if not inclinations:
        return 1.0
    scores = []
    thighs = any(segment == "thigh" for segment, *_ in inclinations)
    for prior, mean, spread in (POSTURES[name] for name in (POSTURES if thighs else ("stands", "lies"))):
        score = math.log(prior)
        for segment, forward, sideways in inclinations:
            row = 0 if segment == "thigh" else 1
            for value, at in ((forward, row), (sideways, 2)):
                away = math.remainder(math.degrees(value) - mean[at], 360.0)
                deviation = math.hypot(spread[at], 6.0)  # of the mean in walking
                score -= 0.5 * (away / deviation) ** 2 + math.log(deviation)
        scores.append(score)
    return float(np.exp(scores[0] - np.logaddexp.reduce(scores)))


type _Normal = tuple[tuple[Values, Values], tuple[Values, Values, Values]]
"""Mean of two variables, and their variances and covariance (first, both, second)."""


def posterior(pose: Pose, mean: tuple[Values, Values], deviation: tuple[Values, Values]) -> _Normal:
    """Mean [rad] and covariance [rad²] of hip and knee in the pose from which angles count, as one normal density.

    People stand at `mean` with a `deviation` [rad], or a few with a larger one, and walk with the usual mean angles, or
    a few with others: a mixture of normal densities, each weighed by how well standing and walking agree in it.
    """
    off = tuple(pose.mean[i] - mean[i] for i in range(2))
    # variances and covariance of the means of walking between people and sets: 4° and 6°, correlated by 0.6
    walk = math.radians(4.0) ** 2, 0.6 * math.radians(4.0) * math.radians(6.0), math.radians(6.0) ** 2
    parts: list[tuple[Values, _Normal]] = []
    # share of people, and factors on the deviations of standing and walking: a tenth walk with other mean angles, as
    # crouched, and a tenth stand otherwise, with bent knees; chosen by hand
    for share, stand_times, walk_times in ((0.81, 1.0, 1.0), (0.09, 1.0, 3.0), (0.09, 4.0, 1.0)):
        hip, knee = ((stand_times * each) ** 2 for each in deviation)
        a, b, c = hip + walk[0] * walk_times**2, walk[1] * walk_times**2, knee + walk[2] * walk_times**2
        size = a * c - b * b
        square = (c * off[0] ** 2 - 2.0 * b * off[0] * off[1] + a * off[1] ** 2) / size
        gain = (c * hip / size, -b * hip / size), (-b * knee / size, a * knee / size)
        at = tuple(mean[i] + gain[i][0] * off[0] + gain[i][1] * off[1] for i in range(2))
        cov = hip - gain[0][0] * hip, -gain[0][1] * knee, knee - gain[1][1] * knee
        parts.append((share * xp.exp(-0.5 * square) / xp.sqrt(size), ((at[0], at[1]), cov)))
    total = sum(weight for weight, _ in parts)
    zero = 0.0 * total
    walked = (pose.mean[0] + zero, pose.mean[1] + zero), tuple(1.8 * value + zero for value in walk)  # 0.9 + 0.1 · 3²
    stood = (mean[0] + zero, mean[1] + zero), (deviation[0] ** 2 + zero, zero, deviation[1] ** 2 + zero)
    likely = [(pose.walks * pose.stands * weight / total, part) for weight, part in parts]
    likely += [(pose.walks * (1.0 - pose.stands), walked), (1.0 - pose.walks, stood)]
    middle = tuple(sum(weight * part[0][i] for weight, part in likely) for i in range(2))
    hip, both, knee = (
        sum(weight * (cov[i + j] + (at[i] - middle[i]) * (at[j] - middle[j])) for weight, (at, cov) in likely)
        for i, j in ((0, 0), (0, 1), (1, 1))
    )
    return (middle[0], middle[1]), (hip, both, knee)
