"""The computations of `jgait tune`: cross-validation, the fit to all people, and standard errors of the parameters."""

import math
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from jgait import tune as tuning
from jgait.commands.console import Bar, console, count
from jgait.estimators import Estimator
from jgait.params import freed
from jgait.tune import CrossValidation, Fit, Identifiability, Lessons, Objective, Progress
from jgait.tune.coordinates import coordinates, natural
from jgait.tune.problem import Items, Problem
from jgait.tune.remainder import reduced

HARDLY = 0.05
"""Largest change of a loss with a parameter that is not determined [share of the loss], where there are no standard
errors: within one unit of the free coordinate, at which a standard error counts as too large. Chosen: of 80 independent
strides, a likelihood-ratio test at 95 % sees a change of 5 %."""

MOST_MOVED = 64
"""Largest number of learned numbers that are moved one by one to see whether the loss changes; chosen for the time."""


class Groups(NamedTuple):
    """What is left out of the tuning in turn, and judged by it: people, or days of a single person.

    Attributes:
        labels: (n,) the group of each recording.
        singular, many: what a group is, in words.
    """

    labels: tuple[str, ...]
    singular: str
    many: str


def groups_of(made: Lessons) -> Groups:
    """People; days if there is a single person and the day of every recording is known."""
    if len(set(made.subjects)) == 1 and all(made.days) and len(set(made.days)) > 1:
        return Groups(made.days, "day", "days")
    return Groups(made.subjects, "person", "people")


class Job(NamedTuple):
    """A tuning task: the parameters to learn, the people, and the settings of the fit.

    `free` has transforms that are fixed for all parameters except the learned ones; `groups` are left out in turn;
    `error`, with the name `judged` and its `unit`, is reported for each person; `settings` are arguments of every fit;
    with `folds` None one subject is left out at a time; `run` is the folder of the checkpoints.
    """

    pipeline: Estimator[PyTree, PyTree]
    start: PyTree
    free: PyTree
    made: Lessons
    groups: Groups
    loss: Objective
    error: Objective
    unit: str
    judged: str
    settings: dict[str, Any]
    folds: int | None
    run: Path


class TuningResults(NamedTuple):
    """A `CrossValidation` or None, a `Fit` to all people, an `Identifiability` or None, and why steps were left out.

    `undetermined` has the names of the learned numbers that the data do not determine; `errors` the median error of the
    recordings before and after, or None where people left out judge.
    """

    validation: CrossValidation[PyTree] | None
    fit: Fit[PyTree]
    known: Identifiability | None
    left_out: list[str]
    undetermined: list[str]
    errors: tuple[float, float] | None


def learned(job: Job, bar: Bar, cross: bool, loss: Collection[str]) -> TuningResults:
    """Cross-validate, fit, and compute which parameters the data determine."""
    people, groups = len(set(job.made.subjects)), job.groups
    if job.run.exists():
        console.print("continuing an earlier run with the same settings", highlight=False)

    def report(what: str, then: str = "") -> Callable[[Progress], None]:
        def state(p: Progress) -> None:
            bar(f"{what}: loss {p.loss:.4g}, gradient {p.gradient_norm:.2g}", p.done, p.total)
            if then and p.done == p.total:
                bar.begin(then)

        return state

    validation, why = None, ""
    if cross and len(set(groups.labels)) < 2:
        why = (
            "cross-validation is left out: it needs two people, or one person on two days that are known, and there is "
            "only a single person"
        )
    data, file = job.made.data, job.run / "steps.npz"
    if cross and not why:
        bar.begin(f"learning from all people, and from other {groups.many} (compiling)")
        validation = tuning.cross_validate(
            job.loss, job.start, job.free, data, folds=job.folds, error=job.error, subjects=groups.labels,
            progress=report(f"learning from other {groups.many}", f"judging the {groups.many} left out (compiling)"),
            checkpoint_file=file, **job.settings,
        )  # fmt: skip
        fit = validation.fit
    else:
        bar.begin("learning from all people (compiling)")
        fit = tuning.fit(
            job.loss, job.start, job.free, data, subjects=job.made.subjects, checkpoint_file=file,
            progress=report("learning from all people"), **job.settings,
        )  # fmt: skip
    bar.begin("which parameters the data determine (compiling)")
    results = TuningResults(validation, fit, None, [why] if why else [], [], None)
    likelihood = set(loss) == {"likelihood"}
    free = [jax.tree_util.keystr(path).lstrip(".") for path, _ in jax.tree_util.tree_leaves_with_path(fit.free)]
    learned = [name for name in free if name not in fit.not_learned]
    if learned:  # what is not learned has been told
        job = job._replace(free=freed(job.free, *learned))
        known, unknown = _determined(job, fit, people, "hessian" if likelihood else "sandwich")
        results = results._replace(known=known, left_out=[*results.left_out, *([unknown] if unknown else [])])
        if known is None or validation is None:
            moved, errors = _moved(job, fit, likelihood)
            results = results._replace(undetermined=moved, errors=errors if validation is None else None)
        if known is not None:
            results = results._replace(undetermined=known.undetermined)
    return results


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


def _determined(job: Job, fit: Fit[PyTree], people: int, information: str) -> tuple[Identifiability | None, str]:
    numbers = len(coordinates(fit.params, job.free).names)
    if people <= numbers:
        return None, (
            f"standard errors are left out: {count(numbers, 'number was', 'numbers were')} learned from "
            f"{count(people, 'person', 'people')}, and there must be more people than numbers"
        )
    if fit.left_out:
        return None, "standard errors are left out, because some recordings were not used"
    data, subjects = job.made.data, job.made.subjects
    try:
        known = tuning.identifiability(
            job.loss, fit.params, job.free, data, subjects=subjects, information=information
        )  # fmt: skip
        return known, ""
    except ValueError as error:
        return None, f"standard errors are left out: {error}"
