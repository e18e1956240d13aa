"""Stride lengths sample by sample: the steps that `ankle_stride.length` scans; `length` gives equations and sources.

Each method has two functions, for its first state and for its step over one sample, so that a device can measure during
the walk. Signals are in the axes of the segment: forward x, left y, up z.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from jgait.geometry.rotation import Quaternion, exponential, product, rotated
from jgait.geometry.vectors import Vector, add, cross, dot, root, scale, subtract
from jgait.signal.marks import Marks
from jgait.types import Flags, Values


class StrideLengthParams(NamedTuple):
    """Parameters of all methods, in natural units.

    Attributes:
        leg_length: L, length of the pendulum [m].
        angle_gain: c, gain of the swing's angle [1].
        time_gain: e, gain of the angle over the swing's duration [s].
        lever: from the point at the ankle that stands to the sensor, forward, left and up in the segment's axes [m].
        gyr_bias: gyroscope bias, in the segment's axes [rad/s].
        acc_bias: accelerometer bias, in the segment's axes [m/s²].
    """

    leg_length: Values = 0.85
    angle_gain: Values = 1.0
    time_gain: Values = 0.0
    lever: Vector = Vector(0.0, 0.0, 0.0)
    gyr_bias: Vector = Vector(0.0, 0.0, 0.0)
    acc_bias: Vector = Vector(0.0, 0.0, 0.0)


class Swung(NamedTuple):
    """A swing, at the sample at which it ends; 0 elsewhere: SL₁, SL₂ [m], angle θ [rad], duration T_swing [s]."""

    chord: Values
    arc: Values
    angle: Values
    duration: Values


class Travelled(NamedTuple):
    """A stride, at the sample at which it ends; 0 elsewhere: |s|, its horizontal part and its rise [m], turn, duration
    [s].

    The turn about up from begin to end is positive to the left [rad].
    """

    length: Values
    level: Values
    rise: Values
    turn: Values
    duration: Values


class SwingState(NamedTuple):
    """Integrals since the swing began: angle [rad] and duration [s]; and the rate of the sample before [rad/s]."""

    angle: Values
    duration: Values
    rate: Values


def swing_begin(gyr: Vector) -> SwingState:
    """The state at the first sample."""
    nothing = jnp.zeros_like(gyr.y)
    return SwingState(nothing, nothing, nothing)


def swing_step(
    p: StrideLengthParams, s: SwingState, gyr: Vector, mark: Marks, dt: Values, *, all_axes: bool = False
) -> tuple[SwingState, Swung]:
    """Step of the pendulum methods over one sample: the state after it, and the swing if a swing ended.

    `gyr` is the rate in the segment's axes [rad/s]; `all_axes` takes the paper's norm instead of the sagittal rate.
    """
    w = subtract(gyr, p.gyr_bias)
    rate = root(w.x * w.x + w.y * w.y + w.z * w.z) if all_axes else -w.y
    angle, duration = s.angle + 0.5 * dt * (rate + s.rate), s.duration + dt
    long = jnp.where(mark.end, duration, 1.0)
    found = Swung(
        2.0 * p.leg_length * jnp.sin(0.5 * angle),
        p.leg_length * (p.angle_gain * angle + p.time_gain * angle / long),
        angle,
        duration,
    )
    found = Swung(*(jnp.where(mark.end, value, 0.0) for value in found))
    kept = jnp.where(mark.begin, 0.0, 1.0)
    return SwingState(kept * angle, kept * duration, rate), found


class StrideState(NamedTuple):
    """Integrals since the stride began, in the axes of its first sample.

    Attributes:
        attitude: from the axes of this sample to those of the first.
        velocity: ∫ R f dt, with gravity included [m/s].
        way: ∫ of `velocity` [m].
        duration: time since the stride began [s].
        start: velocity ω × r at the first sample [m/s].
        sampled: specific force at the first sample [m/s²].
        gyr: rate of the sample before [rad/s].
        force: specific force of the sample before, in the first axes [m/s²].
    """

    attitude: Quaternion
    velocity: Vector
    way: Vector
    duration: Values
    start: Vector
    sampled: Vector
    gyr: Vector
    force: Vector


def _stride_from(p: StrideLengthParams, w: Vector, f: Vector) -> StrideState:
    nothing = jnp.zeros_like(w.x)
    none = Vector(nothing, nothing, nothing)
    level = Quaternion(jnp.ones_like(nothing), nothing, nothing, nothing)
    return StrideState(level, none, none, nothing, cross(w, p.lever), f, w, f)


def stride_begin(p: StrideLengthParams, gyr: Vector, acc: Vector) -> StrideState:
    """The state at the first sample."""
    return _stride_from(p, subtract(gyr, p.gyr_bias), subtract(acc, p.acc_bias))


def _restarted(where: Flags, fresh: StrideState, going: StrideState) -> StrideState:
    state: StrideState = jax.tree.map(lambda a, b: jnp.where(where, a, b), fresh, going)
    return state


def _trapezoid(total: Vector, dt: Values, before: Vector, now: Vector) -> Vector:
    return add(total, scale(0.5 * dt, add(before, now)))


def stride_step(
    p: StrideLengthParams, s: StrideState, gyr: Vector, acc: Vector, mark: Marks, dt: Values, *,
    euler: bool = False, sample_up: bool = False,
) -> tuple[StrideState, Travelled]:  # fmt: skip
    """Step of the 3-D method over one sample: the state after it, and the stride if a stride ended.

    `gyr` [rad/s] and `acc` [m/s²] are in the segment's axes; `euler` takes the paper's equation 3, `sample_up` its
    direction of gravity from the first sample.
    """
    w, f = subtract(gyr, p.gyr_bias), subtract(acc, p.acc_bias)
    if euler:
        small = product(s.attitude, Quaternion(0.0, *scale(0.5 * dt, w)))
        attitude = Quaternion(*(a + b for a, b in zip(s.attitude, small, strict=True)))
    else:
        attitude = product(s.attitude, exponential(scale(0.5 * dt, add(s.gyr, w))))
    force = rotated(attitude, f)
    velocity = _trapezoid(s.velocity, dt, s.force, force)
    way = _trapezoid(s.way, dt, s.velocity, velocity)
    duration = s.duration + dt
    going = StrideState(attitude, velocity, way, duration, s.start, s.sampled, w, force)
    found = _read(p, going, sample_up=sample_up)
    found = Travelled(*(jnp.where(mark.end, value, 0.0) for value in found))
    return _restarted(mark.begin, _stride_from(p, w, f), going), found


def _read(p: StrideLengthParams, s: StrideState, *, sample_up: bool) -> Travelled:
    # A stride of zero duration has zero length; dividing by 1 s keeps the gradient finite.
    long = jnp.where(s.duration > 0.0, s.duration, 1.0)
    stop = rotated(s.attitude, cross(s.gyr, p.lever))
    drift = scale(-0.5 * s.duration, s.velocity)
    sensor = add(add(s.way, drift), scale(0.5 * s.duration, add(s.start, stop)))
    # The displacement of the ankle, from that of the sensor.
    moved = subtract(sensor, subtract(rotated(s.attitude, p.lever), p.lever))
    up = s.sampled if sample_up else scale(1.0 / long, subtract(s.velocity, subtract(stop, s.start)))
    norm = root(dot(up, up))
    up = scale(1.0 / jnp.where(norm > 0.0, norm, 1.0), up)
    rise = dot(moved, up)
    flat = subtract(moved, scale(rise, up))
    about = s.attitude.x * up.x + s.attitude.y * up.y + s.attitude.z * up.z
    turn = 2.0 * jnp.arctan2(about, s.attitude.w)
    return Travelled(root(dot(moved, moved)), root(dot(flat, flat)), rise, turn, s.duration)
