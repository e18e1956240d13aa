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
from jaxtyping import PyTree

from jgait.duty_cycle.recording import SEGMENTS, gyroscope_masks
from jgait.estimators.duty_cycled_gyro import model as duty_model
from jgait.estimators.duty_cycled_gyro.estimator import joints
from jgait.estimators.duty_cycled_gyro.params import DutyCycledParams, PlanarSegment, SegmentEstimate
from jgait.estimators.duty_cycled_gyro.prepare import LOST, checked, find_rests, worn_legs_of, worn_names
from jgait.estimators.leg_ekf.params import one_side
from jgait.estimators.online.device import Device, Readings
from jgait.estimators.online.legs import LegsNow, lost_for, stacked_mountings, standing_samples, stood
from jgait.events.rest import LEGS_RATE
from jgait.filtering import Belief
from jgait.mounting.leg import SegmentMounting
from jgait.notes import Note
from jgait.types import SIDES, Counts, Flags, Recording, Values


class DutyConstants(NamedTuple):
    """Parameters of the legs; mounting of the k sensors."""

    each_leg: tuple[DutyCycledParams, ...]  #: parameters of each leg.
    worn: PyTree  #: `SegmentMounting`, leaves (k, …).
    window: Values  #: samples for which all gyroscopes must be slow in standing.


class DutyState(NamedTuple):
    """Beliefs about thigh and shank of each leg, None without a sensor; slow samples; (k,) time without a rate [s]; how
    fast the person turns; whether the person has stood.
    """

    beliefs: tuple[tuple[Belief | None, ...], ...]
    slow: Values
    lost: Values
    turn: duty_model.Turn
    trusted: Flags


class DutyDeviceOptions(NamedTuple):
    """What is fixed when the program is made."""

    accelerometers: bool  #: whether every sensor has an accelerometer.
    legs: tuple[tuple[int | None, ...], ...]  #: index of the thigh's and of the shank's sensor of each leg, or None.


def device(p: DutyCycledParams, recording: Recording) -> tuple[Device, tuple[Note, ...]]:
    """The device for a person whose legs' sensors walk in a recording with all gyroscopes on, and notes.

    Raises:
        RecordingError: as `duty_cycled_gyro.prepare.prepare`.
    """
    names = worn_names(recording)
    time = checked(recording, names)
    sensors = {name: recording.sensors[name] for name in names}
    used = gyroscope_masks(recording, names)
    _, calibration = worn_legs_of(recording, used, *find_rests(sensors, used, time), {})
    mountings: list[SegmentMounting] = []
    legs: dict[int, tuple[int | None, ...]] = {}
    for number, side in enumerate(SIDES):
        if side in calibration.legs:
            segments = calibration.legs[side].segments
            places = {segment: len(mountings) + k for k, segment in enumerate(segments)}
            legs[number] = tuple(map(places.get, SEGMENTS))
            mountings += segments.values()
    placements, worn = stacked_mountings(mountings)
    window = standing_samples(1.0 / float(np.median(np.diff(time))))
    leg_params = tuple(one_side(p, side) for side in legs)
    constants = DutyConstants(leg_params, worn, window)
    options = DutyDeviceOptions(all(imu.acc is not None for imu in sensors.values()), tuple(legs.values()))
    return Device("legs", placements, constants, begin, advance, options, tuple(legs)), tuple(calibration.notes)


def begin(c: DutyConstants, sample: Readings, options: DutyDeviceOptions) -> DutyState:
    """The state before the first sample, see `Device`."""
    del sample

    def leg(params: DutyCycledParams, segments: tuple[int | None, ...]) -> tuple[Belief | None, ...]:
        biases = tuple(None if k is None else -c.worn.bias[k, 1] for k in segments)
        beliefs = duty_model.standing(params, biases, jnp.zeros_like(c.window) + 0.1)  # [rad²] of the angles
        return tuple(None if belief is None else belief.joined() for belief in beliefs)

    zeros = jnp.zeros_like(c.worn.scale)
    beliefs = tuple(map(leg, c.each_leg, options.legs))
    return DutyState(beliefs, zeros[0], zeros, duty_model.no_turn(c.worn.axes[0]), jnp.zeros((), bool))


def advance(
    c: DutyConstants, state: DutyState, samples: Readings, count: Counts, options: DutyDeviceOptions
) -> tuple[DutyState, LegsNow]:
    """A block of samples, see `Device`."""
    gyr = jnp.einsum("kij,bkj->kbi", c.worn.axes, samples.gyr)
    acc = jnp.einsum("kij,bkj->kbi", c.worn.axes, samples.acc) * c.worn.scale[:, None, None]
    slow, still = stood(state.slow, samples, LEGS_RATE, c.window, count)
    lost = lost_for(state.lost, samples.turned, samples.dt, count)
    real = jnp.arange(samples.dt.shape[0], dtype=jnp.int32) < count
    on = (samples.turned & real[:, None]).T
    turn, turning = duty_model.turning(gyr[:, :, 2] - c.worn.bias[:, 2:], on, samples.dt, state.turn)

    def planar(params: DutyCycledParams, k: int) -> PlanarSegment:
        turned, rate = samples.turned[:, k], -gyr[k, :, 1]
        excess = duty_model.excess(params.turn_tilt, turning, samples.dt, jnp.zeros_like(rate))
        return PlanarSegment(
            rate, acc[k, :, 0], acc[k, :, 2], turned | samples.acc_measured[:, k], turned, excess, -c.worn.bias[k, 1],
            c.worn.variance[k],
        )  # fmt: skip

    beliefs, angles, legs = list[tuple[Belief | None, ...]](), list[SegmentEstimate](), list[PyTree]()
    for leg_params, before, places in zip(c.each_leg, state.beliefs, options.legs, strict=True):
        segments = tuple(None if k is None else planar(leg_params, k) for k in places)
        estimates, after = duty_model.over(
            leg_params, segments, before, samples.dt, still, real, accelerometers=options.accelerometers
        )
        beliefs.append(tuple(None if posterior is None else posterior.belief(count - 1) for posterior in after))
        there = [estimate for estimate in estimates if estimate is not None]
        angles += there
        legs += [joints(leg_params, *there)] if len(there) == 2 else []
    each: PyTree = jax.tree.map(lambda *v: jnp.stack(v, axis=1), *angles)
    complete = len(legs) == len(options.legs)
    both: PyTree = jax.tree.map(lambda *v: jnp.stack(v, axis=1), *legs) if complete else (None, None)
    trusted = state.trusted | (lax.cummax(still.astype(jnp.int32)) > 0)
    valid = jnp.all((lost < LOST) & each.valid, axis=1) & trusted
    state = DutyState(tuple(beliefs), slow, lost[count - 1], turn, trusted[-1])
    return state, LegsNow(both[0], both[1], still, valid, each.angle)
