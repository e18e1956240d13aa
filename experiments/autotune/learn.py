"""A fit of the foot estimator to groups of lessons of different lengths, by Adam on the sum of the groups."""

import time
from collections.abc import Sequence
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from jgait import params, tune
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import FootOptions, FootParams
from jgait.tune import Lessons

FREE = (
    "pivot_height", "velocity_noise", "rate_noise", "acc_noise", "gyr_noise", "acc_jump_noise", "gyr_jump_noise",
    "softness", "threshold_factor", "noise",
)  # fmt: skip
"""What is learned; the rest keeps its default."""

STEPS, RATE = 30, 0.15


class Learned(NamedTuple):
    """Parameters, the loss before each step, and the seconds of each step, the first of which compiles."""

    params: FootParams
    losses: list[float]
    seconds: list[float]


@cache
def _programs(options: FootOptions, loss: str) -> tuple[Any, Any, Any]:
    """Start, transforms, and a program (free, lessons, weights) → value and gradient of the weighted sum."""
    estimator = foot_ins.estimator(options)
    free = params.freed(estimator.transforms, *(FREE if options.noise != "constant" else FREE[:-1]))
    objective = tune.objective(estimator, options, loss)

    def total(moved: Any, data: Any, weights: Any) -> Any:
        p = params.constrain(moved, free, estimator.params)
        each = jax.vmap(lambda lesson: objective(p, lesson))(data)
        return jnp.sum(jnp.where(jnp.isfinite(each) & (weights > 0.0), weights * each, 0.0))

    return estimator.params, free, jax.jit(tune.value_and_grad(total, "reverse"))


def fit(
    groups: Sequence[tuple[np.ndarray, Lessons]], weights: np.ndarray, options: FootOptions,
    loss: str = "position_log", steps: int = STEPS,
) -> Learned:  # fmt: skip
    """Fit to the trials with a weight above 0; priors as declared."""
    start, transforms, program = _programs(options, loss)
    priors, count = params.priors(start), float(np.sum(weights))
    moved = jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), params.unconstrain(start, transforms))

    @jax.jit
    def penalty(free: Any) -> Any:
        natural = params.constrain(free, transforms, start)
        leaves = jax.tree.leaves(priors, is_leaf=lambda v: v is None or isinstance(v, params.Prior))
        values = jax.tree.leaves(natural)
        known = [jnp.sum(one.penalty(v)) for one, v in zip(leaves, values, strict=True) if one is not None]
        return sum(known, jnp.zeros((), jnp.float32)).astype(jnp.float32) / count

    optimizer = optax.adam(optax.cosine_decay_schedule(RATE, steps), b1=0.8, b2=0.95)
    state = optimizer.init(moved)
    losses, seconds = [], []
    for _ in range(steps):
        began = time.perf_counter()
        value, slope = jax.value_and_grad(penalty)(moved)
        for rows, made in groups:
            part, more = program(moved, made.data, jnp.asarray(weights[rows] / count, jnp.float32))
            value, slope = value + part, jax.tree.map(jnp.add, slope, more)
        losses.append(float(value))
        step, state = optimizer.update(slope, state)
        moved = optax.apply_updates(moved, step)
        seconds.append(time.perf_counter() - began)
    return Learned(params.constrain(moved, transforms, start), losses, seconds)


@partial(jax.jit, static_argnames=("options", "loss"))
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
