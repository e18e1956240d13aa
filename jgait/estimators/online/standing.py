"""What devices of legs share: stacked mountings, standing, lost samples, and trust in angles, in a block of samples."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax

from jgait.estimators.leg_ekf.prepare import SegmentMounting
from jgait.estimators.online.device import Readings
from jgait.events.rest import LEGS_WINDOW_S
from jgait.types import Counts, Flags, Values

START_VARIANCE = 0.3
"""[rad²] Variance of the angles at the first sample: a stream may begin in any phase of a stride."""

SETTLES_S = 5.0
"""[s] Time of walking after which angles are usable though the person has not stood since the stream began, or since
samples were lost for long. Chosen on simulated walks that begin in any phase of a stride."""


class Settling(NamedTuple):
    """What is kept between samples to know whether angles can be trusted."""

    unknown: Values  #: time since the angles were last unknown: since the start, or since a long loss ended [s].
    stood: Values  #: time since the person last stood [s]; ∞ before.


def unsettled(zero: Values) -> Settling:
    """Before the first sample, of the type of `zero`."""
    return Settling(zero, zero + jnp.inf)


def settled(before: Settling, gone: Flags, still: Flags, dt: Values, count: Counts) -> tuple[Settling, Flags]:
    """Whether angles are settled at each of n samples: after standing, or `SETTLES_S` of walking, without a long loss.

    `gone` (n,) is True where a sensor's samples have been lost for so long that the angles are unknown, `still` (n,)
    where the person stands; `dt` is the time since the previous sample [s], `count` the number of samples.
    """
    unknown, stood = (lost_for(old, flags, dt, count) for old, flags in zip(before, (gone, still), strict=True))
    return Settling(unknown[count - 1], stood[count - 1]), (stood < unknown) | (unknown >= SETTLES_S)


def stacked_mountings(worn: list[SegmentMounting]) -> SegmentMounting:
    """The mountings of k sensors as one, its fields (k, …); placements are a list."""
    placements, *numbers = zip(*worn, strict=True)
    return SegmentMounting(list(placements), *map(np.stack, numbers))  # type: ignore[arg-type]


def standing_samples(sampling_rate_hz: float) -> np.ndarray:
    """Number of samples for which all gyroscopes must be slow: the window of `events.rest.standing_of_legs`."""
    return np.asarray(2 * max(1, round(LEGS_WINDOW_S * sampling_rate_hz)) + 1, np.int32)


def stood(slow: Counts, samples: Readings, limit: float, window: Counts, count: Counts) -> tuple[Counts, Flags]:
    """Number of samples for which the legs have been slow, below `limit` [rad/s], and (n,) whether the person stands.

    `slow` is that number before the n samples, `window` that from which on the person stands, `count` the number of
    samples. Gyroscopes that were off or whose reading is lost do not count, but at least one must.
    """
    fast = jnp.sum(samples.gyr * samples.gyr, axis=2) >= limit**2
    quiet = jnp.any(samples.turned, axis=1) & ~jnp.any(fast & samples.turned, axis=1)
    number = jnp.arange(1, quiet.shape[0] + 1, dtype=jnp.int32)
    # the last sample that moved; a block that is quiet so far goes on with the number before it
    moved = lax.cummax(jnp.where(quiet, 0, number))
    ended = jnp.where(lax.cummin(quiet.astype(jnp.int32)) > 0, -slow, moved)
    since = number - ended
    stands = (since >= window) & (number <= count)
    return jnp.minimum(since[count - 1], window), stands


def lost_for(before: Values, there: Flags, dt: Values, count: Counts) -> Values:
    """(n, …) time since the last measured sample [s], `before` (…) the samples; 0 where a sample is measured (`there`)
    and after `count` samples. `dt` is the time since the previous sample [s].
    """
    axes = tuple(range(1, there.ndim))
    elapsed = jnp.broadcast_to(jnp.expand_dims(jnp.cumsum(jnp.maximum(dt, 1e-6)), axes), there.shape)
    last = jnp.maximum(lax.cummax(jnp.where(there, elapsed, -jnp.inf)), -before[None])
    real = jnp.expand_dims(jnp.arange(dt.shape[0], dtype=jnp.int32) < count, axes)
    return jnp.where(real & ~there, elapsed - last, 0.0)
