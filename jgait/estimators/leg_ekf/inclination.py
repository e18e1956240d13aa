r"""Inclination of a body segment: a Kalman filter on the direction of the vertical in segment axes.

The gyroscope predicts the direction; the accelerometer corrects it slowly during walking and strongly during quiet
standing. State: the unit vector that points up and the gyroscope bias, both in segment axes (forward, left, up).
With the rate ω − β over one interval as rotation vector w,

    u ← exp(−[w]×) u,      z = acc / g = u + noise,      gyr = β + noise while standing.

The noise of z is large while walking, because the accelerometer also measures the swing; noise of 1 g acts like a
complementary filter of several seconds. The angle in the sagittal plane is θ = atan2(u_forward, u_up), positive
when the distal end swings forward.

Sensors: one gyroscope and accelerometer on the segment. Gravity direction as a Kalman state: Sabatini (2011),
Sensors 11(2), doi 10.3390/s110201489.
"""

from typing import Annotated, NamedTuple

import jax.numpy as jnp

from jgait.estimators.leg_ekf.inputs import LegInputs, Segment
from jgait.filtering import Belief, Covariance, Model
from jgait.geometry.rotation import rotated, small_turn
from jgait.geometry.vectors import GRAVITY, Three, as_array, entries, vector
from jgait.params import Param, Parameter, documented, positive
from jgait.types import Flags, Maybe, Values


class InclinationState(NamedTuple):
    """Direction of up [1] and gyroscope bias [rad/s], in segment axes."""

    up: Three | Values
    bias: Three | Values


class InclinationObservation(NamedTuple):
    """Accelerometer in units of gravity [1], and the gyroscope's reading while standing [rad/s]."""

    acc: Three | Values
    gyr: Three | Values


class InclinationControl(NamedTuple):
    """Inputs of a sample: mean rate over the interval [rad/s], whether the person stands, whether it was measured, and
    if not, the time since the last measured sample [s]; None: one interval. `unrest` is a further variance of the
    gyroscope about its bias while standing [rad²/s²]; None: zero.
    """

    rate: Three
    still: Flags
    measured: Flags
    lost: Maybe[Values] = None
    unrest: Maybe[Values] = None


@documented
class InclinationNoise(NamedTuple):
    """Noise of the gravity direction."""

    gyro_noise: Annotated[Param, Parameter(positive, "rad/√s", "gyroscope white noise, soft tissue included")] = 0.02
    bias_walk: Annotated[Param, Parameter(positive, "rad/s/√s", "bias random walk")] = 2e-5
    walking_acceleration: Annotated[Param, Parameter(
        positive, "1", "standard deviation of acc / g about up while walking",
    )] = 1.0  # fmt: skip
    standing_acceleration: Annotated[Param, Parameter(positive, "1", "the same while standing")] = 0.01
    standing_rate: Annotated[Param, Parameter(
        positive, "rad/s", "standard deviation of the gyroscope about its bias while standing",
    )] = 0.02  # fmt: skip


def _initial(params: InclinationNoise) -> Belief:
    return prior(jnp.zeros(3, jnp.result_type(params.gyro_noise)), 1e-4, 0.0)


def _transition(
    params: InclinationNoise, state: InclinationState, control: InclinationControl, dt: Values
) -> InclinationState:
    del params
    back = small_turn(vector((state.bias - control.rate) * dt))
    return InclinationState(as_array(rotated(back, vector(state.up))), state.bias)


def unknown_turn(since: Values, dt: Values) -> Values:
    """Variance of an angle over an interval `dt`, at whose end samples have been lost for `since` [s]: its rate is
    unknown by 2 rad/s, and the angle by 2 rad/s times the time [rad²].
    """
    return 4.0 * dt * (2.0 * since - dt)


def _transition_noise(
    params: InclinationNoise, state: InclinationState, control: InclinationControl, dt: Values
) -> InclinationState:
    del state
    since = dt if control.lost is None else jnp.maximum(control.lost, dt)
    angle = params.gyro_noise**2 * dt + jnp.where(control.measured, 0.0, unknown_turn(since, dt))
    walk = params.bias_walk**2 * dt
    return InclinationState(angle, walk)


def _observation(
    params: InclinationNoise, state: InclinationState, control: InclinationControl
) -> InclinationObservation:
    del params, control
    return InclinationObservation(state.up, state.bias)


def _observation_noise(
    params: InclinationNoise, state: InclinationState, control: InclinationControl
) -> InclinationObservation:
    del state
    acc = jnp.where(control.still, params.standing_acceleration**2, params.walking_acceleration**2)
    rate = params.standing_rate**2 + (0.0 if control.unrest is None else control.unrest)
    return InclinationObservation(acc, rate)


MODEL = Model(_initial, _transition, _transition_noise, _observation, _observation_noise)


class Inclination(NamedTuple):
    """A segment's inclination in its sagittal plane."""

    angle: Values  #: (T,) [rad], 0 in the calibration pose, positive when the distal end is forward.
    rate: Values  #: (T,) [rad/s], derivative of the angle, gyroscope bias removed.
    variance: Values  #: (T,) [rad²] of `angle`.


NEEDED = ("up",)
"""Parts of the state of which `read_out` uses the covariances."""


def read_out(state: InclinationState, cov: Covariance, rate: Values) -> Inclination:
    """Sagittal angle, rate and variance of the angle, for one sample or a whole recording.

    The rate is the derivative of atan2(u_x, u_z) under u̇ = −ω × u:
    θ̇ = −ω_y + u_y (u_z ω_z + u_x ω_x) / (u_x² + u_z²), so turning does not change the angle of an inclined segment.
    """
    u, w = vector(state.up), vector(rate - state.bias)
    square = jnp.maximum(u.x * u.x + u.z * u.z, 1e-6)
    angle = jnp.arctan2(u.x, u.z)
    slope = u.y * (u.z * w.z + u.x * w.x) / square - w.y
    dx, dz = u.z / square, -u.x / square
    xx, zz, xz = entries(cov["up", "up"], "xx", "zz", "xz")
    variance = dx * dx * xx + dz * dz * zz + 2.0 * dx * dz * xz
    return Inclination(angle, slope, variance)


def prior(bias: Values, start_variance: Values, unrest: Values, start: Maybe[Values] = None) -> Belief:
    """The belief before the first sample: segment inclined by `start` [rad, variance in rad²], gyroscope bias at rest
    [rad/s], whose variance is the larger by the `unrest` of the rest from which the bias is computed [rad²/s²].
    """
    zero = jnp.zeros_like(bias)
    angle = 0.0 if start is None else start
    mean = InclinationState(zero.at[0].set(jnp.sin(angle)).at[2].set(jnp.cos(angle)), bias)
    return Belief(mean, Covariance.from_variances(InclinationState(zero + start_variance, zero + 1e-5 + unrest)))


def observed(
    segment: Segment, before: Values, inputs: LegInputs, standing: bool
) -> tuple[InclinationObservation, InclinationControl, InclinationObservation]:
    """Observation, control and mask of samples (T,) of a segment: gravity always, the bias in standing if `standing`.
    `before` is the rate at the sample before the first [rad/s].
    """
    rate, measured = segment.gyr, segment.measured
    mean = 0.5 * (rate + jnp.concatenate([before[None], rate[:-1]]))
    still = inputs.still if standing else jnp.zeros_like(inputs.still)
    at_rest = still & measured if standing else False
    mask = InclinationObservation(measured, at_rest)
    # turns of a leg that does not stand still, as in a shift of weight, last half a second: they do not average out
    unrest = segment.unrest * 0.5 / jnp.maximum(inputs.dt, 1e-3)
    control = InclinationControl(mean, still, measured, segment.lost, unrest)
    return InclinationObservation(segment.acc / GRAVITY, rate), control, mask
