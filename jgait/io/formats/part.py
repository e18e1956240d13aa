"""The result of a reader of a file format: the sensors of a file, in the file's units."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jgait.notes import Note


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
    axes: str = ""  #: what is known of the sensor's axes, in words; empty: nothing.
    #: (T,) whole numbers of the samples, increasing, by which all parts of the file count; or None. What was lost on
    #: the way has none. Parts that have them need no `time`.
    packets: np.ndarray | None = None
    packets_wrap: int | None = None  #: what the sensors' counter counts to before it begins again; None: it does not.
    units_by: str = "file"  #: what states the units, a key of `jgait.io.units.STATES`.


class Measured(NamedTuple):
    """All sensors of a file, or of the files that belong together."""

    parts: Sequence[Part]  #: one a sensor.
    name: str  #: of the recording.
    subject: str = ""  #: name of the person; "" where the file states none.
    notes: tuple[Note, ...] = ()  #: notes of the reader.
    #: (T,) distance of the left ankle from the right leg at the samples of the sensors, which must be on one clock, NaN
    #: where nothing was measured; or None. Its unit, one of `jgait.io.checks.RANGE_UNITS`, is told.
    feet_range: np.ndarray | None = None


def joined(every: Sequence[Measured], name: str | None = None) -> Measured:
    """Files of one walk as one, each note once; sensors that are called the same are called by their files."""
    notes = tuple(dict.fromkeys(note for measured in every for note in measured.notes))
    labels = [part.label for measured in every for part in measured.parts]
    parts = [
        part._replace(label=measured.name) if len(measured.parts) == 1 and labels.count(part.label) > 1 else part
        for measured in every
        for part in measured.parts
    ]
    return Measured(parts, name or every[0].name, every[0].subject, notes)
