r"""The methods: how a filter replaces the nonlinear functions of a model by affine ones.

EKF       the Jacobian at the mean, by autodiff
UKF, CKF  statistical linear regression over sigma points
KF        like the EKF, for functions whose Jacobian does not depend on the state

`iterations` is the number of linearisations of each update; every iteration updates the same prior, of UKF and CKF by
posterior linearisation. `derivative` says how JAX differentiates the filter first: "reverse" for `jax.grad` and for
`jax.jvp` of a gradient, in closed form where there is one; "forward" for `jax.jvp` and `jax.jacfwd` alone.

Sources: S. Särkkä, "Bayesian Filtering and Smoothing" (2013), chapters 5 and 6; Á. García-Fernández et al.,
"Posterior linearization filter", IEEE TSP 63(20), 2015, for the iterated form.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

Derivative = Literal["reverse", "forward"]


class _Method:
    """What the methods share; raises ValueError for options that are none."""

    derivative: Derivative

    def __post_init__(self) -> None:
        number: object = getattr(self, "iterations", 1)
        if not isinstance(number, int) or isinstance(number, bool) or number < 1:
            raise ValueError(f"iterations must be a whole number from 1 up; got {number!r}")
        if self.derivative not in ("reverse", "forward"):
            raise ValueError(f"derivative must be 'reverse' or 'forward'; got {self.derivative!r}")
        if not 0.0 < (alpha := getattr(self, "alpha", 1.0)) < math.inf:
            raise ValueError(f"UKF needs alpha > 0; got {alpha!r}")


# The methods are frozen dataclasses: jit needs static arguments with a hash, and a tuple could not check its fields.
@dataclass(frozen=True)
class KF(_Method):
    """Kalman filter: for linear models; raises for a model whose Jacobian depends on the state."""

    iterations: ClassVar[int] = 1
    derivative: Derivative = "reverse"


@dataclass(frozen=True)
class EKF(_Method):
    """Extended Kalman filter; with more than one iteration the update is linearised again at its result."""

    iterations: int = 1
    derivative: Derivative = "reverse"


@dataclass(frozen=True)
class UKF(_Method):
    """Unscented Kalman filter: 2n + 1 sigma points at √(α² (n + κ)) standard deviations.

    The defaults have no negative weights and give the exact variance of a quadratic function of one Gaussian variable.
    """

    #: spread of the points; a small spread increases rounding errors: differences are divided by its square.
    alpha: float = 1.0
    beta: float = 2.0  #: weight of the central point in the covariance; 2 suits Gaussian distributions.
    kappa: float = 0.0  #: additional spread of the points.
    iterations: int = 1
    derivative: Derivative = "reverse"


Method = KF | EKF | UKF


def IteratedEKF(iterations: int = 3) -> EKF:  # noqa: N802 - named like the method
    """The EKF whose updates are linearised `iterations` times."""
    return EKF(iterations)


def CKF(iterations: int = 1, derivative: Derivative = "reverse") -> UKF:  # noqa: N802 - named like the method
    """Cubature Kalman filter: 2n equally weighted points at √n standard deviations, the UKF without a central one."""
    return UKF(1.0, 0.0, 0.0, iterations, derivative)


def regression(method: UKF, g: Callable[[Array], Array], mean: Array, cov: Array) -> tuple[Array, Array, Array]:
    """Statistical linear regression of g over sigma points μ ± c (d L) ξ_i of N(μ, P), P = d L Lᵀ d; one recording.

    Returns v (m,), A (m, n) and Ω (m, m) with which g(δ) ≈ v + A (δ − μ) + N(0, Ω): v is the mean of the values,
    A = B (d L)⁻¹, and Ω = Φ − A P Aᵀ the covariance of the residual. With the pairs' half differences h_i and half
    second differences s_i the sums over the points become
    v = g(μ) + Σ s_i / c², B = [h_1 … h_n] / c and Ω = Σ s_i s_iᵀ / c² + q e eᵀ with e = v − g(μ): the affine part of
    g is cancelled in the formula, so that no large numbers cancel in floating point.
    """
    size, q = mean.shape[0], method.beta - method.alpha**2  # q = W₀ᶜ + n / c² − 2, and c² = n + λ
    if not (square := method.alpha**2 * (size + method.kappa)) > 0.0:
        raise ValueError(f"UKF needs kappa > −n; got kappa={method.kappa!r} for n={size} error components")
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
