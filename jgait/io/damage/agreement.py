"""Whether gyroscope and accelerometer of a sensor, and the sensors of a person, agree: scale, sign, axes, delay.

Turned by the gyroscope to the axes at the start of a window of two strides, the accelerometer's mean is gravity: what
the body accelerates has no mean over whole strides. If the gyroscope turns the wrong way, about the wrong axis, or by
the wrong amount, the size of that mean is not that of gravity. It needs no calibration and no standing.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.geometry.rotation import Quaternion, conjugate, product
from jgait.geometry.vectors import GRAVITY
from jgait.io.units import Unit
from jgait.notes import Kind, Note
from jgait.signal.windows import held_spread, over_losses, true_runs, window_size, window_sum
from jgait.types import SIDES, Imu, as_float

RATE_HZ = 25.0
"""[Hz] Least rate of the samples that are averaged before they are turned."""

WINDOW_S = 2.24
"""[s] Length of a window: two strides of usual walking."""

LONG_GAP_S = 0.1
"""[s] Shortest gap whose samples do not count."""

LONGEST_S = 60.0
"""[s] Part of a recording that is examined."""

ACTIVE = 0.5
"""[1] Share of the fastest window's mean square rate above which a window counts as walking."""

FASTEST_WINDOW = 1.0
"""[rad/s] Least root mean square rate of a window in which the direction of gravity turns enough."""

TRUNK = ("pelvis", "lower")
"""First words of the placements of the trunk, which turns little: its windows need no fastest rate."""

AGREEING = {
    "foot": (0.89, 1.11), "ankle": (0.91, 1.10), "shank": (0.93, 1.09), "thigh": (0.91, 1.08),
    **dict.fromkeys(TRUNK, (0.90, 1.10)),
}  # fmt: skip
"""[1] Size of the turned mean over gravity, by segment, outside of which gyroscope and accelerometer disagree. In
undamaged recordings, public and simulated, it is 0.922 to 1.094 at the foot, 0.961 to 1.075 at the shank and 0.930 to
1.060 at the thigh and 0.956 to 1.035 at the trunk."""

FEW_WINDOWS = 0.12
"""[1] What `AGREEING` is widened by for one window of walking; for n windows, by this over √n. Turns, starts and stops
weigh more in short walks."""

SLOWEST = 0.3
"""[rad/s] Least 99th percentile of the rate of a leg's sensor that is accelerated as in walking; undamaged ones reach
2.1."""

SHAKEN = 1.0
"""[m/s²] Standard deviation of the size of the specific force from which on a leg walks."""

LEAST_MOVING = 0.2
"""[rad/s] Least root mean square rate of a sensor that moves: those of standing people differ by their noise."""

LIES = 0.05, 0.3
"""[rad/s], [m/s²] Standard deviation of the rate and of the specific force over `WINDOW_S` below which a sensor lies
still: it is not compared with one that moves then, for it is not worn yet, or that one is in a hand. A gyroscope that
does not record shows by the force."""

SIDES_APART = 1.6
"""[1] Largest ratio of the root mean square rates of the same segment of both legs. Undamaged recordings reach 1.36."""

GYROSCOPE_DISAGREES = Kind(
    "gyroscope_disagrees",
    "check",
    "{placement}: gyroscope and accelerometer do not agree: turned by the gyroscope, the mean acceleration over two "
    "strides is {ratio:.2f} of gravity; {causes}",
    "Sign, order or handedness of the axes, the unit or the scale of the gyroscope, or the sampling rate is wrong for "
    "this sensor. What is computed from it is wrong as well.",
)
GYROSCOPE_SLOW = Kind(
    "gyroscope_slow",
    "check",
    "{placement}: the gyroscope reaches only {rate:.3g} rad/s (99th percentile{stated}) while the accelerometer is "
    "shaken as in walking; its unit differs from that of the other sensors (rad/s in place of deg/s?), or it did not "
    "record",
    "With a rate that is many times too small, angles and lengths of this sensor are worthless.",
)
SIDES_DIFFER = Kind(
    "sides_differ",
    "check",
    "{placement} turns {ratio:.2f} times as fast as {other}: unless one leg is spared, the scale or unit of one of the "
    "two gyroscopes is wrong, or one of the two sensors sat on another segment",
    "Both legs of a person turn alike, also in most illnesses that affect one side.",
)

TRIALS = {
    "the gyroscope may be 2 times too small": (2.0, 2.0, 2.0),
    "the gyroscope may be 2 times too large": (0.5, 0.5, 0.5),
    "its x axis may be turned round": (-1.0, 1.0, 1.0),
    "its y axis may be turned round": (1.0, -1.0, 1.0),
    "its z axis may be turned round": (1.0, 1.0, -1.0),
    "its sign or the handedness of its axes may be wrong": (-1.0, -1.0, -1.0),
}
"""Likely causes, and what the gyroscope is multiplied by to undo them."""

UNCLEAR = "its axes, unit or scale, or the sampling rate, may be wrong"
NEAR = 0.06
"""[1] Largest difference of the turned mean from gravity with a likely cause undone."""


def bridged(imu: Imu, rate_hz: float) -> Imu:
    """The sensor with its gyroscope interpolated over short gaps; it is 0 in long ones."""
    mask = np.asarray(imu.mask)
    if mask.all() or not mask.any():
        return imu
    gyr = over_losses(np.arange(len(mask)), imu.gyr, mask)
    return imu._replace(gyr=np.where(in_long_gaps(imu, rate_hz)[:, None], 0.0, gyr))


def in_long_gaps(imu: Imu, rate_hz: float) -> np.ndarray:
    """(T,) bool, samples in gaps longer than `LONG_GAP_S`."""
    mask = np.asarray(imu.mask)
    lost = np.zeros(len(mask), bool)
    for start, end in true_runs(~mask):
        lost[start:end] = end - start > LONG_GAP_S * rate_hz
    return lost


def lies(imu: Imu, rate_hz: float) -> np.ndarray:
    """(T,) bool, samples in windows in which a sensor with an accelerometer does not move, see `LIES`."""
    size = window_size(WINDOW_S, rate_hz)
    spread = [held_spread(as_float(part), size) < most for part, most in zip((imu.gyr, imu.acc), LIES, strict=True)]
    return window_sum((spread[0] & spread[1]).astype(float), size) > 0.5


class Averaged(NamedTuple):
    """Means of a sensor's samples, windows of which are turned."""

    gyr: np.ndarray  #: (n, 3) [rad/s].
    acc: np.ndarray  #: (n, 3) [m/s²].
    lost: np.ndarray  #: (n,) bool, means of samples in a long gap.
    step: float  #: time between them [s].


def averaged(
    imu: Imu, rate_hz: float, least_hz: float = RATE_HZ, shortest_s: float = 2.0 * WINDOW_S
) -> Averaged | None:
    """Means of a few samples each, at a least rate; None without an accelerometer, or in a shorter recording."""
    if imu.acc is None:
        return None
    count = max(int(rate_hz / least_hz), 1)
    length = min(len(imu.time), int(LONGEST_S * rate_hz)) // count
    if length < shortest_s * rate_hz / count:
        return None
    cut = slice(0, length * count)
    gyr, acc = (np.asarray(part)[cut].reshape(length, count, 3).mean(axis=1) for part in (imu.gyr, imu.acc))
    lost = in_long_gaps(imu, rate_hz)[cut].reshape(length, count).any(axis=1)
    return Averaged(gyr, acc, lost, count / rate_hz)


def moving_means(values: np.ndarray, samples: int) -> np.ndarray:
    """Means (T − samples + 1, n) of values (T, n) over windows of some samples."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray((sums[samples:] - sums[:-samples]) / samples)


def turned(rates: np.ndarray, forces: np.ndarray, step: float) -> np.ndarray:
    """Forces (…, n, 3), each turned by the rates before it to the axes at the beginning; (3, …, n)."""
    half = 0.5 * step * rates
    angle = np.sqrt(np.sum(half * half, axis=-1))
    q = np.concatenate([np.cos(angle)[None], np.moveaxis(half, -1, 0) * np.sinc(angle / np.pi)])
    q[..., 1:] = q[..., :-1].copy()
    q[..., 0] = np.array([1.0, 0.0, 0.0, 0.0]).reshape(4, *[1] * (angle.ndim - 1))
    width = 1
    while width < q.shape[-1]:  # products of neighbours, of pairs, of fours …
        q[..., width:] = product(Quaternion(*q[..., :-width]), Quaternion(*q[..., width:]))
        width *= 2
    whole, zero = Quaternion(*q), np.zeros(angle.shape)
    still = Quaternion(zero, *np.broadcast_to(np.moveaxis(forces, -1, 0), (3, *angle.shape)))
    return np.stack(product(product(whole, still), conjugate(whole))[1:])


def windows(sensor: Averaged) -> np.ndarray:
    """(windows, samples) rows of windows of `WINDOW_S`, half a window apart."""
    samples = round(WINDOW_S / sensor.step)
    return np.arange(0, len(sensor.gyr) - samples + 1, samples // 2)[:, None] + np.arange(samples)


def turned_mean(sensor: Averaged, factors: np.ndarray) -> np.ndarray:
    """(trials, windows) size of the mean acceleration, turned by the gyroscope times factors (trials, 3) [m/s²].

    A raised cosine over a window leaves out what repeats every stride.
    """
    rows = windows(sensor)
    weight = np.hanning(rows.shape[1] + 2)[1:-1]
    # (axis, trials, windows, samples)
    mean = turned(sensor.gyr[rows] * factors[:, None, None, :], sensor.acc[rows][None], sensor.step) @ (
        weight / weight.sum()
    )
    return np.asarray(np.sqrt(np.sum(mean * mean, axis=0)))


def walking_windows(sensor: Averaged, fastest: float = FASTEST_WINDOW) -> np.ndarray:
    """(windows,) bool, those without a long gap in which the sensor turns fast enough, beyond a rate [rad/s]."""
    rows = windows(sensor)
    square = np.where(sensor.lost[rows].any(axis=1), 0.0, np.sum(sensor.gyr[rows] ** 2, axis=2).mean(axis=1))
    return (square > ACTIVE * square.max()) & (square > fastest**2)


def _gravity_note(placement: str, sensor: Averaged) -> Note | None:
    segment = placement.partition("_")[0]
    walks = walking_windows(sensor, 0.0 if segment in TRUNK else FASTEST_WINDOW)
    if segment not in AGREEING or not walks.any():
        return None
    more = FEW_WINDOWS / float(np.sqrt(walks.sum()))
    low, high = AGREEING[segment][0] - more, AGREEING[segment][1] + more
    ratio = float(np.median(turned_mean(sensor, np.ones((1, 3)))[0, walks])) / GRAVITY
    if low <= ratio <= high:
        return None
    trials = np.median(turned_mean(sensor, np.array(list(TRIALS.values())))[:, walks], axis=1) / GRAVITY
    fits = [cause for cause, value in zip(TRIALS, trials, strict=True) if abs(value - 1.0) < NEAR]
    return GYROSCOPE_DISAGREES(placement=placement, ratio=ratio, causes=", or ".join(fits[:3]) or UNCLEAR)


def agreement_notes(sensors: Mapping[str, Imu], rate_hz: float, units: Mapping[str, Unit]) -> tuple[Note, ...]:
    """Notes about sensors of the legs whose gyroscope disagrees with the accelerometer, or with the other sensors.

    Args:
        sensors: placement → sensor.
        rate_hz: rate of the samples [Hz].
        units: placement → unit in which its gyroscope was read; notes name the header that states it.
    """
    notes: list[Note] = []
    rates: dict[str, float] = {}
    for placement, imu in sensors.items():
        segment = placement.partition("_")[0]
        if segment not in AGREEING:
            continue
        gyr = np.asarray(imu.gyr)[np.asarray(imu.mask)]
        size = np.sqrt(np.sum(gyr * gyr, axis=1))
        if len(imu.time) < 2.0 * WINDOW_S * rate_hz:
            continue
        sensor = averaged(imu, rate_hz)
        fast = float(np.percentile(size, 99.0))
        if sensor is not None and segment not in TRUNK and fast < SLOWEST:
            shaken = float(np.sqrt(np.sum(np.asarray(imu.acc)[np.asarray(imu.mask)] ** 2, axis=1)).std())
            if shaken > SHAKEN:
                unit = units.get(placement)
                stated = f", {unit}" if unit is not None and unit.origin == "header" else ""
                notes.append(GYROSCOPE_SLOW(placement=placement, rate=fast, stated=stated))
                continue
        rates[placement] = float(np.sqrt(np.mean(size * size)))
        note = None if sensor is None else _gravity_note(placement, sensor)
        if note is not None:
            notes.append(note)
    for segment in AGREEING:
        right, left = (f"{segment}_{side}" for side in SIDES)
        if right in rates and left in rates and min(rates[right], rates[left]) > 0.0:
            rates |= _while_both_move(sensors, right, left, rate_hz)
            faster, slower = (right, left) if rates[right] > rates[left] else (left, right)
            ratio = rates[faster] / rates[slower]
            if ratio > SIDES_APART and rates[faster] > LEAST_MOVING:
                notes.append(SIDES_DIFFER(placement=faster, ratio=ratio, other=slower))
    return tuple(notes)


def _while_both_move(sensors: Mapping[str, Imu], right: str, left: str, rate_hz: float) -> dict[str, float]:
    """Root mean square rates of two sensors in the time in which both are worn; none if this is too short."""
    pair = {name: sensors[name] for name in (right, left)}
    lengths = {len(imu.time) for imu in pair.values()}
    if len(lengths) > 1 or any(imu.acc is None for imu in pair.values()):
        return {}
    counts = np.all([np.asarray(imu.mask, bool) & ~lies(imu, rate_hz) for imu in pair.values()], axis=0)
    if counts.sum() < 2.0 * WINDOW_S * rate_hz:
        return {}
    return {name: float(np.sqrt(np.mean(np.sum(as_float(imu.gyr)[counts] ** 2, axis=1)))) for name, imu in pair.items()}
