"""The losses that an option names, and the walks of a cohort prepared for them."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from jaxtyping import PyTree

from jgait import tune as tuning
from jgait.commands import cohort as cohorts
from jgait.commands.console import Bar, note, progress, stop
from jgait.commands.pipeline import measures_of
from jgait.estimators import Estimator
from jgait.estimators.proportions import SENSOR_SHARE
from jgait.params import check_params
from jgait.tune import Lessons, objective, parsed
from jgait.types import Recording, RecordingError, Walk


def losses_of(option: str, text: str) -> dict[str, float]:
    """The losses and weights of an option; exits with code 2 if they cannot be read."""
    try:
        return parsed(text)
    except ValueError as error:
        stop(f"{option}: {error}")


def check_answers(pipeline: Estimator[PyTree, PyTree], losses: Sequence[str]) -> None:
    """Exit with code 2 if an estimator cannot answer one of the losses."""
    try:
        objective(pipeline, None, dict.fromkeys(losses, 1.0))
    except ValueError as error:
        stop(str(error))


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
                made[name] = pipeline.prepare(walk.recording)
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
    measures = tuple(parameters)
    if of_all := sorted(learned & set(measures)):
        note(f"{', '.join(of_all)}: a single value is learned for all people, not one for each person")

    def body_of(walk: Walk) -> dict[str, np.ndarray]:
        # All lessons must have the same measures, so unknown measures get their default.
        body = cohorts.body(walk, measures)
        if "height" in body:  # of the waist's estimator, to which it says how high the sensor is
            body = {"sensor_height": SENSOR_SHARE * body.pop("height"), **body}
        default = {name: getattr(start, parameter) for name, parameter in parameters.items() if name != "height"}
        known = default | body
        known = {name: tuple(value) if np.ndim(value) else value for name, value in known.items()}
        check_params(pipeline.own(start, known), pipeline.transforms)
        both = {name: np.asarray(value, float) for name, value in known.items()}
        of_legs = [name for name in both if isinstance(getattr(start, parameters[name]), tuple)]
        both |= {name: np.broadcast_to(both[name], 2) for name in of_legs}
        return {name: value for name, value in both.items() if name not in learned}

    lacks: list[tuple[str, str]] = []

    def answering(walks: Iterable[Walk]) -> Iterator[Walk]:
        for walk in walks:
            try:
                yield tuning.asked(walk, losses)
            except RecordingError as error:
                lacks.append((walk.recording.name, str(error)))

    with progress() as bars:
        bar, total = Bar(bars), len(source.items)
        walks = source.walks(failures, lambda number: bar("reading", number, total))
        needed = any(tuning.LOSSES[name].needs for name in losses)
        try:
            made = tuning.lessons(pipeline, answering(walks), own=body_of, reference=needed)
        except ValueError:
            if len({reason for _, reason in lacks}) == 1:
                raise ValueError(f"{lacks[0][1]}; no reference of {source.title} has that") from None
            failures += lacks
            if not source.items:
                raise ValueError(f"no recording of {source.title} could be used") from None
            if len(lacks) == len(source.items):
                lacking = Counter(part for _, reason in lacks for part in reason.split("; "))
                raise ValueError(
                    f"no recording of {source.title} can answer all of {', '.join(losses)}; "
                    + "; ".join(f"{part}: {many} have none" for part, many in lacking.items())
                    + "; learn from losses that the same recordings can answer"
                ) from None
            raise
    failures += [*lacks, *made.failures]
    return made
