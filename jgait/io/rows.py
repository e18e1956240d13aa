"""Rows of a table in a text file, and whether the file ends within its last row."""

import csv
import itertools
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jgait.io.files import check_columns, check_width
from jgait.notes import Kind, Note
from jgait.types import RecordingError

if TYPE_CHECKING:
    import pandas as pd

SHORT_CELLS = 1_000_000
"""Number of cells that rows of a table may lack."""

TAIL = 2**20
"""[bytes] Size of the end of a file that is searched for its last row."""

ROWS_BEFORE = 50
"""[1] Number of rows before the last one with which its last cell is compared."""

JUMP = 3.0
"""[1] Smallest difference of half a number from the number before, over the largest difference of those before."""

ROW_CUT_OFF = Kind(
    "row_cut_off", "check",
    "the file ends within a row: line {line} has {cells} of {expected} values, the last of them {value}; this row is "
    "left out, {rows} rows were read",
    "The file was not written or copied to its end. What was measured after this row is missing.",
)  # fmt: skip


def read_table(file: Path) -> tuple["pd.DataFrame", tuple[Note, ...]]:
    """A table from a text file with a header; comma, semicolon or tab, decimal point or comma.

    Raises:
        FileNotFoundError: if there is no such file.
        RecordingError: if the file is empty, no text, has no rows, or rows that are longer than the header.
    """
    import pandas as pd

    try:
        with file.open(encoding="utf-8-sig") as stream:
            lines = list(itertools.islice((line for line in stream if line.strip()), 2))
    except UnicodeDecodeError as error:
        raise RecordingError(
            f"{file.name} is no text file in UTF-8 ({error}); save it as 'CSV UTF-8', or rename columns with umlauts"
        ) from error
    if not lines:
        raise RecordingError(f"{file.name} is empty; expected a header and one row a sample")
    separator = max((",", ";", "\t"), key=lines[0].count)
    for line in lines:
        check_width(line, separator, file.name)
    breaks = _checked_breaks(file, lines[0].count(separator) + 1)
    decimal = "," if separator != "," and "," in lines[-1] else "."
    try:
        with warnings.catch_warnings():
            # Without index_col=False, rows that are longer than the header would shift all columns by one, silently.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            table = pd.read_csv(
                file, sep=separator, decimal=decimal, encoding="utf-8-sig", skipinitialspace=True, index_col=False
            )
    except pd.errors.ParserWarning as error:
        raise RecordingError(f"{file.name} has rows with more values than the header has columns") from error
    except (pd.errors.ParserError, UnicodeDecodeError) as error:
        raise RecordingError(f"{file.name} is no table: {error}") from error
    check_columns([str(column) for column in table.columns], file.name)
    if not len(table):
        raise RecordingError(f"{file.name} has a header and no rows; its columns are {list(table.columns)}")
    note = _cut_off(file, separator, breaks, len(table) - 1)
    return (table, ()) if note is None else (table.iloc[:-1], (note,))


def _checked_breaks(file: Path, columns: int) -> int:
    """Number of line breaks; refuses a file of more rows than it can have cells: each cell or separator is a byte."""
    with file.open("rb") as stream:
        rows = sum(block.count(b"\n") for block in iter(lambda: stream.read(2**20), b""))
    if rows * columns > file.stat().st_size + SHORT_CELLS:
        raise RecordingError(f"{file.name} has {columns} columns and {rows} rows, most of which are cut off or empty")
    return rows


def _cut_off(file: Path, separator: str, breaks: int, whole: int) -> Note | None:
    """The note about a last row that is not whole; None if it is.

    It is not whole if it has fewer cells than the row before, or if no line break ends it and its last cell looks like
    half a number: it is shorter than those of all rows before, lacks the decimals that all of them have, or differs
    from the row before by more than `JUMP` times what they differ.
    """
    with file.open("rb") as stream:
        stream.seek(max(file.stat().st_size - TAIL, 0))
        end = stream.read()
    ended = end.rstrip(b"\r\n")
    lines = [line for line in ended.decode("utf-8", "replace").splitlines() if line.strip()][-ROWS_BEFORE - 1 :]
    try:
        *before, last = csv.reader(lines, delimiter=separator)
    except csv.Error:  # a cell of more than 128 kB
        return None
    if not before or len(last) > len(before[-1]):
        return None
    if len(last) == len(before[-1]):
        cells = [row[-1].strip() for row in before if len(row) == len(last)]
        if ended != end or len(cells) < ROWS_BEFORE or not _half(last[-1].strip(), cells):
            return None
    line = breaks - end[len(ended) :].count(b"\n") + 1
    return ROW_CUT_OFF(line=line, cells=len(last), expected=len(before[-1]), value=repr(last[-1]), rows=whole)


def _half(cell: str, before: list[str]) -> bool:
    """Whether a cell looks like half a number, by the cells of the rows before it."""
    marks = [mark for mark in ".," if all(mark in other for other in before)]
    if len(cell) < min(map(len, before)) or not all(mark in cell for mark in marks):
        return True
    try:
        numbers = np.array([float(other.replace(",", ".")) for other in (*before, cell)])
    except ValueError:  # empty cells, or words
        return False
    steps = np.abs(np.diff(numbers))
    return bool(0.0 < JUMP * steps[:-1].max() < steps[-1])
