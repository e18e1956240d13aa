"""The reference of a recording of a cohort: a distance, or files of samples and of strides."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jgait.io.clock import CLOCK_FROM_FIRST
from jgait.io.strides import TIMES
from jgait.types import Estimate, Legs, Recording

if TYPE_CHECKING:
    import pandas as pd

REFERENCES = ("reference_samples", "reference_strides")
"""Columns of files with a reference, see `io.reference_from_tables`."""

REFERENCE_TIMES = ("time_s", *(f"{name}_s" for name in TIMES))
"""Columns of times in these files."""

AT_ENDS = 0.25
"""[s] Length of the standing at both ends of a recording, where the distance is 0 and the whole distance."""


def reference_of(recording: Recording, way: float | None, files: Sequence[Path | None]) -> Estimate | None:
    """The reference of a row: its distance [m], and what its files of samples and of strides have."""
    import pandas as pd

    from jgait import io

    if not any(files):
        return None if way is None else _walked(recording, way)
    absent = next((file for file in files if file is not None and not file.exists()), None)
    if absent is not None:
        raise FileNotFoundError(f"there is no such file: {absent}")
    time = np.asarray(next(iter(recording.sensors.values())).time, float)
    begins = sum(float(str(note.values["begin_s"])) for note in recording.notes if note.code == CLOCK_FROM_FIRST.code)
    tables = (None if file is None else _from_first(pd.read_csv(file), begins) for file in files)
    found = io.reference_from_tables(time, *tables)
    if found.distance is not None or way is None:
        return found
    whole = _walked(recording, way)
    return found._replace(distance=whole.distance, valid=whole.valid) if files[0] is None else found


def _from_first(table: "pd.DataFrame", begins: float) -> "pd.DataFrame":
    """A table of a reference whose times count from a sample with this time in the file [s]."""
    times = {name: table[name] - begins for name in table.columns if name in REFERENCE_TIMES}
    return table.assign(**times) if begins else table


def _walked(recording: Recording, way: float) -> Estimate:
    """A reference with the whole distance only: 0 m at the start of the recording, the whole distance at the end."""
    time = np.asarray(next(iter(recording.sensors.values())).time, float)
    start, end = time <= time[0] + AT_ENDS, time >= time[-1] - AT_ENDS
    distance = np.where(start, 0.0, way)
    return Estimate(time, Legs(None, None), None, distance, (start | end) & (start != end), {})
