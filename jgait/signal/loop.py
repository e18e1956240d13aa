"""A loop over the first samples of arrays."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import PyTree

from jgait.types import Counts


def scanned(
    step: Callable[[PyTree, PyTree], tuple[PyTree, PyTree]], start: PyTree, samples: PyTree, count: Counts | None = None
) -> tuple[PyTree, PyTree]:
    """`lax.scan` over the first `count` samples, or over all; results beyond are zeros.

    Args:
        step: (state, sample) → state and result.
        start: state before the first sample.
        samples: leaves (T, …).
        count: number of samples to process; None: T.

    Returns:
        The state after the last processed sample, and the results (T, …).
    """
    if count is None:
        return lax.scan(step, start, samples)
    length = jax.tree.leaves(samples)[0].shape[0]

    def sample(k: Counts) -> PyTree:
        return jax.tree.map(lambda v: lax.dynamic_index_in_dim(v, k, keepdims=False), samples)

    def turn(k: Counts, carried: tuple[PyTree, PyTree]) -> tuple[PyTree, PyTree]:
        state, results = carried
        after, found = step(state, sample(k))
        return after, jax.tree.map(lambda all_, one: lax.dynamic_update_index_in_dim(all_, one, k, 0), results, found)

    shapes = jax.eval_shape(lambda: step(start, sample(0))[1])
    results = jax.tree.map(lambda one: jnp.zeros((length, *one.shape), one.dtype), shapes)
    return lax.fori_loop(0, count, turn, (start, results))
