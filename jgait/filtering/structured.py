r"""Predict and update over components, without superfluous operations.

Barriers keep XLA from repeating operations in each loop that uses their results. The field `health` is a float that
is finite if all numbers are finite: a comparison costs almost nothing, while stored bools would split XLA's vector
loops.
"""

import math
from collections.abc import Sequence, Set
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import PyTree

from jgait.filtering.component_model import ComponentModel
from jgait.filtering.components import (
    Matrix,
    barred,
    dot,
    from_upper,
    identity,
    known,
    minus,
    plus,
    product,
    sound,
    symmetric,
    total,
    upper,
    where,
)
from jgait.filtering.covariance_update import Gains, inverse_factor, updated_covariance
from jgait.filtering.tracing import Expansion
from jgait.types import Values

LOG_2PI = math.log(2.0 * math.pi)


class Components(NamedTuple):
    """Mean (k scalars), and covariance of the error about the mean (n × n scalars)."""

    mean: list[PyTree]
    cov: Matrix


class Sample(NamedTuple):
    """One sample."""

    measured: list[PyTree]  #: observation (m scalars).
    control: PyTree  #: control tuple, or None.
    dt: Values  #: interval [s].
    seen: list[PyTree]  #: which components are measured (m bools; True without a mask).


class Noise(NamedTuple):
    """A noise covariance that is the same at every sample; `health` is finite if the matrix is finite."""

    matrix: Matrix
    health: PyTree


class Transition(NamedTuple):
    """A linearised transition."""

    mean: list[PyTree]  #: the predicted state.
    matrix: Matrix  #: A.
    noise: Matrix  #: Q.
    health: PyTree  #: finite where the transition was finite.


class Statistics(NamedTuple):
    """Statistics of an update; see `jgait.filtering.Updated`."""

    innovation: list[PyTree]
    stddev: list[PyTree]
    log_likelihood: PyTree
    nis: PyTree
    count: PyTree
    health: PyTree


def dtype_of(moments: Components) -> PyTree:
    """The float type of a belief."""
    return jnp.result_type(*(value for value in (*moments.mean, *upper(moments.cov)) if not known(value)))


def affine_transition(cm: ComponentModel, before: Components, sample: Sample, noise: Noise | None) -> Transition:
    """The transition linearised at the mean; where it is not finite, the identity without noise replaces it."""
    x, size = before.mean, len(before.cov)
    control, dt = sample.control, sample.dt
    trace = Expansion(dtype_of(before))
    mean, matrix = trace.jacobian(lambda x: cm.transition(x, control, dt), x)
    if noise is None:
        entries = trace.call(lambda x: upper(cm.transition_noise(x, control, dt)), x)
        noise = Noise(from_upper(entries, size), _summary(entries))
    safe = {id(value) for value in (*x, dt)}
    health = plus(_summary((*mean, *(e for row in matrix for e in row)), safe), noise.health)
    health = barred(health)[0]
    good = sound(health)
    matrix = [
        [a if known(a) and a == b else where(good, a, b) for a, b in zip(row, unit, strict=True)]
        for row, unit in zip(matrix, identity(size), strict=True)
    ]
    return Transition(
        [where(good, a, b) for a, b in zip(mean, x, strict=True)],
        barred(matrix)[0],
        symmetric(size, lambda i, j: where(good, noise.matrix[i][j], 0.0)),
        health,
    )


def _summary(values: Sequence[PyTree], safe: Set[int] = frozenset()) -> PyTree:
    """The sum of all distinct unknown values: finite if all are finite; a sum that overflows counts as a failure."""
    unknown = {id(value): value for value in values if not known(value) and id(value) not in safe}
    return total(unknown.values())


def corrected(
    cm: ComponentModel, prior: Components, sample: Sample, noise: Noise | None
) -> tuple[Components, Gains, Statistics]:
    """The belief after a sample, the gains, and the update's statistics."""
    gained = gains(cm, prior, sample, noise)
    delta = [dot(column, gained.white) for column in zip(*gained.white_cross, strict=True)]
    after = Components(
        [plus(a, d) for a, d in zip(prior.mean, delta, strict=True)], updated_covariance(prior.cov, gained, sample.seen)
    )
    return after, gained, _statistics(gained, sample.seen)


def _statistics(g: Gains, observed: list[PyTree]) -> Statistics:
    good = sound(g.health)
    count = total(where(s, 1.0, 0.0) for s in observed)
    nis = dot(g.white, g.white)
    return Statistics(
        [where(good, e, 0.0) for e in g.innovation],
        [where(good, lax.sqrt(g.spread[a][a]), 0.0) for a in range(len(observed))],
        where(good, -0.5 * (nis + g.log_det + count * LOG_2PI), 0.0),
        where(good, nis, 0.0),
        where(good, count, 0.0),
        g.health,
    )


def gains(cm: ComponentModel, prior: Components, sample: Sample, noise: Noise | None) -> Gains:
    """Linearise the observation at the prediction, and factor the innovation's covariance."""
    x, cov = prior
    observed, count = sample.seen, len(sample.measured)
    expected, matrix, innovation = _linearised(cm, prior, sample)
    if noise is None:
        trace = Expansion(dtype_of(prior))
        entries = trace.call(lambda x: upper(cm.observation_noise(x, sample.control)), x)
        noise = Noise(from_upper(entries, count), _summary(entries))
    linear = [all(known(e) for e in row) for row in matrix]
    doubtful = [e for e, straight in zip(expected, linear, strict=True) if not straight]
    summary = plus(_summary((*doubtful, *(e for row in matrix for e in row))), noise.health)
    variance = noise.matrix
    if not known(summary):
        summary = barred(summary)[0]
        usable = sound(summary)
        matrix = [[e if known(e) else where(usable, e, 0.0) for e in row] for row in matrix]
        variance = symmetric(count, lambda a, b: where(usable, noise.matrix[a][b], 1.0 if a == b else 0.0))
    innovation = [where(s, e, 0.0) for s, e in zip(observed, innovation, strict=True)]
    cross = barred(product(matrix, cov))[0]

    def spread_entry(a: int, b: int) -> PyTree:
        entry = plus(dot(cross[a], matrix[b]), variance[a][b])
        if a == b:
            return where(observed[a], entry, 1.0)
        return where(observed[a], where(observed[b], entry, 0.0), 0.0)

    innovation, spread = barred(innovation, symmetric(count, spread_entry))
    inverse, log_det, health = inverse_factor(spread, plus(summary, total(innovation)))
    error = [where(sound(e), e, 0.0) for e in innovation]
    inverse, error = barred(inverse, error)
    masked = [[where(s, e, 0.0) for e in row] for s, row in zip(observed, cross, strict=True)]
    white_cross, white = barred(product(inverse, masked), [dot(row, error) for row in inverse])
    return Gains(matrix, variance, cross, inverse, white_cross, white, innovation, spread, log_det, health)


def _linearised(cm: ComponentModel, prior: Components, sample: Sample) -> tuple[list[PyTree], Matrix, list[PyTree]]:
    """The expected observation at the prediction, its Jacobian, and the innovation."""
    control, x = sample.control, prior.mean
    trace = Expansion(dtype_of(prior))
    if not cm.wrapped:
        expected, matrix = trace.jacobian(lambda x: cm.observation(x, control), x)
        return expected, matrix, [minus(y, e) for y, e in zip(sample.measured, expected, strict=True)]
    expected = trace.call(lambda x: cm.observation(x, control), x)
    matrix = trace.jacobian(lambda x: cm.residual(cm.observation(x, control), expected), x)[1]
    measured = [where(s, y, e) for s, y, e in zip(sample.seen, sample.measured, expected, strict=True)]
    return expected, matrix, trace.call(cm.residual, measured, expected)
