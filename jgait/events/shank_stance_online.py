r"""When the ankle stands, told while the person walks: the valley of the stance rate, in constant memory.

`events.shank_stance` looks at the whole time between two swings. Here the least rate since the swing is kept, anew
after each greatest one while the foot comes down (`landing` samples); once it has then stayed the least for `hold`
samples, it was
the valley. What comes between push-off and the swing does not count. A step of a `lax.scan`, for a device at each
sample.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import PyTree

from jgait.types import Flags, Values


class StanceSearch(NamedTuple):
    """What is remembered from one sample to the next.

    Attributes:
        seeks: bool, a valley is looked for.
        since: sample at which the swing was known to be over.
        most: greatest rate since then while the foot came down [rad/s].
        least: least rate since that [rad/s].
        at: its sample.
    """

    seeks: PyTree
    since: Values
    most: Values
    least: Values
    at: Values


class Phase(NamedTuple):
    """What a detector of `events.shank` says at the sample.

    Attributes:
        over: bool, a swing was found to be over.
        leaves: bool, the foot pushes off or swings.
    """

    over: Flags
    leaves: Flags


def begin(rate: ArrayLike) -> StanceSearch:
    """The state before the first swing; `rate` is the first one [rad/s]."""
    x = jnp.asarray(rate)
    none = jnp.zeros_like(x, dtype=jnp.int32)
    return StanceSearch(jnp.zeros_like(x, dtype=bool), none, x, x, none)


def step(
    s: StanceSearch, index: ArrayLike, rate: ArrayLike, phase: Phase, hold: ArrayLike, landing: ArrayLike
) -> tuple[StanceSearch, PyTree]:
    """One sample.

    Args:
        s: from `begin` or the step before.
        index: of the sample, int32.
        rate: low-passed sagittal rate, the forward swing negative [rad/s].
        phase: of the gait.
        hold: for how many samples the valley's rate is the least.
        landing: for how many samples after a swing the foot comes down.

    Returns:
        The state to carry on, and whether the sample `state.at` has turned out to be a valley.
    """
    now, x = jnp.asarray(index, jnp.int32), jnp.asarray(rate)
    since = jnp.where(phase.over, now, s.since)
    lands = now - since < landing
    rises = phase.over | (lands & (x >= s.most))
    most = jnp.where(rises, x, s.most)
    lower = rises | ((x < s.least) & ~phase.leaves)
    least, at = jnp.where(lower, x, s.least), jnp.where(lower, now, s.at)
    found = s.seeks & ~lands & (now - at >= hold)
    return StanceSearch((s.seeks | phase.over) & ~found, since, most, least, at), found
