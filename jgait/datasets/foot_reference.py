"""Stride lengths of a foot from its inertial sensor: strapdown integration between stances.

Between the quiet instants of two stances, the attitude is integrated from the gyroscope with the exact rotation of each
sample interval; the accelerometer gives the tilt at the first instant. At the second instant the foot stands again: the
difference to the accelerometer's tilt and the remaining velocity are drift, and are removed linearly in time. The
corrected velocity is integrated to the displacement; its horizontal length is the stride length.

In a slow swing the gyroscope and the accelerometer can both be quiet for a moment. Gravity distinguishes it from a
stance: the tilt from the accelerometer and the attitude then differ by 10–60°, at a stance by 0–5°. An instant with a
larger difference is not accepted as a stance, and the stride continues to the next stance. All limits were chosen by
hand.

No magnetometer, so no heading: strides are lengths, and their sum is the path of the foot. It is a reference
for estimators that use other sensors; against Vicon on `neura_sparse` see tests/datasets/test_foot_reference.py.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jgait.signal.windows import true_runs
from jgait.types import Imu, as_float

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


class FootPath(NamedTuple):
    """Strides of one foot."""

    start: np.ndarray  #: (n,) sample of the quiet instant before each stride.
    end: np.ndarray  #: (n,) sample of the quiet instant after each stride.
    length: np.ndarray  #: (n,) [m] horizontal displacement.
    #: (n,) [m] vertical displacement; it is 0 on level ground, so its size indicates the error of `length`.
    rise: np.ndarray
    distance: np.ndarray  #: (T,) [m] path since the first sample, constant while the foot stands.
    standing: np.ndarray  #: (T,) bool, whether the foot stands.


def level(acc: np.ndarray) -> "Rotation":
    """The smallest rotation, sensor to level frame (z up), that turns a specific force (3,) at rest upwards."""
    from scipy.spatial.transform import Rotation

    return Rotation.align_vectors([[0.0, 0.0, 1.0]], acc[None])[0]


def strapdown(gyr: np.ndarray, acc: np.ndarray, dt: float, acc_start: np.ndarray, acc_end: np.ndarray
              ) -> tuple[np.ndarray, float]:  # fmt: skip
    """Displacement (n, 3) [m], z up, between two instants of rest, in the level frame of the first, and the attitude
    drift [rad] that is removed. `gyr` and `acc` include both instants; the others are readings (3,) at rest [m/s²].
    """
    from scipy.integrate import cumulative_trapezoid
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_rotvec((gyr[1:] + gyr[:-1]) * (dt / 2)).as_matrix()
    attitude = np.empty((len(gyr), 3, 3))
    attitude[0] = level(acc_start).as_matrix()
    for k, turn in enumerate(turns):
        attitude[k + 1] = attitude[k] @ turn
    # At the second rest the specific force must point up: the rotation that achieves this is drift, linear in time.
    correction = level(attitude[-1] @ acc_end)
    share = np.linspace(0.0, 1.0, len(gyr))[:, None]
    force = Rotation.from_rotvec(share * correction.as_rotvec()).apply(np.einsum("kij,kj->ki", attitude, acc))
    gravity = np.linalg.norm(acc_start) * (1 - share) + np.linalg.norm(acc_end) * share
    velocity = cumulative_trapezoid(force - gravity * np.array([0.0, 0.0, 1.0]), dx=dt, axis=0, initial=0.0)
    velocity = velocity - share * velocity[-1]
    return cumulative_trapezoid(velocity, dx=dt, axis=0, initial=0.0), float(correction.magnitude())


def stances(imu: Imu, rate_hz: float) -> list[tuple[int, int]]:
    """Stances of the foot, (start, end) [samples], half-open: the largest rate and the spread of the force over 50 ms
    are below 1 rad/s and 1.2 m/s² for 80 ms, without missing samples.
    """
    from scipy.ndimage import maximum_filter1d, uniform_filter1d

    size = max(3, round(0.05 * rate_hz))
    rate = maximum_filter1d(np.linalg.norm(imu.gyr, axis=1), size)
    force = np.linalg.norm(imu.acc, axis=1)
    mean = uniform_filter1d(force, size)
    spread = np.sqrt(np.maximum(uniform_filter1d(force**2, size) - mean**2, 0.0))
    still = (rate < 1.0) & (spread < 1.2) & imu.mask
    return [run for run in true_runs(still) if run[1] - run[0] >= 0.08 * rate_hz]


def foot_path(imu: Imu, rate_hz: float) -> FootPath:
    """Strides of a foot from standing to standing; the gyroscope's bias is its median in the longest stance. Raises
    ValueError, with the reason, where there is none.
    """
    if imu.acc is None:
        raise ValueError("the foot has no accelerometer")
    standing = stances(imu, rate_hz)
    if len(standing) < 2:
        raise ValueError(f"the foot stands {len(standing)} times; a stride needs two stances")
    longest = slice(*max(standing, key=lambda run: run[1] - run[0]))
    gyr = imu.gyr - np.median(imu.gyr[longest], axis=0)
    rows = []
    distance = np.zeros(len(gyr))
    current = 0
    while current < len(standing) - 1:
        following, stride = _next_stride(as_float(gyr), imu, rate_hz, standing, current)
        current = following
        if stride is None or stride.length < 0.05:  # a standing foot that is shifted
            continue
        distance[stride.first : stride.last + 1] += stride.forward
        distance[stride.last + 1 :] += stride.length
        rows.append((stride.first, stride.last, stride.length, stride.rise))
    if not rows:
        raise ValueError(f"the foot stands {len(standing)} times and never strides between")
    start, end, length, rise = (np.array(column) for column in zip(*rows, strict=True))
    return FootPath(start, end, length, rise, distance, _covered(standing, len(gyr)))


def walking_strides(feet: dict[str, FootPath], rate_hz: float) -> dict[str, FootPath]:
    """The strides of walking (side → strides), without bouts shorter than 1 m between times in which both feet stand
    for 0.4 s: a turn, or a shift of a foot on the spot.
    """
    both = np.logical_and.reduce([path.standing for path in feet.values()])
    pauses = [run for run in true_runs(both) if run[1] - run[0] >= 0.4 * rate_hz]
    moving = true_runs(~_covered(pauses, len(both)))
    kept = {side: np.zeros(len(path.length), bool) for side, path in feet.items()}
    for start, end in moving:
        inside = {side: ((path.start + path.end) / 2 >= start) & ((path.start + path.end) / 2 < end)
                  for side, path in feet.items()}  # fmt: skip
        if np.mean([path.length[inside[side]].sum() for side, path in feet.items()]) >= 1.0:
            kept = {side: kept[side] | inside[side] for side in feet}
    return {side: _only(path, kept[side]) for side, path in feet.items()}


def _only(path: FootPath, keep: np.ndarray) -> FootPath:
    """The path without the strides where `keep` (n,) is False, and without their lengths in the distance."""
    step = np.diff(path.distance, prepend=0.0)
    step[_covered([(a, b + 1) for a, b in zip(path.start[~keep], path.end[~keep], strict=True)], len(step))] = 0.0
    kept = {name: getattr(path, name)[keep] for name in ("start", "end", "length", "rise")}
    return path._replace(distance=np.cumsum(step), **kept)


def _covered(runs: list[tuple[int, int]], samples: int) -> np.ndarray:
    flags = np.zeros(samples, bool)
    for start, end in runs:
        flags[start:end] = True
    return flags


class _Stride(NamedTuple):
    first: int
    last: int
    length: float
    rise: float
    tilt: float
    forward: np.ndarray


def _next_stride(
    gyr: np.ndarray, imu: Imu, rate_hz: float, standing: list[tuple[int, int]], current: int
) -> tuple[int, _Stride | None]:
    """The stance that ends the next stride, and this stride: the first of three stances with a tilt difference below
    0.12 rad, or the smallest; None if samples are missing, or it does not last 0.25 to 3 s.
    """
    tried: list[tuple[int, _Stride]] = []
    acc = as_float(imu.acc)
    before = standing[current]
    reach = int(0.4 * rate_hz)
    first = _quietest(gyr, max(before[0], before[1] - reach), before[1])
    for following in range(current + 1, min(current + 4, len(standing))):
        after = standing[following]
        last = _quietest(gyr, after[0], min(after[1], after[0] + reach))
        time = (last - first) / rate_hz
        if time > 3.0 or not imu.mask[first : last + 1].all():
            break
        if time < 0.25:
            continue
        part = slice(first, last + 1)
        position, tilt = strapdown(gyr[part], acc[part], 1 / rate_hz, _rest(acc, first), _rest(acc, last))
        length = float(np.hypot(*position[-1, :2]))
        forward = position[:, :2] @ (position[-1, :2] / max(length, 1e-12))
        tried.append((following, _Stride(first, last, length, float(position[-1, 2]), tilt, forward)))
        if tilt <= 0.12:
            return tried[-1]
    if not tried:
        return current + 1, None
    return min(tried, key=lambda candidate: candidate[1].tilt)


def _quietest(gyr: np.ndarray, start: int, end: int) -> int:
    """The sample with the smallest angular rate, averaged over five samples."""
    rate = np.linalg.norm(gyr, axis=1)
    padded = np.pad(rate, 2, mode="edge")
    smooth = np.convolve(padded, np.full(5, 0.2), mode="valid")
    return start + int(np.argmin(smooth[start:end]))


def _rest(acc: np.ndarray, sample: int) -> np.ndarray:
    """Specific force at rest, averaged over five samples."""
    return acc[max(0, sample - 2) : sample + 3].mean(axis=0)
