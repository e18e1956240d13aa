r"""The filter over components as one scan, and the smoother of means as one back.

The scan runs in segments of about √T samples, each under `jax.checkpoint`: a gradient in reverse mode stores the belief
at the start of each segment, and computes a segment again when the backward pass reaches it. Memory grows with √T,
and the stored values of one segment fit the processor's cache.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.typing import DTypeLike
from jaxtyping import Array

from jgait.filtering.covariance import Scalar
from jgait.filtering.fast.components import (
    dot,
    from_upper,
    minus,
    parted,
    plus,
    product,
    total,
    transposed,
    unknown,
)
from jgait.filtering.fast.step import Components, Reading, advanced, triangle
from jgait.filtering.inputs import Inputs
from jgait.filtering.methods import EKF, KF, Method

SEGMENTED_FROM = 256
"""Least number of samples of a recording that is scanned in segments; shorter recordings have one segment."""

Carry = tuple[list[Scalar], list[Scalar]]
"""A belief as the carry of a scan: arrays of the mean, and of the upper triangle of the covariance."""


def refused(given: Inputs, method: Method, covariances: bool) -> str:
    """The reason why components cannot compute it; empty if they can."""
    needs = {
        f"the method {method!r}": not (isinstance(method, KF | EKF) and method.iterations == 1),
        "states on a manifold": given.shape.curved,
        "smoothed covariances": covariances,
    }
    wrong = " and ".join(what for what, needed in needs.items() if needed)
    return wrong and (
        "execution='fast' has filters and smoothed means by KF() and EKF() on states that are no manifold; "
        f"this call has {wrong}, and needs 'core'"
    )


def solve(given: Inputs, fields: tuple[str, ...], smooth: bool) -> dict[str, Array]:
    """Fields of `Posterior` by name, and the smoothed means: arrays (T, size), (T, n, n) or (T,)."""
    kept, linear, matrices = forward(given, (*fields, "mean", "cov") if smooth else fields, smooth)
    field_values = {name: kept[name] for name in fields}
    if smooth:
        field_values["smoothed_mean"] = backward(given, kept["mean"], kept["cov"], linear, matrices)
    return {name: _stacked(name, values, given.shape.error.size) for name, values in field_values.items()}


def _stacked(name: str, values: Any, size: int) -> Array:
    """A field of components as an array."""
    if name == "cov":
        return jnp.stack([jnp.stack(row, axis=-1) for row in from_upper(values, size)], axis=-2)
    return jnp.stack(values, axis=-1) if isinstance(values, list) else values


def forward(
    given: Inputs, keep: tuple[str, ...], smooth: bool
) -> tuple[dict[str, Any], list[Array], Callable[[Iterable[Array]], Any]]:
    """The fields `keep`; and what the smoother needs: arrays, and the function from those of a sample to matrices."""
    shape = given.shape
    size, dtype = shape.error.size, shape.dtype
    series, at_sample = parted((given.measured, given.controls, given.dt, given.visible), jnp.ndim)
    matrices: list[Callable[[Iterable[Array]], Any]] = []

    def body(carry: Carry, leaves: list[Array]) -> tuple[Carry, tuple[dict[str, Any], list[Array]]]:
        measured, controls, dt, visible = at_sample(leaves)
        before = Components(carry[0], from_upper(carry[1], size))
        fields, A, g = advanced(shape, jax.tree.leaves(given.params), before, Reading(measured, controls, dt, visible))
        linear: list[Array] = []
        if smooth:
            gain, z = product(transposed(g.white_cross), g.inverse), [dot(c, g.white) for c in transposed(g.inverse)]
            linear, whole = parted((A, g.matrix, gain, z), unknown)
            matrices[:] = [whole]
        outputs = {name: arrays(fields[name], bool if name == "valid" else dtype) for name in keep}
        return arrays((fields["mean"], fields["cov"]), dtype), (outputs, arrays(linear, dtype))

    start = arrays((given.mean, triangle(given.cov.entries(), size, dtype)), dtype)
    kept, linear = segmented(body, start, series)
    return kept, linear, matrices[0] if smooth else tuple


def backward(
    given: Inputs,
    means: list[Array],
    covs: list[Array],
    linear: list[Array],
    matrices: Callable[[Iterable[Array]], Any],
) -> list[Array]:
    """The smoothed means, x − P λ with λ ← Aᵀ (λ − Hᵀ (z + Kᵀ λ)), from the last sample to the first."""
    size, dtype = given.shape.error.size, given.shape.dtype

    def body(lam: list[Scalar], sample: Any) -> tuple[list[Scalar], list[Scalar]]:
        mean, cov, entries = sample
        A, H, K, z = matrices(entries)
        move = [dot(row, lam) for row in from_upper(cov, size)]
        fine = jnp.isfinite(total(move))
        smoothed = [x - jnp.where(fine, d, 0.0) for x, d in zip(mean, move, strict=True)]
        correction = [plus(a, dot(k, lam)) for a, k in zip(z, transposed(K), strict=True)]
        rest = [minus(a, dot(h, correction)) for a, h in zip(lam, transposed(H), strict=True)]
        return arrays([dot(column, rest) for column in transposed(A)], dtype), arrays(smoothed, dtype)

    return segmented(body, [jnp.zeros((), dtype)] * size, (means, covs, linear), reverse=True)


def arrays[T](values: T, dtype: DTypeLike) -> T:
    """Scalars (Python floats or arrays), or a tree of them, as arrays of the dtype."""
    return jax.tree.map(lambda value: jnp.asarray(value, dtype), values)


def segmented(body: Callable[[Any, Any], Any], start: Any, leaves: Any, reverse: bool = False) -> Any:
    """The outputs of `lax.scan`, in checkpointed segments; `body` has the leaves of one sample as input.

    If the segment length does not divide T, the samples that are left over are a segment of their own.
    """
    length = len(jax.tree.leaves(leaves)[0])
    size = length if length < SEGMENTED_FROM else math.isqrt(length)
    body = jax.checkpoint(body, prevent_cse=False)

    @jax.checkpoint
    def segment(carry: Any, part: Any) -> Any:
        return lax.scan(body, carry, part, reverse=reverse)

    if size == length:
        return segment(start, leaves)[1]
    end = length // size * size

    def segments(carry: Any) -> Any:
        folded = jax.tree.map(lambda leaf: leaf[:end].reshape(-1, size, *leaf.shape[1:]), leaves)
        carry, outputs = lax.scan(segment, carry, folded, reverse=reverse)
        return carry, jax.tree.map(lambda leaf: leaf.reshape(end, *leaf.shape[2:]), outputs)

    def rest(carry: Any) -> Any:
        return segment(carry, jax.tree.map(lambda leaf: leaf[end:], leaves))

    if reverse:
        carry, last = rest(start)
        first = segments(carry)[1]
    else:
        carry, first = segments(start)
        last = rest(carry)[1]
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), first, last)
