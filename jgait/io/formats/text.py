"""Tables in text files of measuring systems.

A file is read as its format states and never mended: a row within it that is shorter or longer than the others, or a
cell that holds no number where one must be, is an error that names file and line. A last row that is cut off is left
out, and noted. Empty cells are lost samples.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jgait.io.clock import TIME_UNITS
from jgait.io.files import check_columns, check_file, numbers
from jgait.io.names import is_number
from jgait.io.part import Measured, joined
from jgait.io.text import HEADER_WITHIN, Head, first_lines, head_of, rows_of, separator_of, split
from jgait.io.units import ACC_UNITS, GYR_UNITS, known_unit
from jgait.notes import Note
from jgait.types import RecordingError

if TYPE_CHECKING:
    import pandas as pd

HEAD = 4096  # [bytes] number of first bytes of a file that are read to recognise its format


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


def first_bytes(file: Path) -> bytes:
    """The first bytes of a file, by which its format is recognised."""
    with file.open("rb") as stream:
        return stream.read(HEAD)


def _whole_header(lines: Sequence[str], row: int, separator: str) -> tuple[tuple[str, ...], int]:
    """The names of the header, and its last line: a header torn in two is joined where the rows are as long."""
    header = split(lines[row], separator)
    if row + 2 < len(lines) and not any(map(is_number, rest := split(lines[row + 1], separator))):
        columns = len(split(lines[row + 2].rstrip(separator), separator))
        for whole in ((*header, *rest), (*header[:-1], *rest), (*header[:-1], header[-1] + rest[0], *rest[1:])):
            if rest and len(header) < columns == len([name for name in whole if name]):
                return tuple(name for name in whole if name), row + 1
    return header, row
