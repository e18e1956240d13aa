"""Steps of an optimiser as one `lax.scan`, for several fits side by side; a step to a non-finite loss is undone.

With `Settings.downhill` a step is undone as well that does not lower the loss enough; the next step goes to the minimum
of the parabola through the losses and the slope along the same direction. Such a fit stops where the loss is flat.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, Int, PyTree

from jgait.tune.problem import Context, Items, Problem, item_losses, total, value, value_of
from jgait.types import Integer, Values

NOTHING = 1e-12
"""Largest gradient, relative to the loss, of a parameter that is not learned [share of the loss for each unit of the
free coordinate]. Rounding gives 2e-16 and less, the parameters on which losses of recorded walks depend least 4e-9."""


FLAT = 0.005
"""Largest gradient of a finished fit, of each free number [standard errors of the gradient over the items]: the optimum
is closer than a tenth of the parameters' standard errors, also where parameters are correlated."""

DECREASE = 1e-4
"""Least decrease of the loss of a step that is kept, as a share of what the slope predicts (Armijo's rule) [1]."""

SHORTENED = (0.02, 0.5)
"""Least and largest factor by which a step that is undone becomes shorter [1]."""


class Settings(NamedTuple):
    """The settings of a fit, see `tune.fit`; static."""

    steps: int
    minibatch: int | None
    every: int
    patience: int | None
    downhill: bool = False  #: whether each step must lower the loss, and the fit stops where the loss is flat.


class Carry(NamedTuple):
    """The state of one fit between two steps; `free` always has a finite loss and gradient."""

    free: PyTree  #: current free coordinates.
    optimizer: PyTree  #: state of the optimiser.
    #: (n,) of the items; 0 for items without a finite loss or gradient at the start.
    weights: Float[Array, "*lane item"]
    loss: Float[Array, "*lane"]  #: at `free`, over the training items of the next step.
    gradient: PyTree  #: gradient of that loss at `free`.
    scale: Float[Array, "*lane"]  #: fraction of the optimiser's update that the next step applies.
    best: PyTree  #: free coordinates with the lowest score so far.
    best_score: Values  #: score of `best`: its loss on the validation items if there are any, else on all items.
    best_step: Int[Array, "*lane"]  #: number of the step that led to `best`.
    stopped: Bool[Array, "*lane"]  #: bool, True after `patience` scores without improvement.
    taken: Int[Array, "*lane"]  #: number of steps done.
    reach: PyTree  #: largest |gradient| of each free number at any step so far, as a share of |loss|.


class Trace(NamedTuple):
    """The history of one step: loss and norm of the gradient before it, whether it was kept, its score or NaN."""

    loss: Values
    norm: Values
    accepted: Values
    score: Values


def norm(tree: PyTree) -> Float[Array, ""]:
    """Euclidean norm over all leaves."""
    return jnp.sqrt(jax.tree.reduce(jnp.add, [jnp.sum(leaf * leaf) for leaf in jax.tree.leaves(tree)]))


def _finite(tree: PyTree) -> Bool[Array, ""]:
    return jax.tree.reduce(jnp.logical_and, [jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(tree)])


def choose(condition: Bool[Array, ""], yes: PyTree, no: PyTree) -> PyTree:
    """The leaves of one of two trees."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), yes, no)


def first(
    free: PyTree, optimizer: optax.GradientTransformation, weights: Float[Array, "item"], dtype: DTypeLike
) -> Carry:
    """The state before the loss of the start is computed."""
    infinite = jnp.full((), jnp.inf, dtype)
    zero = jnp.zeros((), jnp.int32)
    slope = jax.tree.map(jnp.zeros_like, free)
    state = optimizer.init(free)
    weights = jnp.asarray(weights, dtype)
    stopped = jnp.zeros((), bool)
    full = jnp.ones((), dtype)
    return Carry(free, state, weights, infinite, slope, full, free, infinite, zero, stopped, zero, slope)


def flat(reach: PyTree) -> PyTree:
    """For each leaf of `Carry.reach`, whether no number of it is learned."""
    return jax.tree.map(lambda leaf: jnp.all(leaf <= jnp.maximum(NOTHING, 10.0 * jnp.finfo(leaf.dtype).eps)), reach)


def _level(gradient: PyTree, variance: PyTree) -> Bool[Array, ""]:
    """Whether the gradient of each number is small beside its standard error, and there are items enough for one."""
    flat_ones = jax.tree.map(lambda g, v: jnp.all((v > 0.0) & (g * g <= FLAT**2 * v)), gradient, variance)
    return jax.tree.reduce(jnp.logical_and, flat_ones)


def _reach(reach: PyTree, loss: Float[Array, ""], gradient: PyTree) -> PyTree:
    size = jnp.maximum(jnp.abs(loss), jnp.finfo(loss.dtype).tiny)
    return jax.tree.map(lambda r, g: jnp.maximum(r, (jnp.abs(g) / size).astype(r.dtype)), reach, gradient)


def _batch(
    settings: Settings, context: Context, weights: Float[Array, "item"], step: Int[Array, ""]
) -> tuple[Items, Float[Array, "batch"]]:
    """The training items of a step and their weights; each epoch takes the items in a new random order."""
    if settings.minibatch is None:
        return context.items, weights
    n, size = weights.shape[0], settings.minibatch
    epoch_steps = -(-n // size)
    order = jax.random.permutation(jax.random.fold_in(context.key, step // epoch_steps), n)
    chosen = order[((step % epoch_steps) * size + jnp.arange(size, dtype=jnp.int32)) % n]
    return jax.tree.map(lambda leaf: leaf[chosen], context.items), weights[chosen]


def _score(
    problem: Problem, settings: Settings, context: Context
) -> Callable[[PyTree, Float[Array, "item"]], Float[Array, ""]] | None:
    """(free, weights) → score that selects the best step; None where the score is the loss of the step."""
    if context.checked is not None:
        checked = context.checked

        def judged(free: PyTree, weights: Float[Array, "item"]) -> Float[Array, ""]:
            losses = item_losses(problem, free, context.params, checked)
            return value_of(losses, jnp.ones_like(losses))

        return judged
    if settings.minibatch is None:
        return None
    return lambda free, weights: value(problem, free, context.params, context.items, weights, jnp.sum(weights))


def runner(
    problem: Problem, optimizer: optax.GradientTransformation, settings: Settings, size: int
) -> Callable[..., PyTree]:
    """(carry, numbers of the first and the last step, context) → carry and trace after `size` steps; step −1 evaluates
    the start.

    Steps after the last one change nothing, so that one program runs every chunk of a fit.
    """

    def run(carry: Carry, begin: Integer, steps: Integer, context: Context) -> tuple[Carry, Trace]:
        look = _score(problem, settings, context)

        def finite_items(free: PyTree) -> Bool[Array, "item"]:
            return jnp.isfinite(item_losses(problem, free, context.params, context.items))

        def evaluate(
            free: PyTree, weights: Float[Array, "item"], step: Int[Array, ""], forgiving: Bool[Array, ""]
        ) -> tuple[Float[Array, ""], PyTree, PyTree, Bool[Array, "batch"]]:
            items, batch_weights = _batch(settings, context, weights, step)
            return total(problem, free, context.params, items, batch_weights, jnp.sum(weights), forgiving)

        def updates(c: Carry, step: Int[Array, ""]) -> tuple[PyTree, PyTree]:
            items, batch_weights = _batch(settings, context, c.weights, jnp.maximum(step, 0))

            # line searches of optax refuse arguments that the value's function does not take
            def here(free: PyTree, obj_fn: PyTree = None, grad_fn: PyTree = None) -> Float[Array, ""]:
                return value(problem, free, context.params, items, batch_weights, jnp.sum(c.weights))

            # optax counts steps in integers; JAX's strict dtype promotion raises an error for these
            with jax.numpy_dtype_promotion("standard"):
                return optimizer.update(
                    c.gradient, c.optimizer, c.free, value=c.loss, grad=c.gradient, value_fn=here, obj_fn=here,
                    grad_fn=lambda free, _: jax.grad(here)(free),
                )  # fmt: skip

        def move(c: Carry, step: Int[Array, ""]) -> tuple[Carry, Trace]:
            starting = step < 0
            update, state = updates(c, step)
            free = jax.tree.map(lambda f, u: jnp.where(starting, f, f + (c.scale * u).astype(f.dtype)), c.free, update)
            state = choose(starting, c.optimizer, state)
            loss, gradient, variance, sound = evaluate(free, c.weights, step + 1, starting)
            if settings.minibatch is not None:  # weights are computed over all items
                sound = jax.lax.cond(starting, finite_items, lambda _: c.weights > -1.0, free)
            c = c._replace(weights=jnp.where(starting & ~sound, jnp.zeros_like(c.weights), c.weights))
            good = _finite((free, loss, gradient)) & (jnp.sum(c.weights) > 0.0)
            shorter, done = jnp.asarray(0.5, c.scale.dtype), jnp.zeros((), bool)
            if settings.downhill:
                predicted = (c.scale * optax.tree.vdot(c.gradient, update)).astype(c.loss.dtype)
                missing = loss - c.loss - predicted
                shorter = jnp.where(good, jnp.clip(-0.5 * predicted / missing, *SHORTENED), 0.5).astype(c.scale.dtype)
                good = good & (starting | (missing <= (DECREASE - 1.0) * predicted))
                rounding = max(1e-10, 10.0 * float(jnp.finfo(c.loss.dtype).eps))
                done = (-0.5 * predicted <= rounding * jnp.abs(c.loss)) | (good & _level(gradient, variance))
                done = done & ~starting
            reach = _reach(c.reach, loss, gradient)
            kept = choose(good, c._replace(free=free, optimizer=state, loss=loss, gradient=gradient, reach=reach), c)
            scale = jnp.minimum(1.0, 1.0 if settings.downhill else 2.0 * c.scale)
            kept = kept._replace(scale=jnp.where(good, scale, shorter * c.scale).astype(c.scale.dtype))
            new, trace = _keep_best(c, kept, good, step, steps, look, settings)
            new = new._replace(stopped=new.stopped | done)
            if settings.minibatch is None:  # another part of the items may depend on the parameters
                nothing = jax.tree.reduce(jnp.logical_and, flat(new.reach), (step >= 0) & good)
                new = new._replace(stopped=new.stopped | nothing)
            return new, trace

        def body(c: Carry, step: PyTree) -> tuple[Carry, Trace]:
            unknown = jnp.full_like(c.loss, jnp.nan)
            resting = (c, Trace(c.loss, norm(c.gradient), jnp.ones((), bool), unknown))
            return choose((step < steps) & ~c.stopped, move(c, step), resting)

        return jax.lax.scan(body, carry, begin + jnp.arange(size, dtype=jnp.int32))

    return run


def _keep_best(
    c: Carry,
    kept: Carry,
    good: Bool[Array, ""],
    step: Int[Array, ""],
    steps: Integer,
    look: Callable[[PyTree, Float[Array, "item"]], Float[Array, ""]] | None,
    settings: Settings,
) -> tuple[Carry, Trace]:
    """The carry after a step, with `best` and `stopped` updated."""
    unknown = jnp.full_like(c.loss, jnp.nan)
    if look is None:
        due, score = jnp.ones((), bool), kept.loss
    else:
        due = ((step + 1) % settings.every == 0) | (step + 1 == steps)
        score = jax.lax.cond(due, lambda k: look(k.free, k.weights), lambda k: unknown, kept)
    better = good & due & (score < c.best_score)
    best, best_score = choose(better, (kept.free, score), (c.best, c.best_score))
    best_step = jnp.where(better, step + 1, c.best_step)
    stopped = c.stopped
    if settings.patience is not None:
        stopped = due & (step + 1 - best_step >= settings.patience * settings.every)
    new = kept._replace(best=best, best_score=best_score, best_step=best_step, stopped=stopped, taken=step + 1)
    return new, Trace(c.loss, norm(c.gradient), good, unknown if look is None else score)
