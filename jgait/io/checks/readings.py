"""Range, stuck and clipped readings of one sensor: what it cannot have measured is masked, with a note.

Limits without another word were chosen outside of what undamaged recordings, public and simulated, reach; a number in
parentheses is what they reach.
"""

import itertools
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.geometry.vectors import GRAVITY
from jgait.notes import CLIPPING, LOSSES, NO_RANGE, Kind, Note
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Imu, RangeReadings, as_float

MASKED = Kind("samples_masked", "check", "", LOSSES)  # readings that the sensor cannot have measured
WRAPPED = Kind(
    "channel_wrapped", "check",
    "{channel} jumps {times} {times:time|times} from one end of its range ({value:.4g} {unit}) to the other",
    "The movement was faster than the sensor's range, and its peaks come out with the wrong sign. The results of this "
    "sensor are wrong; a sensor with a larger range avoids this.",
)  # fmt: skip
UNWRAPPED = WRAPPED._replace(
    code="channel_unwrapped", severity="corrected",
    meaning="The movement was faster than the sensor's range, and its peaks came out with the wrong sign. A whole "
    "range was added to them or taken from them. A sensor with a larger range avoids this.",
)  # fmt: skip
CHANNEL_CONSTANT = Kind(
    "channel_constant", "check", "{channel} is constant at {value:.4g} {unit}",
    "One axis of a sensor gives the same value all the time: it is broken, or was not recorded.",
)  # fmt: skip
ACCELEROMETER_COARSE = Kind(
    "accelerometer_coarse", "info", "{placement}: the accelerometer reads in steps of {step:.2g} m/s²",
    "Standing may not be found, tilts are less certain, and lengths and distances may change by several per cent. "
    "Record with a finer resolution, or export more digits.",
)  # fmt: skip
CHANNEL_CLIPPED = Kind(
    "channel_clipped", "check",
    "{placement}: {channel} is clipped at ±{value:.4g} {unit} in {samples} {samples:sample|samples}", CLIPPING,
    counts=True,
)  # fmt: skip
RANGE_LOST = Kind("range_lost", "check", "", NO_RANGE)  # a range between the feet that was not measured


class SignalLimits(NamedTuple):
    """A kind of signal, and limits of its readings in its unit."""

    words: str  #: name of the sensor.
    unit: str
    largest: float  #: largest reading of any wearable sensor: gyroscopes end at 4000 deg/s, accelerometers at 400 g.
    placeholder: float  #: least size of a number that stands for a missing one: 999 mg and 999 mdeg/s are readings.
    #: least distance of a spike from the median of five samples, at the foot (14.4, 162) and elsewhere (4.7, 49).
    spike: tuple[float, float]
    change: float  #: least change at an end of a time in which a sensor is stuck, or it may rest; chosen by hand.
    clipped: float  #: smallest size of a clipped reading; chosen by hand.
    ranges: tuple[float, ...]  #: ranges of common sensors, by their data sheets.


SIGNALS = {
    "gyr": SignalLimits("gyroscope", "rad/s", 100.0, 10.0, (24.0, 10.0), 0.1, 1.0, tuple(
        np.deg2rad([125.0, 245.0, 250.0, 300.0, 400.0, 450.0, 500.0, 900.0, 1000.0, 1200.0, 2000.0]))),
    "acc": SignalLimits("accelerometer", "m/s²", 4000.0, 50.0, (60.0, 90.0), 1.0, 1.5 * GRAVITY, tuple(
        GRAVITY * np.array([2.0, 4.0, 6.0, 8.0, 16.0]))),
}  # fmt: skip
"""Kind of signal → its name, unit and limits."""

PLACEHOLDERS = (-999.0, 999.0, -9999.0, 9999.0, -99999.0, 99999.0)
"""Numbers that programs write for a missing value, in the unit of the file."""

TURNING = 0.3
"""[rad/s] Mean rate with which an accelerometer cannot repeat its reading; chosen by hand."""

COARSE = 0.04 * GRAVITY
"""[m/s²] Step of an accelerometer from which on its readings repeat at rest and results change; in steps of 0.03 g,
distances are within 0.5 %, of 0.05 g within 4 %."""


def without_damage(
    placement: str, signals: dict[str, np.ndarray], scales: dict[str, float], rate_hz: float,
    twice: np.ndarray | None = None,
) -> tuple[dict[str, np.ndarray], tuple[Note, ...]]:  # fmt: skip
    """One sensor's signals, "gyr" and perhaps "acc" (T, 3) in SI, NaN where samples cannot have been measured, and the
    notes about it. `scales` are SI units per unit of the file; `twice` (T − 1,) is True before a row that repeats the
    one before in all sensors, None if the sensor is the only one.
    """
    signals = {kind: values.copy() for kind, values in signals.items()}
    wrapped, repeated, sentences = list[Note](), dict[str, list[str]](), list[str]()
    held = np.all([~np.diff(values, axis=0).any(axis=1) for values in signals.values()], axis=0)
    held &= False if twice is None else ~twice
    with np.errstate(invalid="ignore"):
        for kind, values in signals.items():
            wrong = (np.abs(values) > SIGNALS[kind].largest).any(axis=1)
            if 0 < wrong.sum() <= max(0.01 * len(values), 1):  # with more, the unit is wrong
                first = int(np.argmax(wrong))
                worst, unit = values[first][np.argmax(np.abs(values[first]))], SIGNALS[kind].unit
                where = f"{wrong.sum()}, {worst:.4g} {unit} at {first / rate_hz:.2f} s"
                sentences.append(f"values that no sensor reads: {where}; masked")
                values[wrong] = np.nan
        sentences += _placeholders(signals, scales, rate_hz)
        for kind, values in signals.items():
            wrapped += _unwrap(placement, kind, values)
            spikes, jumps = _spikes(placement, kind, values, signals["gyr"], rate_hz)
            stuck = {f"the {SIGNALS[kind].words}": _stuck(kind, values, signals["gyr"], rate_hz)}
            stuck |= {f"{kind}_{'xyz'[axis]}": _axis_stuck(kind, values, axis, rate_hz) for axis in range(3)}
            slower = _repeats(kind, values, signals["gyr"], held, rate_hz)
            values[spikes] = np.nan
            for signal, runs in stuck.items():
                for start, end in runs:
                    values[start + 1 : end + 1] = np.nan
                if runs:
                    seconds = sum(end - start + 1 for start, end in runs) / rate_hz
                    since = f"for {seconds:.2f} s in all, first at {runs[0][0] / rate_hz:.2f} s"
                    repeated.setdefault(since, []).append(signal)
            sentences += jumps + (_between_new(kind, values, *slower, rate_hz) if slower is not None else [])
    sentences += [f"one reading of {' and '.join(of)} is repeated {since}; masked" for since, of in repeated.items()]
    return signals, (*wrapped, *(MASKED.note(sentence, placement=placement) for sentence in sentences))


def finest_step(values: np.ndarray) -> float:
    """The least change that is not 0 between neighbouring samples of any axis; 0 where nothing changes."""
    steps = np.abs(np.diff(values, axis=0))
    return float(steps[steps > 0.0].min()) if (steps > 0.0).any() else 0.0


def placeholders_in(values: np.ndarray) -> tuple[float, ...]:
    """Numbers in values (T, 3), in the file's unit, that may stand for missing ones: programs' own, and a repeated huge
    one.
    """
    sizes, first, counts = np.unique(np.abs(values[np.isfinite(values)]), return_index=True, return_counts=True)
    if not len(sizes) or sizes[-1] < 998.0:
        return ()
    if len(sizes) > 1 and counts[-1] > 1 and sizes[-1] > 4.0 * sizes[-2]:
        return (*PLACEHOLDERS, float(values[np.isfinite(values)][first[-1]]))
    return PLACEHOLDERS


def _placeholders(signals: dict[str, np.ndarray], scales: dict[str, float], rate: float) -> list[str]:
    """Mask samples that hold the number of a missing value, or are zero in all axes; what is masked, in words."""
    masks: dict[float, np.ndarray] = {}
    zero = np.all([~values.any(axis=1) for values in signals.values()], axis=0)  # NaN counts as not zero
    for kind, values in signals.items():
        for number in placeholders_in(values / scales[kind]):
            same = np.abs(values / scales[kind] - number) < 1e-6
            # one axis may read such a number while it passes by; then its neighbours are near
            jump = np.abs(np.diff(values, axis=0, prepend=values[:1])) > 0.5 * abs(number) * scales[kind]
            wrong = same.all(axis=1) | (same & jump).any(axis=1)
            if wrong.any() and abs(number) * scales[kind] >= SIGNALS[kind].placeholder:
                masks[number] = masks.get(number, False) | wrong
    if "acc" in signals and zero.any() and zero.mean() < 0.5:  # with more, they are written on purpose
        masks[0.0] = zero
    for wrong, values in itertools.product(masks.values(), signals.values()):
        values[wrong] = np.nan
    return [
        f"samples that hold {number:g} in place of a reading: {wrong.sum()}, first at {np.argmax(wrong) / rate:.2f} s; "
        "masked"
        for number, wrong in masks.items()
    ]


def _spikes(
    placement: str, kind: str, values: np.ndarray, gyr: np.ndarray, rate: float
) -> tuple[np.ndarray, list[str]]:
    """(T,) bool, one or two samples far away from the median around them, where the signal is calm otherwise."""
    least = SIGNALS[kind].spike[not placement.startswith("foot")]
    spikes, size, change = np.zeros(len(values), bool), 0.0, np.diff(values, axis=0)
    if not np.nanmax(np.abs(change), initial=0.0) > least:
        return spikes, []
    padded = np.pad(np.where(np.isfinite(values), values, 0.0), [(2, 2), (0, 0)], mode="edge")
    away = np.abs(values - np.median([padded[k : k + len(values)] for k in range(5)], axis=0))
    odd = away > least
    # steps to and from odd samples do not count
    steps = np.where(odd[1:] | odd[:-1] | ~np.isfinite(change), 0.0, np.abs(change))
    for row, axis in np.argwhere(odd):
        around = steps[max(row - 6, 0) : row + 6, axis]
        turns = np.abs(np.diff(gyr[max(row - 3, 0) : row + 4], axis=0))
        # an impact of 1 m/s² turns the sensor as well, by a change of its rate of 0.02 rad/s at least
        struck = kind == "acc" and (np.isnan(turns).all() or np.nanmax(turns) >= 0.01 * away[row, axis])
        if not struck and away[row, axis] > 2.5 * around.max(initial=1e-9):
            spikes[row], size = True, max(size, float(away[row, axis]))
    signal = SIGNALS[kind]
    by = f"{size:.4g} {signal.unit}: {spikes.sum()}"
    what = f"samples of the {signal.words} that jump from their neighbours by up to {by}"
    return spikes, [f"{what}, first at {np.argmax(spikes) / rate:.2f} s; masked"] if spikes.any() else []


def _unwrap(placement: str, kind: str, values: np.ndarray) -> list[Note]:
    """Continue channels that jump from one end of a common range to the other, and do not stay there, as clipped."""
    notes = []
    for axis, column in enumerate(values.T):
        extent = np.nanmax(np.abs(column), initial=0.0)
        edges = [limit for limit in SIGNALS[kind].ranges if extent <= 1.001 * limit]
        size = np.abs(np.diff(column))
        if not edges or not np.nanmax(size, initial=0.0) > 1.6 * extent:
            continue
        limit, low, high = float(edges[0]), np.nanmin(column), np.nanmax(column)
        jumps = int(np.sum((size > 1.6 * limit) & (size < 0.9999 * (high - low))))
        clips = np.sum((column == low) | (column == high)) >= jumps
        if jumps >= 4 and min(high, -low) >= 0.97 * limit and not clips:
            channel = f"{placement} {kind}_{'xyz'[axis]}"
            known = np.isfinite(column)
            whole = np.unwrap(column[known], period=2.0 * limit)
            # more of the time is no swing
            if mended := np.mean(np.abs(whole - column[known]) > limit) < 0.3:
                values[known, axis] = whole
            about = {"channel": channel, "times": jumps, "value": limit, "unit": SIGNALS[kind].unit}
            notes.append(UNWRAPPED(**about) if mended else WRAPPED(**about))
    return notes


def _long_runs(same: np.ndarray, rate: float) -> list[tuple[int, int]]:
    """The stretches of True that are too long for a sensor that works: gyroscopes repeat a reading in 4 samples, coarse
    accelerometers that do not turn in 22.
    """
    least = max(8, 0.05 * rate)
    return [(start, end) for start, end in true_runs(same) if end - start >= least]


def _stuck(kind: str, values: np.ndarray, gyr: np.ndarray, rate: float) -> list[tuple[int, int]]:
    """First and last samples of stretches in which a sensor repeats its reading although it turns, and then jumps; or
    to the end.
    """
    steps = np.abs(np.diff(values, axis=0))
    same = ~steps.any(axis=1)
    if not (runs := _long_runs(same, rate)):
        return []
    resolution = np.min(steps, axis=0, where=steps > 0.0, initial=np.inf)
    low, high = np.nanmin(values, axis=0), np.nanmax(values, axis=0)
    others = max((e - s for s, e in true_runs(same) if e < len(same)), default=1)
    stuck, least = [], SIGNALS[kind].change
    for start, end in runs:
        reading, rates = values[start], np.abs(gyr[start : end + 1])
        clipped = (((reading == low) | (reading == high)) & (np.abs(reading) > least)).any()
        turns = kind == "gyr" or np.isnan(rates).all() or np.nanmean(rates) >= TURNING
        ends = [steps[k] for k in (start - 1, end) if 0 <= k < len(steps)]
        jumps = any(((e > 10.0 * resolution) & (e > least)).any() for e in ends)
        late = end == len(same) and start >= rate
        long = end - start >= max(rate, 10.0 * others)  # a second, and far longer than at rest
        # a coarse accelerometer repeats its reading in standing
        rests = kind == "acc" and np.nansum(np.abs(np.diff(gyr[start : end + 1], axis=0))) > 0.0
        if (turns and jumps and not clipped) or (late and long and not rests):
            stuck.append((start, end))
    return stuck


def _axis_stuck(kind: str, values: np.ndarray, axis: int, rate: float) -> list[tuple[int, int]]:
    """First and last samples of stretches in which one axis, not by chance, repeats its reading while others change."""
    steps = np.abs(np.diff(values, axis=0))
    column, same, change = values[:, axis], steps[:, axis] == 0.0, np.delete(steps, axis, axis=1).sum(axis=1)
    if not (runs := _long_runs(same, rate)):
        return []
    free = change > 0.0
    for start, end in runs:
        free[start:end] = False
    chance = np.log(max(float(same[free].mean()) if free.any() else 1.0, 1e-3))
    rests = _long_runs(~steps.any(axis=1), rate)  # a sensor without noise repeats itself in simple movements too
    limits = (np.nanmin(column), np.nanmax(column))
    return [
        (start, end) for start, end in runs
        if (end - start) * chance < np.log(1e-24)  # if repeats were independent; 1e-19 in steps of 0.1 g
        and all(start <= s < end for s, _ in rests)
        and np.nanmean(change[start:end]) > 0.25 * np.nanmean(change)
        and not (column[start] in limits and abs(column[start]) > SIGNALS[kind].change)
    ]  # fmt: skip


def _repeats(
    kind: str, values: np.ndarray, gyr: np.ndarray, held: np.ndarray, rate: float
) -> tuple[np.ndarray, float] | None:
    """Rows that repeat the one before, and their share, if they are many; `held` (T − 1,) is True where the whole
    sensor does.
    """
    same = ~np.diff(values, axis=0).any(axis=1)
    turns = np.linalg.norm(gyr[1:], axis=1) > TURNING if kind == "acc" else np.ones(len(same), bool)
    for start, end in _long_runs(same, rate):
        same[start:end] = False
    share = float(np.sum(same & turns) / max(np.sum(turns), 1))
    slower = share > 0.4 or np.mean(same & held) > 0.12  # (0.04)
    return (1 + np.flatnonzero(same), share) if slower else None


def _between_new(kind: str, values: np.ndarray, again: np.ndarray, share: float, rate: float) -> list[str]:
    """Replace repeated readings by straight lines between the new ones, or mask them if these are too rare."""
    new = np.setdiff1d(np.flatnonzero(np.isfinite(values).all(axis=1)), again)
    # below 45 Hz of new readings steps come out wrong; a clock is a little off its nominal rate
    dense = new.size > 0 and rate * (1.0 - share) >= 0.99 * 45.0
    values[again] = np.stack([np.interp(again, new, column[new]) for column in values.T], axis=1) if dense else np.nan
    taken = "straight lines are taken between new readings" if dense else "masked, since new ones are too rare"
    return [
        f"{100.0 * share:.0f} % of the readings of the {SIGNALS[kind].words} repeat the one before: the sensor is "
        f"slower than the file states; {taken}"
    ]


def channel_notes(placement: str, imu: Imu) -> list[Note]:
    """Notes about constant and clipped channels of a sensor, and about a coarse accelerometer."""
    mask, notes = np.asarray(imu.mask, bool), []
    step = 0.0 if imu.acc is None else finest_step(np.asarray(imu.acc)[mask])
    if step >= COARSE:
        notes.append(ACCELEROMETER_COARSE(placement=placement, step=step))
    signals = {"gyr": imu.gyr} | ({} if imu.acc is None else {"acc": imu.acc}) if mask.any() else {}
    channels = [
        (kind, axis, as_float(signal)[:, k]) for kind, signal in signals.items() for k, axis in enumerate("xyz")
    ]
    for kind, axis, values in channels:
        there, channel, unit = values[mask], f"{kind}_{axis}", SIGNALS[kind].unit
        if np.ptp(there) == 0.0:
            notes.append(CHANNEL_CONSTANT(channel=f"{placement} {channel}", value=there[0], unit=unit))
            continue
        coarse = finest_step(there) if kind == "acc" else 0.0
        clips = {abs(float(limit)): n for limit in (there.max(), there.min())
                 if abs(limit) >= SIGNALS[kind].clipped and (n := _clipped(values, mask, limit, coarse))}  # fmt: skip
        if clips:
            about = {"channel": channel, "value": max(clips), "unit": unit, "samples": sum(clips.values())}
            notes.append(CHANNEL_CLIPPED(placement=placement, **about))
    return notes


def _clipped(values: np.ndarray, mask: np.ndarray, limit: float, step: float) -> int:
    """Number of samples of a channel that stay at its extreme value; its readings are `step` apart."""
    runs = [(s, e) for s, e in true_runs(mask & (np.abs(values - limit) <= 1e-6 * abs(limit))) if e - s >= 3]
    if step >= COARSE:
        change = np.abs(np.diff(values, prepend=values[:1], append=values[-1:]))
        runs = [run for run in runs if change[list(run)].max() > 5.0 * step]
    return sum(end - start for start, end in runs)


def without_repeats(read: RangeReadings, imus: Mapping[str, Imu]) -> tuple[RangeReadings, tuple[Note, ...]]:
    """A range between the feet with repeated readings masked while a foot's sensor moves, and the note about them."""
    feet = [imus[f"foot_{side}"] for side in SIDES if f"foot_{side}" in imus]
    rows = np.flatnonzero(read.mask)
    if not feet or not rows.size:
        return read, ()
    rate = np.max([np.where(foot.mask, np.linalg.norm(as_float(foot.gyr), axis=1), 0.0) for foot in feet], axis=0)
    time, mask, runs = as_float(read.time), np.array(read.mask, bool), []
    for run in np.split(rows, np.flatnonzero(np.diff(read.distance[rows]) != 0.0) + 1):
        lasts, gapless = time[run[-1]] - time[run[0]], run[-1] - run[0] == run.size - 1
        stuck = lasts >= 5.0 and run.size >= 10
        held = gapless and lasts > 0.3
        if (stuck or held) and np.mean(rate[run[0] : run[-1] + 1]) > 1.0:  # [rad/s] the faster foot moves
            mask[run if stuck else run[1:]] = False
            runs.append(run)
    if not runs:
        return read, ()
    seconds = sum(float(time[run[-1]] - time[run[0]]) for run in runs)
    stuck_for = f"for {seconds:.2f} s in all, first at {time[runs[0][0]] - time[0]:.2f} s"
    note = RANGE_LOST.note(f"readings of feet_range that are repeated while the feet move: {len(runs)}, {stuck_for}")
    return read._replace(distance=np.where(mask, read.distance, 0.0), mask=mask), (note,)
