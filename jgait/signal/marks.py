"""Flags at the samples where intervals of a recording begin and end."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Int

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
    there = jnp.ones(jnp.shape(begin), bool) if valid is None else jnp.asarray(valid)
    flags = []
    for index in (begin, end):
        at = jnp.where(there, jnp.asarray(index), samples)
        flags.append(jnp.zeros(samples, bool).at[at].set(True, mode="drop"))
    return Marks(*flags)
