"""Small products and inverses of matrices whose last axis is the batch: (row, column, B)."""

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import PyTree

REDUCED = 16
"""Terms of the longest sum of products of one recording that XLA's reductions vectorise."""


def product(a: PyTree, b: PyTree, to: PyTree = None) -> PyTree:
    """Matrix products (i, k, B) (k, j, B) → (i, j, B), added to the matrices `to`, if there are any."""
    result = unheld_product(a, b, to)
    return result if _reduced(a, b) else held(result)


def unheld_product(a: PyTree, b: PyTree, to: PyTree = None) -> PyTree:
    """As `product`, for one use alone, with which XLA computes it in one loop.

    For one recording XLA vectorises a reduction that is not long; else sums of products written out.
    """
    if _reduced(a, b):
        result = jnp.sum(a[:, :, None] * b[None], axis=1)
        return result if to is None else to + result
    result = a[:, 0, None] * b[None, 0]
    result = result if to is None else to + result
    for k in range(1, a.shape[1]):
        result = result + a[:, k, None] * b[None, k]
    return result


def _reduced(a: PyTree, b: PyTree) -> bool:
    return max(a.shape[-1], b.shape[-1]) == 1 and a.shape[1] <= REDUCED


def applied(a: PyTree, x: PyTree) -> PyTree:
    """Matrices times vectors (i, k, B) (k, B) → (i, B)."""
    return product(a, x[:, None])[:, 0]


def summed(a: PyTree) -> PyTree:
    """The sums (B,) over all axes but the batch.

    For several recordings as sums of slices: XLA computes reductions of leading axes number by number.
    """
    if a.shape[-1] == 1:
        return jnp.sum(a, axis=tuple(range(a.ndim - 1)))
    rows = a.reshape(-1, a.shape[-1])
    while rows.shape[0] > 1:
        half = rows.shape[0] // 2
        odd = rows[2 * half :]
        rows = rows[:half] + rows[half : 2 * half]
        rows = jnp.concatenate([rows, odd]) if odd.shape[0] else rows
    return rows[0]


def transposed(a: PyTree) -> PyTree:
    """The transposed matrices."""
    return jnp.swapaxes(a, 0, 1)


def product_transposed(a: PyTree, b: PyTree, to: PyTree = None) -> PyTree:
    """Matrix products a bᵀ, (i, k, B) (j, k, B) → (i, j, B), added to `to`."""
    return product(a, _turned(a, b), to)


def unheld_product_transposed(a: PyTree, b: PyTree, to: PyTree = None) -> PyTree:
    """As `product_transposed` and `unheld_product`."""
    return unheld_product(a, _turned(a, b), to)


def _turned(a: PyTree, b: PyTree) -> PyTree:
    """The matrices bᵀ; for one recording gathered: XLA does not vectorise a product with what it sees as transposed."""
    if max(a.shape[-1], b.shape[-1]) > 1:
        return transposed(b)
    rows, columns = b.shape[:2]
    order = np.arange(rows * columns).reshape(rows, columns).T.ravel()
    return held(b.reshape(rows * columns, 1)[order]).reshape(columns, rows, 1)


def symmetrised(a: PyTree) -> PyTree:
    """The symmetric part."""
    return 0.5 * (a + transposed(a))


def outer(x: PyTree, y: PyTree) -> PyTree:
    """The products x yᵀ, (i, B) (j, B) → (i, j, B)."""
    return x[:, None] * y[None]


def diagonal(a: PyTree) -> PyTree:
    """The diagonals (n, B)."""
    size = a.shape[0]
    return a.reshape(size * size, a.shape[-1])[:: size + 1]


def diagonal_matrix(x: PyTree) -> PyTree:
    """Matrices with the diagonals x (n, B)."""
    return jnp.eye(x.shape[0], dtype=x.dtype)[:, :, None] * x[:, None]


def held(*values: PyTree) -> PyTree:
    """The values, which XLA keeps in memory instead of computing them again at each use."""
    return lax.optimization_barrier(values if len(values) > 1 else values[0])


ENTRIES = 6
"""Rows of the largest matrix that is inverted number by number."""


def inverse(s: PyTree) -> tuple[PyTree, PyTree, PyTree]:
    """The inverses of symmetric matrices (m, m, B), log-determinants (B,), and whether all pivots are positive (B,).

    A pivot that is not positive is replaced by 1. A matrix of more than `ENTRIES` rows is inverted by halves, with the
    same pivots: number by number, its program would take long to compile.
    """
    size = s.shape[0]
    if size > ENTRIES:
        return _inverse_by_halves(s)
    factor: list[list[PyTree]] = [[None] * size for _ in range(size)]
    pivots: list[PyTree] = []
    good: PyTree = True
    for j in range(size):
        value = s[j, j]
        for k in range(j):
            value = value - factor[j][k] * factor[j][k] * pivots[k]
        good = good & (value > 0.0)
        pivots.append(jnp.where(value > 0.0, value, 1.0))
        for i in range(j + 1, size):
            value = s[i, j]
            for k in range(j):
                value = value - factor[i][k] * factor[j][k] * pivots[k]
            factor[i][j] = value / pivots[j]
    lower: list[list[PyTree]] = [[None] * size for _ in range(size)]
    for i in range(size):
        for j in range(i):
            value = -factor[i][j]
            for k in range(j + 1, i):
                value = value - factor[i][k] * lower[k][j]
            lower[i][j] = value
    over = [1.0 / pivot for pivot in pivots]
    rows: list[list[PyTree]] = [[None] * size for _ in range(size)]
    for i in range(size):
        for j in range(i + 1):
            value = over[i] if i == j else over[i] * lower[i][j]
            for k in range(i + 1, size):
                value = value + lower[k][i] * lower[k][j] * over[k]
            rows[i][j] = rows[j][i] = value
    log_det = sum(jnp.log(pivot) for pivot in pivots)
    return jnp.stack([jnp.stack(row) for row in rows]), log_det, good


def _inverse_by_halves(s: PyTree) -> tuple[PyTree, PyTree, PyTree]:
    half = s.shape[0] // 2
    first, log_det, good = inverse(s[:half, :half])
    beside = product(s[half:, :half], first)
    last, log_det_last, good_last = inverse(s[half:, half:] - product_transposed(beside, s[half:, :half]))
    corner = product(last, beside)
    first = first + product(transposed(beside), corner)
    rows = [jnp.concatenate([first, -transposed(corner)], axis=1), jnp.concatenate([-corner, last], axis=1)]
    return held(symmetrised(jnp.concatenate(rows))), log_det + log_det_last, good & good_last


def lifted(value: PyTree, like: PyTree) -> PyTree:
    """Values (B,) with as many axes as `like` (..., B), for products and choices."""
    return jnp.reshape(value, (1,) * (like.ndim - 1) + value.shape)


def where(flag: PyTree, a: PyTree, b: PyTree) -> PyTree:
    """The array a (..., B) where the flag (B,) is True, else b, an array or a number."""
    return jnp.where(lifted(flag, a), a, b)
