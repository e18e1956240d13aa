r"""Stride lengths from one sensor at the ankle or on the shank, given the gait events.

Each method is differentiable in leg length, gains, lever, gyroscope bias and cut-off; the events are inputs, and carry
no gradient. Signals are in the axes of the segment (forward x, left y, up z, see `mounting.shank`), so that the rate
about y is negative in the forward swing.

`pendulum`: the angle θ of the swing from toe-off to heel strike,

    SL₁ = 2 L sin(θ/2),    SL₂ = L θ,    SL₂' = L (c θ + e θ / T_swing).

`inertial`: strapdown from one stance instant to the next, q' = q exp(h ω), v' = v + h R(q) f, in the axes of the first
instant; with the velocities of the sensor at both stance instants, v₀ = ω × r and v₁ = R(ω_T × r), r the lever,

    s = ∫ v dt − T v(T)/2 + T (v₀ + v₁)/2 − (R r − r),    up = v(T)/T − (v₁ − v₀)/T.

Any constant acceleration cancels in s, and with it gravity: the length |s| depends neither on the vertical nor on the
sensor's mounting. R r − r is the displacement of the sensor relative to the ankle. `up` is gravity by the same
integral; it gives the horizontal part of s and the rise.

Source: H. D. Silva, J. A. Afonso, L. A. Rocha, "Walk distance estimation using an ankle-mounted inertial measurement
unit", 2017, equations 1 to 6.

Deviations from the paper:
    Effects, where they were measured, are those of `experiments/silva2017`, which has 3 and 5 as printed.

    1. θ is about the sagittal axis; the rate's norm over all axes is 3 to 15 % longer and breaks in turns.
    2. SL₂' has a swing-time term, which makes up for what the supporting leg adds: with e of other people, c learned at
       one speed holds at another to 1.4 % instead of 3.4 % (`tripod`).
    3. The rotation of an interval is exact; equation 3, not normalised, adds 1.6 to 3.5 cm a stride.
    4. The initial velocity is ω × r, not zero, and the stride is that of the ankle, not of the sensor (r = 0): mid
       shank 2.6 instead of 10 cm (`neura_sparse`), 3.6 with the velocity alone.
    5. Up is the mean specific force over the stride instead of one sample of it; the length |s| is the same.
    6. The cut-off is a parameter: with the true lever the 4 Hz of the paper make simulated strides 2 to 3.5 cm too
       long, 8 Hz half a centimetre at most; a lever learned at 4 Hz makes up for it.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.typing import ArrayLike
from jaxtyping import PyTree

from jgait.geometry.rotation import Quaternion, normalised, product, rotated, small_turn
from jgait.geometry.vectors import Vector, add, cross, dot, root, scale, subtract, vector
from jgait.signal.marks import Marks
from jgait.types import Counts, Values


class StrideLengthParams(NamedTuple):
    """Parameters of all methods, in natural units."""

    leg_length: Values = 0.85  #: L, length of the pendulum [m].
    angle_gain: Values = 1.0  #: c, gain of the swing's angle [1].
    time_gain: Values = 0.0  #: e, gain of the angle over the swing's duration [s].
    #: from the point at the ankle that stands to the sensor, forward, left and up in the segment's axes [m].
    lever: Vector = Vector(0.0, 0.0, 0.0)
    gyr_bias: Vector = Vector(0.0, 0.0, 0.0)  #: gyroscope bias, in the segment's axes [rad/s].


class Swung(NamedTuple):
    """Swings (n,): SL₁, SL₂ [m], angle θ [rad], duration T_swing [s]."""

    chord: Values
    arc: Values
    angle: Values
    duration: Values


class Travelled(NamedTuple):
    """A stride, at the sample at which it ends; 0 elsewhere: |s|, its horizontal part and its rise [m], turn about up,
    positive to the left [rad], duration [s].
    """

    length: Values
    level: Values
    rise: Values
    turn: Values
    duration: Values


def pendulum(p: StrideLengthParams, gyr: ArrayLike, begin: Counts, end: Counts, dt: ArrayLike) -> Swung:
    """SL₁ and SL₂ of the swings (n,) of the shank from samples `begin` to samples `end`.

    `gyr` (T, 3) is the unfiltered rate in the segment's axes [rad/s].
    """
    rate = -(jnp.asarray(gyr)[:, 1] - p.gyr_bias.y)
    turned = jnp.cumsum(0.5 * dt * (rate + jnp.concatenate([jnp.zeros_like(rate[:1]), rate[:-1]])))
    angle, duration = turned[end] - turned[begin], dt * (end - begin).astype(rate.dtype)
    arc = p.leg_length * (p.angle_gain * angle + p.time_gain * angle / jnp.where(duration > 0.0, duration, 1.0))
    return Swung(2.0 * p.leg_length * jnp.sin(0.5 * angle), arc, angle, duration)


def inertial(p: StrideLengthParams, gyr: ArrayLike, acc: ArrayLike, strides: Marks, dt: ArrayLike) -> Travelled:
    """Length, rise and turn of each stride by strapdown from stance to stance, (T,) each, at the samples at which they
    end.

    `gyr` [rad/s] and `acc` [m/s²], (T, 3), are in the segment's axes, low-passed; strides begin and end while the
    ankle stands.
    """
    return scanned(partial(_step, p, dt=dt), partial(begun, p), p, gyr, acc, strides)


def scanned(
    step_function: Callable[[PyTree, PyTree], tuple[PyTree, Travelled]], begin: Callable[[Vector, Vector], PyTree],
    p: StrideLengthParams, gyr: ArrayLike, acc: ArrayLike, strides: Marks,
) -> Travelled:  # fmt: skip
    """A scan of a method's step over the samples: (state, (rate, force, marks)) → state and stride.

    `begin` gives the state at the begin of a stride from rate, without its bias, and force. Other arguments as of
    `inertial`.
    """
    samples = subtract(vector(jnp.asarray(gyr)), p.gyr_bias), vector(jnp.asarray(acc)), strides

    def step(state: PyTree, sample: PyTree) -> tuple[PyTree, Travelled]:
        going, travelled = step_function(state, sample)
        travelled = Travelled(*(jnp.where(sample[2].end, value, 0.0) for value in travelled))
        return jax.tree.map(lambda a, b: jnp.where(sample[2].begin, a, b), begin(*sample[:2]), going), travelled

    first = jax.tree.map(lambda v: v[0], samples)
    state = begin(*first[:2])
    # in the dtypes that a step returns, because parameters and signals may differ in precision
    after = jax.eval_shape(lambda s, x: step(s, x)[0], state, first)
    state = jax.tree.map(lambda value, like: jnp.asarray(value, like.dtype), state, after)
    return lax.scan(step, state, samples)[1]


class StrideState(NamedTuple):
    """Integrals since the stride began, in the axes of its first sample."""

    attitude: Quaternion  #: from the axes of this sample to those of the first.
    velocity: Vector  #: ∫ R f dt, with gravity included [m/s].
    way: Vector  #: ∫ of `velocity` [m].
    duration: Values  #: time since the stride began [s].
    start: Vector  #: velocity ω × r at the first sample [m/s].
    gyr: Vector  #: rate of the sample before [rad/s].
    force: Vector  #: specific force of the sample before, in the first axes [m/s²].


def begun(p: StrideLengthParams, w: Vector, f: Vector) -> StrideState:
    """The state at the begin of a stride, from rate [rad/s] and specific force [m/s²]."""
    nothing = jnp.zeros_like(w.x)
    none = Vector(nothing, nothing, nothing)
    level = Quaternion(jnp.ones_like(nothing), nothing, nothing, nothing)
    return StrideState(level, none, none, nothing, cross(w, p.lever), w, f)


def _step(
    p: StrideLengthParams, s: StrideState, sample: tuple[Vector, Vector, Marks], *, dt: Values
) -> tuple[StrideState, Travelled]:
    """One sample of the 3-D method: the state after it, and the stride from its begin to here."""
    w, f, _ = sample
    going = advanced(s, product(s.attitude, normalised(small_turn(scale(0.5 * dt, add(s.gyr, w))))), w, f, dt)
    # A stride of zero duration has zero length; dividing by 1 s keeps the gradient finite.
    long = jnp.where(going.duration > 0.0, going.duration, 1.0)
    stop = rotated(going.attitude, cross(w, p.lever))
    return going, read(p, going, scale(1.0 / long, subtract(going.velocity, subtract(stop, going.start))))


def advanced(s: StrideState, attitude: Quaternion, w: Vector, f: Vector, dt: Values) -> StrideState:
    """The state after a sample of rate [rad/s] and specific force [m/s²] with this attitude."""
    force = rotated(attitude, f)
    velocity = add(s.velocity, scale(0.5 * dt, add(s.force, force)))
    way = add(s.way, scale(0.5 * dt, add(s.velocity, velocity)))
    return StrideState(attitude, velocity, way, s.duration + dt, s.start, w, force)


def read(p: StrideLengthParams, s: StrideState, up: Vector) -> Travelled:
    """The stride from its begin to a state; `up` points up, in the axes of the first sample, of any length."""
    stop = rotated(s.attitude, cross(s.gyr, p.lever))
    drift = scale(-0.5 * s.duration, s.velocity)
    sensor = add(add(s.way, drift), scale(0.5 * s.duration, add(s.start, stop)))
    # The displacement of the ankle, from that of the sensor.
    moved = subtract(sensor, subtract(rotated(s.attitude, p.lever), p.lever))
    norm = root(dot(up, up))
    up = scale(1.0 / jnp.where(norm > 0.0, norm, 1.0), up)
    rise = dot(moved, up)
    flat = subtract(moved, scale(rise, up))
    about = s.attitude.x * up.x + s.attitude.y * up.y + s.attitude.z * up.z
    turn = 2.0 * jnp.arctan2(about, s.attitude.w)
    return Travelled(root(dot(moved, moved)), root(dot(flat, flat)), rise, turn, s.duration)
