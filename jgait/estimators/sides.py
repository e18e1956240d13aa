"""Both sides of a person as one: their records with a first axis of sides, and the distance along their strides."""

import math
from types import ModuleType

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from jgait.types import Counts, Flags, Values


def stacked[Record](*records: Record) -> Record:
    """Records of the same structure as one, with a first axis for the records.

    Numbers of one type become parts of one array: each array that is stacked is one more function to compile.
    """
    rows = [[jnp.asarray(leaf) for leaf in jax.tree.leaves(record)] for record in records]
    numbers: dict[PyTree, list[int]] = {}
    for place, leaf in enumerate(rows[0]):
        if leaf.ndim == 0:
            numbers.setdefault(leaf.dtype, []).append(place)
    made = {place: jnp.stack(each) for place, each in enumerate(zip(*rows, strict=True)) if each[0].ndim}
    for places in numbers.values():
        together = jnp.stack([row[place] for row in rows for place in places]).reshape(len(rows), -1)
        made |= {place: together[:, column] for column, place in enumerate(places)}
    joined: Record = jax.tree.unflatten(jax.tree.structure(records[0]), [made[place] for place in range(len(rows[0]))])
    return joined


def picked(index: Counts, *values: Values) -> tuple[Values, ...]:
    """The samples `index` (n,) of each of some signals (T,), by one function."""
    return tuple(jnp.stack(values, axis=1)[index].T)


def of_turns(length: Values, turn: Values, xp: ModuleType = jnp) -> tuple[Values, Values]:
    """Way of the person over strides that turn, and its standard deviation [m].

    Length (n,) is the chord from foothold to foothold [m], turn (n,) that of the foot [rad]. On a curve the person
    walks the arc; who turns on the spot walks the chord or less. The way is the mean of both, its deviation that of a
    uniform distribution between them. `xp` is `jax.numpy`, or NumPy on the host.
    """
    arc = length / xp.sinc(xp.clip(turn / (2.0 * math.pi), -0.5, 0.5))
    return 0.5 * (length + arc), (arc - length) / math.sqrt(12.0)


def along(time: Values, start: Values, end: Values, real: Flags, lengths: Values) -> Values:
    """Sums (T, m) of what strides (n, m) add, which grow linearly from the start [s] to the end [s] of each stride.

    The strides are in the order of their starts and do not overlap; those that are not `real` follow the others, and
    add nothing.
    """
    rows = jnp.arange(start.shape[0], dtype=jnp.int32).astype(time.dtype)
    beyond = time[-1] + 1.0 + rows  # after the recording, in order
    knots = jnp.stack([jnp.where(real, start, beyond), jnp.where(real, end, beyond + 0.5)], axis=1).ravel()
    done = jnp.cumsum(lengths, axis=0)
    values = jnp.stack([done - lengths, done], axis=1).reshape(-1, lengths.shape[1])
    return jax.vmap(lambda column: jnp.interp(time, knots, column), 1, 1)(values)
