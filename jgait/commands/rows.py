"""What is doubtful about the rows of a table: labels of people and days that look alike, and copied recordings."""

import contextlib
import hashlib
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from jgait.notes import Kind, Note

LABELS_ALIKE = Kind(
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
    "recording_copied", "check", "{recording} and {other} hold the same recording",
    "It counts twice, or as the recording of another person or day: intervals are too narrow, and what is tuned is "
    "judged on data that it was learned from. Leave one of the two out.",
)  # fmt: skip

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
            LABELS_ALIKE(labels=list(map(repr, same)), column=column, many=many)
            for same in groups.values()
            if len(same) > 1
        ]
    ways: dict[str, str] = {}
    for day in filter(DATE.fullmatch, (row.get("day") or "" for row in rows)):
        ways.setdefault(re.sub(r"\d+", lambda digits: "y" if len(digits[0]) == 4 else "d", day), day)
    return notes + ([DAYS_MIXED(ways=list(map(repr, ways.values())))] if len(ways) > 1 else [])


def _number_free_of_zeros(label: str) -> str:
    """A label with its whole numbers in one way: 01, 1 and 1.0 are 1, sub-01 is sub-1; 1.10 is not 1.1."""
    whole = re.sub(r"^(\d+)\.0+$", r"\1", label.strip().casefold())
    return whole if re.fullmatch(r"\d*\.\d+", whole) else re.sub(r"(?<!\d)0+(?=\d)", "", whole)


def copies_among(files: Mapping[str, Path]) -> list[Note]:
    """Notes on the recordings, by name, whose files are copies; files that cannot be read are no copies."""
    names: dict[str, str] = {}
    copies = []
    for name, path in files.items():
        with contextlib.suppress(OSError):
            other = names.setdefault(content_of(path), name)
            copies += [COPIED(recording=name, other=other)] if other != name else []
    return copies


def content_of(path: Path) -> str:
    """The SHA-256 of a file, or of all files of a folder."""
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
