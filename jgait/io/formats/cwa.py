"""Axivity's CWA files (`*.cwa`) of an AX6, read by the library `cwa_reader_rs`.

*Format*: Open Movement, "AX3/AX6 technical notes". *Units*: g and deg/s, as the library gives them. *Clock*: the
device's wall clock, which has no time zone. *Placement*: not stated; the sensor is called by the file. *Axes*: the
device's. An AX3, and an AX6 whose gyroscope was off, are refused.
"""

from pathlib import Path

import numpy as np

from jgait.io.files import check_file, library
from jgait.io.part import Measured, Part
from jgait.types import RecordingError

EXPECTED = "an Axivity CWA file"


def measured(path: Path) -> Measured:
    """The sensor of a file. Raises ImportError without the library, RecordingError without a gyroscope."""
    check_file(path, EXPECTED)
    reader = library("cwa_reader_rs", EXPECTED, "devices")
    about = reader.read_metadata(str(path))
    if not about["gyro_range"]:
        raise RecordingError(
            f"{path.name}: this {about['hardware_type']} recorded no gyroscope, which every method needs"
        )
    table = reader.read_cwa_file(
        str(path), include_magnetometer=False, include_temperature=False, include_light=False, include_battery=False
    )
    gyr, acc = (table[[f"{kind}_{axis}" for axis in "xyz"]].to_numpy(np.float64) for kind in ("gyro", "acc"))
    time = (table.index - table.index[0]).total_seconds().to_numpy(np.float64)
    part = Part(
        path.stem, gyr, acc, time, gyr_unit="deg/s", acc_unit="g",
        begin_s=table.index[0].timestamp(),
    )  # fmt: skip
    return Measured([part], path.stem)
