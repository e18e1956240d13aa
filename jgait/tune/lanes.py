"""Several fits side by side as one program, in stretches between which the host reports, saves and may stop."""

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
from jaxtyping import Bool, Float, PyTree

from jgait.filtering.compile import wide_vectors
from jgait.tune import checkpoint
from jgait.tune.descent import Carry, Settings, Trace, first, runner
from jgait.tune.problem import Context, Problem
from jgait.types import AnyArray, Integer


class Progress(NamedTuple):
    """How far a fit is; of several, the one that stands best.

    Attributes:
        done: steps.
        total: steps at most.
        loss: now.
        gradient_norm: now, in unconstrained coordinates.
        score: the best yet of what the result is chosen by: loss, or loss on the validation items.
    """

    done: int
    total: int
    loss: float
    gradient_norm: float
    score: float


Report = Callable[[Progress], None]
"""Called on the host between stretches of steps; it changes nothing in the result."""


class Lanes(NamedTuple):
    """Where several fits ended, on the host; every leaf has a leading axis of fits (L,).

    Attributes:
        carry: the last of each.
        trace: (L, steps) of each; steps after a fit stopped repeat.
    """

    carry: Carry
    trace: Trace


def descend(
    problem: Problem,
    optimizer: optax.GradientTransformation,
    settings: Settings,
    context: Context,
    free: PyTree,
    weights: Float[AnyArray, "lane item"] | Bool[AnyArray, "lane item"],
    dtype: PyTree,
    *,
    chunk: int | None,
    report: Report | None,
    file: Path | None,
    mark: dict[str, str],
) -> Lanes:
    """Run several fits to their end.

    Args:
        problem: what is minimised.
        optimizer: from optax, with support for extra arguments.
        settings: of all fits.
        context: what they read.
        free: where each starts, leaves (L, …).
        weights: (L, n) of the items for each.
        dtype: of the loss.
        chunk: steps a stretch; None for all at once, or a twentieth where there is something to report or to save.
        report: called with the progress.
        file: checkpoint, or None.
        mark: fingerprint of the fits.

    Raises:
        ValueError: see `checkpoint.load`.
    """
    total = settings.steps + 1  # the start is evaluated as step −1, by the same program as every other
    chunk = max(2, settings.steps // 20) if chunk is None and (report or file) else chunk
    # A scan of one step would be unrolled and round differently; two is the least.
    size = total if chunk is None else min(total, max(2, chunk))
    run = _in_groups(_program(problem, optimizer, settings, size), _group(settings, weights), problem.mesh is None)
    carry = jax.vmap(lambda f, w: first(f, optimizer, w, dtype))(free, jnp.asarray(weights, dtype))
    begin, history = 0, [_empty(carry)]
    saved = None if file is None else checkpoint.load(file, mark, (0, carry, history[0]))
    if saved is not None:
        begin, carry, history = int(saved[0]), saved[1], [saved[2]]
    while begin < total and not np.all(np.asarray(carry.stopped)):
        carry, part = run(carry, np.int32(begin - 1), context)
        part = jax.tree.map(lambda v, left=total - begin: np.asarray(v)[:, :left], part)
        history, begin = [*history, part], min(begin + size, total)
        if file is not None and jax.process_index() == 0:
            history = [_joined(history)]
            checkpoint.save(file, mark, (begin, carry, history[0]))
        if report is not None and np.isfinite(np.asarray(carry.best_score)).any():
            report(_progress(carry, begin - 1, settings.steps))
    trace = _joined(history)
    return Lanes(jax.tree.map(np.asarray, carry), jax.tree.map(lambda v: v[:, 1:], trace))


def _program(
    problem: Problem, optimizer: optax.GradientTransformation, settings: Settings, size: int
) -> Callable[..., PyTree]:
    run = jax.vmap(runner(problem, optimizer, settings, size), in_axes=(0, None, None))
    everywhere = None if problem.mesh is None else NamedSharding(problem.mesh, PartitionSpec())
    return jax.jit(run, out_shardings=everywhere, compiler_options=wide_vectors() or None)


AT_ONCE = 128
"""Items times fits that one program works on: as many numbers as the processor's nearest memory takes."""


def _group(settings: Settings, weights: Float[AnyArray, "lane item"] | Bool[AnyArray, "lane item"]) -> int:
    """How many fits run side by side in one program."""
    return max(1, AT_ONCE // (settings.minibatch or np.shape(weights)[1]))


def _in_groups(run: Callable[..., PyTree], group: int, threads: bool) -> Callable[..., PyTree]:
    """The same for any number of fits: groups of one size, so that one program is compiled, a thread for each core.

    Fits know nothing of each other, and a program over recordings keeps no more than one core busy. Where devices
    share the items, groups run in turn: devices must agree on what they do together.
    """

    def every(carry: Carry, begin: Integer, context: Context) -> tuple[Carry, Trace]:
        lanes = np.shape(carry.loss)[0]
        if lanes <= group:
            return run(carry, begin, context)
        starts = range(0, lanes, group)
        pieces = [
            jax.tree.map(lambda v, at=at: np.asarray(v)[np.minimum(np.arange(at, at + group), lanes - 1)], carry)
            for at in starts
        ]

        def one(piece: Carry) -> PyTree:
            return jax.tree.map(np.asarray, run(piece, begin, context))

        done = [one(pieces[0])]
        with ThreadPoolExecutor(max(1, os.cpu_count() or 1) if threads else 1) as pool:
            done += pool.map(one, pieces[1:])
        return jax.tree.map(lambda *parts: np.concatenate(parts)[:lanes], *done)

    return every


def _empty(carry: Carry) -> Trace:
    lanes, kind = np.shape(carry.loss)[0], np.asarray(carry.loss).dtype
    return Trace(*(np.zeros((lanes, 0), bool if name == "accepted" else kind) for name in Trace._fields))


def _joined(parts: list[Trace]) -> Trace:
    return Trace(*(np.concatenate(columns, axis=1) for columns in zip(*parts, strict=True)))


def _progress(carry: Carry, done: int, total: int) -> Progress:
    best = int(np.nanargmin(np.asarray(carry.best_score)))
    slope = np.sqrt(sum(float(np.sum(np.square(np.asarray(leaf)[best]))) for leaf in jax.tree.leaves(carry.gradient)))
    return Progress(done, total, float(carry.loss[best]), float(slope), float(carry.best_score[best]))
