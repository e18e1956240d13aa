"""Order of samples: rows that are missing or written twice although time goes on, and signals on different clocks.

Where a row is missing, all sensors turn by what they turn in two steps; where it is written twice, none changes while
it turns. Landings shake a leg and turn it at the same time: a delay between two signals that are most alike with it is
one of their clocks.
"""

from collections.abc import Mapping

import numpy as np

from jgait.io.checks import limits as at
from jgait.notes import Kind, Note
from jgait.quality import SOUND, SensorQuality
from jgait.quality.notes import delayed
from jgait.signal.windows import true_runs
from jgait.types import Imu, as_float

ROWS_WRONG = Kind(
    "rows_wrong",
    "check",
    "",
    "Without time stamps, movements come out too fast and too small where rows are missing, too slow and too large "
    "where they are written twice; lengths and angles after the place are wrong.",
)
"""Rows of a file that are missing, or written twice, although time goes on."""


def rows_wrong(sensors: Mapping[str, Imu], rate_hz: float) -> tuple[SensorQuality, list[Note]]:
    """For every sensor the number of rows written twice, or of places where rows are missing; and the note about it."""
    masks = [np.asarray(imu.mask, bool) for imu in sensors.values()]
    steps = len(masks[0]) - 1
    if len({len(mask) for mask in masks}) != 1 or steps < 10 * at.BESIDE_JUMP:
        return SOUND, []
    if min(mask.mean() for mask in masks) <= 1.0 - at.MOST_LOST:
        return SOUND, []
    near = np.zeros(steps + 1, bool)
    for start, end in (run for mask in masks for run in true_runs(~mask)):
        if end - start >= at.UNBRIDGED:
            near[max(start - at.BESIDE_JUMP - 1, 0) : end + at.BESIDE_JUMP + 1] = True
    whole = ~(near[1:] | near[:-1])
    changes = [np.diff(as_float(imu.gyr), axis=0) for imu in sensors.values()]
    early = slice(int(at.COUNTED_S * rate_hz))
    twice = _written_twice([change[early] for change in changes], whole[early])
    if rows := int(twice.sum()):
        begin_s = (np.argmax(twice) + 1) / rate_hz
        text = f"rows that repeat the one before in all sensors while they turn: {rows}, first at {begin_s:.2f} s"
        return SensorQuality(rows_twice=rows), [ROWS_WRONG.note(f"{text}; they are written twice though time goes on")]
    lost = _double_steps([change[early] for change in changes], whole[early], rate_hz)
    if not lost.any() and len(changes) >= at.SENSORS_OF_JUMP:
        sizes = np.linalg.norm(changes, axis=2) + at.LEAST_CHANGE
        beside = [by for by in range(-at.BESIDE_JUMP, at.BESIDE_JUMP + 1) if by]
        around = np.max([[_shifted(size, by) for size in sizes] for by in beside], axis=0)
        lost = (np.log(sizes / around).mean(axis=0) > at.SURE_JUMP) & whole
    if places := int(lost.sum()):
        begin_s = (np.argmax(lost) + 1) / rate_hz
        text = f"places at which all sensors jump: {places}, first at {begin_s:.2f} s; rows are missing there although"
        return SensorQuality(rows_lost=places), [
            ROWS_WRONG.note(f"{text} time goes on, or the recording was joined from parts")
        ]
    return SOUND, []


def _shifted(values: np.ndarray, by: int) -> np.ndarray:
    """Values moved by some samples; the ends are repeated."""
    return values[np.clip(np.arange(len(values)) - by, 0, len(values) - 1)]


def _written_twice(changes: list[np.ndarray], whole: np.ndarray) -> np.ndarray:
    """(n,) bool, steps over which a row is repeated; none unless they are frequent and the next step is not longer."""
    same = whole & np.all([~change.any(axis=1) for change in changes], axis=0)
    same &= ~(_shifted(same, 1) | _shifted(same, -1))  # a longer stretch is a sensor at its limit, or one that stopped
    rows = np.flatnonzero(same)
    turns, measured, usual = np.zeros(len(same), bool), 0.0, 0.0
    for change in changes if rows.size else ():
        expected = 0.5 * (_shifted(change, 1) + _shifted(change, -2))[rows]
        size = np.linalg.norm(expected, axis=1)
        steps = np.abs(change)
        counts = size > max(at.RESOLVED * np.min(steps, where=steps > 0.0, initial=np.inf), at.LEAST_CHANGE)
        turns[rows[counts]] = True
        along = np.sum(_shifted(change, -1)[rows] * expected, axis=1)
        usual, measured = usual + float(size[counts].sum()), measured + float((along[counts] / size[counts]).sum())
    few = turns.sum() < max(at.FEWEST_ROWS, at.TWICE_SHARE * whole.sum())
    return np.zeros(len(same), bool) if few or measured > at.ONE_STEP * usual else turns


def _double_steps(changes: list[np.ndarray], whole: np.ndarray, rate_hz: float) -> np.ndarray:
    """(n,) bool, steps that are double of what a cubic through their neighbours gives; none unless frequent and in each
    sensor.
    """
    many, none = len(changes) >= 3, np.zeros(len(whole), bool)
    if rate_hz < 0.5 * at.FAST_HZ[many]:
        return none
    ratios = np.full((len(changes), len(whole)), np.nan)
    for sensor_ratios, change in zip(ratios, changes, strict=True):
        around = 4.0 * (_shifted(change, 1) + _shifted(change, -1)) - _shifted(change, 2) - _shifted(change, -2)
        expected = around / 6.0
        along, size = np.sum(change * expected, axis=1), np.sum(expected * expected, axis=1)
        straight = along > at.STRAIGHT[many] * np.sqrt(size * np.sum(change * change, axis=1))
        counts = straight & (size > np.quantile(size, at.SLOWEST_STEPS)) & (size > at.LEAST_CHANGE**2)
        sensor_ratios[counts] = np.log(along[counts] / size[counts])
    known = np.isfinite(ratios)
    counts = whole & (2 * known.sum(axis=0) >= len(changes))
    middle = np.zeros(len(whole))
    middle[counts] = np.nanmedian(ratios[:, counts], axis=0) if counts.any() else 0.0
    double, longer = ((middle > low) & (middle < high) for low, high in (at.TWO_STEPS, at.LONGER_STEP))
    least = max(
        at.FEWEST_ROWS, at.LOST_SHARE * counts.sum(), at.LEAST_RATIO[rate_hz >= at.FAST_HZ[many]] * longer.sum()
    )
    each = np.sum((ratios > at.TWO_STEPS[0]) & (ratios < at.TWO_STEPS[1]), axis=1) / np.maximum(known.sum(axis=1), 1)
    return np.asarray(double) if double.sum() >= least and each.min() >= at.EACH_SENSOR * each.max() else none


def shaking(force: np.ndarray, samples: int) -> np.ndarray:
    """(T,) size of a specific force (T, 3) without its moving mean over some samples."""
    padded = np.pad(force, [(samples // 2, samples - samples // 2 - 1), (0, 0)], mode="edge")
    mean = np.stack([np.convolve(column, np.ones(samples) / samples, "valid") for column in padded.T], axis=1)
    return np.asarray(np.linalg.norm(force - mean, axis=1))


def delay_between(
    first: np.ndarray, second: np.ndarray, rate_hz: float, usual: tuple[float, float], gain: float
) -> tuple[float, float]:
    """Delay [s] of the second signal behind the first, both (n,), where they are most alike; and their correlation. One
    outside of the usual delays [s] counts only if its correlation is larger by `gain`.
    """
    farthest = int(at.FARTHEST_S * rate_hz)
    a, b = first - first.mean(), second - second.mean()
    size = np.sqrt((a @ a) * (b @ b))
    if not size > 0.0:
        return 0.0, 0.0
    samples = 1 << int(len(a) + farthest).bit_length()
    both = np.fft.irfft(np.conj(np.fft.rfft(a, samples)) * np.fft.rfft(b, samples), samples)
    alike = np.concatenate([both[-farthest:], both[: farthest + 1]]) / size
    best = int(np.argmax(alike))
    low, high = (farthest + round(delay * rate_hz) for delay in usual)
    within = max(low, 0) + int(np.argmax(alike[max(low, 0) : high + 1]))
    best = best if alike[best] > alike[within] + gain else within
    return (best - farthest) / rate_hz, float(alike[best])


def accelerometer_late(placement: str, imu: Imu, rate_hz: float) -> tuple[SensorQuality, list[Note]]:
    """The delay of the accelerometer of a sensor of a leg behind its gyroscope, and the note about it."""
    segment, longest = placement.partition("_")[0], int(at.LONGEST_S * rate_hz)
    if segment not in at.IN_SENSOR_S or imu.acc is None or len(imu.time) <= at.SHORTEST_S * rate_hz:
        return SOUND, []
    step = max(round(at.CHANGE_S * rate_hz), 1)
    gyr, acc = (np.linalg.norm(part[step:] - part[:-step], axis=1)
                for part in (as_float(imu.gyr)[:longest], as_float(imu.acc)[:longest]))  # fmt: skip
    low, high = at.IN_SENSOR_S[segment]
    low, high = min(low, -1.0 / rate_hz), max(high, 1.0 / rate_hz)  # a delay is known to a sample
    gain = at.CLEARER if segment == "foot" or step < 2 else 0.0
    delay, alike = delay_between(gyr, acc, rate_hz, (low, high), gain)
    usual = low - 0.5 / rate_hz <= delay <= high + 0.5 / rate_hz
    if usual or alike <= at.LEAST_ALIKE:
        return SOUND, []
    return SensorQuality(acc_late=delay), [delayed(placement, "the accelerometer", delay, "the gyroscope")]


def late_behind(upper: str, lower: str, sensors: Mapping[str, Imu], rate_hz: float) -> float:
    """The delay [s] of the lower one of two sensors of a leg, in all or in the last third of the walk; 0 if it is
    usual.
    """
    longest, samples = int(at.LONGEST_S * rate_hz), max(round(at.CALM_S * rate_hz), 3)
    first, second = (shaking(as_float(sensors[name].acc)[:longest], samples) for name in (upper, lower))
    pair = upper.partition("_")[0], lower.partition("_")[0]
    coarse = max(round(at.CHANGE_S * rate_hz), 1) < 2
    farthest = (int(at.BETWEEN_S[pair] * rate_hz) + 1) / rate_hz if coarse else at.BETWEEN_S[pair]
    gain = at.CLEARER_FOOT if pair[1] == "foot" else at.CLEARER
    shaken = np.convolve(first, np.ones(round(rate_hz)) / round(rate_hz), "same")
    walks = np.flatnonzero(shaken > at.WALKING * first.mean())
    third = (walks[-1] + 1 - walks[0]) // 3 if walks.size else 0
    cuts = [slice(None)]
    if 3 * third > at.DRIFTED_S * rate_hz:
        cuts.append(slice(walks[-1] + 1 - third, walks[-1] + 1))
    for cut in cuts:
        delay, alike = delay_between(first[cut], second[cut], rate_hz, (-farthest, farthest), gain)
        if abs(delay) > farthest and alike > at.LEAST_ALIKE:
            return delay
    return 0.0
