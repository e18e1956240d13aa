"""Marks: per sample, where intervals of a recording begin and end."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike


class Marks(NamedTuple):
    """Where strides begin and end, as flags at samples, (T,) or, online, a scalar.

    Attributes:
        begin: bool, a stride begins here.
        end: bool, a stride ends here; one may begin at the same sample.
    """

    begin: Any
    end: Any


def marks(begin: ArrayLike, end: ArrayLike, samples: int, valid: ArrayLike | None = None) -> Marks:
    """Flags of strides from the samples at which they begin and end.

    Args:
        begin: (n,) samples.
        end: (n,) samples, each after its begin and not after the next.
        samples: T; static.
        valid: (n,) bool, False for rows that are no stride; None: all are.
    """
    there = jnp.ones(jnp.shape(begin), bool) if valid is None else jnp.asarray(valid)
    flags = []
    for index in (begin, end):
        at = jnp.where(there, jnp.asarray(index), samples)
        flags.append(jnp.zeros(samples, bool).at[at].set(True, mode="drop"))
    return Marks(*flags)
