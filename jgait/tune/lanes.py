"""Several fits as one program, in chunks of steps; between chunks the host reports, saves and may stop."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.sharding import NamedSharding, PartitionSpec
from jaxtyping import Bool, Float, PyTree

from jgait.geometry.arrays import compiler_options
from jgait.tune import checkpoint
from jgait.tune.dask import DIED, on_dask
from jgait.tune.descent import Carry, Settings, Trace, first, runner
from jgait.tune.problem import Context, Problem, kept
from jgait.types import AnyArray

if TYPE_CHECKING:
    from distributed import Client


class Progress(NamedTuple):
    """The state of a fit; of several fits, of the fit with the best score."""

    done: int  #: number of steps done.
    total: int  #: largest number of steps; `done` where every fit has stopped.
    loss: float  #: current loss.
    gradient_norm: float  #: current norm of the gradient, in unconstrained coordinates.
    score: float  #: lowest score so far: the loss, or the loss on the validation items.


Report = Callable[[Progress], None]
"""A function called on the host between chunks of steps; it has no influence on the result."""


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
) -> tuple[Carry, Trace]:
    """Run several fits to their end: their final states, and the history of each.

    Both are on the host, every leaf with a leading axis of fits (L,); after a fit stopped, its last values repeat.

    Args:
        problem: the minimised function.
        optimizer: from optax, with support for extra arguments.
        settings: settings of all fits.
        context: parameters, items and key of all fits.
        free: starting coordinates of each fit, leaves (L, …).
        weights: (L, n) of the items for each fit.
        dtype: dtype of the loss.
        chunk: steps in a chunk; None for all steps, or a twentieth of them with a report or a file.
        report: called with the progress.
        file: checkpoint, or None.
        mark: fingerprint of the fits.

    Raises:
        ValueError: see `checkpoint.load`.
    """
    total = settings.steps + 1  # the same program evaluates the start, as step −1
    if chunk is None and (settings.downhill or report or file):
        chunk = FEW if settings.downhill else max(2, settings.steps // 20)
    # XLA unrolls a scan of one step, which then rounds differently; so a chunk has at least two steps.
    size = total if chunk is None else min(total, max(2, chunk))
    size_of = sum(leaf.nbytes for leaf in jax.tree.leaves(context.items))
    group = max(1, min(AT_ONCE // (settings.minibatch or np.shape(weights)[1]), MEMORY // max(1, size_of)))
    key = problem, optimizer, settings._replace(steps=0), size
    run = _in_groups(_program(*key), group, problem.mesh is None)
    carry = jax.vmap(lambda f, w: first(f, optimizer, w, dtype))(free, jnp.asarray(weights, dtype))
    lanes, kind = np.shape(carry.loss)[0], np.asarray(carry.loss).dtype
    empty = (np.zeros((lanes, 0), bool if name == "accepted" else kind) for name in Trace._fields)
    begin, history = 0, [Trace(*empty)]
    saved = None if file is None else checkpoint.load(file, mark, (0, carry, history[0]))
    if saved is not None:
        begin, carry, history = int(saved[0]), saved[1], [saved[2]]
    while begin < total and not np.all(np.asarray(carry.stopped)):
        carry, part = run(carry, np.int32(begin - 1), np.int32(settings.steps), context)
        part = jax.tree.map(lambda v, left=total - begin: np.asarray(v)[:, :left], part)
        history, begin = [*history, part], min(begin + size, total)
        if file is not None and jax.process_index() == 0:
            history = [_joined(history)]
            checkpoint.save(file, mark, (begin, carry, history[0]))
        if report is not None and np.isfinite(np.asarray(carry.best_score)).any():
            stopped = np.all(np.asarray(carry.stopped))
            report(_progress(carry, begin - 1, begin - 1 if stopped else settings.steps))
    trace = _joined(history)
    return jax.tree.map(np.asarray, carry), jax.tree.map(lambda v: v[:, 1:], trace)


def descend_apart(
    run: Callable[..., tuple[Carry, Trace]], free: PyTree, weights: Bool[AnyArray, "lane item"], *,
    report: Report | None, file: Path | None, part: tuple[int, int] | None = None, client: "Client | None" = None,
) -> tuple[Carry, Trace] | None:  # fmt: skip
    """`descend` with its fits shared among machines: one part of them, all of them from files of parts, or on Dask.

    `run` is `descend` but for the next four arguments. The fits of a `part`, its number from 1 and that of all parts,
    are finished in `STEM-K-of-N.npz` beside the file, and the result is None. A later call without `part` takes the
    fits of all these files. The workers of a `client` share the fits.
    """
    lanes = len(weights)

    def piece(number: int, of: int) -> tuple[PyTree, PyTree]:
        return jax.tree.map(lambda leaf: np.asarray(leaf)[number - 1 :: of], (free, weights))

    def file_of(number: int, of: int) -> Path | None:
        return None if file is None else file.with_name(f"{file.stem}-{number}-of-{of}{file.suffix}")

    if part is not None:
        if part[0] <= lanes:
            run(*piece(*part), report=report, file=file_of(*part))
        return None
    there = [] if file is None else [*file.parent.glob(f"{file.stem}-1-of-*{file.suffix}")]
    if client is not None:
        of = lanes
        parts = _there(run, [piece(number, of) for number in range(1, of + 1)], client)
    elif there:
        of = int(there[0].stem.rpartition("-")[2])
        parts = [run(*piece(k, of), report=report, file=file_of(k, of)) for k in range(1, min(lanes, of) + 1)]
    else:
        return run(free, weights, report=report, file=file)
    order = np.argsort(np.concatenate([np.arange(lanes)[number::of] for number in range(of)]))
    longest = max(trace.loss.shape[1] for _, trace in parts)
    filled = [
        (carry, Trace(*(np.pad(v, ((0, 0), (0, longest - v.shape[1])), "edge") for v in trace)))
        for carry, trace in parts
    ]
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[order], *filled)


def _there(
    run: Callable[..., tuple[Carry, Trace]], fits: list[tuple[PyTree, PyTree]], client: "Client"
) -> list[tuple[Carry, Trace]]:
    """`run` of each fit on the workers of a cluster; raises RuntimeError for a fit whose workers die repeatedly."""
    done: dict[int, tuple[Carry, Trace]] = {}
    for ((number, _),), result in on_dask(
        lambda group: run(*group[0][1], report=None, file=None), enumerate(fits), client
    ):
        if result is None:
            raise RuntimeError(f"fit {number + 1} of {len(fits)} has no result: {DIED}")
        done[number] = result
    return [done[number] for number in range(len(fits))]


@kept
def _program(
    problem: Problem, optimizer: optax.GradientTransformation, settings: Settings, size: int
) -> Callable[..., PyTree]:
    run = jax.vmap(runner(problem, optimizer, settings, size), in_axes=(0, None, None, None))
    everywhere = None if problem.mesh is None else NamedSharding(problem.mesh, PartitionSpec())
    return jax.jit(run, out_shardings=everywhere, compiler_options=compiler_options() or None)


FEW = 4
"""Number of steps in a chunk of a fit that stops where the loss is flat, which is checked between chunks."""

AT_ONCE, MEMORY = 128, 2**25
"""Largest number of items times fits that run together in one program: with more, the numbers do not fit the
processor's cache. [bytes] Largest size of these items: a gradient through a filter needs some fifty times as much."""


def _in_groups(run: Callable[..., PyTree], group: int, threads: bool) -> Callable[..., PyTree]:
    """`run` for any number of fits: groups of one size, so that one program is compiled; a thread for each core.

    Fits are independent, and a program over recordings uses one core only. Where items are distributed over devices,
    the groups run one after another: all devices must run the same group.
    """

    def every(carry: Carry, *rest: PyTree) -> tuple[Carry, Trace]:
        lanes = np.shape(carry.loss)[0]
        if lanes <= group:
            return run(carry, *rest)
        starts = range(0, lanes, group)
        pieces = [
            jax.tree.map(lambda v, at=at: np.asarray(v)[np.minimum(np.arange(at, at + group), lanes - 1)], carry)
            for at in starts
        ]

        def finished(piece: Carry) -> PyTree:
            return jax.tree.map(np.asarray, run(piece, *rest))

        done = [finished(pieces[0])]
        with ThreadPoolExecutor(max(1, os.cpu_count() or 1) if threads else 1) as pool:
            done += pool.map(finished, pieces[1:])
        return jax.tree.map(lambda *parts: np.concatenate(parts)[:lanes], *done)

    return every


def _joined(parts: list[Trace]) -> Trace:
    return Trace(*(np.concatenate(columns, axis=1) for columns in zip(*parts, strict=True)))


def _progress(carry: Carry, done: int, total: int) -> Progress:
    best = int(np.nanargmin(np.asarray(carry.best_score)))
    slope = np.sqrt(sum(float(np.sum(np.square(np.asarray(leaf)[best]))) for leaf in jax.tree.leaves(carry.gradient)))
    return Progress(done, total, float(carry.loss[best]), float(slope), float(carry.best_score[best]))
