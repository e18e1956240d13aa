"""A cohort, of a table of a user's files, a public data set, or simulated people, and an estimator on it."""

import csv
import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import jax
import typer
from jaxtyping import PyTree

from jgait import datasets
from jgait import evaluate as evaluation
from jgait.commands import machines
from jgait.commands.cohort_table import HOW, Source, columns_of_measures, of_table
from jgait.commands.console import Bar, count, note, progress, refused, stop
from jgait.commands.options import measures_of, not_held_out, pipeline_of, start_of
from jgait.estimators import Estimator, proportions
from jgait.evaluate import Cohort
from jgait.evaluate.store import OtherEvaluationError
from jgait.notes import Kind
from jgait.types import Measures, RecordingError, Walk

File = Annotated[
    Path | None,
    typer.Argument(
        metavar="[COHORT.csv]",
        help="One row for each recording. Columns: file (from the table's folder), and if known subject, day, "
        f"{', '.join(columns_of_measures())}, distance_m (walked, by a reference), reference_samples and "
        f"reference_strides (files with joint angles, and with strides, of a reference); also rate_hz, "
        f"{', '.join(HOW)}, where a file does not state its own.",
    ),
]
Dataset = Annotated[str | None, typer.Option(help="A public data set instead, such as walking5m or neura_sparse.")]
Simulated = Annotated[int | None, typer.Option(min=1, help="Number of simulated people on walks of 3 to 4 m instead.")]
Seed = Annotated[int, typer.Option(help="Random seed of simulated people, starting points and folds.")]

WALK_REPEATED = Kind(
    "walk_repeated", "info", "{recording} is left out: it is the same walk as {other}",
    "A walk counts once. The recording can be loaded by its name with jgait.datasets.load.",
)  # fmt: skip


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

        def finished(done: int, failed: int) -> None:
            bar(f"{count(done, 'recording', 'recordings')}, {failed} failed", done, total)

        try:
            return evaluation.cohort(
                pipeline, source.items, start, body=body_of, read=source.read, client=client,
                progress=finished, **settings,
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
