r"""The thigh's and the shin's filter of Udaya Shankar et al. with the matrices of section 8 as they are printed.

Deviations are numbered as in `jgait.estimators.duty_cycled_gyro.model`.

Source: P. S. Udaya Shankar, N. Raveendranathan, N. R. Gans, R. Jafari, "Towards power optimized Kalman filter for
gait assessment using wearable sensors", Wireless Health 2010, sections 3.2, 4 and 8.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp

from jgait import filtering
from jgait.estimators.duty_cycled_gyro.params import (
    DutyCycledParams,
    DutyEstimate,
    DutyInputs,
    PlanarSegment,
    SegmentEstimate,
    ThighState,
    levers,
)
from jgait.filtering import Belief, Covariance, Model
from jgait.geometry.vectors import GRAVITY


class LiteralParams(NamedTuple):
    """Parameters of a printed filter.

    Attributes:
        noise: σ of Q, one for all states.
        velocity_variance: R of ẋ and ż [m²/s²].
        acc_variance: R of ẍ and z̈ [m²/s⁴].
        gyro_variance: R of ω [rad²/s²].
        start_variance: of every state at the start.
    """

    noise: Any
    velocity_variance: Any
    acc_variance: Any
    gyro_variance: Any
    start_variance: Any


class LiteralControl(NamedTuple):
    """What "a1, b1, a2, b2" of the shin's H are read as: section 4.3 at this sample's angles [m].

    Attributes:
        a1: −d_s1 sin θ₁.
        b1: −d_s2 sin θ₂.
        a2: d_s1 cos θ₁.
        b2: d_s2 cos θ₂.
    """

    a1: Any
    b1: Any
    a2: Any
    b2: Any


class LiteralObservation(NamedTuple):
    """The five measurements of section 8.2.

    Attributes:
        down_velocity: ẋ_g, from the gyroscope [m/s].
        forward_velocity: ż_g, from the gyroscope [m/s].
        down_acceleration: ẍ_a, along the segment, gravity taken off [m/s²].
        forward_acceleration: z̈_a, across it [m/s²].
        rate: ω_g [rad/s].
    """

    down_velocity: Any
    forward_velocity: Any
    down_acceleration: Any
    forward_acceleration: Any
    rate: Any


class ShinState(NamedTuple):
    """The paper's eleven states: as `ThighState` for the shin's sensor, relative to the hip, with both angles."""

    down: Any
    down_velocity: Any
    down_acceleration: Any
    forward: Any
    forward_velocity: Any
    forward_acceleration: Any
    velocity_bias: Any
    thigh_angle: Any  #: θ₁ [rad].
    thigh_rate: Any  #: ω₁ [rad/s].
    angle: Any  #: θ₂, of the shank from hanging straight down, positive forward [rad].
    rate: Any  #: ω₂ [rad/s].


def thigh_transition(params: LiteralParams, state: ThighState, control: Any, dt: Any) -> ThighState:
    """A of the thigh as printed: no T²/2 (deviation 3), θ added to z (deviation 4)."""
    del params, control
    return state._replace(
        down=state.down + dt * state.down_velocity,
        down_velocity=state.down_velocity + dt * state.down_acceleration,
        forward=state.forward + dt * state.forward_velocity + state.angle,
        forward_velocity=state.forward_velocity + dt * state.forward_acceleration,
        angle=state.angle + dt * state.rate,
    )


def thigh_observation(params: LiteralParams, state: ThighState, control: Any) -> LiteralObservation:
    """H of the thigh as printed: −1 in the column of θ, an angle taken from a velocity (deviation 4)."""
    del params, control
    return LiteralObservation(
        down_velocity=state.down_velocity - state.angle,
        forward_velocity=state.forward_velocity - state.angle,
        down_acceleration=state.down_acceleration,
        forward_acceleration=state.forward_acceleration,
        rate=state.rate,
    )


def shin_transition(params: LiteralParams, state: ShinState, control: LiteralControl, dt: Any) -> ShinState:
    """A of the shin as printed: T² for T²/2 (deviation 3), θ₂ for ω₁ (deviation 5)."""
    del params, control
    return state._replace(
        down=state.down + dt * state.down_velocity + dt * dt * state.down_acceleration,
        down_velocity=state.down_velocity + dt * state.down_acceleration,
        forward=state.forward + dt * state.forward_velocity + dt * dt * state.forward_acceleration,
        forward_velocity=state.forward_velocity + dt * state.forward_acceleration,
        thigh_angle=state.thigh_angle + dt * state.angle,
        angle=state.angle + dt * state.rate,
    )


def shin_observation(params: LiteralParams, state: ShinState, control: LiteralControl) -> LiteralObservation:
    """H of the shin as printed, its columns taken in the order of A: θ₂ for ω₁, no velocity (deviation 5)."""
    del params
    return LiteralObservation(
        down_velocity=control.a1 * state.angle + control.b1 * state.rate,
        forward_velocity=control.a2 * state.angle + control.b2 * state.rate,
        down_acceleration=state.down_acceleration,
        forward_acceleration=state.forward_acceleration,
        rate=state.rate,
    )


def _triple(names: tuple[str, str, str], s: Any, dt: Any) -> dict[tuple[str, str], Any]:
    """A printed block of Q (deviation 1)."""
    a, b, c = names
    return {
        (a, a): s * dt**9 / 9.0,
        (a, b): s * dt**4 / 4.0,
        (a, c): s * dt**5 / 5.0,
        (b, b): s * dt**3 / 3.0,
        (b, c): s * dt**2 / 2.0,
        (c, c): s * dt,
    }


_DOWN = ("down", "down_velocity", "down_acceleration")
_FORWARD = ("forward", "forward_velocity", "forward_acceleration")


def thigh_transition_noise(params: LiteralParams, state: ThighState, control: Any, dt: Any) -> Covariance:
    """Q of the thigh as printed: v, θ and ω as one chain (deviation 2)."""
    del state, control
    s = params.noise
    entries = _triple(_DOWN, s, dt) | _triple(_FORWARD, s, dt) | _triple(("velocity_bias", "angle", "rate"), s, dt)
    return Covariance.from_variances(ThighState(*(0.0,) * 9)).with_entries(entries)


def shin_transition_noise(params: LiteralParams, state: ShinState, control: LiteralControl, dt: Any) -> Covariance:
    """Q of the shin: the first eleven of the thirteen printed rows (deviation 2)."""
    del state, control
    s = params.noise
    entries = _triple(_DOWN, s, dt) | _triple(_FORWARD, s, dt)
    entries |= {("velocity_bias", "velocity_bias"): s * dt, ("thigh_angle", "thigh_angle"): s * dt}
    entries |= {
        ("thigh_rate", "thigh_rate"): s * dt**3 / 3.0,
        ("thigh_rate", "angle"): s * dt**2 / 2.0,
        ("angle", "angle"): s * dt,
        ("rate", "rate"): s * dt**3 / 3.0,
    }
    return Covariance.from_variances(ShinState(*(0.0,) * 11)).with_entries(entries)


def observation_noise(params: LiteralParams, state: Any, control: Any) -> LiteralObservation:
    """R: diagonal, the sensors' variances at rest."""
    del state, control
    speed, acc = params.velocity_variance, params.acc_variance
    return LiteralObservation(speed, speed, acc, acc, params.gyro_variance)


def _standing(params: LiteralParams, like: Any) -> Belief:
    """Section 4.2: standing, everything 0."""
    zero = jnp.zeros_like(jnp.asarray(params.start_variance))
    count = len(like._fields)
    return Belief(like(*(zero,) * count), Covariance.from_variances(like(*(zero + params.start_variance,) * count)))


def _thigh_initial(params: LiteralParams) -> Belief:
    return _standing(params, ThighState)


def _shin_initial(params: LiteralParams) -> Belief:
    return _standing(params, ShinState)


THIGH = Model(_thigh_initial, thigh_transition, thigh_transition_noise, thigh_observation, observation_noise)
"""Nine states, as printed."""

SHIN = Model(_shin_initial, shin_transition, shin_transition_noise, shin_observation, observation_noise)
"""Eleven states, as printed."""


def strapdown_angle(rate: Any, dt: Any) -> Any:
    """Angle by the trapezoidal rule from hanging straight down [rad]: section 3.2, after reference 23 of the paper."""
    before = jnp.concatenate([rate[:1], rate[:-1]])
    return jnp.cumsum(0.5 * dt * (before + rate))


def _rate(segment: PlanarSegment) -> Any:
    """The rate without its bias at rest; 0 where the gyroscope is off."""
    return jnp.where(segment.gyro_on & segment.measured, segment.gyr - segment.bias, 0.0)


def _measured(segment: PlanarSegment, angle: Any, down: Any, forward: Any, valid: Any) -> tuple[Any, Any]:
    """The five measurements and their mask, given the velocities of section 4.3."""
    on = segment.gyro_on & segment.measured & valid
    felt = segment.measured & valid
    # Gravity is split along the sensor's axes; what is left stays in them (deviation 7).
    along = GRAVITY * jnp.cos(angle) - segment.acc_up
    across = segment.acc_forward - GRAVITY * jnp.sin(angle)
    return LiteralObservation(down, forward, along, across, _rate(segment)), LiteralObservation(on, on, felt, felt, on)


def _filtered(
    model: Model, p: DutyCycledParams, segment: PlanarSegment, lever: Any, told: tuple[Any, Any, Any],
    inputs: DutyInputs,
) -> SegmentEstimate:  # fmt: skip
    observations, controls, mask = told
    gyro = p.gyro_noise * segment.variance
    params = LiteralParams(p.angle_noise, lever**2 * gyro, p.standing_acceleration**2, gyro, inputs.start_variance)
    found = filtering.kalman_filter(
        model, params, observations, controls=controls, dt=inputs.dt, mask=mask,
    )  # fmt: skip
    deviation = found.cov.stddev()
    return SegmentEstimate(
        found.mean.angle, found.mean.rate, deviation.angle, deviation.rate, found.mean.rate + segment.bias,
        found.nis, found.count, found.log_likelihood, found.valid,
    )  # fmt: skip


def run(p: DutyCycledParams, inputs: DutyInputs) -> DutyEstimate:
    """The printed filters over a recording; arguments and returns as of `duty_cycled_gyro.model.run`.

    The shin's needs both sensors; a shank worn alone is filtered as a thigh.
    """
    thigh = shank = None
    theta1 = rate1 = None
    if inputs.thigh is not None:
        rate1 = _rate(inputs.thigh)
        theta1 = strapdown_angle(rate1, inputs.dt)
        thigh = _single(p, inputs.thigh, theta1, rate1, levers(p)[0], inputs)
    if inputs.shank is not None:
        rate2 = _rate(inputs.shank)
        theta2 = strapdown_angle(rate2, inputs.dt)
        if theta1 is None or rate1 is None:
            shank = _single(p, inputs.shank, theta2, rate2, levers(p)[1], inputs)
        else:
            d1, d2 = levers(p)
            c = LiteralControl(-d1 * jnp.sin(theta1), -d2 * jnp.sin(theta2), d1 * jnp.cos(theta1), d2 * jnp.cos(theta2))
            down, forward = c.a1 * rate1 + c.b1 * rate2, c.a2 * rate1 + c.b2 * rate2
            observations, mask = _measured(inputs.shank, theta2, down, forward, inputs.valid)
            shank = _filtered(SHIN, p, inputs.shank, d2, (observations, c, mask), inputs)
    return DutyEstimate(thigh, shank)


def _single(
    p: DutyCycledParams, segment: PlanarSegment, angle: Any, rate: Any, lever: Any, inputs: DutyInputs
) -> SegmentEstimate:
    down, forward = -lever * jnp.sin(angle) * rate, lever * jnp.cos(angle) * rate
    observations, mask = _measured(segment, angle, down, forward, inputs.valid)
    return _filtered(THIGH, p, segment, lever, (observations, None, mask), inputs)
