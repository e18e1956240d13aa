"""What a reader gives: the sensors of a file, in the file's units, and how sensors come to one clock."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jgait.io.clock import (
    LONGEST_GAP_S,
    REPEATED,
    TIMES_CORRECTED,
    check_inserted,
    check_order,
    fresh_rows,
    steadied,
    usual_step,
)
from jgait.io.dates import date_of
from jgait.notes import AS_READ, DATA_LOST, Kind, Note
from jgait.types import RecordingError

CLOCKS_APART = 0.5
"""[samples] Smallest difference between the time stamps of two sensors on different clocks; below it, samples are those
of one time."""

SAME_RATE = 1e-3
"""[1] Relative difference below which two sampling rates are equal: nominal rates are written with three digits."""

UP_UNSURE = Kind(
    "up_unsure", "check", "",
    "The file does not show beyond doubt which way is up. With a wrong vertical, heights and directions are wrong, and "
    "right and left of a sensor at the waist are exchanged. POINT:Y_SCREEN of a C3D file is the vertical of a "
    "program's view, which some programs write otherwise than the laboratory's.",
)  # fmt: skip
"""The direction of an axis that a reader assumes."""


class Part(NamedTuple):
    """One sensor, as its file describes it."""

    label: str  #: name of the sensor in the file.
    gyr: np.ndarray  #: (T, 3) angular rate, NaN where lost.
    acc: np.ndarray | None = None  #: (T, 3) specific force, NaN where lost; or None.
    time: np.ndarray | None = None  #: (T,) [s] on a clock that all parts of the file share, or None.
    sampling_rate_hz: float | None = None  #: [Hz], or None to take it from `time`.
    #: what file or specification state, a key of `jgait.io.units.GYR_UNITS`; None: neither does.
    gyr_unit: str | None = None
    acc_unit: str | None = None  #: a key of `jgait.io.units.ACC_UNITS`; None: neither does.
    placement: str | None = None  #: the placement, if the file states it beyond doubt; see `jgait.types.PLACEMENTS`.
    stated: bool = False  #: whether the caller states the placement.
    #: (T,) whole numbers of the samples, increasing, by which all parts of the file count; or None. What was lost on
    #: the way has none. Parts that have them need no `time`.
    packets: np.ndarray | None = None
    packets_wrap: int | None = None  #: what the sensors' counter counts to before it begins again; None: it does not.
    units_by: str = "file"  #: what states the units, a key of `jgait.io.units.STATES`.
    begin_s: float | None = None  #: [s] from 1970 to 0 of `time`, where the file has dates.
    #: (A,) [s] of the samples of `acc`, (A, 3), where they have times of their own, from the same 0 as `time`; or None.
    acc_time: np.ndarray | None = None


class Measured(NamedTuple):
    """All sensors of a file, or of the files that belong together."""

    parts: Sequence[Part]  #: one a sensor.
    name: str  #: of the recording.
    subject: str = ""  #: name of the person; "" where the file states none.
    notes: tuple[Note, ...] = ()  #: notes of the reader.
    #: (T,) distance of the left ankle from the right leg at the samples of the sensors, which must be on one clock, NaN
    #: where nothing was measured; or None. Its unit, one of `jgait.io.checks.sizes.RANGE_UNITS`, is told.
    feet_range: np.ndarray | None = None
    unread: tuple[str, ...] = ()  #: columns that are not of sensors.


def joined(every: Sequence[Measured], name: str | None = None) -> Measured:
    """Files of one walk as one, each note once; sensors that are called the same are called by their files. Raises
    RecordingError if some files have dates and others numbers, or dates have nothing in common.
    """
    notes = tuple(dict.fromkeys(note for measured in every for note in measured.notes))
    labels = [part.label for measured in every for part in measured.parts]
    parts = [
        part._replace(label=measured.name) if len(measured.parts) == 1 and labels.count(part.label) > 1 else part
        for measured in every
        for part in measured.parts
    ]
    called = name or every[0].name
    return Measured(on_one_zero(parts, called), called, every[0].subject, notes)


def on_one_zero(parts: list[Part], name: str) -> list[Part]:
    """The parts with one 0 of their times, where the last of them begins, if they have dates; errors as of `joined`."""
    spans = [
        (part.begin_s, part.begin_s + float(np.nanmax(part.time)), part.label)
        for part in parts if part.begin_s is not None and part.time is not None
    ]  # fmt: skip
    if not spans:
        return parts
    if numbers := [part.label for part in parts if part.time is not None and part.begin_s is None]:
        raise RecordingError(
            f"{name}: the time of {spans[0][2]} has dates, that of {numbers[0]} has none; they cannot be joined: write "
            "the same kind of times in all files"
        )
    begin_s, _, last = max(spans)
    _, end_s, first = min(spans, key=lambda span: span[1])
    if begin_s >= end_s:
        raise RecordingError(
            f"{name}: the sensors' clocks do not overlap: {last} begins at {date_of(begin_s)}, {first} ends at "
            f"{date_of(end_s)}"
        )

    def since(time: np.ndarray | None, part: Part) -> np.ndarray | None:
        shift = 0.0 if part.begin_s is None else part.begin_s - begin_s
        return None if time is None else np.round(time + shift, 6)  # a double since 1970

    return [
        part._replace(
            time=since(part.time, part), acc_time=since(part.acc_time, part),
            begin_s=None if part.begin_s is None else begin_s,
        )
        for part in parts
    ]  # fmt: skip


def on_one_counter(placed: dict[str, Part], name: str, notes: list[Note]) -> dict[str, Part]:
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
        if gap > LONGEST_GAP_S * (part.sampling_rate_hz or 100.0):
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
    placed: Mapping[str, Part], sensors: dict[str, dict[str, np.ndarray]], rate_hz: float | None, name: str,
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
    base = next(i for i, step in enumerate(steps) if step <= 1.05 * min(steps))  # clocks of one rate differ by less
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
