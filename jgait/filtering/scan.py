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

import jax
import jax.numpy as jnp
from jax import lax
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, Int

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

PART = 128
"""[samples] Largest length of the parts in which padding is skipped."""


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
    """Predict and update at a sample, for `scanned`; the belief after it, and the outputs `keep`.

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
    named: dict[str, Array], chosen: tuple[int, ...], start: After, keep: Sequence[str], busy: Int[Array, ""] | None
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

    def unchanged(last: dict[str, Array], part: tuple[Array, ...]) -> dict[str, Array]:
        """The outputs where no later sample tells anything."""
        outputs = jax.tree.map(jnp.zeros_like, repeated(last, part))
        if chosen:
            rows = jnp.asarray(chosen)
            outputs["smoothed"] = part[0][:, rows[:, None], rows[None]]
        return outputs

    known = tuple(named[name] for name in ("cov", "M", "J", "G", "z"))
    return scanned(body, start, known, busy, reverse=True, skipped=unchanged)


def nothing_after(size: int, lanes: int, dtype: DTypeLike, covariances: bool) -> After:
    """λ and Λ after the last sample."""
    return jnp.zeros((size, lanes), dtype), jnp.zeros((size, size, lanes) if covariances else (), dtype)


def taken(matrix: Array, rows: tuple[int, ...]) -> Array:
    """Some rows of matrices."""
    if rows == tuple(range(rows[0], rows[-1] + 1)):
        return matrix[rows[0] : rows[-1] + 1]
    return matrix[jnp.asarray(rows)]


def busy_samples(samples: Sample) -> Int[Array, ""]:
    """The number of samples up to the first of the padding, over all recordings.

    Padding is a run of samples up to the end that have neither an interval nor a measurement: nothing changes there.
    """
    active = jnp.any(samples.dt != 0.0, axis=-1) | jnp.any(samples.visible, axis=(1, 2))
    length = len(active)
    last = length - 1 - jnp.argmax(active[::-1])
    return jnp.where(jnp.any(active), jnp.minimum(last + 2, length), 1)


def part_size(length: int) -> int | None:
    """The length of the parts in which a scan skips padding; None: a scan of this length has no parts."""
    size = next(size for size in range(PART, 0, -1) if length % size == 0)
    return size if PART // 4 <= size < length else None


def repeated[Y](last: Y, part: object) -> Y:
    """The outputs of padding: those of the sample before it."""
    size = len(jax.tree.leaves(part)[0])
    return jax.tree.map(lambda v: jnp.broadcast_to(v, (size, *v.shape)), last)


def scanned[C, S, Y](
    body: Callable[[C, S], tuple[C, Y]], start: C, samples: S, busy: Int[Array, ""] | None, *,
    reverse: bool = False, skipped: Callable[[Y, S], Y] = repeated,
) -> tuple[C, Y]:  # fmt: skip
    """`lax.scan` of the parts in which the first `busy` samples are, so that padding costs nothing.

    Outputs of other parts are skipped(last outputs before them, or 0, part). Without `busy` all samples are scanned.
    """
    length = len(jax.tree.leaves(samples)[0])
    size = part_size(length)
    if size is None or busy is None:
        return lax.scan(body, start, samples, reverse=reverse)
    body = jax.jit(body, inline=True)  # traced once, for the shapes and for the scan

    def part(kept: tuple[C, Y], given: tuple[Array, S]) -> tuple[tuple[C, Y], Y]:
        def run(kept: tuple[C, Y], samples: S) -> tuple[tuple[C, Y], Y]:
            carry, outputs = lax.scan(body, kept[0], samples, reverse=reverse)
            return (carry, jax.tree.map(lambda v: v[-1], outputs)), outputs

        return lax.cond(given[0] < busy, run, lambda kept, part: (kept, skipped(kept[1], part)), kept, given[1])

    shapes = jax.eval_shape(body, start, jax.tree.map(lambda v: v[0], samples))[1]
    none = jax.tree.map(lambda v: jnp.zeros(v.shape, v.dtype), shapes)
    parts = jnp.arange(0, length, size), jax.tree.map(lambda v: v.reshape(-1, size, *v.shape[1:]), samples)
    (carry, _), outputs = lax.scan(part, (start, none), parts, reverse=reverse)
    return carry, jax.tree.map(lambda v: v.reshape(length, *v.shape[2:]), outputs)


def without_skipped(cotangents: Array, busy: Int[Array, ""] | None) -> Array:
    """The transpose of `repeated`: the cotangents of skipped parts are those of the last sample before."""
    length = len(cotangents)
    size = part_size(length)
    if size is None or busy is None:
        return cotangents
    last = (busy + size - 1) // size * size - 1
    before = jnp.reshape(jnp.arange(length) < last, (length, *[1] * (cotangents.ndim - 1)))
    rest = jnp.sum(jnp.where(before, 0.0, cotangents), axis=0)
    return jnp.where(before, cotangents, 0.0).at[last].set(rest)
