"""Scans that end where the padding of recordings begins.

A trailing run of samples without an interval (dt = 0) and without a measurement is padding: nothing changes there, so
the scans stop after its first sample, whose outputs hold for all of it. Recordings of any length can therefore share
the program of a longer one, at the cost of their own samples.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import PyTree


def samples_of(dt: PyTree, observed: PyTree) -> PyTree:
    """The number of samples up to the first of the padding, over all recordings; dt (T, B), seen (T, m, B)."""
    active = jnp.any(dt != 0.0, axis=-1) | jnp.any(observed, axis=(1, 2))
    length = active.shape[0]
    last = length - 1 - jnp.argmax(active[::-1])
    return jnp.where(jnp.any(active), jnp.minimum(last + 2, length), 1)


def scanned(
    body: Callable[[PyTree, PyTree], tuple[PyTree, PyTree]],
    start: PyTree,
    samples: PyTree,
    count: PyTree,
    reverse: bool = False,
    before: tuple[PyTree, PyTree] | None = None,
) -> tuple[PyTree, PyTree]:
    """`lax.scan` over the first `count` samples, and zeros beyond; over all of them if `count` is None.

    With `before`, (values, arrays), the body gets two values of a sample: that of the arrays at the sample before, or
    `values` at the first, and that of `samples`. JAX cannot differentiate a loop whose length is not constant in
    reverse mode.
    """
    if count is None:
        if before is not None:
            samples = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b[:-1]]), *before), samples
        return lax.scan(body, start, samples, reverse=reverse)
    length = jax.tree.leaves(samples)[0].shape[0]
    body = jax.jit(body, inline=True)  # traced once, for the shapes and for the loop

    def at(i: PyTree, arrays: PyTree) -> PyTree:
        return jax.tree.map(lambda v: lax.dynamic_index_in_dim(v, i, keepdims=False), arrays)

    def sample(i: PyTree) -> PyTree:
        if before is None:
            return at(i, samples)
        values, arrays = before
        last = jax.tree.map(lambda a, b: jnp.where(i > 0, b, a), values, at(jnp.maximum(i - 1, 0), arrays))
        return last, at(i, samples)

    def step(number: PyTree, kept: tuple[PyTree, PyTree]) -> tuple[PyTree, PyTree]:
        carry, outputs = kept
        i = count - 1 - number if reverse else number
        carry, found = body(carry, sample(i))
        return carry, jax.tree.map(lambda all, one: lax.dynamic_update_index_in_dim(all, one, i, 0), outputs, found)

    shapes = jax.eval_shape(lambda: body(start, sample(0))[1])
    outputs = jax.tree.map(lambda one: jnp.zeros((length, *one.shape), one.dtype), shapes)
    return lax.fori_loop(0, count, step, (start, outputs))


def held_on(values: PyTree, count: PyTree) -> PyTree:
    """Outputs (T, …) with that of the last computed sample repeated in the padding."""
    if count is None:
        return values
    last = lax.dynamic_index_in_dim(values, count - 1, keepdims=False)
    own = jnp.arange(values.shape[0]) < count
    return jnp.where(own.reshape(-1, *(1,) * (values.ndim - 1)), values, last)


def added_up(cotangents: PyTree, count: PyTree) -> PyTree:
    """The transpose of `held_on`: cotangents of which those of the padding are added to the last computed sample's."""
    if count is None:
        return cotangents

    def at(i: PyTree) -> PyTree:
        return lax.dynamic_index_in_dim(cotangents, i, keepdims=False)

    total = lax.fori_loop(count, cotangents.shape[0], lambda i, kept: kept + at(i), at(count - 1))
    return lax.dynamic_update_index_in_dim(cotangents, total, count - 1, 0)


def folded(leaves: PyTree, size: int) -> PyTree:
    """Arrays (T, …) as segments (count, size, …), the last one filled with the last entry."""

    def whole(leaf: PyTree) -> PyTree:
        filling = jnp.broadcast_to(leaf[-1:], (-len(leaf) % size, *leaf.shape[1:]))
        return (jnp.concatenate([leaf, filling]) if len(filling) else leaf).reshape(-1, size, *leaf.shape[1:])

    return jax.tree.map(whole, leaves)


def unfolded(segments: PyTree, length: int) -> PyTree:
    """The inverse of `folded`."""
    return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:])[:length], segments)
