r"""State-space model of one foot's inertial sensor: strapdown integration in swing, a constraint in stance.

State: position and velocity of the sensor in a world with z up, its attitude, and the biases of its gyroscope and
accelerometer. Errors of the attitude are rotation vectors in the world, δ with q' = exp(δ) q.

    p' = p + h v + h²/2 a        a = R(q ω̃ half an interval on) (f − b_a) − g
    v' = v + h a
    q' = q exp(h (ω − b_g))

In stance the foot rotates about a point on the ground, at height r below the sensor, and the ground is level:

    v − ω_w × (0, 0, r) = 0,    p_z = 0

Positions are relative to the last foothold: the position is set to zero at each foothold. No sensor observes the
absolute position, so no information is lost; the position at the next foothold, with its covariance, is that of the
stride, and its values stay small enough for float32 in recordings of any length.

Source: error-state navigation with zero-velocity updates after E. Foxlin, "Pedestrian tracking with shoe-mounted
inertial sensors", IEEE CG&A 25(6), 2005, and the smoother's use in gait after Potter et al., who name such a filter as
the source of their foot trajectories. The pivot and the noise that grows with the signal are additions of this library.
"""

from typing import NamedTuple

from jgait.estimators.error_state import differences, near_unit, retract
from jgait.filtering import Belief, Covariance, Model
from jgait.geometry.rotation import Quaternion, product, rotated, small_turn
from jgait.geometry.vectors import GRAVITY, Vector, add, scale, subtract
from jgait.types import Flags, Values


class FootState(NamedTuple):
    """The sensor: position [m] from the last foothold, velocity [m/s], attitude q_ws, biases [rad/s], [m/s²]."""

    position: Vector
    velocity: Vector
    attitude: Quaternion
    gyr_bias: Vector
    acc_bias: Vector


class FootError(NamedTuple):
    """Error of a `FootState`; the attitude error is a rotation vector in the world [rad]."""

    position: Vector
    velocity: Vector
    attitude: Vector
    gyr_bias: Vector
    acc_bias: Vector


class FootControl(NamedTuple):
    """Signals of the sensor over one interval, and the variances of their errors."""

    gyr: Vector  #: mean angular rate [rad/s].
    acc: Vector  #: mean specific force [m/s²].
    gyr_density: Values  #: spectral density of the rate's error [rad²/s].
    acc_density: Values  #: spectral density of the force's error [m²/s³].
    velocity_variance: Values  #: of the zero-velocity observation at this sample [m²/s²].
    restart: Flags  #: 1 where the interval begins at a foothold, at which the position is set to zero; else 0.


class FootObservation(NamedTuple):
    """Observation in stance: velocity minus that of the rotation about the pivot [m/s], and height [m]; both zero."""

    velocity: Vector
    height: Values


class FootModelParams(NamedTuple):
    """Parameters of the model."""

    pivot_height: Values  #: r, height of the sensor above the point that the foot rotates about in stance [m].
    gyr_bias_walk: Values  #: spectral density of the random walk of the gyroscope bias [rad²/s³].
    acc_bias_walk: Values  #: spectral density of the random walk of the accelerometer bias [m²/s⁵].
    height_variance: Values  #: variance of the height of level ground from one foothold to the next [m²].


AGAIN = 1e-12
"""Variance of the position after it is set to zero [m²]: one micrometre squared keeps the covariance regular."""


def transition(p: FootModelParams, s: FootState, u: FootControl, dt: Values) -> FootState:
    """Strapdown integration over one interval; the attitude at mid-interval rotates the specific force."""
    del p
    half, middle, force = _midway(s, u, dt)
    acceleration = Vector(force.x, force.y, force.z - GRAVITY)
    went = add(scale(dt, s.velocity), scale(0.5 * dt * dt, acceleration))
    since = scale(1.0 - u.restart, s.position)
    return FootState(
        position=add(since, went),
        velocity=add(s.velocity, scale(dt, acceleration)),
        attitude=near_unit(product(middle, half)),
        gyr_bias=s.gyr_bias,
        acc_bias=s.acc_bias,
    )


def _midway(s: FootState, u: FootControl, dt: Values) -> tuple[Quaternion, Quaternion, Vector]:
    """The rotation of half an interval, and at mid-interval the attitude and the specific force in the world."""
    half = small_turn(scale(0.5 * dt, subtract(u.gyr, s.gyr_bias)))
    middle = product(s.attitude, half)
    return half, middle, rotated(middle, subtract(u.acc, s.acc_bias))


def transition_noise(p: FootModelParams, s: FootState, u: FootControl, dt: Values) -> Covariance:
    """White noise of both sensors, the same in all directions, and random walks of their biases."""
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
    """Velocity minus that of the rotation about the pivot, and height above the last foothold."""
    rate = rotated(s.attitude, subtract(u.gyr, s.gyr_bias))
    r = p.pivot_height
    v = s.velocity
    return FootObservation(Vector(v.x - r * rate.y, v.y + r * rate.x, v.z), s.position.z)


def observation_noise(p: FootModelParams, s: FootState, u: FootControl) -> FootObservation:
    """Variances of the zero velocity, from the control, and of the height of level ground."""
    del s
    return FootObservation(_three(u.velocity_variance), p.height_variance)


def local(reference: FootState, s: FootState) -> FootError:
    """The error of the state `s` relative to `reference`."""
    return FootError(*differences(reference, s))


def initial(p: FootModelParams) -> Belief:
    """The belief of a sensor at rest with its z axis vertical."""
    del p
    variances = FootError(*map(_three, (1e-8, 1e-6, 4e-4, 1e-7, 4e-4)))
    return standing_belief(Quaternion(1.0, 0.0, 0.0, 0.0), Vector(0.0, 0.0, 0.0), variances)


def standing_belief(attitude: Quaternion, gyr_bias: Vector, variances: FootError) -> Belief:
    """The belief about a sensor at rest, before the first sample; gyroscope bias [rad/s]."""
    zero = _three(0.0 * gyr_bias.x)
    return Belief(FootState(zero, zero, attitude, gyr_bias, zero), Covariance.from_variances(variances))


def _three(value: Values) -> Vector:
    return Vector(value, value, value)


MODEL = Model(
    initial, transition, transition_noise, observation, observation_noise, retract, local,
)  # fmt: skip
"""State-space model of one foot."""
