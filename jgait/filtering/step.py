r"""One predict and one update of a batch, in textbook letters; matrices are (row, column, B).

    predict   P⁻ = A P Aᵀ + Q
    update    S = H P⁻ Hᵀ + R,   G = S⁻¹,   K = P⁻ Hᵀ G,   δ = K e,   P = (I − K H) P⁻ (I − K H)ᵀ + K R Kᵀ

All equations are in error coordinates about the predicted state, so that rotations need no special case. The products
and inverses of matrices that they are made of follow below.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float


def predict(
    P: Float[Array, "n n B"], A: Float[Array, "n n B"], Q: Float[Array, "n n B"], x: Float[Array, "k B"]
) -> tuple[Float[Array, "n n B"], Bool[Array, "B"]]:
    """P⁻, and whether it and the predicted state x are finite; P where they are not."""
    half = product(A, P)
    finite = held(jnp.isfinite(summed(x) + summed(half[:, 0]) + summed(diagonal(Q))))
    # Selected in the loop of the product: a loop of its own takes longer than a product.
    return held(where(finite, product_transposed(half, A, Q, hold=False), P)), finite


class Update(NamedTuple):
    """An update; where it is not `good`, H, K, δ, G and z are zero."""

    P: Float[Array, "n n B"]
    delta: Float[Array, "n B"]
    H: Float[Array, "m n B"]
    K: Float[Array, "n m B"]
    G: Float[Array, "m m B"]
    z: Float[Array, "m B"]  #: G e.
    nis: Float[Array, "B"]  #: eᵀ G e.
    variance: Float[Array, "m B"]  #: diagonal of S.
    log_det: Float[Array, "B"]  #: log |S|.
    good: Bool[Array, "B"]


def update(
    P: Float[Array, "n n B"], H: Float[Array, "m n B"], R: Float[Array, "m m B"], e: Float[Array, "m B"],
    finite: Bool[Array, "B"],
) -> Update:  # fmt: skip
    """The update of P⁻ by an observation; none where `finite` is False, or where something is not finite.

    Joseph's form is computed by products with H and K alone: a variance that the observation makes far smaller keeps
    its digits.
    """
    C = product(H, P)
    S = product_transposed(C, H) + R
    G, log_det, positive = inverse(S)
    K, z = product(transposed(C), G), applied(G, e)
    # Without `held`, XLA computes the flag again for each entry of each matrix that the flag selects.
    good = held(finite & positive & jnp.isfinite(summed(K) + summed(z) + log_det))
    K, G, z, H, R, e = (where(good, value, 0.0) for value in (K, G, z, H, R, e))
    K = held(K)
    left = held(product(-K, product(H, P), P))
    right = product_transposed(left, H, -product(K, R))
    after = held(product_transposed(-right, K, left, hold=False))
    return Update(after, applied(K, e), H, K, G, z, summed(e * z), diagonal(S), where(good, log_det, 0.0), good)


def unseen(P: Float[Array, "n n B"], size: int, finite: Bool[Array, "B"]) -> Update:
    """The update by `size` components of which none is measured: as that with H = 0, e = 0 and R = 1."""
    n, lanes = P.shape[1:]
    none, zero = jnp.zeros((size, lanes), P.dtype), jnp.zeros((n, lanes), P.dtype)
    H = jnp.zeros((size, n, lanes), P.dtype)
    return Update(P, zero, H, transposed(H), diagonal_matrix(none + 1.0), none, none[0], none + 1.0, none[0], finite)


# --- matrices (row, column, B) ---


def product(
    a: Float[Array, "i k B"], b: Float[Array, "k j B"], to: Float[Array, "i j B"] | None = None, *, hold: bool = True
) -> Float[Array, "i j B"]:
    """Matrix products, added to the matrices `to`, if there are any.

    For one recording XLA vectorises a reduction of up to 32 terms; else sums of products written out. Without `hold`,
    for one use alone, XLA computes the product in the loop of that use.
    """
    if max(a.shape[-1], b.shape[-1]) == 1 and a.shape[1] <= 32:
        result = jnp.sum(a[:, :, None] * b[None], axis=1)
        return result if to is None else to + result
    first, *rest = (a[:, k, None] * b[None, k] for k in range(a.shape[1]))
    result = sum(rest, first if to is None else to + first)
    return held(result) if hold else result


def product_transposed(
    a: Float[Array, "i k B"], b: Float[Array, "j k B"], to: Float[Array, "i j B"] | None = None, *, hold: bool = True
) -> Float[Array, "i j B"]:
    """Matrix products a bᵀ, as `product`.

    For one recording bᵀ is gathered: XLA does not vectorise a product with what it sees as transposed.
    """
    rows, columns, lanes = b.shape
    if max(a.shape[-1], lanes) > 1:
        return product(a, transposed(b), to, hold=hold)
    order = np.arange(rows * columns).reshape(rows, columns).T.ravel()
    return product(a, held(b.reshape(-1, 1)[order]).reshape(columns, rows, 1), to, hold=hold)


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


def inverse(s: Float[Array, "m m B"]) -> tuple[Float[Array, "m m B"], Float[Array, "B"], Bool[Array, "B"]]:
    """The inverses of symmetric matrices, log-determinants, and whether all pivots are positive.

    A pivot that is not positive is replaced by 1. A matrix of more than six rows is inverted by halves, with the same
    pivots: number by number, its program would take long to compile.
    """
    size, half = s.shape[0], s.shape[0] // 2
    if size > 6:
        first, log_det, good = inverse(s[:half, :half])
        beside = product(s[half:, :half], first)
        last, log_det_last, good_last = inverse(s[half:, half:] - product_transposed(beside, s[half:, :half]))
        corner = product(last, beside)
        first = first + product(transposed(beside), corner)
        rows = [jnp.concatenate([first, -transposed(corner)], axis=1), jnp.concatenate([-corner, last], axis=1)]
        return held(symmetrised(jnp.concatenate(rows))), log_det + log_det_last, good & good_last
    # Gauss–Jordan elimination of the lower triangle: what is left is the negative inverse.
    left = {(i, j): s[i, j] for i in range(size) for j in range(i + 1)}
    pivots, good = list[Array](), jnp.ones((), bool)
    for k in range(size):
        good = good & (left[k, k] > 0.0)
        pivots.append(jnp.where(left[k, k] > 0.0, left[k, k], 1.0))
        over = 1.0 / pivots[k]
        column = {i: left[max(i, k), min(i, k)] for i in range(size) if i != k}
        left |= {(i, j): left[i, j] - v * (column[j] * over) for i, v in column.items() for j in column if j <= i}
        left |= {(max(i, k), min(i, k)): v * over for i, v in column.items()} | {(k, k): -over}
    rows = [jnp.stack([-left[max(i, j), min(i, j)] for j in range(size)]) for i in range(size)]
    return jnp.stack(rows), sum(map(jnp.log, pivots[1:]), jnp.log(pivots[0])), good


def lifted(value: Array, like: Array) -> Array:
    """Values (B,) with as many axes as `like` (..., B), for products and choices."""
    return jnp.reshape(value, (1,) * (like.ndim - 1) + value.shape)


def where(flag: Bool[Array, "B"], a: Float[Array, "*axes B"], b: Array | float) -> Float[Array, "*axes B"]:
    """The array a where the flag is True, else b."""
    return jnp.where(lifted(flag, a), a, b)
