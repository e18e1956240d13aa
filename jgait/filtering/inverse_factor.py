"""Inverses of Cholesky factors over components."""

from collections.abc import Callable

import jax.numpy as jnp
from jax import lax

from jgait.filtering.components import Matrix, barred, minus, plus, sound, times, total, where
from jgait.types import Values


def inverse_factor(spread: Matrix, summary: Values) -> tuple[Matrix, Values, Values]:
    """L⁻¹ for spread = L Lᵀ, the logarithm of its determinant, and a float that is finite if the factor exists.

    If the factor does not exist, L⁻¹ is zero. A pivot that is not positive is replaced before its square root is
    computed, so that gradients stay finite.
    """
    health = plus(summary, total(spread[j][j] for j in range(len(spread))))
    pivots: list[Values] = []

    def root(pivot: Values, variance: Values) -> Values:
        del variance
        pivots.append(pivot)
        return lax.rsqrt(jnp.where(pivot > 0.0, pivot, 1.0))

    lower, roots = _factor(spread, root)
    for pivot in pivots:
        health = jnp.where(pivot > 0.0, health, jnp.inf)
    log_det = -2.0 * total(jnp.log(value) for value in roots)
    good = sound(health)
    return _inverted(lower, roots, [where(good, value, 0.0) for value in roots]), log_det, health


def _factor(spread: Matrix, root: Callable[[Values, Values], Values]) -> tuple[Matrix, list[Values]]:
    """L below its diagonal, and the reciprocals of the diagonal, from `root(pivot, variance)`."""
    size = len(spread)
    lower: Matrix = [[0.0] * size for _ in range(size)]
    roots: list[Values] = []
    for j in range(size):
        pivot = minus(spread[j][j], total(times(lower[j][k], lower[j][k]) for k in range(j)))
        roots.append(root(pivot, spread[j][j]))
        for i in range(j + 1, size):
            below = minus(spread[i][j], total(times(lower[i][k], lower[j][k]) for k in range(j)))
            lower[i][j] = times(below, roots[j])
        if j % 2 == 1 and j + 1 < size:
            lower, roots = barred(lower, roots)
    return lower, roots


def _inverted(lower: Matrix, roots: list[Values], diagonal: list[Values]) -> Matrix:
    size = len(lower)
    inverse: Matrix = [[0.0] * size for _ in range(size)]
    for j in range(size):
        inverse[j][j] = diagonal[j]
        for i in range(j + 1, size):
            inner = total(times(lower[i][k], inverse[k][j]) for k in range(j, i))
            inverse[i][j] = times(-roots[i], inner)
    return inverse
