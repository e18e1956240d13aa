"""A fit of the foot estimator to groups of lessons, each computed by a thread of its own, by Adam on their sum."""

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from experiments.autotune.evidence import between
from jgait import filtering, params, tune
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import DEFAULT, FootOptions, FootParams
from jgait.tune import Lessons
from jgait.tune.objective import Term

FREE = (
    "pivot_height", "velocity_noise", "rate_noise", "acc_noise", "gyr_noise", "acc_jump_noise", "gyr_jump_noise",
    "noise",
)  # fmt: skip
"""What is learned; the rest keeps its default. The place of the reference's marker is solved apart, see `marker`."""

STEPS, RATE = 14, 0.25
"""Steps of Adam and the rate of the first, which falls to 0: up to 1.75 units of a logarithm in all."""


class Learned(NamedTuple):
    """Free values before and after, the loss before each step, and each step's seconds, by the clock and of the
    processors; the first compiles."""

    start: Any
    free: Any
    losses: list[float]
    seconds: list[tuple[float, float]]


@cache
def _programs(options: FootOptions, loss: str | Term) -> tuple[Any, Any]:
    """Transforms, and a program (free, start, lessons, weights) → value and gradient of the weighted sum."""
    estimator = foot_ins.estimator(options)
    transforms = params.freed(estimator.transforms, *FREE[: -1 if options.noise == "constant" else None])
    objective = tune.objective(estimator, options, {loss: 1.0})

    def one(moved: Any, start: Any, lesson: Any) -> Any:
        value = objective(params.constrain(moved, transforms, start), lesson)
        return jnp.where(jnp.isfinite(value), value, 0.0)

    def total(moved: Any, start: Any, data: Any, weights: Any) -> Any:
        """One lesson after another, so that one lesson's trajectories are in memory; those of weight 0 do not run."""
        each = tune.value_and_grad(one, "reverse")
        nothing = jax.tree.map(jnp.zeros_like, (jnp.zeros((), jnp.float32), moved))

        def of(item: Any) -> Any:
            lesson, weight = item
            found = jax.lax.cond(weight > 0.0, lambda: each(moved, start, lesson), lambda: nothing)
            return jax.tree.map(lambda v: weight * v, found)

        return jax.tree.map(lambda v: jnp.sum(v, axis=0), jax.lax.map(of, (data, weights)))

    return transforms, filtering.compiled(total)


def natural(free: Any, start: FootParams, options: FootOptions = DEFAULT) -> FootParams:
    """Parameters in natural units from free values; those that are not learned are those of `start`."""
    return params.constrain(free, _programs(options, "position_log")[0], _single(start))


def part(found: Learned, share: float, start: FootParams, options: FootOptions) -> FootParams:
    """Parameters at a share of the way of a fit."""
    return natural(between(found.start, found.free, share), start, options)


def fit(
    groups: Sequence[tuple[np.ndarray, Lessons]], weights: np.ndarray, start: FootParams,
    options: FootOptions = DEFAULT, loss: str | Term = "position_log", *, steps: int = STEPS,
    names: tuple[str, ...] = (), priors: bool = True,
) -> Learned:  # fmt: skip
    """Fit the parameters `names`, or all of `FREE`, to trials with a weight above 0; priors as declared, or none."""
    transforms, program = _programs(options, loss)
    start = _single(start)
    declared, count = params.priors(foot_ins.estimator(options).params), float(np.sum(weights))
    moved = begin = params.unconstrain(start, transforms)
    own = params.freed(foot_ins.estimator(options).transforms, *names) if names else transforms
    kept = jax.tree_util.tree_flatten_with_path(params.unconstrain(start, own))[0]
    learned = {jax.tree_util.keystr(path) for path, _ in kept}

    @jax.jit
    def penalty(free: Any) -> Any:
        at = jax.tree.leaves(params.constrain(free, transforms, start))
        leaves = jax.tree.leaves(declared, is_leaf=lambda v: v is None or isinstance(v, params.Prior))
        known = [jnp.sum(one.penalty(v)) for one, v in zip(leaves, at, strict=True) if one is not None]
        return (sum(known, jnp.zeros((), jnp.float32)) if priors else jnp.zeros(())).astype(jnp.float32) / count

    optimizer = optax.adam(optax.cosine_decay_schedule(RATE, steps), b1=0.8, b2=0.95)
    state = optimizer.init(moved)
    losses, seconds, pool = [], [], ThreadPoolExecutor(len(groups))
    weighted = [(made.data, jnp.asarray(weights[rows] / count, jnp.float32)) for rows, made in groups]
    for _ in range(steps):
        began = np.array([time.perf_counter(), time.process_time()])
        value, slope = jax.value_and_grad(penalty)(moved)
        apply = pool.map if losses else map  # the first step compiles
        for some, more in apply(lambda group, at=moved: jax.block_until_ready(program(at, start, *group)), weighted):
            value, slope = value + some, jax.tree.map(jnp.add, slope, more)
        losses.append(float(value))
        slope = jax.tree_util.tree_map_with_path(
            lambda path, v: v if jax.tree_util.keystr(path) in learned else jnp.zeros_like(v), slope
        )
        step, state = optimizer.update(slope, state)
        moved = optax.apply_updates(moved, step)
        seconds.append(tuple(np.array([time.perf_counter(), time.process_time()]) - began))
    return Learned(begin, moved, losses, seconds)


def _single(p: FootParams) -> FootParams:
    return jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), p)
