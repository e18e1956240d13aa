r"""Instants at which the ankle rests, detected online: the valley of the shank's rate in stance, in constant memory.

`events.shank_stance` searches the whole time between two swings. Here the least rate since the swing is stored; while
the foot comes down (`landing` samples), each new greatest rate resets it. A sample whose rate has stayed the least for
`hold` samples is the valley. Samples from push-off to swing do not count. `step` processes one sample, in a `lax.scan`
or on a device.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import PyTree

from jgait.types import Flags, Values


class StanceSearch(NamedTuple):
    """State of the search, passed from one sample to the next."""

    seeks: PyTree  #: bool, the valley of this stance is not detected yet.
    since: Values  #: sample at which the end of the swing was detected.
    most: Values  #: greatest rate since that sample while the foot came down [rad/s].
    least: Values  #: least rate since the greatest rate [rad/s].
    at: Values  #: sample of the least rate.


class Phase(NamedTuple):
    """Output of a detector of `events.shank` at the sample."""

    over: Flags  #: bool, the end of a swing is detected.
    leaves: Flags  #: bool, the foot pushes off or swings.


def begin(rate: ArrayLike) -> StanceSearch:
    """The state before the first swing; `rate` is the rate of the first sample [rad/s]."""
    x = jnp.asarray(rate)
    none = jnp.zeros_like(x, dtype=jnp.int32)
    return StanceSearch(jnp.zeros_like(x, dtype=bool), none, x, x, none)


def step(
    s: StanceSearch, index: ArrayLike, rate: ArrayLike, phase: Phase, hold: ArrayLike, landing: ArrayLike
) -> tuple[StanceSearch, PyTree]:
    """One sample: the next state, and whether the sample `state.at` is now detected as a valley.

    Args:
        s: state from `begin` or from the previous step.
        index: number of the sample, int32.
        rate: low-passed sagittal rate, the forward swing negative [rad/s].
        phase: phase of the gait at this sample.
        hold: number of samples for which the rate of the valley must stay the least [samples].
        landing: number of samples after a swing in which the foot comes down [samples].
    """
    now, x = jnp.asarray(index, jnp.int32), jnp.asarray(rate)
    since = jnp.where(phase.over, now, s.since)
    lands = now - since < landing
    rises = phase.over | (lands & (x >= s.most))
    most = jnp.where(rises, x, s.most)
    lower = rises | ((x < s.least) & ~phase.leaves)
    least, at = jnp.where(lower, x, s.least), jnp.where(lower, now, s.at)
    valley = s.seeks & ~lands & (now - at >= hold)
    return StanceSearch((s.seeks | phase.over) & ~valley, since, most, least, at), valley
