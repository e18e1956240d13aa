"""What is doubtful about the rows of a table: labels of people and days that look alike, and copied recordings."""

import hashlib
import itertools
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

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
    "recording_copied", "check", "{recording} and {other} hold the same recording{rounded}",
    "It counts twice, or as the recording of another person or day: intervals are too narrow, and what is tuned is "
    "judged on data that it was learned from. Leave one of the two out.",
)  # fmt: skip

COMPARED = 32
"""Number of lines of two files that are compared, evenly spread; chosen: people and walks differ in each line."""

VARIES = (0.25, 0.75)
"""[1] Share of these lines at which a column rises from the line before. Beyond are columns such as the time, which
rise alike in different recordings; chosen."""

LEAST_COLUMNS, MOST_OTHER = 3, 0.15
"""Least number of columns that vary, and [1] largest share of lines at which those of copies rise otherwise. Chosen: of
different recordings it is a half by chance, and rounding to one decimal changes less."""

CONTENT = re.compile(r"([0-9a-f]{64}) (\d+):([0-9a-f]+)")
"""What `content_of` gives for a table: a digest, the number of lines, and where columns rise."""

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


class Copy(NamedTuple):
    """Two recordings whose files are copies."""

    recording: str
    other: str
    rounded: bool  #: True if their numbers are rounded, or written otherwise.

    @property
    def note(self) -> Note:
        """The copy in words."""
        rounded = ", with numbers rounded or written otherwise" if self.rounded else ""
        return COPIED(recording=self.recording, other=self.other, rounded=rounded)


def copies_among(files: Mapping[str, Path]) -> list[Copy]:
    """Recordings, by name, whose files are copies, also with rounded numbers; files that cannot be read are no
    copies.
    """
    known, names, copies = Contents(), dict[str, str](), []
    for name, path in files.items():
        try:
            content = content_of(path)
        except OSError:
            continue
        if same := known.find(content):
            copies.append(Copy(name, names[same], rounded=content != same))
        else:
            known.add(content)
            names[content] = name
    return copies


def content_of(path: Path) -> str:
    """The SHA-256 of a file, or of all files of a folder; of tables also the number of lines, and at which of
    `COMPARED` lines each column rises, which numbers that are rounded or in another unit do as well.
    """
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    data = [file.read_bytes() for file in files]
    digest = hashlib.sha256(b"".join(data)).hexdigest()
    lines = [line for part in data for line in part.splitlines()]
    if len(lines) < COMPARED:
        return digest
    some = [re.split(rb"[,;\t]", lines[row]) for row in np.linspace(0, len(lines) - 1, COMPARED).astype(int)]
    cells = np.array([[*map(_number, row)] for row in itertools.zip_longest(*some, fillvalue=b"")])
    return f"{digest} {len(lines)}:{np.packbits(cells[:, 1:] > cells[:, :-1], axis=1).tobytes().hex()}"


class Contents:
    """Recordings, as `content_of` states their content, among which copies of others are looked for."""

    def __init__(self, contents: Iterable[str] = ()) -> None:
        self._digests: dict[str, str] = {}
        self._tables: dict[tuple[str, int], list[tuple[str, np.ndarray]]] = {}  # by numbers of lines and of columns
        for content in contents:
            self.add(content)

    def add(self, content: str) -> None:
        """Add a recording."""
        digest, length, rises = _parts(content)
        self._digests[digest] = content
        self._tables.setdefault((length, len(rises)), []).append((content, rises))

    def find(self, content: str) -> str | None:
        """The content of the recording of which this is a copy; None if there is none."""
        digest, length, rises = _parts(content)
        alike = (other for other, theirs in self._tables.get((length, len(rises)), ()) if _rise_alike(rises, theirs))
        return self._digests.get(digest) or next(alike, None)


def _parts(content: str) -> tuple[str, str, np.ndarray]:
    """The digest, the number of lines, and (columns, lines) 1 where a column rises; what is no table has no columns."""
    table = CONTENT.fullmatch(content)
    if table is None:
        return content, "", np.zeros((0, COMPARED - 1))
    rises = np.unpackbits(np.frombuffer(bytes.fromhex(table[3]), np.uint8))
    return table[1], table[2], rises.reshape(-1, COMPARED)[:, : COMPARED - 1]


def _rise_alike(ours: np.ndarray, theirs: np.ndarray) -> bool:
    shares = np.stack([ours, theirs]).mean(axis=-1)
    vary = np.all((shares > VARIES[0]) & (shares < VARIES[1]), axis=0)
    return bool(vary.sum() >= LEAST_COLUMNS and np.mean(ours[vary] != theirs[vary]) <= MOST_OTHER)


def _number(cell: bytes) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan
