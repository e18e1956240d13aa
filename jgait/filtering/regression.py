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
from jax import lax
from jaxtyping import Array

from jgait.filtering.methods import CKF, UKF


def regression(method: UKF | CKF, g: Callable[[Array], Array], mean: Array, cov: Array) -> tuple[Array, Array, Array]:
    """The value v (m,), A (m, n) and Ω (m, m), over the points μ ± c (d L) ξ_i of a covariance d L Lᵀ d.

    With the pairs' half differences h_i and half second differences s_i the sums over the points become
    v = g(μ) + Σ s_i / c², B = [h_1 … h_n] / c and Ω = Σ s_i s_iᵀ / c² + q e eᵀ with e = v − g(μ): the affine part of
    g is cancelled in the formula, so that no large numbers cancel in floating point.
    """
    square, q = _scaling(method, mean.shape[0])
    radius = math.sqrt(square)
    variance = jnp.diagonal(cov)
    known = variance <= 0.0  # exactly: it has no offsets, and no column in A
    d = jnp.sqrt(jnp.where(known, 1.0, variance))
    inverse = jnp.where(known, 0.0, 1.0 / d)
    # of perfectly correlated components a pivot would be zero up to rounding
    unit = 1.0 + 100.0 * float(jnp.finfo(cov.dtype).eps)
    correlation = jnp.where(jnp.eye(len(cov), dtype=bool), unit, cov * inverse[:, None] * inverse[None, :])
    lower = jnp.linalg.cholesky(correlation, symmetrize_input=False)
    offsets = radius * (jnp.where(known, 0.0, d)[:, None] * lower).T
    values = jax.vmap(g)(jnp.concatenate([mean[None, :], mean[None, :] + offsets, mean[None, :] - offsets]))
    centre, (ahead, behind) = values[0], jnp.split(values[1:], 2)
    half, second = 0.5 * (ahead - behind), 0.5 * (ahead + behind) - centre[None, :]
    excess = jnp.sum(second, axis=0) / square
    solved = lax.linalg.triangular_solve(lower, half / radius, left_side=True, lower=True, transpose_a=True)
    matrix = solved.T * inverse[None, :]
    spread = jnp.sum(second[:, :, None] * second[:, None], axis=0) / square + q * (excess[:, None] * excess[None, :])
    return centre + excess, matrix, spread


def _scaling(method: UKF | CKF, size: int) -> tuple[float, float]:
    """c² = n + λ, and the weight of e eᵀ in Ω: W₀ᶜ + n / c² − 2, which is β − α² (−1 for the CKF)."""
    if isinstance(method, CKF):
        return float(size), -1.0
    square = method.alpha**2 * (size + method.kappa)
    if not square > 0.0:
        raise ValueError(f"UKF needs kappa > −n; got kappa={method.kappa!r} for n={size} error components")
    return square, method.beta - method.alpha**2
