r"""Accelerations of the trunk (forward, left, up), its yaw rate and the heading of the walk, from one sensor on it.

With the attitude of `waist.orientation`, the vertical u in the trunk's axes and the trunk's forward axis x,

    h = (x − (x·u) u) / |…|,    l = u × h,    a_f = f·h,  a_l = f·l,  a_u = f·u − g,    ω_u = ω·u.

The walking direction is the low-passed direction of h: a low-pass on the heading, with a cut-off below the stride rate,
separates turns of the walk from turns of the pelvis. The horizontal accelerations are rotated by the difference.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import PyTree

from jgait import filtering
from jgait.estimators.programs import compiled
from jgait.estimators.waist import orientation as waist_orientation
from jgait.estimators.waist.inputs import WaistInputs
from jgait.estimators.waist.orientation import TrunkControl, TrunkError, TrunkNoise, TrunkObservation, TrunkState
from jgait.estimators.waist.params import WaistParams
from jgait.geometry.arrays import xp
from jgait.geometry.rotation import quaternion, rotated
from jgait.geometry.vectors import GRAVITY, Vector, vector
from jgait.signal import butterworth
from jgait.types import Flags, Values


class TrunkMotion(NamedTuple):
    """Motion of the trunk; (T,) each."""

    forward: Values  #: acceleration along the walking direction [m/s²].
    left: PyTree  #: acceleration to the left of the walking direction [m/s²].
    upward: Values  #: vertical acceleration without gravity [m/s²].
    yaw_rate: Values  #: angular rate about the vertical, a turn to the left positive [rad/s].
    heading: Values  #: heading of the walk, from about 0 at the first sample [rad].
    roll_rate: PyTree  #: angular rate about the walking direction, the left side rising positive [rad/s].


def motion(
    p: WaistParams, inputs: WaistInputs, *, smooth: bool = True, method: filtering.Method = filtering.EKF()
) -> TrunkMotion:
    """Motion of the trunk; with `smooth`, later samples correct earlier attitudes. Decisions on steps are not used."""
    return _seen(p, inputs, _attitude(p, inputs, smooth, method).mean)


def filtered_motion(p: WaistParams, inputs: WaistInputs) -> TrunkMotion:
    """Motion of the trunk by the filter alone. The smoothed states are not used, but so the program is that of
    `motion`.
    """
    return _seen(p, inputs, _attitude(p, inputs, True, filtering.EKF()).filtered.mean)


def _seen(p: WaistParams, inputs: WaistInputs, state: TrunkState) -> TrunkMotion:
    """Motion of the trunk from an attitude and the readings of gyroscope and accelerometer."""
    ones, zeros = xp.ones_like(inputs.dt), xp.zeros_like(inputs.dt)
    attitude = quaternion(state.attitude)
    force = rotated(attitude, vector(inputs.acc - state.acc_bias))
    rate = rotated(attitude, vector(inputs.gyr - state.gyr_bias))
    ahead = rotated(attitude, Vector(ones, zeros, zeros))
    counts = inputs.measured
    x, y, z = (xp.where(counts, part, 0.0) for part in (force.x, force.y, force.z - GRAVITY))
    roll, pitch, yaw_rate = (xp.where(counts, part, 0.0) for part in rate)
    # the heading without jumps by a whole turn: the first heading plus the integral of the yaw rate
    first = xp.arctan2(ahead.y[0], ahead.x[0])
    yaw = first + xp.cumsum(yaw_rate * inputs.dt)
    heading = butterworth.low_pass_until(yaw, p.heading_hz, inputs.rate_hz, inputs.last)
    off = heading - yaw
    level = xp.sqrt(xp.maximum(ahead.x * ahead.x + ahead.y * ahead.y, 1e-12))
    c, s = ahead.x / level, ahead.y / level
    cosine, sine = c * xp.cos(off) - s * xp.sin(off), s * xp.cos(off) + c * xp.sin(off)
    return TrunkMotion(
        cosine * x + sine * y, cosine * y - sine * x, z, yaw_rate, heading, cosine * roll + sine * pitch
    )  # fmt: skip


def _attitude(p: WaistParams, inputs: WaistInputs, smooth: bool, method: filtering.Method) -> filtering.Inferred:
    """Attitude and biases at each sample, by the filter and, if `smooth`, by the smoother."""
    gyr = 0.5 * (inputs.gyr + xp.concatenate([inputs.gyr[:1], inputs.gyr[:-1]]))
    lost = xp.where(inputs.measured, 0.0, 0.5)  # [rad/s] of the rate at lost samples
    density = xp.where(inputs.still, p.standing_noise**2, p.acc_noise**2)
    controls = TrunkControl(gyr, inputs.acc, p.gyr_noise**2 + lost * lost * inputs.dt, density * inputs.rate_hz)
    settled = p.gyr_noise * p.acc_noise / GRAVITY + inputs.start_variance
    known = [xp.zeros_like(inputs.rate_hz) + v for v in (settled, p.gyr_bias**2, p.sensor_bias**2)]
    start = waist_orientation.belief(inputs.attitude, inputs.gyr_bias, TrunkError(*known))
    noise = TrunkNoise(p.gyr_bias_walk**2, p.sensor_bias_walk**2)
    return compiled(_states)(noise, controls, inputs.dt, inputs.measured, start, smooth=smooth, method=method)


def _states(
    noise: TrunkNoise, controls: TrunkControl, dt: Values, measured: Flags, start: filtering.Belief, smooth: bool,
    method: filtering.Method,
) -> filtering.Inferred:  # fmt: skip
    return filtering.infer(
        waist_orientation.MODEL, noise, TrunkObservation(jnp.zeros_like(controls.acc)), smooth=smooth,
        controls=controls, dt=dt, mask=measured, initial=start, method=method, keep=("mean", "nis"), covariance=False,
    )  # fmt: skip
