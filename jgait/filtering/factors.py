r"""Factors of covariances, P = L Lᵀ with L lower triangular, and their updates without a new factorisation.

A rotation of an array's columns changes no product of two rows, so every factor of P can be made triangular. All
functions are elementwise arithmetic that XLA fuses into a scan, with finite gradients where P is singular.
"""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from jgait.filtering.linear_algebra import product, scaled_cholesky
from jgait.types import AnyArray

FLAT = 16.0
"""Remainder of a row, as a fraction of its norm, below which it is rounding, without a derivative [epsilons]."""


def triangularised(a: Float[AnyArray, "n k"], floor: float = 1.0) -> Float[Array, "n n"]:
    """The lower triangle L with L Lᵀ = a aᵀ, with no negative entry on its diagonal.

    A row that depends linearly on the rows before it gives a column of zeros; the gradient is finite there too: it is
    0 for the remainder of that row.

    Args:
        a: finite matrix.
        floor: fraction of a row's norm below which its remainder counts as zero [epsilons of the dtype].

    Returns:
        L.
    """
    return reduced(a, a.shape[0], floor)[0]


def reduced(
    a: Float[AnyArray, "n k"], count: int, floor: float = 1.0
) -> tuple[Float[Array, "n {count}"], Float[Array, "{count} k"]]:
    """The first columns of `triangularised`, and the orthonormal rows onto which the rows of `a` are projected.

    Householder reflections of the array with zeros before it are equal to the Gram–Schmidt recurrences and as accurate:
    there is no cancellation with a pivot and no sign, and a dependent row does not change the rest.

    Args:
        a: finite matrix.
        count: number of columns.
        floor: as in `triangularised`.

    Returns:
        L and U: a − L U is the remainder of a.

    Source: Å. Björck, C. Paige, "Loss and recapture of orthogonality in the modified Gram–Schmidt algorithm",
    SIAM J. Matrix Anal. Appl. 13(1), 1992, section 2.
    """
    whole, least = _rounding(a)
    rows, columns, directions = a, [], []
    for i in range(count):
        row = rows[0]
        square = jnp.sum(row * row)
        flat = square <= jnp.maximum(FLAT**2 * whole[i], least)
        still, there = lax.stop_gradient(row), square > floor**2 * whole[i]
        fixed = jnp.where(there, still / jnp.sqrt(jnp.where(there, lax.stop_gradient(square), 1.0)), 0.0)
        length = jnp.sqrt(jnp.where(flat, 1.0, square))
        direction = jnp.where(flat, fixed, row / length)
        pivot = jnp.where(flat, jnp.sum(row * fixed), length)
        shares = product(rows[1:], direction)
        columns.append(jnp.concatenate([jnp.zeros_like(a, shape=(i,)), pivot[None], shares]))
        directions.append(direction)
        rows = rows[1:] - shares[:, None] * direction[None, :]
    return jnp.stack(columns, axis=1), jnp.stack(directions)


def _rounding(a: Float[AnyArray, "n k"]) -> tuple[Float[Array, "n"], float]:
    """The squared rounding error (one epsilon) of each row, and the smallest square that is safe as a divisor."""
    kind = jnp.finfo(a.dtype)
    return lax.stop_gradient(squares(a)) * float(kind.eps) ** 2, float(kind.tiny) / float(kind.eps)


def changed(
    factor: Float[AnyArray, "n n"],
    rest: Float[AnyArray, "n n"],
    change: Float[AnyArray, "n n"],
    extra: Float[AnyArray, "n k"],
) -> tuple[Float[Array, "n n"], Float[Array, "n n"]]:
    """The factor L' with L' L'ᵀ = (L + change)(L + change)ᵀ + extra extraᵀ, and its rounding error.

    Row by row, a rotation moves the entries right of the diagonal, n_i, into the diagonal; written as increments,

        ρ² = l_ii² + n_i·n_i,  l_ji ← l_ji + (n_j·n_i − (ρ − l_ii) l_ji) / ρ,
        n_j ← n_j − (n_j·n_i / (ρ (ρ + l_ii)) + l_ji / ρ) n_i,  ρ − l_ii = n_i·n_i / (ρ + l_ii)

    Args:
        factor: L, lower triangular.
        rest: the rounding error of L.
        change: any matrix.
        extra: further columns.
    """
    factor, rest = added(factor, rest, jnp.tril(change))
    work, more = jnp.concatenate([factor + jnp.triu(change, 1), extra], axis=1), jnp.zeros_like(factor)
    whole, least = _rounding(work)
    columns: list[Array] = []
    signs: list[Array] = []
    for i in range(factor.shape[0]):
        sign = jnp.where(work[0, 0] < 0.0, -1.0, 1.0).astype(factor.dtype)
        pivot, below, row = sign * work[0, 0], sign * work[1:, 0], work[0, 1:]
        across = jnp.sum(row * row)
        square = pivot * pivot + across
        # A row that is only rounding error does not change.
        flat = square <= jnp.maximum(FLAT**2 * whole[i], least)
        length = jnp.sqrt(jnp.where(flat, 1.0, square))
        total = jnp.where(flat, 1.0, length + pivot)
        row, across = jnp.where(flat, 0.0, row), jnp.where(flat, 0.0, across)
        grown, shares = across / total, product(work[1:, 1:], row)
        gain = jnp.concatenate([grown[None], (shares - grown * below) / length])
        columns.append(jnp.concatenate([jnp.zeros_like(row, shape=(i,)), sign * more[:, 0] + gain]))
        signs.append(sign)
        turned = (shares / (length * total) + below / length)[:, None] * row[None, :]
        work, more = work[1:, 1:] - turned, more[1:, 1:] - turned[:, : more.shape[1] - 1]
    sign = jnp.stack(signs)[None, :]
    return added(factor * sign, rest * sign, jnp.stack(columns, axis=1))


def added(
    value: Float[AnyArray, "*shape"], rest: Float[AnyArray, "*shape"], more: Float[AnyArray, "*shape"]
) -> tuple[Float[Array, "*shape"], Float[Array, "*shape"]]:
    """The exact sum value + rest + more as the nearest number and its rounding error."""
    total = jnp.add(value, more)
    back = total - value
    low = lax.stop_gradient(jnp.asarray(rest) + ((value - (total - back)) + (more - back)))
    near = total + low
    return near, lax.stop_gradient(low - (near - total))


def covariance(factor: Float[AnyArray, "n k"]) -> Float[Array, "n n"]:
    """The exactly symmetric matrix L Lᵀ."""
    return product(factor, factor.T)


def rooted(p: Float[AnyArray, "n n"], beside: Float[AnyArray, "n"]) -> tuple[Float[Array, "n n"], Bool[Array, ""]]:
    """A factor of a possibly singular covariance, and whether p is positive semidefinite up to rounding.

    Args:
        p: covariance, finite.
        beside: variances to which p is added, whose rounding error p may contain.
    """
    size = p.shape[0]
    d, _, lower = scaled_cholesky(p, jitter=size)
    factor = d[:, None] * lower
    variance = jnp.diagonal(p)
    off = jnp.abs(jnp.sum(factor * factor, axis=1) - variance)
    return factor, jnp.all(off <= 100.0 * size * float(jnp.finfo(p.dtype).eps) * (jnp.abs(variance) + beside))


def squares(factor: Float[AnyArray, "n k"]) -> Float[Array, "n"]:
    """The variances of a covariance from its factor, diag(L Lᵀ)."""
    return jnp.sum(factor * factor, axis=1)
