r"""How a filter replaces a nonlinear function by an affine one: the only place where KF, EKF, UKF and CKF differ.

A function g of the error δ, believed to be δ ~ N(μ, P), is replaced by g(δ) ≈ v + A (δ − μ) + e, e ~ N(0, Ω):

    EKF       v = g(μ), A = ∂g/∂δ at μ (autodiff), Ω = 0
    UKF, CKF  statistical linear regression over sigma points: v their mean, A = Ψᵀ P⁻¹, Ω = Φ − A P Aᵀ
    KF        like the EKF, for functions whose Jacobian does not depend on where it is taken

Sources: S. Särkkä, "Bayesian Filtering and Smoothing" (2013), chapters 5 and 6; Á. García-Fernández et al.,
"Posterior linearization filter", IEEE TSP 63(20), 2015, for the iterated form.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.extend.core import Literal

from jgait.filtering.linear_algebra import backward_substitution, product, scaled_cholesky


class Affine(NamedTuple):
    """v + A (δ − μ) + e: value (m,), matrix (m, n), covariance of e (m, m)."""

    value: Any
    matrix: Any
    spread: Any


class KF(NamedTuple):
    """Kalman filter: for linear models; refuses a model whose Jacobian depends on the state."""

    @property
    def iterations(self) -> int:
        """Updates are not iterated."""
        return 1


class EKF(NamedTuple):
    """Extended Kalman filter; with more than one iteration the update is linearised again at its own result.

    Attributes:
        iterations: how often each update is linearised, always from the same prior.
    """

    iterations: int = 1


class UKF(NamedTuple):
    """Unscented Kalman filter, with 2n + 1 sigma points.

    Attributes:
        alpha: spread of the points.
        beta: 2 suits Gaussians.
        kappa: further spread; None takes 3 − n.
        iterations: as of `EKF` (posterior linearisation).
    """

    alpha: float = 1.0
    beta: float = 0.0
    kappa: float | None = None
    iterations: int = 1


class CKF(NamedTuple):
    """Cubature Kalman filter: 2n equally weighted points.

    Attributes:
        iterations: as of `EKF` (posterior linearisation).
    """

    iterations: int = 1


Method = KF | EKF | UKF | CKF


def IteratedEKF(iterations: int = 3) -> EKF:  # noqa: N802 - reads as the method's name
    """The EKF whose updates are linearised `iterations` times."""
    if iterations < 1:
        raise ValueError(f"iterations must be 1 or more; got {iterations}")
    return EKF(iterations)


def linearise(method: Method, g: Callable[[Any], Any], mean: Any, cov: Any, what: str) -> Affine:
    """Replace g about the mean (n,) by an affine function, after the method.

    Args:
        method: KF, EKF, UKF or CKF.
        g: error vector (n,) → vector (m,).
        mean: (n,) where to linearise.
        cov: (n, n) how far around; the Jacobian methods do not look at it.
        what: name of the function, for messages.

    Raises:
        ValueError: from the KF, if the Jacobian of g depends on where it is taken.
    """
    if isinstance(method, KF | EKF):
        if isinstance(method, KF) and depends_on_place(g, mean):
            raise ValueError(
                f"the KF needs a linear model; the Jacobian of '{what}' depends on the state: use EKF, UKF or CKF"
            )
        value, matrix = _value_and_jacobian(g, mean)
        return Affine(value, matrix, jnp.zeros((value.shape[0],) * 2, value.dtype))
    points, mean_weights, cov_weights = _sigma_points(method, mean.shape[0], mean.dtype)
    d, lower = scaled_cholesky(cov)
    values = jnp.stack([g(mean + d * product(lower, point)) for point in points])
    value = jnp.sum(mean_weights[:, None] * values, axis=0)
    centred = values - value[None, :]
    weighted = cov_weights[:, None] * centred
    # Regress on the unit points first: B = Σ w (g − v) ξᵀ, then A = B (d L)⁻¹ without inverting P.
    regression = product(weighted.T, points)
    scaled = backward_substitution(lower, regression.T).T
    matrix = jnp.where(d > 0.0, scaled / jnp.where(d > 0.0, d, 1.0), 0.0)
    spread = product(weighted.T, centred) - product(regression, regression.T)
    return Affine(value, matrix, spread)


def _value_and_jacobian(g: Callable[[Any], Any], at: Any) -> tuple[Any, Any]:
    value, pushforward = jax.linearize(g, at)
    return value, jax.vmap(pushforward, out_axes=1)(jnp.eye(at.shape[0], dtype=at.dtype))


def _sigma_points(method: Any, size: int, dtype: Any) -> tuple[Any, Any, Any]:
    """Unit points (k, n) and their weights for mean and covariance (k,); Σ w ξ ξᵀ = I."""
    eye = jnp.eye(size, dtype=dtype)
    if isinstance(method, CKF):
        radius = size**0.5
        weights = jnp.full((2 * size,), 0.5 / size, dtype)
        return radius * jnp.concatenate([eye, -eye]), weights, weights
    kappa = 3.0 - size if method.kappa is None else method.kappa
    scale = method.alpha**2 * (size + kappa)
    if scale <= 0.0:
        raise ValueError(f"UKF needs alpha²(n + kappa) > 0; got {scale:g} for n = {size}")
    points = scale**0.5 * jnp.concatenate([jnp.zeros((1, size), dtype), eye, -eye])
    side = 0.5 / scale
    first = 1.0 - size / scale
    mean_weights = jnp.asarray([first] + 2 * size * [side], dtype)
    first_cov = first + 1.0 - method.alpha**2 + method.beta
    return points, mean_weights, jnp.asarray([first_cov] + 2 * size * [side], dtype)


def depends_on_place(g: Callable[[Any], Any], at: Any) -> bool:
    """Whether the Jacobian of g depends on where it is taken, read off the trace of its derivative."""

    def directional(x: Any, tangent: Any) -> Any:
        return jax.jvp(g, (x,), (tangent,))[1]

    closed = jax.make_jaxpr(directional)(at, at)
    return _reaches(closed.jaxpr, {closed.jaxpr.invars[0]})[0]


def _reaches(jaxpr: Any, sources: set[Any]) -> list[bool]:
    """For each output of a jaxpr, whether any of the source variables can influence it."""
    touched = set(sources)
    for equation in jaxpr.eqns:
        inputs = [not isinstance(v, Literal) and v in touched for v in equation.invars]
        if not any(inputs):
            continue
        inner = equation.params.get("jaxpr")
        body = getattr(inner, "jaxpr", inner)
        if body is not None and len(body.invars) == len(inputs) and len(body.outvars) == len(equation.outvars):
            outputs = _reaches(body, {v for v, hit in zip(body.invars, inputs, strict=True) if hit})
        else:
            outputs = [True] * len(equation.outvars)
        touched |= {v for v, hit in zip(equation.outvars, outputs, strict=True) if hit}
    return [not isinstance(v, Literal) and v in touched for v in jaxpr.outvars]
