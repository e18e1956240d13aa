"""The reference of a recording of a cohort: a distance, or files of samples and of strides."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jgait import io
from jgait.io.strides import TIMES
from jgait.io.text import read_table
from jgait.notes import Kind
from jgait.quality import of_sensor
from jgait.types import Recording, Walk

if TYPE_CHECKING:
    import pandas as pd

REFERENCES = ("reference_samples", "reference_strides")
"""Columns of files with a reference, see `io.reference_from_tables`."""

REFERENCE_TIMES = ("time_s", *(f"{name}_s" for name in TIMES))
"""Columns of times in these files."""

DISTANCE_NOT_USED = Kind(
    "reference_distance_not_used", "check", "distance_m of the table is not used, because {file} has no such column",
    "The reference is that file's. Write the distance walked so far into it to compare the distance as well.",
)  # fmt: skip
DISTANCE_CONTRADICTED = Kind(
    "reference_distance_contradicted", "check",
    "distance_m of the table, {stated:.4g} m, is not used: {file} has {walked:.4g} m",
    "The distance is compared with that of the file. One of the two is wrong.",
)  # fmt: skip

DIFFERENT = 0.1
"""[1] Share by which two distances of one walk may differ, chosen: larger than errors of a tape or of a path's sway."""

COVERED = 0.9
"""[1] Share of the recording in which a file has samples, chosen: with less, the file may lack a part of the walk."""


def with_reference(
    recording: Recording, way: float | None, files: Sequence[Path | None], info: dict[str, object]
) -> Walk:
    """A recording with the reference of its row: a distance [m], or None, and files of samples and of strides."""
    placement, imu = next(iter(recording.sensors.items()))
    time = np.asarray(imu.time, float)
    if not any(files):
        return Walk(recording, None if way is None else io.reference_from_tables(time, distance=way), info)
    begins = of_sensor(recording.quality, placement).begin
    absent = next((file for file in files if file is not None and not file.exists()), None)
    if absent is not None:
        raise FileNotFoundError(f"there is no such file: {absent}")
    tables = (None if file is None else _from_first(read_table(file)[0], begins) for file in files)
    reference = io.reference_from_tables(time, *tables)
    if reference.distance is not None and way is not None and files[0] is not None:
        known = np.asarray(reference.valid, bool)
        so_far = np.asarray(reference.distance, float)[known]
        walked = float(so_far[-1] - so_far[0])  # as it is compared; the body sways beyond it
        part = float(np.mean(known)) < COVERED
        if walked > (1.0 + DIFFERENT) * way or (walked < (1.0 - DIFFERENT) * way and not part):
            note = DISTANCE_CONTRADICTED(stated=way, file=files[0].name, walked=walked)
            recording = recording._replace(notes=(*recording.notes, note))
    if reference.distance is None and way is not None:
        if files[0] is not None:
            note = DISTANCE_NOT_USED(file=files[0].name)
            return Walk(recording._replace(notes=(*recording.notes, note)), reference, info)
        whole = io.reference_from_tables(time, distance=way)
        reference = reference._replace(distance=whole.distance, valid=whole.valid)
    return Walk(recording, reference, info)


def _from_first(table: "pd.DataFrame", begins: float) -> "pd.DataFrame":
    """A table of a reference whose times count from a sample with this time in the file [s]."""
    times = {name: table[name] - begins for name in table.columns if name in REFERENCE_TIMES}
    return table.assign(**times) if begins else table
