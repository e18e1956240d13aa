"""What is doubtful about the rows of a table: labels of people and days that look alike, and copied recordings."""

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jgait.notes import Kind, Note

ALIKE = Kind(
    "labels_alike", "check", "{labels} in the column {column!r} count as different {many}",
    "If they are one, the same person or day is in both parts of a split, and intervals are too narrow: write it in "
    "one way in all rows.",
)  # fmt: skip

DAYS_MIXED = Kind(
    "days_mixed", "check", "days are written in several ways, such as {ways}",
    "A day that is written in two ways counts as two days, so that it is in both parts of a split: write all days in "
    "one way, such as 2026-05-01.",
)  # fmt: skip

COPIED = Kind(
    "recording_copied", "check", "{recording} and {other} hold the same recording{rounded}",
    "It counts twice, or as the recording of another person or day: intervals are too narrow, and what is tuned is "
    "judged on data that it was learned from. Leave one of the two out.",
)  # fmt: skip

COMPARED = 32
"""Number of lines of two files that are compared, evenly spread; chosen: people and walks differ in each line."""

LEAST_NUMBERS = 32
"""Least number of different numbers in these lines without which two files that are not equal in every character are
not taken as copies: signals that are all rounded to a few values are alike by chance; chosen."""

DATE = re.compile(r"\d{1,4}([-./ ])\d{1,2}\1\d{1,4}")
"""Dates in numbers."""


def label_notes(rows: Iterable[Mapping[str, str]]) -> list[Note]:
    """Notes on labels of people and of days that differ in zeros before numbers, and on dates in several ways."""
    rows = list(rows)
    notes = []
    for column, many in (("subject", "people"), ("day", "days")):
        groups: dict[str, dict[str, None]] = {}
        for label in filter(None, (row.get(column) for row in rows)):
            groups.setdefault(_number_free_of_zeros(label), {})[label] = None
        notes += [
            ALIKE(labels=list(map(repr, same)), column=column, many=many) for same in groups.values() if len(same) > 1
        ]
    ways: dict[str, str] = {}
    for day in filter(DATE.fullmatch, (row.get("day") or "" for row in rows)):
        ways.setdefault(re.sub(r"\d+", lambda digits: "y" if len(digits[0]) == 4 else "d", day), day)
    return notes + ([DAYS_MIXED(ways=list(map(repr, ways.values())))] if len(ways) > 1 else [])


def _number_free_of_zeros(label: str) -> str:
    """A label with its whole numbers in one way: 01, 1 and 1.0 are 1, sub-01 is sub-1; 1.10 is not 1.1."""
    whole = re.sub(r"^(\d+)\.0+$", r"\1", label.strip().casefold())
    return whole if re.fullmatch(r"\d*\.\d+", whole) else re.sub(r"(?<!\d)0+(?=\d)", "", whole)


def copy_notes(files: Mapping[str, Path]) -> list[Note]:
    """Notes on recordings, by name, whose files are copies, also with rounded numbers; files that cannot be read are
    no copies.
    """
    known: dict[int, list[tuple[str, _Content]]] = {}
    notes = []
    for name, path in files.items():
        try:
            content = _content(path)
        except OSError:
            continue
        same = known.setdefault(content.length, [])
        for other, theirs in same:
            if content.digest == theirs.digest or _rounded(content.lines, theirs.lines):
                rounded = "" if content.digest == theirs.digest else ", with numbers rounded or written otherwise"
                notes.append(COPIED(recording=name, other=other, rounded=rounded))
                break
        else:
            same.append((name, content))
    return notes


class _Content(NamedTuple):
    """A file, or all files of a folder: number of lines, digest, and some of the lines."""

    length: int
    digest: bytes
    lines: Sequence[bytes]


def _content(path: Path) -> _Content:
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    data = b"\n".join(file.read_bytes() for file in files)
    lines = data.splitlines()
    some = np.unique(np.linspace(0, len(lines) - 1, COMPARED).astype(int)) if lines else np.zeros(0, int)
    return _Content(len(lines), hashlib.sha256(data).digest(), [lines[number] for number in some])


def _rounded(ours: Sequence[bytes], theirs: Sequence[bytes]) -> bool:
    """Whether lines hold the same numbers, equal when rounded to as many decimals as the one with fewer has."""
    numbers: set[float] = set()
    for line, other in zip(ours, theirs, strict=True):
        cells, known = (re.split(rb"[,;\t]", each) for each in (line, other))
        if len(cells) != len(known):
            return False
        for cell, like in zip(cells, known, strict=True):
            if cell.strip(b' "') == like.strip(b' "'):
                continue
            one, two = map(_number, (cell, like))
            if one is None and two is None:
                continue  # names of columns
            if one is None or two is None:
                return False
            step = 10.0 ** -min(map(_decimals, (cell, like)))
            if not abs(one - two) <= 0.501 * step:
                return False
            numbers |= {one, two}
    return len(numbers) >= LEAST_NUMBERS


def _number(cell: bytes) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _decimals(cell: bytes) -> int:
    """Number of decimals of a number as it is written."""
    digits, _, power = cell.strip().lower().partition(b"e")
    return len(digits.partition(b".")[2]) - int(power or 0)
