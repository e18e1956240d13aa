"""The result of a reader of a file format: the sensors of a file, in the file's units."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jgait.io.dates import date_of
from jgait.notes import Kind, Note
from jgait.types import RecordingError

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
