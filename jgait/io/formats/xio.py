"""x-io Technologies' CSV: x-IMU3, NGIMU, x-IMU, and the files that go with Fusion and Gait-Tracking.

*Format* (x-io, user manuals of x-IMU3, NGIMU and x-IMU): a header that names quantity, axis and unit of each column.
x-IMU3 `Inertial.csv`: `Timestamp (us),Gyroscope X (deg/s),…,Accelerometer X (g),…`; NGIMU `sensors.csv` and Fusion:
`Time (s),Gyroscope X (deg/s),…`; x-IMU `*_CalInertialAndMag.csv`: `Packet number,Gyroscope X (deg/s),…`. A folder of
such files, or of one folder a device, is one recording.

*Units*: stated by the header; raw numbers (`lsb`) are refused. *Clock*: the file's; the x-IMU's packet numbers count
packets of every kind, so that they tell no time, and the sampling rate must be said. Rows that repeat the row before
are left out. *Placement*: not stated; a sensor is called by its file, or by its device's folder. *Axes*: the sensor's,
printed on its case.
"""

import re
from pathlib import Path

import numpy as np

from jgait.io.formats.part import Measured, Part, joined
from jgait.io.formats.text import AXES, SECONDS, UNITS, Rows, files_in, header_in, read_rows
from jgait.notes import LOSSES, Kind
from jgait.types import RecordingError

EXPECTED = "x-io CSV with a header Timestamp (us) or Time (s), Gyroscope X (deg/s), …, Accelerometer X (g), …"
ENDINGS = (".csv",)
BY_DEVICE = ("inertial", "sensors")
"""Files that every device writes under the same name."""
TIME = re.compile(r"^(?:time|timestamp)\s*\((\w+)\)$", re.IGNORECASE)

ROWS_REPEATED = Kind(
    "rows_repeated", "check", "{file}: {rows} "
    "{rows:row that repeats the row before is|rows that repeat the row before are} left out", LOSSES
)  # fmt: skip


def recognises(path: Path, head: bytes) -> bool:
    """Whether it is such a file, by its header, or a folder of them or of devices' folders."""
    if path.is_dir():
        return bool(_files(path))
    return header_in(head, _is_header)


def _files(folder: Path) -> list[Path]:
    return files_in(folder, ENDINGS, recognises, below=True)


def _is_header(cells: tuple[str, ...]) -> bool:
    return any(re.match(r"gyroscope x \(", cell, re.IGNORECASE) for cell in cells)


def measured(path: Path) -> Measured:
    """One sensor, or all of a folder. Raises RecordingError for another format, or units that are not known."""
    if path.is_dir():
        return joined([_one(file) for file in _files(path)], path.name)
    return _one(path)


def _one(path: Path) -> Measured:
    rows = read_rows(path, EXPECTED, _is_header)
    gyr, gyr_unit = _signal(rows, "Gyroscope")
    acc, acc_unit = _signal(rows, "Accelerometer")
    time = _time(rows)
    notes = []
    if time is not None:
        whole = np.column_stack([time, gyr, acc])
        fresh = np.concatenate([[True], np.any(whole[1:] != whole[:-1], axis=1)])
        if not fresh.all():
            notes.append(ROWS_REPEATED(file=path.name, rows=(~fresh).sum()))
        time, gyr, acc = time[fresh], gyr[fresh], acc[fresh]
    called = path.parent.resolve().name if path.stem.lower() in BY_DEVICE else path.stem
    part = Part(called, gyr, acc, time=time, gyr_unit=gyr_unit, acc_unit=acc_unit, axes=AXES)
    return Measured([part], called, notes=tuple(notes))


def _signal(rows: Rows, what: str) -> tuple[np.ndarray, str]:
    """(T, 3) of one quantity, and its unit from the header."""
    columns, units = [], set()
    for axis in "XYZ":
        named = re.compile(rf"^{what} {axis} \((.+)\)$", re.IGNORECASE)
        match_of_axis = next((match for column in rows.header if (match := named.match(column))), None)
        if match_of_axis is None:
            raise rows.lacks(f"{what} {axis} (…)")
        columns.append(match_of_axis.group())
        units.add(match_of_axis.group(1))
    unit = units.pop()
    if units or unit not in UNITS:
        hint = ": raw numbers, for which the calibration is lacking; export calibrated data" if unit == "lsb" else ""
        raise RecordingError(f"{rows.name}: {what} is in {unit!r}; expected one of {', '.join(UNITS)}{hint}")
    return rows.three(columns), UNITS[unit]


def _time(rows: Rows) -> np.ndarray | None:
    """(T,) [s], or None where the file counts packets only."""
    for position, column in enumerate(rows.header):
        if match := TIME.match(column):
            if match.group(1) not in SECONDS:
                raise RecordingError(f"{rows.name}: time is in {match.group(1)!r}; expected {', '.join(SECONDS)}")
            return SECONDS[match.group(1)] * rows.numbers(position)
    return None
