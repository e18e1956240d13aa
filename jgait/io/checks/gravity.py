"""Gyroscopes against gravity: whether those of one sensor, and of all sensors of a person, agree with it.

Turned by the gyroscope to the axes at the start of a window of two strides, the accelerometer's mean is gravity: what
the body accelerates has no mean over whole strides. If the gyroscope turns the wrong way, about the wrong axis, or by
the wrong amount, the mean has another size, or another direction than in the standing before or after the strides. In a
turn of the person, every segment turns by the same angle about the vertical. Neither needs a calibration.

Limits without another word were chosen outside of what undamaged recordings, public and simulated, reach; a number in
parentheses is what they reach.
"""

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from jgait.geometry.rotation import Quaternion, conjugate, product
from jgait.geometry.vectors import GRAVITY
from jgait.io.units import Unit
from jgait.notes import Note
from jgait.quality.notes import CONTRADICTS
from jgait.signal.windows import held_spread, true_runs, window_size, window_sum
from jgait.types import Imu, as_float

WINDOW_S = 2.24
"""[s] Length of a window, two strides of usual walking."""

LONGEST_S = 60.0
"""[s] Part of a recording that is compared, from its beginning: chosen for speed, some thirty strides decide."""

ACTIVE = 0.5
"""[1] Share of the fastest window's mean square rate above which a window is walking; chosen by hand."""

FASTEST_WINDOW = 1.0
"""[rad/s] Least rms rate of a leg in a window in which the direction of gravity turns enough to be compared."""


class Usual(NamedTuple):
    """What the sensor of a segment measures in walking."""

    #: [°] Largest tilt between standing and walking by the gyroscope against the accelerometer (foot 13.3, shank 5.8,
    #: thigh 4.3, trunk 6.3).
    tilt_deg: float
    #: [1] Size of the turned mean over gravity (foot 0.922 to 1.094, shank 0.961 to 1.075, thigh 0.930 to 1.060, trunk
    #: 0.956 to 1.035).
    gravity: tuple[float, float] | None = None
    #: [s] Delay of the accelerometer behind the gyroscope (foot −0.025 to 0.02, shank −0.039 to 0.02, thigh −0.04 to
    #: 0.03).
    acc_late_s: tuple[float, float] | None = None
    #: [rad], [m] Rms rate times the duration of a stride, and spread of the force times its square, means of all
    #: undamaged recordings; None of the trunk, which turns little.
    pace: tuple[float, float] | None = None


USUAL = {
    "foot": Usual(16.0, (0.89, 1.11), (-0.035, 0.032), (4.8, 10.7)),
    "ankle": Usual(8.0, (0.91, 1.10), (-0.05, 0.027), (4.0, 7.8)),
    "shank": Usual(8.0, (0.93, 1.09), (-0.05, 0.027), (3.3, 6.8)),
    "thigh": Usual(7.0, (0.91, 1.08), (-0.06, 0.05), (1.95, 5.3)),
    "pelvis": Usual(9.0, (0.90, 1.10)), "lower": Usual(9.0, (0.90, 1.10)), "waist": Usual(9.0),
}  # fmt: skip
"""First word of a placement → what is usual there; other placements are not compared."""

TRIALS = {
    "the gyroscope may be 2 times too small": (2.0, 2.0, 2.0),
    "the gyroscope may be 2 times too large": (0.5, 0.5, 0.5),
    "its x axis may be turned round": (-1.0, 1.0, 1.0),
    "its y axis may be turned round": (1.0, -1.0, 1.0),
    "its z axis may be turned round": (1.0, 1.0, -1.0),
    "its sign or the handedness of its axes may be wrong": (-1.0, -1.0, -1.0),
}
"""Likely causes, and what the gyroscope is multiplied by to undo them."""

LEAST_TURN = 1.0
"""[rad] Least turn of the person in a window by which sensors are compared."""


def slow_gyroscope(placement: str, imu: Imu, rate_hz: float, unit: Unit | None) -> Note | None:
    """The note about a gyroscope of a leg that hardly turns while its accelerometer is shaken as in walking."""
    usual, mask = USUAL.get(placement.partition("_")[0]), np.asarray(imu.mask)
    if usual is None or usual.pace is None or imu.acc is None:
        return None
    if len(imu.time) < 2.0 * WINDOW_S * rate_hz or not mask.any():
        return None
    # walking has a 99th percentile of 2.1 rad/s or more, and a spread of the force above 1 m/s²
    rate = float(np.percentile(np.linalg.norm(as_float(imu.gyr)[mask], axis=1), 99.0))
    if rate >= 0.3 or float(np.linalg.norm(as_float(imu.acc)[mask], axis=1).std()) <= 1.0:
        return None
    return CONTRADICTS.note(
        "{placement}: the gyroscope reaches only {rate:.3g} rad/s (99th percentile{stated}) while the accelerometer is "
        "shaken as in walking; its unit differs from that of the other sensors (rad/s in place of deg/s?), or it did "
        "not record",
        placement=placement, rate=rate, stated=f", {unit}" if unit is not None and unit.origin == "header" else "",
    )  # fmt: skip


def gravity_notes(placement: str, imu: Imu, lost: np.ndarray, rate_hz: float) -> list[Note]:
    """Notes about a sensor of legs or trunk whose gyroscope and accelerometer contradict each other; `lost` (T,) are
    samples in long gaps.
    """
    usual, length = USUAL.get(placement.partition("_")[0]), min(len(imu.time), int(LONGEST_S * rate_hz))
    if usual is None or imu.acc is None or length < WINDOW_S * rate_hz:
        return []
    count = max(int(rate_hz / 50.0), 1)  # means at 50 Hz or more are turned
    length, step, notes = length // count, count / rate_hz, list[Note]()
    gyr, acc = (as_float(part)[: length * count].reshape(length, count, 3).mean(axis=1) for part in (imu.gyr, imu.acc))
    gaps = lost[: length * count].reshape(length, count).any(axis=1)
    if usual.gravity is not None and length * count >= 2.0 * WINDOW_S * rate_hz:
        rows, weight = _windows(length, step)
        square = np.where(gaps[rows].any(axis=1), 0.0, np.sum(gyr[rows] ** 2, axis=2).mean(axis=1))
        least = 0.0 if usual.pace is None else FASTEST_WINDOW**2
        rows = rows[(square > ACTIVE * square.max(initial=0.0)) & (square > least)]
        ratio = float(_ratios(gyr[rows], acc[rows], step, weight, [(1.0, 1.0, 1.0)])[0]) if len(rows) else 1.0
        more = 0.12 / np.sqrt(max(len(rows), 1))  # of few windows the median is less certain
        if not usual.gravity[0] - more <= ratio <= usual.gravity[1] + more:
            undone = zip(TRIALS, _ratios(gyr[rows], acc[rows], step, weight, list(TRIALS.values())), strict=True)
            fits = [cause for cause, value in undone if abs(value - 1.0) < 0.06]
            causes = ", or ".join(fits[:3]) or "its axes, unit or scale, or the sampling rate, may be wrong"
            disagree = (
                "{placement}: gyroscope and accelerometer do not agree: turned by the gyroscope, the mean acceleration "
                "over two strides is {ratio:.2f} of gravity; {causes}"
            )
            notes.append(CONTRADICTS.note(disagree, placement=placement, ratio=ratio, causes=causes))
    if rate_hz >= 20.0:  # between slower samples legs turn too far
        # the trunk turns little: a window of 0.15 rad/s is walking there
        angle = _smallest_tilt(gyr, acc, gaps, step, 0.15 if usual.pace is None else FASTEST_WINDOW)
        if angle is not None and angle > usual.tilt_deg:
            tilts = (
                "{placement}: between standing and walking its gyroscope and its accelerometer tilt by up to "
                "{degrees:.0f}° more or less than each other; the sign, order or handedness of the axes of one of them "
                "is wrong"
            )
            notes.append(CONTRADICTS.note(tilts, placement=placement, degrees=angle))
    return notes


def _turned(rates: np.ndarray, forces: np.ndarray, step: float) -> np.ndarray:
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


def _windows(length: int, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows (windows, samples) of windows half a window apart, and the weights of their samples, a raised cosine, which
    leaves out what repeats every stride.
    """
    samples = round(WINDOW_S / step)
    weight = np.hanning(samples + 2)[1:-1]
    begins = np.arange(0, length - samples + 1, max(samples // 2, 1))
    return begins[:, None] + np.arange(samples), weight / weight.sum()


def _ratios(
    gyr: np.ndarray, acc: np.ndarray, step: float, weight: np.ndarray, trials: list[tuple[float, ...]]
) -> np.ndarray:
    """(trials,) size of the turned mean of windows (windows, samples, 3) over gravity, median of the windows, with the
    gyroscope multiplied by each trial.
    """
    mean = _turned(gyr * np.array(trials)[:, None, None, :], acc[None], step) @ weight
    return np.asarray(np.median(np.linalg.norm(mean, axis=0), axis=1) / GRAVITY)


def _smallest_tilt(gyr: np.ndarray, acc: np.ndarray, lost: np.ndarray, step: float, moving: float) -> float | None:
    """Smallest angle between the mean forces of a standing, of which the longest has the bias, and of the walking
    beside it, of a rms rate of `moving` [rad/s] or more [deg]; None without both.
    """
    size = window_size(0.5, 1.0 / step)
    still = (held_spread(gyr, size) < 0.05) & (held_spread(acc, size) < 1.0) & ~lost
    standings = sorted(true_runs(still), key=lambda run: run[0] - run[1])[:8]
    if not standings or (standings[0][1] - standings[0][0]) * step < 1.0:  # of 1.5 s and more the mean rate is the bias
        return None
    bias, half, beside = gyr[slice(*standings[0])].mean(axis=0), size // 2, round(5.0 / step)
    angles = []
    for start, end in standings:
        for way, middle in ((1, end - 1), (-1, start)):
            down = acc[max(middle - half, 0) : middle + half + 1].mean(axis=0)
            first = middle + way * (half + 1)
            rows = np.arange(first, np.clip(first + way * beside, -1, len(gyr)), way)
            rows = rows[: int(np.argmax(lost[rows]))] if lost[rows].any() else rows
            windows, weight = _windows(len(rows), step)
            if not len(windows):
                continue
            square = np.sum(gyr[rows[windows]] ** 2, axis=2).mean(axis=1)
            walks = windows[square > max(ACTIVE * square.max(), moving**2)][:2]
            if len(walks):
                back = _turned(way * (gyr[rows] - bias), acc[rows], step).T
                mean = np.einsum("w,kwi->ki", weight, back[walks])
                cosine = mean @ down / (np.linalg.norm(mean, axis=1) * np.linalg.norm(down))
                angles.append(float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))).mean()))
    return min(angles, default=None)


def lies(imu: Imu, rate_hz: float) -> np.ndarray:
    """(T,) bool, windows in which a sensor with an accelerometer does not move, by less than 0.05 rad/s and 0.3 m/s²:
    nobody wears it, or a person stands.
    """
    size = window_size(WINDOW_S, rate_hz)
    still = (held_spread(as_float(imu.gyr), size) < 0.05) & (held_spread(as_float(imu.acc), size) < 0.3)
    return window_sum(still.astype(float), size) > 0.5


def turn_notes(
    sensors: Mapping[str, Imu], lost: Mapping[str, np.ndarray], rate_hz: float, accused: Collection[str]
) -> list[tuple[tuple[str, ...], Note]]:
    """Notes about sensors that do not turn as the person does, which is the median of all, each with the sensors that
    it names. The mean rate about the mean force over two strides is the person's, whatever the mounting. Of two sensors
    the one that is `accused`, for it contradicts itself, is named.
    """
    samples = round(WINDOW_S * rate_hz)
    every, turns, rests = max(samples // 8, 1), {}, []
    for placement, imu in sensors.items():
        if placement.partition("_")[0] not in USUAL or imu.acc is None or len(imu.time) < 2 * samples:
            continue
        still = np.stack([lies(imu, rate_hz), lost[placement]], axis=1).astype(float)
        parts = (as_float(imu.gyr), as_float(imu.acc), still)
        sums = [np.cumsum(np.pad(part, [(1, 0), (0, 0)]), axis=0) for part in parts]
        gyr, acc, share = ((sum_[samples:] - sum_[:-samples])[::every] / samples for sum_ in sums)
        up = acc / np.maximum(np.linalg.norm(acc, axis=1, keepdims=True), 1e-9)
        turns[placement] = np.where(share[:, 1] > 0.5 / samples, np.nan, np.sum(gyr * up, axis=1) * WINDOW_S)
        rests.append(share[:, 0])
    if len(turns) < 2 or len({len(turn) for turn in turns.values()}) > 1:
        return []
    # a sensor that rests for an eighth of a window more or less than the others moved without them
    alone = np.abs(np.array(rests) - np.median(rests, axis=0)) > 0.125
    angles = {placement: np.where(rests, np.nan, turn) for (placement, turn), rests in
              zip(turns.items(), alone, strict=True)}  # fmt: skip
    if len(angles) == 2:
        return _of_two(angles, accused)
    table = np.array(list(angles.values()))
    known = np.isfinite(table).sum(axis=0) > 2
    person = np.full(table.shape[1], np.nan)
    person[known] = np.nanmedian(table[:, known], axis=0)
    notes: list[tuple[tuple[str, ...], Note]] = []
    for placement, angle in angles.items():
        turn, ratio, whole = _compared(angle, person)
        # a foot turns in steps (0.58 to 1.2), other segments with the person (0.82 to 1.33)
        low, high = (0.45, 1.6) if placement.startswith("foot") or not whole else (0.7, 1.45)
        if turn >= LEAST_TURN and not low <= ratio <= high:
            notes.append(((placement,), _apart(placement, turn, ratio, "the person's other sensors")))
    return notes


def _apart(placement: str, turn: float, ratio: float, others: str) -> Note:
    """The note about a sensor that turns otherwise than others do."""
    return CONTRADICTS.note(
        "{placement}: in a turn by {degrees:.0f}° it turns {ratio:.2f} times as far as {others}; its gyroscope has a "
        "wrong sign, order of axes, unit or scale",
        placement=placement, degrees=np.rad2deg(turn), ratio=ratio, others=others,
    )  # fmt: skip


def _of_two(angles: Mapping[str, np.ndarray], accused: Collection[str]) -> list[tuple[tuple[str, ...], Note]]:
    """The note if two sensors turn apart: about the one that contradicts itself, or about both."""
    first, second = sorted(angles, key=lambda placement: placement not in accused)
    turn, ratio, _ = _compared(angles[first], angles[second])
    back = _compared(angles[second], angles[first])
    if not any(size >= LEAST_TURN and not 0.33 <= each <= 3.0 for size, each in ((turn, ratio), back[:2])):
        return []
    if (first in accused) != (second in accused):
        return [((first,), _apart(first, turn, ratio, second))]
    text = (
        "{placement} and {other}: in a turn by {degrees:.0f}° one turns {ratio:.2f} times as far as the other; a sign, "
        "the order of axes, the unit or the scale is wrong in one of the two"
    )
    note = CONTRADICTS.note(text, placement=first, other=second, degrees=np.rad2deg(turn), ratio=ratio)
    return [((first, second), note)]


def _compared(sensor: np.ndarray, person: np.ndarray) -> tuple[float, float, bool]:
    """Largest turn of the person [rad], a sensor's turn over it, and whether it lies within the recording."""
    both = np.flatnonzero(np.isfinite(sensor) & np.isfinite(person))
    size = np.abs(person[both])
    if not size.size or not size.max() > 0.0:
        return 0.0, 1.0, True
    large = both[size > 0.5 * size.max()]
    ratio = float(sensor[large] @ person[large] / (person[large] @ person[large]))
    return float(size.max()), ratio, 2 <= int(both[np.argmax(size)]) < len(person) - 2  # windows at an end cut a turn
