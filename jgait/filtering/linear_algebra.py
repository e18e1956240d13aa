"""Small dense products and solves in a form that XLA fuses into the scan, without library calls."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jgait.types import AnyArray


def product(a: Float[AnyArray, "row inner"], b: Float[AnyArray, "inner *column"]) -> Float[Array, "row *column"]:
    """Matrix product, or matrix times vector."""
    if b.ndim == 1:
        return jnp.sum(a * b[None, :], axis=1)
    return jnp.sum(a[:, :, None] * b[None, :, :], axis=1)


def cholesky(a: Float[AnyArray, "n n"], floor: float = 0.0) -> tuple[Float[Array, "n n"], Bool[Array, ""]]:
    """The lower triangle L with L Lᵀ = a, and whether every pivot was above the floor.

    A pivot not above the floor is replaced (by the floor, or by 1 if the floor is 0), so that the factor and its
    gradient are never NaN; the caller decides whether to use such a factor.
    """
    size = a.shape[0]
    rows = jnp.arange(size)
    columns: list[Array] = []
    good = jnp.asarray(True)
    for j in range(size):
        column = a[:, j]
        for k in range(j):
            column = column - columns[k] * columns[k][j]
        above = column[j] > floor
        good = good & above
        root = jnp.sqrt(jnp.where(above, column[j], floor if floor > 0.0 else 1.0))
        columns.append(jnp.where(rows > j, column / root, jnp.where(rows == j, root, 0.0)))
    return jnp.stack(columns, axis=1), good


def backward_substitution(lower: Float[AnyArray, "n n"], b: Float[AnyArray, "n *column"]) -> Float[Array, "n *column"]:
    """Solve Lᵀ x = b."""
    size = lower.shape[0]
    rows: dict[int, Array] = {}
    for i in reversed(range(size)):
        value = b[i]
        for k in range(i + 1, size):
            value = value - lower[k, i] * rows[k]
        rows[i] = jnp.asarray(value / lower[i, i])
    return jnp.stack([rows[i] for i in range(size)])


def scaled_cholesky(
    p: Float[AnyArray, "n n"], jitter: float
) -> tuple[Float[Array, "n"], Float[Array, "n"], Float[Array, "n n"]]:
    """Standard deviations d, their inverse, and the factor L of the correlation matrix: p ≈ d (L Lᵀ) d.

    Components that are known exactly (variance 0) have d = 1/d = 0 and a unit row in L. If components are perfectly
    correlated, a pivot is zero up to rounding and is replaced by `jitter` epsilons.

    Args:
        p: covariance, possibly singular.
        jitter: least pivot of the correlation matrix, in units of the dtype's epsilon.
    """
    variance = jnp.diagonal(p)
    known = variance <= 0.0
    d = jnp.sqrt(jnp.where(known, 1.0, variance))
    inverse = jnp.where(known, 0.0, 1.0 / d)
    eye = jnp.eye(p.shape[0], dtype=bool)
    correlation = jnp.where(eye, 1.0, p * inverse[:, None] * inverse[None, :])
    lower, _ = cholesky(correlation, jitter * float(jnp.finfo(p.dtype).eps))
    return jnp.where(known, 0.0, d), inverse, lower
