r"""One predict and one update of a batch, in textbook letters; matrices are (row, column, B).

    predict   P⁻ = A P Aᵀ + Q
    update    S = H P⁻ Hᵀ + R,   G = S⁻¹,   K = P⁻ Hᵀ G,   δ = K e,   P = (I − K H) P⁻ (I − K H)ᵀ + K R Kᵀ

All equations are in error coordinates about the predicted state, so that rotations need no special case.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jgait.filtering.lanes import (
    applied,
    diagonal,
    diagonal_matrix,
    held,
    inverse,
    product,
    product_transposed,
    summed,
    transposed,
    where,
)


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
