"""`jgait tune`: parameters from a cohort by gradient, judged on people from whom they were not learned."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from jaxtyping import PyTree

from jgait.commands import cohort as cohorts
from jgait.commands import recordings
from jgait.commands.console import Bar, console, note, progress, say_failures, stop
from jgait.commands.folder import results_folder
from jgait.commands.pipeline import measures_of, pipeline_of, start_of
from jgait.estimators import Estimator
from jgait.types import Walk

if TYPE_CHECKING:
    from jgait.tune import Lessons


def tune(
    free: Annotated[str, typer.Option(help="What is learned, for example distance_scale,angle_noise.")],
    table: cohorts.File = None,
    dataset: cohorts.Dataset = None,
    simulated: cohorts.Simulated = None,
    loss: Annotated[str, typer.Option(help="distance, trajectory or likelihood (which needs no reference).")] = (
        "distance"
    ),
    judge: Annotated[str | None, typer.Option(help="The error by which people are judged; default: the loss.")] = None,
    steps: Annotated[int, typer.Option(min=1, help="Of the optimiser.")] = 60,
    rate: Annotated[float, typer.Option("--learning-rate", min=1e-6, help="Of the first step; decreases to 0.")] = 0.05,
    starts: Annotated[int, typer.Option(min=1, help="Number of starting points; the first is as given.")] = 1,
    folds: Annotated[int | None, typer.Option(min=2, help="Groups of people; default: each person alone.")] = None,
    cross: Annotated[
        bool, typer.Option("--cross-validation/--no-cross-validation", help="Judge on other people.")
    ] = True,
    estimator: cohorts.EstimatorName = "leg_ekf",
    paper: cohorts.Paper = False,
    params: cohorts.Params = None,
    gyr_unit: recordings.GyrUnit = None,
    acc_unit: recordings.AccUnit = None,
    seed: cohorts.Seed = 0,
    out: Annotated[Path, typer.Option(help="Folder for results; an interrupted run continues there.")] = (
        Path("jgait-tuning")
    ),
    fresh: Annotated[bool, typer.Option("--fresh", help="Delete the results of an earlier run in the folder.")] = False,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the numbers here.")] = None,
) -> None:
    """Learn parameters from a cohort by gradient, and judge them on people from whom they were not learned.

    Writes tuned.json (for `jgait evaluate --params` and `jgait estimate --params`), held_out.csv and figures. Exit
    code 0: all recordings were used; 1: some could not be used; 2: nothing could be learned.
    """
    from jgait.commands import tune_report, tune_run
    from jgait.tune.checkpoint import OtherFitError

    for option, given in (("--loss", loss), ("--judge", judge or loss)):
        if given not in tune_run.LOSSES:
            stop(f"{option} is {', '.join(tune_run.LOSSES)}; got '{given}'")
    pipeline = pipeline_of(estimator, paper)
    start = start_of(pipeline, params, paper)
    names = [name.strip() for name in free.split(",") if name.strip()]
    freed = _freed(pipeline, names)
    source = cohorts.source(table, dataset, simulated, seed, gyr_unit, acc_unit, measures_of(pipeline))
    for line in source.notes:
        note(line)
    failures = list(source.failures)
    made = _lessons(pipeline, source, start, names, failures, {loss, judge or loss} != {"likelihood"})
    say_failures(failures)
    _check_reference(made, {loss, judge or loss}, source.title)
    how: dict[str, Any] = {
        "pipeline": "paper" if paper else "default", "free": names, "loss": loss, "steps": steps,
        "learning_rate": rate, "starts": starts, "seed": seed, "cohort": source.title,
        "recordings": len(made.names), "people": len(set(made.subjects)),
    }  # fmt: skip
    title = f"{pipeline.name}{', the paper’s pipeline,' if paper else ''} tuned on {source.title}"
    asked = {
        **how, "estimator": pipeline.name, "judge": judge or loss, "folds": folds, "cross_validation": cross,
        "params": None if params is None else str(params), **source.marks,
    }  # fmt: skip
    read = [table, params, *source.files]
    with results_folder(
        out, "tune", asked, planned=tune_report.PLANNED, inputs=read, json_file=json_file, fresh=fresh
    ) as folder:
        job = tune_run.job_of(
            pipeline, start, freed, made, loss, judge or loss, steps, rate, starts, folds, seed, folder.run
        )  # fmt: skip
        with progress() as bars, warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                results = tune_run.learned(job, Bar(bars), cross, loss)
            except OtherFitError as error:
                stop(f"{error}; --fresh starts anew")
            except (ValueError, TypeError, OSError) as error:
                stop(str(error))
        for message in dict.fromkeys(str(warning.message) for warning in caught):
            note(message)
        try:
            tune_report.report(title, job, results, how, folder, failures, json_file)
        except OSError as error:
            stop(f"nothing more could be written: {error}")
    if failures:
        console.print(f"{len(failures)} of {len(failures) + len(made.names)} recordings could not be used")
        raise typer.Exit(1)


def _freed(pipeline: Estimator[PyTree, PyTree], names: list[str]) -> PyTree:
    """The transforms of the learned parameters; exits with code 2 for an unknown name."""
    from jgait.params import freed

    if not names:
        stop("--free names nothing to learn")
    try:
        return freed(pipeline.transforms, *names)
    except ValueError as error:
        stop(f"--free: {error}")


def _lessons(
    pipeline: Estimator[PyTree, PyTree], source: cohorts.Source, start: PyTree, names: list[str],
    failures: list[tuple[str, str]], reference: bool,
) -> "Lessons":  # fmt: skip
    """The lessons of the cohort, with the measures of each person; exits with code 2 if there are none."""
    from jgait import tune as tuning
    from jgait.params import check_params

    learned = {name.split(".")[0] for name in names}
    measures = measures_of(pipeline)
    if learned & set(measures):
        note(
            f"{', '.join(sorted(learned & set(measures)))}: a single value is learned for all people, not one for each "
            "person"
        )

    def body_of(walk: Walk) -> dict[str, np.ndarray]:
        # All lessons must have the same measures, so unknown measures get their default.
        known = {name: getattr(start, name) for name in measures} | cohorts.body(walk, measures)
        known = {name: tuple(value) if np.ndim(value) else value for name, value in known.items()}
        check_params(pipeline.own(start, known), pipeline.transforms)
        both = {name: np.asarray(value, float) for name, value in known.items()}
        both |= {name: np.broadcast_to(both[name], 2) for name in both if isinstance(getattr(start, name), tuple)}
        return {name: value for name, value in both.items() if name not in learned}

    with progress() as bars:
        bar, total = Bar(bars), len(source.items)
        walks = source.walks(failures, lambda number: bar("reading", number, total))
        try:
            made = tuning.lessons(pipeline, walks, own=body_of, reference=reference)
        except ValueError as error:
            say_failures(failures)
            stop(str(error))
    failures += made.failures
    return made


def _check_reference(made: "Lessons", losses: set[str], title: str) -> None:
    """Exit with code 2 if the reference lacks a quantity that the losses need."""
    truth = made.data.reference
    if "trajectory" in losses and not any(truth.legs):
        stop(f"trajectory errors need joint angles, and the reference of {title} has none: --loss distance")
    if "distance" in losses and truth.distance is None:
        stop(f"distance errors need a distance, and the reference of {title} has none: --loss trajectory")
