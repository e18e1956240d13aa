r"""Shimmer's CSV, as Consensys exports it; one or several devices in a file.

*Format* (Shimmer, Consensys user guide): perhaps `"sep=\t"`; a header of names `<device>_<signal>_<axis>_<CAL or RAW>`
such as `Shimmer_8665_Accel_LN_X_CAL` or `RWrist_Gyro_X_CAL`; a row of units (`m/(s^2)`, `deg/s`, `ms`); tabs, commas
or semicolons.

*Units*: stated by the row of units; without it they are questioned. Uncalibrated signals (`RAW`) are refused.
*Signals*: the low-noise accelerometer (`Accel_LN`, to about ±2 g), or the wide-range one (`Accel_WR`) where it is the
only one or the other is driven to its limit. *Clock*: Unix time. *Placement*: not stated, but the user may have called
a device by it. *Axes*: the sensor's, printed on its case.
"""

import re

import numpy as np

from jgait.geometry.vectors import GRAVITY
from jgait.io.formats.text import Rows, TextFormat
from jgait.io.part import Measured, Part
from jgait.io.units import ACC_UNITS
from jgait.notes import AS_READ, Note
from jgait.types import RecordingError

SIGNAL = re.compile(r"^(?P<device>.+?)_(?P<signal>Accel_LN|Accel_WR|Gyro)_(?P<axis>[XYZ])_(?P<kind>CAL|RAW|UNCAL)$")
ACCELEROMETERS = ("Accel_LN", "Accel_WR")
STAMP = re.compile(r"^(?P<device>.+?)_Timestamp(?:Sync)?_(?P<how>FormattedUnix|Unix|Shimmer|RC)?_?CAL$")
FULL, OFTEN = 1.9, 1e-3
"""[g], [1] The low-noise accelerometer is at its limit where one axis is above the one in more than the other share."""


def _is_header(cells: tuple[str, ...]) -> bool:
    return any(SIGNAL.match(cell) or STAMP.match(cell) for cell in cells)


def _content(rows: Rows) -> Measured:
    """All devices of a file."""
    signals_of: dict[str, dict[str, set[str]]] = {}
    for cell in rows.header:
        if match := SIGNAL.match(cell):
            signals_of.setdefault(match["device"], {}).setdefault(match["signal"], set()).add(match["kind"])
    notes: list[Note] = []
    parts = [_part(rows, device, kinds, notes) for device, kinds in signals_of.items() if "Gyro" in kinds]
    if not parts:
        there = ", ".join(filter(None, rows.header))
        raise RecordingError(f"{rows.path.name} holds no gyroscope; expected {FORMAT.expected}; it has {there}")
    return Measured(parts, rows.path.stem, notes=tuple(notes))


def _part(rows: Rows, device: str, kinds: dict[str, set[str]], notes: list[Note]) -> Part:
    for signal, names in (("gyroscope", ("Gyro",)), ("accelerometer", ACCELEROMETERS)):
        variants = set[str]().union(*(kinds.get(name, ()) for name in names))
        if variants and "CAL" not in variants:
            variant = f"(found {', '.join(sorted(variants))}, expected CAL): export calibrated data"
            raise RecordingError(f"{rows.path.name}: the {signal} of {device} is not calibrated {variant}")
    time = _time(rows, device)
    timed = np.isfinite(time) if time is not None else np.ones(len(rows.cells), bool)
    gyr, gyr_unit = rows.signal(_columns(device, "Gyro"))
    acc, acc_unit = None, None
    for name in (name for name in ACCELEROMETERS if "CAL" in kinds.get(name, ())):
        at_limit = 0.0
        if acc is not None:
            limit = FULL * GRAVITY / ACC_UNITS[acc_unit or "m/s^2"]
            at_limit = float(np.mean(np.abs(acc[timed]).max(axis=1, initial=0.0) > limit))
        if acc is None or at_limit > OFTEN:
            acc, acc_unit = rows.signal(_columns(device, name))
            why = f", for {ACCELEROMETERS[0]} is at its limit in {at_limit:.2%} of the samples" if at_limit else ""
            notes.append(AS_READ.note(f"{device}: {name} taken{why}"))
    return Part(
        device, gyr[timed], None if acc is None else acc[timed],
        time=None if time is None else time[timed], gyr_unit=gyr_unit, acc_unit=acc_unit,
    )  # fmt: skip


def _columns(device: str, signal: str) -> list[str]:
    return [f"{device}_{signal}_{axis}_CAL" for axis in "XYZ"]


def _time(rows: Rows, device: str) -> np.ndarray | None:
    """(T,) [s], NaN in rows without this device; Unix time before the device's own."""
    import pandas as pd

    stamps = {cell: match for cell in rows.header if (match := STAMP.match(cell))}
    cells = {match["how"] or "": cell for cell, match in stamps.items() if match["device"] == device}
    how = next((how for how in ("Unix", "FormattedUnix", "Shimmer", "RC", "") if how in cells), None)
    if how is None:
        return None
    column = rows.where(cells[how]) or 0
    if how != "FormattedUnix":
        return rows.seconds(column, "ms")
    times = pd.to_datetime(rows.cells[column], errors="coerce", format="mixed")
    if len(wrong := rows.cells[column][times.isna() & rows.cells[column].notna()]):
        what = f"column {cells[how]!r} must hold times of day; found {wrong.iloc[0]!r}"
        raise RecordingError(f"{rows.path.name}: {what}")
    return ((times - pd.Timestamp(0)) / pd.Timedelta(seconds=1)).to_numpy(np.float64, na_value=np.nan)


FORMAT = TextFormat(
    "Shimmer Consensys CSV with a header <device>_Timestamp_Unix_CAL, …_Accel_LN_X_CAL, …, …_Gyro_X_CAL, …",
    (".csv", ".txt", ".tsv"), _is_header, _content,
)  # fmt: skip
recognises, measured = FORMAT.recognises, FORMAT.measured
