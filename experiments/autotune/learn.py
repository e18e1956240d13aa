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

from jgait import filtering, params, tune
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import DEFAULT, TEXTBOOK, FootParams
from jgait.tune import Lessons
from jgait.tune.objective import Term

START = TEXTBOOK._replace(pivot_height=0.02, rate_noise=0.003, acc_jump_noise=0.02, gyr_jump_noise=0.02)
"""The textbook's filter; what it leaves out begins small, for the logarithm of 0 has no gradient."""

FREE = (
    "pivot_height", "velocity_noise", "rate_noise", "acc_noise", "gyr_noise", "acc_jump_noise", "gyr_jump_noise",
)  # fmt: skip
"""What is learned. The place of the reference's marker is solved apart, see `marker`."""

Terms = tuple[tuple[str | Term, float], ...]
"""Losses with their weights."""

SHARE = 0.002
"""[1/nat] Weight of the likelihood beside an error in logarithms. Positions of the feet do not tell, say, by how much
the noise of jolts differs from that of slow motion; the innovations do."""

POSITION: Terms = (("position_log", 1.0), ("likelihood", SHARE))
LIKELIHOOD: Terms = (("likelihood", 1.0),)

STEPS, RATE = 50, 0.15
"""Steps of Adam and the rate of the first, which falls to 0: up to 3.75 units of a logarithm in all. The loss
`POSITION` of all trials changes by less than 0.001 over the last ten steps."""


class Learned(NamedTuple):
    """Parameters, the loss before each step, and each step's seconds, by the clock and of the processors; the first
    compiles."""

    params: FootParams
    losses: list[float]
    seconds: np.ndarray


@cache
def _programs(loss: Terms) -> tuple[Any, Any]:
    """Transforms, and a program (free, start, lessons, weights) → value and gradient of the weighted sum."""
    estimator = foot_ins.estimator()
    transforms = params.freed(estimator.transforms, *FREE)
    objective = tune.objective(estimator, DEFAULT, dict(loss))

    def one(moved: Any, start: Any, lesson: Any) -> Any:
        value = objective(params.constrain(moved, transforms, start), lesson)
        return jnp.where(jnp.isfinite(value), value, 0.0)

    def total(moved: Any, start: Any, data: Any, weights: Any) -> Any:
        """One lesson after another, so that one lesson's trajectories are in memory; those of weight 0 do not run."""
        each = jax.value_and_grad(one)
        nothing = jax.tree.map(jnp.zeros_like, (jnp.zeros((), jnp.float32), moved))

        def of(item: Any) -> Any:
            lesson, weight = item
            found = jax.lax.cond(weight > 0.0, lambda: each(moved, start, lesson), lambda: nothing)
            return jax.tree.map(lambda v: weight * v, found)

        return jax.tree.map(lambda v: jnp.sum(v, axis=0), jax.lax.map(of, (data, weights)))

    return transforms, filtering.compiled(total)


def fit(
    groups: Sequence[tuple[np.ndarray, Lessons]], weights: np.ndarray, loss: Terms = POSITION, steps: int = STEPS
) -> Learned:
    """Fit the parameters `FREE` from `START` on to the trials with a weight above 0, with the declared priors."""
    transforms, program = _programs(loss)
    start = jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), START)
    moved, count = params.unconstrain(start, transforms), float(np.sum(weights))
    priors = params.priors(FootParams())

    @jax.jit
    @jax.value_and_grad
    def prior(moved: Any) -> Any:
        """Minus the logarithm of the declared priors' density; they count once for all trials."""
        natural = params.constrain(moved, transforms, start)
        told = [getattr(priors, name).penalty(getattr(natural, name)) for name in FREE if getattr(priors, name)]
        return sum(told[1:], told[0]) / count

    optimizer = optax.adam(optax.cosine_decay_schedule(RATE, steps), b1=0.8, b2=0.95)
    state = optimizer.init(moved)
    losses, seconds, pool = [], [], ThreadPoolExecutor(len(groups))
    weighted = [(made.data, jnp.asarray(weights[rows] / count, jnp.float32)) for rows, made in groups]
    for _ in range(steps):
        began = np.array([time.perf_counter(), time.process_time()])
        apply = pool.map if losses else map  # the first step compiles
        parts = list(apply(lambda group, at=moved: jax.block_until_ready(program(at, start, *group)), weighted))
        value, slope = jax.tree.map(lambda *v: sum(v[1:], v[0]), prior(moved), *parts)
        losses.append(float(value))
        step, state = optimizer.update(slope, state)
        moved = optax.apply_updates(moved, step)
        seconds.append(np.array([time.perf_counter(), time.process_time()]) - began)
    return Learned(params.constrain(moved, transforms, start), losses, np.stack(seconds))
