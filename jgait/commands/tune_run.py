"""The computations of `jgait tune`: cross-validation, the fit to all people, and standard errors of the parameters."""

import math
import warnings
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from jgait import tune as tuning
from jgait.commands.console import Bar, console, count, note, progress, refused, stop
from jgait.estimators import Estimator
from jgait.params import freed, names
from jgait.tune import CrossValidation, Fit, Identifiability, Lessons, Objective, Progress
from jgait.tune.checkpoint import OtherFitError
from jgait.tune.coordinates import coordinates, natural
from jgait.tune.problem import Items, Problem
from jgait.tune.remainder import reduced

if TYPE_CHECKING:
    from distributed import Client

HARDLY = 0.05
"""Largest change of a loss with a parameter that is not determined [share of the loss], where there are no standard
errors: within one unit of the free coordinate, at which a standard error counts as too large. Chosen: of 80 independent
strides, a likelihood-ratio test at 95 % sees a change of 5 %."""

MOST_MOVED = 64
"""Largest number of learned numbers that are moved one by one to see whether the loss changes; chosen for the time."""


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
    error: Objective  #: reported for each person, with its name and unit.
    unit: str
    judged: str
    settings: dict[str, Any]  #: arguments of every fit.
    folds: int | None  #: groups of people or days; None: one is left out at a time.
    run: Path  #: folder of the checkpoints.
    part: tuple[int, int] | None = None  #: as of `tune.cross_validate`.
    client: "Client | None" = None


class TuningResults(NamedTuple):
    """What was learned, and what is known of it."""

    validation: CrossValidation[PyTree] | None
    fit: Fit[PyTree]  #: to all people.
    known: Identifiability | None
    left_out: list[str]  #: why steps were left out.
    undetermined: list[str]  #: learned numbers that the data do not determine.
    errors: tuple[float, float] | None  #: median of the recordings before and after; None where people left out judge.


def run(job: Job, cross: bool, loss: Collection[str]) -> TuningResults | None:
    """`learned` under a progress bar, its warnings printed; exits with code 2 if the parameters cannot be learned."""
    with progress() as bars, warnings.catch_warnings(record=True) as caught, refused("", TypeError):
        warnings.simplefilter("always")
        try:
            results = learned(job, Bar(bars), cross, loss)
        except OtherFitError as error:
            stop(f"{error}; --fresh starts anew")
    for message in dict.fromkeys(str(warning.message) for warning in caught):
        note(message)
    return results


def learned(job: Job, bar: Bar, cross: bool, loss: Collection[str]) -> TuningResults | None:
    """Cross-validate, fit, and compute which parameters the data determine; None of a part of the fits."""
    groups, data, file = job.groups, job.made.data, job.run / "steps.npz"
    if job.run.exists():
        console.print("continuing an earlier run with the same settings", highlight=False)

    def report(what: str, then: str = "") -> Callable[[Progress], None]:
        def state(p: Progress) -> None:
            bar(f"{what}: loss {p.loss:.4g}, gradient {p.gradient_norm:.2g}", p.done, p.total)
            if then and p.done == p.total:
                bar.begin(then)

        return state

    validation, left_out = None, []
    if cross and len(set(groups.labels)) < 2:
        left_out = [
            "cross-validation is left out: it needs two people, or one person on two days that are known, and there is "
            "only a single person"
        ]
    if cross and not left_out:
        bar.begin(f"learning from all people, and from other {groups.many} (compiling)")
        validation = tuning.cross_validate(
            job.loss, job.start, job.free, data, folds=job.folds, error=job.error, subjects=groups.labels,
            progress=report(f"learning from other {groups.many}", f"judging the {groups.many} left out (compiling)"),
            checkpoint_file=file, part=job.part, client=job.client, **job.settings,
        )  # fmt: skip
        if validation is None:
            return None
        fit = validation.fit
    else:
        bar.begin("learning from all people (compiling)")
        fit = tuning.fit(
            job.loss, job.start, job.free, data, subjects=job.made.subjects, checkpoint_file=file,
            progress=report("learning from all people"), **job.settings,
        )  # fmt: skip
    bar.begin("which parameters the data determine (compiling)")
    likelihood = set(loss) == {"likelihood"}
    free = [name for name in names(fit.free) if name not in fit.not_learned]  # the others have been named
    if not free:
        return TuningResults(validation, fit, None, left_out, [], None)
    job = job._replace(free=freed(job.free, *free))
    known, why = _determined(job, fit, "hessian" if likelihood else "sandwich")
    moved, errors = _moved(job, fit, likelihood) if known is None or validation is None else ([], None)
    return TuningResults(
        validation, fit, known, [*left_out, *([why] if why else [])],
        moved if known is None else known.undetermined, errors if validation is None else None,
    )  # fmt: skip


def _moved(job: Job, fit: Fit[PyTree], nats: bool) -> tuple[list[str], tuple[float, float]]:
    """The numbers with which the loss hardly changes, and the median error of the recordings before and after.

    Each number is moved by one unit of its free coordinate to either side of the best values. A loss in nats has to
    change by half a nat, as within a standard error of one unit; any other loss by a share `HARDLY`.
    """
    at, begin = (coordinates(params, job.free) for params in (fit.params, job.start))
    best = np.asarray(at.vector)
    count = best.size if best.size <= MOST_MOVED else 0
    steps = np.eye(best.size, dtype=best.dtype)[:count]
    used = np.delete(np.arange(len(job.made.names)), list(fit.left_out))
    items = Items(jax.tree.map(lambda leaf: np.asarray(leaf)[used], job.made.data), np.zeros(used.size, np.int32))
    judged = [
        reduced(Problem(of, job.free, None, None), job.start, begin.tree, items)[:2] for of in (job.loss, job.error)
    ]

    def both(vector: Float[Array, "free"]) -> list[Array]:
        point = natural(at, vector, job.free, job.start)
        return [jax.vmap(partial(problem.loss, point))(rest.data) for problem, rest in judged]

    points = jnp.asarray(np.concatenate([np.asarray(begin.vector)[None], best[None], best + steps, best - steps]))
    losses, errors = (np.asarray(values, float) for values in jax.jit(lambda v: jax.lax.map(both, v))(points))
    total = losses.sum(axis=1)
    change = np.abs(total[2:] - total[1]).reshape(2, count).max(axis=0)
    hardly = change < (0.5 if nats else HARDLY * abs(total[1]))
    before, after = (float(np.nanmedian(row)) if np.isfinite(row).any() else math.nan for row in errors[:2])
    return [name for name, small in zip(at.names, hardly, strict=False) if small], (before, after)


def _determined(job: Job, fit: Fit[PyTree], information: str) -> tuple[Identifiability | None, str]:
    """Which numbers the data determine; None and the reason where that cannot be computed."""
    people, numbers = len(set(job.made.subjects)), len(coordinates(fit.params, job.free).names)
    why = "because some recordings were not used" if fit.left_out else ""
    if people <= numbers:
        why = (
            f"{count(numbers, 'number was', 'numbers were')} learned from {count(people, 'person', 'people')}, and "
            "there must be more people than numbers"
        )
    if not why:
        try:
            data, subjects = job.made.data, job.made.subjects
            return tuning.identifiability(
                job.loss, fit.params, job.free, data, subjects=subjects, information=information
            ), ""  # fmt: skip
        except ValueError as error:
            why = str(error)
    return None, f"standard errors are left out{',' if why.startswith('because') else ':'} {why}"
