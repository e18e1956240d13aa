"""Gradient-based fit of parameters: optax in a `lax.scan`, in free coordinates without bounds."""

import warnings
from collections.abc import Callable, Hashable, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import optax
from jax.sharding import Mesh
from jaxtyping import Array, PRNGKeyArray, PyTree

from jgait.notes import record
from jgait.params import constrain
from jgait.params import names as names_of
from jgait.tune import checkpoint
from jgait.tune.checks import (
    check_data,
    check_priors,
    numbered,
    over_transforms,
    spread_out,
    start,
    transforms_of,
)
from jgait.tune.descent import Carry, Settings, Trace, flat
from jgait.tune.lanes import Report, descend
from jgait.tune.optimizers import supported
from jgait.tune.problem import Context, Items, Problem, place
from jgait.tune.remainder import reduced
from jgait.tune.words import is_interval
from jgait.types import AnyArray, Maybe, check_key, check_kind, people


@record
class Fit[P](NamedTuple):
    """A finished fit."""

    #: the parameters of the step with the lowest loss, natural units; on the validation items if there are any, else on
    #: the training items. A fixed parameter is the same object as in the argument.
    params: P
    free: P  #: `params` in unconstrained coordinates; None where fixed.
    #: (steps,) loss at the start of each step, over the minibatch if there is one; always finite. A fit of which no
    #: parameter is learned stops after its first step.
    losses: np.ndarray
    gradient_norms: np.ndarray  #: (steps,) norm of the gradient in unconstrained coordinates at the start of each step.
    #: (steps,) bool; False where the step led to a loss or gradient that is not finite and was undone; without an
    #: optimizer also where the step did not lower the loss.
    accepted: np.ndarray
    best_loss: float  #: the loss that selected `params`.
    #: (steps,) loss on the validation items after each step, or on all items if there are minibatches; NaN where that
    #: loss was not computed.
    validation: np.ndarray
    #: numbers of the items left out, because their loss or gradient was not finite at the start.
    left_out: tuple[int, ...]
    subjects: tuple[str, ...]  #: labels of the subjects, in the order of the leading axis of parameters per subject.
    #: names of the free parameters that kept their start, for their gradient vanishes; see the warning.
    not_learned: tuple[str, ...] = ()
    per_subject: tuple[str, ...] = ()  #: names of the parameters that have a value for each subject.
    #: number of the step that led to `params`; 0: no step lowered the loss, and `params` are the start.
    best_step: int = 0

    def of(self, subject: Hashable) -> P:
        """The parameters of one person: of those per subject this person's values, of the others the shared ones.

        Args:
            subject: one of `subjects`; capitals and spaces do not count, see `jgait.types.people`.

        Raises:
            KeyError: if the fit did not use this person.
        """
        name = people([*self.subjects, subject])[-1]
        if name not in self.subjects:
            raise KeyError(f"the fit has no subject {subject!r}; it has {', '.join(self.subjects) or 'none'}")
        number = self.subjects.index(name)
        values, structure = jax.tree.flatten(self.params)
        personal = [
            np.asarray(value)[number] if name_of in self.per_subject else value
            for name_of, value in zip(names_of(self.params), values, strict=True)
        ]
        params: P = jax.tree.unflatten(structure, personal)
        return params


def scattered(key: Maybe[PRNGKeyArray], free: PyTree, count: int, spread: float) -> PyTree:
    """Random starts with a leading axis (count,): `free` first, the others with noise of deviation `spread`."""
    if count == 1:
        return jax.tree.map(lambda leaf: leaf[None], free)
    leaves, structure = jax.tree.flatten(free)
    keys = jax.random.split(jax.random.fold_in(key, 1), len(leaves))

    def around(key: PRNGKeyArray, leaf: Array) -> Array:
        moved = spread * jax.random.normal(key, (count, *leaf.shape), leaf.dtype)
        return leaf[None] + moved.at[0].set(0.0)

    return jax.tree.unflatten(structure, [around(*pair) for pair in zip(keys, leaves, strict=True)])


def check_settings(
    steps: int, chunk: int | None, starts: int, key: PRNGKeyArray | None, minibatch: int | None, n: int, named: PyTree
) -> None:
    """Raise ValueError if a setting is not possible, TypeError if it is of another kind; the message names it."""
    for name, number in (("steps", steps), ("chunk", chunk), ("starts", starts), ("minibatch", minibatch)):
        if number is not None:
            check_kind(number, (int, np.integer), f"{name} must be a whole number")
    if key is not None:
        check_key(key)
    if steps < 1 or (chunk is not None and chunk < 1):
        raise ValueError(f"steps and chunk must be at least 1; got steps={steps}, chunk={chunk}")
    if starts < 1:
        raise ValueError(f"starts must be at least 1; got {starts}")
    if minibatch is not None and not 1 <= minibatch <= n:
        raise ValueError(f"minibatch must be between 1 and the {n} items to learn from; got {minibatch}")
    if key is None and (starts > 1 or minibatch is not None):
        raise ValueError("several starts and minibatches are drawn: give key=jax.random.key(…)")
    if named is None and minibatch is not None:
        raise ValueError("minibatches need an optimizer of optax, such as optax.adam(0.05)")


def check_mesh(mesh: Mesh | None, minibatch: int | None, name: str, count: int) -> None:
    """Raise ValueError if a number of items cannot be divided among the devices."""
    for what, number in ((name, count), ("minibatch", minibatch or 0)):
        if mesh is not None and number % mesh.size:
            raise ValueError(f"on {mesh.size} devices {what} must be a multiple of it; got {number}")


def _split(items: Items, validation: AnyArray | None, n: int) -> tuple[Items, Items | None, np.ndarray]:
    """Training items, validation items, and the numbers of the training items."""
    if validation is None:
        return items, None, np.arange(n)
    mask = np.asarray(validation)
    if mask.dtype != np.bool_ or mask.shape != (n,) or mask.all() or not mask.any():
        raise ValueError(
            f"validation must be a bool for each of the {n} items, some True and some False; got {mask.dtype} of "
            f"shape {mask.shape}, {int(mask.sum())} True"
        )
    learn, judge = np.flatnonzero(~mask), np.flatnonzero(mask)
    parts = (jax.tree.map(lambda leaf, chosen=chosen: np.asarray(leaf)[chosen], items) for chosen in (learn, judge))
    return next(parts), next(parts), learn


def _filled(items: Items, mesh: Mesh | None) -> tuple[Items, np.ndarray]:
    """Items and their weights; copies with weight 0 make the number of items a multiple of the mesh's devices."""
    n = items.subject.shape[0]
    more = 0 if mesh is None else -n % mesh.size
    weights = np.concatenate([np.ones(n), np.zeros(more)])
    if more:
        items = jax.tree.map(lambda leaf: np.concatenate([leaf, np.repeat(np.asarray(leaf)[-1:], more, 0)]), items)
    return items, weights


def fit[P](
    loss: Callable[[P, PyTree], PyTree],
    params: P,
    transforms: P,
    data: PyTree,
    optimizer: optax.GradientTransformation | optax.MultiSteps | None = None,
    *,
    steps: int = 100,
    batched: bool = True,
    subjects: Sequence[Hashable] | None = None,
    priors: P | None = None,
    starts: int = 1,
    spread: float = 0.5,
    minibatch: int | None = None,
    validation: PyTree = None,
    every: int | None = None,
    patience: int | None = None,
    key: PRNGKeyArray | None = None,
    checkpoint_file: str | Path | None = None,
    mesh: Mesh | None = None,
    progress: Report | None = None,
    chunk: int | None = None,
) -> Fit[P]:
    """Minimise the mean loss over the items of `data`.

    Without an optimizer, L-BFGS in the free coordinates (see `jgait.params`): a step that does not lower the loss is
    undone and made shorter, and the fit stops where the gradient of every free number is within 0.005 of its
    standard error over the items, or no lower loss can be told from rounding.

    With an optimizer, every step adds its update to the free coordinates. A step that leads to a loss or gradient that
    is not finite is undone, the optimizer's state with it, and the next step has half the length; each accepted step
    doubles the length again, up to the full update. An item whose loss or gradient is not finite at the
    start is left out, with a warning, and its number is in the result. A free parameter whose gradient is always 0 is
    named in a warning; a warning also says when no step lowered the loss.

    Args:
        loss: (params, item) → scalar; pure JAX.
        params: NamedTuple of starting values in natural units.
        transforms: the same type, holding a `Transform` for each; `per_subject(…)` gives every subject a value.
        data: pytree of arrays with a leading axis of n items; one item without that axis if not `batched`.
        optimizer: None for L-BFGS with a stop, or any of optax, for example `optax.adam(0.05)` or `optax.lookahead(…)`;
            as extra arguments it gets `value`, `grad`, `value_fn`, `obj_fn` and `grad_fn`.
        steps: largest number of steps.
        batched: whether `data` has an axis of items.
        subjects: (n,) subject of each item; needed for parameters per subject.
        priors: the type of `params`, holding a `jgait.params.Prior` or None for each. Minus the logarithm of their
            density is added, divided by n: with a loss in nats the result is the maximum of the posterior density.
        starts: number of starts, fitted in parallel; the first start is `params`.
        spread: standard deviation of the other starts about `params`, in free coordinates.
        minibatch: number of training items in each step; None for all. Every epoch has a new order of the items.
        validation: (n,) bool, True for validation items: they select the best step and are not trained on.
        every: number of steps between two computations of the validation loss, or with minibatches of the loss on all
            items; None for every step, or every epoch.
        patience: number of such losses without improvement after which the fit stops; None: no early stop.
        key: PRNG key of starts and minibatches.
        checkpoint_file: file in which the state is saved about twenty times. With the same file, an interrupted fit
            continues and ends with the same result; a finished fit returns its result at once. The file of another fit
            is refused. Loss and optimizer are compared by their source and the values that they keep: name another file
            when other functions that the loss calls have changed.
        mesh: devices of one axis, over which the items are distributed; with several processes, each process passes
            the whole `data` and returns the whole result.
        progress: function called on the host after every chunk; it has no influence on the result.
        chunk: number of steps between two calls of `progress` and two saves, at least 2; None for a twentieth
            of all, without an optimizer 4.

    Returns:
        The parameters with the lowest loss, and the history.

    Raises:
        TypeError: if `params` and `transforms` do not match, or `data` holds anything but numbers.
        ValueError: if there is no free parameter, no item or no finite number in `data`, a starting value is outside
            its range, the loss is not a scalar, the loss is finite for no item at the start, or the checkpoint is of
            another fit.
    """
    data, n = check_data(data, batched)
    labels, number = numbered(subjects, n)
    check_priors(priors, transforms)
    params = spread_out(params, transforms, len(labels))
    free = start(params, transforms)
    problem = Problem(loss, transforms, priors, mesh)
    items = Items(data, number)
    problem, known, dtype = reduced(problem, params, free, items)
    learn, judge, numbers = _split(known, validation, n)
    check_settings(steps, chunk, starts, key, minibatch, numbers.size, optimizer)
    check_mesh(mesh, minibatch, "the number of validation items", 0 if judge is None else judge.subject.size)
    learn, weights = _filled(learn, mesh)
    epoch = 1 if minibatch is None else -(-weights.size // minibatch)
    settings = Settings(steps, minibatch, every or epoch, patience, optimizer is None)
    optimizer = supported(optimizer)
    mark = {} if checkpoint_file is None else checkpoint.fingerprint(
        data=items, params=params, transforms=transforms, priors=priors, settings=settings, validation=validation,
        starts=(starts, spread), key=key, loss=loss, optimizer=optimizer,
    )  # fmt: skip
    begin = scattered(key, free, starts, spread)
    carry, trace = descend(
        problem, optimizer, settings,
        Context(params, place(problem, learn), None if judge is None else place(problem, judge), key),
        begin, np.tile(weights, (starts, 1)), dtype, chunk=chunk, report=progress,
        file=None if checkpoint_file is None else Path(checkpoint_file), mark=mark,
    )  # fmt: skip
    return result_of(problem, params, carry, trace, begin, labels, numbers)


def lane(tree: PyTree, number: int | slice | np.ndarray) -> PyTree:
    """The parts of a tree that belong to one or some of several fits."""
    return jax.tree.map(lambda leaf: leaf[number], tree)


def best_starts(carry: Carry, starts: int) -> np.ndarray:
    """(F,) the number of the best fit of each group of `starts` fits; −1 where no fit has a finite loss.

    Losses over different numbers of items cannot be compared: only the starts with the most items are eligible.
    """
    scores, counted = carry.best_score.reshape(-1, starts), np.count_nonzero(carry.weights, axis=1).reshape(-1, starts)
    eligible = (counted == counted.max(axis=1, keepdims=True)) & np.isfinite(scores)
    number = np.argmin(np.where(eligible, scores, np.inf), axis=1) + starts * np.arange(len(scores))
    return np.where(eligible.any(axis=1), number, -1)


EDGE = 9.2
"""Least |logit| at an end of an interval: within a ten-thousandth of its width, where the gradient vanishes; chosen."""


def warn_of_flat(
    transforms: PyTree, begin: PyTree, end: PyTree, reach: PyTree, stacklevel: int
) -> tuple[str, ...]:  # fmt: skip
    """Warn of the free parameters that are not learned, with the reason, from free coordinates at begin and end.

    Returns:
        Their names.
    """
    bounded = over_transforms(lambda t, free: jax.tree.map(lambda _: is_interval(t), free), transforms, begin)
    nothing, stuck = [], []
    for (path, first), last, inside, none in zip(
        jax.tree_util.tree_leaves_with_path(begin), *map(jax.tree.leaves, (end, bounded, flat(reach))), strict=True
    ):
        name = jax.tree_util.keystr(path).lstrip(".")
        if inside and min(np.min(np.abs(first)), np.min(np.abs(last))) > EDGE:
            stuck.append(name)
        elif none:
            nothing.append(name)
    for names, reason in (
        (nothing, "the gradient is 0 at every step, or no more than rounding, for the loss of these items does not "
                  "depend on it there"),
        (stuck, "the start value lies at an end of the range, where the gradient vanishes: start further inside"),
    ):  # fmt: skip
        if names:
            warnings.warn(f"not learned: {', '.join(names)}; {reason}", stacklevel=stacklevel)
    return (*nothing, *stuck)


def _not_lowered(best: float, losses: np.ndarray, accepted: np.ndarray) -> str:
    """Why the start is the result, in words."""
    undone = np.count_nonzero(~accepted)
    steps = f"; {undone} of {accepted.size} steps led to a loss or a gradient that is not finite" if undone else ""
    return (
        f"no step lowered the loss: the start values are the result, with a loss of {best:.3g}; the loss before the "
        f"last step is {losses[-1]:.3g}{steps}. They are an optimum already, or the learning rate is too large"
    )


def result_of[P](
    problem: Problem, params: P, carry: Carry, trace: Trace, begin: PyTree, labels: tuple[str, ...], numbers: np.ndarray
) -> Fit[P]:
    """The result of fits from several starts to the items with these numbers."""
    (best,) = best_starts(carry, len(carry.loss))
    if best < 0 and np.isfinite(carry.loss).any():
        raise ValueError("the loss of the validation items is not finite: leave out those that cannot be computed")
    if best < 0:
        raise ValueError("the loss or its gradient is not finite at the start, for any item")
    left_out = tuple(int(i) for i in numbers[carry.weights[best, : numbers.size] == 0.0])
    if left_out:
        shown = ", ".join(map(str, left_out[:10])) + (", …" if len(left_out) > 10 else "")
        warnings.warn(
            f"{len(left_out)} of {numbers.size} items were left out: their loss or gradient is not finite at the "
            f"start (items {shown})",
            stacklevel=3,
        )
    best_carry = lane(carry, best)
    losses, norms, accepted, scores = (column[best, : int(best_carry.taken)] for column in trace)
    transforms = problem.transforms
    every, marks = names_of(transforms), transforms_of(transforms)
    of_subjects = tuple(name for name, mark in zip(every, marks, strict=True) if mark.per_subject)
    flat_ones = (
        warn_of_flat(transforms, lane(begin, best), best_carry.best, best_carry.reach, 4) if accepted.any() else ()
    )
    if not best_carry.best_step and len(flat_ones) < len(jax.tree.leaves(best_carry.best)):
        warnings.warn(_not_lowered(float(best_carry.best_score), losses, accepted), stacklevel=3)
    return Fit(
        constrain(best_carry.best, transforms, params), best_carry.best, losses, norms, accepted,
        float(best_carry.best_score), scores, left_out, labels, flat_ones, of_subjects, int(best_carry.best_step),
    )  # fmt: skip
