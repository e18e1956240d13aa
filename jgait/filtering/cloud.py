"""A cloud of weighted particles: how it moves, what it weighs, and its moments.

A particle is a state; component i of all of them is one array (N,). The model's functions are mapped over the
particles, and what does not depend on the particle is computed once.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jgait.filtering.component_model import ComponentModel
from jgait.filtering.components import Matrix, all_finite, both, dot, is_zero, known, minus, symmetric, total, where
from jgait.filtering.dense import LOG_2PI
from jgait.filtering.inputs import Inputs
from jgait.filtering.resampling import lowest

FLAT = 16.0
"""Below this share of its variance what is left of a component is rounding [epsilons of the dtype]."""

ROUNDS = 6
"""Steps to the mean on a manifold; each leaves a share of about the particles' variance [rad², for rotations]."""


class Cloud(NamedTuple):
    """Particles.

    Attributes:
        state: k arrays (N,).
        log_weights: (N,), normalised.
    """

    state: tuple[Any, ...]
    log_weights: Any


def root(p: Matrix, dtype: Any) -> tuple[Matrix, Any]:
    """A lower triangle L with L Lᵀ = p for a perhaps singular covariance, and whether p is one up to rounding.

    A component that adds nothing to those before it has a column of zeros, whose gradient is zero.
    """
    size, epsilon = len(p), float(jnp.finfo(dtype).eps)
    lower: Matrix = [[0.0] * size for _ in range(size)]
    sound: Any = True
    for j in range(size):
        pivot = minus(p[j][j], total(_square(entry) for entry in lower[j][:j]))
        floor = FLAT * size * epsilon * p[j][j]
        sound = both(sound, pivot >= -floor)
        if known(pivot) and known(floor):
            length: Any = math.sqrt(pivot) if pivot > floor else 0.0
            inverse: Any = 1.0 / length if length else 0.0
        else:
            there = pivot > floor
            safe = jnp.sqrt(jnp.where(there, pivot, 1.0))
            length, inverse = jnp.where(there, safe, 0.0), jnp.where(there, 1.0 / safe, 0.0)
        lower[j][j] = length
        for i in range(j + 1, size):
            rest = minus(p[i][j], dot(lower[i][:j], lower[j][:j]))
            lower[i][j] = 0.0 if is_zero(rest) or is_zero(inverse) else rest * inverse
    return lower, sound


def _square(value: Any) -> Any:
    return 0.0 if is_zero(value) else value * value


def log_density(error: Sequence[Any], p: Matrix, dtype: Any) -> tuple[Any, Any]:
    """The log-density of N(0, p) at `error` less the constants (2π)^(−½), and whether p is positive."""
    lower: Matrix = [[0.0] * len(p) for _ in p]
    white: list[Any] = []
    value, positive = jnp.zeros((), dtype), jnp.asarray(True)
    for j in range(len(p)):
        pivot = minus(p[j][j], total(_square(entry) for entry in lower[j][:j]))
        above = pivot > 0.0
        positive = positive & above
        length = jnp.sqrt(jnp.where(above, pivot, 1.0).astype(dtype))
        for i in range(j + 1, len(p)):
            rest = minus(p[i][j], dot(lower[i][:j], lower[j][:j]))
            lower[i][j] = 0.0 if is_zero(rest) else rest / length
        white.append(minus(error[j], dot(lower[j][:j], white)) / length)
        value = value - 0.5 * white[j] * white[j] - jnp.log(length)
    return value, positive


def drawn(given: Inputs, key: Any, particles: int) -> Cloud:
    """Particles of the initial belief, equally weighted."""
    lower, _ = root(given.cov, given.dtype)
    shocks = jax.random.normal(key, (len(given.cov), particles), given.dtype)

    def one(shock: Any) -> tuple[Any, ...]:
        x = given.cm.retract(given.mean, [dot(row, list(shock)) for row in lower])
        return tuple(jnp.asarray(value, given.dtype) for value in x)

    uniform = jnp.full((particles,), -math.log(particles), given.dtype)
    return Cloud(jax.vmap(one, in_axes=1)(shocks), uniform)


def moved(given: Inputs, state: tuple[Any, ...], control: Any, dt: Any, key: Any) -> tuple[tuple[Any, ...], Any]:
    """The particles one interval later, and which of them are sound; the others stay where they were."""
    cm, dtype = given.cm, given.dtype
    noisy = _noisy(given, state, control, dt)
    shocks = jax.random.normal(key, (len(noisy), state[0].shape[0]), dtype)

    def one(x: tuple[Any, ...], shock: Any) -> tuple[tuple[Any, ...], Any]:
        lower, sound = root(cm.transition_noise(x, control, dt), dtype)
        step = [dot([row[j] for j in noisy], list(shock)) for row in lower]
        after = cm.retract(cm.transition(x, control, dt), step)
        sound = jnp.asarray(both(sound, all_finite(after)))
        return tuple(jnp.where(sound, jnp.asarray(a, dtype), b) for a, b in zip(after, x, strict=True)), sound

    return jax.vmap(one, in_axes=(0, 1))(state, shocks)


def _noisy(given: Inputs, state: tuple[Any, ...], control: Any, dt: Any) -> list[int]:
    """The columns of the root of the process noise that a trace cannot tell to be zero: the others need no draws."""
    columns: list[int] = []

    def look(x: tuple[Any, ...]) -> None:
        lower, _ = root(given.cm.transition_noise(x, control, dt), given.dtype)
        columns.extend(j for j in range(len(lower)) if not all(is_zero(row[j]) for row in lower))

    jax.eval_shape(look, tuple(jax.ShapeDtypeStruct((), given.dtype) for _ in state))
    return columns


def weighed(given: Inputs, state: tuple[Any, ...], measured: Sequence[Any], control: Any, seen: Sequence[Any]) -> Any:
    """The log-density (N,) of what was measured and seen, given each particle; `lowest` where the numbers break."""
    cm, dtype = given.cm, given.dtype
    count = total(jnp.asarray(there).astype(dtype) for there in seen)

    def one(x: tuple[Any, ...]) -> Any:
        expected = cm.observation(x, control)
        difference = cm.residual([where(s, y, e) for s, y, e in zip(seen, measured, expected, strict=True)], expected)
        error = [where(s, e, 0.0) for s, e in zip(seen, difference, strict=True)]
        noise = cm.observation_noise(x, control)
        noise = symmetric(len(seen), lambda i, j: where(both(seen[i], seen[j]), noise[i][j], 1.0 if i == j else 0.0))
        sound = jnp.asarray(all_finite([*error, *(entry for row in noise for entry in row)]))
        error = [jnp.where(sound, e, 0.0) for e in error]
        noise = symmetric(len(seen), lambda i, j: noise[i][j] if known(noise[i][j]) else
                          jnp.where(sound, noise[i][j], 1.0 if i == j else 0.0))  # fmt: skip
        value, positive = log_density(error, noise, dtype)
        good = sound & positive & jnp.isfinite(value)
        return jnp.where(good, value - 0.5 * count * LOG_2PI, lowest(dtype))

    return jax.vmap(one)(state)


def moments(cm: ComponentModel, state: tuple[Any, ...], weights: Any) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Weighted mean (k scalars) and upper triangle of the covariance of the error about it.

    The mean is where the weighted errors cancel; errors are taken about the heaviest particle first, so that digits
    are not lost far from the origin.
    """
    dtype = weights.dtype

    def errors(reference: Sequence[Any]) -> Any:
        def one(x: tuple[Any, ...]) -> Any:
            return jnp.stack([jnp.asarray(e, dtype) for e in cm.local(reference, x)])

        return jax.vmap(one, out_axes=1)(state)

    heaviest = jnp.argmax(weights)
    mean: list[Any] = [leaf[heaviest] for leaf in state]
    for _ in range(ROUNDS if cm.curved else 1):
        delta = jnp.matmul(errors(mean), weights, precision=lax.Precision.HIGHEST)
        mean = [jnp.asarray(value, dtype) for value in cm.retract(mean, list(delta))]
    error = errors(mean)
    cov = jnp.matmul(error * weights[None, :], error.T, precision=lax.Precision.HIGHEST)
    return tuple(mean), tuple(cov[i, j] for i in range(cov.shape[0]) for j in range(i, cov.shape[0]))
