"""Sides and places: whether the sensors of a person move together, as those of one body.

Both legs turn alike, half a stride apart. In a turn, every segment turns by the same angle about the vertical.
"""

from collections.abc import Collection, Mapping

import numpy as np

from jgait.io.checks import limits as at
from jgait.notes import Note
from jgait.quality import SensorQuality
from jgait.quality.notes import CONTRADICTS
from jgait.signal.windows import held_spread, window_size, window_sum
from jgait.types import Imu, as_float


def lies(imu: Imu, rate_hz: float) -> np.ndarray:
    """(T,) bool, windows in which a sensor with an accelerometer does not move: nobody wears it, or a person stands."""
    size = window_size(at.WINDOW_S, rate_hz)
    spread = [held_spread(as_float(part), size) < most for part, most in zip((imu.gyr, imu.acc), at.LIES, strict=True)]
    return window_sum((spread[0] & spread[1]).astype(float), size) > 0.5


def sides_differ(right: str, left: str, sensors: Mapping[str, Imu], rate_hz: float) -> dict[str, SensorQuality]:
    """The sensor of the same segment of both legs that turns faster, in the time in which both move."""
    counts = np.all([np.asarray(sensors[name].mask, bool) for name in (right, left)], axis=0)
    if all(sensors[name].acc is not None for name in (right, left)):
        both = counts & ~lies(sensors[right], rate_hz) & ~lies(sensors[left], rate_hz)
        counts = both if both.sum() > 2.0 * at.WINDOW_S * rate_hz else counts
    if counts.sum() < 2.0 * at.WINDOW_S * rate_hz:
        return {}
    rates = {name: float(np.sqrt(np.mean(np.sum(as_float(sensors[name].gyr)[counts] ** 2, axis=1))))
             for name in (right, left)}  # fmt: skip
    slower, faster = sorted(rates, key=lambda name: rates[name])
    if not rates[slower] > 0.0 or rates[faster] < at.LEAST_MOVING or rates[faster] < at.SIDES_APART * rates[slower]:
        return {}
    return {faster: SensorQuality(faster=rates[faster] / rates[slower])}


def out_of_step(
    right: str, left: str, sensors: Mapping[str, Imu], stride: int, longest: int
) -> dict[str, SensorQuality]:
    """The left foot if the feet are not half a stride [samples] apart; pauses do not count."""
    sizes = [np.linalg.norm(as_float(sensors[name].gyr)[:longest], axis=1) for name in (right, left)]
    moves = [size - np.convolve(size, np.ones(stride) / stride, "same") for size in sizes]
    a, b = (np.fft.rfft(move, 1 << int(2 * len(move)).bit_length()) for move in moves)
    alike = np.fft.irfft(np.conj(a) * b)
    lags = np.arange(stride)
    share = float(np.argmax(alike[lags] + alike[lags - stride])) / stride
    apart = abs(share - 0.5) > at.OUT_OF_STEP
    return {left: SensorQuality(step_share=share)} if apart else {}


def turn_notes(
    sensors: Mapping[str, Imu], lost: Mapping[str, np.ndarray], rate_hz: float, accused: Collection[str]
) -> list[tuple[tuple[str, ...], Note]]:
    """Notes about sensors that do not turn as the person does, which is the median of all, each with the sensors that
    it names. The mean rate about the mean force over two strides is the person's, whatever the mounting. Of two sensors
    the one that is `accused`, for it contradicts itself, is named.
    """
    samples = round(at.WINDOW_S * rate_hz)
    every, turns, rests = max(samples // 8, 1), {}, []
    for placement, imu in sensors.items():
        if placement.partition("_")[0] not in at.TILTED_DEG or imu.acc is None or len(imu.time) < 2 * samples:
            continue
        still = np.stack([lies(imu, rate_hz), lost[placement]], axis=1).astype(float)
        sums = [
            np.cumsum(np.pad(part, [(1, 0), (0, 0)]), axis=0) for part in (as_float(imu.gyr), as_float(imu.acc), still)
        ]
        gyr, acc, share = ((sum_[samples:] - sum_[:-samples])[::every] / samples for sum_ in sums)
        up = acc / np.maximum(np.linalg.norm(acc, axis=1, keepdims=True), 1e-9)
        turns[placement] = np.where(share[:, 1] > 0.5 / samples, np.nan, np.sum(gyr * up, axis=1) * at.WINDOW_S)
        rests.append(share[:, 0])
    if len(turns) < 2 or len({len(turn) for turn in turns.values()}) > 1:
        return []
    alone = np.abs(np.array(rests) - np.median(rests, axis=0)) > at.RESTS_ALONE
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
        low, high = at.TURN_FOOT if placement.startswith("foot") or not whole else at.TURN
        if turn >= at.LEAST_TURN and not low <= ratio <= high:
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
    low, high = at.TURN_OF_TWO
    if not any(size >= at.LEAST_TURN and not low <= each <= high for size, each, _ in ((turn, ratio, True), back)):
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
    return float(size.max()), ratio, at.CUT_OFF <= int(both[np.argmax(size)]) < len(person) - at.CUT_OFF
