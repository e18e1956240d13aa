"""What devices of legs share, in a block of samples: results, mountings, standing, lost samples, trust in angles."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import PyTree

from jgait.estimators.online.device import Readings
from jgait.events.rest import LEGS_WINDOW_S
from jgait.mounting.leg import SegmentMounting
from jgait.types import Counts, Flags, LegTrajectory, Values

START_VARIANCE = 0.3
"""[rad²] Variance of the angles at the first sample: a stream may begin in any phase of a stride."""

SETTLES_S = 5.0
"""[s] Time of walking after which angles are usable though the person has not stood since the stream began, or since
samples were lost for long. Chosen on simulated walks that begin in any phase of a stride."""


class LegsNow(NamedTuple):
    """Results after samples (b,) of n legs."""

    legs: LegTrajectory | None  #: (b, n), if every leg has sensors on both segments.
    stddev: LegTrajectory | None  #: their standard deviations.
    stands: Flags  #: whether the person stands.
    valid: Flags  #: whether the angles can be trusted.
    angle: Values | None = None  #: (b, k) angle of the segment of each sensor from the vertical [rad].
    distance: Values | None = None  #: [m]


def settled(before: Values, gone: Flags, still: Flags, dt: Values, count: Counts) -> tuple[Values, Flags]:
    """Whether angles are settled at each of n samples: after standing, or `SETTLES_S` of walking, without a long loss.

    `gone` (n,) is True where a sensor's samples have been lost for so long that the angles are unknown, `still` (n,)
    where the person stands; `dt` is the time since the previous sample [s], `count` the number of samples. `before`
    (2,) is the time [s] since the angles were unknown, 0 at the start, and since the person stood, ∞ at the start.
    """
    times = lost_for(before, jnp.stack([gone, still], axis=1), dt, count)
    return times[count - 1], (times[:, 1] < times[:, 0]) | (times[:, 0] >= SETTLES_S)


def stacked_mountings(worn: list[SegmentMounting]) -> tuple[tuple[str, ...], PyTree]:
    """The placements of k sensors, and their mountings as one without a placement, its fields (k, …)."""
    placements, *numbers = zip(*worn, strict=True)
    columns: list[PyTree] = [None, *map(np.stack, numbers)]
    return placements, SegmentMounting(*columns)


def standing_samples(sampling_rate_hz: float) -> np.ndarray:
    """Number of samples for which all gyroscopes must be slow: the window of `events.rest.legs_at_rest`."""
    return np.asarray(2.0 * max(1, round(LEGS_WINDOW_S * sampling_rate_hz)) + 1.0)


def stood(slow: Values, samples: Readings, limit: float, window: Values, count: Counts) -> tuple[Values, Flags]:
    """Number of samples for which the legs have been slow, below `limit` [rad/s], and (n,) whether the person stands.

    `slow` is that number before the n samples, `window` that from which on the person stands, `count` the number of
    samples. Gyroscopes that were off or whose reading is lost do not count, but at least one must.
    """
    fast = jnp.sum(samples.gyr * samples.gyr, axis=2) >= limit**2
    quiet = jnp.any(samples.turned, axis=1) & ~jnp.any(fast & samples.turned, axis=1)
    since = lost_for(slow, ~quiet, jnp.ones_like(samples.dt), count)
    return jnp.minimum(since[count - 1], window), since >= window


def lost_for(before: Values, there: Flags, dt: Values, count: Counts) -> Values:
    """(n, …) time since the last measured sample [s], `before` (…) the samples; 0 where a sample is measured (`there`)
    and after `count` samples. `dt` is the time since the previous sample [s].
    """
    axes = tuple(range(1, there.ndim))
    elapsed = jnp.broadcast_to(jnp.expand_dims(jnp.cumsum(jnp.maximum(dt, 1e-6)), axes), there.shape)
    last = jnp.maximum(lax.cummax(jnp.where(there, elapsed, -jnp.inf)), -before[None])
    real = jnp.expand_dims(jnp.arange(dt.shape[0], dtype=jnp.int32) < count, axes)
    return jnp.where(real & ~there, elapsed - last, 0.0)
