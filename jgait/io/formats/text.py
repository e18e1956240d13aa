"""Tables in text files of measuring systems: where the header is, what separates cells, and that no row is cut off.

A file is read as its format states and never mended: a row within it that is shorter or longer than the others, or a
cell that holds no number where one must be, is an error that names file and line. A last row that is cut off is left
out, and noted. Empty cells are lost samples.
"""

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jgait.io.clock import TIME_UNITS
from jgait.io.files import LONGEST_NAME, check_columns, check_file, line_breaks
from jgait.io.formats.part import Measured, joined
from jgait.io.rows import HEADER_WITHIN, ROW_CUT_OFF
from jgait.io.units import ACC_UNITS, GYR_UNITS, known_unit
from jgait.notes import Note
from jgait.types import RecordingError

SEPARATORS = (",", ";", "\t", " ")
"""What separates cells, a single blank where a line has none of the others."""

HEAD = 4096
"""[bytes] Number of first bytes of a file that are read to recognise its format."""

RAW = "lsb"
"""Unit of numbers that are not calibrated."""

AXES = "as printed on the sensor's case"


class Rows(NamedTuple):
    """A table in a text file."""

    path: Path  #: the file.
    before: tuple[str, ...]  #: lines above the header.
    #: names of the columns, without blanks, quotes, and units in parentheses where the format has them there.
    header: tuple[str, ...]
    first_line: int  #: number of the first row's line in the file, from 1.
    units: tuple[str, ...]  #: unit of each column as the file states it, "" where it states none; or ().
    cells: np.ndarray  #: (rows, columns) pandas table, columns by position.
    notes: tuple[Note, ...] = ()  #: the note about a last row that is cut off.

    @property
    def name(self) -> str:
        """Name of the file."""
        return self.path.name

    def where(self, column: str) -> int | None:
        """Position of a column, without regard to case; None if there is none."""
        plain = [name.lower() for name in self.header]
        return plain.index(column.lower()) if column.lower() in plain else None

    def numbers(self, column: int) -> np.ndarray:
        """(T,) a column as numbers, NaN where empty. Raises RecordingError for a cell that holds something else."""
        import pandas as pd

        raw = self.cells[column]
        values = pd.to_numeric(raw, errors="coerce").to_numpy(np.float64, na_value=np.nan)
        wrong = np.flatnonzero(np.isnan(values) & raw.notna().to_numpy())
        if len(wrong):
            raise RecordingError(
                f"{self.name}, line {self.first_line + wrong[0]}: column {self.header[column]!r} must hold numbers; "
                f"found {raw.iloc[wrong[0]]!r}"
            )
        return values

    def seconds(self, column: int, default: str) -> np.ndarray:
        """(T,) a column of times in seconds; in the default unit where the file states none.

        Raises:
            RecordingError: for a unit other than those of `TIME_UNITS`.
        """
        unit = self.unit(column) or default
        if unit not in TIME_UNITS:
            raise RecordingError(
                f"{self.name}: {self.header[column]} is in {unit!r}; expected one of {', '.join(TIME_UNITS)}"
            )
        return TIME_UNITS[unit] * self.numbers(column)

    def three(self, columns: Sequence[str]) -> np.ndarray:
        """(T, 3) of three columns. Raises RecordingError if one is not there, naming it and those that are."""
        places = [self.where(column) for column in columns]
        if None in places:
            lacking = columns[places.index(None)]
            there = ", ".join(filter(None, self.header))
            raise RecordingError(f"{self.name} lacks the column {lacking!r}; it has {there}")
        return np.stack([self.numbers(position) for position in places if position is not None], axis=1)

    def in_units(self, columns: Sequence[str]) -> tuple[np.ndarray, str | None]:
        """(T, 3) of three columns, and the unit that the file states; None if it states none.

        Raises:
            RecordingError: if a column is not there, or the unit is none that is known.
        """
        values = self.three(columns)
        stated = {self.unit(self.where(column) or 0) for column in columns}
        if stated <= {""}:
            return values, None
        known = {known_unit(unit) for unit in stated}
        unit = known.pop()
        if known or unit is None:
            raw = ": raw numbers, for which the calibration is lacking; export calibrated data" if RAW in stated else ""
            units = ", ".join(sorted(stated))
            raise RecordingError(
                f"{self.name}: {columns[0]} … is in {units}; expected one of {', '.join((*GYR_UNITS, *ACC_UNITS))}{raw}"
            )
        return values, unit

    def unit(self, column: int) -> str:
        """What the file states of a column's unit, plain; "" where it states nothing."""
        stated = self.units[column].strip() if column < len(self.units) else ""
        return stated[1:-1].strip() if stated[:1] + stated[-1:] in ("[]", "()") else stated


class TextFormat(NamedTuple):
    """A format of text files of one or more sensors each; a folder of such files is one recording."""

    expected: str  #: description of the file with its header, for messages.
    endings: tuple[str, ...]  #: endings of the files' names in a folder.
    is_header: Callable[[tuple[str, ...]], bool]  #: whether a line's cells are the header.
    content: Callable[[Rows], Measured]  #: the sensors of one file.
    #: where the file states units: in a "row" without numbers below the header, in the "header", or nowhere.
    units: str = ""
    below: bool = False  #: whether the files of a folder may lie one folder further down.
    accepts: Callable[[Path, bytes], bool] = lambda path, head: True  #: what else a file's name and first bytes must be

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it is such a file, by its header, or a folder of them."""
        if path.is_dir():
            return bool(self.files(path))
        lines = head.decode("utf-8-sig", errors="replace").splitlines()  # the last may be cut off
        return b"\0" not in head and _header(lines, self.is_header) is not None and self.accepts(path, head)

    def files(self, folder: Path) -> list[Path]:
        """The files of this format in a folder, by name."""
        matches = []
        for pattern in ("*", "*/*") if self.below else ("*",):
            for file in sorted(folder.glob(pattern)):
                if file.suffix.lower() in self.endings and not file.name.startswith(".") and file.is_file():
                    with file.open("rb") as stream:
                        matches += [file] if self.recognises(file, stream.read(HEAD)) else []
        return matches

    def measured(self, path: Path) -> Measured:
        """All sensors of a file or folder.

        Raises:
            OSError: if the file does not exist, or may not be read.
            RecordingError: for another format, without raw calibrated signals, or for units that are not known.
        """
        if path.is_dir():
            return joined([self.measured(file) for file in self.files(path)], path.name)
        return self.measured_rows(self.read(path))

    def measured_rows(self, rows: Rows) -> Measured:
        """All sensors of the rows of a file, with the notes about them."""
        whole = self.content(rows)
        return whole._replace(notes=(*rows.notes, *whole.notes))

    def read(self, path: Path) -> Rows:
        """The table of a file, its cells unread.

        Raises:
            OSError: if the file does not exist, or may not be read.
            RecordingError: if it is empty, no text, has no such header or no rows, or a row has another length.
        """
        check_file(path, self.expected)
        lines = text_lines(path, self.expected)
        header_at = _header(lines, self.is_header)
        if header_at is None:
            begins = next((line for line in lines if line.strip()), "").strip()[:80]
            raise RecordingError(f"{path.name} has no such header: expected {self.expected}; it begins with {begins!r}")
        separator = header_at[1]
        header, row = _whole_header(lines, *header_at)
        check_columns(header, path.name)
        units: tuple[str, ...] = ()
        if self.units == "header":
            pairs = [cell.partition(" (") for cell in header]
            header, units = tuple(name for name, _, _ in pairs), tuple(unit.removesuffix(")") for _, _, unit in pairs)
        first = row + 1
        while first < len(lines) and not lines[first].strip():
            first += 1
        if self.units == "row" and first < len(lines) and not _any_number(split(lines[first], separator)):
            units = split(lines[first], separator)
            first += 1
        before = tuple(line[:LONGEST_NAME] for line in lines[: header_at[0]])
        return rows_of(path, lines, first, separator, header)._replace(before=before, units=units)


def rows_of(path: Path, lines: Sequence[str], first: int, separator: str, header: tuple[str, ...]) -> Rows:
    """The table in the lines from the `first` on, its cells unread; a last row that is cut off is left out, and noted.

    Raises:
        RecordingError: if there are no rows, or a row within them has another length.
    """
    import pandas as pd

    body = list(lines[first:])
    while body and not body[-1].strip():
        body.pop()
    if not body:
        there = ", ".join(filter(None, header))
        raise RecordingError(f"{path.name} has a header and no rows; its columns are {there}")
    notes: tuple[Note, ...] = ()
    if len(body) > 1 and (count := body[-1].count(separator)) < body[-2].count(separator):
        last = split(body.pop(), separator)[-1]
        notes = (
            ROW_CUT_OFF(
                line=first + len(body) + 1, cells=count + 1, expected=body[-1].count(separator) + 1,
                value=repr(last), rows=len(body),
            ),
        )  # fmt: skip
    check_lengths(body, separator, len(header), first + 1, path.name)
    decimal = "," if separator != "," and "," in body[-1] else "."
    cells = pd.read_csv(
        io.StringIO("\n".join(body)), sep=separator, decimal=decimal, header=None, index_col=False,
        skipinitialspace=separator != " ", skip_blank_lines=False, low_memory=False,
    )  # fmt: skip
    return Rows(path, (), header, first + 1, (), cells, notes)


def split(line: str, separator: str) -> tuple[str, ...]:
    """Cells of a line without blanks and quotes."""
    return tuple(cell.strip().strip('"').strip() for cell in line.rstrip("\r\n").split(separator))


def separator_of(line: str) -> str:
    """What separates the cells of a line: the mark that it has most of, a blank where it has none."""
    separator = max(SEPARATORS[:-1], key=line.count)
    return separator if separator in line else SEPARATORS[-1]


def text_lines(path: Path, expected: str) -> list[str]:
    """Lines of a text in UTF-8, or else in Windows' Western code, in which some systems write a degree or a ©."""
    line_breaks(path)
    raw = path.read_bytes()
    if b"\0" in raw:
        raise RecordingError(f"{path.name} is no text file (it holds bytes 0); expected {expected}")
    try:
        return raw.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace").splitlines()


def _header(lines: Sequence[str], is_header: Callable[[tuple[str, ...]], bool]) -> tuple[int, str] | None:
    """Line of the header, and what separates its cells."""
    for row, line in enumerate(lines[:HEADER_WITHIN]):
        separator = separator_of(line)
        if is_header(split(line, separator)):
            return row, separator
    return None


def _whole_header(lines: Sequence[str], row: int, separator: str) -> tuple[tuple[str, ...], int]:
    """The names of the header, and its last line: a header torn in two is joined where the rows are as long."""
    header = split(lines[row], separator)
    if row + 2 < len(lines) and not _any_number(rest := split(lines[row + 1], separator)):
        columns = len(split(lines[row + 2].rstrip(separator), separator))
        for whole in ((*header, *rest), (*header[:-1], *rest), (*header[:-1], header[-1] + rest[0], *rest[1:])):
            if len(header) < columns == len([name for name in whole if name]):
                return tuple(name for name in whole if name), row + 1
    return header, row


def _any_number(cells: Sequence[str]) -> bool:
    for cell in cells:
        try:
            float(cell.replace(",", "."))
        except ValueError:
            continue
        return True
    return False


def check_lengths(body: Sequence[str], separator: str, columns: int, first_line: int, name: str) -> None:
    """Refuse rows that are not all as long as the header, or longer by a separator at the end.

    Raises:
        RecordingError: naming the first line that is not.
    """
    counts = np.fromiter((line.count(separator) for line in body), np.int64, len(body)) + 1
    if counts[0] != columns and not (counts[0] == columns + 1 and body[0].rstrip(" \r").endswith(separator)):
        raise RecordingError(
            f"{name}, line {first_line}: the header has {columns} columns, the row has {counts[0]} values"
        )
    wrong = np.flatnonzero(counts != counts[0])
    if len(wrong):
        what = "is cut off" if counts[wrong[0]] < counts[0] else "is too long"
        raise RecordingError(
            f"{name}, line {first_line + wrong[0]}: the row {what}: expected {counts[0]} values, "
            f"found {counts[wrong[0]]}"
        )
