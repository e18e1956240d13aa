"""What several loaders share: notes, files of a recording, columns, packet counters, a sensor on one foot."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jgait.datasets import registry
from jgait.io.formats import devices
from jgait.notes import AS_READ, DATA_LOST, LEFT_OUT, Kind, Note
from jgait.types import SIDES, AnyArray, Imu, RecordingError, Strides

if TYPE_CHECKING:
    import pandas as pd

SIDE_UNKNOWN = Kind(
    "side_unknown",
    "info",
    "which foot it was is not known; called foot_right",
    "Results of the right foot may be those of the left.",
)

AXES_TURNED = AS_READ.note("z down upstream: sensor axes turned half a turn about x")

FLIP = np.array([1.0, -1.0, -1.0])
"""Half a turn about x, a proper rotation: converts readings of a sensor with z down to axes with z up."""

SHORTEST_STRIDE_M = 0.1
"""[m] Shortest stride between two footprints; at a smaller distance the foot was put down again on the spot. Chosen by
hand."""


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
            self.notes.append(
                LEFT_OUT.note(
                    f"{error.dataset} lacks {error.file}; jgait.datasets.fetch({error.dataset!r}) gets it",
                )
                if absent is None
                else absent
            )
            return None


def table(path: Path, columns: Sequence[str], **options: Any) -> "pd.DataFrame":
    """A text file, read with the options of `pandas.read_csv`. Raises RecordingError if it lacks one of the columns."""
    import pandas as pd

    content = pd.read_csv(path, **options)
    lacking = [column for column in columns if column not in content.columns]
    if lacking:
        raise RecordingError(f"{path.name} has no column {lacking[0]}; it has {', '.join(map(str, content.columns))}")
    return content


def xsens(path: Path) -> tuple[np.ndarray, float | None]:
    """(n, 7) packet number, gyroscope [rad/s], accelerometer [m/s²] of Xsens' text; and its stated rate [Hz]."""
    (part,) = devices.FORMATS["mtw"].measured(path).parts
    if part.packets is None or part.acc is None or len(part.packets) < 2:
        raise RecordingError(f"{path.name} has no numbers of packets, or one sample; at least 2 are needed")
    return np.column_stack([part.packets, part.gyr, part.acc]), part.sampling_rate_hz


def on_counter(
    tables: Mapping[str, np.ndarray], first: int, length: int, rate_hz: float, notes: list[Note]
) -> dict[str, Imu]:
    """Sensors at `length` packets from number `first` on, time from 0; missing packets are masked, and noted. `tables`
    have (n, 7) packet number, gyroscope [rad/s], accelerometer [m/s²]; rows that are not finite count as missing.
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
            notes.append(DATA_LOST.note(f"samples masked: {(~mask).sum()} of {length}", placement=placement))
    return sensors


def foot_imu(name: str, time: np.ndarray, gyr: np.ndarray, acc: np.ndarray) -> tuple[Imu, float]:
    """A sensor [rad/s, m/s²] with time from 0, non-finite samples masked; and its sampling rate [Hz] from the median
    step. Raises RecordingError if the shapes do not fit or time does not increase.
    """
    if time.ndim != 1 or len(time) < 2 or gyr.shape != (len(time), 3) or acc.shape != (len(time), 3):
        raise RecordingError(
            f"{name} must have at least 2 samples of time (T,), gyroscope (T, 3) and accelerometer (T, 3); "
            f"got {time.shape}, {gyr.shape} and {acc.shape}"
        )
    back = np.flatnonzero(~(np.diff(time) > 0))
    if len(back):
        raise RecordingError(f"{name}: time must run forwards; it does not after sample {back[0]}, {time[back[0]]} s")
    mask = np.isfinite(gyr).all(axis=1) & np.isfinite(acc).all(axis=1)
    gyr, acc = np.where(mask[:, None], gyr, 0.0), np.where(mask[:, None], acc, 0.0)
    return Imu(time - time[0], gyr, acc, mask), float(1.0 / np.median(np.diff(time)))


def way(time: AnyArray, position: AnyArray, arrived: AnyArray, left: AnyArray) -> np.ndarray:
    """Distance along footprints (T,) [m]: constant while the foot stands on `position` (n, 2 or 3) [m], from when it
    `arrived` until it `left` (n,) [s], linear in time between; height does not count.
    """
    if len(position) == 0:
        return np.zeros_like(time)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position[:, :2], axis=0), axis=1))])
    return np.interp(time, np.stack([arrived, left], axis=1).ravel(), np.repeat(along, 2))


def footprint_strides(
    side: str, position: np.ndarray, arrived: np.ndarray, left: np.ndarray, whole: np.ndarray | None = None
) -> Strides:
    """Strides from footprint to footprint as of `way`, fields (n − 1,); contacts, widths and heights are not known.
    `whole` (n − 1,) is False where a footprint may be missing between two.
    """
    length = np.linalg.norm(np.diff(position[:, :2], axis=0), axis=1)
    valid = (length > SHORTEST_STRIDE_M) & (True if whole is None else whole)
    nothing = np.full(length.size, np.nan)
    return Strides(
        side=np.full(length.size, SIDES.index(side)), start=None, final_contact=None, end=None, length=length,
        width=nothing, height=nothing, valid=valid, standing=left[:-1], standing_end=arrived[1:],
    )  # fmt: skip
