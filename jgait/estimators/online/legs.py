"""Joint angles and distance sample by sample: `leg_ekf` as a device.

Deviations from `leg_ekf` without smoothing, with `distance="stance"`:
    1. The person stands when all gyroscopes on the legs have been slow for half a second, not within a quarter of a
       second before and after.
    2. Where the person does not stand at the first sample, any pose is possible; angles are not valid until they have
       settled, see `standing.settled`.
    3. With sensors on one leg, the share of walking time in which the foot moves backward is that up to now.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from jgait.estimators.leg_ekf.estimator import LegBeliefs, calibrated, deviation_of, filtered, start, trajectory_of
from jgait.estimators.leg_ekf.inputs import LegInputs, LegSignals, Segment
from jgait.estimators.leg_ekf.params import DEFAULT, LegOptions, LegParams, one_side
from jgait.estimators.leg_ekf.prepare import LONG_GAP, resting_legs, with_feet
from jgait.estimators.leg_ekf.readout import LEAST_SHARE, MOVES_M, backward
from jgait.estimators.online.device import Device, Readings
from jgait.estimators.online.standing import (
    START_VARIANCE,
    LegsNow,
    lost_for,
    settled,
    stacked_mountings,
    standing_samples,
    stood,
)
from jgait.estimators.sides import stacked
from jgait.events.rest import LEGS_RATE
from jgait.mounting.leg import worn_legs
from jgait.notes import Note
from jgait.types import SIDES, Counts, Recording, Values, as_float

KINEMATICS = DEFAULT._replace(smooth=False, distance="stance")
"""The options of the device."""


class LegsConstants(NamedTuple):
    """Parameters and mounting of n legs."""

    p: LegParams  #: parameters of the person.
    each_leg: LegParams  #: parameters of each leg, leaves (n,).
    worn: PyTree  #: `SegmentMounting` of thigh and shank, leaves (n, 2, …).
    window: Values  #: samples for which all gyroscopes must be slow in standing.
    start_variance: Values  #: variance of the pose at the first sample [rad²].


class LegsState(NamedTuple):
    """State between samples."""

    legs: LegBeliefs  #: what is known of each leg, leaves (n, …).
    lost: Values  #: (n, 2) time since the last measured sample of thigh and shank [s]; 0: the newest is measured.
    slow: Values  #: samples for which all gyroscopes have been slow.
    settling: Values  #: (2,) whether angles can be trusted, see `standing.settled`.
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
    constants = LegsConstants(p, leg_params, worn, standing_samples(rate), as_float(START_VARIANCE))
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
    zero, each = jnp.zeros_like(c.start_variance), jnp.zeros_like(c.worn.scale)
    first = _signals(c.worn, jax.tree.map(lambda v: v[None], sample), each[None])

    def begun(params: LegParams, leg: LegSignals) -> LegBeliefs:
        before = start(params, leg, c.start_variance, options)
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
    inputs = LegInputs(None, None, samples.dt, samples.dt, still, real, c.start_variance)

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
