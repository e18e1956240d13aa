r"""Stride lengths from one sensor at the ankle or on the shank, given the gait events.

Each method is a `lax.scan` from event to event in constant memory, and differentiable in leg length, gains, lever,
sensor biases and cut-off; the events are inputs, and carry no gradient. Signals are in the axes of the segment
(forward x, left y, up z, see `mounting.shank`), so that the rate about y is negative in the forward swing.

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
    Effects, where they were measured, are those of `experiments/silva2017`.

    1. θ is about the sagittal axis; the rate's norm over all axes (`all_axes`) is 3 to 15 % longer and breaks in turns.
    2. SL₂' has a swing-time term, which makes up for what the supporting leg adds: with e of other people, c learned at
       one speed holds at another to 1.4 % instead of 3.4 % (`tripod`).
    3. The rotation of an interval is exact; equation 3 (`euler`), not normalised, adds 1.6 to 3.5 cm a stride.
    4. The initial velocity is ω × r, not zero, and the stride is that of the ankle, not of the sensor (r = 0): mid
       shank 2.6 instead of 10 cm (`neura_sparse`), 3.6 with the velocity alone.
    5. Up is the mean specific force over the stride instead of one sample of it (`sample_up`). The length |s| is the
       same, and its gradient in that sample is zero, as in the events'.
    6. The cut-off is an argument (`smoothed`): with the true lever the paper's 4 Hz make simulated strides 2 to 3.5 cm
       too long, 8 Hz half a centimetre at most; a lever learned at 4 Hz makes up for it.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike
from jaxtyping import PyTree

from jgait.estimators.ankle_stride.length_steps import (
    StrideLengthParams,
    Swung,
    Travelled,
    stride_begin,
    stride_step,
    swing_begin,
    swing_step,
)
from jgait.geometry.vectors import Vector
from jgait.signal import butterworth
from jgait.signal.marks import Marks, marks
from jgait.types import Scalar, Values

__all__ = ["Marks", "StrideLengthParams", "Swung", "Travelled", "inertial", "marks", "pendulum", "scanned", "smoothed"]


def smoothed(signal: ArrayLike, cutoff_hz: Scalar | None, sampling_rate_hz: float) -> Array:
    """Low-pass of a (T, 3) signal without delay, for the inertial methods; the paper has 4 Hz, None no filter."""
    values = jnp.asarray(signal)
    return values if cutoff_hz is None else butterworth.low_pass_both_ways(values, cutoff_hz, sampling_rate_hz)


def pendulum(p: StrideLengthParams, gyr: ArrayLike, swings: Marks, dt: ArrayLike, *, all_axes: bool = False) -> Swung:
    """SL₁ and SL₂ of each swing, (T,) each, at the samples at which swings of the shank end.

    `gyr` (T, 3) is the unfiltered rate in the segment's axes [rad/s]; `all_axes` takes the paper's norm of the rate
    instead of the sagittal rate.

    Raises:
        ValueError: if the shapes do not fit.
    """
    rate = _vector(gyr, swings)
    state = swing_begin(Vector(*(v[0] for v in rate)))

    def one(s: PyTree, x: PyTree) -> PyTree:
        return swing_step(p, s, x[0], x[1], dt, all_axes=all_axes)

    found: Swung = lax.scan(one, _typed(one, state, (rate, swings)), (rate, swings))[1]
    return found


def inertial(
    p: StrideLengthParams, gyr: ArrayLike, acc: ArrayLike, strides: Marks, dt: ArrayLike, *,
    euler: bool = False, sample_up: bool = False,
) -> Travelled:  # fmt: skip
    """Length, rise and turn of each stride by strapdown from stance to stance, (T,) each, at the samples at which they
    end.

    `gyr` [rad/s] and `acc` [m/s²], (T, 3), are in the segment's axes, see `smoothed`; strides begin and end while the
    ankle stands. `euler` takes the paper's equation 3, `sample_up` its direction of gravity from one sample.

    Raises:
        ValueError: if the shapes do not fit.
    """

    def one(s: PyTree, x: PyTree) -> PyTree:
        return stride_step(p, s, x[0], x[1], x[2], dt, euler=euler, sample_up=sample_up)

    return scanned(one, stride_begin, p, gyr, acc, strides)


def scanned(
    one: Callable[[Values, Values], Values],
    begin: PyTree,
    p: StrideLengthParams,
    gyr: Values,
    acc: Values,
    strides: Marks,
) -> Travelled:
    """A scan of a method's step `one` over the samples, from the state of `begin`; other arguments as of `inertial`."""
    rate, force = _vector(gyr, strides), _vector(acc, strides)
    state = begin(p, Vector(*(v[0] for v in rate)), Vector(*(v[0] for v in force)))
    samples = (rate, force, strides)
    found: Travelled = lax.scan(one, _typed(one, state, samples), samples)[1]
    return found


def _vector(signal: Values, flags: Marks) -> Vector:
    values = jnp.asarray(signal)
    if values.ndim != 2 or values.shape[1] != 3 or values.shape[0] < 1:
        raise ValueError(f"signals must be (T, 3) with T >= 1; got shape {values.shape}")
    if any(jnp.shape(flag) != values.shape[:1] for flag in flags):
        raise ValueError(f"flags must be ({values.shape[0]},) as the signals; got {[jnp.shape(f) for f in flags]}")
    return Vector(*values.T)


def _typed(one: Callable[[Values, Values], Values], state: PyTree, samples: PyTree) -> PyTree:
    """The first state in the dtypes that a step returns, because parameters and signals may differ in precision."""
    after = jax.eval_shape(lambda s, x: one(s, x)[0], state, jax.tree.map(lambda v: v[0], samples))
    return jax.tree.map(lambda value, like: jnp.asarray(value, like.dtype), state, after)
