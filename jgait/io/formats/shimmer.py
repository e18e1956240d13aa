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
from jgait.io.formats.part import Measured, Part
from jgait.io.formats.text import AXES, Rows, TextFormat
from jgait.io.units import ACC_UNITS
from jgait.notes import AS_READ, Kind, Note
from jgait.types import RecordingError

SIGNAL = re.compile(r"^(?P<device>.+?)_(?P<signal>Accel_LN|Accel_WR|Gyro)_(?P<axis>[XYZ])_(?P<kind>CAL|RAW|UNCAL)$")
ACCELEROMETERS = ("Accel_LN", "Accel_WR")
STAMP = re.compile(r"^(?P<device>.+?)_Timestamp(?:Sync)?_(?P<how>FormattedUnix|Unix|Shimmer|RC)?_?CAL$")
FULL, OFTEN = 1.9, 1e-3
"""[g], [1] The low-noise accelerometer is at its limit where one axis is above the one in more than the other share."""

WIDE_RANGE_TAKEN = Kind(
    "wide_range_taken",
    "corrected",
    "{sensor}: {signal} taken, for Accel_LN is at its limit in {share:.2%} of the samples",
    "The low-noise accelerometer cannot measure such movements; the one with the wider range and more noise can.",
)


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
        raise RecordingError(
            f"{rows.name} holds no gyroscope; expected {FORMAT.expected}; it has {', '.join(filter(None, rows.header))}"
        )
    return Measured(parts, rows.path.stem, notes=tuple(notes))


def _part(rows: Rows, device: str, kinds: dict[str, set[str]], notes: list[Note]) -> Part:
    stored = kinds["Gyro"], set[str]().union(*(kinds.get(name, ()) for name in ACCELEROMETERS))
    for signal, variants in zip(("gyroscope", "accelerometer"), stored, strict=True):
        if variants and "CAL" not in variants:
            raise RecordingError(
                f"{rows.name}: the {signal} of {device} is not calibrated (found "
                f"{', '.join(sorted(variants))}, expected "
                "CAL): export calibrated data"
            )
    time = _time(rows, device)
    timed = np.isfinite(time) if time is not None else np.ones(len(rows.cells), bool)
    gyr, gyr_unit = rows.in_units(_columns(device, "Gyro"))
    acc, acc_unit = None, None
    choice = [name for name in ACCELEROMETERS if "CAL" in kinds.get(name, ())]
    if choice:
        acc, acc_unit = rows.in_units(_columns(device, choice[0]))
        limit = FULL * GRAVITY / ACC_UNITS[acc_unit or "m/s^2"]
        share = float(np.mean(np.abs(acc[timed]).max(axis=1, initial=0.0) > limit))
        taken = choice[0]
        if len(choice) == 2 and share > OFTEN:
            taken = choice[1]
            acc, acc_unit = rows.in_units(_columns(device, taken))
            notes.append(WIDE_RANGE_TAKEN(sensor=device, signal=taken, share=share))
        else:
            notes.append(AS_READ.note(f"{device}: {taken} taken"))
    return Part(
        device, gyr[timed], None if acc is None else acc[timed],
        time=None if time is None else time[timed], gyr_unit=gyr_unit, acc_unit=acc_unit, axes=AXES,
    )  # fmt: skip


def _columns(device: str, signal: str) -> list[str]:
    return [f"{device}_{signal}_{axis}_CAL" for axis in "XYZ"]


def _time(rows: Rows, device: str) -> np.ndarray | None:
    """(T,) [s], NaN in rows without this device; Unix time before the device's own."""
    import pandas as pd

    stamps = {cell: match for cell in rows.header if (match := STAMP.match(cell))}
    cells = {match["how"] or "": cell for cell, match in stamps.items() if match["device"] == device}
    for how in ("Unix", "FormattedUnix", "Shimmer", "RC", ""):
        if how not in cells:
            continue
        column = rows.where(cells[how]) or 0
        if how == "FormattedUnix":
            times = pd.to_datetime(rows.cells[column], errors="coerce", format="mixed")
            wrong = times.isna() & rows.cells[column].notna()
            if wrong.any():
                wrong_cell = rows.cells[column][wrong].iloc[0]
                raise RecordingError(f"{rows.name}: column {cells[how]!r} must hold times of day; found {wrong_cell!r}")
            since = (times - pd.Timestamp(0)) / pd.Timedelta(seconds=1)
            return since.to_numpy(np.float64, na_value=np.nan)
        return rows.seconds(column, "ms")
    return None


FORMAT = TextFormat(
    "Shimmer Consensys CSV with a header <device>_Timestamp_Unix_CAL, …_Accel_LN_X_CAL, …, …_Gyro_X_CAL, …",
    (".csv", ".txt", ".tsv"), _is_header, _content,
)  # fmt: skip
recognises, measured = FORMAT.recognises, FORMAT.measured
