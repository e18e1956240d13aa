"""The source of a cohort: a table of a user's files, a public data set, or simulated people."""

import csv
import difflib
import functools
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import jax
import typer
from jaxtyping import PyTree

from jgait import datasets, estimators
from jgait import evaluate as evaluation
from jgait.commands import machines
from jgait.commands.console import Bar, note, progress, refused, say_failures, stop
from jgait.commands.pipeline import measures_of, not_held_out, pipeline_of, start_of
from jgait.commands.recordings import recording_of
from jgait.commands.references import REFERENCES, with_reference
from jgait.commands.rows import content_of, copies_among, label_notes
from jgait.estimators import Estimator, proportions
from jgait.estimators.about import BodyMeasure
from jgait.evaluate import Cohort
from jgait.evaluate.store import OtherEvaluationError
from jgait.io.names import like_a_signal
from jgait.io.units import ACC_UNITS, GYR_UNITS, unit_scale
from jgait.notes import DEFAULT_MEASURE, LEFT_OUT, Kind, Note
from jgait.types import Measures, Recording, RecordingError, Walk, people, reason_of

MEASURES = {
    f"{measure.name}_{measure.unit}": measure
    for estimator in map(estimators.get, estimators.names())
    for measure in estimator.about.measures if measure.name in measures_of(estimator)
}  # fmt: skip
"""Column → the body measure in this column, for all estimators; measures that are parameters of an estimator."""

OTHERS = {
    "distance_m": BodyMeasure("distance", "m", 0.01, 1e6, "distance walked"),
    "sampling_rate_hz": BodyMeasure("sampling_rate", "Hz", 0.1, 1e6, "sampling rate"),
}
"""Other columns of numbers."""

COLUMNS = ("file", "subject", "day", *MEASURES, *OTHERS, *REFERENCES)
ASKED_FOR = {
    measure for name in estimators.names() for group in estimators.about_of(name).missing for measure in group.measures
}
"""Measures with a note if the default is used: the result is proportional to the measure, or shifted by its error."""

File = Annotated[
    Path | None,
    typer.Argument(
        metavar="[COHORT.csv]",
        help="One row for each recording. Columns: file (from the table's folder), and if known subject, day, "
        f"{', '.join(MEASURES)}, distance_m (walked, by a reference), sampling_rate_hz, reference_samples and "
        "reference_strides (files with joint angles, and with strides, of a reference).",
    ),
]
Dataset = Annotated[str | None, typer.Option(help="A public data set instead, such as walking5m or neura_sparse.")]
Simulated = Annotated[int | None, typer.Option(min=1, help="Number of simulated people on walks of 3 to 4 m instead.")]

SIMULATED_WORN = (
    "people of --simulated wear sensors on thighs and shanks; run jgait simulate --placements foot_right,foot_left (or "
    "ankle_right, or waist), and give the table that it writes"
)
"""Where a cohort of `Simulated` has sensors, for messages."""

Seed = Annotated[int, typer.Option(help="Random seed of simulated people, starting points and folds.")]
EstimatorName = Annotated[
    str,
    typer.Option("--estimator", "--method", help=f"Which estimator: {', '.join(estimators.names())}."),
]
OneEstimator = Annotated[
    str | None,
    typer.Option("--estimator", "--method", help=f"One method alone: {', '.join(estimators.names())}."),
]
Paper = Annotated[bool, typer.Option("--paper", help="The paper's pipeline instead of the default one.")]
Params = Annotated[
    Path | None, typer.Option("--params", help="Parameters of this file, or preset:NAME; see jgait presets.")
]

SUBJECTS_UNKNOWN = Kind(
    "subjects_unknown",
    "info",
    "no column 'subject': every recording counts as another person",
    "If recordings are of the same people, intervals are narrower than they should be.",
)
MEASURE_OF_SOME = Kind(
    "measure_of_some",
    "check",
    "{without} of {recordings} {recordings:recording|recordings} {without:has|have} no {column}: the default length is "
    "taken for {without:it|them}",
    DEFAULT_MEASURE,
)
WALK_REPEATED = Kind(
    "walk_repeated", "info", "{recording} is left out: it is the same walk as {other}",
    "A walk counts once. The recording can be loaded by its name with jgait.datasets.load.",
)  # fmt: skip


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

    def with_failures(self, results: Cohort) -> tuple[Cohort, list[tuple[str, str]]]:
        """Results of `evaluate.cohort` whose failures contain rows that cannot be items, and these (recording, reason),
        which are printed; exits with code 2 if nothing could be used.
        """
        import pandas as pd

        rows = pd.DataFrame(self.failures, columns=["recording", "reason"])
        every = pd.concat([rows, results.failures], ignore_index=True)
        stated = every["recording"].map(lambda name: self.subjects.get(name) or None)
        every["subject"] = stated.fillna(every["subject"].astype(object)).fillna("")
        failures = list(zip(every["recording"], every["reason"], strict=True))
        say_failures(failures)
        if not len(results.recordings):
            why = f"; {SIMULATED_WORN}" if self.read is None else ""
            stop(f"none of the {len(failures)} recordings of {self.title} could be used{why}")
        return results._replace(failures=every[["recording", "subject", "reason"]]), failures

    def versions(self, names: Iterable[str], columns: Sequence[str] = ("file",)) -> dict[str, str]:
        """File → its content, of the files of these recordings that are in the columns of a table; else name → the
        mark.
        """
        if not isinstance(self.read, CohortFiles):
            return {name: f"{self.marks[name]}: {name}" for name in names if name in self.marks}
        files = (self.read.rows[name].get(column) for name in names for column in columns)
        paths = {name: self.read.folder / name for name in files if name}
        return {name: content_of(path) for name, path in paths.items() if path.exists()}

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


def body(walk: Walk, measures: Sequence[str]) -> Measures:
    """The known measures of a person that the estimator takes; a height in the table gives those that it lacks."""
    stated = walk.info.get("body")
    known = datasets.body(walk) if stated is None else proportions.with_proportions(stated, measures)
    return {name: value for name, value in known.items() if name in measures}


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


def source(
    table: Path | None, dataset: str | None, simulated: int | None, seed: int, gyr_unit: str | None,
    acc_unit: str | None, measures: Sequence[str], params: Path | None = None,
) -> Source:  # fmt: skip
    """The cohort of the command's options, of files, of a public set or simulated, its notes printed; exits with code 2
    if there is none.

    Noted are missing `measures` of a person, which the estimator uses, and recordings on which `params` were tuned.
    """
    given = [name for name, value in (("a table", table), ("--dataset", dataset), ("--simulated", simulated)) if value]
    if len(given) != 1:
        stop(f"give one of: a table COHORT.csv, --dataset NAME, --simulated N; got {' and '.join(given) or 'none'}")
    with refused("", datasets.DatasetUnavailable, csv.Error):
        if table is not None:
            cohort = _of_table(table, gyr_unit, acc_unit, measures)
        else:
            cohort = _of_dataset(dataset) if dataset is not None else _simulated(simulated or 0, seed)
        tuned = () if params is None else not_held_out(params, cohort.versions(cohort.marks), cohort.subjects)
    cohort = cohort._replace(notes=[*cohort.notes, *tuned])
    for line in cohort.notes:
        note(line)
    return cohort


def _simulated(people: int, seed: int) -> Source:
    from jgait import simulate
    from jgait.simulate.sensors import IDG300

    ways = [simulate.straight(3.1 + 0.9 * number / people) for number in range(people)]
    simulated = simulate.cohort(jax.random.key(seed), people, ways, IDG300, 50.0, simulate.FOUR)
    walks = [Walk(recording, truth.estimate, {}) for recording, truth in simulated]
    marks = {walk.recording.name: f"simulated people, seed {seed}" for walk in walks}
    return Source(f"{people} simulated people", walks, None, marks, [], [])


def of_set(name: str, recording: str) -> Walk:
    """The recording of this name of a public set. Raises RecordingError if it cannot be read, or there is none."""
    walks = datasets.load(name, only=(recording,))
    if not walks:
        raise RecordingError(walks.failures[0].reason if walks.failures else f"there is no recording {recording!r}")
    return walks[0]


def _of_dataset(name: str) -> Source:
    again = datasets.repeated(name)  # the message of DatasetUnavailable states how to get the set
    names = [recording for recording in datasets.names(name) if recording not in again]
    notes = [WALK_REPEATED(recording=recording, other=other) for recording, other in again.items()]
    return Source(name, names, functools.partial(of_set, name), dict.fromkeys(names, name), [], notes)


class CohortFiles:
    """Reads the rows of a table; its `repr` has the units only, because the rows are stored with the results."""

    def __init__(
        self, folder: Path, rows: dict[str, dict[str, str]], gyr_unit: str | None, acc_unit: str | None
    ) -> None:
        self.folder, self.rows, self.gyr_unit, self.acc_unit = folder, rows, gyr_unit, acc_unit
        self.shown = folder  #: as messages name it.

    def __repr__(self) -> str:
        given = {"angular rates": self.gyr_unit, "accelerations": self.acc_unit}
        return ", ".join(f"{what} in {unit or 'the unit of the file'}" for what, unit in given.items())

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "folder": self.folder.resolve()}  # another process may run in another folder

    def __call__(self, file: str) -> Walk:
        """The walk of a row, with its reference."""
        row = self.rows[file]
        recording, known = self.recording(file, gyr_unit=self.gyr_unit, acc_unit=self.acc_unit)
        files = [self.folder / row[name] if row.get(name) else None for name in REFERENCES]
        return with_reference(recording, _number(row, "distance_m"), files, {"body": known, "day": row.get("day")})

    def recording(self, file: str, **how: Any) -> tuple[Recording, dict[str, float]]:
        """The recording of a row, read by `recording_of` with further arguments, and the measures of its person."""
        row = self.rows[file]
        numbers = {name: _number(row, name) for name in (*MEASURES, *OTHERS)}
        path = self.folder / file
        if not path.exists():
            raise FileNotFoundError(f"there is no such file: {self.shown / file}")
        how["rate"] = numbers["sampling_rate_hz"] or how.get("rate")
        recording = recording_of(path, name=file, subject=row.get("subject") or file, **how)
        return recording, {
            measure.name: value for name, measure in MEASURES.items() if (value := numbers[name]) is not None
        }


def _number(row: dict[str, str], name: str) -> float | None:
    """The number in a column, None where the cell is empty. Raises ValueError if it is none, or out of its range."""
    measure, text = {**MEASURES, **OTHERS}[name], row.get(name, "")
    if not text:
        return None
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        value = math.nan
    if not measure.low <= value <= measure.high:
        raise ValueError(f"{name} must be between {measure.low:g} and {measure.high:g} {measure.unit}; got {text!r}")
    return value


def _of_table(path: Path, gyr_unit: str | None, acc_unit: str | None, measures: Sequence[str]) -> Source:
    """Rows of a table, by file.

    Raises:
        ValueError: if the file is no table with a column `file`, or a unit is unknown.
    """
    for unit, units, option in ((gyr_unit, GYR_UNITS, "--gyr-unit"), (acc_unit, ACC_UNITS, "--acc-unit")):
        if unit is not None:
            unit_scale(unit, units, option)
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
        near = difflib.get_close_matches("file", names, 1, 0.6)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        listed = ", ".join(map(repr, names[:8])) + (", …" if len(names) > 8 else "")
        raise ValueError(f"{path} needs a column 'file'; it has {listed}{hint}")
    rows: dict[str, dict[str, str]] = {}
    failures: list[tuple[str, str]] = []
    for number, record in enumerate(records, 2):
        row = {name: cell.strip() for name, cell in zip(names, record, strict=False)}
        file = row.get("file", "")
        if len(record) > len(names):
            failures.append((file or f"line {number}", f"line {number} has more cells than the header has columns"))
        elif not file or file in rows:
            failures.append((f"line {number}", f"{file} is listed twice" if file else "it names no file"))
        else:
            rows[file] = row
    of_somebody = [row for row in rows.values() if row.get("subject")]
    for row, name in zip(of_somebody, people(row["subject"] for row in of_somebody), strict=True):
        row["subject"] = name
    copies = copies_among({file: path.parent / file for file in rows})
    notes = [*_notes(names, rows, measures), *copies]
    files = {file: [path.parent / row[name] for name in ("file", *REFERENCES) if row.get(name)]
             for file, row in rows.items()}  # fmt: skip
    return Source(path.name, list(rows), CohortFiles(path.parent, rows, gyr_unit, acc_unit),
                  {file: _mark(row, files[file]) for file, row in rows.items()}, failures, notes,
                  [row_file for every in files.values() for row_file in every],
                  {file: row["subject"] for file, row in rows.items() if row.get("subject")}, copies)  # fmt: skip


def _notes(names: list[str], rows: dict[str, dict[str, str]], measures: Sequence[str]) -> list[Note]:
    """Notes about columns that the user may have misspelt or forgotten."""
    notes: list[Note] = []
    others = [name for name in names if name not in COLUMNS]
    for name in others:
        near = difflib.get_close_matches(name, COLUMNS, 1, 0.7)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        notes.append(LEFT_OUT.note(f"column {name!r} is left out{hint}"))
    if not any(row.get("subject") for row in rows.values()):
        notes.append(SUBJECTS_UNKNOWN())
    notes += label_notes(rows.values())
    for name in [name for name in measures if name in ASKED_FOR and name != "height"]:
        columns = (f"{name}_m", "height_m") if name in (*proportions.SHARES, "sensor_height") else (f"{name}_m",)
        without = sum(not any(row.get(column) for column in columns) for row in rows.values())
        if without:
            notes.append(MEASURE_OF_SOME(without=without, recordings=len(rows), column=" nor ".join(columns)))
    return notes


def _mark(row: dict[str, str], files: Iterable[Path]) -> str:
    """A text for a row and the versions of its files."""
    states = [file.stat() if file.exists() else None for file in files]
    stamp = "; ".join(
        "missing" if state is None else f"{state.st_size} bytes of {state.st_mtime_ns}" for state in states
    )
    cells = ", ".join(f"{name} {row[name]}" for name in COLUMNS if row.get(name) and name != "file")
    return f"{cells} ({stamp})"


def evaluated(
    pipeline: Estimator[PyTree, PyTree], start: PyTree, source: Source, dask: str | None = None, **settings: Any
) -> Cohort:
    """The results of `evaluate.cohort` with further settings, computed here or by the workers of the scheduler at an
    address; exits with code 2 if there can be none.
    """
    body_of = functools.partial(body, measures=measures_of(pipeline))
    with machines.client_of(dask) as client, progress() as bars, refused():
        bar, total = Bar(bars), len(source.items)
        bar("reading and computing", 0, total)
        try:
            return evaluation.cohort(
                pipeline, source.items, start, body=body_of, read=source.read, client=client,
                progress=lambda done, failed: bar(f"{done} recordings, {failed} of them failed", done, total),
                **settings,
            )  # fmt: skip
        except OtherEvaluationError as error:
            stop(f"{error}, as --fresh does")


def opened(
    table: Path | None, dataset: str | None, simulated: int | None, seed: int, estimator: str, paper: bool,
    params: Path | None, gyr_unit: str | None, acc_unit: str | None,
) -> tuple[Estimator[PyTree, PyTree], PyTree, Source]:  # fmt: skip
    """The estimator, its parameters and the cohort that the options of a command select; exits with code 2 if there is
    none.
    """
    pipeline = pipeline_of(estimator, paper, params)
    start = start_of(pipeline, params, paper)
    cohort = source(table, dataset, simulated, seed, gyr_unit, acc_unit, measures_of(pipeline), params)
    return pipeline, start, cohort
