"""Rows of a table in a text file, and whether the file ends within its last row."""

import csv
import itertools
import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from jgait.io.files import check_brand, check_columns, check_file, check_size, first_lines, line_breaks
from jgait.io.names import like_a_signal, unit_in_name
from jgait.io.units import known_unit, stated_unit
from jgait.notes import AS_READ, Kind, Note
from jgait.types import RecordingError

if TYPE_CHECKING:
    import pandas as pd

SEPARATORS = (",", ";", "\t")

HEADER_WITHIN = 60
"""[lines] Number of first lines that are searched for a header."""

TIMES = ("s", "sec", "ms", "us", "µs", "min", "h")
"""Units of time in a row of units."""

TAIL = 2**20
"""[bytes] Size of the end of a file that is searched for its last row."""

ROW_CUT_OFF = Kind(
    "row_cut_off", "check",
    "the file ends within a row: line {line} has {cells} of {expected} values, the last of them {value}; this row is "
    "left out, {rows} rows were read",
    "The file was not written or copied to its end. What was measured after this row is missing.",
)  # fmt: skip


def read_table(file: Path) -> tuple["pd.DataFrame", tuple[Note, ...]]:
    """A table from a text file with a header; comma, semicolon or tab, decimal point or comma.

    Lines above the header are left out, and noted; units in the row below it are added to the names of the columns.

    Raises:
        FileNotFoundError: if there is no such file.
        RecordingError: if the file is empty, no text, has no rows, or rows that are longer than the header.
    """
    import pandas as pd

    check_file(file, "a header and one row a sample")
    check_brand(file)
    try:
        lines = first_lines(file, HEADER_WITHIN + 3)
    except UnicodeDecodeError as error:
        raise RecordingError(
            f"{file.name} is no text file in UTF-8 ({error}); save it as 'CSV UTF-8', or rename columns with umlauts"
        ) from error
    filled = [row for row, line in enumerate(lines) if line.strip()]
    if not filled:
        raise RecordingError(f"{file.name} is empty; expected a header and one row a sample")
    above = header_at(lines)
    header, *body = (row for row in filled if row >= above)
    separator = max(SEPARATORS, key=lines[header].count)
    check_columns(lines[header].split(separator), file.name)
    breaks = line_breaks(file)
    check_size(8 * breaks * (lines[header].count(separator) + 1), file.name)
    units = _units(lines[body[0]], separator) if body else []
    unread = [*range(above), *body[: 1 if units else 0]]
    body = body[1 if units else 0 :]
    decimal = "," if separator != "," and any("," in lines[row] for row in body or [header]) else "."
    try:
        with warnings.catch_warnings():
            # Without index_col=False, rows that are longer than the header would shift all columns by one, silently.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            table = pd.read_csv(
                file, sep=separator, decimal=decimal, encoding="utf-8-sig", skipinitialspace=True, index_col=False,
                skiprows=unread,
            )  # fmt: skip
    except pd.errors.ParserWarning as error:
        raise RecordingError(f"{file.name} has rows with more values than the header has columns") from error
    except (pd.errors.ParserError, UnicodeDecodeError) as error:
        raise RecordingError(f"{file.name} is no table: {_why(error, lines[header])}") from error
    if not len(table):
        raise RecordingError(f"{file.name} has a header and no rows; its columns are {list(table.columns)}")
    notes = (
        [AS_READ.note(f"lines above the header not read: {filled.index(header)}: {lines[filled[0]].strip()[:80]}, …")]
        if header != filled[0]
        else []
    )
    if units:
        stated = ", ".join(dict.fromkeys(filter(None, units)))
        notes.append(AS_READ.note(f"the row below the header has units: {stated}"))
        named = itertools.zip_longest(map(str, table.columns), units[: len(table.columns)], fillvalue="")
        table.columns = pd.Index([_with_unit(column, unit, file.name) for column, unit in named])
    note = _cut_off(file, separator, breaks, len(table) - 1)
    return (table, tuple(notes)) if note is None else (table.iloc[:-1], (*notes, note))


def header_at(lines: Sequence[str]) -> int:
    """The number of lines above the header: the first line that names three axes of a sensor, or begins two rows of
    names; 0 where none does. A comment is a header only where no other line is one.
    """
    for comment in (False, True):
        for row, line in enumerate(lines[:HEADER_WITHIN]):
            separator = max(SEPARATORS, key=line.count)
            if line.startswith(("#", "//")) is comment and sum(map(like_a_signal, line.split(separator))) >= 3:
                before = lines[row - 1].split(separator) if row else []
                names = (
                    len(before) == line.count(separator) + 1
                    and sum(map(bool, map(str.strip, before))) > len(before) / 2
                )
                return row - 1 if names else row
    return 0


def _units(line: str, separator: str) -> list[str]:
    """The units in a row below the header, without brackets, "" where there is none; empty for any other row."""
    cells = [cell.strip().strip('"').strip() for cell in line.split(separator)]
    cells = [cell[1:-1].strip() if cell[:1] + cell[-1:] in ("[]", "()") else cell for cell in cells]
    return cells if any(map(_is_unit, cells)) and not any(map(_is_number, cells)) else []


def _is_unit(cell: str) -> bool:
    return known_unit(cell) is not None or cell in TIMES


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _with_unit(column: str, unit: str, name: str) -> str:
    """The name of a column with the unit below it, if it does not state this unit; refuses another one."""
    stated = stated_unit(column) or unit_in_name(column)
    if not unit or (stated is not None and (known_unit(stated) or stated) == (known_unit(unit) or unit)):
        return column
    if stated is not None and _is_unit(unit):
        raise RecordingError(
            f"{name}: the column {column!r} has {unit!r} in the row below the header; correct one of the two units"
        )
    return f"{column} [{unit}]"


def _why(error: Exception, header: str) -> str:
    """The reason in words why the rows do not fit the header."""
    match = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
    if not match:
        return str(error)
    return (
        f"line {match[2]} has {match[3]} values, and the header {match[1]}: {header.strip()[:80]!r}; expected one line "
        "with a name for each column, such as foot_left_gyr_x, above the numbers"
    )


def _cut_off(file: Path, separator: str, breaks: int, whole: int) -> Note | None:
    """The note about a last row that has fewer cells than the row before; None if it has as many."""
    with file.open("rb") as stream:
        stream.seek(max(file.stat().st_size - TAIL, 0))
        end = stream.read()
    ended = end.rstrip(b"\r\n")
    lines = [line for line in ended.decode("utf-8", "replace").splitlines() if line.strip()][-2:]
    try:
        before, last = csv.reader(lines, delimiter=separator)
    except (csv.Error, ValueError):  # a cell of more than 128 kB, or one row
        return None
    if len(last) >= len(before):
        return None
    line = breaks - end[len(ended) :].count(b"\n") + 1
    return ROW_CUT_OFF(line=line, cells=len(last), expected=len(before), value=repr(last[-1]), rows=whole)
