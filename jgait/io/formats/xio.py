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

import numpy as np

from jgait.io.formats.text import Rows, TextFormat
from jgait.io.part import Measured, Part
from jgait.notes import DATA_LOST

BY_DEVICE = ("inertial", "sensors")
"""Files that every device writes under the same name."""


def _is_header(cells: tuple[str, ...]) -> bool:
    return any(re.match(r"gyroscope x \(", cell, re.IGNORECASE) for cell in cells)


def _content(rows: Rows) -> Measured:
    gyr, gyr_unit = rows.signal([f"Gyroscope {axis}" for axis in "XYZ"])
    acc, acc_unit = rows.signal([f"Accelerometer {axis}" for axis in "XYZ"])
    clock = next((place for word in ("Time", "Timestamp") if (place := rows.where(word)) is not None), None)
    time, notes = None if clock is None else rows.seconds(clock, ""), []
    if time is not None:
        whole = np.column_stack([time, gyr, acc])
        fresh = np.concatenate([[True], np.any(whole[1:] != whole[:-1], axis=1)])
        if not fresh.all():
            notes.append(
                DATA_LOST.note(f"{rows.path.name}: rows that repeat the row before left out: {(~fresh).sum()}")
            )
        time, gyr, acc = time[fresh], gyr[fresh], acc[fresh]
    stem = rows.path.stem
    called = rows.path.parent.resolve().name if stem.lower() in BY_DEVICE else stem
    part = Part(called, gyr, acc, time=time, gyr_unit=gyr_unit, acc_unit=acc_unit)
    return Measured([part], called, notes=tuple(notes))


FORMAT = TextFormat(
    "x-io CSV with a header Timestamp (us) or Time (s), Gyroscope X (deg/s), …, Accelerometer X (g), …", (".csv",),
    _is_header, _content, in_header=True, below=True,
)  # fmt: skip
recognises, measured = FORMAT.recognises, FORMAT.measured
