r"""How the trunk moves, from one sensor on it: accelerations forward, to the left and upwards, and its turning.

With the attitude of `waist.orientation`, u up in the trunk's axes and x the trunk's axis forward,

    h = (x − (x·u) u) / |…|,    l = u × h,    a_f = f·h,  a_l = f·l,  a_u = f·u − g,    ω_u = ω·u.

The walking direction is where h looks on average: a low-pass on the heading, below the rate of strides, parts the turns
of the walk from those of the pelvis, and the level accelerations are turned by the difference.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import PyTree

from jgait import filtering
from jgait.estimators.waist import orientation as waist_orientation
from jgait.estimators.waist.inputs import WaistInputs
from jgait.estimators.waist.orientation import TrunkControl, TrunkError, TrunkNoise, TrunkObservation, TrunkState
from jgait.estimators.waist.params import WaistParams
from jgait.filtering.execution import Execution
from jgait.geometry.rotation import Quaternion, rotated
from jgait.geometry.vectors import GRAVITY, Vector, subtract, vector
from jgait.signal import butterworth
from jgait.types import Values

LOST_RATE = 0.5
"""[rad/s] How wrong the rate may be where it was lost."""


class TrunkMotion(NamedTuple):
    """How the trunk moves; (T,) each.

    Attributes:
        forward: acceleration along the walking direction [m/s²].
        left: to its left [m/s²].
        upward: without gravity [m/s²].
        yaw_rate: about the vertical, a turn to the left positive [rad/s].
        heading: of the walk, from about 0 at the first sample [rad].
    """

    forward: Values
    left: PyTree
    upward: Values
    yaw_rate: Values
    heading: Values


def motion(p: WaistParams, inputs: WaistInputs, *, smooth: bool = True, execution: Execution = "dense") -> TrunkMotion:
    """How the trunk moves.

    Args:
        p: parameters.
        inputs: signals; decisions on steps are not used.
        smooth: whether later samples judge earlier ones; static.
        execution: see `jgait.filtering`.
    """
    return _seen(p, inputs, _attitude(p, inputs, smooth=smooth, execution=execution).mean)


def motion_and_likelihood(
    p: WaistParams, inputs: WaistInputs, *, execution: Execution = "dense"
) -> tuple[TrunkMotion, Values]:
    """How the trunk moves by the filter alone, and the log-likelihood of what the accelerometer reads.

    A gyroscope that turns the other way makes it less: what leans by gravity then leans the other way by rate.

    Args:
        p: parameters.
        inputs: signals; decisions on steps are not used.
        execution: see `jgait.filtering`.
    """
    posterior = _attitude(p, inputs, smooth=False, execution=execution)
    return _seen(p, inputs, posterior.mean), jnp.sum(posterior.log_likelihood)


def _seen(p: WaistParams, inputs: WaistInputs, state: TrunkState) -> TrunkMotion:
    """What an attitude makes of both sensors' readings."""
    one, none = jnp.ones_like(inputs.dt), jnp.zeros_like(inputs.dt)
    force = rotated(state.attitude, subtract(vector(inputs.acc), state.acc_bias))
    rate = rotated(state.attitude, subtract(vector(inputs.gyr), state.gyr_bias))
    ahead = rotated(state.attitude, Vector(one, none, none))
    counts = inputs.measured
    x, y, z = (jnp.where(counts, part, 0.0) for part in (force.x, force.y, force.z - GRAVITY))
    yaw_rate = jnp.where(counts, rate.z, 0.0)
    # the heading without its jumps by a whole turn: the angle moves by what the rate says, within half a turn
    first = jnp.arctan2(ahead.y[0], ahead.x[0])
    yaw = first + jnp.cumsum(yaw_rate * inputs.dt)
    heading = butterworth.low_pass_until(yaw, p.heading_hz, inputs.rate_hz, inputs.last)
    off = heading - yaw
    level = jnp.sqrt(jnp.maximum(ahead.x * ahead.x + ahead.y * ahead.y, 1e-12))
    c, s = ahead.x / level, ahead.y / level
    cosine, sine = c * jnp.cos(off) - s * jnp.sin(off), s * jnp.cos(off) + c * jnp.sin(off)
    return TrunkMotion(cosine * x + sine * y, cosine * y - sine * x, z, yaw_rate, heading)


def _attitude(p: WaistParams, inputs: WaistInputs, *, smooth: bool, execution: Execution) -> Values:
    """Attitude and biases at each sample: what the filter, or the smoother, gives."""
    gyr = vector(0.5 * (inputs.gyr + jnp.concatenate([inputs.gyr[:1], inputs.gyr[:-1]])))
    lost = jnp.where(inputs.measured, 0.0, LOST_RATE)
    density = jnp.where(inputs.still, p.standing_noise**2, p.acc_noise**2)
    controls = TrunkControl(gyr, vector(inputs.acc), p.gyr_noise**2 + lost * lost * inputs.dt, density * inputs.rate_hz)
    zero = jnp.zeros_like(inputs.dt)
    settled = p.gyr_noise * p.acc_noise / GRAVITY + inputs.start_variance
    known = [jnp.zeros_like(inputs.rate_hz) + v for v in (settled, p.gyr_bias**2, p.sensor_bias**2)]
    start = waist_orientation.belief(
        Quaternion(*(inputs.attitude[i] for i in range(4))), vector(inputs.gyr_bias),
        TrunkError(*(Vector(v, v, v) for v in known)),
    )  # fmt: skip
    solve = filtering.kalman_smoother if smooth else filtering.kalman_filter
    return solve(
        waist_orientation.MODEL,
        TrunkNoise(p.gyr_bias_walk**2, p.sensor_bias_walk**2),
        TrunkObservation(Vector(zero, zero, zero)),
        controls=controls,
        dt=inputs.dt,
        mask=inputs.measured,
        initial=start,
        execution=execution,
    )
