"""A user's table of recordings: its rows, the measures of people, references, and what is doubtful about it."""

import contextlib
import csv
import functools
import hashlib
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import PyTree

from jgait import estimators, io
from jgait.commands.console import say_failures, stop
from jgait.commands.options import measures_of
from jgait.commands.recordings import OPTIONS, places_in, recording_of
from jgait.estimators import proportions
from jgait.estimators.about import BodyMeasure
from jgait.io.names import like_a_signal
from jgait.io.strides import TIMES
from jgait.io.text import read_table
from jgait.io.units import ACC_UNITS, GYR_UNITS, unit_scale
from jgait.notes import DEFAULT_MEASURE, LEFT_OUT, Kind, Note, meant
from jgait.quality import of_sensor
from jgait.types import Recording, Walk, people, reason_of

if TYPE_CHECKING:
    import pandas as pd

    from jgait.evaluate import Cohort

REFERENCES = ("reference_samples", "reference_strides")
"""Columns of files with a reference, see `io.reference_from_tables`."""

HOW = ("placement", "gyr_unit", "acc_unit")
"""Columns of what is stated of a recording, as by the options of the command."""

WORDS = OPTIONS | {name: f"column {name}" for name in HOW}
WORDS |= {"placements": "column placement", "sampling_rate_hz": "column rate_hz"}
"""Argument of a reader → the column, or the option, of the same meaning."""

SUBJECTS_UNKNOWN = Kind(
    "subjects_unknown", "info", "no column 'subject': every recording counts as another person",
    "If recordings are of the same people, intervals are narrower than they should be.",
)  # fmt: skip
MEASURE_OF_SOME = Kind(
    "measure_of_some", "check",
    "{without} of {recordings} {recordings:recording|recordings} {without:has|have} no {column}: the default length is "
    "taken for {without:it|them}",
    DEFAULT_MEASURE,
)  # fmt: skip
COPIED = Kind(
    "recording_copied", "check", "{recording} and {other} hold the same recording",
    "It counts twice, or as the recording of another person or day: intervals are too narrow, and what is tuned is "
    "judged on data that it was learned from. Leave one of the two out.",
)  # fmt: skip
DISTANCE_NOT_USED = Kind(
    "reference_distance_not_used", "check", "distance_m of the table is not used, because {file} has no such column",
    "The reference is that file's. Write the distance walked so far into it to compare the distance as well.",
)  # fmt: skip


@functools.cache
def columns_of_measures() -> dict[str, BodyMeasure]:
    """Column → the body measure in this column, for all estimators; measures that are parameters of an estimator."""
    return {
        f"{measure.name}_{measure.unit}": measure
        for estimator in map(estimators.get, estimators.names())
        for measure in estimator.about.measures if measure.name in measures_of(estimator)
    }  # fmt: skip


@functools.cache
def columns_of_numbers() -> dict[str, BodyMeasure]:
    """Column of numbers → its meaning and range."""
    rate = BodyMeasure("sampling_rate", "Hz", 0.1, 1e6, "sampling rate")
    return columns_of_measures() | {
        "distance_m": BodyMeasure("distance", "m", 0.01, 1e6, "distance walked"),
        "sampling_rate_hz": rate, "rate_hz": rate,
    }  # fmt: skip


def known_columns() -> tuple[str, ...]:
    """All columns that a table can have."""
    return ("file", "subject", "day", *columns_of_numbers(), *HOW, *REFERENCES)


def is_cohort(path: Path) -> bool:
    """Whether a table has a column `file`, and none of a sensor; False for a file that cannot be read."""
    if not path.is_file():
        return False
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as stream:
            header = stream.readline(100_000)
    except OSError:
        return False
    names = [name.strip().strip('"').lower() for name in re.split("[,;\t\n]", header)]
    return "file" in names and not any(map(like_a_signal, names))


def rows_of(path: Path) -> tuple[dict[str, dict[str, str]], list[str], list[tuple[str, str]]]:
    """The rows of a table by file, its columns, and (name, reason) of rows that cannot be used. Raises ValueError if it
    is no table with a column `file`.
    """
    if not path.is_file():
        raise ValueError(f"there is no such file: {path}")
    try:
        lines = [line for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip()]
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is no text file in UTF-8: {error}") from error
    if len(lines) < 2:
        raise ValueError(f"{path} must have a header and a row for each recording; it has {len(lines)} lines")
    separator = max((",", ";", "\t"), key=lines[0].count)
    header, *records = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    names = [name.strip().lower() for name in header]
    if "file" not in names:
        listed = ", ".join(map(repr, names[:8])) + (", …" if len(names) > 8 else "")
        raise ValueError(f"{path} needs a column 'file'; it has {listed}{meant('file', names, 0.6)}")
    rows: dict[str, dict[str, str]] = {}
    places: dict[Path, str] = {}
    failures: list[tuple[str, str]] = []
    for number, record in enumerate(records, 2):
        row = {name: cell.strip() for name, cell in zip(names, record, strict=False)}
        file = row.get("file", "")
        if len(record) > len(names):
            failures.append((file or f"line {number}", f"line {number} has more cells than the header has columns"))
        elif not file:
            failures.append((f"line {number}", "it names no file"))
        elif (first := places.setdefault((path.parent / file).resolve(), file)) != file or file in rows:
            twice = f"{file} is listed twice" if first == file else f"{file} and {first} are the same file"
            failures.append((f"line {number}", twice))
        else:
            rows[file] = row
    return rows, names, failures


class CohortFiles:
    """Reads the rows of a table; its `repr` has the units only, because the rows are stored with the results."""

    def __init__(
        self, folder: Path, rows: dict[str, dict[str, str]], gyr_unit: str | None, acc_unit: str | None
    ) -> None:
        for unit, units, option in ((gyr_unit, GYR_UNITS, "--gyr-unit"), (acc_unit, ACC_UNITS, "--acc-unit")):
            if unit is not None:
                unit_scale(unit, units, option)
        self.folder, self.rows, self.gyr_unit, self.acc_unit = folder, rows, gyr_unit, acc_unit
        self.shown = folder  #: as messages name it.

    def __repr__(self) -> str:
        given = {"angular rates": self.gyr_unit, "accelerations": self.acc_unit}
        return ", ".join(f"{what} in {unit or 'the unit of the file'}" for what, unit in given.items())

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "folder": self.folder.resolve()}  # another process may run in another folder

    def __call__(self, file: str) -> Walk:
        """The walk of a row, with its reference: a distance, and files of samples and of strides."""
        row = self.rows[file]
        recording, known = self.recording(file, gyr_unit=self.gyr_unit, acc_unit=self.acc_unit)
        way, info = _number(row, "distance_m"), {"body": known, "day": row.get("day")}
        files = [self.folder / row[name] if row.get(name) else None for name in REFERENCES]
        placement, imu = next(iter(recording.sensors.items()))
        time = np.asarray(imu.time, float)
        whole = None if way is None else io.reference_from_tables(time, distance=way)
        if not any(files):
            return Walk(recording, whole, info)
        begins = of_sensor(recording.quality, placement).begin
        tables = [None if path is None else _from_first(path, begins) for path in files]
        reference, samples = io.reference_from_tables(time, *tables), files[0]
        if reference.distance is None and whole is not None and samples is None:
            reference = reference._replace(distance=whole.distance, valid=whole.valid)
        elif reference.distance is None and samples is not None and way is not None:
            recording = recording._replace(notes=(*recording.notes, DISTANCE_NOT_USED(file=samples.name)))
        return Walk(recording, reference, info)

    def recording(self, file: str, **how: Any) -> tuple[Recording, dict[str, float]]:
        """The recording of a row, read by `recording_of` with further arguments, and the measures of its person."""
        row = self.rows[file]
        numbers = {name: _number(row, name) for name in columns_of_numbers()}
        if not (self.folder / file).exists():
            raise FileNotFoundError(f"there is no such file: {self.shown / file}")
        how["rate"] = numbers["sampling_rate_hz"] or numbers["rate_hz"] or how.get("rate")
        how |= {name: row[name] for name in HOW if row.get(name)}
        if "=" in (named := row.get("placement", "")):
            how |= places_in(each.strip() for each in named.split(";"))
        how |= {"name": file, "subject": row.get("subject") or file, "options": WORDS}
        recording = recording_of(self.folder / file, **how)
        known = {measure.name: numbers[name] for name, measure in columns_of_measures().items()}
        return recording, {name: value for name, value in known.items() if value is not None}

    def files(self, file: str, columns: Sequence[str] = ("file", *REFERENCES)) -> dict[str, Path]:
        """The files in these columns of a row, by the names in its cells."""
        named = filter(None, map(self.rows[file].get, columns))
        return {name: self.folder / name for name in named}

    def mark(self, file: str) -> str:
        """A text for a row and the versions of its files."""
        row, states = self.rows[file], []
        for path in self.files(file).values():
            state = path.stat() if path.exists() else None
            states.append("missing" if state is None else f"{state.st_size} bytes of {state.st_mtime_ns}")
        cells = ", ".join(f"{name} {row[name]}" for name in known_columns() if row.get(name) and name != "file")
        return f"{cells} ({'; '.join(states)})"


def _number(row: dict[str, str], name: str) -> float | None:
    """The number in a column, None where the cell is empty. Raises ValueError if it is none, or out of its range."""
    measure, text = columns_of_numbers()[name], row.get(name, "")
    if not text:
        return None
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        value = math.nan
    if not measure.low <= value <= measure.high:
        raise ValueError(f"{name} must be between {measure.low:g} and {measure.high:g} {measure.unit}; got {text!r}")
    return value


def table_notes(names: Sequence[str], rows: Mapping[str, Mapping[str, str]], measures: Sequence[str]) -> list[Note]:
    """Notes about columns that the user may have misspelt or forgotten; `measures` are those of the estimator."""
    others = [name for name in names if name not in known_columns()]
    notes = [LEFT_OUT.note(f"column {name!r} is left out{meant(name, known_columns(), 0.7)}") for name in others]
    if not any(row.get("subject") for row in rows.values()):
        notes.append(SUBJECTS_UNKNOWN())
    # measures of which a note says that the default is used: the result is proportional to them, or shifted
    asked = {
        name for about in map(estimators.about_of, estimators.names()) for of in about.missing for name in of.measures
    }
    for name in [name for name in measures if name in asked and name != "height"]:
        columns = (f"{name}_m", "height_m") if name in (*proportions.SHARES, "sensor_height") else (f"{name}_m",)
        without = sum(not any(row.get(column) for column in columns) for row in rows.values())
        if without:
            notes.append(MEASURE_OF_SOME(without=without, recordings=len(rows), column=" nor ".join(columns)))
    return notes


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


def _from_first(file: Path, begins: float) -> "pd.DataFrame":
    """A table of a reference whose times count from a sample with this time in the file [s]."""
    if not file.exists():
        raise FileNotFoundError(f"there is no such file: {file}")
    table = read_table(file)[0]
    times = {name: table[name] - begins for name in ("time_s", *(f"{name}_s" for name in TIMES)) if name in table}
    return table.assign(**times) if begins else table


class Source(NamedTuple):
    """A cohort before its recordings are read."""

    title: str  #: name of the cohort.
    items: list[PyTree]  #: walks, or names for `read`.
    #: name → walk; raises for a walk that cannot be read. None where the items are walks.
    read: Callable[[PyTree], Walk] | None
    marks: dict[str, str]  #: name → the inputs of its result, so that a run that continues detects changed inputs.
    failures: list[tuple[str, str]]  #: (name, reason) of rows that cannot be items.
    notes: list[Note]  #: notes for the user.
    files: Sequence[Path] = ()  #: files of the user that are read.
    subjects: Mapping[str, str] = {}  #: name → subject, as far as known before the recordings are read.
    copies: Sequence[Note] = ()  #: notes on recordings whose files are copies.

    def with_failures(self, results: "Cohort") -> "tuple[Cohort, list[tuple[str, str]]]":
        """Results whose failures contain rows that cannot be items, and these (recording, reason), printed; exits with
        code 2 if nothing could be used.
        """
        import pandas as pd

        rows = pd.DataFrame(self.failures, columns=["recording", "reason"])
        every = pd.concat([rows, results.failures], ignore_index=True)
        stated = every["recording"].map(lambda name: self.subjects.get(name) or None)
        every["subject"] = stated.fillna(every["subject"].astype(object)).fillna("")
        failures = list(zip(every["recording"], every["reason"], strict=True))
        say_failures(failures)
        if not len(results.recordings):
            why = (
                "; people of --simulated wear sensors on thighs and shanks; run jgait simulate --placements "
                "foot_right,foot_left (or ankle_right, or waist), and give the table that it writes"
            )
            stop(f"none of the {len(failures)} recordings of {self.title} could be used{why * (self.read is None)}")
        return results._replace(failures=every[["recording", "subject", "reason"]]), failures

    def versions(self, names: Iterable[str], columns: Sequence[str] = ("file",)) -> dict[str, str]:
        """File → its content, of these recordings' files in columns of a table; else name → its mark."""
        if not isinstance(self.read, CohortFiles):
            return {name: f"{self.marks[name]}: {name}" for name in names if name in self.marks}
        paths = {file: path for name in names for file, path in self.read.files(name, columns).items()}
        return {file: content_of(path) for file, path in paths.items() if path.exists()}

    def walks(self, failures: list[tuple[str, str]], report: Callable[[int], None]) -> Iterable[Walk]:
        """Yields the walks one by one; walks that cannot be read are added to the failures."""
        for number, item in enumerate(self.items):
            report(number)
            try:
                walk = item if self.read is None else self.read(item)
            except ImportError:
                raise
            except Exception as error:  # an error in a single file must not stop the others
                failures.append((str(item), reason_of(error)))
            else:
                yield walk


def of_table(path: Path, gyr_unit: str | None, acc_unit: str | None, measures: Sequence[str]) -> Source:
    """Rows of a table, by file. Raises ValueError if it is no table with a column `file`, or a unit is unknown."""
    rows, names, failures = rows_of(path)
    named = [row for row in rows.values() if row.get("subject")]
    for row, name in zip(named, people(row["subject"] for row in named), strict=True):
        row["subject"] = name
    read = CohortFiles(path.parent, rows, gyr_unit, acc_unit)
    copies = copies_among({file: path.parent / file for file in rows})
    return Source(
        path.name, list(rows), read, {file: read.mark(file) for file in rows}, failures,
        [*table_notes(names, rows, measures), *copies], [each for file in rows for each in read.files(file).values()],
        {file: row["subject"] for file, row in rows.items() if row.get("subject")}, copies,
    )  # fmt: skip
