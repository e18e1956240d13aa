"""Sensors of one file on one clock: by packet numbers, by time stamps, or by their sampling rate alone."""

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from jgait.io.clock import (
    LONGEST_GAP_S,
    REPEATED,
    TIME_UNITS,
    TIMES_CORRECTED,
    check_inserted,
    check_order,
    count_samples,
    fresh_rows,
    steadied,
    unit_of_time,
    usual_step,
)  # fmt: skip
from jgait.io.dates import dated, with_time
from jgait.io.names import column_of, unit_in_name
from jgait.notes import AS_READ, DATA_LOST, Note
from jgait.types import RecordingError

if TYPE_CHECKING:
    import pandas as pd

    from jgait.io.part import Part

CLOCKS_APART = 0.5  # [samples] smallest difference between the time stamps of two sensors on different clocks
SAME_RATE = 1e-3  # [1] relative difference below which two sampling rates are equal
SAME_SPEED = 0.05  # [1] relative difference of sample times up to which the first of two clocks is kept; chosen
SINCE_1970 = (1e9, 4e9)  # [s] times that count from 1970: 2001 to 2096
USUAL_RATE = 100.0  # [Hz] assumed rate for the duration of a gap in packet numbers where none is known


def clock_of(table: "pd.DataFrame", name: str) -> tuple[np.ndarray | None, float | None]:
    """Times (T,) [s] by the index of a table or its first clock, and the seconds from 1970 to their 0, if any; None
    without.
    """
    table = with_time(table)
    clocks = [
        column for column in map(str, table.columns)
        if column_of(column) == "time" or re.search("epoc|time|elapsed", column, re.IGNORECASE)
    ]  # fmt: skip
    for column in sorted(clocks, key=lambda column: table[column].dtype.kind not in "iuf"):
        if (dates := dated(table[column])) is not None:
            return dates
        stamps = table[column].to_numpy()
        if stamps.dtype.kind not in "iuf" or len(stamps) < 2 or count_samples(stamps):
            continue
        check_order(stamps.astype(np.float64), name)
        scale = TIME_UNITS[unit_of_time(stamps.astype(np.float64), unit_in_name(column), name)]
        begin_s = scale * float(stamps[0])
        if SINCE_1970[0] < begin_s < SINCE_1970[1]:
            return scale * (stamps - stamps[0]), begin_s
        return scale * stamps, None
    return None, None


def on_one_counter(placed: "dict[str, Part]", name: str, notes: list[Note]) -> "dict[str, Part]":
    """Parts that count packets on the numbers that they share, of one length, NaN where a packet was lost; of a counter
    that wraps, the turn nearest to the first. Raises RecordingError for numbers that cannot be joined.
    """
    if all(part.packets is None for part in placed.values()):
        return placed
    placed, numbers = dict(placed), dict[str, np.ndarray]()
    for where, part in placed.items():
        if part.packets is None:
            raise RecordingError(f"{name}: {where} has no packet numbers, other sensors have; they cannot be joined")
        packets = np.asarray(part.packets, np.int64)
        repeated = np.diff(packets) == 0
        wrong = np.flatnonzero(np.diff(packets) < (0 if repeated.sum() <= REPEATED * len(packets) else 1))
        if len(wrong):
            raise RecordingError(
                f"{name}: packet numbers of {where} must increase; {packets[wrong[0] + 1]} follows "
                f"{packets[wrong[0]]} in row {wrong[0] + 1} (the first row is 0)"
            )
        if repeated.any():
            # it is not known which of two equal rows was measured at that time
            doubt = (np.append(repeated, False) | np.append(False, repeated))[:, None]
            acc = None if part.acc is None else np.where(doubt, np.nan, part.acc)
            placed[where] = part._replace(gyr=np.where(doubt, np.nan, part.gyr), acc=acc)
            twice = ", ".join(map(str, packets[1:][repeated].tolist()))
            notes.append(DATA_LOST.note(f"packet numbers that occur twice are masked: {twice}", placement=where))
        first = next(iter(numbers.values()), packets)
        turn = part.packets_wrap
        numbers[where] = packets + (0 if turn is None else turn * round(float(first[0] - packets[0]) / turn))
    begin, end = max(packets[0] for packets in numbers.values()), min(packets[-1] for packets in numbers.values())
    if end <= begin:
        spans = ", ".join(f"{where} {packets[0]} to {packets[-1]}" for where, packets in numbers.items())
        raise RecordingError(f"{name}: the sensors' packet numbers do not overlap: {spans}")
    for where, part in placed.items():
        packets, length = numbers[where], int(end + 1 - begin)
        kept = (packets >= begin) & (packets <= end)
        gap = int(np.diff(packets).max()) - 1
        if gap > LONGEST_GAP_S * (part.sampling_rate_hz or USUAL_RATE):
            raise RecordingError(
                f"{name}: {gap} packets of {where} are missing in a row, more than {LONGEST_GAP_S:g} s; "
                "split the recording there"
            )
        if not kept.all():
            ends = f"packets at the ends that other sensors do not have left out: {(~kept).sum()}"
            notes.append(AS_READ.note(ends, placement=where))
        check_inserted(length, len(packets), f"{name}, {where}")
        spread = np.full((2, length, 3), np.nan)
        for values, measured in zip(spread, (part.gyr, part.acc), strict=True):
            values[packets[kept] - begin] = np.nan if measured is None else np.asarray(measured, np.float64)[kept]
        acc = None if part.acc is None else spread[1]
        placed[where] = part._replace(gyr=spread[0], acc=acc, time=None, packets=None)
    return placed


def one_clock(
    placed: "Mapping[str, Part]", sensors: dict[str, dict[str, np.ndarray]], rate_hz: float | None, name: str,
    notes: list[Note],
) -> tuple[np.ndarray | None, float | None]:  # fmt: skip
    """Time (T,) [s] and rate [Hz] of all sensors, at least one of them. Signals (T, 3) on clocks of their own are
    interpolated, in place, to the first of the fastest ones. Raises RecordingError if they cannot be joined.
    """
    parts = list(placed.values())
    first = parts[0]
    if all(part.time is None for part in parts):
        rates = {part.sampling_rate_hz for part in parts if part.sampling_rate_hz is not None}
        lengths = {where: len(part.gyr) for where, part in placed.items()}
        if len(set(lengths.values())) > 1 or (rates and max(rates) > (1.0 + SAME_RATE) * min(rates)):
            raise RecordingError(f"{name}: sensors without time stamps must have one rate and length; got {lengths}")
        if rate_hz is None and not rates:
            raise RecordingError(
                f"{name} states neither time stamps nor a sampling rate; give {{argument}} (a 'time' in steps of 1 "
                "counts the samples; in ms, it must be called 'time_ms')",
                argument="sampling_rate_hz",
            )
        return None, rate_hz or rates.pop()
    lost = [where for where, part in placed.items() if part.time is None]
    if lost:
        raise RecordingError(f"{name}: {lost[0]} has no time stamps, other sensors have; they cannot be joined")
    # the signals of each sensor that share a clock
    tracks = [(where, [kind for kind in sensors[where] if kind != "acc" or part.acc_time is None], part.time)
              for where, part in placed.items()]  # fmt: skip
    tracks += [(where, ["acc"], part.acc_time) for where, part in placed.items() if part.acc_time is not None]
    times = [np.asarray(time, np.float64) for _, _, time in tracks]
    if len(tracks) == 1:
        return times[0], rate_hz or first.sampling_rate_hz
    for (where, _, _), stamps in zip(tracks, times, strict=True):
        check_order(stamps, f"{name}, {where}")
    steps = [usual_step(stamps) for stamps in times]
    base = next(i for i, step in enumerate(steps) if step <= (1.0 + SAME_SPEED) * min(steps))
    same = [len(t) == len(times[base]) and np.abs(t - times[base]).max() < CLOCKS_APART * steps[base] for t in times]
    if all(same):
        return times[base], rate_hz or first.sampling_rate_hz
    for i, (where, kinds, _) in enumerate(tracks):
        again = ~np.diff(np.hstack([sensors[where][kind] for kind in kinds]), axis=0).any(axis=1)
        rows, begin = fresh_rows(times[i], again, notes), times[i][0]
        sensors[where] |= {kind: sensors[where][kind][rows] for kind in kinds}
        times[i] = begin + steadied(times[i][rows] - begin, notes)[0]
    begin, end = max(t[0] for t in times), min(t[-1] for t in times)
    if not end > begin:
        raise RecordingError(
            f"{name}: the sensors' clocks do not overlap: one begins at {begin:.3f} s, one ends at {end:.3f} s"
        )
    common = times[base][(times[base] >= begin) & (times[base] <= end)]
    for (where, kinds, _), stamps in zip(tracks, times, strict=True):
        right = np.clip(np.searchsorted(stamps, common), 1, len(stamps) - 1)
        far = stamps[right] - stamps[right - 1] > 1.5 * float(np.median(np.diff(stamps)))  # of a neighbour
        for kind in kinds:
            values = [np.interp(common, stamps, column) for column in sensors[where][kind].T]
            sensors[where][kind] = np.where(far[:, None], np.nan, np.stack(values, axis=1))
    joined = "signals with clocks of their own were interpolated to that of {placement}, {begin_s:.2f} to {end_s:.2f} s"
    notes.append(TIMES_CORRECTED.note(joined, placement=tracks[base][0], begin_s=begin, end_s=end))
    return common, None
