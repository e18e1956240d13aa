"""A fit of the foot estimator to groups of lessons, each computed by a thread of its own, by Adam on their sum."""

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from jgait import filtering, params, tune
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import FootOptions, FootParams
from jgait.tune import Lessons
from jgait.tune.objective import Term

FREE = (
    "pivot_height", "velocity_noise", "rate_noise", "acc_noise", "gyr_noise", "acc_jump_noise", "gyr_jump_noise",
    "noise", "tracked_point",
)  # fmt: skip
"""What is learned; the rest keeps its default. Only a path can teach the point that the reference tracks."""

NOISES = tuple(name for name in FREE if name.endswith("_noise"))
"""What the likelihood of the innovations is asked to teach."""

MARKER = ("tracked_point",)
"""What is learned where the rest stays hand-chosen: where the reference's marker is on the foot."""

STEPS, FEW, RATE = 30, 15, 0.15


class Learned(NamedTuple):
    """Parameters, the loss before each step, and the seconds of each step, the first of which compiles."""

    params: FootParams
    losses: list[float]
    seconds: list[float]


@cache
def _programs(options: FootOptions, loss: str | Term, names: tuple[str, ...]) -> tuple[Any, Any]:
    """Transforms, and a program (free, start, lessons, weights) → value and gradient of the weighted sum."""
    estimator = foot_ins.estimator(options)
    free = params.freed(estimator.transforms, *names)
    objective = tune.objective(estimator, options, {loss: 1.0})

    def one(moved: Any, start: Any, lesson: Any, weight: Any) -> Any:
        value = objective(params.constrain(moved, free, start), lesson)
        return jnp.where(jnp.isfinite(value) & (weight > 0.0), weight * value, 0.0)

    def total(moved: Any, start: Any, data: Any, weights: Any) -> Any:
        """One lesson after another, so that only one lesson's trajectories are in memory."""
        each = tune.value_and_grad(one, "reverse")
        found = jax.lax.map(lambda item: each(moved, start, *item), (data, weights))
        return jax.tree.map(lambda v: jnp.sum(v, axis=0), found)

    return free, filtering.compiled(total)


def fit(
    groups: Sequence[tuple[np.ndarray, Lessons]], weights: np.ndarray, options: FootOptions,
    loss: str | Term = "position_log", steps: int = STEPS, free: tuple[str, ...] = FREE,
    start: FootParams | None = None,
) -> Learned:  # fmt: skip
    """Fit the parameters `free` to the trials with a weight above 0; priors as declared."""
    transforms, program = _programs(options, loss, free)
    start = foot_ins.estimator(options).params if start is None else start
    start = jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), start)
    priors, count = params.priors(foot_ins.estimator(options).params), float(np.sum(weights))
    moved = params.unconstrain(start, transforms)

    @jax.jit
    def penalty(free: Any) -> Any:
        natural = params.constrain(free, transforms, start)
        leaves = jax.tree.leaves(priors, is_leaf=lambda v: v is None or isinstance(v, params.Prior))
        values = jax.tree.leaves(natural)
        known = [jnp.sum(one.penalty(v)) for one, v in zip(leaves, values, strict=True) if one is not None]
        return sum(known, jnp.zeros((), jnp.float32)).astype(jnp.float32) / count

    optimizer = optax.adam(optax.cosine_decay_schedule(RATE, steps), b1=0.8, b2=0.95)
    state = optimizer.init(moved)
    losses, seconds, pool = [], [], ThreadPoolExecutor(len(groups))
    weighted = [(made.data, jnp.asarray(weights[rows] / count, jnp.float32)) for rows, made in groups]
    for _ in range(steps):
        began = time.perf_counter()
        value, slope = jax.value_and_grad(penalty)(moved)
        apply = pool.map if losses else map  # the first step compiles
        for part, more in apply(lambda group, at=moved: jax.block_until_ready(program(at, start, *group)), weighted):
            value, slope = value + part, jax.tree.map(jnp.add, slope, more)
        losses.append(float(value))
        step, state = optimizer.update(slope, state)
        moved = optax.apply_updates(moved, step)
        seconds.append(time.perf_counter() - began)
    return Learned(params.constrain(moved, transforms, start), losses, seconds)


@partial(filtering.compiled, static_argnames=("options", "loss"))
def _errors(p: FootParams, data: Any, options: FootOptions, loss: str) -> Any:
    estimator = foot_ins.estimator(options)
    return jax.vmap(lambda lesson: tune.LOSSES[loss].error(estimator.run(p, lesson.inputs, options), lesson))(data)


def errors(
    p: FootParams, groups: Sequence[tuple[np.ndarray, Lessons]], options: FootOptions, loss: str = "position"
) -> np.ndarray:
    """The error of every trial."""
    found = np.full(sum(len(rows) for rows, _ in groups), np.nan)
    single = jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), p)
    for rows, made in groups:
        found[rows] = np.asarray(_errors(single, made.data, options, loss))
    return found
