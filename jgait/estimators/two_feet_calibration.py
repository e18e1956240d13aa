"""From a recording to what the joint estimator takes: NumPy, on the host.

Which ranges are used, what is a turn and how late the range's clock is are decided as `stride_width_ekf` decides them,
about trajectories made in haste: strapdown from foothold to foothold, level and at rest at each. Directions of strides
come out of that within a few degrees, which is all that is asked of it.
"""

import itertools
import math

import numpy as np

from jgait.estimators.foot_ins import prepare as foot_calibration
from jgait.estimators.foot_ins.inputs import FootSignals
from jgait.estimators.interface import Prepared
from jgait.estimators.stride_width_ekf.prepare import prepare_from_feet
from jgait.estimators.stride_width_ekf.trajectories import SHORT
from jgait.estimators.two_feet_inputs import TwoFeetInputs
from jgait.estimators.two_feet_params import DEFAULT, TwoFeetOptions, width_options
from jgait.geometry.vectors import GRAVITY
from jgait.types import Feet, FootTrajectory, Recording, RecordingError

LEVEL_TIME = 0.03
"""[s] Around a foothold over which the accelerometer says what is up."""


def prepare(
    recording: Recording, options: TwoFeetOptions = DEFAULT, *, start_heading: tuple[float, float] | None = None
) -> Prepared[TwoFeetInputs]:
    """The inputs of `two_feet.run` for a recording.

    Args:
        recording: sensors on both feet, on one clock, and the range between them.
        options: which ranges are used.
        start_heading: heading of the first right and left stride in one world [rad]; None: they are parallel, as
            people begin to walk with both feet in one direction.

    Returns:
        Inputs and options. `notes` says what was left out, and how late the range's clock was.

    Raises:
        RecordingError: a foot is missing, or see `foot_calibration.prepare`.
    """
    worn = foot_calibration.worn_sides(recording, "two_feet")
    if len(worn) < 2:
        raise RecordingError(
            f"two_feet needs 'foot_right' and 'foot_left'; the recording has {sorted(recording.sensors)}"
        )
    ready = foot_calibration.prepare(recording, options.detector)
    time = np.asarray(ready.inputs.time)
    feet: list[FootSignals] = [ready.inputs.right, ready.inputs.left]  # type: ignore[list-item]
    stood = [foot.foothold[: int(foot.count)] for foot in feet]
    ways = [_in_haste(foot, at) for foot, at in zip(feet, stood, strict=True)]
    headings = [_headings(way[at, :2], at, time.size) for way, at in zip(ways, stood, strict=True)]
    rough = Feet(*(FootTrajectory(way, None, None) for way in ways))
    told = prepare_from_feet(time, rough, (stood[0], stood[1]), recording.feet_range, width_options(options))
    moments = told.inputs
    known = feet[0].valid & feet[1].valid
    seen, distance, late = np.zeros(time.size, bool), np.ones(time.size), np.zeros(time.size)
    for row in np.flatnonzero(moments.seen):
        at = _nearest(time, moments.time[row])
        if known[at]:
            seen[at], distance[at], late[at] = True, moments.distance[row], moments.time[row] - time[at]
    both = np.zeros(time.size, bool)
    both[[_nearest(time, moment) for moment in moments.time[moments.double_support]]] = True
    # until the next moment a foot turns as it did at the last
    last = np.clip(np.searchsorted(moments.time, time, side="right") - 1, 0, moments.time.size - 1)
    first = (0.0, 0.0) if start_heading is None else start_heading
    yaw = headings[0][0] - headings[1][0] + first[1] - first[0]
    inputs = TwoFeetInputs(
        time, feet[0], feet[1], distance, late, seen, headings[0], headings[1],
        np.asarray(math.remainder(yaw, 2.0 * math.pi)), moments.turning[last], both,
    )  # fmt: skip
    return Prepared(inputs, options, (*ready.notes, *told.notes), ready.standing)


def _nearest(time: np.ndarray, moment: float) -> int:
    after = min(int(np.searchsorted(time, moment)), time.size - 1)
    before = max(after - 1, 0)
    return before if moment - time[before] < time[after] - moment else after


def _headings(stood: np.ndarray, at: np.ndarray, samples: int) -> np.ndarray:
    """(T,) direction of each sample's stride; a foot that shifts on the spot keeps that before."""
    way = np.diff(stood, axis=0)
    long = np.flatnonzero(np.hypot(*way.T) >= SHORT) if len(way) else np.zeros(0, int)
    if not long.size:
        return np.zeros(samples)
    heading = np.unwrap(np.arctan2(way[long, 1], way[long, 0]))
    stride = np.searchsorted(at[long], np.arange(samples), side="left") - 1
    return heading[np.clip(stride, 0, long.size - 1)]


def _in_haste(foot: FootSignals, stood: np.ndarray) -> np.ndarray:
    """(T, 3) the foot's way by strapdown, velocity and tilt taken off between footholds."""
    position = np.zeros((len(foot.rate), 3))
    q = tuple(map(float, foot.attitude))
    span = max(1, round(LEVEL_TIME / max(float(np.median(foot.dt[foot.dt > 0])), 1e-4))) if (foot.dt > 0).any() else 1
    for a, b in itertools.pairwise(stood):
        h = foot.dt[a + 1 : b + 1]
        turned = np.array(_turned_by(q, (foot.gyr[a + 1 : b + 1] - foot.gyr_bias) * h[:, None]))
        middle = turned[:-1] + turned[1:]
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        force = _rotated(middle, foot.acc[a + 1 : b + 1])
        speed = np.cumsum((force - np.array([0.0, 0.0, GRAVITY])) * h[:, None], axis=0)
        duration = np.cumsum(h) / max(float(np.sum(h)), 1e-9)
        speed = speed - duration[:, None] * speed[-1]
        before = np.concatenate([np.zeros((1, 3)), speed[:-1]])
        position[a + 1 : b + 1] = position[a] + np.cumsum(0.5 * (before + speed) * h[:, None], axis=0)
        up = _rotated(np.repeat(turned[-1:], 2 * span + 1, axis=0), _around(foot.acc, b, span)).mean(axis=0)
        q = _levelled(turned[-1], up)
    if len(stood):
        position[stood[-1] + 1 :] = position[stood[-1]]
    return position


def _around(values: np.ndarray, at: int, span: int) -> np.ndarray:
    return values[np.clip(np.arange(at - span, at + span + 1), 0, len(values) - 1)]


def _turned_by(q: tuple[float, ...], turns: np.ndarray) -> list[tuple[float, ...]]:
    """Attitudes before and after each turn (n, 3) [rad] in the sensor's axes; plain floats, thrice as quick as rows."""
    angle = np.linalg.norm(turns, axis=1)
    half = 0.5 * np.sinc(angle / (2.0 * np.pi))
    found = [q]
    w, x, y, z = q
    for c, (i, j, k) in zip(np.cos(0.5 * angle).tolist(), (half[:, None] * turns).tolist(), strict=True):
        w, x, y, z = (
            w * c - x * i - y * j - z * k, w * i + x * c + y * k - z * j,
            w * j - x * k + y * c + z * i, w * k + x * j - y * i + z * c,
        )  # fmt: skip
        found.append((w, x, y, z))
    return found


def _rotated(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) by quaternions (n, 4)."""
    u = q[:, 1:]
    t = 2.0 * np.cross(u, v)
    return v + q[:, :1] * t + np.cross(u, t)


def _levelled(q: np.ndarray, up: np.ndarray) -> tuple[float, ...]:
    """An attitude, tilted so that what it takes to be up is up."""
    x, y, z = up / max(float(np.linalg.norm(up)), 1e-9)
    if z < 0.5:  # a jolt, and no gravity
        return tuple(map(float, q))
    turn = np.array([1.0 + z, y, -x, 0.0])
    turn /= np.linalg.norm(turn)
    w, i, j, k = q
    a, b, c, _ = turn
    out = np.array([a * w - b * i - c * j, a * i + b * w + c * k, a * j - b * k + c * w, a * k + b * j - c * i])
    return tuple(map(float, out / np.linalg.norm(out)))
