"""The one place that scans: a filter forward over the samples of a batch, and its smoother back.

A filter's carry is the belief (x, δ, P): the predicted state x, the correction δ, and the covariance P of errors about
x. The estimate is x ⊕ δ; on a manifold, the map to errors about it is part of the next A.

The smoother is the modified Bryson–Frazier form. With J = H A and M = (I − K H) A of each sample,

    λ ← Mᵀ λ − Jᵀ G e,   Λ ← Mᵀ Λ M + Jᵀ G J,   from the last sample to the first,
    x_s = x ⊕ (δ − P λ),   P_s = P − P Λ P.

This is the Rauch–Tung–Striebel smoother without an inverse of a covariance: the same on flat states, equal to first
order in the smoother's corrections on manifolds.

Source: G. J. Bierman, "Fixed interval smoothing with discrete measurements", Int. J. Control 18(1), 1973; H. Rauch,
F. Tung, C. Striebel (1965), AIAA Journal 3(8).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float

from jgait.filtering.linear import Linear
from jgait.filtering.step import (
    Update,
    applied,
    held,
    predict,
    product,
    product_transposed,
    summed,
    transposed,
    unseen,
    update,
    where,
)


class Sample(NamedTuple):
    """One sample of a batch, or all of them with the time axis in front."""

    measured: Float[Array, "m B"]
    control: tuple[Float[Array, "B"], ...]
    dt: Float[Array, "B"]  #: [s]
    visible: Bool[Array, "m B"]


type Belief = tuple[Float[Array, "k B"], Float[Array, "n B"], Float[Array, "n n B"]]
"""x, δ, P."""

type After = tuple[Float[Array, "n B"], Float[Array, "..."]]
"""λ, and Λ (n, n, B), or 0 where no covariances are smoothed."""


def filter_step(linear: Linear, keep: Sequence[str]) -> Callable[[Belief, Sample], tuple[Belief, dict[str, Array]]]:
    """Predict and update at a sample, for `lax.scan`; the belief after it, and the outputs `keep`.

    x, delta, cov    the belief after the sample
    prior            P⁻, of errors about x
    innovation, variance, nis, log_det, valid    of the update; valid is False where something was not finite
    G, z             S⁻¹ and S⁻¹ e
    M, J             (I − K H) A and H A
    """

    def body(belief: Belief, sample: Sample) -> tuple[Belief, dict[str, Array]]:
        x, delta, P = belief
        A, Q, after = held(*linear.transition(x, delta, P, sample.control, sample.dt))
        prior, finite = predict(P, A, Q, after)
        x = where(finite, after, x)

        def observed() -> tuple[Update, Array]:
            return updated(linear, x, prior, sample, finite)

        if linear.lanes == 1:  # a single recording need not compute an update where nothing is measured
            size = len(sample.measured)
            none = jnp.zeros_like(sample.measured)
            new, e = lax.cond(jnp.any(sample.visible), observed, lambda: (unseen(prior, size, finite), none))
        else:
            new, e = observed()
        delta = where(finite, new.delta, delta)
        outputs = {
            "x": x, "delta": delta, "cov": new.P, "prior": prior, "innovation": e, "variance": new.variance,
            "nis": new.nis, "log_det": new.log_det, "valid": new.good, "G": new.G, "z": new.z,
        }  # fmt: skip
        if "J" in keep:
            A = where(finite, A, jnp.eye(len(A), dtype=A.dtype)[:, :, None])
            outputs["J"] = product(new.H, A)
            outputs["M"] = A - product(new.K, outputs["J"])
        return (x, delta, new.P), {name: outputs[name] for name in keep}

    return body


def updated(linear: Linear, x: Array, prior: Array, sample: Sample, finite: Array) -> tuple[Update, Array]:
    """The update of a prediction, and the innovation; iterated, each time of the same P⁻, if the method says so."""
    H, R, e = held(*linear.observation(x, sample.control, sample.measured, sample.visible, None, prior))
    first = new = update(prior, H, R, e, finite)
    for _ in range(1, linear.method.iterations):
        near = prior - product(new.K, product(new.H, prior))
        H, R, again = linear.observation(x, sample.control, sample.measured, sample.visible, new.delta, near)
        new = update(prior, H, R, again + applied(H, new.delta), first.good & new.good)
    return new._replace(variance=first.variance, nis=first.nis, log_det=first.log_det), where(new.good, e, 0.0)


def smoother_scan(
    named: dict[str, Array], chosen: tuple[int, ...], start: After, keep: Sequence[str]
) -> tuple[After, dict[str, Array]]:
    """From the last sample to the first; λ and Λ before the first sample, and the outputs `keep`.

    move       −P λ, to be added to δ
    smoothed   P − P Λ P of the components `chosen`; without any, Λ is not computed
    lam, Lam   λ and Λ of the samples after each
    """

    def body(carry: After, sample: tuple[Array, ...]) -> tuple[After, dict[str, Array]]:
        lam, Lam = carry
        P, M, J, G, z = sample
        move = -applied(P, lam)
        fine = held(jnp.isfinite(summed(move)))
        outputs = {"lam": lam, "Lam": Lam}
        if chosen:
            part = taken(P, chosen)
            known = taken(transposed(part), chosen)
            smoothed = held(product_transposed(-product(part, Lam), part, known))
            outputs["smoothed"] = where(fine & held(jnp.isfinite(summed(smoothed))), smoothed, known)
            Lam = product(product(transposed(M), Lam), M, product(transposed(J), product(G, J)))
        outputs["move"] = where(fine, move, 0.0)
        lam = applied(transposed(M), lam) - applied(transposed(J), z)
        return (lam, Lam), {name: outputs[name] for name in keep}

    known = tuple(named[name] for name in ("cov", "M", "J", "G", "z"))
    return lax.scan(body, start, known, reverse=True)


def nothing_after(size: int, lanes: int, dtype: DTypeLike, covariances: bool) -> After:
    """λ and Λ after the last sample."""
    return jnp.zeros((size, lanes), dtype), jnp.zeros((size, size, lanes) if covariances else (), dtype)


def taken(matrix: Array, rows: tuple[int, ...]) -> Array:
    """Some rows of matrices."""
    if rows == tuple(range(rows[0], rows[-1] + 1)):
        return matrix[rows[0] : rows[-1] + 1]
    return matrix[jnp.asarray(rows)]
