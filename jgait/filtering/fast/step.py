r"""Predict and update over components, without superfluous operations.

Barriers keep XLA from repeating operations in each loop that uses their results. The field `health` is a float that
is finite if all numbers are finite: a comparison costs almost nothing, while stored bools would split XLA's vector
loops.
"""

import math
from collections.abc import Sequence, Set
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.typing import DTypeLike
from jaxtyping import Array

from jgait.filtering.covariance import Entries, Scalar
from jgait.filtering.fast.components import (
    Flag,
    Matrix,
    barred,
    congruence,
    dot,
    from_upper,
    identity,
    known,
    minus,
    plus,
    product,
    sound,
    symmetric,
    times,
    total,
    transposed,
    upper,
    where,
)
from jgait.filtering.fast.tracing import Expansion
from jgait.filtering.linear import Leaves, Shape

LOG_2PI = math.log(2.0 * math.pi)


class Components(NamedTuple):
    """Mean (k scalars), and covariance of the error about the mean (n × n scalars)."""

    mean: list[Scalar]
    cov: Matrix


class Reading(NamedTuple):
    """One sample."""

    measured: list[Scalar]  #: observation (m scalars).
    control: list[Array]  #: components of the control.
    dt: Scalar  #: interval [s].
    visible: list[Flag]  #: which components are measured (m bools; True without a mask).


class Gains(NamedTuple):
    """The terms of an update, whitened by the innovation's factor L, S = L Lᵀ; zero where masked or not finite."""

    matrix: Matrix  #: H without the mask (m × n).
    noise: Matrix  #: R (m × m).
    cross: Matrix  #: H P⁻ without the mask (m × n).
    inverse: Matrix  #: L⁻¹, lower triangle.
    white_cross: Matrix  #: L⁻¹ H P⁻ (m × n).
    white: list[Scalar]  #: L⁻¹ (y − ŷ) (m).
    innovation: list[Scalar]  #: y − ŷ (m), 0 where masked.
    spread: Matrix  #: S (m × m), 1 on the diagonal where masked.
    log_det: Scalar  #: logarithm of the determinant of S.
    health: Scalar  #: finite where all numbers are and S could be factored; elsewhere the belief is left unchanged.


def triangle(entries: Entries, size: int, dtype: DTypeLike) -> list[Scalar]:
    """The upper triangle of a noise matrix; numbers are known."""
    values = (entries.get((i, j), 0.0) for i in range(size) for j in range(i, size))
    return [float(v) if isinstance(v, int | float) else jnp.asarray(v, dtype) for v in values]


def advanced(shape: Shape, params: Leaves, before: Components, sample: Reading) -> tuple[dict[str, Any], Matrix, Gains]:
    """Predict, then update: fields of `Posterior` (covariances as upper triangles), A, and the terms of the update."""
    prior, matrix, health = predicted(shape, params, before, sample)
    g = gains(shape, params, prior, sample)
    moves = [dot(column, g.white) for column in transposed(g.white_cross)]
    good, nis, count = sound(g.health), dot(g.white, g.white), total(where(s, 1.0, 0.0) for s in sample.visible)
    statistics = {
        "innovation": g.innovation,
        "innovation_stddev": [lax.sqrt(row[a]) for a, row in enumerate(g.spread)],
        "log_likelihood": -0.5 * (nis + g.log_det + count * LOG_2PI),
        "nis": nis,
        "count": count,
    }
    fields = {
        "mean": [plus(a, d) for a, d in zip(prior.mean, moves, strict=True)],
        "cov": upper(_joseph(prior.cov, g)),
        "valid": sound(plus(g.health, health)),
        **jax.tree.map(lambda value: where(good, value, 0.0), statistics),
    }
    return fields, matrix, g


def predicted(shape: Shape, params: Leaves, before: Components, sample: Reading) -> tuple[Components, Matrix, Scalar]:
    """The prediction, A, and a float that is finite where the transition was.

    The transition is linearised at the mean; where it is not finite, the identity without noise replaces it.
    """
    x, size = before.mean, len(before.cov)
    control, dt = sample.control, sample.dt
    trace = Expansion(shape.dtype)
    moved, slopes = trace.jacobian(lambda x: shape.transition(params, (control, dt), x), x)
    entries = trace.call(lambda x: triangle(shape.transition_noise(params, (control, dt), x), size, shape.dtype), x)
    safe = {id(value) for value in (*x, dt)}
    health = barred(plus(_summary((*moved, *(e for row in slopes for e in row)), safe), _summary(entries)))
    good = sound(health)
    pairs = zip(slopes, identity(size), strict=True)
    matrix = barred([[where(good, a, b) for a, b in zip(row, unit, strict=True)] for row, unit in pairs])
    mean = [where(good, a, b) for a, b in zip(moved, x, strict=True)]
    noise = from_upper([where(good, e, 0.0) for e in entries], size)
    spread = congruence(matrix, before.cov)
    return Components(mean, symmetric(size, lambda i, j: plus(spread[i][j], noise[i][j]))), matrix, health


def _summary(values: Sequence[Scalar], safe: Set[int] = frozenset()) -> Scalar:
    """The sum of all distinct unknown values: finite if all are finite; a sum that overflows counts as a failure."""
    return total({id(value): value for value in values if not known(value) and id(value) not in safe}.values())


def gains(shape: Shape, params: Leaves, prior: Components, sample: Reading) -> Gains:
    """Linearise the observation at the prediction, and factor the innovation's covariance."""
    visible, count = sample.visible, len(sample.measured)
    expected, matrix, innovation = _linearised(shape, params, prior, sample)
    trace = Expansion(shape.dtype)
    entries = trace.call(
        lambda x: triangle(shape.observation_noise(params, sample.control, x), count, shape.dtype),
        prior.mean,
    )
    # What is not seen tells nothing, even where it is not finite.
    matrix = [[e if known(e) else where(s, e, 0.0) for e in row] for s, row in zip(visible, matrix, strict=True)]
    both = symmetric(count, lambda a, b: visible[a] if a == b else visible[a] & visible[b])
    noise, unit = from_upper(entries, count), identity(count)
    shown = symmetric(count, lambda a, b: where(both[a][b], noise[a][b], unit[a][b]))
    curved = [where(s, e, 0.0) for s, e, row in zip(visible, expected, matrix, strict=True) if not all(map(known, row))]
    summary = barred(_summary((*curved, *(e for row in matrix for e in row), *upper(shown))))
    usable = sound(summary)
    matrix = [[e if known(e) else where(usable, e, 0.0) for e in row] for row in matrix]
    noise = symmetric(count, lambda a, b: where(usable, shown[a][b], unit[a][b]))
    innovation = [where(s, e, 0.0) for s, e in zip(visible, innovation, strict=True)]
    cross = barred(product(matrix, prior.cov))

    def spread_entry(a: int, b: int) -> Scalar:
        return where(both[a][b], plus(dot(cross[a], matrix[b]), noise[a][b]), unit[a][b])

    innovation, spread = barred((innovation, symmetric(count, spread_entry)))
    inverse, log_det, health = inverse_factor(spread, plus(summary, total(innovation)))
    inverse, error = barred((inverse, [where(sound(e), e, 0.0) for e in innovation]))
    white_cross, white = barred((product(inverse, _masked(visible, cross)), [dot(row, error) for row in inverse]))
    return Gains(matrix, noise, cross, inverse, white_cross, white, innovation, spread, log_det, health)


def _masked(visible: list[Flag], rows: Matrix) -> Matrix:
    """Rows that are zero where they are not seen."""
    return [[where(s, e, 0.0) for e in row] for s, row in zip(visible, rows, strict=True)]


def _linearised(
    shape: Shape, params: Leaves, prior: Components, sample: Reading
) -> tuple[list[Scalar], Matrix, list[Scalar]]:
    """The expected observation at the prediction, its Jacobian, and the innovation."""
    control, x = sample.control, prior.mean
    trace = Expansion(shape.dtype)
    if shape.model.residual is None:
        expected, matrix = trace.jacobian(lambda x: shape.observation(params, control, x), x)
        return expected, matrix, [minus(y, e) for y, e in zip(sample.measured, expected, strict=True)]
    expected = trace.call(lambda x: shape.observation(params, control, x), x)

    def shift(shown: Sequence[Scalar], reference: Sequence[Scalar]) -> list[Array]:
        return shape.residual(shape.arrays(shown), shape.arrays(reference))

    matrix = trace.jacobian(lambda x: shift(shape.observation(params, control, x), expected), x)[1]
    measured = [where(s, y, e) for s, y, e in zip(sample.visible, sample.measured, expected, strict=True)]
    return expected, matrix, trace.call(shift, measured, expected)


def inverse_factor(spread: Matrix, summary: Scalar) -> tuple[Matrix, Scalar, Scalar]:
    """L⁻¹ for spread = L Lᵀ, the logarithm of its determinant, and a float that is finite if the factor exists.

    If the factor does not exist, L⁻¹ is zero. A pivot that is not positive is replaced before its square root is
    computed, so that gradients stay finite.
    """
    size = len(spread)
    health = plus(summary, total(spread[j][j] for j in range(size)))
    lower: Matrix = [[0.0] * size for _ in range(size)]  # L below its diagonal
    roots: list[Scalar] = []  # reciprocals of the diagonal
    for j in range(size):
        pivot = minus(spread[j][j], dot(lower[j][:j], lower[j][:j]))
        roots.append(lax.rsqrt(jnp.where(pivot > 0.0, pivot, 1.0)))
        health = jnp.where(pivot > 0.0, health, jnp.inf)
        for i in range(j + 1, size):
            lower[i][j] = times(minus(spread[i][j], dot(lower[i][:j], lower[j][:j])), roots[j])
        if j % 2 == 1 and j + 1 < size:
            lower, roots = barred((lower, roots))
    log_det = -2.0 * total(jnp.log(value) for value in roots)
    good = sound(health)
    inverse: Matrix = [[0.0] * size for _ in range(size)]
    for j in range(size):
        inverse[j][j] = where(good, roots[j], 0.0)
        for i in range(j + 1, size):
            inner = total(times(lower[i][k], inverse[k][j]) for k in range(j, i))
            inverse[i][j] = times(-roots[i], inner)
    return inverse, log_det, health


def _joseph(cov: Matrix, g: Gains) -> Matrix:
    """(I − K H) P (I − K H)ᵀ + K R Kᵀ."""
    gain = barred(product(transposed(g.white_cross), g.inverse))
    pairs = zip(identity(len(cov)), product(gain, g.matrix), strict=True)
    left = barred([[minus(a, e) for a, e in zip(unit, row, strict=True)] for unit, row in pairs])
    half = barred(product(left, cov))
    noisy = product(gain, g.noise)
    return symmetric(len(cov), lambda i, j: plus(dot(half[i], left[j]), dot(noisy[i], gain[j])))
