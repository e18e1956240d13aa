"""Loops over the first samples of longer arrays."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from jgait.types import Counts


def scanned[C, S, Y](body: Callable[[C, S], tuple[C, Y]], start: C, samples: S, count: Counts | None) -> tuple[C, Y]:
    """`lax.scan` over the first `count` samples, or over all; outputs beyond are zeros.

    JAX cannot differentiate it in reverse mode where a count is given.
    """
    if count is None:
        return lax.scan(body, start, samples)
    length = jax.tree.leaves(samples)[0].shape[0]
    body = jax.jit(body, inline=True)  # traced once, for the shapes and for the loop

    def sample(i: Counts) -> S:
        return jax.tree.map(lambda v: lax.dynamic_index_in_dim(v, i, keepdims=False), samples)

    def step(i: Counts, kept: tuple[C, Y]) -> tuple[C, Y]:
        carry, output = body(kept[0], sample(i))
        put = jax.tree.map(lambda all, leaf: lax.dynamic_update_index_in_dim(all, leaf, i, 0), kept[1], output)
        return carry, put

    shapes = jax.eval_shape(lambda: body(start, sample(0))[1])
    outputs = jax.tree.map(lambda leaf: jnp.zeros((length, *leaf.shape), leaf.dtype), shapes)
    return lax.fori_loop(0, count, step, (start, outputs))


def held_on(values: Array, count: Counts) -> Array:
    """The outputs (T, …); from `count` on they repeat the output before."""
    last = lax.dynamic_index_in_dim(values, count - 1, keepdims=False)
    computed = jnp.arange(values.shape[0]) < count
    return jnp.where(computed.reshape(-1, *(1,) * (values.ndim - 1)), values, last)
