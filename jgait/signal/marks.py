"""Samples at which intervals of a recording begin and end: flags, and values at the last of them."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Bool, Int, PyTree

from jgait.types import AnyArray, Flags


class Marks(NamedTuple):
    """Flags of the start and the end of strides at each sample, (T,) or, online, a scalar."""

    begin: Flags  #: bool, a stride begins at this sample.
    end: Flags  #: bool, a stride ends at this sample; the next stride may begin at the same sample.


def marks(
    begin: Int[AnyArray, "stride"],
    end: Int[AnyArray, "stride"],
    samples: int,
    valid: Bool[AnyArray, "stride"] | None = None,
) -> Marks:
    """Flags of T samples from the samples at which strides begin and end; an end is not after the next start.

    `valid` is False for rows without a stride.
    """
    rows = (jnp.where(True if valid is None else valid, jnp.asarray(index), samples) for index in (begin, end))
    return Marks(*(jnp.zeros(samples, bool).at[at].set(True, mode="drop") for at in rows))


def latest[T: PyTree](first: T, there: T, instant: Flags) -> tuple[T, T]:
    """Values at the last instant before each sample (T,), and at the last instant of all.

    `first` are the values at the last instant before the first sample, `there` the values at the samples.
    """
    count = instant.shape[0]
    number = lax.cummax(jnp.where(instant, jnp.arange(1, count + 1, dtype=jnp.int32), 0))
    before = jnp.concatenate([jnp.zeros_like(number[:1]), number[:-1]])
    all_ = jax.tree.map(lambda old, new: jnp.concatenate([old[None], new]), first, there)
    before_each, last = (jax.tree.map(lambda values, at=at: values[at], all_) for at in (before, number[-1]))
    return before_each, last
