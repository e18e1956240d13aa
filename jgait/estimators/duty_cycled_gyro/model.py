r"""The thigh's and the shin's filter of Udaya Shankar et al. on named scalars, corrected, under a gyroscope mask.

The sensor is at distance d from the joint of its segment, at x downward and z forward of the hip; the segment is at
angle θ from the vertical. Between samples x ← x + T ẋ + T²/2 ẍ, ẋ ← ẋ + T ẋ̇, and θ ← θ + T ω. The rigid link gives
position and velocity, and the sensors measure

    x = d cos θ,       ẋ = −d sin θ ω,     f_up      = (g − ẍ) cos θ − z̈ sin θ,
    z = d sin θ,       ż =  d cos θ ω,     f_forward = (g − ẍ) sin θ + z̈ cos θ,      ω_g = ω − v / d.

For the shin's sensor the thigh's link a₁ is added: x = a₁ cos θ₁ + d cos θ₂, and so on; θ₁ and ω₁ come from the thigh's
filter. The acceleration of the joint is not modelled; it is part of the accelerometer's noise while walking.

While the gyroscope is off, its observation is masked; gravity, the rigid link and a weak observation of the vertical
correct rate and angle. Rates filled from earlier strides (`duty_cycle.fillers`) give more accurate angles. While the
person stands, accelerations are observed as 0.

One gyroscope axis does not measure turns. Where the person turns, the rate counts for less (`excess`), and gravity
corrects the angle: on `neura_sparse` with its U-turn thigh and shank are within 5.5° and 2.7° (left), 2.9° and 1.8°
(right) of motion capture (standard deviation); `leg_ekf`, which takes all three axes, within 4.7° and 1.5°, 2.2° and
1.2°.

Deviations from the paper:
    Its matrices are in `experiments/udaya2010/literal.py` as they are printed. Angles are errors of the printed
    filters, three simulated people with ideal sensors, 14 s, 50 Hz, RMS to the strapdown angle, σ = 10; these filters
    stay within 0.8°.

    1. Q's blocks [T⁹/9, T⁴/4, T⁵/5; ·, T³/3, T²/2; ·, ·, T] are indefinite: their least eigenvalue is −2.4·10⁻⁹ σ at
       T = 20 ms. Integrated white noise has [T⁵/20, T⁴/8, T³/6; ·, T³/3, T²/2; ·, ·, T].
    2. Q of the thigh chains v, θ and ω, which A does not; Q of the shin is printed with 13 rows and 11 columns, of
       which the first 11 rows are taken here. With A and H repaired, 1 and 2 alone cost 20 to 24° (thigh).
    3. A second derivative moves the position by T²/2: A of the thigh leaves the term out, that of the shin the half.
       The angles are not affected, because no position enters them.
    4. A of the thigh adds θ to z, and H takes θ from both velocities where the velocity bias v belongs, which no row
       reaches then. The thigh's angle is lost: 150 to 176°.
    5. The shin's states stand in the order (θ₁, ω₁, θ₂, ω₂) in A's vector and (θ₁, θ₂, ω₁, ω₂) in H's, and the rows of
       ẋ and ż never reach the velocity states. The shank's angle is lost: 102 to 121°.
    6. Rank of the observability matrix: 5 of 9 (thigh) and 4 of 11 (shin) as printed, and still 5 of 9 with A, H and Q
       repaired: no observation determines a position, or an angle except by integration. This model puts sensor and
       joint on one rigid link and leaves gravity in the accelerometer: 9 of 9 and 11 of 11; 8 and 10 while the
       gyroscope is off, because its bias is not observed then.
    7. Gravity is taken off with the integrated angle, and what is left stays in the sensor's turning axes though A
       integrates it as ẍ and ż. This model observes the specific force itself. Not measured apart.
    8. One reading of the gyroscope comes in three times, as ẋ, ż and ω, with independent noise, and v comes into two of
       them. This model observes it once; v is the bias as velocity of the sensor across its link, which is the
       printed row of ż for a segment that hangs. Not measured apart.
    9. The shin's velocity in section 4.3 has the thigh's sensor at the knee, d_s1 for the thigh's length a₁. Not
       measured apart.
    10. The shin's filter gets only those velocities of the thigh; this model gives it angle and rate of the
        thigh's filter with their variances.
    11. The gyroscope "in deg/s" would make velocities 57 times too large; all is in radians here too. The sensor's z
        axis "laterally" would leave the sagittal plane; z is forward.
    12. While the gyroscope is off, this model pulls the angle loosely to the vertical, or a gap may turn the segment
        over and leave it 360° wrong, as it did once in nine simulated recordings.

Source: P. S. Udaya Shankar, N. Raveendranathan, N. R. Gans, R. Jafari, "Towards power optimized Kalman filter for
gait assessment using wearable sensors", Wireless Health 2010, sections 4 and 8.
"""

from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import PyTree

from jgait import filtering
from jgait.estimators.duty_cycled_gyro.params import (
    DutyControl,
    DutyCycledParams,
    DutyEstimate,
    DutyInputs,
    LinkParams,
    PlanarSegment,
    SegmentEstimate,
    ShinObservation,
    ShinState,
    ThighObservation,
    ThighState,
    levers,
)
from jgait.filtering import Belief, Covariance, Model, Posterior
from jgait.filtering.covariance import Layout
from jgait.geometry.vectors import GRAVITY
from jgait.types import Flags, Values


def thigh_transition(params: LinkParams, state: ThighState, control: DutyControl, dt: Values) -> ThighState:
    """Section 8.1 with T²/2, and without the stray θ in z (deviations 3 and 4)."""
    del params, control
    return state._replace(
        down=state.down + dt * state.down_velocity + 0.5 * dt * dt * state.down_acceleration,
        down_velocity=state.down_velocity + dt * state.down_acceleration,
        forward=state.forward + dt * state.forward_velocity + 0.5 * dt * dt * state.forward_acceleration,
        forward_velocity=state.forward_velocity + dt * state.forward_acceleration,
        angle=state.angle + dt * state.rate,
    )


def shin_transition(params: LinkParams, state: ShinState, control: DutyControl, dt: Values) -> ShinState:
    """Transition of the shin's filter, which includes the thigh's angle (deviation 5)."""
    shin = thigh_transition(params, state.shin, control, dt)
    return ShinState(shin, state.thigh_angle + dt * state.thigh_rate, state.thigh_rate)


def _white_acceleration(noise: Values, angle: str, rate: str, dt: Values) -> dict[tuple[str, str], Values]:
    return {(angle, angle): noise * dt**3 / 3.0, (angle, rate): noise * dt**2 / 2.0, (rate, rate): noise * dt}


def thigh_transition_noise(params: LinkParams, state: ThighState, control: DutyControl, dt: Values) -> Covariance:
    """Q of the thigh, integrated white jerk, σ [T⁵/20, T⁴/8, T³/6; ·, T³/3, T²/2; ·, ·, T], of both directions, random
    walk of the bias, and integrated white angular acceleration (deviations 1, 2).
    """
    del control
    s = params.acceleration_noise
    entries = _white_acceleration(params.angle_noise, "angle", "rate", dt)
    entries["velocity_bias", "velocity_bias"] = params.bias_noise * dt
    for way in ("down", "forward"):
        velocity, acceleration = f"{way}_velocity", f"{way}_acceleration"
        entries |= {
            (way, way): s * dt**5 / 20.0,
            (way, velocity): s * dt**4 / 8.0,
            (way, acceleration): s * dt**3 / 6.0,
            (velocity, velocity): s * dt**3 / 3.0,
            (velocity, acceleration): s * dt**2 / 2.0,
            (acceleration, acceleration): s * dt,
        }
    return Covariance.from_variances(state._replace(**dict.fromkeys(state._fields, 0.0))).with_entries(entries)


def shin_transition_noise(params: LinkParams, state: ShinState, control: DutyControl, dt: Values) -> Covariance:
    """Q of the shin: 11 × 11, with a block for each angle."""
    shin = thigh_transition_noise(params, state.shin, control, dt)
    entries = _white_acceleration(params.angle_noise, "thigh_angle", "thigh_rate", dt)
    return Covariance.of(shin.entries(), Layout.of(ShinState(*state))).with_entries(entries)


def _read(params: LinkParams, state: ThighState, joint: tuple[Values, Values, Values, Values]) -> ThighObservation:
    """Observations of one segment, for given position and velocity of its joint (x, z, ẋ, ż)."""
    sin, cos = jnp.sin(state.angle), jnp.cos(state.angle)
    d, lighter = params.lever, GRAVITY - state.down_acceleration
    return ThighObservation(
        acc_up=lighter * cos - state.forward_acceleration * sin,
        acc_forward=lighter * sin + state.forward_acceleration * cos,
        gyro=state.rate - state.velocity_bias / d,
        link_down=state.down - joint[0] - d * cos,
        link_forward=state.forward - joint[1] - d * sin,
        link_down_velocity=state.down_velocity - joint[2] + d * sin * state.rate,
        link_forward_velocity=state.forward_velocity - joint[3] - d * cos * state.rate,
        rest_down=state.down_acceleration,
        rest_forward=state.forward_acceleration,
        swing=state.angle,
    )


def thigh_observation(params: LinkParams, state: ThighState, control: DutyControl) -> ThighObservation:
    """Section 8.2 with gravity, and with the rigid link instead of velocities from the gyroscope."""
    del control
    return _read(params, state, (0.0, 0.0, 0.0, 0.0))


def shin_observation(params: LinkParams, state: ShinState, control: DutyControl) -> ShinObservation:
    """Observation of the shin's filter: its joint is the knee; the thigh's angle and rate are observed as well."""
    del control
    a, sin, cos = params.thigh_length, jnp.sin(state.thigh_angle), jnp.cos(state.thigh_angle)
    knee = (a * cos, a * sin, -a * sin * state.thigh_rate, a * cos * state.thigh_rate)
    return ShinObservation(_read(params, state.shin, knee), state.thigh_angle, state.thigh_rate)


def thigh_observation_noise(params: LinkParams, state: ThighState, control: DutyControl) -> ThighObservation:
    """R: variances of the sensors at this sample, and of the rigid link."""
    del state
    acc, rest = control.acc_variance, control.rest_variance
    place, speed = params.position_variance, params.velocity_variance
    return ThighObservation(
        acc, acc, control.gyro_variance, place, place, speed, speed, rest, rest, control.swing_variance
    )


def shin_observation_noise(params: LinkParams, state: ShinState, control: DutyControl) -> ShinObservation:
    """R of the shin's filter: as of the thigh, with the variances of the thigh's angle and rate."""
    shin = thigh_observation_noise(params, state.shin, control)
    return ShinObservation(shin, control.thigh_angle_variance, control.thigh_rate_variance)


def thigh_standing(params: LinkParams, angle: Values, bias: Values, angle_variance: Values) -> Belief:
    """The belief before the first sample: at rest, on the rigid link; angle [rad], gyroscope bias [rad/s]."""
    zero, d = jnp.zeros_like(jnp.asarray(bias) + angle), params.lever
    still = (zero, zero)
    mean = ThighState(zero + d * jnp.cos(angle), *still, d * jnp.sin(angle), *still, -d * bias, zero + angle, zero)
    place, bias_variance = d * d * angle_variance + params.position_variance, 1e-5 * d * d
    # An angle error also moves the sensor; here only as a variance of the position, without correlation.
    variances = ThighState(place, 1e-4, 1.0, place, 1e-4, 1.0, bias_variance, angle_variance, 1e-4)
    return Belief(mean, Covariance.from_variances(variances))


def shin_standing(params: LinkParams, angle: Values, bias: Values, angle_variance: Values) -> Belief:
    """The belief of the shin's filter before the first sample, as `thigh_standing`; the thigh is at rest."""
    standing, a = thigh_standing(params, angle, bias, angle_variance), params.thigh_length
    m, v = standing.mean, standing.cov.variances()
    zero = jnp.zeros_like(m.angle)
    wider = v._replace(down=v.down + a * a * angle_variance, forward=v.forward + a * a * angle_variance)
    variances = ShinState(wider, v.angle, v.rate)
    return Belief(ShinState(m._replace(down=m.down + a), zero, zero), Covariance.from_variances(variances))


THIGH = Model(
    partial(thigh_standing, angle=0.0, bias=0.0, angle_variance=1e-4), thigh_transition, thigh_transition_noise,
    thigh_observation, thigh_observation_noise,
)  # fmt: skip
"""Nine states, one segment that hangs from a joint: the thigh, or a shank without a thigh sensor."""

SHIN = Model(
    partial(shin_standing, angle=0.0, bias=0.0, angle_variance=1e-4), shin_transition, shin_transition_noise,
    shin_observation, shin_observation_noise,
)  # fmt: skip
"""Eleven states: the shank, with angle and rate of the thigh."""


def link_params(p: DutyCycledParams, lever: PyTree) -> LinkParams:
    """The model's parameters for a sensor at distance `lever` from its joint [m]."""
    return LinkParams(
        p.thigh_length, lever, p.angle_noise, p.acceleration_noise, p.bias_noise,
        p.position_closure**2, p.velocity_closure**2,
    )  # fmt: skip


def observe(
    p: DutyCycledParams, segment: PlanarSegment, dt: Values, still: Flags, valid: Flags, *, accelerometers: bool = True
) -> tuple[ThighObservation, DutyControl, ThighObservation]:
    """Observation, control and mask of the filter of one segment, for a recording or for one sample;
    without `accelerometers` their observations are masked.
    """
    zero = jnp.zeros_like(segment.gyr)
    rest = p.standing_acceleration**2
    acc = rest + jnp.where(still, 0.0, p.joint_acceleration**2)
    persists = 1.0 / jnp.maximum(dt, 1e-3)
    control = DutyControl(
        zero + acc, zero + rest, p.gyro_noise * segment.variance + segment.excess, zero + p.swing_noise**2 * persists,
        zero + 1.0, zero + 1.0,
    )  # fmt: skip
    feels = segment.measured & valid if accelerometers else False
    turned = segment.gyro_on & valid
    unknown, at_rest = valid & ~turned, valid & still
    observed = ThighObservation(segment.acc_up, segment.acc_forward, segment.gyr, *(zero,) * 7)
    return observed, control, ThighObservation(feels, feels, turned, *(valid,) * 4, at_rest, at_rest, unknown)


def standing(
    p: DutyCycledParams, biases: tuple[Values | None, ...], angle_variance: Values
) -> tuple[Belief | None, ...]:
    """The beliefs about thigh and shank of a leg that hangs straight down, from the gyroscopes' biases [rad/s]; None
    for a segment without a sensor.
    """
    priors = thigh_standing, thigh_standing if biases[0] is None else shin_standing
    return tuple(
        None if bias is None else prior(link_params(p, lever), 0.0, bias, angle_variance)
        for prior, lever, bias in zip(priors, levers(p), biases, strict=True)
    )


def over(
    p: DutyCycledParams, segments: tuple[PlanarSegment | None, ...],
    beliefs: tuple[Belief | None, ...], dt: Values, still: Flags, valid: Flags, *, accelerometers: bool = True,
    method: filtering.Method = filtering.EKF(),
) -> tuple[DutyEstimate, tuple[Posterior | None, ...]]:  # fmt: skip
    """Estimates of a leg's thigh and shank over samples, from the beliefs before them, and the filters' results."""
    every, posteriors = list[SegmentEstimate | None](), list[Posterior | None]()
    for segment, before, lever in zip(segments, beliefs, levers(p), strict=True):
        if segment is None or before is None:
            every.append(None)
            posteriors.append(None)
            continue
        thigh, params = every[0] if every else None, link_params(p, lever)
        observations: PyTree
        mask: PyTree
        observations, controls, mask = observe(p, segment, dt, still, valid, accelerometers=accelerometers)
        if thigh is not None:
            # Errors of the thigh's angle persist for about 1 s; equivalent white noise has the variance times 1 s / dt.
            spread = thigh.angle_stddev**2 / jnp.maximum(dt, 1e-3)
            controls = controls._replace(thigh_angle_variance=spread, thigh_rate_variance=thigh.rate_stddev**2)
            observations = ShinObservation(observations, thigh.angle, thigh.rate)
            mask = ShinObservation(mask, valid, valid)
        posterior = filtering.kalman_filter(
            THIGH if thigh is None else SHIN, params, observations, controls=controls, dt=dt, mask=mask, initial=before,
            method=method,
        )  # fmt: skip
        mean, deviation = posterior.mean, posterior.cov.stddev()
        if thigh is not None:
            mean, deviation = mean.shin, deviation.shin
        every.append(SegmentEstimate(
            mean.angle, mean.rate, deviation.angle, deviation.rate, mean.rate - mean.velocity_bias / lever,
            posterior.nis, posterior.count, posterior.log_likelihood, posterior.valid,
        ))  # fmt: skip
        posteriors.append(posterior)
    return DutyEstimate(*every), tuple(posteriors)


def run(
    p: DutyCycledParams, inputs: DutyInputs, *, accelerometers: bool = True, method: filtering.Method = filtering.EKF()
) -> DutyEstimate:
    """Angle and rate of one leg's segments under a gyroscope mask: pure, for jit, vmap and grad.

    A shank without a thigh sensor has the model of the thigh: one segment that hangs from a fixed joint. Without
    `accelerometers` (static) angles come from the gyroscopes alone and drift.

    Raises:
        ValueError: if no segment has a sensor.
    """
    thigh, shank = inputs.thigh, inputs.shank
    if thigh is None and shank is None:
        raise ValueError("the duty-cycled filters need a thigh or a shank sensor; got neither")
    biases = None if thigh is None else thigh.bias, None if shank is None else shank.bias
    beliefs = standing(p, biases, inputs.start_variance)
    return over(
        p, (thigh, shank), beliefs, inputs.dt, inputs.still, inputs.valid, accelerometers=accelerometers, method=method
    )[0]


class Turn(NamedTuple):
    """Rate of the turn after a sample [rad/s], and the time since a gyroscope was on [s]."""

    rate: Values
    since: Values


def no_turn(rates: Values) -> Turn:
    """The turn before the first sample, for rates (n, T)."""
    return Turn(jnp.zeros_like(rates[0, 0]), jnp.zeros_like(rates[0, 0]))


def turning(rates: Values, on: Flags, dt: Values, before: Turn) -> tuple[Turn, Values]:
    """How fast the person turns: mean over the segments, then over half a second, as a segment also rotates about its
    axis within each stride.

    Args:
        rates: (n, T) rate of n segments about their long axes [rad/s].
        on: (n, T) bool, the gyroscope was on and its sample arrived.
        dt: (T,) time since the previous sample [s].
        before: before the first sample.

    Returns:
        The state after the last sample, and the rate of the turn at every sample (T,) [rad/s].
    """
    count = jnp.sum(on, axis=0)
    mean = jnp.sum(jnp.where(on, rates, 0.0), axis=0) / jnp.maximum(count, 1).astype(rates.dtype)

    def step(now: Turn, sample: tuple[Values, Flags, Values]) -> tuple[Turn, Values]:
        rate, measured, dt = sample
        since = now.since + dt
        moved = now.rate + (rate - now.rate) * (1.0 - jnp.exp(-since / 0.5))
        after = Turn(jnp.where(measured, moved, now.rate), jnp.where(measured, 0.0, since))
        return after, after.rate

    return lax.scan(step, before, (mean, count > 0, jnp.asarray(dt, rates.dtype)))


def excess(tilt: Values, turning: Values, dt: Values, filled: Values) -> Values:
    """(T,) variance of a rate in addition to the gyroscope's [rad²/s²], of a segment with a `tilt` to the side [rad].

    One axis does not measure turns, but a segment that is tilted to the side measures a part of them, as if it swung:
    on `neura_sparse` a U-turn moved the thigh's angle by up to 35°. The part is nearly the same over the turn, which
    lasts about 1 s. Arguments as of
    `turning`; `filled` (T,) is the spectral density of the errors of a filled rate [rad²/s], 0 where it was measured.
    """
    return ((tilt * turning) ** 2 + filled) / jnp.maximum(jnp.asarray(dt), 1e-3)
