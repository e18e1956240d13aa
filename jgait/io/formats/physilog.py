"""Gait Up's Physilog CSV (Physilog 5 and 6, Research ToolKit), one file a sensor.

*Format*: lines about the export (`Gait Up - Physilog data export`, `Created on:`, `Total data points:`, rates of the
groups of signals: `Time [128 hz],Gyro [128 hz],…`); a header `Time,Gyro X,Gyro Y,Gyro Z,Accel X,…`; a row of units
`[s],[deg/s],…,[g],…`; commas or semicolons, often one at the end of each row.

*Units*: stated by the row of units; without it they are questioned. Barometer, temperature, event and orientation are
left out. *Clock*: the file's, which starts with the recording, so that sensors started together share it. *Placement*:
not stated; a sensor is called by its file. *Axes*: the sensor's, printed on its case.
"""

import re
from pathlib import Path

import numpy as np

from jgait.io.formats.part import Measured, Part, joined
from jgait.io.formats.text import AXES, SECONDS, Rows, files_in, header_in, read_rows
from jgait.types import RecordingError

EXPECTED = "Gait Up Physilog CSV with a header Time, Gyro X, Gyro Y, Gyro Z, Accel X, …"
ENDINGS = (".csv", ".txt")
RATE = re.compile(r"gyro\w*\s*\[\s*([\d.]+)\s*hz\s*\]", re.IGNORECASE)


def recognises(path: Path, head: bytes) -> bool:
    """Whether it is such a file, by its header, or a folder of them."""
    if path.is_dir():
        return bool(files_in(path, ENDINGS, recognises))
    return header_in(head, _is_header)


def _is_header(cells: tuple[str, ...]) -> bool:
    plain = [cell.lower() for cell in cells]
    return "gyro x" in plain and "time" in plain


def measured(path: Path) -> Measured:
    """One sensor, or all of a folder. Raises RecordingError for another format, or units that are not known."""
    if path.is_dir():
        return joined([measured(file) for file in files_in(path, ENDINGS, recognises)], path.name)
    rows = read_rows(path, EXPECTED, _is_header, units_below=True)
    gyr, gyr_unit = rows.in_units([f"Gyro {axis}" for axis in "XYZ"])
    acc, acc_unit = None, None
    if rows.where("Accel X") is not None:
        acc, acc_unit = rows.in_units([f"Accel {axis}" for axis in "XYZ"])
    stated = RATE.search("\n".join(rows.before))
    time = _time(rows)
    part = Part(
        path.stem, gyr, acc, time=time, sampling_rate_hz=float(stated.group(1)) if stated else None,
        gyr_unit=gyr_unit, acc_unit=acc_unit, axes=AXES,
    )  # fmt: skip
    return Measured([part], path.stem)


def _time(rows: Rows) -> np.ndarray:
    position = rows.where("Time") or 0
    unit = rows.unit(position) or "s"
    if unit not in SECONDS:
        raise RecordingError(f"{rows.name}: Time is in {unit!r}; expected one of {', '.join(SECONDS)}")
    return SECONDS[unit] * rows.numbers(position)
