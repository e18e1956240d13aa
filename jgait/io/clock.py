"""The clock of a recording: units of time, order, gaps."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jgait.estimators.checks import FEWEST_SAMPLES
from jgait.notes import DATA_LOST, DEDUCED, Kind, Note
from jgait.quality import SensorQuality, merged
from jgait.types import Recording, RecordingError, as_float

LONGEST_STEP_S = 0.11
"""[s] Longest sample time, of 10 Hz by a clock that is a little off. Longer ones show no strides; methods need less."""

SHORTEST_USUAL_S = 5e-4
"""[s] Shortest sample time for which a unit is deduced: a clock of 32768 Hz makes steps of some hundred ticks, which
would be 3000 Hz in us."""

FEWEST_STAMPS = 4
"""[1] Different time stamps from which the rate of packets follows: two steps, and one more that agrees."""

LONGEST_GAP_S = 10.0
"""[s] Longest gap that is filled; chosen by hand: after a longer one the filters know nothing of the walk."""

REPEATED = 0.01
"""[1] Largest share of rows that repeat the time before them and are left out; with more, they are samples of coarse
stamps. Chosen far above the one repeat in 30 s of `ipol_gait` 11-1."""

BURST = 3.0
"""[1] Steps over the median of stamps in bursts, as of packets that arrive; chosen by hand."""

LONG = 1.5
"""[1] Steps over the usual one in which a sample is lost: half-way from one sample to two."""

IRREGULAR = 8
"""[1] Number of long and short steps in a window of stamps in which they even out, or do not; chosen by hand."""

JITTERY = 0.1
"""[1] Least number of steps below half the median, for each one above one and a half, of stamps that jitter: a stamp
that is late makes a long step and then a short one, a lost sample only a long one. Chosen between the two."""

BESIDE = 8
"""[rows] Number of rows before and after a step whose median lateness is compared: a sample is lost if all that follow
are late. Chosen: few enough for several losses a second, enough for a jitter of half a sample."""

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Unit of time → s."""

CLOCK_BEGINS = Kind(
    "clock_begins", "info", "",
    "Add this time to those of the tables and figures to compare them with the file, or with another system's clock. "
    "Dates with a time zone are in UTC; of a date such as 03/04/2026 day and month may have changed places.",
)  # fmt: skip
"""The time of the first sample in the file, as `begin_s` [s] or as a `date`; times count from it."""
TIMES_CORRECTED = Kind(
    "times_corrected", "corrected", "",
    "A sensor samples evenly. Rows that got the times at which they arrived were moved to even times, signals with "
    "clocks of their own to one clock; all times may be late by about the jitter.",
)  # fmt: skip


RATE_STATED = Kind(
    "rate_stated", "info",
    "there are no time stamps: times follow from the stated sampling rate of {rate_hz:.5g} Hz, which is taken to be "
    "right within {spread:.0%}",
    "If the rate is off by 1 %, times are off by 1 %, and lengths and distances by 2 %; their deviations contain that. "
    "Time stamps in the file make them more certain.",
)  # fmt: skip


class SampleTimes(NamedTuple):
    """The time of each sample."""

    time: np.ndarray  #: (T,) [s] from 0, strictly increasing; steps are one sample time, except for jitter.
    rows: np.ndarray  #: (T,) row of each sample in the input, -1 where a sample was inserted into a gap.
    sampling_rate_hz: float  #: [Hz].
    notes: tuple[Note, ...]  #: notes about the deduced unit and inserted samples.
    begin: float = 0.0  #: time of the first sample in the input, if a note states it [s].


def make_clock(
    samples: int, time: npt.ArrayLike | None, sampling_rate_hz: float | None, time_unit: str | None, name: str,
    again: np.ndarray | None = None,
) -> SampleTimes:  # fmt: skip
    """The clock of so many rows from their time stamps (samples,), or their numbers, a nominal rate [Hz], or both.
    Missing samples are inserted, a unit that is not stated is deduced, and stamps that jitter, are coarse, or come in
    packets become even; all is noted. `again` (samples − 1,) is True before rows that repeat all readings. Raises
    RecordingError for stamps or rates that are no clock of walking.
    """
    if samples < FEWEST_SAMPLES:
        raise RecordingError(f"{name} has {samples} samples; at least {FEWEST_SAMPLES} are needed")
    if sampling_rate_hz is not None and not (np.isfinite(sampling_rate_hz) and sampling_rate_hz > 0):
        raise _rate_needed(f"{name}: {{argument}} must be positive; got {sampling_rate_hz}")
    if sampling_rate_hz is not None and sampling_rate_hz * LONGEST_STEP_S < 1.0:
        least = f"walking needs at least {1.0 / LONGEST_STEP_S:.2g} Hz"
        raise _rate_needed(f"{name}: {{argument}} is {sampling_rate_hz:.4g} Hz; {least}")
    if time is None:
        if sampling_rate_hz is None:
            text = "samples without time stamps, so {argument} is needed; it was not given"
            raise _rate_needed(f"{name} has {samples} {text}")
        return SampleTimes(np.arange(samples) / sampling_rate_hz, np.arange(samples), float(sampling_rate_hz), ())
    stamps, notes = as_float(time), list[Note]()
    if stamps.shape != (samples,):
        raise RecordingError(f"{name}: time must have one value a sample, ({samples},); got shape {stamps.shape}")
    check_order(stamps, name)
    fresh = fresh_rows(stamps, again, notes)
    stamps = stamps[fresh]
    if time_unit is None and count_samples(stamps):
        if sampling_rate_hz is None:
            raise _rate_needed(
                f"{name}: time counts the samples ({stamps[0]:.15g}, {stamps[1]:.15g}, …), so {{argument}} is needed; "
                "if it is in ms at 1000 Hz, call the column 'time_ms'"
            )
        stamps, time_unit = (stamps - stamps[0]) / sampling_rate_hz, "s"
    unit = unit_of_time(stamps, time_unit, name)
    if not time_unit:
        notes.append(time_unit_deduced(unit, stamps))
    begin = float(stamps[0]) * TIME_UNITS[unit]
    seconds, counts, step = steadied((stamps - stamps[0]) * TIME_UNITS[unit], notes)
    begin = begin if abs(begin) > 1.5 * step else 0.0
    if begin:
        first = "times count from the first sample, which has the time {begin_s:.3f} s in the file"
        notes.append(CLOCK_BEGINS.note(first, begin_s=begin))
    # without the rounding of sums, which differs between recordings of different length
    rate = float(f"{1.0 / step:.9g}")
    if sampling_rate_hz is None:
        notes.append(DEDUCED.note(f"sampling rate {rate:.4g} Hz, from the time stamps"))
    elif abs(rate / sampling_rate_hz - 1.0) > 0.05:  # nominal rates differ by less
        raise _rate_needed(
            f"{name}: the time stamps run at {rate:.4g} Hz, but {{argument}} is {sampling_rate_hz:.4g}; "
            "give one of the two, or correct time_unit"
        )
    filled, rows = _fill_gaps(seconds, counts, name, notes)
    rate_hz = float(sampling_rate_hz or rate)
    return SampleTimes(filled, np.where(rows < 0, -1, fresh[rows]), rate_hz, tuple(notes), begin)


def fresh_rows(stamps: np.ndarray, again: np.ndarray | None, notes: list[Note]) -> np.ndarray:
    """The rows of time stamps (n,) without those that repeat the time before, if they are few, or copies (`again`);
    noted.
    """
    same = np.diff(stamps) == 0
    copies = again is not None and np.sum(same & again) >= 0.9 * same.sum()
    if not same.any() or not (copies or same.sum() <= max(REPEATED * len(stamps), 1)):
        return np.arange(len(stamps))
    row = int(np.argmax(same)) + 1
    where = f"the first in row {row} (the first row is 0) at {stamps[row]:.15g}"
    notes.append(DATA_LOST.note(f"rows that repeat the time before left out: {same.sum()}, {where}"))
    return np.flatnonzero(~np.append(False, same))


def _rate_needed(text: str) -> RecordingError:
    return RecordingError(text, argument="sampling_rate_hz")


def check_inserted(samples: int, rows: int, name: str) -> None:
    """Refuse, by a RecordingError, a recording with more than 100 samples for each row, of which nothing is left."""
    if samples > 100 * max(rows, FEWEST_SAMPLES):
        raise RecordingError(
            f"{name}: {rows} rows are spread over {samples} samples; expected at most 100 for each row"
        )


def time_unit_deduced(unit: str, time: np.ndarray) -> Note:
    """The note that the steps of `time` (T,) decided its unit."""
    return DEDUCED.note(f"time taken to be in {unit}, because its steps are {usual_step(time):.4g}")


TIME_SPREAD = 0.01
"""[1] Relative deviation of the interval between samples by a rate that a user states: sensors of this kind sample by
oscillators of their own, with a tolerance of 1 % by the data sheets (MPU-6050: ±1 %)."""


def by_stated_rate(recording: Recording) -> Recording:
    """The recording of a file without time stamps, whose rate only its user states: a fact, and a note on it."""
    facts = dict.fromkeys(recording.sensors, SensorQuality(time_spread=TIME_SPREAD))
    note = RATE_STATED(rate_hz=recording.sampling_rate_hz, spread=TIME_SPREAD)
    quality = merged(recording.quality, facts)
    return recording._replace(quality=quality, notes=(*recording.notes, note))


def count_samples(stamps: np.ndarray) -> bool:
    """Whether a column of times (n,) holds numbers of samples: whole numbers, most of them one after the other."""
    return len(stamps) > 1 and bool((stamps % 1 == 0).all()) and float(np.median(np.diff(stamps))) == 1.0


def unwrapped(counts: np.ndarray) -> np.ndarray | None:
    """(n,) numbers of samples, or of packets of equal size, of a counter that turns at 2¹⁶, as Xsens' do; None of other
    columns.
    """
    numbers = np.unwrap(counts, period=2**16)
    begins = np.flatnonzero(np.diff(numbers, prepend=numbers[:1] - 1))
    sizes = np.diff(begins, append=len(numbers))
    if len(sizes) > 1 and (sizes[:-1] == sizes[0]).all() and sizes[-1] <= sizes[0]:
        numbers = sizes[0] * numbers + np.arange(len(numbers)) - np.repeat(begins, sizes)
    return numbers if count_samples(numbers) else None


def check_order(stamps: np.ndarray, name: str) -> None:
    """Refuse, by a RecordingError with the row, time stamps that are missing, stand still, or decrease by more than
    they jitter; rows in disorder, which can be sorted, are told from a clock that stepped back.
    """
    lost = np.flatnonzero(~np.isfinite(stamps))
    if len(lost):
        raise RecordingError(
            f"{name}: time is missing in {len(lost)} rows, first in row {lost[0]} (the first row is 0): remove these "
            "rows, or fill in their times"
        )
    step = np.diff(stamps)
    if len(np.unique(stamps)) < min(FEWEST_STAMPS, len(stamps)):
        raise _rate_needed(
            f"{name}: time stands still at {stamps[0]:.15g}: leave it out, and give {{argument}}, or export it finer"
        )
    wrong = np.flatnonzero(step < 0)
    if not len(wrong):
        return
    row, ordered = int(wrong[0]) + 1, np.diff(np.sort(stamps))
    where = (
        f"{name}: time runs backwards at row {row} (the first row is 0): {stamps[row]:.15g} follows "
        f"{stamps[row - 1]:.15g}; {len(wrong)} such rows in all"
    )
    usual = float(np.median(ordered))
    if usual > 0 and ordered.min() > 0.5 * usual and (len(wrong) > 1 or ordered.max() < 1.5 * usual):
        raise RecordingError(f"{where}: the rows are in disorder: sort them by time")
    if stamps[-1] <= stamps[0] or -step.min() > 5.0 * (stamps[-1] - stamps[0]) / len(step):
        raise RecordingError(
            f"{where}: the clock stepped back, or another recording begins: split the recording there, and do not sort "
            "the rows, which mixes those of two times"
        )


def _in_bursts(steps: np.ndarray) -> bool:
    """Whether steps (n,) of time are those of packets: most of them far shorter than the mean."""
    middle = float(np.median(steps))
    waits = np.sum(steps > BURST * middle)
    return middle <= 0.0 or bool(steps.mean() > BURST * middle and waits >= max(0.02 * len(steps), FEWEST_STAMPS - 1))


def usual_step(stamps: np.ndarray) -> float:
    """The usual step of time stamps (n,): their median, of stamps in bursts their mean."""
    steps = np.diff(stamps)
    return float(np.mean(steps) if _in_bursts(steps) else np.median(steps))


def unit_of_time(stamps: np.ndarray, stated: str | None, name: str) -> str:
    """The unit of time stamps (n,), n > 1: stated, or as their steps suggest. Raises RecordingError if it is none of
    sensors.
    """
    step = usual_step(stamps)
    lengths = {unit: step * scale for unit, scale in TIME_UNITS.items()}
    unit = stated or next((u for u, length in lengths.items() if SHORTEST_USUAL_S <= length <= LONGEST_STEP_S), None)
    if unit is None:
        rates = ", ".join(f"{1.0 / length:.4g} Hz in {unit}" for unit, length in lengths.items())
        raise RecordingError(
            f"{name}: the time's steps are {step:.4g}, so the sampling rate would be {rates}; "
            f"expected {1.0 / LONGEST_STEP_S:.2g} to {1.0 / SHORTEST_USUAL_S:g} Hz. Write the time in s; divide ticks "
            "of a clock by their number in a second, such as 32768"
        )
    if unit not in TIME_UNITS:
        raise RecordingError(f"{name}: time_unit must be one of {', '.join(map(repr, TIME_UNITS))}; got {unit!r}")
    fits = [candidate for candidate, length in lengths.items() if 1e-4 <= length <= LONGEST_STEP_S]
    if unit in fits:
        return unit
    hint = f"; it seems to be in {' or '.join(fits)}: correct {{argument}}" if fits else ""
    slow = lengths[unit] > LONGEST_STEP_S
    wrong = f"; walking needs at most {LONGEST_STEP_S} s" if slow else ", faster than 10 kHz"
    raise RecordingError(
        f"{name}: with time in {unit}, samples are {lengths[unit]:.4g} s apart{wrong}{hint}",
        argument="time_unit" if fits else "",
    )


def steadied(seconds: np.ndarray, notes: list[Note]) -> tuple[np.ndarray, np.ndarray, float]:
    """Times (n,) [s] without jitter, which is noted, the number of sample times in each step (n-1,), and one [s]. Those
    of a coarse timer or of packets become even, but follow a clock that drifts; others stay as they are.
    """
    steps = np.diff(seconds)
    middle, bursts = float(np.median(steps)), _in_bursts(steps)
    long, short = steps > LONG * middle, steps < 0.5 * middle
    one_way = min(long.sum(), short.sum()) <= JITTERY * max(long.sum(), short.sum())
    coarse = not bursts and one_way and _evens_out(steps, short | long)
    if not (bursts or coarse) and short.sum() <= JITTERY * long.sum():
        # If time stamps are rounded to milliseconds, the mean of the regular steps is more precise than their median.
        step = float(steps[~long].mean())
        return seconds, np.where(steps > LONG * step, np.rint(steps / step).astype(int), 1), step
    # The rows that are alike late: with which packets begin, or after the odd steps of a coarse timer.
    if bursts:
        begins = 1 + np.flatnonzero(steps > BURST * middle)[:-1]  # the last packet may be cut off
    else:
        begins = 1 + np.flatnonzero(np.where(long.sum() > short.sum(), long, short) if coarse else steps > 0.0)
    time, apart = seconds[begins], min(BESIDE * int(np.ceil(BESIDE * len(begins) / len(seconds))), len(begins) // 2)
    step = float(np.median((time[apart:] - time[:-apart]) / (begins[apart:] - begins[:-apart])))
    for _ in range(5):  # losses depend on the sample time, and the other way round
        counts = np.ones(len(steps), int)
        counts[begins[1:] - 1] += _lost(time / step - begins)
        position = np.concatenate([[0], np.cumsum(counts)])
        step = float(np.polyfit(position[begins], time, 1)[0])
    late = seconds - step * position
    # a clock that drifts is followed by medians of 64 rows
    blocks = np.array_split(begins, max(len(begins) // max(64 * len(begins) // len(seconds), BESIDE), 1))
    slow = np.interp(position, [position[b].mean() for b in blocks], [np.median(late[b]) for b in blocks])
    jitters = (
        "the time stamps jitter by {jitter_ms:.2g} ms about samples every {step_ms:.4g} ms; the samples are taken to "
        "be evenly spaced"
    )
    notes.append(TIMES_CORRECTED.note(jitters, jitter_ms=1e3 * float(np.std(late - slow)), step_ms=1e3 * step))
    even = step * position + slow
    return even - even[0], counts, step


def _evens_out(steps: np.ndarray, odd: np.ndarray) -> bool:
    """Whether steps (n,) that are long or short, where `odd`, even out as a coarse timer's do: in windows, time strays
    by less than after random steps, √(π/2 n) standard deviations.
    """
    if odd.sum() < 2 * IRREGULAR:
        return False
    length = int(np.ceil(IRREGULAR / odd.mean()))
    cut = steps[: len(steps) // length * length].reshape(-1, length)
    stray = np.cumsum(cut - cut.mean(axis=1, keepdims=True), axis=1)
    random = np.sqrt(0.5 * np.pi * length) * cut.std(axis=1)
    return bool(np.median(np.ptp(stray, axis=1)) < 0.5 * np.median(random))  # lost samples add up


def _lost(late: np.ndarray) -> np.ndarray:
    """(n-1,) samples lost before each packet but the first: by which all that follow stay `late` (n,) [samples]."""
    beside = max(min(BESIDE, len(late) // 4), 1)
    padded = np.pad(late, beside, mode="median", stat_length=beside)
    medians = np.median(np.lib.stride_tricks.sliding_window_view(padded, beside), axis=1)
    rise = medians[beside + 1 : -1] - medians[1 : -beside - 1]
    signs = np.where(np.abs(rise) > max(0.5, 4.0 * float(np.median(np.abs(rise)))), np.sign(rise), 0.0)
    level = np.zeros(len(late))
    for run in np.split(np.arange(len(rise)), np.flatnonzero(np.diff(signs)) + 1):
        samples = np.rint(rise[run].sum() / beside)
        steps = late[run + 1] - late[run]
        level[run[int(np.argmax(np.sign(samples) * steps))] + 1] += samples if signs[run[0]] else 0.0
    # rows that come late and catch up later, as after a pause of the radio, have lost nothing
    kept = np.minimum.accumulate(np.cumsum(level)[::-1])[::-1]
    return np.diff(kept).astype(int)


def _fill_gaps(seconds: np.ndarray, counts: np.ndarray, name: str, notes: list[Note]) -> tuple[np.ndarray, np.ndarray]:
    """Time with evenly spaced samples inserted into the gaps, and the row of each sample (-1 where inserted)."""
    gaps = np.diff(seconds)
    if (counts == 1).all():
        return seconds, np.arange(len(seconds))
    longest = int(np.argmax(gaps))
    if gaps[longest] > LONGEST_GAP_S:
        raise RecordingError(
            f"{name}: {gaps[longest]:.1f} s are missing after row {longest} (the first row is 0), more than "
            f"{LONGEST_GAP_S:g} s; split the recording there"
        )
    position = np.concatenate([[0], np.cumsum(counts)])
    check_inserted(int(position[-1]) + 1, len(seconds), name)
    rows = np.full(position[-1] + 1, -1)
    rows[position] = np.arange(len(seconds))
    filled = (
        "{gaps} {gaps:gap|gaps} in time, the longest {longest_s:.3g} s after {begin_s:.2f} s; {inserted} "
        "{inserted:sample|samples} inserted and masked"
    )
    many = {"gaps": (counts > 1).sum(), "inserted": (rows < 0).sum()}
    of_all = DATA_LOST._replace(of_all=True)
    notes.append(of_all.note(filled, longest_s=gaps[longest], begin_s=seconds[longest], **many))
    return np.interp(np.arange(len(rows)), position, seconds), rows
