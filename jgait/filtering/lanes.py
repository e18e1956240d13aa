"""Small products and inverses of matrices whose last axis is the batch: (row, column, B)."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

REDUCED = 32
"""Terms of the longest sum of products of one recording that XLA's reductions vectorise."""


def product(
    a: Float[Array, "i k B"], b: Float[Array, "k j B"], to: Float[Array, "i j B"] | None = None
) -> Float[Array, "i j B"]:
    """Matrix products, added to the matrices `to`, if there are any."""
    result = unheld_product(a, b, to)
    return result if _reduced(a, b) else held(result)


def unheld_product(
    a: Float[Array, "i k B"], b: Float[Array, "k j B"], to: Float[Array, "i j B"] | None = None
) -> Float[Array, "i j B"]:
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


def _reduced(a: Array, b: Array) -> bool:
    return max(a.shape[-1], b.shape[-1]) == 1 and a.shape[1] <= REDUCED


def applied(a: Float[Array, "i k B"], x: Float[Array, "k B"]) -> Float[Array, "i B"]:
    """Matrices times vectors."""
    return product(a, x[:, None])[:, 0]


def summed(a: Float[Array, "*axes B"]) -> Float[Array, "B"]:
    """The sums over all axes but the batch.

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


def transposed(a: Float[Array, "i j B"]) -> Float[Array, "j i B"]:
    """The transposed matrices."""
    return jnp.swapaxes(a, 0, 1)


def product_transposed(
    a: Float[Array, "i k B"], b: Float[Array, "j k B"], to: Float[Array, "i j B"] | None = None
) -> Float[Array, "i j B"]:
    """Matrix products a bᵀ, added to `to`."""
    return product(a, _turned(a, b), to)


def unheld_product_transposed(
    a: Float[Array, "i k B"], b: Float[Array, "j k B"], to: Float[Array, "i j B"] | None = None
) -> Float[Array, "i j B"]:
    """As `product_transposed` and `unheld_product`."""
    return unheld_product(a, _turned(a, b), to)


def _turned(a: Float[Array, "i k B"], b: Float[Array, "j k B"]) -> Float[Array, "k j B"]:
    """The matrices bᵀ; for one recording gathered: XLA does not vectorise a product with what it sees as transposed."""
    if max(a.shape[-1], b.shape[-1]) > 1:
        return transposed(b)
    rows, columns = b.shape[:2]
    order = np.arange(rows * columns).reshape(rows, columns).T.ravel()
    return held(b.reshape(rows * columns, 1)[order]).reshape(columns, rows, 1)


def symmetrised(a: Float[Array, "n n B"]) -> Float[Array, "n n B"]:
    """The symmetric part."""
    return 0.5 * (a + transposed(a))


def outer(x: Float[Array, "i B"], y: Float[Array, "j B"]) -> Float[Array, "i j B"]:
    """The products x yᵀ."""
    return x[:, None] * y[None]


def diagonal(a: Float[Array, "n n B"]) -> Float[Array, "n B"]:
    """The diagonals."""
    size = a.shape[0]
    return a.reshape(size * size, a.shape[-1])[:: size + 1]


def diagonal_matrix(x: Float[Array, "n B"]) -> Float[Array, "n n B"]:
    """Matrices with the diagonals x."""
    return jnp.eye(x.shape[0], dtype=x.dtype)[:, :, None] * x[:, None]


def held(*values: Any) -> Any:
    """The values, which XLA keeps in memory instead of computing them again at each use."""
    return lax.optimization_barrier(values if len(values) > 1 else values[0])


ENTRIES = 6
"""Rows of the largest matrix that is inverted number by number."""


def inverse(s: Float[Array, "m m B"]) -> tuple[Float[Array, "m m B"], Float[Array, "B"], Bool[Array, "B"]]:
    """The inverses of symmetric matrices, log-determinants, and whether all pivots are positive.

    A pivot that is not positive is replaced by 1. A matrix of more than `ENTRIES` rows is inverted by halves, with the
    same pivots: number by number, its program would take long to compile.
    """
    size = s.shape[0]
    if size > ENTRIES:
        return _inverse_by_halves(s)
    factor, pivots = dict[tuple[int, int], Array](), list[Array]()
    good: Any = True
    for j in range(size):
        value = s[j, j]
        for k in range(j):
            value = value - factor[j, k] * factor[j, k] * pivots[k]
        good = good & (value > 0.0)
        pivots.append(jnp.where(value > 0.0, value, 1.0))
        for i in range(j + 1, size):
            value = s[i, j]
            for k in range(j):
                value = value - factor[i, k] * factor[j, k] * pivots[k]
            factor[i, j] = value / pivots[j]
    lower = dict[tuple[int, int], Array]()
    for i in range(size):
        for j in range(i):
            value = -factor[i, j]
            for k in range(j + 1, i):
                value = value - factor[i, k] * lower[k, j]
            lower[i, j] = value
    over = [1.0 / pivot for pivot in pivots]
    entries = dict[tuple[int, int], Array]()
    for i in range(size):
        for j in range(i + 1):
            value = over[i] if i == j else over[i] * lower[i, j]
            for k in range(i + 1, size):
                value = value + lower[k, i] * lower[k, j] * over[k]
            entries[i, j] = entries[j, i] = value
    log_det: Any = sum(jnp.log(pivot) for pivot in pivots)
    rows = [jnp.stack([entries[i, j] for j in range(size)]) for i in range(size)]
    return jnp.stack(rows), log_det, good


def _inverse_by_halves(s: Float[Array, "m m B"]) -> tuple[Array, Array, Array]:
    half = s.shape[0] // 2
    first, log_det, good = inverse(s[:half, :half])
    beside = product(s[half:, :half], first)
    last, log_det_last, good_last = inverse(s[half:, half:] - product_transposed(beside, s[half:, :half]))
    corner = product(last, beside)
    first = first + product(transposed(beside), corner)
    rows = [jnp.concatenate([first, -transposed(corner)], axis=1), jnp.concatenate([-corner, last], axis=1)]
    return held(symmetrised(jnp.concatenate(rows))), log_det + log_det_last, good & good_last


def lifted(value: Array, like: Array) -> Array:
    """Values (B,) with as many axes as `like` (..., B), for products and choices."""
    return jnp.reshape(value, (1,) * (like.ndim - 1) + value.shape)


def where(flag: Bool[Array, "B"], a: Float[Array, "*axes B"], b: Array | float) -> Float[Array, "*axes B"]:
    """The array a where the flag is True, else b."""
    return jnp.where(lifted(flag, a), a, b)
