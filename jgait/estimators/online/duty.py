"""Joint angles sample by sample with gyroscopes that are off at times: `duty_cycled_gyro` as a device.

It is the filter with the filler "hold": while a gyroscope is off, its rate is not observed, and gravity and the rigid
link correct the angle. The other fillers repeat earlier strides; they have no form sample by sample. The person stands
when all gyroscopes that are on have been slow for half a second.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from jgait import filtering
from jgait.estimators.duty_cycled_gyro import model as duty_model
from jgait.estimators.duty_cycled_gyro.estimator import joints
from jgait.estimators.duty_cycled_gyro.model_params import (
    DutyOptions,
    LinkParams,
    PlanarSegment,
    SegmentEstimate,
)
from jgait.estimators.duty_cycled_gyro.params import DEFAULT, DutyCycledParams, filter_params, one_side
from jgait.estimators.duty_cycled_gyro.prepare import LOST, NAME, checked, worn
from jgait.estimators.leg_ekf.prepare import SegmentMounting, mounted
from jgait.estimators.online.device import Device, Readings
from jgait.estimators.online.standing import lost_for, standing_samples, stood
from jgait.events.rest import LEGS_RATE, standing_of_legs
from jgait.filtering import Belief, Model
from jgait.notes import Note
from jgait.types import SIDES, Counts, Flags, LegTrajectory, Recording, Values, as_float


class DutyConstants(NamedTuple):
    """Parameters of each leg, in the order right, left; mounting of the k sensors.

    Attributes:
        own: parameters of each leg with a sensor.
        axes: (k, 3, 3) axes of the segments in the sensors' axes [1].
        scale: (k,) factor on the accelerometer [1].
        bias: (k,) sagittal gyroscope bias at rest, positive when the distal end swings forward [rad/s].
        variance: (k,) sagittal gyroscope variance at rest [rad²/s²].
        window: samples for which all gyroscopes must be slow in standing.
        start_variance: variance of the angles at the first sample [rad²].
    """

    own: tuple[DutyCycledParams, ...]
    axes: Values
    scale: Values
    bias: Values
    variance: Values
    window: Counts
    start_variance: Values


class DutyState(NamedTuple):
    """Beliefs about the segments in the order of the sensors, slow samples, (k,) time without a rate [s]."""

    beliefs: tuple[Belief, ...]
    slow: Counts
    lost: Values


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
    """Options of the filters; segments with a sensor of each leg: index of the thigh's and of the shank's, or None."""

    filters: DutyOptions
    sensors: tuple[tuple[int | None, int | None], ...]


def device(p: DutyCycledParams, recording: Recording) -> tuple[Device, tuple[Note, ...]]:
    """The device for a person whose legs' sensors walk in a recording with all gyroscopes on, and notes.

    Raises:
        RecordingError: as `duty_cycled_gyro.prepare.prepare`.
    """
    names = worn(recording)
    time = checked(recording, names, DEFAULT)
    sensors = {name: recording.sensors[name] for name in names}
    rate = 1.0 / float(np.median(np.diff(time)))
    still, (start, stop), notes = standing_of_legs([imu.gyr for imu in sensors.values()], rate, NAME)
    found: list[SegmentMounting] = []
    own, pairs, numbers = [], [], []
    for number, side in enumerate(SIDES):
        here = [segment for segment in ("thigh", "shank") if f"{segment}_{side}" in sensors]
        if not here:
            continue
        # A sensor worn alone is used as thigh and as shank: the sign of the axis follows from its swing alone.
        both = {f"{s}_{side}": sensors[f"{s if s in here else here[0]}_{side}"] for s in ("thigh", "shank")}
        segments, more = mounted(both, side, slice(start, stop), still, rate, estimator=NAME)
        notes += more if len(here) == 2 else []
        index: list[int | None] = []
        for segment in ("thigh", "shank"):
            index.append(len(found) if segment in here else None)
            if segment in here:
                one = segments[segment] if len(here) == 2 else segments["shank"]
                found.append(one if len(here) == 2 else one._replace(placement=f"{segment}_{side}"))
        own.append(one_side(p, number))
        pairs.append((index[0], index[1]))
        numbers.append(number)
    constants = DutyConstants(
        own=tuple(own),
        axes=np.stack([one.axes for one in found]),
        scale=as_float([one.scale for one in found]),
        bias=as_float([-one.bias[1] for one in found]),
        variance=as_float([one.variance for one in found]),
        window=standing_samples(rate),
        start_variance=as_float(0.1),
    )
    gravity = DEFAULT.filters.gravity and all(imu.acc is not None for imu in sensors.values())
    options = DutyDeviceOptions(DEFAULT.filters._replace(gravity=gravity), tuple(pairs))
    placements = tuple(one.placement for one in found)
    return Device("legs", NAME, placements, constants, begin, advance, options, tuple(numbers)), tuple(notes)


def begin(c: DutyConstants, sample: Readings, options: DutyDeviceOptions) -> DutyState:
    """The state before the first sample, see `Device`."""
    del sample
    beliefs: dict[int, Belief] = {}
    for number, (thigh, shank) in enumerate(options.sensors):
        p = filter_params(c.own[number])
        if thigh is not None:
            own = duty_model.link_params(p, p.thigh_sensor)
            beliefs[thigh] = duty_model.thigh_standing(own, 0.0, c.bias[thigh], c.start_variance)
        if shank is not None:
            own = duty_model.link_params(p, p.shank_sensor)
            standing = duty_model.thigh_standing if thigh is None else duty_model.shin_standing
            beliefs[shank] = standing(own, 0.0, c.bias[shank], c.start_variance)
    none = jnp.zeros((), jnp.int32)
    return DutyState(tuple(beliefs[k] for k in sorted(beliefs)), none, jnp.zeros_like(c.scale))


def _filtered(
    model: Model, params: LinkParams, seen: PyTree, belief: Belief, dt: Values, newest: Counts, options: DutyOptions
) -> tuple[Belief, SegmentEstimate]:
    """The filter over a block of samples: belief after the newest, and the segment's angle and rate."""
    observations, controls, mask = seen
    told = filtering.kalman_filter(
        model, params, observations, controls=controls, dt=dt, mask=mask, method=options.method, initial=belief
    )  # fmt: skip
    mean, deviation = told.mean, told.cov.stddev()
    gyro = mean.rate - mean.velocity_bias / params.lever
    return jax.tree.map(lambda leaf: leaf[newest], Belief(told.mean, told.cov)), SegmentEstimate(
        mean.angle, mean.rate, deviation.angle, deviation.rate, gyro, told.nis, told.count, told.log_likelihood,
        told.valid,
    )  # fmt: skip


def _leg(
    c: DutyCycledParams, beliefs: tuple[Belief | None, ...], segments: tuple[PlanarSegment | None, ...], dt: Values,
    still: Flags, count: Counts, filters: DutyOptions,
) -> tuple[list[Belief], list[SegmentEstimate]]:  # fmt: skip
    """Thigh and shank of one leg, those with a sensor: beliefs after the block, and estimates."""
    p = filter_params(c)
    real = jnp.arange(dt.shape[0], dtype=jnp.int32) < count
    after: list[Belief] = []
    found: list[SegmentEstimate] = []
    for segment, before, lever in zip(segments, beliefs, (p.thigh_sensor, p.shank_sensor), strict=True):
        if segment is None or before is None:
            continue
        own = duty_model.link_params(p, lever)
        seen: PyTree
        if found:
            seen = duty_model.observe_shin(p, segment, found[0], dt, still, real, filters)
        else:
            seen = duty_model.observe(p, segment, dt, still, real, filters)
        model = duty_model.SHIN if found else duty_model.THIGH
        belief, estimate = _filtered(model, own, seen, before, dt, count - 1, filters)
        after.append(belief)
        found.append(estimate)
    return after, found


def advance(
    c: DutyConstants, state: DutyState, samples: Readings, count: Counts, options: DutyDeviceOptions
) -> tuple[DutyState, DutyNow]:
    """A block of samples, see `Device`."""
    gyr = -jnp.einsum("kij,bkj->bki", c.axes, samples.gyr)[:, :, 1]
    acc = jnp.einsum("kij,bkj->bki", c.axes, samples.acc) * c.scale[None, :, None]
    slow, still = stood(state.slow, samples, LEGS_RATE, c.window, count)
    lost = lost_for(state.lost, samples.turned, samples.dt, count)
    zero = jnp.zeros_like(samples.dt)

    def planar(k: int | None) -> PlanarSegment | None:
        if k is None:
            return None
        on = samples.turned[:, k]
        return PlanarSegment(
            gyr[:, k], acc[:, k, 0], acc[:, k, 2], on | samples.felt[:, k], on, zero, c.bias[k], c.variance[k]
        )

    beliefs: list[Belief] = []
    found: list[SegmentEstimate] = []
    legs: list[tuple[LegTrajectory, LegTrajectory]] = []
    for own, pair in zip(c.own, options.sensors, strict=True):
        before = tuple(None if k is None else state.beliefs[k] for k in pair)
        after, told = _leg(own, before, tuple(map(planar, pair)), samples.dt, still, count, options.filters)
        beliefs += after
        found += told
        if len(told) == 2:
            legs.append(joints(own, *told))
    both = len(legs) == len(options.sensors)
    leg, stddev = jax.tree.map(lambda *v: jnp.stack(v, axis=1), *legs) if both else (None, None)
    valid = jnp.all(jnp.stack([one.valid for one in found]), axis=0) & jnp.all(lost < LOST, axis=1)
    return DutyState(tuple(beliefs), slow, lost[count - 1]), DutyNow(
        jnp.stack([one.angle for one in found], axis=1), jnp.stack([one.angle_stddev for one in found], axis=1),
        leg, stddev, still, valid,
    )  # fmt: skip
