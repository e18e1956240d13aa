"""The computations of `jgait tune`: lessons, cross-validation, the fit to all people, and standard errors."""

import warnings
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import PyTree

from jgait import evaluate
from jgait import tune as tuning
from jgait.commands import cohort as cohorts
from jgait.commands.cohort_table import Source
from jgait.commands.console import Bar, console, count, note, progress, refused, say_flags, stop
from jgait.commands.options import measures_of
from jgait.estimators import Estimator
from jgait.estimators.proportions import SENSOR_SHARE
from jgait.evaluate.scores import Scores, score
from jgait.notes import Note, by_reason
from jgait.params import check_params, freed, names
from jgait.report.cohort import of_notes
from jgait.tune import CrossValidation, Fit, Identifiability, Lessons, Objective, Progress
from jgait.tune.checkpoint import OtherFitError
from jgait.tune.problem import coordinates
from jgait.types import Estimate, Recording, RecordingError, Walk

if TYPE_CHECKING:
    from distributed import Client

COMPARED = {"distance": "distance_m", "stride_length": "stride_length_m", "calibration": "stride_length_m"}
"""Loss → the quantity that it compares with the reference."""


def prepared(
    source: Source, pipeline: Estimator[PyTree, PyTree], failures: list[tuple[str, str]]
) -> tuple[Source, Estimator[PyTree, PyTree]]:
    """The cohort without signals, and an estimator that has prepared them; unreadable walks become failures."""
    made: dict[str, PyTree] = {}
    walks = []
    with progress() as bars:
        bar = Bar(bars)
        for walk in source.walks(failures, lambda number: bar("reading", number, len(source.items))):
            try:
                made[walk.recording.name] = pipeline.prepared(walk.recording)
            except Exception as error:  # is raised where the recording is asked for
                made[walk.recording.name] = error
            walks.append(walk._replace(recording=walk.recording._replace(sensors={})))

    def prepare(recording: Recording) -> PyTree:
        if isinstance(made[recording.name], Exception):
            raise made[recording.name]
        return made[recording.name]

    return source._replace(items=walks, read=None), pipeline._replace(prepare=prepare)


def lessons_of(
    pipeline: Estimator[PyTree, PyTree], source: Source, start: PyTree, names: list[str],
    failures: list[tuple[str, str]], losses: Sequence[str],
) -> Lessons:  # fmt: skip
    """The lessons of the cohort, with the measures of each person; walks whose reference cannot answer a loss are
    failures. Raises ValueError if there are none.
    """
    learned = {name.split(".")[0] for name in names}
    parameters = {m.name: m.parameter or m.name for m in pipeline.about.measures if m.name in measures_of(pipeline)}
    learned |= {name for name, parameter in parameters.items() if parameter in learned}
    if of_all := sorted(learned & set(parameters)):
        note(f"{', '.join(of_all)}: a single value is learned for all people, not one for each person")

    def body_of(walk: Walk) -> dict[str, np.ndarray]:
        # All lessons must have the same measures, so unknown measures get their default.
        body = cohorts.body(walk, tuple(parameters))
        if "height" in body:  # of the waist's estimator, to which it says how high the sensor is
            body = {"sensor_height": SENSOR_SHARE * body.pop("height"), **body}
        default = {name: getattr(start, parameter) for name, parameter in parameters.items() if name != "height"}
        known = {name: tuple(value) if np.ndim(value) else value for name, value in (default | body).items()}
        check_params(pipeline.with_body(start, known), pipeline.transforms)
        return {
            name: np.broadcast_to(np.asarray(value, float), np.shape(getattr(start, parameters[name])))
            for name, value in known.items() if name not in learned
        }  # fmt: skip

    lacks: list[tuple[str, str]] = []

    def answering(walks: Iterable[Walk]) -> Iterator[Walk]:
        for walk in walks:
            try:
                yield tuning.asked(walk, losses)
            except RecordingError as error:
                lacks.append((walk.recording.name, str(error)))

    needed = any(tuning.LOSSES[name].needs for name in losses)
    try:
        made = tuning.lessons(
            pipeline, answering(source.walks(failures, lambda _: None)), body=body_of, reference=needed
        )
    except ValueError:
        if lacks and len(lacks) == len(source.items):
            each = "; ".join(f"{reason} ({recordings})" for reason, recordings in by_reason(lacks).items())
            every = ", ".join(losses)
            raise ValueError(f"no recording of {source.title} can answer all of {every}: {each}") from None
        failures += lacks
        raise
    failures += [*lacks, *made.failures]
    return made


def say_notes(
    ready: Estimator[PyTree, PyTree], start: PyTree, walks: Source, made: Lessons, losses: Collection[str]
) -> None:
    """Print what is doubtful about the recordings learned from and their references; exits with code 2 if the
    references of all contradict the estimates, as in another unit, in what the losses compare.
    """
    compared = {quantity for loss, quantity in COMPARED.items() if loss in losses}
    off: dict[str, Note] = {}

    def judged(estimate: Estimate, walk: Walk) -> Scores:
        result = score(estimate, walk)
        off.update((walk.recording.name, line) for quantity, line in result.contradicts[::-1] if quantity in compared)
        return result

    rows = cohorts.evaluated(ready, start, walks, score=judged).recordings
    rows = rows[rows["recording"].isin(made.names)]
    if len(rows) > 1 and off.keys() >= set(rows["recording"]):
        name = rows["recording"].iloc[0]
        stop(
            f"the references of all {len(rows)} recordings contradict the estimates, such as {name}: {off[name]}. "
            f"{off[name].meaning}"
        )
    say_flags(of_notes(rows), "jgait evaluate of the same recordings")


class Groups(NamedTuple):
    """What is left out of the tuning in turn, and judged by it: people, or days of a single person."""

    labels: tuple[str, ...]  #: (n,) the group of each recording.
    singular: str  #: what a group is, in words.
    many: str


def groups_of(made: Lessons) -> Groups:
    """People; days if there is a single person and the day of every recording is known; a note names the others."""
    if len(set(made.subjects)) == 1 and all(made.days) and len(set(made.days)) > 1:
        return Groups(made.days, "day", "days")
    if len(set(made.subjects)) == 1 and any(made.days) and not all(made.days):
        without = ", ".join(name for name, day in zip(made.names, made.days, strict=True) if not day)
        note(f"days are not left out in turn, because the day of these recordings is not known: {without}")
    return Groups(made.subjects, "person", "people")


class Job(NamedTuple):
    """A tuning task."""

    pipeline: Estimator[PyTree, PyTree]
    start: PyTree  #: parameters to begin with.
    free: PyTree  #: transforms, fixed for all parameters but the learned ones.
    made: Lessons
    groups: Groups
    loss: Objective
    judge: str  #: name in `tune.LOSSES` of the error that is reported for each person.
    settings: dict[str, Any]  #: arguments of every fit.
    folds: int | None  #: groups of people or days; None: one is left out at a time.
    run: Path  #: folder of the checkpoints.
    part: tuple[int, int] | None = None  #: as of `tune.cross_validate`.
    client: "Client | None" = None

    @property
    def error(self) -> tuning.Loss:
        """The error that is reported, with its unit and its words."""
        return tuning.LOSSES[self.judge]


class TuningResults(NamedTuple):
    """What was learned, and what is known of it."""

    validation: CrossValidation[PyTree] | None
    fit: Fit[PyTree]  #: to all people.
    known: Identifiability | None
    left_out: list[str]  #: why steps were left out.
    errors: tuple[float, float] | None  #: median of the recordings before and after; None where people left out judge.


def run(job: Job, cross: bool, loss: Collection[str]) -> TuningResults | None:
    """`_learned` under a progress bar, its warnings printed; exits with code 2 if the parameters cannot be learned."""
    with progress() as bars, warnings.catch_warnings(record=True) as caught, refused("", TypeError):
        warnings.simplefilter("always")
        try:
            results = _learned(job, Bar(bars), cross, loss)
        except OtherFitError as error:
            stop(f"{error}; --fresh starts anew")
    for message in dict.fromkeys(str(warning.message) for warning in caught):
        note(message)
    return results


def _learned(job: Job, bar: Bar, cross: bool, loss: Collection[str]) -> TuningResults | None:
    """Cross-validate, fit, and compute which parameters the data determine; None of a part of the fits."""
    groups, data = job.groups, job.made.data
    if job.run.exists():
        console.print("continuing an earlier run with the same settings", highlight=False)

    def report(what: str, then: str = "") -> dict[str, Any]:
        """The arguments of a fit: its settings, its checkpoint, and its progress on the bar."""

        def state(p: Progress) -> None:
            bar(f"{what}: loss {p.loss:.4g}, gradient {p.gradient_norm:.2g}", p.done, p.total)
            if then and p.done == p.total:
                bar.begin(then)

        return {**job.settings, "checkpoint_file": job.run / "steps.npz", "progress": state}

    validation, left_out, errors = None, list[str](), None
    if cross and len(set(groups.labels)) < 2:
        left_out = [
            "cross-validation is left out: it needs two people, or one person on two days that are known, and there is "
            "only a single person"
        ]
    if cross and not left_out:
        bar.begin(f"learning from all people, and from other {groups.many} (compiling)")
        validation = tuning.cross_validate(
            job.loss, job.start, job.free, data, folds=job.folds, subjects=groups.labels, part=job.part,
            client=job.client, error=replace(job.loss, terms=((job.error.error, 1.0),)),
            **report(f"learning from other {groups.many}", f"judging the {groups.many} left out (compiling)"),
        )  # fmt: skip
        if validation is None:
            return None
        fit = validation.fit
    else:
        bar.begin("learning from all people (compiling)")
        fit = tuning.fit(
            job.loss, job.start, job.free, data, subjects=job.made.subjects, **report("learning from all people")
        )
        before, after = (
            float(evaluate.judged(job.pipeline, p, job.made, [job.judge])[job.judge].median())
            for p in (job.start, fit.params)
        )
        errors = before, after
    bar.begin("which parameters the data determine (compiling)")
    free = [name for name in names(fit.free) if name not in fit.not_learned]  # the others have been named
    known, why = None, ""
    if free:
        known, why = _determined(job._replace(free=freed(job.free, *free)), fit, set(loss) == {"likelihood"})
    return TuningResults(validation, fit, known, [*left_out, *filter(None, [why])], errors)


def _determined(job: Job, fit: Fit[PyTree], likelihood: bool) -> tuple[Identifiability | None, str]:
    """Which numbers the data determine; None and the reason where that cannot be computed."""
    people, numbers = len(set(job.made.subjects)), len(coordinates(fit.params, job.free).names)
    if fit.left_out:
        return None, "standard errors are left out, because some recordings were not used"
    why = (
        f"{count(numbers, 'number was', 'numbers were')} learned from {count(people, 'person', 'people')}, and "
        "there must be more people than numbers"
    )
    if people > numbers:
        try:
            return tuning.identifiability(
                job.loss, fit.params, job.free, job.made.data, subjects=job.made.subjects,
                information="hessian" if likelihood else "sandwich",
            ), ""  # fmt: skip
        except ValueError as error:
            why = str(error)
    return None, f"standard errors are left out: {why}"
