"""Small dense products and solves, written so that XLA fuses them into the scan instead of calling a library."""

from typing import Any

import jax.numpy as jnp


def product(a: Any, b: Any) -> Any:
    """Matrix product (i, k)(k, j), or matrix times vector (i, k)(k,)."""
    if b.ndim == 1:
        return jnp.sum(a * b[None, :], axis=1)
    return jnp.sum(a[:, :, None] * b[None, :, :], axis=1)


def symmetric(a: Any) -> Any:
    """Mean of a matrix and its transpose."""
    return 0.5 * (a + a.T)


def cholesky(a: Any) -> Any:
    """Lower triangle L with L Lᵀ = a (n, n), column by column.

    A pivot that rounding has made negative or zero gives NaN, which the filter notices and refuses.
    """
    size = a.shape[0]
    columns = []
    for j in range(size):
        column = a[:, j]
        for k in range(j):
            column = column - columns[k] * columns[k][j]
        below = jnp.arange(size) >= j
        columns.append(jnp.where(below, column / jnp.sqrt(column[j]), 0.0))
    return jnp.stack(columns, axis=1)


def forward_substitution(lower: Any, b: Any) -> Any:
    """Solve L x = b for b (n,) or (n, k)."""
    rows: list[Any] = []
    for i in range(lower.shape[0]):
        value = b[i]
        for k in range(i):
            value = value - lower[i, k] * rows[k]
        rows.append(value / lower[i, i])
    return jnp.stack(rows)


def backward_substitution(lower: Any, b: Any) -> Any:
    """Solve Lᵀ x = b for b (n,) or (n, k)."""
    size = lower.shape[0]
    rows: list[Any] = [None] * size
    for i in reversed(range(size)):
        value = b[i]
        for k in range(i + 1, size):
            value = value - lower[k, i] * rows[k]
        rows[i] = value / lower[i, i]
    return jnp.stack(rows)


def scaled_cholesky(p: Any) -> tuple[Any, Any]:
    """Standard deviations d (n,) and the factor L of the correlation matrix: p = d L Lᵀ d.

    Components that are known exactly (variance 0) get a unit row of their own; perfect correlations are loosened by
    a hundred roundings, so that the factor exists.
    """
    variance = jnp.diagonal(p)
    known = variance <= 0.0
    d = jnp.where(known, 0.0, jnp.sqrt(jnp.where(known, 1.0, variance)))
    inverse = jnp.where(known, 0.0, 1.0 / jnp.where(known, 1.0, d))
    correlation = p * inverse[:, None] * inverse[None, :]
    loosened = 1.0 + 100.0 * jnp.finfo(p.dtype).eps
    eye = jnp.eye(p.shape[0], dtype=bool)
    correlation = jnp.where(eye, loosened, correlation)
    return d, cholesky(correlation)


def solve_covariance(p: Any, b: Any) -> Any:
    """Solve p x = b for a covariance p that may hold exactly known components (their x is 0)."""
    d, lower = scaled_cholesky(p)
    inverse = jnp.where(d > 0.0, 1.0 / jnp.where(d > 0.0, d, 1.0), 0.0)
    scale = inverse[:, None] if b.ndim == 2 else inverse
    return scale * backward_substitution(lower, forward_substitution(lower, scale * b))
