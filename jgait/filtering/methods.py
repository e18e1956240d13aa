r"""The affine approximation of nonlinear functions: the only difference between KF, EKF, UKF and CKF.

A function g of the error δ ~ N(μ, P) is replaced by g(δ) ≈ v + A (δ − μ) + e, e ~ N(0, Ω):

    EKF       v = g(μ), A = ∂g/∂δ at μ (autodiff), Ω = 0
    UKF, CKF  statistical linear regression over sigma points μ ± c L ξ_i, L Lᵀ = P: v their mean, A = B L⁻¹, and
              Ω = Φ − A P Aᵀ, the covariance of the regression's residual
    KF        like the EKF, for functions whose Jacobian does not depend on δ

Sources: S. Särkkä, "Bayesian Filtering and Smoothing" (2013), chapters 5 and 6; Á. García-Fernández et al.,
"Posterior linearization filter", IEEE TSP 63(20), 2015, for the iterated form.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jax.extend.core import Literal
from jaxtyping import PyTree

SIGMA_JITTER = 100.0
"""Least pivot of the correlation matrix from which sigma points are computed [epsilons of the dtype]."""


class Affine(NamedTuple):
    """v + A (δ − μ) + e: value (m,), matrix (m, n), covariance of e (m, m)."""

    value: PyTree
    matrix: PyTree
    spread: PyTree


# The methods are frozen dataclasses, not tuples: EKF(1) and CKF(1) would be equal as tuples, and jit, which compares
# static arguments to find a compiled function, would use the wrong one.
@dataclass(frozen=True)
class KF:
    """Kalman filter: for linear models; raises for a model whose Jacobian depends on the state."""

    iterations: ClassVar[int] = 1


class _Iterated:
    """A method whose updates may be iterated."""

    iterations: int

    def __post_init__(self) -> None:
        _check_whole("iterations", self.iterations, 1)


@dataclass(frozen=True)
class EKF(_Iterated):
    """Extended Kalman filter; with more than one iteration the update is linearised again at its result.

    Attributes:
        iterations: number of linearisations of each update; every iteration updates the same prior.
    """

    iterations: int = 1


@dataclass(frozen=True)
class UKF(_Iterated):
    """Unscented Kalman filter: 2n + 1 sigma points at √(α² (n + κ)) standard deviations.

    The defaults have no negative weights and give the exact variance of a quadratic function of one Gaussian variable.

    Attributes:
        alpha: spread of the points; a small spread increases rounding errors: differences are divided by its square.
        beta: weight of the central point in the covariance; 2 suits Gaussian distributions.
        kappa: additional spread of the points.
        iterations: as in `EKF` (posterior linearisation).
    """

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0
    iterations: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.alpha > 0.0 or not math.isfinite(self.alpha):
            raise ValueError(f"UKF needs alpha > 0; got {self.alpha!r}")


@dataclass(frozen=True)
class CKF(_Iterated):
    """Cubature Kalman filter: 2n equally weighted points at √n standard deviations.

    Attributes:
        iterations: as in `EKF` (posterior linearisation).
    """

    iterations: int = 1


@dataclass(frozen=True)
class IteratedSmoother:
    """For `kalman_smoother`: the EKF with its smoother, then passes that linearise again at the smoothed trajectory.

    Attributes:
        passes: number of passes, with the first; their limit is the most probable trajectory.
    """

    passes: int = 3

    def __post_init__(self) -> None:
        _check_whole("passes", self.passes, 2)


Method = KF | EKF | UKF | CKF


def IteratedEKF(iterations: int = 3) -> EKF:  # noqa: N802 - named like the method
    """The EKF whose updates are linearised `iterations` times."""
    return EKF(iterations)


def _check_whole(name: str, value: PyTree, least: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise ValueError(f"{name} must be a whole number from {least} up; got {value!r}")


def linearise(method: Method, g: Callable[[PyTree], PyTree], mean: PyTree, cov: PyTree) -> Affine:
    """Replace g near the mean (n,) by an affine function, as the method defines.

    Args:
        method: EKF, UKF or CKF.
        g: error vector (n,) → vector (m,).
        mean: (n,) error at which g is linearised.
        cov: (n, n) covariance of the error; the EKF does not use it.
    """
    if isinstance(method, UKF | CKF):
        return _regression(method, g, mean, cov)
    value, pushforward = jax.linearize(g, mean)
    matrix = jax.vmap(pushforward, out_axes=1)(jnp.eye(mean.shape[0], dtype=mean.dtype))
    return Affine(value, matrix, jnp.zeros((value.shape[0],) * 2, value.dtype))


def _regression(method: UKF | CKF, g: Callable[[PyTree], PyTree], mean: PyTree, cov: PyTree) -> Affine:
    """Statistical linear regression over the points μ ± c (d L) ξ_i of a covariance d L Lᵀ d.

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
    return Affine(centre + excess, matrix, spread)


def _scaled_cholesky(cov: PyTree) -> tuple[PyTree, PyTree, PyTree]:
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
    rows, columns = jnp.arange(size), list[PyTree]()
    for j in range(size):
        column = correlation[:, j]
        for before in columns:
            column = column - before * before[j]
        root = jnp.sqrt(jnp.where(column[j] > floor, column[j], floor))
        columns.append(jnp.where(rows > j, column / root, jnp.where(rows == j, root, 0.0)))
    return jnp.where(known, 0.0, d), inverse, jnp.stack(columns, axis=1)


def _backward_substitution(lower: PyTree, b: PyTree) -> PyTree:
    """Solve Lᵀ x = b for L (n, n) and b (n, k)."""
    rows: list[PyTree] = []  # the last first
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


def depends_on_place(g: Callable[[PyTree], PyTree], at: PyTree) -> bool:
    """Whether the Jacobian of g depends on g's argument, determined from the trace of the derivative."""

    def directional(x: PyTree, tangent: PyTree) -> PyTree:
        return jax.jvp(g, (x,), (tangent,))[1]

    closed = jax.make_jaxpr(directional)(at, at)
    return any(reached(closed.jaxpr, {closed.jaxpr.invars[0]}))


def reached(jaxpr: PyTree, sources: set[PyTree]) -> list[bool]:
    """For each output of a jaxpr, whether any of the source variables can influence it.

    Called functions are analysed too; in a loop or branch every input counts as an influence on every output.
    """
    touched = set(sources)
    for equation in jaxpr.eqns:
        inputs = [not isinstance(v, Literal) and v in touched for v in equation.invars]
        if not any(inputs):
            continue
        body = _called(equation)
        if body is not None:
            outputs = reached(body, {v for v, hit in zip(body.invars, inputs, strict=True) if hit})
        else:
            outputs = [True] * len(equation.outvars)
        touched |= {v for v, hit in zip(equation.outvars, outputs, strict=True) if hit}
    return [not isinstance(v, Literal) and v in touched for v in jaxpr.outvars]


def _called(equation: PyTree) -> PyTree:
    """The jaxpr that an equation calls once with the equation's inputs, or None."""
    if equation.primitive.name in ("scan", "while", "cond"):
        return None
    inner = equation.params.get("jaxpr", equation.params.get("call_jaxpr"))
    body = getattr(inner, "jaxpr", inner)
    if body is None or len(body.invars) != len(equation.invars) or len(body.outvars) != len(equation.outvars):
        return None
    return body
