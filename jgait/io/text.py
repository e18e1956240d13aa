"""Tables in text files: where the header is, what separates cells, units below the header, a last row that is cut off.

Every reader of text finds its header in the first lines (`first_lines`, `Head`); `rows_of` reads the rows below.
"""

import csv
import itertools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jgait.io.files import (
    LONGEST_LINE,
    LONGEST_NAME,
    cells_in_lines,
    check_brand,
    check_columns,
    check_file,
    check_size,
)
from jgait.io.names import is_number, like_a_signal, unit_in_name
from jgait.io.units import known_unit, stated_unit
from jgait.notes import AS_READ, DATA_LOST, Note
from jgait.types import RecordingError

if TYPE_CHECKING:
    import pandas as pd

SEPARATORS = (",", ";", "\t")
HEADER_WITHIN = 60
"""[lines] Number of first lines that are searched for a header; chosen by hand, exports have up to 30 above it."""

TIMES = ("s", "sec", "ms", "us", "µs", "min", "h")  # units of time in a row of units


class Head(NamedTuple):
    """What the first lines of a text state of the table in it."""

    names: tuple[str, ...]  #: of the columns.
    above: tuple[str, ...]  #: lines above the header.
    separator: str
    first: int  #: number of lines before the first row.
    units: tuple[str, ...]  #: of the row below the header, without brackets; () where no row states units.
    decimal: str  #: decimal mark.
    encoding: str


def first_lines(path: Path, number: int = HEADER_WITHIN + 3) -> tuple[list[str], str]:
    """The first lines of a text, and its encoding: UTF-8, or Windows' Western code where these lines are no UTF-8.
    Raises RecordingError if a line is longer than `LONGEST_LINE`, or the file is no text.
    """
    with path.open("rb") as stream:
        lines = [line for _ in range(number) if (line := stream.readline(LONGEST_LINE + 1))]
    if max(map(len, lines), default=0) > LONGEST_LINE:
        raise RecordingError(f"{path.name} has a line of more than {LONGEST_LINE} characters; expected a table")
    raw, encoding = b"".join(lines), "utf-8-sig"
    if b"\0" in raw:
        raise RecordingError(f"{path.name} is no text file (it holds bytes 0); expected a table")
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError:
        encoding = "cp1252"
        text = raw.decode(encoding, "replace")
    return [line.rstrip("\r") for line in text.removesuffix("\n").split("\n")], encoding


def split(line: str, separator: str) -> tuple[str, ...]:
    """Cells of a line without blanks and quotes."""
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=separator != " "), [])
    except csv.Error:  # a cell of more than 128 kB
        cells = line.split(separator)
    return tuple(cell.strip().strip('"').strip() for cell in cells)


def separator_of(line: str, separators: Sequence[str] = SEPARATORS) -> str:
    """What separates the cells of a line: the mark that it has most of."""
    return max(separators, key=line.count)


def head_of(lines: Sequence[str], encoding: str, header: int, separator: str, last: int | None = None) -> Head:
    """The head of a table whose header begins in a line of its `first_lines`, and ends in the line `last`."""
    below = [row for row in range((header if last is None else last) + 1, len(lines)) if lines[row].strip()]
    cells = split(lines[below[0]], separator) if below else ()
    units = tuple(cell[1:-1].strip() if cell[:1] + cell[-1:] in ("[]", "()") else cell for cell in cells)
    stated = any(known_unit(cell) or cell in TIMES for cell in units)
    units = units if stated and not any(map(is_number, units)) else ()
    body = below[1:] if units else below
    decimal = "," if separator != "," and any("," in lines[row] for row in body or [header]) else "."
    above = tuple(line[:LONGEST_NAME] for line in lines[:header])
    first = body[0] if body else len(lines)
    return Head(split(lines[header], separator), above, separator, first, units, decimal, encoding)


def rows_of(path: Path, head: Head, *, strict: bool) -> tuple["pd.DataFrame", tuple[Note, ...]]:
    """The rows of a table, its columns by position; a last row that is cut off is left out, and noted.

    Args:
        path: the file.
        head: of the table.
        strict: whether a row that is shorter than the others is refused; else its lost cells are empty.

    Raises:
        RecordingError: if there are no rows, or a row has more cells than the header, or in a strict table less.
    """
    import pandas as pd

    columns = len(head.names)
    cells = cells_in_lines(path, head.separator)
    rows = head.first + np.flatnonzero(cells[head.first :])
    if not rows.size:
        there = ", ".join(filter(None, head.names))
        raise RecordingError(f"{path.name} has a header and no rows; its columns are {there}")
    check_size(8 * len(cells) * columns, path)
    cut = rows.size > 1 and cells[rows[-1]] < cells[rows[-2]]
    whole = rows[: rows.size - cut]
    usual = columns + int(cells[whole[0]] == columns + 1)  # a separator may end each row
    wrong = whole[(cells[whole] != usual) & (cells[whole] != 0) if strict else cells[whole] > usual]
    if len(wrong):
        names = head.separator.join(head.names).strip()[:80]
        what = "is cut off" if cells[wrong[0]] < usual else "is too long"
        raise RecordingError(
            f"{path.name}, line {wrong[0] + 1}: the row {what}: it has {cells[wrong[0]]} values, the header {columns}: "
            f"{names!r}; expected one line with a name for each column, such as foot_left_gyr_x, above the numbers"
        )
    try:
        table = pd.read_csv(
            path, sep=head.separator, decimal=head.decimal, header=None, names=range(columns), index_col=False,
            skiprows=head.first, nrows=rows.size - cut, skipinitialspace=head.separator != " ",
            encoding=head.encoding, encoding_errors="replace", low_memory=False,
        )  # fmt: skip
    except pd.errors.ParserError as error:
        raise RecordingError(f"{path.name} is no table: {error}") from error
    if not cut:
        return table, ()
    with path.open("rb") as stream:
        stream.seek(max(path.stat().st_size - LONGEST_LINE, 0))
        last = split(stream.read().decode("utf-8", "replace").rstrip().rpartition("\n")[2], head.separator)[-1]
    text = (
        "the file ends within a row: line {line} has {cells} of {expected} values, the last of them {value}; this row "
        "is left out, {rows} rows were read"
    )
    counts = {"line": rows[-1] + 1, "cells": cells[rows[-1]], "expected": cells[rows[-2]], "rows": rows.size - 1}
    return table, (DATA_LOST.note(text, value=repr(last), **counts),)


def read_table(file: Path) -> tuple["pd.DataFrame", tuple[Note, ...]]:
    """A table from a text file with a header; comma, semicolon or tab, decimal point or comma.

    Lines above the header are left out, and noted; units in the row below it are added to the names of the columns.
    gaitmap's two rows of names become two levels of columns.

    Raises:
        FileNotFoundError: if there is no such file.
        RecordingError: if the file is empty, no text, has no rows, or rows that are longer than the header.
    """
    import pandas as pd

    check_file(file, "a header and one row a sample")
    check_brand(file)
    lines, encoding = first_lines(file)
    filled = [row for row, line in enumerate(lines) if line.strip()]
    if not filled:
        raise RecordingError(f"{file.name} is empty; expected a header and one row a sample")
    header, levels = header_at(lines)
    separator = separator_of(lines[header])
    head = head_of(lines, encoding, header, separator, header + levels - 1)
    check_columns(head.names, file.name)
    if levels == 2:
        numbered = 0 if not _axis(split(lines[header + 1], separator)[0]) else None  # gaitmap's own rows have numbers
        table, notes = pd.read_csv(
            file, sep=separator, decimal=head.decimal, header=[0, 1], index_col=numbered, encoding=encoding,
            skiprows=header,
        ), tuple[Note, ...]()  # fmt: skip
    else:
        table, notes = rows_of(file, head, strict=False)
    if header != filled[0]:
        above = f"{filled.index(header)}: {lines[filled[0]].strip()[:80]}, …"
        notes = (AS_READ.note(f"lines above the header not read: {above}"), *notes)
    if levels == 2:
        return table, notes
    names = list(head.names)
    if head.units:
        stated = ", ".join(dict.fromkeys(filter(None, head.units)))
        notes = (*notes, AS_READ.note(f"the row below the header has units: {stated}"))
        units = [*head.units, *[""] * len(names)]
        names = [_with_unit(column, unit, file.name) for column, unit in zip(names, units, strict=False)]
    names = [name or f"Unnamed: {k}" for k, name in enumerate(names)]  # none is empty or twice, as in pandas
    table.columns = pd.Index(
        [f"{name}.{names[:k].count(name)}" if name in names[:k] else name for k, name in enumerate(names)]
    )
    return table, notes


def header_at(lines: Sequence[str]) -> tuple[int, int]:
    """The line of the header, and its number of rows: the first line that names three axes of a sensor, or begins two
    rows of names; the first filled line where none does. A comment is a header only where no other line is one.
    """
    for comment in (False, True):
        for row, line in enumerate(lines[:HEADER_WITHIN]):
            separator = separator_of(line)
            if line.startswith(("#", "//")) is comment and sum(map(_axis, split(line, separator))) >= 3:
                before = split(lines[row - 1], separator) if row else ()
                two = len(before) == line.count(separator) + 1 and sum(map(bool, before)) > len(before) / 2
                return (row - 1, 2) if two else (row, 1)
    # else the line above the first one of numbers, or the first line
    filled = [row for row, line in enumerate(lines) if line.strip()]
    for above, row in itertools.pairwise(filled):
        cells = split(lines[row], separator_of(lines[row]))
        if len(cells) > 2 and sum(map(is_number, cells)) > len(cells) / 2:
            return above, 1
    return (filled or [0])[0], 1


def _axis(cell: str) -> bool:
    """Whether the name of a column is that of an axis of a sensor, also in the body frames of gaitmap and mobgap."""
    return like_a_signal(cell) or re.fullmatch("(gyr|acc)_(pa|ml|si|is)", cell, re.IGNORECASE) is not None


def _with_unit(column: str, unit: str, name: str) -> str:
    """The name of a column with the unit below it, if it does not state this unit; refuses another one."""
    stated = stated_unit(column) or unit_in_name(column)
    if not unit or (stated is not None and (known_unit(stated) or stated) == (known_unit(unit) or unit)):
        return column
    if stated is not None and (known_unit(unit) or unit in TIMES):
        raise RecordingError(
            f"{name}: the column {column!r} has {unit!r} in the row below the header; correct one of the two units"
        )
    return f"{column} [{unit}]"
