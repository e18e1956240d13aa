r"""Change of speed, distance and pendulum step over each interval between nodes, from the accelerometer.

Over a step the trunk rises and falls by h like an inverted pendulum of length ℓ, whose chord is 2√(2ℓh − h²)
(Zijlstra and Hof), and its speed changes by V. Both grow with the step length; their errors vary between people, so

    λ = ℓ · (2√(2h/ℓ − (h/ℓ)²))^α · (V/√(gℓ))^β,        α = 1, β = 0: Zijlstra and Hof.

h is the range of the trunk's height: the upward acceleration, integrated twice, with a high-pass before and after each
integral. V is the range of the forward speed, computed likewise.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import PyTree

from jgait.estimators.programs import compiled
from jgait.estimators.waist.inputs import WaistInputs
from jgait.estimators.waist.motion import TrunkMotion
from jgait.estimators.waist.params import WaistParams
from jgait.geometry.arrays import put, xp
from jgait.geometry.vectors import GRAVITY
from jgait.signal import butterworth
from jgait.types import Flags, Values


class Intervals(NamedTuple):
    """Values over the interval that ends at each node; (K,) each, 0 at the first node and in padding."""

    duration: Values  #: duration of the interval [s].
    gained: Values  #: integral of the forward acceleration [m/s].
    went: Values  #: integral of `gained` over the interval [m].
    pendulum: Values  #: λ, step length of the pendulum, shorter in turns [m].
    turn: Values  #: turn of the walk [rad].


def intervals(p: WaistParams, inputs: WaistInputs, motion: TrunkMotion) -> Intervals:
    """Values over each interval, from the accelerometer, for the motion of the trunk."""
    rate, last = inputs.rate_hz, inputs.last
    steps = inputs.dt

    def fast(x: Values) -> Values:
        return x - butterworth.low_pass_until(x, p.excursion_hz, rate, last)

    def integral(x: Values) -> Values:
        return xp.cumsum(0.5 * steps[:, None] * (x + xp.concatenate([x[:1], x[:-1]])), axis=0)

    upward = xp.where(inputs.valid, motion.upward, 0.0)
    forward = xp.where(inputs.valid, motion.forward, 0.0)
    gentle = butterworth.low_pass_until(forward, 6.0, rate, last)  # [Hz] removes impacts at contacts from the speed
    velocity = fast(integral(fast(xp.stack([upward, gentle], axis=1))))
    height, speed = fast(integral(velocity[:, :1]))[:, 0], velocity[:, 1]
    node = put(xp.zeros_like(inputs.valid), inputs.at, True)
    after = xp.concatenate([xp.ones_like(node[:1]), node[:-1]])

    ranges_of = compiled(_ranges)(after, steps, forward, height, speed)
    row = xp.arange(inputs.at.shape[0], dtype=xp.int32)
    there = (row > 0) & (row < inputs.count)
    before = inputs.at[xp.maximum(row - 1, 0)]
    gained, went, excursion, surge = (xp.where(there, values[inputs.at], 0.0) for values in ranges_of)
    duration = xp.where(there, (inputs.at - before).astype(forward.dtype) / rate, 0.0)
    turn = xp.where(there, motion.heading[inputs.at] - motion.heading[before], 0.0)
    steps_of = xp.exp(-p.turn_shortening * xp.abs(turn)) * pendulum(p, excursion, surge)
    return Intervals(duration, gained, went, steps_of, turn)


def _ranges(after: Flags, steps: Values, forward: Values, height: Values, speed: Values) -> tuple[Values, ...]:
    """(T,) each: forward acceleration integrated since the last node, once and twice; ranges of height and speed.
    `after` (T,) is True where a node was the sample before.
    """

    def accumulate(carry: PyTree, sample: PyTree) -> PyTree:
        change, way, top, bottom, fastest, slowest, before = carry
        restart, dt, a, z, v = sample
        a_before, z_before, v_before = before
        here = jnp.where(restart, 0.0, change)
        now = here + 0.5 * dt * (a + a_before)
        went = jnp.where(restart, 0.0, way) + 0.5 * dt * (here + now)
        ranges = (
            jnp.maximum(jnp.where(restart, z_before, top), z),
            jnp.minimum(jnp.where(restart, z_before, bottom), z),
            jnp.maximum(jnp.where(restart, v_before, fastest), v),
            jnp.minimum(jnp.where(restart, v_before, slowest), v),
        )
        return (now, went, *ranges, (a, z, v)), (now, went, ranges[0] - ranges[1], ranges[2] - ranges[3])

    zero = jnp.zeros_like(forward[0])
    first = (zero, zero, height[0], height[0], speed[0], speed[0], (forward[0], height[0], speed[0]))
    return lax.scan(accumulate, first, (after, steps, forward, height, speed))[1]


def pendulum(p: WaistParams, excursion: Values, surge: Values) -> Values:
    """λ of steps [m] from the ranges of the trunk's height and forward speed [m, m/s]; 0 where one is almost zero."""
    high = xp.minimum(excursion / p.pendulum_length, 1.0)
    quick = surge / xp.sqrt(GRAVITY * p.pendulum_length)
    there = (high > 1e-6) & (quick > 1e-6)
    high, quick = xp.where(there, high, 0.1), xp.where(there, quick, 0.1)
    chord = xp.log(2.0) + 0.5 * xp.log(high * (2.0 - high))
    relative = xp.exp(p.excursion_power * chord + p.surge_power * xp.log(quick))
    return xp.where(there, p.pendulum_length * relative, 0.0)
