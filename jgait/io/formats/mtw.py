"""Xsens MTw text (`MT_*.txt`), one file a sensor, as MT Manager and its relatives export it.

*Format* (Xsens, MT Manager user manual, "ASCII exporter"): lines that begin with `//`, among them `// Update Rate:
100.0Hz`; a header `PacketCounter SampleTimeFine Acc_X … Gyr_X … Mag_X …` and perhaps `FreeAcc_…`, `Quat_…`, `Mat[1][1]`
…; tabs, commas, semicolons or single blanks. `Acquisition frequency: 100 Hz` instead of the `//` lines is read too.

*Units*: the manual states m/s² with gravity and rad/s. Some exports are in deg/s all the same: a rate that is too large
for a walking person in rad/s is taken for a unit that is not stated, and questioned. *Clock*: sensors of one receiver
count the same packets (16 bits, wrapping); those that were lost become missing samples. *Placement*: not stated; the
sensor is called by the serial number that ends the file's name. *Axes*: the sensor's, printed on its case.
"""

import re
from pathlib import Path

import numpy as np

from jgait.io.checks.sizes import BY_SIZE
from jgait.io.formats.text import Rows, TextFormat
from jgait.io.names import COLUMNS, column_of
from jgait.io.part import Measured, Part
from jgait.notes import DEDUCED
from jgait.types import RecordingError

COUNTER, COUNTER_BITS = "PacketCounter", 16
RATE = re.compile(r"(?:update rate|acquisition frequency)\W*([\d.]+)\s*hz", re.IGNORECASE)
SERIAL = re.compile(r"[_-]([0-9A-F]{8})$")


def is_header(cells: tuple[str, ...]) -> bool:
    """Whether cells are the header of an Xsens sensor's file, and not of a table that names the places of sensors."""
    plain = [cell.lower() for cell in cells]
    return COUNTER.lower() in plain and len(plain) > 3 and COLUMNS.isdisjoint({*map(column_of, cells)} - {"time"})


def starts(path: Path, head: bytes) -> bool:
    """Whether it is an MTw's file by its ending, or by what stands above the header."""
    return path.suffix.lower() == ".txt" or head.lstrip(b"\xef\xbb\xbf ")[:2] == b"//"


def measured(path: Path) -> Measured:
    """One sensor, or all of a folder; errors as of `TextFormat.measured`."""
    whole = FORMAT.measured(path)
    # One export, one unit: where one sensor's is in doubt, all are.
    doubt = not all(part.gyr_unit for part in whole.parts)
    return whole._replace(parts=[part._replace(gyr_unit=None) for part in whole.parts]) if doubt else whole


def signals(rows: Rows) -> tuple[np.ndarray, np.ndarray]:
    """Gyroscope and accelerometer, (T, 3) each, as the file has them. Raises RecordingError if one is not there; of
    acceleration without gravity, saying so.
    """
    if rows.where("Acc_X") is None:
        names = [column for column in rows.header if column.lower().startswith("freeacc")]
        what = f"only acceleration from which gravity was taken off ({', '.join(names)})" if names else ""
        if any(column.lower().startswith(("dv[", "dv_", "dq_", "velinc", "oriinc")) for column in rows.header):
            what = what or "increments (dq, dv) and no rates"
        if what:
            needed = "expected Acc_X, Acc_Y, Acc_Z, Gyr_X, …: export or record inertial data"
            raise RecordingError(f"{rows.path.name} holds {what}; {needed}")
    return rows.signal(["Gyr_X", "Gyr_Y", "Gyr_Z"])[0], rows.signal(["Acc_X", "Acc_Y", "Acc_Z"])[0]


def counted(rows: Rows, column: str, bits: int) -> np.ndarray | None:
    """(T,) a counter, its wraps undone; None if the file has no such column, or nothing in it. Raises RecordingError if
    a row has none.
    """
    position = rows.where(column)
    values = rows.numbers(position) if position is not None else np.zeros(0)
    lost = np.flatnonzero(~np.isfinite(values))
    if len(lost) == len(values):
        return None
    if len(lost):
        raise RecordingError(f"{rows.path.name}, line {rows.first_line + lost[0]}: {column} is empty")
    return np.unwrap(values, period=2**bits)


def _content(rows: Rows) -> Measured:
    stem, (gyr, acc) = rows.path.stem, signals(rows)
    stated, serial = RATE.search("\n".join(rows.before)), SERIAL.search(stem)
    size = np.linalg.norm(gyr, axis=1)
    fast = np.nanpercentile(size, 99.0) if np.isfinite(size).any() else 0.0
    likely = bool(fast < BY_SIZE["gyr"].limits["rad/s"][1])
    part = Part(
        serial.group(1) if serial else stem, gyr, acc, sampling_rate_hz=float(stated.group(1)) if stated else None,
        gyr_unit="rad/s" if likely else None, acc_unit="m/s^2",
        packets=counted(rows, COUNTER, COUNTER_BITS), packets_wrap=2**COUNTER_BITS,
    )  # fmt: skip
    doubt = DEDUCED.note(f"{stem}: rates are too large for rad/s, Xsens' unit by its manual")
    return Measured([part], stem, notes=() if likely else (doubt,))


FORMAT = TextFormat(
    "Xsens MTw text with a header PacketCounter, Acc_X, …, Gyr_X, …", (".txt", ".csv"), is_header, _content,
    accepts=starts,
)  # fmt: skip
recognises = FORMAT.recognises
