"""Cross-validation over subjects: the error of fitted parameters on people who were not in the fit."""

import hashlib
from collections.abc import Callable, Hashable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np
import optax
from jax.sharding import Mesh
from jax.typing import DTypeLike
from jaxtyping import Bool, PRNGKeyArray, PyTree

from jgait.estimators.dask import DIED, on_dask
from jgait.geometry.arrays import compiled
from jgait.notes import record
from jgait.params import constrain
from jgait.tune.checks import check_data, transforms_of
from jgait.tune.descent import Carry, Report, Trace, descend, lane
from jgait.tune.fit import Fit, Task, best_starts, posed, result_of
from jgait.tune.lessons import Lesson
from jgait.tune.problem import Context, Items, Problem, kept, of_subject, place
from jgait.types import AnyArray

if TYPE_CHECKING:
    import pandas as pd
    from distributed import Client


@record
class CrossValidation[P](NamedTuple):
    """The result of a cross-validation."""

    #: one row for each subject (index `subject`), with the errors of the fit that held the subject out: `fold`, `n`
    #: (items), `error_before` and `error_after` (means over the subject's items), `change` (after − before); in the
    #: unit of `error`, or of the loss where there is none.
    table: "pd.DataFrame"
    items: "pd.DataFrame"  #: one row for each item: `item subject fold error_before error_after`.
    params: P  #: the parameters of each fold, natural units; a free parameter has a leading axis (F,).
    #: (F, starts) training loss of every fit; the start with the lowest one gives the fold's parameters.
    losses: np.ndarray
    left_out: np.ndarray  #: (F,) number of items in a fold's training part that were left out, see `tune.fit`.
    #: the fit to all items, beside those of the folds in one program; as `tune.fit` gives it, with its warnings.
    fit: Fit[P]


def _check_split(subjects: Sequence[Hashable], folds: Sequence[Hashable]) -> None:
    """Raise ValueError if items of one subject are in several folds, in which its error is too low, or all in one."""
    if len(subjects) != len(folds):
        raise ValueError(f"every item needs a subject and a fold; got {len(subjects)} subjects and {len(folds)} folds")
    of: dict[Hashable, set[str]] = {}
    for subject, fold in zip(subjects, folds, strict=True):
        of.setdefault(subject, set()).add(str(fold))
    if torn := [f"{subject} is in folds {', '.join(sorted(its))}" for subject, its in of.items() if len(its) > 1]:
        raise ValueError(f"the split leaks {len(torn)} of {len(of)} subjects: {'; '.join(torn[:5])}")
    if len(set(folds)) < 2:
        raise ValueError("cross-validation needs at least two folds; got one")


def _check_twins(data: PyTree, subjects: Sequence[Hashable]) -> None:
    """Raise if the same recording has two different subjects; of lessons, the sensors' signals alone are compared."""
    leaves = [np.ascontiguousarray(leaf) for leaf in jax.tree.leaves(data.inputs if isinstance(data, Lesson) else data)]
    first_of: dict[bytes, int] = {}
    for item, subject in enumerate(subjects):
        digest = hashlib.sha256()
        for leaf in leaves:
            digest.update(leaf[item].tobytes())
        other = first_of.setdefault(digest.digest(), item)
        if subjects[other] != subject:
            raise ValueError(
                f"the split leaks: items {other} and {item} are the same recording, of subjects {subjects[other]} and "
                f"{subject}"
            )


def _folds(
    subjects: Sequence[Hashable], folds: Sequence[Hashable] | int | None, key: PRNGKeyArray | None
) -> list[Hashable]:
    people = list(dict.fromkeys(subjects))
    if folds is None:
        return [people.index(subject) for subject in subjects]
    if isinstance(folds, int | np.integer):
        if not 2 <= folds <= len(people):
            raise ValueError(f"folds must be between 2 and the {len(people)} subjects; got {folds}")
        if key is None:
            raise ValueError("which subjects share a fold is drawn: give key=jax.random.key(…)")
        order = np.asarray(jax.random.permutation(jax.random.fold_in(key, 2), len(people)))
        of = {people[person]: place % int(folds) for place, person in enumerate(order)}
        return [of[subject] for subject in subjects]
    return list(np.asarray(folds).tolist())


def cross_validate[P](
    loss: Callable[[P, PyTree], PyTree], params: P, transforms: P, data: PyTree,
    optimizer: optax.GradientTransformation | optax.MultiSteps | None = None, *, subjects: Sequence[Hashable],
    folds: int | Sequence[Hashable] | None = None, error: Callable[[P, PyTree], PyTree] | None = None,
    steps: int = 100, priors: P | None = None, starts: int = 1, spread: float = 0.5, minibatch: int | None = None,
    key: PRNGKeyArray | None = None, checkpoint_file: str | Path | None = None, mesh: Mesh | None = None,
    progress: Report | None = None, chunk: int | None = None, part: tuple[int, int] | None = None,
    client: "Client | None" = None,
) -> CrossValidation[P] | None:  # fmt: skip
    """For every fold, fit on the other folds' subjects and compute the error on the fold's subjects, in one program;
    the fit to all items is made beside.

    A fold with several starts uses the start with the lowest training loss; the items held out have no influence on
    that choice. `params` are the starting values, with which `error_before` is computed as well; known values per
    subject (`per_subject(fixed)`) are allowed, free ones raise. All arguments are as of `tune.fit`, but for

        subjects: (n,) subject of each item.
        folds: None: each subject is one fold; a number k: the subjects are divided into k folds, with `key`; or (n,)
            the fold of each item, the same for all items of a subject.
        error: (params, item) → scalar, the error in the tables, in the unit of its values; None for the loss, which of
            most objectives is a square: `tune.objective(…, "stride_length_error")` gives cm, "stride_length" cm².
        part: (k, n): only the k-th of n parts of the fits is made, into a file beside `checkpoint_file`, and the result
            is None. A call without `part` takes the fits from the files of all parts.
        client: a `dask.distributed.Client`, whose workers share the fits.

    Raises:
        TypeError, ValueError: as `tune.fit`; or if a subject is in several folds, or a recording has two subjects.
    """
    import pandas as pd

    data, n = check_data(data, True)
    if any(t.per_subject and t.to_natural is not None for t in transforms_of(transforms)):
        raise ValueError("a subject's own parameters cannot be learned from others: fix them, or share them")
    task = posed(
        loss, params, transforms, data, optimizer, n, subjects, steps=steps, priors=priors, starts=starts,
        spread=spread, minibatch=minibatch, key=key, checkpoint_file=checkpoint_file, mesh=mesh, chunk=chunk,
        learned=n, even=("the number of items", n),
    )  # fmt: skip
    named = [task.labels[i] for i in task.items.subject]
    fold_of = _folds(named, folds, key)
    _check_split(named, fold_of)
    _check_twins(data, named)
    kinds = list(dict.fromkeys(fold_of))
    learned = np.asarray([*([of != fold for of in fold_of] for fold in kinds), [True] * n])
    made = None if client is not None else task.reduced()  # what a reduced problem has computed cannot be sent
    fits = _shared(
        partial(_descended, task, made, key=key, chunk=chunk, mark=task.mark(folds=learned)),
        jax.tree.map(lambda leaf: np.concatenate([np.asarray(leaf)] * len(learned)), task.begin),
        np.repeat(learned, starts, axis=0), report=progress, file=task.file, part=part, client=client,
    )  # fmt: skip
    if fits is None:
        return None
    carry, trace = fits
    every = slice(len(kinds) * starts, None)
    fit = result_of(task, lane(carry, every), lane(trace, every), np.arange(n))
    carry, learned = lane(carry, slice(every.start)), learned[:-1]
    chosen = best_starts(carry, starts)
    if (chosen < 0).any():
        raise ValueError("the loss or its gradient is not finite at the start, for any item of a fold")
    best, losses = lane(carry.best, chosen), carry.best_score.reshape(-1, starts)
    left_out = learned.sum(axis=1) - np.count_nonzero(carry.weights[chosen], axis=1)
    judge = task._replace(problem=task.problem._replace(loss=error or loss))
    whole = made is not None and made[0].loss is loss  # nothing of it could be computed before
    if whole:
        problem, known = judge.problem, judge.items
    else:
        problem, known, _ = made if made and error is None else judge.reduced()
    program, at = _errors(problem), np.asarray([kinds.index(fold) for fold in fold_of])
    before = jax.tree.map(lambda leaf: np.repeat(np.asarray(leaf)[None], n, axis=0), task.free)
    after = jax.tree.map(lambda leaf: leaf[at], best)
    each = {"error_before": before, "error_after": after}
    judged = {name: np.asarray(program(free, task.params, known)) for name, free in each.items()}
    items = pd.DataFrame({"item": range(n), "subject": named, "fold": fold_of, **judged})
    grouped = items.groupby("subject", sort=False)
    table = grouped.agg(fold=("fold", "first"), n=("item", "size"), **{name: (name, "mean") for name in judged})
    table = table.assign(change=table["error_after"] - table["error_before"])
    return CrossValidation(table, items, constrain(best, transforms, task.params), losses, left_out, fit)


def _descended(
    task: Task, made: tuple[Problem, Items, DTypeLike] | None, free: PyTree, weights: Bool[AnyArray, "lane item"], *,
    key: PRNGKeyArray | None, **how: PyTree,
) -> tuple[Carry, Trace]:  # fmt: skip
    """The task's fits from these starts to the items with these weights; a worker of a cluster reduces it itself."""
    problem, known, dtype = made or task.reduced()
    context = Context(task.params, place(problem, known), None, key)
    return descend(problem, task.optimizer, task.settings, context, free, weights, dtype, **how)


def _shared(
    run: Callable[..., tuple[Carry, Trace]], free: PyTree, weights: Bool[AnyArray, "lane item"], *,
    report: Report | None, file: Path | None, part: tuple[int, int] | None, client: "Client | None",
) -> tuple[Carry, Trace] | None:  # fmt: skip
    """`run` of all fits, shared among machines: one part of them, all of them from files of parts, or on Dask.

    The fits of a `part`, its number from 1 and that of all parts, are finished in `STEM-K-of-N.npz` beside the file,
    and the result is None. A later call without `part` takes the fits of all these files.
    """
    lanes = len(weights)

    def piece(number: int, of: int) -> tuple[PyTree, PyTree]:
        return lane((free, weights), slice(number - 1, None, of))

    def on_file(number: int, of: int) -> tuple[Carry, Trace]:
        checkpoint = None if file is None else file.with_name(f"{file.stem}-{number}-of-{of}{file.suffix}")
        return run(*piece(number, of), report=report, file=checkpoint)

    if part is not None:
        if part[0] <= lanes:
            on_file(*part)
        return None
    there = [] if file is None else [*file.parent.glob(f"{file.stem}-1-of-*{file.suffix}")]
    if client is not None:
        of, done = lanes, dict[int, tuple[Carry, Trace]]()
        fits = ((number, piece(number + 1, lanes)) for number in range(lanes))
        for ((number, _),), result in on_dask(lambda group: run(*group[0][1], report=None, file=None), fits, client):
            if result is None:
                raise RuntimeError(f"fit {number + 1} of {lanes} has no result: {DIED}")
            done[number] = result
        parts = [done[number] for number in range(lanes)]
    elif there:
        of = int(there[0].stem.rpartition("-")[2])
        parts = [on_file(number, of) for number in range(1, min(lanes, of) + 1)]
    else:
        return run(free, weights, report=report, file=file)
    order = np.argsort(np.concatenate([np.arange(lanes)[number::of] for number in range(of)]))
    longest = max(trace.loss.shape[1] for _, trace in parts)
    filled = [
        (carry, Trace(*(np.pad(v, ((0, 0), (0, longest - v.shape[1])), "edge") for v in trace)))
        for carry, trace in parts
    ]
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[order], *filled)


@kept
def _errors(problem: Problem) -> Callable[..., PyTree]:
    """(free coordinates of each item, params, items) → the loss (n,) of each item."""

    def of_item(at: PyTree, params: PyTree, item: Items) -> PyTree:
        known, free_of_subject = (of_subject(tree, problem.transforms, item.subject) for tree in (params, at))
        return problem.loss(constrain(free_of_subject, problem.transforms, known), item.data)

    return compiled(jax.vmap(of_item, in_axes=(0, None, 0)))
