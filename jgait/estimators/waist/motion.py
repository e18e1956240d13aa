r"""Attitude and accelerations of the trunk, its yaw rate and the heading of the walk, from one sensor on it.

A Kalman filter follows the attitude and the biases of gyroscope and accelerometer. State: the attitude q_ws in a world
with z up, the gyroscope bias b_g and the accelerometer bias b_a. Errors of the attitude are rotation vectors in the
world, δ with q' = exp(δ) q. Over an interval h with the mean rate ω,

    q' = q exp(h (ω − b_g)),        z = R(q) (f − b_a) = (0, 0, g) + noise.

The noise of z is the acceleration of the trunk, small while standing and large while walking; while walking, tilt
follows the gyroscope over seconds and gravity over longer times. An accelerometer bias looks like a lean that turns
with the trunk; a turn of the walk separates bias from lean. Heading has no reference and is not needed. The covariance
at the start is small if the person stands: a large one takes the push of the first step for a lean.

With the vertical u in the trunk's axes and the trunk's forward axis x,

    h = (x − (x·u) u) / |…|,    l = u × h,    a_f = f·h,  a_l = f·l,  a_u = f·u − g,    ω_u = ω·u.

The walking direction is the low-passed direction of h: a low-pass on the heading, with a cut-off below the stride rate,
separates turns of the walk from turns of the pelvis. The horizontal accelerations are rotated by the difference.

Source: gravity as reference of a Kalman filter on attitude after A. M. Sabatini, "Kalman-filter-based orientation
determination using inertial/magnetic sensors", Sensors 11(10), 2011; Köse and others cite their own, whose equations
and parameters are not printed.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, PyTree

from jgait import filtering
from jgait.estimators.programs import compiled
from jgait.estimators.waist.inputs import WaistInputs
from jgait.estimators.waist.params import WaistParams
from jgait.filtering import Belief, Covariance, Model
from jgait.geometry.arrays import xp
from jgait.geometry.rotation import differences, normalised, product, quaternion, retract, rotated, small_turn
from jgait.geometry.vectors import GRAVITY, Three, Vector, as_array, vector
from jgait.signal import butterworth
from jgait.types import AnyArray, Flags, Values


class TrunkState(NamedTuple):
    """Attitude q_ws, biases of gyroscope [rad/s] and accelerometer [m/s²] in the sensor's axes."""

    attitude: Float[AnyArray, "*batch 4"]
    gyr_bias: Three
    acc_bias: Three


class TrunkError(NamedTuple):
    """Error of a `TrunkState`; that of the attitude is a rotation vector in the world [rad]. As variances: a number is
    the variance of each component.
    """

    attitude: Three | Values
    gyr_bias: Three | Values
    acc_bias: Three | Values


class TrunkControl(NamedTuple):
    """Readings of the sensor and variances of their errors."""

    gyr: Three  #: mean angular rate over the interval [rad/s].
    acc: Three  #: specific force at the sample [m/s²].
    gyr_density: Values  #: spectral density of the rate's error [rad²/s].
    acc_variance: Values  #: variance of the trunk's acceleration, taken as white from sample to sample [m²/s⁴].


class TrunkObservation(NamedTuple):
    """Specific force in the world minus gravity [m/s²], zero on average."""

    force: Three | Values


class TrunkNoise(NamedTuple):
    """Parameters of the model, few, because their gradient is carried through all samples."""

    gyr_bias_walk: Values  #: spectral density of the gyroscope bias's random walk [rad²/s³].
    acc_bias_walk: Values  #: the same for the accelerometer bias [m²/s⁵].


def transition(p: TrunkNoise, s: TrunkState, u: TrunkControl, dt: Values) -> TrunkState:
    """The attitude rotated by the angular rate over one interval."""
    del p
    turned = product(quaternion(s.attitude), normalised(small_turn(vector(dt * (u.gyr - s.gyr_bias)))))
    return TrunkState(as_array(turned), s.gyr_bias, s.acc_bias)


def transition_noise(p: TrunkNoise, s: TrunkState, u: TrunkControl, dt: Values) -> TrunkError:
    """Process noise of the attitude, from the rate's error over the interval, and of both biases."""
    del s
    return TrunkError(u.gyr_density * dt, p.gyr_bias_walk * dt, p.acc_bias_walk * dt)


def observation(p: TrunkNoise, s: TrunkState, u: TrunkControl) -> TrunkObservation:
    """The specific force in the world, without gravity."""
    del p
    force = rotated(quaternion(s.attitude), vector(u.acc - s.acc_bias))
    return TrunkObservation(as_array((force.x, force.y, force.z - GRAVITY)))


def observation_noise(p: TrunkNoise, s: TrunkState, u: TrunkControl) -> TrunkObservation:
    """Variance of the trunk's acceleration."""
    del p, s
    return TrunkObservation(u.acc_variance)


def local(reference: TrunkState, s: TrunkState) -> TrunkError:
    """The error of the state `s` relative to `reference`."""
    return TrunkError(*differences(reference, s))


def initial(p: TrunkNoise) -> Belief:
    """The belief of an upright trunk, the sensor's z axis up, biases zero with small variances."""
    del p
    return belief(np.eye(4)[0], np.zeros(3), TrunkError(1e-3, 1e-4, 1e-2))


def belief(attitude: Values, gyr_bias: Values, variances: TrunkError) -> Belief:
    """The belief before the first sample: attitude q_ws with arbitrary heading, gyroscope bias [rad/s]."""
    return Belief(TrunkState(attitude, gyr_bias, xp.zeros_like(gyr_bias)), Covariance.from_variances(variances))


MODEL = Model(initial, transition, transition_noise, observation, observation_noise, retract, local)
"""The model of one sensor on the trunk."""


class TrunkMotion(NamedTuple):
    """Motion of the trunk; (T,) each."""

    forward: Values  #: acceleration along the walking direction [m/s²].
    left: PyTree  #: acceleration to the left of the walking direction [m/s²].
    upward: Values  #: vertical acceleration without gravity [m/s²].
    yaw_rate: Values  #: angular rate about the vertical, a turn to the left positive [rad/s].
    heading: Values  #: heading of the walk, from about 0 at the first sample [rad].
    roll_rate: PyTree  #: angular rate about the walking direction, the left side rising positive [rad/s].


def motion(
    p: WaistParams, inputs: WaistInputs, *, smooth: bool = True, method: filtering.Method = filtering.EKF(),
    filtered: bool = False,
) -> TrunkMotion:  # fmt: skip
    """Motion of the trunk; with `smooth`, later samples correct earlier attitudes, unless states are to be the
    `filtered` ones, by the same program. Decisions on steps are not used.
    """
    gyr = 0.5 * (inputs.gyr + xp.concatenate([inputs.gyr[:1], inputs.gyr[:-1]]))
    lost = xp.where(inputs.measured, 0.0, 0.5)  # [rad/s] of the rate at lost samples
    density = xp.where(inputs.still, p.standing_noise**2, p.acc_noise**2)
    controls = TrunkControl(gyr, inputs.acc, p.gyr_noise**2 + lost * lost * inputs.dt, density * inputs.rate_hz)
    settled = p.gyr_noise * p.acc_noise / GRAVITY + inputs.start_variance
    known = [xp.zeros_like(inputs.rate_hz) + v for v in (settled, p.gyr_bias**2, p.sensor_bias**2)]
    start = belief(inputs.attitude, inputs.gyr_bias, TrunkError(*known))
    noise = TrunkNoise(p.gyr_bias_walk**2, p.sensor_bias_walk**2)
    run = compiled(_states)
    inferred = run(noise, controls, inputs.dt, inputs.measured, start, smooth=smooth, method=method)
    state = inferred.filtered.mean if filtered else inferred.mean
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


def _states(
    p: TrunkNoise, controls: TrunkControl, dt: Values, measured: Flags, start: filtering.Belief, smooth: bool,
    method: filtering.Method,
) -> filtering.Inferred:  # fmt: skip
    return filtering.infer(
        MODEL, p, TrunkObservation(jnp.zeros_like(controls.acc)), smooth=smooth,
        controls=controls, dt=dt, mask=measured, initial=start, method=method, keep=("mean", "nis"), covariance=False,
    )  # fmt: skip
