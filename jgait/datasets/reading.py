"""What several loaders do: find the files of a recording, read columns, put sensors on one packet counter."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jgait.datasets import registry
from jgait.datasets.notes import FILE_ABSENT, SAMPLES_MASKED
from jgait.notes import Note
from jgait.types import Imu, RecordingError

if TYPE_CHECKING:
    import pandas as pd


class Files:
    """The files of one recording.

    Attributes:
        dataset: name of the set.
        notes: notes about the recording, also about absent files.
        verified: whether the sha256 of every file found so far is listed and agrees.
    """

    def __init__(self, dataset: str, *notes: Note) -> None:
        self.dataset, self.notes, self.verified = dataset, list(notes), True

    def need(self, path: str) -> Path:
        """One file at its upstream path. Raises DatasetUnavailable if it is not on this computer."""
        local, known = registry.file(self.dataset, path)
        self.verified &= known
        return local

    def find(self, path: str, absent: Note | None = None) -> Path | None:
        """One file; None, with the note `absent`, if it is not on this computer."""
        try:
            return self.need(path)
        except registry.DatasetUnavailable as error:
            self.notes.append(FILE_ABSENT(dataset=error.dataset, file=error.file) if absent is None else absent)
            return None


def table(path: Path, columns: Sequence[str], **options: Any) -> "pd.DataFrame":
    """A text file, read with the options of `pandas.read_csv`. Raises RecordingError if it lacks one of the columns."""
    import pandas as pd

    content = pd.read_csv(path, **options)
    lacking = [column for column in columns if column not in content.columns]
    if lacking:
        raise RecordingError(f"{path.name} has no column {lacking[0]}; it has {', '.join(map(str, content.columns))}")
    return content


def samples(path: Path, columns: Sequence[str], **options: Any) -> np.ndarray:
    """(n, columns) numbers, otherwise as `table`. Raises RecordingError also for fewer than two rows."""
    values = table(path, columns, **options)[list(columns)].to_numpy(np.float64)
    if len(values) < 2:
        raise RecordingError(f"{path.name} has {len(values)} samples; at least 2 are needed")
    return values


def on_counter(
    tables: Mapping[str, np.ndarray], first: int, length: int, rate_hz: float, notes: list[Note]
) -> dict[str, Imu]:
    """Sensors at `length` packets from number `first` on, time from 0; missing packets are masked, and noted.

    Args:
        tables: placement → (n, 7) packet number, gyroscope [rad/s], accelerometer [m/s²]; rows that are not finite
            count as missing.
        first: number of the first packet.
        length: number of packets.
        rate_hz: [Hz] packets in a second.
        notes: notes are added here.
    """
    sensors = {}
    for placement, values in tables.items():
        row = np.nan_to_num(values[:, 0], nan=first - 1).astype(np.int64) - first
        keep = (row >= 0) & (row < length) & np.isfinite(values).all(axis=1)
        mask, signals = np.zeros(length, bool), np.zeros((length, 6))
        mask[row[keep]] = True
        signals[row[keep]] = values[keep, 1:]
        sensors[placement] = Imu(np.arange(length) / rate_hz, signals[:, :3], signals[:, 3:], mask)
        if not mask.all():
            notes.append(SAMPLES_MASKED(placement=placement, masked=(~mask).sum(), samples=length))
    return sensors
