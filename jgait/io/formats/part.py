"""The result of a reader of a file format: the sensors of a file, in the file's units."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jgait.notes import Note


class Part(NamedTuple):
    """One sensor, as its file describes it.

    Attributes:
        label: name of the sensor in the file.
        gyr: (T, 3) angular rate, NaN where lost.
        acc: (T, 3) specific force, NaN where lost; or None.
        time: (T,) [s] on a clock that all parts of the file share, or None.
        sampling_rate_hz: [Hz], or None to take it from `time`.
        gyr_unit: what file or specification state, a key of `jgait.io.arrays.GYR_UNITS`; None: neither does.
        acc_unit: a key of `jgait.io.arrays.ACC_UNITS`; None: neither does.
        placement: the placement, if the file states it beyond doubt; see `jgait.types.PLACEMENTS`.
        axes: what is known of the sensor's axes, in words; empty: nothing.
        packets: (T,) whole numbers of the samples, increasing, by which all parts of the file count; or None. What was
            lost on the way has none. Parts that have them need no `time`.
        packets_wrap: what the sensors' counter counts to before it begins again; None: it does not.
    """

    label: str
    gyr: np.ndarray
    acc: np.ndarray | None = None
    time: np.ndarray | None = None
    sampling_rate_hz: float | None = None
    gyr_unit: str | None = None
    acc_unit: str | None = None
    placement: str | None = None
    axes: str = ""
    packets: np.ndarray | None = None
    packets_wrap: int | None = None


class Measured(NamedTuple):
    """All sensors of a file, or of the files that belong together.

    Attributes:
        parts: one a sensor.
        name: of the recording.
        subject: name of the person.
        notes: notes of the reader.
        feet_range: (T,) distance of the left ankle from the right leg at the samples of the sensors, which must be on
            one clock, NaN where nothing was measured; or None. Its unit, one of `jgait.io.checks.RANGE_UNITS`, is told.
    """

    parts: Sequence[Part]
    name: str
    subject: str = "subject"
    notes: tuple[Note, ...] = ()
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
