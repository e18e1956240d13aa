r"""Text files of worn sensors: lines about the export, a header, perhaps a row of units, and one row a sample.

- *Xsens MTw* (MT Manager user manual, "ASCII exporter"): `MT_*.txt`, one a sensor; lines that begin with `//`, among
  them `// Update Rate: 100.0Hz`, or `Acquisition frequency: 100 Hz`; a header `PacketCounter SampleTimeFine Acc_X …
  Gyr_X …`, separated by tabs, commas, semicolons or single blanks. m/s² with gravity and rad/s by the manual; some
  exports are in deg/s all the same: a rate that is too large for a walking person in rad/s is questioned. Sensors of
  one receiver count the same packets (16 bits, wrapping). A sensor is called by the serial number that ends its file's
  name.
- *Movella (Xsens) DOT* (user manual, "Data exporter"): one CSV a sensor; lines such as `DeviceTag:,Right thigh`,
  `SyncStatus:`, `OutputRate:,60Hz`; the same header. m/s² with gravity, deg/s and µs by the manual; `SampleTimeFine`
  (32 bits, wrapping) is the clock, which sensors share once they were synchronised. Called by its `DeviceTag`.
- *Shimmer* (Consensys user guide): one or several devices a file; names `<device>_<signal>_<axis>_<CAL or RAW>`, such
  as `RWrist_Gyro_X_CAL`, and a row of units. The low-noise accelerometer (`Accel_LN`, to about ±2 g) counts, or the
  wide-range one (`Accel_WR`) where it is the only one or the other is driven to its limit. Unix time.
- *x-io* (manuals of x-IMU3, NGIMU, x-IMU): names with units, `Timestamp (us),Gyroscope X (deg/s),…`; a file, or a
  folder, a device. The x-IMU's packet numbers count packets of every kind, so that they tell no time. Rows that repeat
  the row before are left out.
- *Gait Up Physilog* 5 and 6 (Research ToolKit): rates above, `Time,Gyro X,…,Accel X,…`, a row of units.

A file is read as its format states and never mended: a row within it that is shorter or longer than the others, or a
cell that holds no number where one must be, is an error that names file and line. A last row that is cut off is left
out, and noted. Empty cells are lost samples. A folder of such files is one recording. Units are those of the file, else
they are questioned; uncalibrated signals and acceleration without gravity are refused. No placement is stated but in a
name that the user gave. *Axes*: the sensor's, printed on its case.
"""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jgait.geometry.vectors import GRAVITY
from jgait.io.checks.sizes import BY_SIZE
from jgait.io.clock import TIME_UNITS
from jgait.io.files import check_columns, check_file, first_bytes, numbers
from jgait.io.names import COLUMNS, column_of, is_number, states
from jgait.io.part import Measured, Part, joined
from jgait.io.text import HEADER_WITHIN, Head, first_lines, head_of, rows_of, separator_of, split
from jgait.io.units import ACC_UNITS, GYR_UNITS, known_unit
from jgait.notes import AS_READ, DATA_LOST, DEDUCED, Note
from jgait.types import RecordingError

if TYPE_CHECKING:
    import pandas as pd

COUNTER = "PacketCounter"
RATE = re.compile(
    r"(?:update rate|acquisition frequency)\W*([\d.]+)\s*hz|gyro\w*\s*\[\s*([\d.]+)\s*hz\s*\]|outputrate\W*([\d.]+)",
    re.IGNORECASE,
)
"""Pattern of the sampling rate in the lines above a header."""

FACT = re.compile(r'^"?([A-Za-z ]+?)\s*:?\s*[:,;\t]\s*(.*?)["\s,;]*$')
SHIMMER = re.compile(r"^(?P<device>.+?)_(?P<signal>Accel_LN|Accel_WR|Gyro)_(?P<axis>[XYZ])_(?P<kind>CAL|RAW|UNCAL)$")
STAMP = re.compile(r"^(?P<device>.+?)_Timestamp(?:Sync)?_(?P<how>FormattedUnix|Unix|Shimmer|RC)?_?CAL$")
ACCELEROMETERS = ("Accel_LN", "Accel_WR")


class Rows(NamedTuple):
    """A table in a text file."""

    path: Path
    head: Head
    cells: "pd.DataFrame"  #: (rows, columns), columns by position.
    notes: tuple[Note, ...]  #: the note about a last row that is cut off.

    def where(self, column: str) -> int | None:
        """Position of a column, without regard to case; None if there is none."""
        plain = [name.lower() for name in self.head.names]
        return plain.index(column.lower()) if column.lower() in plain else None

    def numbers(self, column: int) -> np.ndarray:
        """(T,) a column as numbers, NaN where empty. Raises RecordingError for a cell that holds something else."""
        values, wrong = numbers(self.cells[column])
        if len(wrong):
            where = f"line {self.head.first + 1 + wrong.index[0]}: column {self.head.names[column]!r}"
            raise RecordingError(f"{self.path.name}, {where} must hold numbers; found {wrong.iloc[0]!r}")
        return values

    def seconds(self, column: int, default: str) -> np.ndarray:
        """(T,) a column of times in seconds; in the default unit where the file states none. Raises RecordingError for
        a unit other than those of `TIME_UNITS`.
        """
        unit = (self.head.units[column] if column < len(self.head.units) else "") or default
        if unit not in TIME_UNITS:
            expected = ", ".join(TIME_UNITS)
            raise RecordingError(
                f"{self.path.name}: {self.head.names[column]} is in {unit!r}; expected one of {expected}"
            )
        return TIME_UNITS[unit] * self.numbers(column)

    def signal(self, pattern: str) -> tuple[np.ndarray, str | None]:
        """(T, 3) of the columns X, Y and Z, for which the asterisk of a pattern stands, and their unit as the file
        states it. Raises RecordingError if a column is not there, or the unit is not known.
        """
        columns = [pattern.replace("*", axis) for axis in "XYZ"]
        places = [place for column in columns if (place := self.where(column)) is not None]
        if len(places) < len(columns):
            lacking = next(column for column in columns if self.where(column) is None)
            there = ", ".join(filter(None, self.head.names))
            raise RecordingError(f"{self.path.name} lacks the column {lacking!r}; it has {there}")
        stated = {self.head.units[place] if place < len(self.head.units) else "" for place in places}
        known = {known_unit(unit) for unit in stated}
        if stated != {""} and (len(known) > 1 or None in known):
            raw = (
                ": raw numbers, for which the calibration is lacking; export calibrated data" if "lsb" in stated else ""
            )
            units = f"{', '.join(sorted(stated))}; expected one of {', '.join((*GYR_UNITS, *ACC_UNITS))}{raw}"
            raise RecordingError(f"{self.path.name}: {columns[0]} … is in {units}")
        return np.stack([self.numbers(place) for place in places], axis=1), known.pop()


class TextFormat(NamedTuple):
    """A format of text files of one or more sensors each; a folder of such files is one recording."""

    expected: str  #: description of the file with its header, for messages.
    endings: tuple[str, ...]  #: endings of the files' names in a folder.
    is_header: Callable[[tuple[str, ...]], bool]  #: whether a line's cells are the header.
    content: Callable[[Rows], Measured]  #: the sensors of one file.
    in_header: bool = False  #: whether names of columns end with their units in parentheses.
    below: bool = False  #: whether the files of a folder may lie one folder further down.
    accepts: Callable[[Path, bytes], bool] = lambda path, head: True  #: what else a file's name and first bytes must be
    together: Callable[[Measured, Sequence[Path]], Measured] = lambda whole, files: whole  #: what files need as one

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it is such a file, by its header, or a folder of them."""
        if path.is_dir():
            return bool(self.files(path))
        lines = head.decode("utf-8-sig", errors="replace").splitlines()  # the last may be cut off
        return b"\0" not in head and self.header(lines) is not None and self.accepts(path, head)

    def files(self, folder: Path) -> list[Path]:
        """The files of this format in a folder, by name."""
        every = [file for pattern in ("*", "*/*")[: 1 + self.below] for file in sorted(folder.glob(pattern))]
        likely = [file for file in every if file.suffix.lower() in self.endings and file.is_file()]
        return [file for file in likely if not file.name.startswith(".") and self.recognises(file, first_bytes(file))]

    def measured(self, path: Path) -> Measured:
        """All sensors of a file or folder.

        Raises:
            OSError: if the file does not exist, or may not be read.
            RecordingError: for another format, without raw calibrated signals, or for units that are not known.
        """
        if path.is_dir():
            files = self.files(path)
            return self.together(joined([self.measured(file) for file in files], path.name), files)
        rows = self.read(path)
        whole = self.content(rows)
        return whole._replace(notes=(*rows.notes, *whole.notes))

    def header(self, lines: Sequence[str]) -> tuple[int, str] | None:
        """The line of the header, and what separates its cells; None if there is none."""
        for row, line in enumerate(lines[:HEADER_WITHIN]):
            separator = separator_of(line) if separator_of(line) in line else " "
            if self.is_header(split(line, separator)):
                return row, separator
        return None

    def read(self, path: Path) -> Rows:
        """The table of a file, its cells unread.

        Raises:
            OSError: if the file does not exist, or may not be read.
            RecordingError: if it is empty, no text, has no such header or no rows, or a row has another length.
        """
        check_file(path, self.expected)
        lines, encoding = first_lines(path)
        if (header := self.header(lines)) is None:
            begins = next((line for line in lines if line.strip()), "").strip()[:80]
            raise RecordingError(f"{path.name} has no such header: expected {self.expected}; it begins with {begins!r}")
        row, separator = header
        names, last = _whole_header(lines, row, separator)
        check_columns(names, path.name)
        head = head_of(lines, encoding, row, separator, last)._replace(names=names)
        if self.in_header:
            names, units = zip(*(name.removesuffix(")").partition(" (")[::2] for name in names), strict=True)
            head = head._replace(names=names, units=units)
        return Rows(path, head, *rows_of(path, head, strict=True))


def _whole_header(lines: Sequence[str], row: int, separator: str) -> tuple[tuple[str, ...], int]:
    """The names of the header, and its last line: a header torn in two is joined where the rows are as long."""
    header = split(lines[row], separator)
    if row + 2 < len(lines) and not any(map(is_number, rest := split(lines[row + 1], separator))):
        columns = len(split(lines[row + 2].rstrip(separator), separator))
        for whole in ((*header, *rest), (*header[:-1], *rest), (*header[:-1], header[-1] + rest[0], *rest[1:])):
            if rest and len(header) < columns == len([name for name in whole if name]):
                return tuple(name for name in whole if name), row + 1
    return header, row


def _rate(rows: Rows) -> float | None:
    """The sampling rate [Hz] that the lines above the header state."""
    stated = RATE.search("\n".join(rows.head.above))
    return float(next(filter(None, stated.groups()))) if stated else None


def _is_xsens(cells: tuple[str, ...]) -> bool:
    """Whether cells are the header of an Xsens sensor's file, and not of a table that names the places of sensors."""
    plain = [cell.lower() for cell in cells]
    return COUNTER.lower() in plain and len(plain) > 3 and COLUMNS.isdisjoint({*map(column_of, cells)} - {"time"})


def _is_mtw(path: Path, head: bytes) -> bool:
    return path.suffix.lower() == ".txt" or head.lstrip(b"\xef\xbb\xbf ")[:2] == b"//"


def _xsens(rows: Rows) -> tuple[np.ndarray, np.ndarray]:
    """Gyroscope and accelerometer, (T, 3) each. Raises RecordingError if there are others in their place."""
    if rows.where("Acc_X") is None:
        names = [column for column in rows.head.names if column.lower().startswith("freeacc")]
        what = f"only acceleration from which gravity was taken off ({', '.join(names)})" if names else ""
        if any(column.lower().startswith(("dv[", "dv_", "dq_", "velinc", "oriinc")) for column in rows.head.names):
            what = what or "increments (dq, dv) and no rates"
        if what:
            needed = "expected Acc_X, Acc_Y, Acc_Z, Gyr_X, …: export or record inertial data"
            raise RecordingError(f"{rows.path.name} holds {what}; {needed}")
    return rows.signal("Gyr_*")[0], rows.signal("Acc_*")[0]


def _counted(rows: Rows, column: str, bits: int) -> np.ndarray | None:
    """(T,) a counter, its wraps undone; None if the file has no such column, or nothing in it."""
    position = rows.where(column)
    values = rows.numbers(position) if position is not None else np.zeros(0)
    lost = np.flatnonzero(~np.isfinite(values))
    if len(lost) == len(values):
        return None
    if len(lost):
        raise RecordingError(f"{rows.path.name}, line {rows.head.first + 1 + lost[0]}: {column} is empty")
    return np.unwrap(values, period=2**bits)


def _mtw(rows: Rows) -> Measured:
    stem, (gyr, acc) = rows.path.stem, _xsens(rows)
    serial, size = re.search(r"[_-]([0-9A-F]{8})$", stem), np.linalg.norm(gyr, axis=1)
    fast = np.nanpercentile(size, 99.0) if np.isfinite(size).any() else 0.0
    likely = bool(fast < BY_SIZE["gyr"].limits["rad/s"][1])
    part = Part(
        serial.group(1) if serial else stem, gyr, acc, sampling_rate_hz=_rate(rows),
        gyr_unit="rad/s" if likely else None, acc_unit="m/s^2", packets=_counted(rows, COUNTER, 16), packets_wrap=2**16,
    )  # fmt: skip
    doubt = DEDUCED.note(f"{stem}: rates are too large for rad/s, Xsens' unit by its manual")
    return Measured([part], stem, notes=() if likely else (doubt,))


def _of_one_unit(whole: Measured, files: Sequence[Path]) -> Measured:
    """One export, one unit: where one sensor's is in doubt, all are."""
    doubt = not all(part.gyr_unit for part in whole.parts)
    return whole._replace(parts=[part._replace(gyr_unit=None) for part in whole.parts]) if doubt else whole


def _facts(lines: Sequence[str]) -> dict[str, str]:
    """What the first lines of a DOT's file state: "devicetag" → "Right thigh"."""
    return {fact[1].replace(" ", "").lower(): fact[2] for fact in map(FACT.match, lines) if fact}


def _dot(rows: Rows) -> Measured:
    gyr, acc = _xsens(rows)
    stamps, packets = _counted(rows, "SampleTimeFine", 32), None
    if stamps is None:
        packets = _counted(rows, COUNTER, 32)
    part = Part(
        _facts(rows.head.above).get("devicetag") or rows.path.stem, gyr, acc, None if stamps is None else 1e-6 * stamps,
        _rate(rows) if stamps is None else None, "deg/s", "m/s^2", packets=packets,
    )  # fmt: skip
    return Measured([part], rows.path.stem)


def _synchronised(whole: Measured, files: Sequence[Path]) -> Measured:
    """Refuse sensors whose clocks were not synchronised; that they were is noted where files do not state it."""
    states = {file.name: _facts(first_lines(file)[0]).get("syncstatus", "") for file in files}
    for name, state in states.items() if len(files) > 1 else ():
        if re.match(r"(un|not)[\s_-]*sync", state, re.IGNORECASE):
            raise RecordingError(
                f"{whole.name}: the clock of {name} was not synchronised with the others' (SyncStatus {state!r}); "
                "sensors of one recording need one clock"
            )
    if len(files) < 2 or all(states.values()):
        return whole
    assumed = DEDUCED.note("the files do not state that the sensors' clocks were synchronised; one is assumed")
    return whole._replace(notes=(*whole.notes, assumed))


def _shimmer(rows: Rows) -> Measured:
    """All devices of a file."""
    signals_of: dict[str, dict[str, set[str]]] = {}
    for match in filter(None, map(SHIMMER.match, rows.head.names)):
        signals_of.setdefault(match["device"], {}).setdefault(match["signal"], set()).add(match["kind"])
    notes: list[Note] = []
    parts = [_shimmer_part(rows, device, kinds, notes) for device, kinds in signals_of.items() if "Gyro" in kinds]
    if not parts:
        there = ", ".join(filter(None, rows.head.names))
        raise RecordingError(f"{rows.path.name} holds no gyroscope; expected {SHIMMERS}; it has {there}")
    return Measured(parts, rows.path.stem, notes=tuple(notes))


def _shimmer_part(rows: Rows, device: str, kinds: dict[str, set[str]], notes: list[Note]) -> Part:
    for signal, names in (("gyroscope", ("Gyro",)), ("accelerometer", ACCELEROMETERS)):
        variants = set[str]().union(*(kinds.get(name, ()) for name in names))
        if variants and "CAL" not in variants:
            variant = f"(found {', '.join(sorted(variants))}, expected CAL): export calibrated data"
            raise RecordingError(f"{rows.path.name}: the {signal} of {device} is not calibrated {variant}")
    time = _shimmer_time(rows, device)
    timed = np.isfinite(time) if time is not None else np.ones(len(rows.cells), bool)
    gyr, gyr_unit = rows.signal(f"{device}_Gyro_*_CAL")
    acc, acc_unit = None, None
    for name in (name for name in ACCELEROMETERS if "CAL" in kinds.get(name, ())):
        at_limit = 0.0
        if acc is not None:
            limit = 1.9 * GRAVITY / ACC_UNITS[acc_unit or "m/s^2"]
            at_limit = float(np.mean(np.abs(acc[timed]).max(axis=1, initial=0.0) > limit))
        if acc is None or at_limit > 1e-3:  # where one axis of a sensor of ±2 g is beyond 1.9 g
            acc, acc_unit = rows.signal(f"{device}_{name}_*_CAL")
            why = f", for {ACCELEROMETERS[0]} is at its limit in {at_limit:.2%} of the samples" if at_limit else ""
            notes.append(AS_READ.note(f"{device}: {name} taken{why}"))
    return Part(
        device, gyr[timed], None if acc is None else acc[timed], None if time is None else time[timed],
        gyr_unit=gyr_unit, acc_unit=acc_unit,
    )  # fmt: skip


def _shimmer_time(rows: Rows, device: str) -> np.ndarray | None:
    """(T,) [s], NaN in rows without this device; Unix time before the device's own."""
    import pandas as pd

    stamps = {cell: match for cell in rows.head.names if (match := STAMP.match(cell))}
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


def _xio(rows: Rows) -> Measured:
    (gyr, gyr_unit), (acc, acc_unit) = rows.signal("Gyroscope *"), rows.signal("Accelerometer *")
    clock = next((place for word in ("Time", "Timestamp") if (place := rows.where(word)) is not None), None)
    time, notes = None if clock is None else rows.seconds(clock, ""), []
    if time is not None:
        whole = np.column_stack([time, gyr, acc])
        fresh = np.append(True, np.any(whole[1:] != whole[:-1], axis=1))
        if not fresh.all():
            again = "{rows} {rows:row|rows} of {file} {rows:repeats|repeat} the row before and {rows:is|are} left out"
            notes.append(DATA_LOST.note(again, rows=(~fresh).sum(), file=rows.path.name))
        time, gyr, acc = time[fresh], gyr[fresh], acc[fresh]
    stem = rows.path.stem  # every device writes its file under the same name
    called = rows.path.parent.resolve().name if stem.lower() in ("inertial", "sensors") else stem
    return Measured([Part(called, gyr, acc, time, gyr_unit=gyr_unit, acc_unit=acc_unit)], called, notes=tuple(notes))


def _is_physilog(cells: tuple[str, ...]) -> bool:
    plain = [cell.lower() for cell in cells]
    accelerometer = "accel x" in plain or not any(states(cell, "acc") for cell in cells)
    return "gyro x" in plain and "time" in plain and accelerometer


def _physilog(rows: Rows) -> Measured:
    gyr, gyr_unit = rows.signal("Gyro *")
    acc, acc_unit = (None, None) if rows.where("Accel X") is None else rows.signal("Accel *")
    time, stem = rows.seconds(rows.where("Time") or 0, "s"), rows.path.stem
    return Measured([Part(stem, gyr, acc, time, _rate(rows), gyr_unit, acc_unit)], stem)


SHIMMERS = "Shimmer Consensys CSV with a header <device>_Timestamp_Unix_CAL, …_Accel_LN_X_CAL, …, …_Gyro_X_CAL, …"

FORMATS = {
    "mtw": TextFormat(
        "Xsens MTw text with a header PacketCounter, Acc_X, …, Gyr_X, …", (".txt", ".csv"), _is_xsens, _mtw,
        accepts=_is_mtw, together=_of_one_unit,
    ),
    "dot": TextFormat(
        "Movella DOT CSV with a header PacketCounter, SampleTimeFine, …, Acc_X, …, Gyr_X, …", (".csv",), _is_xsens,
        _dot, accepts=lambda path, head: not _is_mtw(path, head), together=_synchronised,
    ),
    "shimmer": TextFormat(
        SHIMMERS, (".csv", ".txt", ".tsv"),
        lambda cells: any(SHIMMER.match(cell) or STAMP.match(cell) for cell in cells), _shimmer,
    ),
    "xio": TextFormat(
        "x-io CSV with a header Timestamp (us) or Time (s), Gyroscope X (deg/s), …, Accelerometer X (g), …", (".csv",),
        lambda cells: any(cell.lower().startswith("gyroscope x (") for cell in cells), _xio, in_header=True, below=True,
    ),
    "physilog": TextFormat(
        "Gait Up Physilog CSV with a header Time, Gyro X, Gyro Y, Gyro Z, Accel X, …", (".csv", ".txt"), _is_physilog,
        _physilog,
    ),
}  # fmt: skip
"""Name in `jgait.io.FORMATS` → format."""
