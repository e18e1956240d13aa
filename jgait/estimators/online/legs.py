"""Joint angles and distance sample by sample: `leg_ekf` as a device, and what it shares with `online.duty`.

Deviations from `leg_ekf` without smoothing, with `distance="stance"`:
    1. The person stands when all gyroscopes on the legs have been slow for half a second, not within a quarter of a
       second before and after.
    2. Where the person does not stand at the first sample, any pose is possible; angles are not valid until they have
       settled, see `settled`.
    3. With sensors on one leg, the share of walking time in which the foot moves backward is that up to now.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import PyTree

from jgait.estimators.leg_ekf.estimator import LegBeliefs, calibrated, deviation_of, filtered, start, trajectory_of
from jgait.estimators.leg_ekf.inputs import LegInputs, LegSignals, Segment
from jgait.estimators.leg_ekf.params import DEFAULT, LegOptions, LegParams, one_side
from jgait.estimators.leg_ekf.prepare import LONG_GAP, resting_legs, with_feet
from jgait.estimators.leg_ekf.readout import LEAST_SHARE, MOVES_M, backward
from jgait.estimators.online.device import Device, Readings
from jgait.events.rest import LEGS_RATE, LEGS_WINDOW_S
from jgait.geometry.arrays import stacked
from jgait.mounting.leg import SegmentMounting, worn_legs
from jgait.notes import Note
from jgait.types import SIDES, Counts, Flags, LegTrajectory, Recording, Values

KINEMATICS = DEFAULT._replace(smooth=False, distance="stance")
"""The options of the device."""

START_VARIANCE = 0.3
"""[rad²] Variance of the angles at the first sample, as a stream may begin in any phase of a stride; chosen by hand."""

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


class LegsConstants(NamedTuple):
    """Parameters and mounting of n legs."""

    p: LegParams  #: parameters of the person.
    each_leg: LegParams  #: parameters of each leg, leaves (n,).
    worn: PyTree  #: `SegmentMounting` of thigh and shank, leaves (n, 2, …).
    window: Values  #: samples for which all gyroscopes must be slow in standing.


class LegsState(NamedTuple):
    """State between samples."""

    legs: LegBeliefs  #: what is known of each leg, leaves (n, …).
    lost: Values  #: (n, 2) time since the last measured sample of thigh and shank [s]; 0: the newest is measured.
    slow: Values  #: samples for which all gyroscopes have been slow.
    settling: Values  #: (2,) whether angles can be trusted, see `settled`.
    #: (3,) displacement of the hip by the feet in stance [m]; numbers of samples in which the foot of a single leg
    #: moved, and in which it moved backward.
    sums: Values


def device(p: LegParams, recording: Recording) -> tuple[Device, tuple[Note, ...]]:
    """The device for a person whose legs' sensors walk in a recording, and notes on how they are worn.

    Raises:
        RecordingError: as `leg_ekf.prepare.prepare`.
    """
    sides, sensors, time, still = resting_legs(recording, KINEMATICS)
    rate = 1.0 / float(np.median(np.diff(time)))
    every = with_feet(recording, sensors, time)
    calibration = worn_legs(every, still, rate, estimator="leg_ekf")
    mountings = [mounting for side in sides for mounting in calibration.legs[side].segments.values()]
    numbers = tuple(SIDES.index(side) for side in sides)
    placements, worn = stacked_mountings(mountings)
    worn = jax.tree.map(lambda v: v.reshape(-1, 2, *v.shape[1:]), worn)
    leg_params = stacked(*(calibrated(one_side(p, SIDES.index(side)), calibration.legs[side].pose) for side in sides))
    constants = LegsConstants(p, leg_params, worn, standing_samples(rate))
    gravity = KINEMATICS.gravity and all(imu.acc is not None for imu in sensors.values())
    options = KINEMATICS._replace(gravity=gravity)
    return Device("legs", placements, constants, begin, advance, options, numbers), tuple(calibration.notes)


def _signals(worn: PyTree, samples: Readings, lost: Values) -> LegSignals:
    """Signals of b samples in the segments' axes, leaves (n, b, …), bias and variance (n, …)."""
    shape = (-1, *worn.axes.shape[:2], 3)
    gyr = jnp.einsum("nsij,bnsj->snbi", worn.axes, samples.gyr.reshape(shape))
    acc = jnp.einsum("nsij,bnsj->snbi", worn.axes, samples.acc.reshape(shape)) * worn.scale.T[:, :, None, None]
    measured, lost = (jnp.moveaxis(v, 0, 2).swapaxes(0, 1) for v in (samples.turned.reshape(lost.shape), lost))
    thigh, shank = (
        Segment(gyr[s], acc[s], measured[s], worn.bias[:, s], worn.variance[:, s], lost[s], worn.unrest[:, s])
        for s in (0, 1)
    )
    return LegSignals(thigh, shank)


def begin(c: LegsConstants, sample: Readings, options: LegOptions) -> LegsState:
    """The state before the first sample, see `Device`."""
    zero, each = jnp.zeros_like(c.window), jnp.zeros_like(c.worn.scale)
    first = _signals(c.worn, jax.tree.map(lambda v: v[None], sample), each[None])

    def begun(params: LegParams, leg: LegSignals) -> LegBeliefs:
        before = start(params, leg, zero + START_VARIANCE, options)
        return before._replace(segments=before.segments.joined(), leg=before.leg.joined())

    return LegsState(
        jax.vmap(begun)(c.each_leg, first), each, zero, jnp.stack([zero, zero + jnp.inf]), jnp.stack([zero] * 3)
    )  # fmt: skip


def advance(
    c: LegsConstants, state: LegsState, samples: Readings, count: Counts, options: LegOptions
) -> tuple[LegsState, LegsNow]:
    """A block of samples, see `Device`."""
    real, at = jnp.arange(samples.dt.shape[0], dtype=jnp.int32) < count, count - 1
    lost = lost_for(state.lost, samples.turned.reshape(-1, *c.worn.scale.shape), samples.dt, count)
    slow, still = stood(state.slow, samples, LEGS_RATE, c.window, count)
    no_prior: PyTree = jnp.zeros_like(c.window)  # the beliefs of the last block are known
    inputs = LegInputs(None, None, samples.dt, samples.dt, still, real, no_prior)

    def run(params: LegParams, known: LegBeliefs, leg: LegSignals) -> PyTree:
        segments, states = filtered(params, leg, inputs, options, known, ("valid",))
        tilts = known.segments if segments is None else jax.vmap(lambda s: s.filtered.belief(at))(segments)
        after = LegBeliefs(tilts, states.filtered.belief(at), stacked(leg.thigh, leg.shank).gyr[:, at])
        results = trajectory_of(states.mean), deviation_of(params, states.mean, states.cov), states.filtered.valid
        return after, results

    run_legs = jax.vmap(run, out_axes=(0, 1))
    legs, (leg, stddev, updated) = run_legs(c.each_leg, state.legs, _signals(c.worn, samples, lost))
    before = jax.tree.map(
        lambda old, new: jnp.concatenate([jnp.where(samples.dt[0] > 0.0, old, new[0])[None], new[:-1]]),
        trajectory_of(state.legs.leg.mean), leg,
    )  # fmt: skip
    most, walks = jnp.max(backward(leg, before, c.p.rollover_radius), axis=1), real & ~still
    moves = walks & (jnp.abs(most) > MOVES_M)
    ways = (jnp.where(walks, jnp.maximum(most, 0.0), 0.0), moves, moves & (most > 0.0))
    sums = state.sums[None] + jnp.cumsum(jnp.stack([v.astype(most.dtype) for v in ways], axis=1), axis=0)
    share = sums[:, 2] / jnp.maximum(sums[:, 1], 1.0) if len(c.worn.axes) == 1 else jnp.ones_like(most)
    gone = jnp.any(lost >= LONG_GAP, axis=(1, 2))
    settling, trusted = settled(state.settling, gone, still, samples.dt, count)
    after = LegsState(legs, lost[at], slow, settling, sums[at])
    distance = c.p.distance_scale * sums[:, 0] / jnp.maximum(share, LEAST_SHARE)
    return after, LegsNow(leg, stddev, still, jnp.all(updated, axis=1) & trusted, distance=distance)
