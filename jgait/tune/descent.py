"""Fits side by side as one program: steps of an optimiser in one `lax.scan`.

A step to a loss that is not finite is undone. With `Settings.downhill` a step is undone as well that does not lower the
loss enough; the next step goes to the minimum of the parabola through the losses and the slope along the same
direction. Such a fit stops where the loss is flat. The steps are run in chunks, between which the host reports, saves
and may stop.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.sharding import NamedSharding, PartitionSpec
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, Int, PyTree

from jgait.geometry.arrays import compiler_options
from jgait.tune import checkpoint
from jgait.tune.problem import Context, Items, Problem, item_losses, kept, total, value, value_of
from jgait.types import AnyArray, Integer, Values

AT_ONCE, MEMORY = 128, 2**25
"""Largest number of items times fits that run together in one program: with more, the numbers do not fit the
processor's cache. [bytes] Largest size of these items: a gradient through a filter needs some fifty times as much."""


class Settings(NamedTuple):
    """The settings of a fit, see `tune.fit`; static."""

    steps: int
    minibatch: int | None = None
    every: int = 1
    patience: int | None = None
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


class Progress(NamedTuple):
    """The state of a fit; of several fits, of the fit with the best score."""

    done: int  #: number of steps done.
    total: int  #: largest number of steps; `done` where every fit has stopped.
    loss: float  #: current loss.
    gradient_norm: float  #: current norm of the gradient, in unconstrained coordinates.
    score: float  #: lowest score so far: the loss, or the loss on the validation items.


Report = Callable[[Progress], None]
"""A function called on the host between chunks of steps; it has no influence on the result."""


def norm(tree: PyTree) -> Float[Array, ""]:
    """Euclidean norm over all leaves."""
    return jnp.sqrt(jax.tree.reduce(jnp.add, [jnp.sum(leaf * leaf) for leaf in jax.tree.leaves(tree)]))


def lane(tree: PyTree, number: int | slice | np.ndarray) -> PyTree:
    """The parts of a tree that belong to one or some of several fits."""
    return jax.tree.map(lambda leaf: leaf[number], tree)


def flat(reach: PyTree) -> PyTree:
    """For each leaf of `Carry.reach`, whether no number of it is learned: all are rounding, 2e-16 and less, whereas the
    parameters on which losses of recorded walks depend least have 4e-9.
    """
    return jax.tree.map(lambda leaf: jnp.all(leaf <= jnp.maximum(1e-12, 10.0 * jnp.finfo(leaf.dtype).eps)), reach)


def _all(tree: PyTree, *also: Bool[Array, ""]) -> Bool[Array, ""]:
    return jax.tree.reduce(jnp.logical_and, [tree, *also])


def _choose(condition: Bool[Array, ""], yes: PyTree, no: PyTree) -> PyTree:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), yes, no)


def _first(
    free: PyTree, optimizer: optax.GradientTransformation, weights: Float[Array, "item"], dtype: DTypeLike
) -> Carry:
    """The state before the loss of the start is computed."""
    infinite, zero = jnp.full((), jnp.inf, dtype), jnp.zeros((), jnp.int32)
    slope = jax.tree.map(jnp.zeros_like, free)
    return Carry(
        free, optimizer.init(free), jnp.asarray(weights, dtype), infinite, slope, jnp.ones((), dtype), free, infinite,
        zero, jnp.zeros((), bool), zero, slope,
    )  # fmt: skip


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


def _runner(
    problem: Problem, optimizer: optax.GradientTransformation, settings: Settings, size: int
) -> Callable[..., PyTree]:
    """(carry, numbers of the first and the last step, context) → carry and trace after `size` steps.

    Step −1 evaluates the start. Steps after the last one change nothing, so that one program runs every chunk of a fit.
    """
    downhill, minibatch = settings.downhill, settings.minibatch

    def run(carry: Carry, begin: Integer, steps: Integer, context: Context) -> tuple[Carry, Trace]:
        def evaluate(
            free: PyTree, weights: Float[Array, "item"], step: Int[Array, ""], forgiving: Bool[Array, ""]
        ) -> tuple[Float[Array, ""], PyTree, PyTree, Bool[Array, "batch"]]:
            items, batch_weights = _batch(settings, context, weights, step)
            return total(problem, free, context.params, items, batch_weights, jnp.sum(weights), forgiving)

        def updates(c: Carry, step: Int[Array, ""]) -> tuple[PyTree, PyTree]:
            @jax.custom_jvp
            def loss_at(free: PyTree) -> Float[Array, ""]:
                items, weights = _batch(settings, context, c.weights, jnp.maximum(step, 0))
                return value(problem, free, context.params, items, weights, jnp.sum(c.weights))

            @loss_at.defjvp
            def _(at: PyTree, moved: PyTree) -> tuple[Array, Array]:  # items without weight may have no gradient
                loss, gradient, *_ = evaluate(at[0], c.weights, jnp.maximum(step, 0), jnp.zeros((), bool))
                return loss, optax.tree.vdot(gradient, moved[0]).astype(loss.dtype)

            # line searches of optax refuse arguments that the value's function does not take
            def here(free: PyTree, obj_fn: PyTree = None, grad_fn: PyTree = None) -> Float[Array, ""]:
                return loss_at(free)

            # optax counts steps in integers; JAX's strict dtype promotion raises an error for these
            with jax.numpy_dtype_promotion("standard"):
                return optimizer.update(
                    c.gradient, c.optimizer, c.free, value=c.loss, grad=c.gradient, value_fn=here, obj_fn=here,
                    grad_fn=lambda free, _: jax.grad(here)(free),
                )  # fmt: skip

        def score(c: Carry) -> Float[Array, ""]:
            if context.checked is None:
                return value(problem, c.free, context.params, context.items, c.weights, jnp.sum(c.weights))
            losses = item_losses(problem, c.free, context.params, context.checked)
            return value_of(losses, jnp.ones_like(losses))

        def move(c: Carry, step: Int[Array, ""]) -> tuple[Carry, Trace]:
            starting, unknown = step < 0, jnp.full_like(c.loss, jnp.nan)
            update, state = updates(c, step)
            free = jax.tree.map(lambda f, u: jnp.where(starting, f, f + (c.scale * u).astype(f.dtype)), c.free, update)
            state = _choose(starting, c.optimizer, state)
            loss, gradient, variance, sound = evaluate(free, c.weights, step + 1, starting)
            if minibatch is not None:  # weights are computed over all items
                finite = lambda at: jnp.isfinite(item_losses(problem, at, context.params, context.items))  # noqa: E731
                sound = jax.lax.cond(starting, finite, lambda _: c.weights > -1.0, free)
            c = c._replace(weights=jnp.where(starting & ~sound, jnp.zeros_like(c.weights), c.weights))
            finite_ones = jax.tree.map(lambda leaf: jnp.all(jnp.isfinite(leaf)), (free, loss, gradient))
            good = _all(finite_ones, jnp.sum(c.weights) > 0.0)
            shorter, done = jnp.asarray(0.5, c.scale.dtype), jnp.zeros((), bool)
            if downhill:
                predicted = (c.scale * optax.tree.vdot(c.gradient, update)).astype(c.loss.dtype)
                missing = loss - c.loss - predicted
                shorter = jnp.where(good, jnp.clip(-0.5 * predicted / missing, 0.02, 0.5), 0.5).astype(c.scale.dtype)
                good = good & (starting | (missing <= (1e-4 - 1.0) * predicted))  # Armijo's rule
                rounding = max(1e-10, 10.0 * float(jnp.finfo(c.loss.dtype).eps))
                # of its standard error: the optimum is closer than a tenth of those of the parameters
                level = jax.tree.map(lambda g, v: jnp.all((v > 0.0) & (g * g <= 0.005**2 * v)), gradient, variance)
                done = (-0.5 * predicted <= rounding * jnp.abs(c.loss)) | (good & _all(level))
                done = done & ~starting
            whole = jnp.maximum(jnp.abs(loss), jnp.finfo(loss.dtype).tiny)
            reach = jax.tree.map(lambda r, g: jnp.maximum(r, (jnp.abs(g) / whole).astype(r.dtype)), c.reach, gradient)
            new = _choose(good, c._replace(free=free, optimizer=state, loss=loss, gradient=gradient, reach=reach), c)
            scale = jnp.minimum(1.0, 1.0 if downhill else 2.0 * c.scale)
            new = new._replace(scale=jnp.where(good, scale, shorter * c.scale).astype(c.scale.dtype))

            apart = context.checked is not None or minibatch is not None  # the score is not the loss of the step
            due = ((step + 1) % settings.every == 0) | (step + 1 == steps) if apart else jnp.ones((), bool)
            now = jax.lax.cond(due, score, lambda _: unknown, new) if apart else new.loss
            better = good & due & (now < c.best_score)
            best_step = jnp.where(better, step + 1, c.best_step)
            best, best_score = _choose(better, (new.free, now), (c.best, c.best_score))
            if settings.patience is not None:
                done = done | (due & (step + 1 - best_step >= settings.patience * settings.every))
            if minibatch is None:  # another part of the items may depend on the parameters
                done = done | _all(flat(new.reach), (step >= 0) & good)
            new = new._replace(best=best, best_score=best_score, best_step=best_step, stopped=done, taken=step + 1)
            return new, Trace(c.loss, norm(c.gradient), good, now if apart else unknown)

        def body(c: Carry, step: PyTree) -> tuple[Carry, Trace]:
            resting = (c, Trace(c.loss, norm(c.gradient), jnp.ones((), bool), jnp.full_like(c.loss, jnp.nan)))
            return _choose((step < steps) & ~c.stopped, move(c, step), resting)

        return jax.lax.scan(body, carry, begin + jnp.arange(size, dtype=jnp.int32))

    return run


@kept
def _program(
    problem: Problem, optimizer: optax.GradientTransformation, settings: Settings, size: int
) -> Callable[..., PyTree]:
    run = jax.vmap(_runner(problem, optimizer, settings, size), in_axes=(0, None, None, None))
    everywhere = None if problem.mesh is None else NamedSharding(problem.mesh, PartitionSpec())
    return jax.jit(run, out_shardings=everywhere, compiler_options=compiler_options() or None)


def descend(
    problem: Problem, optimizer: optax.GradientTransformation, settings: Settings, context: Context, free: PyTree,
    weights: Float[AnyArray, "lane item"] | Bool[AnyArray, "lane item"], dtype: PyTree, *, chunk: int | None = None,
    report: Report | None = None, file: Path | None = None, mark: dict[str, str] | None = None,
) -> tuple[Carry, Trace]:  # fmt: skip
    """Run several fits, each from its free coordinates and weights (L, …), to their end.

    Their final states, and the history of each, are on the host, every leaf with a leading axis of fits (L,); after a
    fit stopped, its last values repeat. `dtype` is that of the loss, `chunk` the number of steps in a chunk, None for
    all, or a twentieth of them with a `report` or a checkpoint's `file`, whose fits have the fingerprint `mark`.

    Raises:
        ValueError: see `checkpoint.load`.
    """
    total = settings.steps + 1  # the same program evaluates the start, as step −1
    if chunk is None and (settings.downhill or report or file):
        chunk = 4 if settings.downhill else max(2, settings.steps // 20)  # a flat loss ends a fit between chunks
    # XLA unrolls a scan of one step, which then rounds differently; so a chunk has at least two steps.
    size = total if chunk is None else min(total, max(2, chunk))
    size_of = sum(leaf.nbytes for leaf in jax.tree.leaves(context.items))
    group = max(1, min(AT_ONCE // (settings.minibatch or np.shape(weights)[1]), MEMORY // max(1, size_of)))
    key = problem, optimizer, settings._replace(steps=0), size
    run = _in_groups(_program(*key), group, problem.mesh is None)
    carry = jax.vmap(lambda f, w: _first(f, optimizer, w, dtype))(free, jnp.asarray(weights, dtype))
    lanes, kind = np.shape(carry.loss)[0], np.asarray(carry.loss).dtype
    begin, trace = 0, Trace(*(np.zeros((lanes, 0), bool if name == "accepted" else kind) for name in Trace._fields))
    if file is not None and (saved := checkpoint.load(file, mark or {}, (0, carry, trace))) is not None:
        begin, carry, trace = int(saved[0]), saved[1], saved[2]
    while begin < total and not np.all(np.asarray(carry.stopped)):
        carry, part = run(carry, np.int32(begin - 1), np.int32(settings.steps), context)
        trace = jax.tree.map(lambda v, w, left=total - begin: np.append(v, np.asarray(w)[:, :left], 1), trace, part)
        begin = min(begin + size, total)
        if file is not None and jax.process_index() == 0:
            checkpoint.save(file, mark or {}, (begin, carry, trace))
        scores = np.asarray(carry.best_score)
        if report is not None and np.isfinite(scores).any():
            now = lane(carry, int(np.nanargmin(scores)))
            last = begin - 1 if np.all(np.asarray(carry.stopped)) else settings.steps
            report(Progress(begin - 1, last, float(now.loss), float(norm(now.gradient)), float(now.best_score)))
    return jax.tree.map(np.asarray, carry), jax.tree.map(lambda v: v[:, 1:], trace)


def _in_groups(run: Callable[..., PyTree], group: int, threads: bool) -> Callable[..., PyTree]:
    """`run` for any number of fits: groups of one size, so that one program is compiled; a thread for each core.

    Fits are independent, and a program over recordings uses one core only. Where items are distributed over devices,
    the groups run one after another: all devices must run the same group.
    """

    def every(carry: Carry, *rest: PyTree) -> tuple[Carry, Trace]:
        lanes = np.shape(carry.loss)[0]
        if lanes <= group:
            return run(carry, *rest)

        def finished(start: int) -> PyTree:
            chosen = np.minimum(np.arange(start, start + group), lanes - 1)
            return jax.tree.map(np.asarray, run(jax.tree.map(lambda v: np.asarray(v)[chosen], carry), *rest))

        done = [finished(0)]
        with ThreadPoolExecutor(max(1, os.cpu_count() or 1) if threads else 1) as pool:
            done += pool.map(finished, range(group, lanes, group))
        return jax.tree.map(lambda *parts: np.concatenate(parts)[:lanes], *done)

    return every
