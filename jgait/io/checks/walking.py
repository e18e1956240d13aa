"""Rate, order, clocks and sides: whether the sensors of the legs move together, and as in walking.

*Pace*: a leg that takes a stride in the time T turns by an angle that does not depend on T, and is accelerated in
proportion to 1/T². The root mean square rate times T, and the standard deviation of the specific force times T², are
therefore nearly the same for all walking people. If all rates of turn are half as large as they should be, or the
sampling rate is twice as high, they are not.

*Order*: where a row is missing although time goes on, all sensors turn by what they turn in two steps; where it is
written twice, none changes while it turns.

*Clocks*: landings shake a leg and turn it at the same time: a delay between two signals that are most alike with it is
one of their clocks. *Sides*: both legs turn alike, half a stride apart.

Limits without another word were chosen outside of what undamaged recordings, public and simulated, reach; a number in
parentheses is what they reach.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.io.checks.gravity import ACTIVE, LONGEST_S, USUAL, WINDOW_S, lies
from jgait.notes import Kind, Note
from jgait.quality import SOUND, SensorQuality
from jgait.quality.notes import delayed
from jgait.signal.windows import true_runs
from jgait.types import Imu, as_float

PACE_UNUSUAL = Kind(
    "pace_unusual", "check",
    "{sensors}: in a stride of {seconds:.2f} s a leg turns {angle:.2f} times as far and is shaken {shaking:.2f} times "
    "as hard as in usual walking; {cause}",
    "If the person did not run, limp or take very short steps, angles, lengths and speeds of this recording are wrong. "
    "A sensor on another segment than stated, such as a foot for a shank, looks the same.",
)  # fmt: skip
ROWS_WRONG = Kind(
    "rows_wrong", "check", "",
    "Without time stamps, movements come out too fast and too small where rows are missing, too slow and too large "
    "where they are written twice; lengths and angles after the place are wrong.",
)  # fmt: skip
"""Rows of a file that are missing, or written twice, although time goes on."""

SHORTEST_S = 5.0
"""[s] Shortest recording in which delays and paces are compared: some strides."""

LARGE = 1.55
"""[1] Angle, or shaking, of a leg over the usual that is too large (1.26)."""

BESIDE_JUMP = 3
"""[samples] Changes up to so many samples beside a jump are compared with it; chosen by hand."""

LEAST_CHANGE = 1e-3
"""[rad/s] Least change of a rate that counts in a comparison of changes: about the resolution of a gyroscope."""

FEWEST_ROWS = 10
"""[1] Least number of rows that are missing, or written twice, from which on a file is said to have such rows."""

DOUBLE = np.log([1.6, 2.6])
"""[1] Logarithm of a change over the expected one if a row is missing."""

CHANGE_S = 0.02
"""[s] Time over which the change of a signal is taken to compare delays; chosen by hand."""

LEAST_ALIKE = 0.3
"""[1] Least correlation of two signals whose delay is believed; chosen by hand."""

CLEARER = 0.05
"""[1] Gain of the correlation by an unusual delay in a foot, or between two sensors, from which on it counts, and by
any delay where a swing has few samples and is as sharp as an impact. Without it 6 of 96 simulated legs seem late, with
it none; of 288 delays of 0.1 s 216 are found in place of 248."""

BETWEEN_S = {("thigh", "shank"): 0.07, ("shank", "ankle"): 0.06, ("shank", "foot"): 0.13}
"""[s] Largest usual delay between two sensors of a leg (0.05)."""


class LegPace(NamedTuple):
    """Of a sensor in walking: duration of a stride [s], and angle and shaking over the usual."""

    seconds: float
    angle: float
    shaking: float


def paces_of(sensors: Mapping[str, Imu], lost: Mapping[str, np.ndarray], rate_hz: float) -> dict[str, LegPace]:
    """Placement → pace of the sensors of the legs that agree about the duration of a stride; the median of pieces, for
    two strides of walking can look like one of running. `lost` holds the samples (T,) in long gaps.
    """
    size, paces = int(10.0 * rate_hz), {}
    for placement, imu in sensors.items():
        usual, length = USUAL.get(placement.partition("_")[0]), min(len(imu.time), int(LONGEST_S * rate_hz))
        if usual is None or usual.pace is None or imu.acc is None or length <= SHORTEST_S * rate_hz:
            continue
        gyr, force = as_float(imu.gyr)[:length], np.linalg.norm(as_float(imu.acc)[:length], axis=1)
        width = int(WINDOW_S * rate_hz)
        mean = np.convolve(np.sum(gyr * gyr, axis=1), np.ones(width) / width, "same")
        walks = (mean > ACTIVE * mean.max()) & ~lost[placement][:length]
        cuts = [slice(begin, begin + size) for begin in range(0, max(length - size // 2, 1), size)]
        piece_paces = [_pace(gyr[cut], force[cut], walks[cut], rate_hz, usual.pace) for cut in cuts]
        if known := [pace for pace in piece_paces if pace is not None]:
            paces[placement] = sorted(known)[len(known) // 2]
    seconds = float(np.median([pace.seconds for pace in paces.values()])) if paces else 0.0
    return {place: pace for place, pace in paces.items() if abs(pace.seconds / seconds - 1.0) < 0.1}


def pace_notes(paces: Mapping[str, LegPace]) -> list[Note]:
    """The note about legs that do not move as in walking."""
    if not paces:
        return []
    seconds, angle, shaking = (float(np.exp(np.mean(np.log(part)))) for part in zip(*paces.values(), strict=True))
    ratio = shaking / angle  # of small angles 0.62 to 1.14, in short strides from 0.72
    if angle > LARGE and ratio > 1.0:
        cause = "the sampling rate or the unit of time may be wrong: time passes half as fast as it should"
    elif angle > LARGE:
        cause = "the gyroscopes' unit or scale may be wrong: they read twice what they should"
    elif angle < 0.62 and ratio > 1.45 and shaking < LARGE:
        cause = (
            "the gyroscopes' unit or scale may be wrong, so that they read half of what they should, or the person "
            "shuffles"
        )
    elif angle < 0.7 and ratio < (0.58 if seconds > 0.65 else 0.8):
        cause = "the sampling rate or the unit of time may be wrong: time passes twice as fast as it should"
    else:
        return []
    worn = next(iter(paces)) if len(paces) == 1 else "all sensors of the legs"
    return [PACE_UNUSUAL(sensors=worn, seconds=seconds, angle=angle, shaking=shaking, cause=cause)]


def _pace(
    gyr: np.ndarray, force: np.ndarray, walks: np.ndarray, rate_hz: float, usual: tuple[float, float]
) -> LegPace | None:
    """The pace of rates (T, 3) and forces (T,) in walking (T,); None if it does not repeat itself, or too seldom."""
    if not walks.any():
        return None
    moves, shakes = float(np.sqrt(np.sum(gyr[walks] ** 2, axis=1).mean())), float(force[walks].std())
    if moves < 0.15 or shakes < 0.3:  # [rad/s], [m/s²], of a leg that walks 0.6 and 1.1
        return None
    moved = np.where(walks[:, None], gyr - gyr[walks].mean(axis=0), 0.0)
    length, farthest = 1 << int(2 * len(gyr)).bit_length(), int(3.0 * rate_hz)  # strides last 0.3 to 3 s
    power = np.sum(np.abs(np.fft.rfft(moved, length, axis=0)) ** 2, axis=1)
    common = np.fft.irfft(np.abs(np.fft.rfft(walks.astype(float), length)) ** 2, length)[:farthest]
    alike = np.fft.irfft(power, length)[:farthest] / np.maximum(common, 1.0)
    alike = np.where(common < 0.5 * walks.sum(), 0.0, alike) / alike[0]  # few samples have one a stride later
    low = alike < 0.3
    first = max(int(np.argmax(low)) if low.any() else int(np.argmin(alike)), int(0.3 * rate_hz)) + 1
    inner = np.arange(first, farthest - 1)
    peaks = inner[(alike[inner] >= alike[inner - 1]) & (alike[inner] >= alike[inner + 1])]
    if not peaks.size or not alike[peaks].max() > 0.45:
        return None
    stride = int(peaks[alike[peaks] > 0.8 * alike[peaks].max()][0])  # the shortest of those that are nearly as high
    if 3.0 * stride > walks.sum():
        return None
    seconds = stride / rate_hz
    return LegPace(seconds, moves * seconds / usual[0], shakes * seconds**2 / usual[1])


def rows_wrong(sensors: Mapping[str, Imu], rate_hz: float) -> tuple[SensorQuality, list[Note]]:
    """For every sensor the number of rows written twice, or of places where rows are missing; and the note about it."""
    masks = [np.asarray(imu.mask, bool) for imu in sensors.values()]
    steps = len(masks[0]) - 1
    if len({len(mask) for mask in masks}) != 1 or steps < 10 * BESIDE_JUMP or min(map(np.mean, masks)) <= 0.7:
        return SOUND, []
    near = np.zeros(steps + 1, bool)
    for start, end in (run for mask in masks for run in true_runs(~mask)):
        if end - start >= 3:  # around a longer gap nothing counts
            near[max(start - BESIDE_JUMP - 1, 0) : end + BESIDE_JUMP + 1] = True
    whole = ~(near[1:] | near[:-1])
    changes = [np.diff(as_float(imu.gyr), axis=0) for imu in sensors.values()]
    early = slice(int(600.0 * rate_hz))  # [s] ten minutes decide
    twice = _written_twice([change[early] for change in changes], whole[early])
    if rows := int(twice.sum()):
        begin_s = (np.argmax(twice) + 1) / rate_hz
        text = f"rows that repeat the one before in all sensors while they turn: {rows}, first at {begin_s:.2f} s"
        return SensorQuality(rows_twice=rows), [ROWS_WRONG.note(f"{text}; they are written twice though time goes on")]
    lost = _double_steps([change[early] for change in changes], whole[early], rate_hz)
    if not lost.any() and len(changes) >= 4:
        # one place at which all of four sensors or more jump: mean logarithm over the changes beside it (0.30 to 0.4)
        sizes = np.linalg.norm(changes, axis=2) + LEAST_CHANGE
        beside = [by for by in range(-BESIDE_JUMP, BESIDE_JUMP + 1) if by]
        around = np.max([[_shifted(size, by) for size in sizes] for by in beside], axis=0)
        lost = (np.log(sizes / around).mean(axis=0) > 0.8) & whole
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
        # ten steps of the resolution
        counts = size > max(10.0 * np.min(steps, where=steps > 0.0, initial=np.inf), LEAST_CHANGE)
        turns[rows[counts]] = True
        along = np.sum(_shifted(change, -1)[rows] * expected, axis=1)
        usual, measured = usual + float(size[counts].sum()), measured + float((along[counts] / size[counts]).sum())
    # in undamaged recordings 0.003 of the rows
    few = turns.sum() < max(FEWEST_ROWS, 0.008 * whole.sum())
    return np.zeros(len(same), bool) if few or measured > 1.45 * usual else turns


def _double_steps(changes: list[np.ndarray], whole: np.ndarray, rate_hz: float) -> np.ndarray:
    """(n,) bool, steps that are double of what a cubic through their neighbours gives; none unless frequent and in each
    sensor.
    """
    # of three sensors or more, and of fewer: cosine between a change and the expected one, and rate [Hz] from which on
    # neighbours give the expected one well; double steps over those that are only longer are 0.38 there, 0.82 below
    cosine, fast_hz = (0.8, 80.0) if len(changes) >= 3 else (0.95, 160.0)
    ratio, none = 0.45 if rate_hz >= fast_hz else 0.85, np.zeros(len(whole), bool)
    if rate_hz < 0.5 * fast_hz:
        return none
    ratios = np.full((len(changes), len(whole)), np.nan)
    for sensor_ratios, change in zip(ratios, changes, strict=True):
        around = 4.0 * (_shifted(change, 1) + _shifted(change, -1)) - _shifted(change, 2) - _shifted(change, -2)
        expected = around / 6.0
        along, size = np.sum(change * expected, axis=1), np.sum(expected * expected, axis=1)
        straight = along > cosine * np.sqrt(size * np.sum(change * change, axis=1))
        counts = straight & (size > np.quantile(size, 0.3)) & (size > LEAST_CHANGE**2)
        sensor_ratios[counts] = np.log(along[counts] / size[counts])
    known = np.isfinite(ratios)
    counts = whole & (2 * known.sum(axis=0) >= len(changes))
    middle = np.zeros(len(whole))
    middle[counts] = np.nanmedian(ratios[:, counts], axis=0) if counts.any() else 0.0
    double, longer = ((middle > low) & (middle < high) for low, high in (DOUBLE, np.log([1.2, 1.6])))
    least = max(FEWEST_ROWS, 0.02 * counts.sum(), ratio * longer.sum())
    each = np.sum((ratios > DOUBLE[0]) & (ratios < DOUBLE[1]), axis=1) / np.maximum(known.sum(axis=1), 1)
    return np.asarray(double) if double.sum() >= least and each.min() >= 0.25 * each.max() else none


def _delay_between(
    first: np.ndarray, second: np.ndarray, rate_hz: float, usual: tuple[float, float], gain: float
) -> tuple[float, float]:
    """Delay [s] of the second signal behind the first, both (n,), where they are most alike; and their correlation. One
    outside of the usual delays [s] counts only if its correlation is larger by `gain`.
    """
    farthest = int(0.35 * rate_hz)  # [s] a third of a stride: later, steps are mistaken for each other
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
    segment, longest = placement.partition("_")[0], int(LONGEST_S * rate_hz)
    delays = USUAL[segment].acc_late_s if segment in USUAL else None
    if delays is None or imu.acc is None or len(imu.time) <= SHORTEST_S * rate_hz:
        return SOUND, []
    step = max(round(CHANGE_S * rate_hz), 1)
    gyr, acc = (np.linalg.norm(part[step:] - part[:-step], axis=1)
                for part in (as_float(imu.gyr)[:longest], as_float(imu.acc)[:longest]))  # fmt: skip
    low, high = min(delays[0], -1.0 / rate_hz), max(delays[1], 1.0 / rate_hz)  # a delay is known to a sample
    gain = CLEARER if segment == "foot" or step < 2 else 0.0
    delay, alike = _delay_between(gyr, acc, rate_hz, (low, high), gain)
    usual = low - 0.5 / rate_hz <= delay <= high + 0.5 / rate_hz
    if usual or alike <= LEAST_ALIKE:
        return SOUND, []
    return SensorQuality(acc_late=delay), [delayed(placement, "the accelerometer", delay, "the gyroscope")]


def late_behind(upper: str, lower: str, sensors: Mapping[str, Imu], rate_hz: float) -> float:
    """The delay [s] of the lower one of two sensors of a leg, in all or in the last third of the walk; 0 if it is
    usual.
    """
    longest, samples, shaken = int(LONGEST_S * rate_hz), max(round(0.12 * rate_hz), 3), []
    for name in (upper, lower):  # the size of the force without its mean over 0.12 s
        force = as_float(sensors[name].acc)[:longest]
        padded = np.pad(force, [(samples // 2, samples - samples // 2 - 1), (0, 0)], mode="edge")
        mean = np.stack([np.convolve(column, np.ones(samples) / samples, "valid") for column in padded.T], axis=1)
        shaken.append(np.linalg.norm(force - mean, axis=1))
    first, second = shaken
    pair = upper.partition("_")[0], lower.partition("_")[0]
    coarse = max(round(CHANGE_S * rate_hz), 1) < 2
    farthest = (int(BETWEEN_S[pair] * rate_hz) + 1) / rate_hz if coarse else BETWEEN_S[pair]
    gain = (2.0 if pair[1] == "foot" else 1.0) * CLEARER  # a foot that drags is shaken twice in a step
    usual = np.convolve(first, np.ones(round(rate_hz)) / round(rate_hz), "same")
    walks = np.flatnonzero(usual > 0.5 * first.mean())
    third = (walks[-1] + 1 - walks[0]) // 3 if walks.size else 0
    cuts = [slice(None)]
    if 3 * third > 12.0 * rate_hz:  # of a longer walk, a clock that is fast is late in the last third
        cuts.append(slice(walks[-1] + 1 - third, walks[-1] + 1))
    for cut in cuts:
        delay, alike = _delay_between(first[cut], second[cut], rate_hz, (-farthest, farthest), gain)
        if abs(delay) > farthest and alike > LEAST_ALIKE:
            return delay
    return 0.0


def sides_differ(right: str, left: str, sensors: Mapping[str, Imu], rate_hz: float) -> dict[str, SensorQuality]:
    """The sensor of the same segment of both legs that turns faster, in the time in which both move."""
    counts = np.all([np.asarray(sensors[name].mask, bool) for name in (right, left)], axis=0)
    if all(sensors[name].acc is not None for name in (right, left)):
        both = counts & ~lies(sensors[right], rate_hz) & ~lies(sensors[left], rate_hz)
        counts = both if both.sum() > 2.0 * WINDOW_S * rate_hz else counts
    if counts.sum() < 2.0 * WINDOW_S * rate_hz:
        return {}
    rates = {name: float(np.sqrt(np.mean(np.sum(as_float(sensors[name].gyr)[counts] ** 2, axis=1))))
             for name in (right, left)}  # fmt: skip
    slower, faster = sorted(rates, key=lambda name: rates[name])
    # a leg moves with 0.2 rad/s; undamaged legs differ by 1.36
    if not rates[slower] > 0.0 or rates[faster] < 0.2 or rates[faster] < 1.6 * rates[slower]:
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
    apart = abs(share - 0.5) > 0.1  # people who limp strongly reach it
    return {left: SensorQuality(step_share=share)} if apart else {}
