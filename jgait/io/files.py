"""Functions for all readers of files: check that a file exists and is not empty, import a library, convert strings."""

import contextlib
import importlib
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from jgait.notes import AS_READ, Note
from jgait.types import RecordingError, reason_of

if TYPE_CHECKING:
    import pandas as pd

type Tree = dict[str, Any]
"""Nested dictionaries, as libraries for JSON, MATLAB and C3D files return them."""

LONGEST_NAME = 300
"""[characters] Longest name of a column; chosen far above those of any system."""

LONGEST_LINE = 1_000_000
"""[characters] Longest line of a table; chosen far above that of any system."""

MOST_BYTES = 4_000_000_000
"""[bytes] Largest content of a file, as its headers declare it: chosen, a day of seven sensors at 100 Hz has 2.9e9."""

BRANDS = {
    b"Device Identity": "is of a GENEActiv, which has no gyroscope: every method needs one",
    b"GENEActiv": "is of a GENEActiv, which has no gyroscope: every method needs one",
    b"ActiGraph": "is of an ActiGraph's accelerometer alone: every method needs a gyroscope; of a GT9X Link, export "
    "the IMU as CSV from ActiLife",
}
"""First bytes of a file without a gyroscope → what it is."""


@contextlib.contextmanager
def reading(path: Path, expected: str) -> Iterator[None]:
    """Errors of a library in the block become a `RecordingError` with file, expected content and reason, but not those
    of a file that is not there or may not be read, nor a library that is not installed.
    """
    try:
        yield
    except (RecordingError, FileNotFoundError, PermissionError, ImportError):
        raise
    except MemoryError as error:
        raise RecordingError(f"{path.name} needs more memory than its size explains; expected {expected}") from error
    except Exception as error:
        raise RecordingError(f"{path.name} cannot be read; expected {expected}: {reason_of(error)}") from error


def numbered(names: Sequence[str], notes: list[Note]) -> list[str]:
    """Unique names: of those that stand for several signals, all but the first get a number; they are noted."""
    unique = [name if name not in names[:k] else f"{name}#{names[: k + 1].count(name)}" for k, name in enumerate(names)]
    if repeated := [name for k, name in enumerate(names) if names[:k].count(name) == 1]:
        notes.append(AS_READ.note(f"names that stand for several signals got numbers: {', '.join(repeated)}"))
    return unique


def check_columns(names: Sequence[str], name: str) -> None:
    """Refuse, by a RecordingError, a table with more columns, or longer names of columns, than any recording has."""
    if len(names) > 4096:
        raise RecordingError(f"{name} has {len(names)} columns; expected at most 4096")
    longest = max(map(len, names), default=0)
    if longest > LONGEST_NAME:
        raise RecordingError(f"{name} has a column name of {longest} characters; expected at most {LONGEST_NAME}")


def check_size(declared: int, path: Path) -> None:
    """Refuse, by a RecordingError, content of more bytes than `MOST_BYTES`, or than a file of this size holds, as it
    declares: any may declare 100 MB, and packed recordings take a third to a tenth of their content.
    """
    most = min(MOST_BYTES, max(100_000_000, 50 * path.stat().st_size))
    if declared > most:
        raise RecordingError(f"{path.name} declares a content of {declared} bytes; expected at most {most}")


def check_regular(path: Path, expected: str) -> None:
    """Refuse a path at which there is nothing (FileNotFoundError), or a device or a pipe (RecordingError)."""
    if not path.exists():
        raise FileNotFoundError(f"there is no such file: {path}")
    if not path.is_file() and not path.is_dir():
        raise RecordingError(f"{path.name} is not a regular file; expected {expected}")


def check_file(path: Path, expected: str) -> None:
    """Refuse a path at which there is nothing, or what may not be read (OSError), and what is no file, empty or too
    large, by a RecordingError with the `expected`.
    """
    check_regular(path, expected)
    if path.is_dir():
        raise RecordingError(f"{path.name} is a folder; expected {expected}")
    if not os.access(path, os.R_OK):
        raise PermissionError(f"{path} may not be read: you lack the permission")
    if not path.stat().st_size:
        raise RecordingError(f"{path.name} is empty; expected {expected}")
    check_size(path.stat().st_size, path)


def first_bytes(file: Path) -> bytes:
    """The first bytes of a file, by which its format is recognised."""
    with file.open("rb") as stream:
        return stream.read(4096)


def check_brand(path: Path) -> None:
    """Refuse, by a RecordingError that names it, a file of a device that has no gyroscope."""
    head = first_bytes(path)
    brand = next((words for begin, words in BRANDS.items() if begin in head[:200]), "")
    if brand and b"gyr" not in head.lower():
        raise RecordingError(f"{path.name} {brand}")


def cells_in_lines(path: Path, separator: str) -> np.ndarray:
    """(lines,) number of cells in each line of a text, 0 in an empty line; a separator in quotes separates none. Raises
    RecordingError for a byte 0, or a line of more than `LONGEST_LINE` bytes.
    """
    every, cells, length, quotes = [], 0, 0, 0
    with path.open("rb") as stream:
        while block := stream.read(2**20):
            raw = np.frombuffer(block, np.uint8)
            if not raw.all():
                raise RecordingError(f"{path.name} is no text file (it holds bytes 0); expected a table")
            is_mark, is_quote = raw == ord(separator), raw == ord('"')
            if quotes or is_quote.any():
                quoted = quotes + np.cumsum(is_quote)
                is_mark, quotes = is_mark & (quoted % 2 == 0), int(quoted[-1]) % 2
            marks = np.cumsum(is_mark, dtype=np.int32)
            ends = np.append(np.flatnonzero(raw == ord("\n")), len(raw) - 1)  # what follows the last is not whole
            lengths, counts = np.diff(ends, prepend=-1), np.diff(marks[ends], prepend=0)
            lengths[0], counts[0] = lengths[0] + length, counts[0] + cells
            if lengths.max() > LONGEST_LINE:
                raise RecordingError(f"{path.name} has a line of more than {LONGEST_LINE} characters; expected a table")
            empty = (lengths == 1) | ((lengths == 2) & (raw[ends - 1] == ord("\r")))
            every.append(np.where(empty, 0, counts + 1)[:-1])
            length, cells = int(lengths[-1]), int(counts[-1])
    return np.concatenate([*every, [cells + 1] * (length > 0)]).astype(int)


def library(name: str, expected: str, extra: str = "io") -> ModuleType:
    """A library of an extra of jgait. Raises ImportError, with how to install it, if it is not there."""
    try:
        return importlib.import_module(name)
    except ImportError as missing:
        raise ImportError(
            f"reading {expected} needs the extra {extra}: pip install 'jgait[{extra}]' ({missing})"
        ) from missing


def read_parquet(path: Path) -> "pd.DataFrame":
    """A Parquet file. Raises RecordingError if it is none, or declares too many columns or bytes."""
    parquet = library("pyarrow.parquet", "Parquet files")
    with reading(path, "a Parquet file"), parquet.ParquetFile(path) as file:
        about = file.metadata
        check_columns(file.schema_arrow.names, path.name)
        unpacked = sum(about.row_group(group).total_byte_size for group in range(about.num_row_groups))
        check_size(max(unpacked, 8 * about.num_rows * about.num_columns), path)
        table: pd.DataFrame = file.read().to_pandas()
        return table


def json_object(file: Path) -> Tree:
    """The content of a JSON file. Raises RecordingError if it is none, or no object."""
    check_regular(file, "a JSON file")
    try:
        content = json.loads(file.read_text(encoding="utf-8-sig"))
    except ValueError as error:
        raise RecordingError(f"{file.name} is no JSON: {error}") from error
    if not isinstance(content, dict):
        raise RecordingError(f"{file.name} must be a JSON object; it is a {type(content).__name__}")
    return content


def numbers(column: "pd.Series") -> tuple[np.ndarray, "pd.Series"]:
    """(T,) a column as floats, NaN in cells that are empty or no numbers, and the latter."""
    import pandas as pd

    values = pd.to_numeric(column, errors="coerce")
    plain = isinstance(column.dtype, np.dtype) and column.dtype.kind in "fiub"
    return values.to_numpy(np.float64, na_value=np.nan), column[:0] if plain else column[values.isna() & column.notna()]


def plain(value: object) -> str:
    """Text of a string in a file, which may be bytes, an array of one string, and padded with blanks or zeros."""
    if isinstance(value, np.ndarray):
        value = value.ravel()[0] if value.size else ""
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    return str(value).replace("\0", " ").strip()


def positive(*candidates: ArrayLike | None) -> float | None:
    """The first candidate that is a positive finite number, or an array of one; None if there is none."""
    for value in candidates:
        try:
            number = float(np.asarray(value, np.float64).item())
        except (TypeError, ValueError):
            continue
        if np.isfinite(number) and number > 0.0:
            return number
    return None


def three_columns(values: ArrayLike, what: str, rows: int | None = None) -> np.ndarray:
    """(T, 3) numbers or NaN of a file, with a required number of rows. Raises RecordingError for anything else."""
    try:
        columns = np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{what} must be numbers: {error}") from error
    if columns.ndim != 2 or columns.shape[1] != 3 or (rows is not None and len(columns) != rows):
        expected = f"({'samples' if rows is None else rows}, 3)"
        raise RecordingError(f"{what} must have shape {expected}; it has {columns.shape}")
    return columns
