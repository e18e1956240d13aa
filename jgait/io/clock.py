"""The clock of a recording: units of time, order, gaps."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jgait.estimators.checks import FEWEST
from jgait.notes import DEDUCED, LOSSES, Kind, Note
from jgait.types import RecordingError, as_float

LONGEST_STEP_S = 0.5  # [s] longest sample time: longer steps in s are in fact ms
SHORTEST_STEP_S = 1e-4  # [s] shortest sample time: shorter steps are in the other unit
LONGEST_GAP_S = 10.0
MOST_INSERTED = 100  # samples for each row of a file; with more, nothing of the recording is left
BURST, PACKETS = 3.0, 0.02  # [1] mean step over the median, and share of longer steps, of stamps in bursts; chosen
REPEATED = 0.01
"""[1] Largest share of rows that repeat the time, or the packet number, before them; with more, the column is no clock.
A single repeated time always is left out. Chosen far above the one repeat in 30 s of `ipol_gait` 11-1."""

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}

RATE_DEDUCED = Kind("sampling_rate_deduced", "info", "sampling rate {rate_hz:.4g} Hz, from the time stamps", DEDUCED)
TIME_UNIT_DEDUCED = Kind(
    "time_unit_deduced", "info", "time taken to be in {unit}, because its steps are {step:.4g}", DEDUCED
)
CLOCK_FROM_FIRST = Kind(
    "clock_from_first", "info", "times count from the first sample, which has the time {begin_s:.3f} s in the file",
    "Add this time to those of the tables and figures to compare them with the file, or with another system's clock.",
)  # fmt: skip
STAMPS_REPEATED = Kind(
    "stamps_repeated", "check",
    "{rows} {rows:row that repeats|rows that repeat} the time before {rows:is|are} left out, the first in row {row} "
    "(the first row is 0) at {time}",
    LOSSES,
)  # fmt: skip
GAPS_FILLED = Kind(
    "gaps_filled", "check",
    "{gaps} {gaps:gap|gaps} in time, the longest {longest_s:.3g} s after {begin_s:.2f} s; {inserted} "
    "{inserted:sample|samples} inserted and masked",
    LOSSES,
)  # fmt: skip


class SampleTimes(NamedTuple):
    """The time of each sample."""

    time: np.ndarray  #: (T,) [s] from 0, strictly increasing; steps are one sample time, except for jitter.
    rows: np.ndarray  #: (T,) row of each sample in the input, -1 where a sample was inserted into a gap.
    sampling_rate_hz: float  #: [Hz].
    notes: tuple[Note, ...]  #: notes about the deduced unit and inserted samples.


def make_clock(
    samples: int, time: npt.ArrayLike | None, sampling_rate_hz: float | None, time_unit: str | None, name: str
) -> SampleTimes:
    """The clock of so many rows from their time stamps (samples,), a nominal rate [Hz], or both.

    Missing samples are inserted where time increases by more than one and a half sample times; they have no row. A unit
    that is not stated ('s', 'ms' or 'us') is deduced from the size of the steps, and noted. Of the few rows of one time
    the first is taken.

    Raises:
        RecordingError: if there are too few samples, no clock, or time stamps that are missing, repeat often, decrease,
            are in none of these units, or contradict the sampling rate.
    """
    if samples < FEWEST:
        raise RecordingError(f"{name} has {samples} samples; at least {FEWEST} are needed")
    if sampling_rate_hz is not None and not (np.isfinite(sampling_rate_hz) and sampling_rate_hz > 0):
        raise RecordingError(
            f"{name}: {{argument}} must be positive; got {sampling_rate_hz}", argument="sampling_rate_hz"
        )
    if time is None:
        if sampling_rate_hz is None:
            raise RecordingError(
                f"{name} has {samples} samples without time stamps, so {{argument}} is needed; it was not given",
                argument="sampling_rate_hz",
            )
        return SampleTimes(np.arange(samples) / sampling_rate_hz, np.arange(samples), float(sampling_rate_hz), ())
    stamps = as_float(time)
    if stamps.shape != (samples,):
        raise RecordingError(f"{name}: time must have one value a sample, ({samples},); got shape {stamps.shape}")
    check_order(stamps, name)
    fresh = np.flatnonzero(np.concatenate([[True], np.diff(stamps) > 0]))
    notes: list[Note] = []
    if len(fresh) < samples:
        row = int(np.flatnonzero(np.diff(stamps) == 0)[0]) + 1
        notes.append(STAMPS_REPEATED(rows=samples - len(fresh), row=row, time=f"{stamps[row]:.15g}"))
        stamps = stamps[fresh]
    unit = unit_of_time(stamps, time_unit, name)
    if not time_unit:
        notes.append(TIME_UNIT_DEDUCED(unit=unit, step=float(np.median(np.diff(stamps)))))
    seconds = (stamps - stamps[0]) * TIME_UNITS[unit]
    step = float(np.median(np.diff(seconds)))
    if abs(begin := float(stamps[0]) * TIME_UNITS[unit]) > 1.5 * step:
        notes.append(CLOCK_FROM_FIRST(begin_s=begin))
    # If time stamps are rounded to milliseconds, the mean of the regular steps is more precise than their median.
    steps = np.diff(seconds)
    # without the rounding of sums, which differs between recordings of different length
    rate = float(f"{1.0 / float(steps[steps < 1.5 * step].mean()):.9g}")
    if sampling_rate_hz is None:
        notes.append(RATE_DEDUCED(rate_hz=rate))
    elif abs(rate / sampling_rate_hz - 1.0) > 0.05:
        raise RecordingError(
            f"{name}: the time stamps run at {rate:.4g} Hz, but {{argument}} is {sampling_rate_hz:.4g}; "
            "give one of the two, or correct time_unit",
            argument="sampling_rate_hz",
        )
    filled, rows = _fill_gaps(seconds, 1.0 / rate, name, notes)
    rows = np.where(rows < 0, -1, fresh[rows])
    return SampleTimes(filled, rows, float(sampling_rate_hz or rate), tuple(notes))


def check_inserted(samples: int, rows: int, name: str) -> None:
    """Refuse a recording that would consist of inserted samples.

    Raises:
        RecordingError: if there are more than `MOST_INSERTED` samples for each row.
    """
    if samples > MOST_INSERTED * max(rows, FEWEST):
        raise RecordingError(
            f"{name}: {rows} rows are spread over {samples} samples; expected at most {MOST_INSERTED} for each row"
        )


def check_order(stamps: np.ndarray, name: str) -> None:
    """Refuse time stamps that are missing, decrease, or repeat the one before in more than the share `REPEATED`.

    Raises:
        RecordingError: with the number of the first such row.
    """
    lost = np.flatnonzero(~np.isfinite(stamps))
    if len(lost):
        raise RecordingError(
            f"{name}: time is missing in {len(lost)} rows, first in row {lost[0]} (the first row is 0)"
        )
    step = np.diff(stamps)
    few = np.sum(step == 0) <= max(REPEATED * len(stamps), 1)
    wrong = np.flatnonzero(step < 0 if few else step <= 0)
    if len(wrong):
        row = int(wrong[0]) + 1
        what, advice = "runs backwards", "sort the rows, or split the recording there"
        if step[row - 1] == 0:
            what = "repeats"
            advice = f"at most {100 * REPEATED:g} % are left out; drop them, such as with pandas' drop_duplicates"
        raise RecordingError(
            f"{name}: time {what} at row {row} (the first row is 0): {stamps[row]:.15g} follows "
            f"{stamps[row - 1]:.15g}; {len(wrong)} such rows in all: {advice}"
        )


def unit_of_time(stamps: np.ndarray, stated: str | None, name: str) -> str:
    """The unit of increasing time stamps (n,), n > 1: the stated one, or else the one that their steps suggest.

    Raises:
        RecordingError: for an unknown unit, for one in which no sensor samples, and for stamps that come in bursts.
    """
    step = float(np.median(np.diff(stamps)))
    _check_bursts(np.diff(stamps), step, stated, name)
    unit = stated or next((unit for unit, scale in TIME_UNITS.items() if step * scale <= LONGEST_STEP_S), "us")
    if unit not in TIME_UNITS:
        raise RecordingError(f"{name}: time_unit must be one of {', '.join(map(repr, TIME_UNITS))}; got {unit!r}")
    length = step * TIME_UNITS[unit]
    if SHORTEST_STEP_S <= length <= LONGEST_STEP_S:
        return unit
    fits = [unit for unit, scale in TIME_UNITS.items() if SHORTEST_STEP_S <= step * scale <= LONGEST_STEP_S]
    hint = f"; it seems to be in {' or '.join(fits)}: correct {{argument}}" if fits else ""
    wrong = f"; walking needs at most {LONGEST_STEP_S} s" if length > LONGEST_STEP_S else ", faster than 10 kHz"
    raise RecordingError(
        f"{name}: with time in {unit}, samples are {length:.4g} s apart{wrong}{hint}",
        argument="time_unit" if fits else "",
    )


def _check_bursts(steps: np.ndarray, median: float, stated: str | None, name: str) -> None:
    """Refuse stamps of packets, whose samples have the time at which the packet arrived, almost."""
    long = steps > BURST * median
    if steps.mean() <= BURST * median or long.mean() < PACKETS:
        return
    mean, period = float(steps.mean()), float(np.median(steps[long]))
    guess = next((unit for unit, scale in TIME_UNITS.items() if mean * scale <= LONGEST_STEP_S), "us")
    unit = stated if stated in TIME_UNITS else guess
    rate = 1.0 / (mean * TIME_UNITS[unit])
    raise RecordingError(
        f"{name}: the time stamps come in bursts: rows are {median:.3g} {unit} apart, then {period:.3g} {unit}, as in "
        f"packets sent by radio; there are {rate:.4g} rows a second. Leave out the time and give {{argument}}",
        argument="sampling_rate_hz",
    )


def _fill_gaps(seconds: np.ndarray, step: float, name: str, notes: list[Note]) -> tuple[np.ndarray, np.ndarray]:
    """Time with evenly spaced samples inserted into the gaps, and the row of each sample (-1 where inserted)."""
    gaps = np.diff(seconds)
    counts = np.where(gaps > 1.5 * step, np.rint(gaps / step).astype(int), 1)
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
    notes.append(
        GAPS_FILLED(
            gaps=(counts > 1).sum(), longest_s=gaps[longest], begin_s=seconds[longest], inserted=(rows < 0).sum()
        )
    )
    return np.interp(np.arange(len(rows)), position, seconds), rows
