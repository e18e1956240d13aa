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


def with_reference(
    recording: Recording, way: float | None, files: Sequence[Path | None], info: dict[str, object]
) -> Walk:
    """A recording with the reference of its row: a distance [m], or None, and files of samples and of strides."""
    placement, imu = next(iter(recording.sensors.items()))
    time = np.asarray(imu.time, float)
    whole = None if way is None else io.reference_from_tables(time, distance=way)
    if not any(files):
        return Walk(recording, whole, info)
    begins = of_sensor(recording.quality, placement).begin
    for file in files:
        if file is not None and not file.exists():
            raise FileNotFoundError(f"there is no such file: {file}")
    tables = (None if file is None else _from_first(read_table(file)[0], begins) for file in files)
    reference, samples = io.reference_from_tables(time, *tables), files[0]
    if reference.distance is None and whole is not None and samples is None:
        reference = reference._replace(distance=whole.distance, valid=whole.valid)
    elif reference.distance is None and samples is not None and way is not None:
        recording = recording._replace(notes=(*recording.notes, DISTANCE_NOT_USED(file=samples.name)))
    return Walk(recording, reference, info)


def _from_first(table: "pd.DataFrame", begins: float) -> "pd.DataFrame":
    """A table of a reference whose times count from a sample with this time in the file [s]."""
    times = {name: table[name] - begins for name in table.columns if name in REFERENCE_TIMES}
    return table.assign(**times) if begins else table
