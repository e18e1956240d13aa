"""The source of a cohort: a table of a user's files, a public data set, or simulated people."""

import csv
import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import jax
import typer
from jaxtyping import PyTree

from jgait import datasets, estimators
from jgait import evaluate as evaluation
from jgait.commands import machines
from jgait.commands.cohort_table import HOW, MEASURES, CohortFiles, content_of, copies_among, rows_of, table_notes
from jgait.commands.console import Bar, note, progress, refused, say_failures, stop
from jgait.commands.pipeline import measures_of, not_held_out, pipeline_of, start_of
from jgait.estimators import Estimator, proportions
from jgait.evaluate import Cohort
from jgait.evaluate.store import OtherEvaluationError
from jgait.notes import Kind, Note
from jgait.types import Measures, RecordingError, Walk, people, reason_of

File = Annotated[
    Path | None,
    typer.Argument(
        metavar="[COHORT.csv]",
        help="One row for each recording. Columns: file (from the table's folder), and if known subject, day, "
        f"{', '.join(MEASURES)}, distance_m (walked, by a reference), reference_samples and reference_strides (files "
        f"with joint angles, and with strides, of a reference); also rate_hz, {', '.join(HOW)}, where a file does not "
        "state its own.",
    ),
]
Dataset = Annotated[str | None, typer.Option(help="A public data set instead, such as walking5m or neura_sparse.")]
Simulated = Annotated[int | None, typer.Option(min=1, help="Number of simulated people on walks of 3 to 4 m instead.")]
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


def body(walk: Walk, measures: Sequence[str]) -> Measures:
    """The known measures of a person that the estimator takes; a height in the table gives those that it lacks."""
    stated = walk.info.get("body")
    known = datasets.body(walk) if stated is None else proportions.with_proportions(stated, measures)
    return {name: value for name, value in known.items() if name in measures}


def source(
    table: Path | None, dataset: str | None, simulated: int | None, seed: int, gyr_unit: str | None,
    acc_unit: str | None, measures: Sequence[str], params: Path | None = None,
) -> Source:  # fmt: skip
    """The cohort that the options select, its notes printed; exits with code 2 if there is none. Noted are missing
    `measures` of a person, and recordings on which `params` were tuned.
    """
    given = [name for name, value in (("a table", table), ("--dataset", dataset), ("--simulated", simulated)) if value]
    if len(given) != 1:
        stop(f"give one of: a table COHORT.csv, --dataset NAME, --simulated N; got {' and '.join(given) or 'none'}")
    with refused("", datasets.DatasetUnavailable, csv.Error):
        if table is not None:
            cohort = of_table(table, gyr_unit, acc_unit, measures)
        elif dataset is not None:
            again = datasets.repeated(dataset)  # the message of DatasetUnavailable states how to get the set
            names = [recording for recording in datasets.names(dataset) if recording not in again]
            notes = [WALK_REPEATED(recording=recording, other=other) for recording, other in again.items()]
            marks = dict.fromkeys(names, dataset)
            cohort = Source(dataset, names, functools.partial(of_set, dataset), marks, [], notes)
        else:
            cohort = _simulated(simulated or 0, seed)
        tuned = () if params is None else not_held_out(params, cohort.versions(cohort.marks), cohort.subjects)
    cohort = cohort._replace(notes=[*cohort.notes, *tuned])
    for line in cohort.notes:
        note(line)
    return cohort


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


def evaluated(
    pipeline: Estimator[PyTree, PyTree], start: PyTree, source: Source, dask: str | None = None, **settings: Any
) -> Cohort:
    """The results of `evaluate.cohort`, computed here or by Dask's workers; exits with code 2 if there can be none."""
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
    estimator: str, paper: bool, params: Path | None, table: Path | None, dataset: str | None, simulated: int | None,
    seed: int, gyr_unit: str | None, acc_unit: str | None,
) -> tuple[Estimator[PyTree, PyTree], PyTree, Source]:  # fmt: skip
    """The estimator, its parameters and the cohort, as of `source`; exits with code 2 if there is none."""
    pipeline = pipeline_of(estimator, paper, params)
    start = start_of(pipeline, params, paper)
    cohort = source(table, dataset, simulated, seed, gyr_unit, acc_unit, measures_of(pipeline), params)
    return pipeline, start, cohort
