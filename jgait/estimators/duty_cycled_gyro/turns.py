"""The rate at which a person turns, and the noise that a turn adds to the sagittal axis of a gyroscope.

One axis does not measure turns, but a segment that is tilted to the side measures a part of them, as if it swung: on
`neura_sparse` a U-turn moved the thigh's angle by up to 35°.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax

from jgait.types import Flags, Values

TURN_MEAN = 0.5
"""[s] Time constant of the mean rate of a turn: a segment also rotates about its axis within each stride."""


class Turn(NamedTuple):
    """Rate of the turn after a sample [rad/s], and the time since a gyroscope was on [s]."""

    rate: Values
    since: Values


def no_turn(rates: Values) -> Turn:
    """The turn before the first sample, for rates (n, T)."""
    return Turn(jnp.zeros_like(rates[0, 0]), jnp.zeros_like(rates[0, 0]))


def turning(rates: Values, on: Flags, dt: Values, before: Turn) -> tuple[Turn, Values]:
    """How fast the person turns: mean over the segments, then over `TURN_MEAN`.

    Args:
        rates: (n, T) rate of n segments about their long axes [rad/s].
        on: (n, T) bool, the gyroscope was on and its sample arrived.
        dt: (T,) time since the previous sample [s].
        before: before the first sample.

    Returns:
        The state after the last sample, and the rate of the turn at every sample (T,) [rad/s].
    """
    count = jnp.sum(on, axis=0)
    mean = jnp.sum(jnp.where(on, rates, 0.0), axis=0) / jnp.maximum(count, 1).astype(rates.dtype)

    def step(now: Turn, sample: tuple[Values, Flags, Values]) -> tuple[Turn, Values]:
        rate, measured, dt = sample
        since = now.since + dt
        moved = now.rate + (rate - now.rate) * (1.0 - jnp.exp(-since / TURN_MEAN))
        after = Turn(jnp.where(measured, moved, now.rate), jnp.where(measured, 0.0, since))
        return after, after.rate

    return lax.scan(step, before, (mean, count > 0, jnp.asarray(dt, rates.dtype)))


def excess(tilt: Values, turning: Values, dt: Values, filled: Values) -> Values:
    """(T,) variance of a rate in addition to the gyroscope's [rad²/s²], of a segment with a `tilt` to the side [rad].

    The part of a turn that it measures is nearly the same over the turn, which lasts about 1 s. Arguments as of
    `turning`; `filled` (T,) is the spectral density of the errors of a filled rate [rad²/s], 0 where it was measured.
    """
    return ((tilt * turning) ** 2 + filled) / jnp.maximum(jnp.asarray(dt), 1e-3)
