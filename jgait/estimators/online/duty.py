"""Joint angles sample by sample with gyroscopes that are off at times: `duty_cycled_gyro` as a device.

It is the filter with the filler "hold": while a gyroscope is off, its rate is not observed, and gravity and the rigid
link correct the angle. The other fillers repeat earlier strides; they have no form sample by sample. The person stands
when all gyroscopes that are on have been slow for half a second. Before the person has stood, angles are not valid:
walking does not tell the filter a wrong start, which it takes for a bias.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jgait.duty_cycle.recording import SEGMENTS, gyroscope_masks
from jgait.estimators.duty_cycled_gyro import model as duty_model
from jgait.estimators.duty_cycled_gyro import turns
from jgait.estimators.duty_cycled_gyro.estimator import joints
from jgait.estimators.duty_cycled_gyro.model_params import PlanarSegment, SegmentEstimate
from jgait.estimators.duty_cycled_gyro.params import DutyCycledParams
from jgait.estimators.duty_cycled_gyro.prepare import LOST, checked, find_standing, worn_leg, worn_names
from jgait.estimators.leg_ekf.params import one_side
from jgait.estimators.leg_ekf.prepare import SegmentMounting
from jgait.estimators.online.device import Device, Readings
from jgait.estimators.online.standing import lost_for, stacked_mountings, standing_samples, stood
from jgait.estimators.sides import stacked
from jgait.events.rest import LEGS_RATE
from jgait.filtering import Belief
from jgait.notes import Note
from jgait.types import SIDES, Counts, Flags, LegTrajectory, Recording, Values, as_float


class DutyConstants(NamedTuple):
    """Parameters of the legs; mounting of the k sensors."""

    own: tuple[DutyCycledParams, ...]  #: parameters of the n legs of each group, leaves (n,).
    axes: Values  #: (k, 3, 3) axes of the segments in the sensors' axes [1].
    scale: Values  #: (k,) factor on the accelerometer [1].
    bias: Values  #: (k,) sagittal gyroscope bias at rest, positive when the distal end swings forward [rad/s].
    turn_bias: Values  #: (k,) gyroscope bias at rest about the segment's long axis [rad/s].
    variance: Values  #: (k,) sagittal gyroscope variance at rest [rad²/s²].
    window: Counts  #: samples for which all gyroscopes must be slow in standing.
    start_variance: Values  #: variance of the angles at the first sample [rad²].


class DutyState(NamedTuple):
    """Beliefs about thigh and shank of the n legs of each group, leaves (n, …), None without a sensor; slow samples;
    (k,) time without a rate [s]; how fast the person turns; whether the person
    has stood.
    """

    beliefs: tuple[tuple[Belief | None, ...], ...]
    slow: Counts
    lost: Values
    turn: turns.Turn
    trusted: Flags


class DutyNow(NamedTuple):
    """Results after a sample: the angle of each segment from the vertical and its standard deviation (k,) [rad], legs
    with both segments and their deviations, leaves (n,), standing, trust in the angles.
    """

    angle: Values
    angle_stddev: Values
    legs: LegTrajectory | None
    stddev: LegTrajectory | None
    stands: Flags
    valid: Flags


class DutyDeviceOptions(NamedTuple):
    """What is fixed when the program is made."""

    felt: bool  #: whether every sensor has an accelerometer.
    #: the legs in groups with sensors on the same segments, which one program filters together: for each leg of a group
    #: the index of the thigh's and of the shank's sensor, or None.
    groups: tuple[tuple[tuple[int | None, ...], ...], ...]


def device(p: DutyCycledParams, recording: Recording) -> tuple[Device, tuple[Note, ...]]:
    """The device for a person whose legs' sensors walk in a recording with all gyroscopes on, and notes.

    Raises:
        RecordingError: as `duty_cycled_gyro.prepare.prepare`.
    """
    names = worn_names(recording)
    time = checked(recording, names)
    sensors = {name: recording.sensors[name] for name in names}
    used = gyroscope_masks(recording, names)
    still, _, standing, notes = find_standing(sensors, used, time)
    mountings: list[SegmentMounting] = []
    pairs: dict[int, tuple[int | None, ...]] = {}
    for number, side in enumerate(SIDES):
        if any(name.endswith(side) for name in names):
            segments, more = worn_leg(recording, side, used, still, slice(*standing), {})
            notes += more
            places = {segment: len(mountings) + k for k, segment in enumerate(segments)}
            pairs[number] = tuple(map(places.get, SEGMENTS))
            mountings += [mounting for _, mounting in segments.values()]
    alike: dict[tuple[bool, ...], list[int]] = {}
    for number, pair in pairs.items():
        alike.setdefault(tuple(k is None for k in pair), []).append(number)
    worn = stacked_mountings(mountings)
    constants = DutyConstants(
        own=tuple(stacked(*(one_side(p, side) for side in group)) for group in alike.values()),
        axes=worn.axes,
        scale=worn.scale,
        bias=-worn.bias[:, 1],
        turn_bias=worn.bias[:, 2],
        variance=worn.variance,
        window=standing_samples(1.0 / float(np.median(np.diff(time)))),
        start_variance=as_float(0.1),
    )
    options = DutyDeviceOptions(
        all(imu.acc is not None for imu in sensors.values()),
        tuple(tuple(pairs[side] for side in group) for group in alike.values()),
    )
    return Device("legs", tuple(worn.placement), constants, begin, advance, options, tuple(pairs)), tuple(notes)


def begin(c: DutyConstants, sample: Readings, options: DutyDeviceOptions) -> DutyState:
    """The state before the first sample, see `Device`."""
    del sample

    def leg(link: DutyCycledParams, biases: tuple[Values | None, ...]) -> tuple[Belief | None, ...]:
        beliefs = duty_model.standing(link, biases, c.start_variance)
        return tuple(None if belief is None else belief.joined() for belief in beliefs)

    beliefs = tuple(
        jax.vmap(leg)(own, tuple(None if ks is None else c.bias[ks] for ks in _columns(group)))
        for own, group in zip(c.own, options.groups, strict=True)
    )
    none = jnp.zeros((), jnp.int32)
    return DutyState(beliefs, none, jnp.zeros_like(c.scale), turns.no_turn(c.axes[0]), jnp.zeros((), bool))


def _columns(group: tuple[tuple[int | None, ...], ...]) -> tuple[np.ndarray | None, ...]:
    """The sensors on the thighs and on the shanks of a group of legs, None without."""
    return tuple(None if segment[0] is None else np.array(segment) for segment in zip(*group, strict=True))


def _leg(
    c: DutyCycledParams, beliefs: tuple[Belief | None, ...], segments: tuple[PlanarSegment | None, ...],
    turning: Values, dt: Values, still: Flags, count: Counts, *, felt: bool,
) -> tuple[tuple[Belief | None, ...], tuple[SegmentEstimate, ...]]:  # fmt: skip
    """Thigh and shank of one leg: beliefs after the block, and estimates of those with a sensor."""
    real = jnp.arange(dt.shape[0], dtype=jnp.int32) < count
    turned = tuple(
        None if one is None else one._replace(excess=turns.excess(c.turn_tilt, turning, dt, one.excess))
        for one in segments
    )
    estimates, after = duty_model.over(c, turned, beliefs, dt, still, real, felt=felt)
    return (
        tuple(None if one is None else one.belief(count - 1) for one in after),
        tuple(one for one in estimates if one is not None),
    )


def advance(
    c: DutyConstants, state: DutyState, samples: Readings, count: Counts, options: DutyDeviceOptions
) -> tuple[DutyState, DutyNow]:
    """A block of samples, see `Device`."""
    about = jnp.einsum("kij,bkj->bki", c.axes, samples.gyr)
    gyr = -about[:, :, 1]
    acc = jnp.einsum("kij,bkj->bki", c.axes, samples.acc) * c.scale[None, :, None]
    slow, still = stood(state.slow, samples, LEGS_RATE, c.window, count)
    lost = lost_for(state.lost, samples.turned, samples.dt, count)

    real = jnp.arange(samples.dt.shape[0], dtype=jnp.int32) < count
    on = (samples.turned & real[:, None]).T
    turn, turning = turns.turning(about[:, :, 2].T - c.turn_bias[:, None], on, samples.dt, state.turn)

    def planar(ks: np.ndarray | None) -> PlanarSegment | None:
        if ks is None:
            return None
        rate, x, z = (v[:, ks].T for v in (gyr, acc[:, :, 0], acc[:, :, 2]))
        on, felt = samples.turned[:, ks].T, samples.felt[:, ks].T
        return PlanarSegment(rate, x, z, on | felt, on, jnp.zeros_like(rate), c.bias[ks], c.variance[ks])

    beliefs: list[tuple[Belief | None, ...]] = []
    angle: dict[int, tuple[Values, Values]] = {}
    trusted = state.trusted | (lax.cummax(still.astype(jnp.int32)) > 0)
    valid = jnp.all(lost < LOST, axis=1) & trusted
    leg: LegTrajectory | None = None
    stddev: LegTrajectory | None = None
    for own, before, group in zip(c.own, state.beliefs, options.groups, strict=True):
        columns = _columns(group)
        run = jax.vmap(lambda own, b, s: _leg(own, b, s, turning, samples.dt, still, count, felt=options.felt))
        after, results = run(own, before, tuple(map(planar, columns)))
        beliefs.append(after)
        for ks, one in zip((ks for ks in columns if ks is not None), results, strict=True):
            angle |= {int(k): (one.angle[n], one.angle_stddev[n]) for n, k in enumerate(ks)}
            valid &= jnp.all(one.valid, axis=0)
        if len(results) == 2 and len(options.groups) == 1:
            leg, stddev = jax.tree.map(jnp.transpose, jax.vmap(joints)(own, *results))
    angles, deviations = (jnp.stack(v, axis=1) for v in zip(*(angle[k] for k in sorted(angle)), strict=True))
    state = DutyState(tuple(beliefs), slow, lost[count - 1], turn, trusted[-1])
    return state, DutyNow(angles, deviations, leg, stddev, still, valid)
