"""Gradient-based fit of parameters: optax in a `lax.scan`, in free coordinates without bounds."""

import math
import warnings
from collections.abc import Callable, Hashable, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import optax
from jax.sharding import Mesh
from jax.typing import DTypeLike
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
from jgait.tune.descent import Carry, Report, Settings, Trace, descend, flat, lane
from jgait.tune.optimizers import supported
from jgait.tune.problem import Context, Items, Problem, place
from jgait.tune.remainder import reduced
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
        """The parameters of one person, one of `subjects` (capitals and spaces do not count, see `types.people`): of
        those per subject this person's values, of the others the shared ones. Raises KeyError for another person.
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


class Task(NamedTuple):
    """What `fit` and `cross_validate` minimise, made of their arguments."""

    problem: Problem  #: with the loss as it was given.
    params: PyTree  #: in natural units; those per subject with a leading axis.
    free: PyTree  #: the start in free coordinates.
    begin: PyTree  #: several starts, with a leading axis.
    items: Items
    labels: tuple[str, ...]  #: the subjects.
    settings: Settings
    optimizer: optax.GradientTransformationExtraArgs
    file: Path | None
    marks: dict[str, PyTree]  #: the arguments by which a checkpoint is told from that of another fit.

    def reduced(self) -> tuple[Problem, Items, DTypeLike]:
        """Problem and items without what does not depend on the free parameters; see `remainder.reduced`."""
        return reduced(self.problem, self.params, self.free, self.items)

    def mark(self, **more: PyTree) -> dict[str, str]:
        """The fingerprint of the task, with more arguments; none without a file."""
        return {} if self.file is None else checkpoint.fingerprint(**self.marks, **more)


def posed(
    loss: Callable[..., PyTree], params: PyTree, transforms: PyTree, data: PyTree, optimizer: PyTree, n: int,
    subjects: Sequence[Hashable] | None, *, steps: int, priors: PyTree, starts: int, spread: float,
    minibatch: int | None, key: PRNGKeyArray | None, checkpoint_file: str | Path | None, mesh: Mesh | None,
    chunk: int | None, learned: int, even: tuple[str, int], every: int | None = None, patience: int | None = None,
) -> Task:  # fmt: skip
    """The task of `fit` or `cross_validate`, whose arguments these are, for a number of `learned` items; `even`: the
    name and the number of the items that a mesh must divide.

    Raises:
        TypeError, ValueError: if an argument is not possible, or of another kind; the message names it.
    """
    for name, number in (("steps", steps), ("chunk", chunk), ("starts", starts), ("minibatch", minibatch)):
        if number is not None:
            check_kind(number, (int, np.integer), f"{name} must be a whole number")
    if key is not None:
        check_key(key)
    if steps < 1 or (chunk is not None and chunk < 1):
        raise ValueError(f"steps and chunk must be at least 1; got steps={steps}, chunk={chunk}")
    if starts < 1:
        raise ValueError(f"starts must be at least 1; got {starts}")
    if minibatch is not None and not 1 <= minibatch <= learned:
        raise ValueError(f"minibatch must be between 1 and the {learned} items to learn from; got {minibatch}")
    if key is None and (starts > 1 or minibatch is not None):
        raise ValueError("several starts and minibatches are drawn: give key=jax.random.key(…)")
    if optimizer is None and minibatch is not None:
        raise ValueError("minibatches need an optimizer of optax, such as optax.adam(0.05)")
    devices = 1 if mesh is None else mesh.size
    for what, number in (even, ("minibatch", minibatch or 0)):
        if number % devices:
            raise ValueError(f"on {devices} devices {what} must be a multiple of it; got {number}")
    labels, numbers = numbered(subjects, n)
    check_priors(priors, transforms)
    params = spread_out(params, transforms, len(labels))
    free, items = start(params, transforms), Items(data, numbers)
    epoch = 1 if minibatch is None else -(-(learned + -learned % devices) // minibatch)
    settings, usable = Settings(steps, minibatch, every or epoch, patience, optimizer is None), supported(optimizer)
    marks = {
        "data": items, "params": params, "transforms": transforms, "priors": priors, "settings": settings,
        "starts": (starts, spread), "key": key, "loss": loss, "optimizer": usable,
    }  # fmt: skip
    return Task(
        Problem(loss, transforms, priors, mesh), params, free, scattered(key, free, starts, spread), items, labels,
        settings, usable, None if checkpoint_file is None else Path(checkpoint_file), marks,
    )  # fmt: skip


def _split(validation: AnyArray | None, n: int) -> tuple[np.ndarray, np.ndarray]:
    """The numbers of the training and of the validation items."""
    if validation is None:
        return np.arange(n), np.arange(0)
    mask = np.asarray(validation)
    if mask.dtype != np.bool_ or mask.shape != (n,) or mask.all() or not mask.any():
        raise ValueError(
            f"validation must be a bool for each of the {n} items, some True and some False; got {mask.dtype} of "
            f"shape {mask.shape}, {int(mask.sum())} True"
        )
    return np.flatnonzero(~mask), np.flatnonzero(mask)


def fit[P](
    loss: Callable[[P, PyTree], PyTree], params: P, transforms: P, data: PyTree,
    optimizer: optax.GradientTransformation | optax.MultiSteps | None = None, *, steps: int = 100,
    batched: bool = True, subjects: Sequence[Hashable] | None = None, priors: P | None = None, starts: int = 1,
    spread: float = 0.5, minibatch: int | None = None, validation: PyTree = None, every: int | None = None,
    patience: int | None = None, key: PRNGKeyArray | None = None, checkpoint_file: str | Path | None = None,
    mesh: Mesh | None = None, progress: Report | None = None, chunk: int | None = None,
) -> Fit[P]:  # fmt: skip
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
        checkpoint_file: file in which the state is saved after every chunk. With the same file, an interrupted fit
            continues and ends with the same result. The file of another fit is refused; loss and optimizer are compared
            by their source and the values that they keep: name another file when functions that they call have changed.
        mesh: devices of one axis, over which the items are distributed; with several processes, each process passes
            the whole `data` and returns the whole result.
        progress: function called on the host after every chunk; it has no influence on the result.
        chunk: number of steps in a chunk, at least 2; None for a twentieth of all, without an optimizer 4.

    Raises:
        TypeError: if `params` and `transforms` do not match, or `data` holds anything but numbers.
        ValueError: if there is no free parameter, no item or no finite number in `data`, a starting value is outside
            its range, the loss is not a scalar, the loss is finite for no item at the start, or the checkpoint is of
            another fit.
    """
    data, n = check_data(data, batched)
    learn, judge = _split(validation, n)
    task = posed(
        loss, params, transforms, data, optimizer, n, subjects, steps=steps, priors=priors, starts=starts,
        spread=spread, minibatch=minibatch, key=key, checkpoint_file=checkpoint_file, mesh=mesh, chunk=chunk,
        learned=learn.size, even=("the number of validation items", judge.size), every=every, patience=patience,
    )  # fmt: skip
    problem, known, dtype = task.reduced()
    # copies without weight make the number of items a multiple of the devices
    more = 0 if mesh is None else -learn.size % mesh.size
    weights = np.concatenate([np.ones(learn.size), np.zeros(more)])

    def placed(chosen: np.ndarray) -> Items:
        return place(problem, jax.tree.map(lambda leaf: np.asarray(leaf)[chosen], known))

    learned, checked = placed(np.append(learn, np.repeat(learn[-1:], more))), placed(judge) if judge.size else None
    carry, trace = descend(
        problem, task.optimizer, task.settings, Context(task.params, learned, checked, key), task.begin,
        np.tile(weights, (starts, 1)), dtype, chunk=chunk, report=progress, file=task.file,
        mark=task.mark(validation=validation),
    )  # fmt: skip
    return result_of(task, carry, trace, learn)


def best_starts(carry: Carry, starts: int) -> np.ndarray:
    """(F,) the number of the best fit of each group of `starts` fits; −1 where no fit has a finite loss.

    Losses over different numbers of items cannot be compared: only the starts with the most items are eligible.
    """
    scores, counted = carry.best_score.reshape(-1, starts), np.count_nonzero(carry.weights, axis=1).reshape(-1, starts)
    eligible = (counted == counted.max(axis=1, keepdims=True)) & np.isfinite(scores)
    number = np.argmin(np.where(eligible, scores, np.inf), axis=1) + starts * np.arange(len(scores))
    return np.where(eligible.any(axis=1), number, -1)


def _not_learned(transforms: PyTree, begin: PyTree, end: PyTree, reach: PyTree) -> dict[str, list[str]]:
    """Reason → names of the free parameters that are not learned, from free coordinates at begin and end."""
    nothing = (
        "the gradient is 0 at every step, or no more than rounding, for the loss of these items does not depend on it "
        "there"
    )
    stuck = "the start value lies at an end of the range, where the gradient vanishes: start further inside"
    bounded = over_transforms(
        lambda t, free: jax.tree.map(lambda _: math.isfinite(t.low) and math.isfinite(t.high), free), transforms, begin
    )
    names: dict[str, list[str]] = {nothing: [], stuck: []}
    for (path, first), last, inside, none in zip(
        jax.tree_util.tree_leaves_with_path(begin), *map(jax.tree.leaves, (end, bounded, flat(reach))), strict=True
    ):
        # a logit of 9.2 is within a ten-thousandth of the interval's width from its end, where the gradient vanishes
        at_end = inside and min(np.min(np.abs(first)), np.min(np.abs(last))) > 9.2
        if at_end or none:
            names[stuck if at_end else nothing].append(jax.tree_util.keystr(path).lstrip("."))
    return names


def result_of(task: Task, carry: Carry, trace: Trace, numbers: np.ndarray) -> Fit[PyTree]:
    """The result of a task's fits from several starts to the items with these numbers, with its warnings."""

    def warn(text: str) -> None:
        warnings.warn(text, stacklevel=4)

    (best,) = best_starts(carry, len(carry.loss))
    if best < 0 and np.isfinite(carry.loss).any():
        raise ValueError("the loss of the validation items is not finite: leave out those that cannot be computed")
    if best < 0:
        raise ValueError("the loss or its gradient is not finite at the start, for any item")
    last, transforms = lane(carry, best), task.problem.transforms
    losses, norms, accepted, scores = (column[best, : int(last.taken)] for column in trace)
    left_out = tuple(int(i) for i in numbers[last.weights[: numbers.size] == 0.0])
    if left_out:
        shown = ", ".join(map(str, left_out[:10])) + (", …" if len(left_out) > 10 else "")
        warn(
            f"{len(left_out)} of {numbers.size} items were left out: their loss or gradient is not finite at the "
            f"start (items {shown})"
        )
    reasons = _not_learned(transforms, lane(task.begin, best), last.best, last.reach) if accepted.any() else {}
    for reason, names in reasons.items():
        if names:
            warn(f"not learned: {', '.join(names)}; {reason}")
    not_learned = tuple(name for names in reasons.values() for name in names)
    if not last.best_step and len(not_learned) < len(jax.tree.leaves(last.best)):
        undone = np.count_nonzero(~accepted)
        steps = f"; {undone} of {accepted.size} steps led to a loss or a gradient that is not finite" if undone else ""
        warn(
            f"no step lowered the loss: the start values are the result, with a loss of {last.best_score:.3g}; the "
            f"loss before the last step is {losses[-1]:.3g}{steps}. They are an optimum already, or the learning rate "
            "is too large"
        )
    marks = zip(names_of(transforms), transforms_of(transforms), strict=True)
    return Fit(
        constrain(last.best, transforms, task.params), last.best, losses, norms, accepted, float(last.best_score),
        scores, left_out, task.labels, not_learned, tuple(name for name, mark in marks if mark.per_subject),
        int(last.best_step),
    )  # fmt: skip
