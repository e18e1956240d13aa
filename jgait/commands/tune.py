"""`jgait tune`: parameters from a cohort by gradient, judged on people from whom they were not learned."""

import hashlib
import json
import shutil
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import jax
import numpy as np
import typer

from jgait.commands import cohort as cohorts
from jgait.commands import recordings, tune_report
from jgait.commands.console import Bar, console, count, note, progress, say_failures, stop
from jgait.commands.pipeline import measures_of, pipeline_of, start_of

LOSSES = {
    "distance": ("distance_percent", "%", "|error of the distance|"),
    "trajectory": ("trajectory_rms", "° or cm", "error of angles and foot path"),
    "likelihood": ("likelihood", "nat", "negative log-likelihood"),
}
"""Loss → the term that people are judged by, its unit and its name."""


class Job(NamedTuple):
    """What is learned, from whom, and how.

    Attributes:
        pipeline: the estimator.
        start: parameters to start from.
        free: transforms, all fixed but what is learned.
        made: the lessons.
        loss: what is minimised.
        error: what people are judged by.
        unit: of the error.
        judged: name of the error.
        optimizer: of optax.
        steps: of each fit.
        starts: of each fit.
        key: of starts and folds.
        folds: how many; None leaves one subject out at a time.
        run: folder of the checkpoints.
    """

    pipeline: Any
    start: Any
    free: Any
    made: Any
    loss: Any
    error: Any
    unit: str
    judged: str
    optimizer: Any
    steps: int
    starts: int
    key: Any
    folds: int | None
    run: Path


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
    for option, given in (("--loss", loss), ("--judge", judge or loss)):
        if given not in LOSSES:
            stop(f"{option} is {', '.join(LOSSES)}; got '{given}'")
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
    _make_room(out, fresh)
    from jgait.tune.checkpoint import OtherFitError

    job = _job(pipeline, start, freed, made, loss, judge or loss, steps, rate, starts, folds, seed, out / "run")
    with progress() as bars, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            results = _learned(job, Bar(bars), cross, loss)
        except OtherFitError as error:
            stop(f"{error}; --fresh starts anew")
        except (ValueError, TypeError) as error:
            stop(str(error))
    for message in dict.fromkeys(str(warning.message) for warning in caught):
        note(message)
    how = {
        "pipeline": "paper" if paper else "default", "free": names, "loss": loss, "steps": steps,
        "learning_rate": rate, "starts": starts, "seed": seed, "cohort": source.title,
        "recordings": len(made.names), "people": len(set(made.subjects)),
    }  # fmt: skip
    title = f"{pipeline.name}{', the paper’s pipeline,' if paper else ''} tuned on {source.title}"
    try:
        tune_report.report(title, job, results, how, out, failures, json_file)
    except OSError as error:
        stop(f"nothing more could be written: {error}")
    if failures:
        console.print(f"{len(failures)} of {len(failures) + len(made.names)} recordings could not be used")
        raise typer.Exit(1)


def _freed(pipeline: Any, names: list[str]) -> Any:
    from jgait.params import freed

    if not names:
        stop("--free names nothing to learn")
    try:
        return freed(pipeline.transforms, *names)
    except ValueError as error:
        stop(f"--free: {error}")


def _lessons(
    pipeline: Any, source: cohorts.Source, start: Any, names: list[str], failures: list[tuple[str, str]],
    reference: bool,
) -> Any:  # fmt: skip
    """The lessons of the cohort, with the measures of each person; leaves with 2 if there are none."""
    from jgait import tune as tuning
    from jgait.params import check_params

    learned = {name.split(".")[0] for name in names}
    measures = measures_of(pipeline)
    if learned & set(measures):
        note(
            f"{', '.join(sorted(learned & set(measures)))}: a single value is learned for all people, not one for each "
            "person"
        )

    def body_of(walk: Any) -> dict[str, Any]:
        # All lessons name the same measures, so those that are not known have their default.
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


def _check_reference(made: Any, losses: set[str], title: str) -> None:
    """Leave with 2 where the reference lacks what the losses need."""
    truth = made.data.reference
    if "trajectory" in losses and not any(truth.legs):
        stop(f"trajectory errors need joint angles, and the reference of {title} has none: --loss distance")
    if "distance" in losses and truth.distance is None:
        stop(f"distance errors need a distance, and the reference of {title} has none: --loss trajectory")


def _make_room(out: Path, fresh: bool) -> None:
    try:
        if fresh and (out / "run").is_dir():
            shutil.rmtree(out / "run")
        (out / "run").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        stop(f"{out} cannot be used: {error}")


def _job(
    pipeline: Any, start: Any, freed: Any, made: Any, loss: str, judge: str, steps: int, rate: float, starts: int,
    folds: int | None, seed: int, run: Path,
) -> Job:  # fmt: skip
    import optax

    from jgait import tune as tuning

    term, unit, judged = LOSSES[judge]
    objective, error = (tuning.objective(pipeline, made.options, name) for name in (loss, term))
    optimizer = optax.adam(optax.cosine_decay_schedule(rate, steps))
    settings = json.dumps([loss, repr(freed), repr(start), repr(made.options), steps, rate, starts, folds, seed])
    digest = hashlib.sha256(_without_addresses(settings).encode())
    for leaf in jax.tree.leaves(made.data):
        digest.update(np.ascontiguousarray(leaf).tobytes())
    return Job(
        pipeline, start, freed, made, objective, error, unit, judged, optimizer, steps, starts,
        jax.random.key(seed), folds, run / digest.hexdigest()[:12],
    )  # fmt: skip


def _without_addresses(text: str) -> str:
    import re

    return re.sub(r" at 0x[0-9a-f]+", "", text)


def _learned(job: Job, bar: Bar, cross: bool, loss: str) -> "tune_report.TuningResults":
    """Cross-validate, fit, and compute which parameters the data determine."""
    from jgait import tune as tuning

    people = len(set(job.made.subjects))
    shared = {
        "steps": job.steps, "starts": job.starts, "key": job.key, "subjects": job.made.subjects,
    }  # fmt: skip
    if job.run.exists():
        console.print("continuing an earlier run with the same settings", highlight=False)

    def report(what: str) -> Callable[[Any], None]:
        return lambda p: bar(f"{what}: loss {p.loss:.4g}, gradient {p.gradient_norm:.2g}", p.done, p.total)

    validation, why = None, ""
    if cross and people < 2:
        why = "cross-validation is left out: it needs two people, and there is only a single person"
    elif cross:
        bar("learning from other people (compiling)", 0, None)
        validation = tuning.cross_validate(
            job.loss, job.start, job.free, job.made.data, job.optimizer, folds=job.folds, error=job.error,
            progress=report("learning from other people"), checkpoint_file=job.run / "cross_validation.npz",
            **shared,
        )  # fmt: skip
    bar("learning from all people (compiling)", 0, None)
    fit = tuning.fit(
        job.loss, job.start, job.free, job.made.data, job.optimizer, progress=report("learning from all people"),
        checkpoint_file=job.run / "fit.npz", **shared,
    )  # fmt: skip
    bar("which parameters the data determine (compiling)", 0, None)
    known, unknown = _determined(job, fit, people, "hessian" if loss == "likelihood" else "sandwich")
    return tune_report.TuningResults(validation, fit, known, [line for line in (why, unknown) if line])


def _determined(job: Job, fit: Any, people: int, information: str) -> tuple[Any, str]:
    """Standard errors, or why there are none."""
    from jgait import tune as tuning

    numbers = sum(int(np.size(leaf)) for leaf in jax.tree.leaves(fit.free))
    if people <= numbers:
        return None, (
            f"standard errors are left out: {count(numbers, 'number was', 'numbers were')} learned from "
            f"{count(people, 'person', 'people')}, and there must be more people than numbers"
        )
    if fit.left_out:
        return None, "standard errors are left out, because some recordings were not used"
    loss, data = tuning.by_subject(job.loss, job.made.data, job.made.subjects)
    try:
        return tuning.identifiability(loss, fit.params, job.free, data, information=information), ""
    except ValueError as error:
        return None, f"standard errors are left out: {error}"
