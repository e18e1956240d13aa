"""Products with a matrix A (n, n, B) whose last rows are those of the identity, given by its first rows (t, n, B).

Such are the transitions of errors that hold constants, such as the biases of a sensor: half of the operations.
"""

import jax.numpy as jnp
from jaxtyping import PyTree

from jgait.filtering.lanes import product, transposed, unheld_product, unheld_product_transposed, where


def whole(rows: PyTree) -> PyTree:
    """The matrix A."""
    count, size = rows.shape[:2]
    unit = jnp.eye(size, dtype=rows.dtype)[count:, :, None]
    return jnp.concatenate([rows, jnp.broadcast_to(unit, (size - count, *rows.shape[1:]))])


def right_product(a: PyTree, rows: PyTree) -> PyTree:
    """The products a A of matrices (m, n, B)."""
    count = rows.shape[0]
    return product(a[:, :count], rows, a.at[:, :count].set(0.0)) if count < rows.shape[1] else product(a, rows)


def congruence(rows: PyTree, half: PyTree, cov: PyTree, noise: PyTree, finite: PyTree) -> PyTree:
    """A P Aᵀ + Q where `finite` (B,), else P; `half` (t, n, B) holds the first rows of A P."""
    count = rows.shape[0]

    def part(value: PyTree, i: slice, j: slice) -> PyTree:
        return where(finite, value, cov[i, j])

    first, last = slice(count), slice(count, None)
    # Selected in the loop of the product: a loop of its own takes longer than a product.
    corner = part(unheld_product_transposed(half, rows, noise[first, first]), first, first)
    if count == rows.shape[1]:
        return corner
    beside = part(half[:, last] + noise[first, last], first, last)
    below = part(cov[last, last] + noise[last, last], last, last)
    return jnp.concatenate([
        jnp.concatenate([corner, beside], axis=1), jnp.concatenate([transposed(beside), below], axis=1)
    ])  # fmt: skip


def left_product(rows: PyTree, b: PyTree) -> PyTree:
    """The products Aᵀ b of matrices (n, n, B), for one use."""
    count = rows.shape[0]
    last = b.at[:count].set(0.0) if count < rows.shape[1] else None
    return unheld_product(transposed(rows), b[:count], last)
