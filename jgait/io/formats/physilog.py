"""Gait Up's Physilog CSV (Physilog 5 and 6, Research ToolKit), one file a sensor.

*Format*: lines about the export (`Gait Up - Physilog data export`, `Created on:`, `Total data points:`, rates of the
groups of signals: `Time [128 hz],Gyro [128 hz],…`); a header `Time,Gyro X,Gyro Y,Gyro Z,Accel X,…`; a row of units
`[s],[deg/s],…,[g],…`; commas or semicolons, often one at the end of each row.

*Units*: stated by the row of units; without it they are questioned. Barometer, temperature, event and orientation are
left out. *Clock*: the file's, which starts with the recording, so that sensors started together share it. *Placement*:
not stated; a sensor is called by its file. *Axes*: the sensor's, printed on its case.
"""

import re

from jgait.io.formats.text import Rows, TextFormat
from jgait.io.names import states
from jgait.io.part import Measured, Part

RATE = re.compile(r"gyro\w*\s*\[\s*([\d.]+)\s*hz\s*\]", re.IGNORECASE)


def _is_header(cells: tuple[str, ...]) -> bool:
    plain = [cell.lower() for cell in cells]
    accelerometer = "accel x" in plain or not any(states(cell, "acc") for cell in cells)
    return "gyro x" in plain and "time" in plain and accelerometer


def _content(rows: Rows) -> Measured:
    gyr, gyr_unit = rows.signal([f"Gyro {axis}" for axis in "XYZ"])
    acc, acc_unit = None, None
    if rows.where("Accel X") is not None:
        acc, acc_unit = rows.signal([f"Accel {axis}" for axis in "XYZ"])
    stated = RATE.search("\n".join(rows.before))
    part = Part(
        rows.path.stem, gyr, acc, time=rows.seconds(rows.where("Time") or 0, "s"),
        sampling_rate_hz=float(stated.group(1)) if stated else None, gyr_unit=gyr_unit, acc_unit=acc_unit,
    )  # fmt: skip
    return Measured([part], rows.path.stem)


FORMAT = TextFormat(
    "Gait Up Physilog CSV with a header Time, Gyro X, Gyro Y, Gyro Z, Accel X, …", (".csv", ".txt"), _is_header,
    _content,
)  # fmt: skip
recognises, measured = FORMAT.recognises, FORMAT.measured
