"""The walks of a cohort, prepared for losses."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from jaxtyping import PyTree

from jgait import tune as tuning
from jgait.commands import cohort as cohorts
from jgait.commands.console import Bar, note, progress
from jgait.commands.pipeline import measures_of
from jgait.estimators import Estimator
from jgait.estimators.proportions import SENSOR_SHARE
from jgait.notes import by_reason
from jgait.params import check_params
from jgait.tune import Lessons
from jgait.types import Recording, RecordingError, Walk


def prepared(
    source: cohorts.Source, pipeline: Estimator[PyTree, PyTree], failures: list[tuple[str, str]]
) -> tuple[cohorts.Source, Estimator[PyTree, PyTree]]:
    """The cohort, read, without the signals of its sensors, and an estimator that has prepared its recordings. Walks
    that cannot be read are added to the failures.
    """
    made: dict[str, PyTree] = {}
    walks = []
    with progress() as bars:
        bar = Bar(bars)
        for walk in source.walks(failures, lambda number: bar("reading", number, len(source.items))):
            name = walk.recording.name
            try:
                made[name] = pipeline.prepared(walk.recording)
            except Exception as error:  # is raised where the recording is asked for
                made[name] = error
            walks.append(walk._replace(recording=walk.recording._replace(sensors={})))

    def prepare(recording: Recording) -> PyTree:
        if isinstance(made[recording.name], Exception):
            raise made[recording.name]
        return made[recording.name]

    return source._replace(items=walks, read=None), pipeline._replace(prepare=prepare)


def lessons_of(
    pipeline: Estimator[PyTree, PyTree], source: cohorts.Source, start: PyTree, names: list[str],
    failures: list[tuple[str, str]], losses: Sequence[str],
) -> Lessons:  # fmt: skip
    """The lessons of the cohort, with the measures of each person. A walk whose reference cannot answer one of the
    losses is a failure.

    Raises:
        ValueError: if there are none.
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
        of_legs = {name for name in known if isinstance(getattr(start, parameters[name]), tuple)}
        return {
            name: np.broadcast_to(np.asarray(value, float), 2) if name in of_legs else np.asarray(value, float)
            for name, value in known.items()
            if name not in learned
        }

    lacks: list[tuple[str, str]] = []

    def answering(walks: Iterable[Walk]) -> Iterator[Walk]:
        for walk in walks:
            try:
                yield tuning.asked(walk, losses)
            except RecordingError as error:
                lacks.append((walk.recording.name, str(error)))

    with progress() as bars:
        bar = Bar(bars)
        walks = source.walks(failures, lambda number: bar("reading", number, len(source.items)))
        needed = any(tuning.LOSSES[name].needs for name in losses)
        try:
            made = tuning.lessons(pipeline, answering(walks), body=body_of, reference=needed)
        except ValueError:
            if lacks and len(lacks) == len(source.items):
                each = "; ".join(f"{reason} ({names})" for reason, names in by_reason(lacks).items())
                every = ", ".join(losses)
                raise ValueError(f"no recording of {source.title} can answer all of {every}: {each}") from None
            failures += lacks
            raise
    failures += [*lacks, *made.failures]
    return made
