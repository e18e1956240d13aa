r"""Statistical linear regression of a model's functions over sigma points, for UKF and CKF; one recording.

A function g of the error δ ~ N(μ, P) is replaced by g(δ) ≈ v + A (δ − μ) + e, e ~ N(0, Ω), over sigma points
μ ± c L ξ_i with L Lᵀ = P: v is the mean of the values, A = B L⁻¹, and Ω = Φ − A P Aᵀ the covariance of the residual.

Sources: S. Särkkä, "Bayesian Filtering and Smoothing" (2013), chapters 5 and 6; Á. García-Fernández et al.,
"Posterior linearization filter", IEEE TSP 63(20), 2015, for the iterated form.
"""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jgait.filtering.methods import CKF, UKF
from jgait.filtering.model import Shape

SIGMA_JITTER = 100.0
"""Least pivot of the correlation matrix from which sigma points are computed [epsilons of the dtype]."""

type Components = list[Float[Array, ""]]
type Function = Callable[[Components], Components]


def regressed_transition(
    shape: Shape, method: UKF | CKF, moved: Function, x: Components, delta: Components, P: Array
) -> tuple[Array, Array, Components, Components]:
    """A, Ω, x ⊕ δ and x⁻, as `Linear.transition`; errors are about x⁻, which v moves."""
    before, turned = shape.retract(x, delta), _turn(shape, x, jnp.stack(delta))
    after = moved(before)

    def g(e: Array) -> Array:
        return jnp.stack(shape.local(after, moved(shape.retract(before, list(e)))))

    value, matrix, spread = regression(method, g, jnp.zeros_like(P[0]), turned @ P @ turned.T)
    turn = _turn(shape, after, value)
    return turn @ matrix @ turned, turn @ spread @ turn.T, before, shape.retract(after, list(value))


def regressed_observation(
    shape: Shape, method: UKF | CKF, shown: Function, x: Components, at: Components, P: Array
) -> tuple[Array, Components, Array, Array]:
    """H, h(x ⊕ at), v beyond it, and Ω, about the error `at` with the covariance P."""
    expected = shown(shape.retract(x, at))

    def g(e: Array) -> Array:
        # The difference from the prediction at `at` keeps wrapped angles small.
        return jnp.stack(shape.residual(shown(shape.retract(x, list(e))), expected))

    value, matrix, spread = regression(method, g, jnp.stack(at), P)
    return matrix, expected, value, spread


def _turn(shape: Shape, x: list[Array], delta: Array) -> Array:
    """(n, n) from errors δ + e about x to errors about x ⊕ δ."""
    if not shape.curved:
        return jnp.eye(len(delta), dtype=delta.dtype)
    at = shape.retract(x, list(delta))
    return jax.jacfwd(lambda d: jnp.stack(shape.local(at, shape.retract(x, list(d)))))(delta)


def regression(method: UKF | CKF, g: Callable[[Array], Array], mean: Array, cov: Array) -> tuple[Array, Array, Array]:
    """The value v (m,), A (m, n) and Ω (m, m), over the points μ ± c (d L) ξ_i of a covariance d L Lᵀ d.

    With the pairs' half differences h_i and half second differences s_i the sums over the points become
    v = g(μ) + Σ s_i / c², B = [h_1 … h_n] / c and Ω = Σ s_i s_iᵀ / c² + q e eᵀ with e = v − g(μ): the affine part of
    g is cancelled in the formula, so that no large numbers cancel in floating point.
    """
    square, q = _scaling(method, mean.shape[0])
    radius = math.sqrt(square)
    d, inverse, lower = _scaled_cholesky(cov)
    offsets = radius * (d[:, None] * lower).T
    values = jax.vmap(g)(jnp.concatenate([mean[None, :], mean[None, :] + offsets, mean[None, :] - offsets]))
    centre, (ahead, behind) = values[0], jnp.split(values[1:], 2)
    half, second = 0.5 * (ahead - behind), 0.5 * (ahead + behind) - centre[None, :]
    excess = jnp.sum(second, axis=0) / square
    matrix = _backward_substitution(lower, half / radius).T * inverse[None, :]
    spread = jnp.sum(second[:, :, None] * second[:, None], axis=0) / square + q * (excess[:, None] * excess[None, :])
    return centre + excess, matrix, spread


def _scaled_cholesky(cov: Array) -> tuple[Array, Array, Array]:
    """Standard deviations d (n,), their inverse, and the factor L of the correlation matrix: cov ≈ d (L Lᵀ) d.

    Components that are known exactly (variance 0) have d = 1/d = 0 and a unit row in L. If components are perfectly
    correlated, a pivot is zero up to rounding and is replaced. Without library calls, so that XLA fuses it into a scan.
    """
    variance, size = jnp.diagonal(cov), cov.shape[0]
    known = variance <= 0.0
    d = jnp.sqrt(jnp.where(known, 1.0, variance))
    inverse = jnp.where(known, 0.0, 1.0 / d)
    correlation = jnp.where(jnp.eye(size, dtype=bool), 1.0, cov * inverse[:, None] * inverse[None, :])
    floor = SIGMA_JITTER * float(jnp.finfo(cov.dtype).eps)
    rows, columns = jnp.arange(size), list[Array]()
    for j in range(size):
        column = correlation[:, j]
        for before in columns:
            column = column - before * before[j]
        root = jnp.sqrt(jnp.where(column[j] > floor, column[j], floor))
        columns.append(jnp.where(rows > j, column / root, jnp.where(rows == j, root, 0.0)))
    return jnp.where(known, 0.0, d), inverse, jnp.stack(columns, axis=1)


def _backward_substitution(lower: Array, b: Array) -> Array:
    """Solve Lᵀ x = b for L (n, n) and b (n, k)."""
    rows: list[Array] = []  # the last first
    for i in reversed(range(lower.shape[0])):
        value = b[i]
        for k, row in zip(range(lower.shape[0] - len(rows), lower.shape[0]), reversed(rows), strict=True):
            value = value - lower[k, i] * row
        rows.append(value / lower[i, i])
    return jnp.stack(rows[::-1])


def _scaling(method: UKF | CKF, size: int) -> tuple[float, float]:
    """c² = n + λ, and the weight of e eᵀ in Ω: W₀ᶜ + n / c² − 2, which is β − α² (−1 for the CKF)."""
    if isinstance(method, CKF):
        return float(size), -1.0
    square = method.alpha**2 * (size + method.kappa)
    if not square > 0.0:
        raise ValueError(f"UKF needs kappa > −n; got kappa={method.kappa!r} for n={size} error components")
    return square, method.beta - method.alpha**2
