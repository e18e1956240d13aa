r"""The two-link leg of Bennett et al. as a state-space model on named scalars.

Thigh and shank are two revolute links of lengths a₁ and a₂; θ₁ is the thigh from the forward axis (−π/2 hanging
down), θ₂ the shank relative to the thigh (flexion negative), ω₁ and ω₂ their rates, β₁ and β₂ the biases of the
thigh's and shin's gyroscopes, (x, y) the ankle relative to the hip. Equation 5 of the paper, over one interval:

    x ← x + T (−a₁ sin θ₁ ω₁ − a₂ sin(θ₁+θ₂)(ω₁+ω₂)),    θ₁ ← θ₁ + T ω₁,
    y ← y + T ( a₁ cos θ₁ ω₁ + a₂ cos(θ₁+θ₂)(ω₁+ω₂)),    θ₂ ← θ₂ + T ω₂.

The filter computes Jacobians by autodiff. In addition to the paper's two rates the model observes, each with a separate
mask: the closure of x and y with the forward kinematics, and the inclination of both segments.

Source: T. Bennett, R. Jafari, N. Gans, "An extended Kalman filter to estimate human gait parameters and walking
distance", ACC 2013, equations 3–14.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp

from jgait.filtering import Belief, Covariance, Model
from jgait.types import Maybe, Values

STANDING = -math.pi / 2
"""θ₁ of a thigh that hangs straight down [rad]."""


class LegState(NamedTuple):
    """Equation 4: positions [m], angles [rad], rates [rad/s], gyroscope biases [rad/s]."""

    x: Values
    y: Values
    thigh_angle: Values
    thigh_rate: Values
    knee_angle: Values
    knee_rate: Values
    thigh_gyro_bias: Values
    shin_gyro_bias: Values


class LegObservation(NamedTuple):
    """Observations of the leg filter."""

    thigh_gyro: Values  #: sagittal rate of the thigh [rad/s], ω₁ + β₁.
    shin_gyro: Values  #: sagittal rate of the shin [rad/s], ω₁ + ω₂ + β₂.
    closure_x: Values  #: x minus the forward kinematics [m], observed as 0.
    closure_y: Values  #: y minus the forward kinematics [m], observed as 0.
    thigh_inclination: Values  #: θ₁ from gravity [rad].
    shin_inclination: Values  #: θ₁ + θ₂ from gravity [rad].


class LegModelParams(NamedTuple):
    """Parameters of one leg's model."""

    thigh_length: Values  #: a₁ [m].
    shank_length: Values  #: a₂ [m].
    position_noise: Values  #: σ_xy, variance added to x and y each sample [m²].
    angle_noise: Values  #: σ_θ, spectral density of the angular acceleration [rad²/s³].
    bias_noise: Values  #: σ_β, variance added to the biases each sample [rad²/s²].
    gyro_variance_thigh: Values  #: R of the thigh's gyroscope [rad²/s²].
    gyro_variance_shin: Values  #: R of the shin's gyroscope [rad²/s²].
    closure_noise: Values  #: variance of the kinematic closure [m²].


class LegControl(NamedTuple):
    """Variances of the inclinations at this sample, and of angles over its interval while samples are lost [rad²]."""

    thigh_variance: Values
    shin_variance: Values
    lost: Maybe[Values] = None


def forward_kinematics(params: LegModelParams, state: LegState) -> tuple[Values, Values]:
    """Ankle relative to hip (x forward, y up) [m]: equation 3, last column."""
    shin = state.thigh_angle + state.knee_angle
    x = params.thigh_length * jnp.cos(state.thigh_angle) + params.shank_length * jnp.cos(shin)
    y = params.thigh_length * jnp.sin(state.thigh_angle) + params.shank_length * jnp.sin(shin)
    return x, y


def transition(params: LegModelParams, state: LegState, control: LegControl, dt: Values) -> LegState:
    """Equations 5, 7 and 8 over one interval."""
    del control
    shin = state.thigh_angle + state.knee_angle
    thigh_sin = params.thigh_length * jnp.sin(state.thigh_angle)
    thigh_cos = params.thigh_length * jnp.cos(state.thigh_angle)
    shank_sin, shank_cos = params.shank_length * jnp.sin(shin), params.shank_length * jnp.cos(shin)
    return state._replace(
        x=state.x + dt * (-(thigh_sin + shank_sin) * state.thigh_rate - shank_sin * state.knee_rate),
        y=state.y + dt * ((thigh_cos + shank_cos) * state.thigh_rate + shank_cos * state.knee_rate),
        thigh_angle=state.thigh_angle + dt * state.thigh_rate,
        knee_angle=state.knee_angle + dt * state.knee_rate,
    )


def angle_blocks(params: LegModelParams, angle: Values, cross: Values, rate: Values) -> Covariance:
    """Q, from the entries of its blocks of an angle and its rate."""
    variances = LegState(
        params.position_noise, params.position_noise, angle, rate, angle, rate, params.bias_noise, params.bias_noise
    )
    return Covariance.from_variances(variances).with_entries(
        {("thigh_angle", "thigh_rate"): cross, ("knee_angle", "knee_rate"): cross}
    )


def transition_noise(params: LegModelParams, state: LegState, control: LegControl, dt: Values) -> Covariance:
    """Q with the angle blocks σ_θ [T³/3, T²/2; T²/2, T] (deviation 2), and the error of the Euler step in x and y.
    While samples are lost, angles are unknown, and with them x and y, of a leg of about a metre.
    """
    del state
    # In swing the ankle has an acceleration of 20 m/s² relative to the hip, and the Euler step of equation 5 leaves out
    # half of it times T². Without it the closure turns the angles: knees of simulated walks at 50 Hz were 1.6° too
    # straight on average, and are 0.1° off with it.
    s, euler = params.angle_noise, (0.5 * 20.0 * dt**2) ** 2
    lost = getattr(control, "lost", None)  # the filter may run without controls
    lost = 0.0 if lost is None else lost
    return angle_blocks(
        params._replace(position_noise=params.position_noise + euler + lost),
        s * dt**3 / 3.0 + lost, s * dt**2 / 2.0, s * dt,
    )  # fmt: skip


def observation(params: LegModelParams, state: LegState, control: LegControl) -> LegObservation:
    """Equation 9, the kinematic closure, and both inclinations."""
    del control
    x, y = forward_kinematics(params, state)
    return LegObservation(
        thigh_gyro=state.thigh_rate + state.thigh_gyro_bias,
        shin_gyro=state.thigh_rate + state.knee_rate + state.shin_gyro_bias,
        closure_x=state.x - x,
        closure_y=state.y - y,
        thigh_inclination=state.thigh_angle,
        shin_inclination=state.thigh_angle + state.knee_angle,
    )


def observation_noise(params: LegModelParams, state: LegState, control: LegControl) -> LegObservation:
    """R: variances of the gyroscopes at rest, of the closure, and of the inclinations, from the control."""
    del state
    return LegObservation(
        params.gyro_variance_thigh,
        params.gyro_variance_shin,
        params.closure_noise,
        params.closure_noise,
        control.thigh_variance,
        control.shin_variance,
    )


def initial(params: LegModelParams) -> Belief:
    """Standing straight: θ₁ = −π/2, ankle position from the forward kinematics, all else 0."""
    return standing_belief(params, STANDING, 0.0, 0.0, 0.0, 1e-4)


def standing_belief(
    params: LegModelParams,
    thigh_angle: Values,
    knee_angle: Values,
    thigh_bias: Values,
    shin_bias: Values,
    angle_variance: Values,
) -> Belief:
    """The belief before the first sample of a person who stands in a known pose.

    θ₁ and θ₂ [rad] have one variance [rad²]; the biases of both gyroscopes at rest are in rad/s. x and y start on the
    forward kinematics (deviation 4), with the uncertainty that the angles give a straight leg: if they were certain,
    the closure would keep a wrong pose.
    """
    zero = jnp.zeros_like(jnp.asarray(thigh_bias) + thigh_angle)
    mean = LegState(*(zero + v for v in (0.0, 0.0, thigh_angle, 0.0, knee_angle, 0.0, thigh_bias, shin_bias)))
    x, y = forward_kinematics(params, mean)
    xy = 1e-8 + angle_variance * (params.thigh_length + params.shank_length) ** 2
    variances = LegState(xy, xy, angle_variance, 1e-4, angle_variance, 1e-4, 1e-8, 1e-8)
    return Belief(mean._replace(x=x, y=y), Covariance.from_variances(variances))


MODEL = Model(initial, transition, transition_noise, observation, observation_noise)
"""The model with the paper's misprints corrected (deviations 1 to 4), the default."""
