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

from jgait.estimators.leg_ekf import online as leg_online
from jgait.estimators.leg_ekf.inputs import LegInputs, LegSignals, Segment
from jgait.estimators.leg_ekf.params import DEFAULT, LegOptions, LegParams, one_side
from jgait.estimators.leg_ekf.prepare import LONG_GAP, SegmentMounting, mounted, standing_legs
from jgait.estimators.leg_ekf.readout import LEAST_SHARE, MOVES_M, backward
from jgait.estimators.online.device import Device, Readings
from jgait.estimators.online.standing import (
    START_VARIANCE,
    Settling,
    lost_for,
    settled,
    stacked_mountings,
    standing_samples,
    stood,
    unsettled,
)
from jgait.estimators.sides import stacked
from jgait.events.rest import LEGS_RATE
from jgait.notes import Note
from jgait.types import SIDES, Counts, Flags, LegTrajectory, Recording, Values, as_float

KINEMATICS = DEFAULT._replace(smooth=False, distance="stance")
"""The options of the device."""


class LegsConstants(NamedTuple):
    """Parameters and mounting of n legs."""

    p: LegParams  #: parameters of the person.
    own: LegParams  #: parameters of each leg, leaves (n,).
    axes: Values  #: (n, 2, 3, 3) axes of thigh and shank in their sensors' axes [1].
    scale: Values  #: (n, 2) factor on the accelerometer [1].
    bias: Values  #: (n, 2, 3) gyroscope bias at rest, in the segment's axes [rad/s].
    variance: Values  #: (n, 2) sagittal gyroscope variance at rest [rad²/s²].
    unrest: Values  #: (n, 2) variance of turns in the standing that calibrates, see `Segment` [rad²/s²].
    window: Counts  #: samples for which all gyroscopes must be slow in standing.
    start_variance: Values  #: variance of the pose at the first sample [rad²].


class LegsState(NamedTuple):
    """State between samples."""

    legs: leg_online.LegOnlineState  #: states of the filters, leaves (n, …).
    lost: Values  #: (n, 2) time since the last measured sample of thigh and shank [s]; 0: the newest is measured.
    slow: Counts  #: samples for which all gyroscopes have been slow.
    settling: Settling  #: whether angles can be trusted.
    before: LegTrajectory  #: trajectories at the last sample, leaves (n,).
    begun: Flags  #: whether there was a sample.
    way: Values  #: displacement of the hip by the feet in stance [m].
    back: Values  #: number of samples in which the foot of a single leg moved backward.
    moving: Values  #: number of samples in which it moved.


class LegsNow(NamedTuple):
    """Results after samples (b,): legs (b, n), their deviations, distance [m], standing, trust in the angles."""

    legs: LegTrajectory
    stddev: LegTrajectory
    distance: Values
    stands: Flags
    valid: Flags


def device(p: LegParams, recording: Recording) -> tuple[Device, tuple[Note, ...]]:
    """The device for a person whose legs' sensors walk in a recording, and notes on how they are worn.

    Raises:
        RecordingError: as `leg_ekf.prepare.prepare`.
    """
    sides, sensors, time, (still, _, standing, notes) = standing_legs(recording, KINEMATICS)
    rate = 1.0 / float(np.median(np.diff(time)))
    mountings: list[SegmentMounting] = []
    for side in sides:
        segments, more = mounted(sensors, side, slice(*standing), still, rate)
        mountings += segments.values()
        notes += more
    numbers = tuple(SIDES.index(side) for side in sides)
    worn = stacked_mountings(mountings)
    constants = LegsConstants(
        p=p,
        own=stacked(*(one_side(p, number) for number in numbers)),
        axes=worn.axes.reshape(-1, 2, 3, 3),
        scale=as_float(worn.scale).reshape(-1, 2),
        bias=worn.bias.reshape(-1, 2, 3),
        variance=worn.variance.reshape(-1, 2),
        unrest=worn.unrest.reshape(-1, 2),
        window=standing_samples(rate),
        start_variance=as_float(START_VARIANCE),
    )
    gravity = KINEMATICS.gravity and all(imu.acc is not None for imu in sensors.values())
    options = KINEMATICS._replace(gravity=gravity)
    return Device("legs", tuple(worn.placement), constants, begin, advance, options, numbers), tuple(notes)


def _signals(c: LegsConstants, samples: Readings, lost: Values) -> LegSignals:
    """Signals of b samples in the segments' axes, leaves (n, b, …), bias and variance (n, …)."""
    shape = (-1, *c.axes.shape[:2], 3)
    gyr = jnp.einsum("nsij,bnsj->snbi", c.axes, samples.gyr.reshape(shape))
    acc = jnp.einsum("nsij,bnsj->snbi", c.axes, samples.acc.reshape(shape)) * c.scale.T[:, :, None, None]
    measured, lost = (jnp.moveaxis(v, 0, 2).swapaxes(0, 1) for v in (samples.turned.reshape(lost.shape), lost))
    return LegSignals(
        *(Segment(gyr[s], acc[s], measured[s], c.bias[:, s], c.variance[:, s], lost[s], c.unrest[:, s]) for s in (0, 1))
    )


def begin(c: LegsConstants, sample: Readings, options: LegOptions) -> LegsState:
    """The state before the first sample, see `Device`."""
    zero, each = jnp.zeros_like(c.start_variance), jnp.zeros_like(c.scale[:, 0])
    first = _signals(c, jax.tree.map(lambda v: v[None], sample), jnp.zeros_like(c.scale)[None])
    start = jax.vmap(lambda params, leg: leg_online.start(params, leg, c.start_variance, options))
    return LegsState(
        start(c.own, first), jnp.zeros_like(c.scale), jnp.zeros((), jnp.int32), unsettled(zero),
        LegTrajectory(each, each, each, each), jnp.zeros((), bool), zero, zero, zero,
    )  # fmt: skip


def advance(
    c: LegsConstants, state: LegsState, samples: Readings, count: Counts, options: LegOptions
) -> tuple[LegsState, LegsNow]:
    """A block of samples, see `Device`."""
    real = jnp.arange(samples.dt.shape[0], dtype=jnp.int32) < count
    lost = lost_for(state.lost, samples.turned.reshape(-1, *c.scale.shape), samples.dt, count)
    slow, still = stood(state.slow, samples, LEGS_RATE, c.window, count)
    inputs = LegInputs(None, None, samples.dt, samples.dt, still, real, c.start_variance)
    run = jax.vmap(lambda own, leg, one: leg_online.over(own, leg, one, inputs, options, count), out_axes=(0, 1))
    legs, results = run(c.own, state.legs, _signals(c, samples, lost))
    leg = results.leg
    before = jax.tree.map(
        lambda old, new: jnp.concatenate([jnp.where(state.begun, old, new[0])[None], new[:-1]]), state.before, leg
    )
    most = jnp.max(backward(leg, before, c.p.rollover_radius), axis=1)
    way = state.way + jnp.cumsum(jnp.where(still | ~real, 0.0, jnp.maximum(most, 0.0)))
    moves = real & ~still & (jnp.abs(most) > MOVES_M)
    counts = (jnp.where(flags, jnp.ones_like(way), 0.0) for flags in (moves, moves & (most > 0.0)))
    moving, back = (old + jnp.cumsum(new) for old, new in zip((state.moving, state.back), counts, strict=True))
    share = back / jnp.maximum(moving, 1.0) if len(c.axes) == 1 else jnp.ones_like(way)
    at = count - 1
    last = jax.tree.map(lambda v: v[at], leg)
    gone = jnp.any(lost >= LONG_GAP, axis=(1, 2))
    settling, trusted = settled(state.settling, gone, still, samples.dt, count)
    after = LegsState(legs, lost[at], slow, settling, last, jnp.ones((), bool), way[at], back[at], moving[at])
    distance = c.p.distance_scale * way / jnp.maximum(share, LEAST_SHARE)
    valid = jnp.all(results.valid, axis=1) & trusted
    return after, LegsNow(leg, results.stddev, distance, still, valid)
