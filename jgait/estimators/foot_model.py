r"""One foot's inertial sensor as a state-space model: strapdown integration, and a foot that stands.

State: where the sensor is and how it moves in a world with z up, its attitude, and what its gyroscope and
accelerometer read too much. Errors of the attitude are rotation vectors in the world, δ with q' = exp(δ) q.

    p' = p + h v + h²/2 a        a = R(q ω̃ half an interval on) (f − b_a) − g
    v' = v + h a
    q' = q exp(h (ω − b_g))

Where the foot stands it turns about a point on the ground, a height r under the sensor, and the ground is level:

    v − ω_w × (0, 0, r) = 0,    p_z = 0

Positions are counted from the last foothold: at each the position starts again at zero. Nothing observes where the
walk is as a whole, so nothing is lost; the belief at the next foothold is that of the stride, with its covariance,
and numbers stay small enough for float32 however long the walk.

Source: error-state navigation with zero-velocity updates after E. Foxlin, "Pedestrian tracking with shoe-mounted
inertial sensors", IEEE CG&A 25(6), 2005, and the smoother's use in gait after Potter et al., who name such a filter as
the source of their foot trajectories. The pivot and noise that follows the signal are this library's own.
"""

from typing import Any, NamedTuple

from jgait.filtering import Belief, Covariance, Model
from jgait.kinematics import GRAVITY, Vector, add, scale, subtract
from jgait.rotation import Quaternion, conjugate, exponential, logarithm, normalised, product, rotated


class FootState(NamedTuple):
    """The sensor: position [m] from the last foothold, velocity [m/s], attitude q_ws, biases [rad/s], [m/s²]."""

    position: Vector
    velocity: Vector
    attitude: Quaternion
    gyr_bias: Vector
    acc_bias: Vector


class FootError(NamedTuple):
    """Its error: as `FootState`, the attitude's a rotation vector in the world [rad]."""

    position: Vector
    velocity: Vector
    attitude: Vector
    gyr_bias: Vector
    acc_bias: Vector


class FootControl(NamedTuple):
    """What the sensor reads over one interval, and how far to trust it.

    Attributes:
        gyr: mean angular rate [rad/s].
        acc: mean specific force [m/s²].
        gyr_density: spectral density of the rate's error [rad²/s].
        acc_density: spectral density of the force's error [m²/s³].
        velocity_variance: of the zero velocity at this sample [m²/s²].
        restart: 1 where the interval begins at a foothold from which positions count anew, else 0.
    """

    gyr: Vector
    acc: Vector
    gyr_density: Any
    acc_density: Any
    velocity_variance: Any
    restart: Any


class FootObservation(NamedTuple):
    """What holds while a foot stands: velocity beside that of the pivot [m/s], height [m]; both zero."""

    velocity: Vector
    height: Any


class FootModelParams(NamedTuple):
    """What the model needs to know.

    Attributes:
        pivot_height: r, of the sensor over the point that it turns about while standing [m].
        gyr_bias_walk: spectral density of the bias's walk [rad²/s³].
        acc_bias_walk: the same of the accelerometer [m²/s⁵].
        height_variance: of level ground from one foothold to the next [m²].
    """

    pivot_height: Any
    gyr_bias_walk: Any
    acc_bias_walk: Any
    height_variance: Any


AGAIN = 1e-12
"""Variance of the position where it starts anew [m²]: a micrometre, so that covariances keep their rank."""


def transition(p: FootModelParams, s: FootState, u: FootControl, dt: Any) -> FootState:
    """Strapdown integration over one interval, the force turned by the attitude half way."""
    del p
    rate = subtract(u.gyr, s.gyr_bias)
    half = exponential(scale(0.5 * dt, rate))
    middle = product(s.attitude, half)
    force = rotated(middle, subtract(u.acc, s.acc_bias))
    acceleration = Vector(force.x, force.y, force.z - GRAVITY)
    went = add(scale(dt, s.velocity), scale(0.5 * dt * dt, acceleration))
    since = scale(1.0 - u.restart, s.position)
    return FootState(
        position=add(since, went),
        velocity=add(s.velocity, scale(dt, acceleration)),
        attitude=normalised(product(middle, half)),
        gyr_bias=s.gyr_bias,
        acc_bias=s.acc_bias,
    )


def transition_noise(p: FootModelParams, s: FootState, u: FootControl, dt: Any) -> Covariance:
    """White noise of both sensors, the same in all directions, and walking biases."""
    del s
    a = u.acc_density * dt
    every = FootError(
        position=_three(a * dt * dt / 3.0 + AGAIN * u.restart),
        velocity=_three(a),
        attitude=_three(u.gyr_density * dt),
        gyr_bias=_three(p.gyr_bias_walk * dt),
        acc_bias=_three(p.acc_bias_walk * dt),
    )
    crossed = {(f"position.{axis}", f"velocity.{axis}"): 0.5 * a * dt for axis in "xyz"}
    return Covariance.from_variances(every).with_entries(crossed)


def observation(p: FootModelParams, s: FootState, u: FootControl) -> FootObservation:
    """Velocity beside that of a foot which turns about its pivot, and height over the last foothold."""
    rate = rotated(s.attitude, subtract(u.gyr, s.gyr_bias))
    r = p.pivot_height
    v = s.velocity
    return FootObservation(Vector(v.x - r * rate.y, v.y + r * rate.x, v.z), s.position.z)


def observation_noise(p: FootModelParams, s: FootState, u: FootControl) -> FootObservation:
    """Of the zero velocity as it comes, and of the level ground."""
    del s
    return FootObservation(_three(u.velocity_variance), p.height_variance)


def retract(s: FootState, e: FootError) -> FootState:
    """The state at an error from another."""
    return FootState(
        add(s.position, e.position),
        add(s.velocity, e.velocity),
        normalised(product(exponential(e.attitude), s.attitude)),
        add(s.gyr_bias, e.gyr_bias),
        add(s.acc_bias, e.acc_bias),
    )


def local(reference: FootState, s: FootState) -> FootError:
    """The error of a state about another."""
    return FootError(
        subtract(s.position, reference.position),
        subtract(s.velocity, reference.velocity),
        logarithm(product(s.attitude, conjugate(reference.attitude))),
        subtract(s.gyr_bias, reference.gyr_bias),
        subtract(s.acc_bias, reference.acc_bias),
    )


def initial(p: FootModelParams) -> Belief:
    """At rest and level, with the sensor's z axis up."""
    del p
    return standing_belief(Quaternion(1.0, 0.0, 0.0, 0.0), Vector(0.0, 0.0, 0.0), FootError(*map(_three, _START)))


_START = (1e-8, 1e-6, 4e-4, 1e-7, 4e-4)


def standing_belief(attitude: Quaternion, gyr_bias: Vector, variances: FootError) -> Belief:
    """The belief about a sensor at rest, before the first sample.

    Args:
        attitude: of the sensor.
        gyr_bias: [rad/s].
        variances: of the errors.
    """
    zero = _three(0.0 * gyr_bias.x)
    return Belief(FootState(zero, zero, attitude, gyr_bias, zero), Covariance.from_variances(variances))


def _three(value: Any) -> Vector:
    return Vector(value, value, value)


MODEL = Model(initial, transition, transition_noise, observation, observation_noise, retract, local)
"""One foot."""
