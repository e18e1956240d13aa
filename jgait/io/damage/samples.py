"""Samples that no sensor can have measured: they are found in the rows of a file and masked, each with a note."""

from collections.abc import Callable

import numpy as np

from jgait.notes import LOSSES, Kind, Note
from jgait.signal.windows import true_runs

FASTEST_GYR = 100.0
"""[rad/s] Largest rate of a sample. No wearable gyroscope reads above 4000 deg/s, which is 70 rad/s."""

LARGEST_ACC = 4000.0
"""[m/s²] Largest specific force of a sample; accelerometers with the widest range read 400 g."""

MOST_IMPOSSIBLE = 0.01
"""[1] Largest share of impossible samples that is masked; with more, the unit is wrong, see `usable_sensors`."""

SENTINELS = (-999.0, 999.0, -9999.0, 9999.0, -99999.0, 99999.0)
"""Numbers that programs write for a missing value, in the unit of the file."""

LEAST_SENTINEL = {"gyr": 10.0, "acc": 50.0}
"""[rad/s], [m/s²] Least size of such a number, chosen above usual readings: 999 mg and 999 mdeg/s are readings."""

MOST_ZEROS = 0.5
"""[1] Share of samples that are zero in all axes from which on they are left: the file then writes zeros on purpose."""

SPIKE_GYR = {"foot": 24.0, "": 10.0}
"""[rad/s] Least distance of a spike from the median of five samples, by segment. In undamaged public recordings, single
samples are up to 14.4 away from their neighbours at the foot (one glitch is 26.4 away) and up to 4.7 elsewhere."""

SPIKE_ACC = {"foot": 60.0, "": 90.0}
"""[m/s²] As `SPIKE_GYR`. Undamaged recordings reach 162 at the foot, where `IMPACT` separates, and 49 elsewhere."""

CALM_AROUND = 2.5
"""[1] Least ratio of a spike to the largest change between other samples up to `AROUND` away."""

IMPACT = 0.01
"""[rad/s per m/s²] Largest change of the angular rate around a spike of an accelerometer, over the spike: impacts
turn the sensor as well, by 0.02 rad/s per m/s² at least in undamaged recordings."""

AROUND = 6
"""[samples] Distance up to which the changes around a spike are compared."""

WRAP_STEP = 1.6
"""[1] Least change between two samples of a wrap, over the range. Between samples, a wrapped signal jumps by twice its
range less its own change."""

WRAP_EDGE = 0.97
"""[1] Share of the range that a wrapped signal reaches on either side."""

WRAPS = 4
"""[1] Least number of jumps of a channel that wraps: out and back, twice."""

RANGES = {
    "gyr": np.deg2rad([125.0, 245.0, 250.0, 300.0, 400.0, 450.0, 500.0, 900.0, 1000.0, 1200.0, 2000.0]),
    "acc": 9.80665 * np.array([2.0, 4.0, 6.0, 8.0, 16.0]),
}
"""Ranges of common gyroscopes [rad/s] and accelerometers [m/s²]."""

FROZEN_RUN, FROZEN_S = 8, 0.05
"""[samples], [s] Shortest time in which a sensor repeats its reading in all axes; undamaged gyroscopes repeat theirs at
most 4 times, coarse accelerometers 22 times, but without turning; a single axis that turns, 5 times."""

STOPPED_S, STOPPED = 1.0, 10.0
"""[s], [1] Shortest stretch of one reading to the end of a recording in which the sensor has stopped, and least length
over that of every other such stretch: a sensor that rests repeats its readings at every rest alike. It begins no sooner
than this time after the first sample."""

FROZEN_STEPS = 10.0
"""[1] Least change at the end of a frozen stretch, in steps of the sensor's resolution: at rest a sensor moves by
one."""

FROZEN_CHANGE = {"gyr": 0.1, "acc": 1.0}
"""[rad/s], [m/s²] Least change at the end of a frozen stretch."""

TURNING = 0.3
"""[rad/s] Mean rate above which an accelerometer cannot repeat its reading."""

COARSE = 0.04 * 9.80665
"""[m/s²] Step of an accelerometer from which on its readings repeat at rest and results change. Walks of sensors at the
waist, rounded to 0.03 g, give distances within 0.5 % of theirs, rounded to 0.05 g within 4 %, and standing is missed in
some. Undamaged public recordings have steps of at most 0.0005 g."""

REPEATS = 0.4
"""[1] Share of samples equal to the one before in all axes from which on the sensor is slower than its file; of an
accelerometer, of those at which the sensor turns. Undamaged gyroscopes repeat 4 % of their readings."""

HELD = 0.12
"""[1] Share of samples at which a whole sensor, and not all of them, repeats its reading, from which on it is slower
than its file too: tables of two rates were merged, or lost readings held. Chosen, above `REPEATS`' undamaged ones."""

LEAST_HZ = 45.0
"""[Hz] Rate of new readings below which the repeated ones are masked; steps of feet and shanks come out wrong there."""

IMPOSSIBLE = Kind(
    "samples_impossible",
    "check",
    "{placement}: {samples} {samples:sample holds a value|samples hold values} that no sensor reads, {value:.4g} "
    "{unit} at {begin_s:.2f} s; masked",
    LOSSES,
)
PLACEHOLDERS = Kind(
    "samples_placeholder",
    "check",
    "{placement}: {samples} {samples:sample holds|samples hold} {value:g} in place of a reading, first at "
    "{begin_s:.2f} s; masked",
    LOSSES,
)
SPIKES = Kind(
    "samples_spike",
    "check",
    "{placement}: {samples} {samples:sample|samples} of the {signal} {samples:jumps|jump} away from the neighbours "
    "by up to {size:.4g} {unit}, "
    "first at {begin_s:.2f} s; masked",
    LOSSES,
)
FROZEN = Kind(
    "samples_frozen",
    "check",
    "{placement}: one reading of {signals} is repeated for {seconds:.2f} s from {begin_s:.2f} s; masked",
    LOSSES,
)
STUCK = Kind(
    "axis_stuck",
    "check",
    "{channel} repeats one reading {times} {times:time|times} while the sensor turns, for {seconds:.2f} s in all, "
    "first at {begin_s:.2f} s; masked",
    LOSSES,
)
WRAPPED = Kind(
    "channel_wrapped",
    "check",
    "{channel} jumps {times} {times:time|times} from one end of its range ({value:.4g} {unit}) to the other",
    "The movement was faster than the sensor's range, and its peaks come out with the wrong sign. The results of this "
    "sensor are wrong; a sensor with a larger range avoids this.",
)
SLOWER = Kind(
    "samples_repeated",
    "check",
    "{placement}: {percent:.0f} % of the readings of the {signal} repeat the one before; the sensor is slower than the "
    "file states; {taken}",
    "Readings that are written twice add no information, and hold up the signal by half of their time. Over a slow "
    "sensor's readings, impacts and fast movements are not known.",
)
SIGNALS = {"gyr": ("gyroscope", "rad/s"), "acc": ("accelerometer", "m/s²")}


def without_damage(
    placement: str, signals: dict[str, np.ndarray], scales: dict[str, float], rate_hz: float,
    twice: np.ndarray | None = None,
) -> tuple[dict[str, np.ndarray], tuple[Note, ...]]:  # fmt: skip
    """One sensor's signals, NaN where samples cannot have been measured, and the notes about it.

    Args:
        placement: placement of the sensor.
        signals: "gyr" (T, 3) [rad/s], perhaps "acc" (T, 3) [m/s²]; NaN where samples are missing.
        scales: "gyr", "acc" → SI units per unit of the file.
        rate_hz: rate of the rows [Hz].
        twice: (T − 1,) bool, True before a row that repeats the one before in all sensors: rows may be written twice
            there; None if the sensor is the only one.
    """
    signals = {kind: values.copy() for kind, values in signals.items()}
    notes: list[Note] = []
    frozen: dict[tuple[int, int], list[str]] = {}
    held = np.all([~np.diff(values, axis=0).any(axis=1) for values in signals.values()], axis=0)
    held &= False if twice is None else ~twice
    with np.errstate(invalid="ignore"):
        _impossible(placement, signals, rate_hz, notes)
        _placeholders(placement, signals, scales, rate_hz, notes)
        for kind, values in signals.items():
            change = np.diff(values, axis=0)
            notes += _wraps(placement, kind, values, change)
            spikes = _spikes(placement, kind, values, change, signals["gyr"], rate_hz, notes)
            runs = _frozen(placement, kind, values, change, signals["gyr"], rate_hz, notes)
            values[spikes] = np.nan
            stuck = _stuck(placement, kind, values, change, signals["gyr"], rate_hz, notes)
            for start, end in runs:
                frozen.setdefault((start, end), []).append(kind)
            for start, end in (*runs, *stuck):
                values[start + 1 : end + 1] = np.nan
            _between_new(placement, kind, values, change, signals["gyr"], held, rate_hz, notes)
        for (start, end), kinds in sorted(frozen.items()):
            words = " and ".join(f"the {SIGNALS[kind][0]}" for kind in kinds)
            seconds = (end - start + 1) / rate_hz
            notes.append(FROZEN(placement=placement, signals=words, seconds=seconds, begin_s=start / rate_hz))
    return signals, tuple(notes)


def finest_step(values: np.ndarray) -> float:
    """The least change that is not 0 between neighbouring samples of any axis; 0 where nothing changes."""
    steps = np.abs(np.diff(values, axis=0))
    return float(steps[steps > 0.0].min(initial=np.inf)) if (steps > 0.0).any() else 0.0


def _impossible(placement: str, signals: dict[str, np.ndarray], rate: float, notes: list[Note]) -> None:
    """Mask samples beyond the range of any sensor."""
    for (kind, values), limit in zip(signals.items(), (FASTEST_GYR, LARGEST_ACC), strict=False):
        wrong = (np.abs(values) > limit).any(axis=1)
        count = int(wrong.sum())
        if not count or count > max(MOST_IMPOSSIBLE * len(values), 1):
            continue
        first = int(np.argmax(wrong))
        value = values[first][np.argmax(np.abs(values[first]))]
        notes.append(
            IMPOSSIBLE(placement=placement, samples=count, value=value, unit=SIGNALS[kind][1], begin_s=first / rate)
        )
        values[wrong] = np.nan


def _placeholders(
    placement: str, signals: dict[str, np.ndarray], scales: dict[str, float], rate: float, notes: list[Note]
) -> None:
    """Mask samples that hold the number of a missing value, and samples that are zero in all axes."""
    placeholders: dict[float, np.ndarray] = {}
    zero = np.ones(len(signals["gyr"]), bool)
    for kind, values in signals.items():
        zero &= ~values.any(axis=1)  # NaN counts as not zero
        if not (np.abs(values) >= 0.999 * abs(SENTINELS[0]) * scales[kind]).any():
            continue
        for number in SENTINELS:
            if abs(number) * scales[kind] < LEAST_SENTINEL[kind]:
                continue
            same = np.abs(values / scales[kind] - number) < 1e-6
            # One axis may read such a number while it passes by; then its neighbours are near.
            jump = np.abs(np.diff(values, axis=0, prepend=values[:1])) > 0.5 * abs(number) * scales[kind]
            wrong = same.all(axis=1) | (same & jump).any(axis=1)
            if wrong.any():
                placeholders[number] = placeholders.get(number, False) | wrong
    if "acc" in signals and zero.any() and zero.mean() < MOST_ZEROS:
        placeholders[0.0] = zero
    for number, wrong in placeholders.items():
        notes.append(
            PLACEHOLDERS(placement=placement, samples=wrong.sum(), value=number, begin_s=np.argmax(wrong) / rate)
        )
        for values in signals.values():
            values[wrong] = np.nan


def _spikes(
    placement: str, kind: str, values: np.ndarray, change: np.ndarray, gyr: np.ndarray, rate: float, notes: list[Note]
) -> np.ndarray:
    """(T,) bool, one or two samples far away from the median around them, where the signal is calm otherwise."""
    part = "foot" if placement.startswith("foot") else ""
    spikes = np.zeros(len(values), bool)
    least = (SPIKE_GYR if kind == "gyr" else SPIKE_ACC)[part]
    if not np.nanmax(np.abs(change), initial=0.0) > least:
        return spikes
    held = np.concatenate(
        [values[:1], values[:1], np.where(np.isfinite(values), values, 0.0), values[-1:], values[-1:]]
    )
    away = np.abs(values - np.median([held[k : k + len(values)] for k in range(5)], axis=0))
    odd = away > least
    # steps to and from odd samples do not count
    steps = np.where(odd[1:] | odd[:-1] | ~np.isfinite(change), 0.0, np.abs(change))
    size = 0.0
    for row, axis in np.argwhere(odd):
        around = steps[max(row - AROUND, 0) : row + AROUND, axis]
        turns = np.abs(np.diff(gyr[max(row - AROUND // 2, 0) : row + AROUND // 2 + 1], axis=0))
        struck = kind == "acc" and (np.isnan(turns).all() or np.nanmax(turns) >= IMPACT * away[row, axis])
        if not struck and away[row, axis] > CALM_AROUND * around.max(initial=1e-9):
            spikes[row] = True
            size = max(size, float(away[row, axis]))
    if spikes.any():
        signal, unit = SIGNALS[kind]
        notes.append(
            SPIKES(
                placement=placement, samples=spikes.sum(), signal=signal, size=size, unit=unit,
                begin_s=np.argmax(spikes) / rate,
            )
        )  # fmt: skip
    return spikes


def _wraps(placement: str, kind: str, values: np.ndarray, change: np.ndarray) -> list[Note]:
    """Notes about the channels of a sensor that jump from one end of a common range to the other."""
    notes = []
    largest = np.nanmax(np.abs(change), axis=0, initial=0.0)
    extent = np.nanmax(np.abs(values), axis=0, initial=0.0)
    for axis in np.flatnonzero(largest > WRAP_STEP * extent):
        column = values[:, axis]
        edges = [limit for limit in RANGES[kind] if extent[axis] <= 1.001 * limit]
        if not edges:
            continue
        limit = float(edges[0])
        low, high = np.nanmin(column), np.nanmax(column)
        size = np.abs(change[:, axis])
        # from one limit exactly to the other: a clipped impact
        jumps = int(np.sum((size > WRAP_STEP * limit) & (size < 0.9999 * (high - low))))
        if jumps < WRAPS or high < WRAP_EDGE * limit or low > -WRAP_EDGE * limit:
            continue
        if np.sum((column == low) | (column == high)) >= jumps:
            continue  # a clipped signal stays at its limits; a wrapped one reads each of them by chance
        notes.append(
            WRAPPED(channel=f"{placement} {kind}_{'xyz'[axis]}", times=jumps, value=limit, unit=SIGNALS[kind][1])
        )
    return notes


def _long_runs(same: np.ndarray, rate: float) -> list[tuple[int, int]]:
    """The runs of True that are too long for a sensor that works, see `FROZEN_RUN`."""
    return [(start, end) for start, end in true_runs(same) if end - start >= max(FROZEN_RUN, FROZEN_S * rate)]


def _frozen(
    placement: str, kind: str, values: np.ndarray, change: np.ndarray, gyr: np.ndarray, rate: float, notes: list[Note]
) -> list[tuple[int, int]]:
    """First and last samples of stretches in which the sensor repeats one reading and then jumps."""
    same = ~change.any(axis=1)
    runs = _long_runs(same, rate)
    if not runs:
        return []
    frozen, held = [], _holding(kind, values, change, gyr)
    steps = np.abs(change)
    coarse = kind == "acc" and COARSE <= np.min(steps, where=steps > 0.0, initial=np.inf) < np.inf
    others = [last - first for first, last in true_runs(same) if last < len(same)]
    for start, end in runs:
        least = max(STOPPED_S * rate, STOPPED * max(others, default=1))
        # a coarse accelerometer repeats its reading in standing; it has stopped if the gyroscope has
        stopped = not coarse or not np.nansum(np.abs(np.diff(gyr[start : end + 1], axis=0)))
        stopped &= end == len(same) and end - start >= least and start >= STOPPED_S * rate
        if stopped or held((start, end)):
            frozen.append((start, end))
    return frozen


def _between_new(
    placement: str, kind: str, values: np.ndarray, change: np.ndarray, gyr: np.ndarray, held: np.ndarray, rate: float,
    notes: list[Note],
) -> None:  # fmt: skip
    """If so many readings repeat the one before that the sensor is slower than its file, replace these by straight
    lines between the new ones, or mask them if new ones are rarer than `LEAST_HZ`. `held` (T − 1,) is True where the
    whole sensor, but not all of them, repeats its reading.
    """
    same = ~change.any(axis=1)
    turns = np.linalg.norm(gyr[1:], axis=1) > TURNING if kind == "acc" else np.ones(len(same), bool)
    for start, end in _long_runs(same, rate):
        same[start:end] = False
    share = np.sum(same & turns) / max(np.sum(turns), 1)
    if share <= REPEATS and np.mean(same & held) <= HELD:
        return
    again = 1 + np.flatnonzero(same)
    new = np.setdiff1d(np.flatnonzero(np.isfinite(values).all(axis=1)), again)
    dense = new.size > 0 and rate * (1.0 - share) >= 0.99 * LEAST_HZ  # a clock is a little off its nominal rate
    taken = "straight lines are taken between new readings" if dense else "masked, since new ones are too rare"
    notes.append(SLOWER(placement=placement, signal=SIGNALS[kind][0], percent=100.0 * share, taken=taken))
    values[again] = np.stack([np.interp(again, new, column[new]) for column in values.T], axis=1) if dense else np.nan


def _stuck(
    placement: str, kind: str, values: np.ndarray, change: np.ndarray, gyr: np.ndarray, rate: float, notes: list[Note]
) -> list[tuple[int, int]]:
    """First and last samples of stretches in which one axis repeats its reading while the others go on."""
    stuck = []
    moves = change.any(axis=1)
    for axis in range(values.shape[1]):
        runs = [
            (start, end) for start, end in _long_runs(change[:, axis] == 0.0, rate) if moves[start:end].mean() > 0.5
        ]
        if runs:
            # a turn about the axis of a coarse accelerometer does not change its reading
            across = gyr if kind == "gyr" else np.delete(gyr, axis, axis=1)
            held = _holding(kind, values[:, [axis]], change[:, [axis]], across)
            runs = [run for run in runs if held(run)]
        if runs:
            seconds = sum(end - start + 1 for start, end in runs) / rate
            channel = f"{placement} {kind}_{'xyz'[axis]}"
            notes.append(STUCK(channel=channel, times=len(runs), seconds=seconds, begin_s=runs[0][0] / rate))
            stuck += runs
    return stuck


def _holding(kind: str, values: np.ndarray, change: np.ndarray, gyr: np.ndarray) -> Callable[[tuple[int, int]], bool]:
    """Whether one reading is held from a sample to another while the sensor turns: the signal jumps at an end."""
    steps = np.abs(change)
    resolution = np.min(steps, axis=0, where=steps > 0.0, initial=np.inf)
    low, high = np.nanmin(values, axis=0), np.nanmax(values, axis=0)

    def held(run: tuple[int, int]) -> bool:
        start, end = run
        at_limit = (values[start] == low) | (values[start] == high)
        if (at_limit & (np.abs(values[start]) > FROZEN_CHANGE[kind])).any():
            return False  # a clipped axis, which has a note of its own
        # the change into the stretch, or out of it
        ends = [steps[k] for k in (start - 1, end) if 0 <= k < len(change)]
        # a coarse accelerometer repeats its reading whenever it does not turn
        rates = np.abs(gyr[start : end + 1])
        alone = kind == "gyr" and values.shape == gyr.shape
        turning = alone or np.isnan(rates).all() or np.nanmean(rates) >= TURNING
        return bool(turning) and any(
            ((step > FROZEN_STEPS * resolution) & (step > FROZEN_CHANGE[kind])).any() for step in ends
        )

    return held
