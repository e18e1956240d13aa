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

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jgait.filtering import Belief, Covariance, Model
from jgait.geometry.rotation import differences, near_unit, product, quaternion, retract, rotated, small_turn
from jgait.geometry.vectors import GRAVITY, Three, as_array, vector
from jgait.types import AnyArray, Values


class FootState(NamedTuple):
    """The sensor: position [m] from the last foothold, velocity [m/s], attitude q_ws, biases [rad/s], [m/s²]."""

    position: Three
    velocity: Three
    attitude: Float[AnyArray, "*batch 4"]
    gyr_bias: Three
    acc_bias: Three


class FootError(NamedTuple):
    """Error of a `FootState`; the attitude error is a rotation vector in the world [rad].

    As variances: a number is the variance of each component.
    """

    position: Three | Values
    velocity: Three | Values
    attitude: Three | Values
    gyr_bias: Three | Values
    acc_bias: Three | Values


class FootControl(NamedTuple):
    """Signals of the sensor over one interval, and the variances of their errors."""

    gyr: Three  #: mean angular rate [rad/s].
    acc: Three  #: mean specific force [m/s²].
    gyr_density: Values  #: spectral density of the rate's error [rad²/s].
    acc_density: Values  #: spectral density of the force's error [m²/s³].
    velocity_variance: Values  #: of the zero-velocity observation at this sample [m²/s²].
    restart: Values  #: 1 where the interval begins at a foothold, at which the position is set to zero; else 0.


class FootObservation(NamedTuple):
    """Observation in stance: velocity minus that of the rotation about the pivot [m/s], and height [m]; both zero.

    As a mask: whether each is observed.
    """

    velocity: Three | Values | Bool[AnyArray, "*batch"]
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
    half = small_turn(vector(0.5 * dt * (u.gyr - s.gyr_bias)))
    middle = product(quaternion(s.attitude), half)
    force = as_array(rotated(middle, vector(u.acc - s.acc_bias)))
    acceleration = force - jnp.asarray([0.0, 0.0, GRAVITY], force.dtype)
    return FootState(
        position=(1.0 - u.restart) * s.position + (dt * s.velocity + 0.5 * dt * dt * acceleration),
        velocity=s.velocity + dt * acceleration,
        attitude=as_array(near_unit(product(middle, half))),
        gyr_bias=s.gyr_bias,
        acc_bias=s.acc_bias,
    )


def transition_noise(p: FootModelParams, s: FootState, u: FootControl, dt: Values) -> Covariance:
    """White noise of both sensors, the same in all directions, and random walks of their biases."""
    del s
    a = u.acc_density * dt
    every = FootError(
        position=a * dt * dt / 3.0 + AGAIN * u.restart,
        velocity=a,
        attitude=u.gyr_density * dt,
        gyr_bias=p.gyr_bias_walk * dt,
        acc_bias=p.acc_bias_walk * dt,
    )
    return Covariance.from_variances(every).with_entries({("position", "velocity"): 0.5 * a * dt})


def observation(p: FootModelParams, s: FootState, u: FootControl) -> FootObservation:
    """Velocity minus that of the rotation about the pivot, and height above the last foothold."""
    rate = rotated(quaternion(s.attitude), vector(u.gyr - s.gyr_bias))
    r, v = p.pivot_height, vector(s.velocity)
    return FootObservation(as_array((v.x - r * rate.y, v.y + r * rate.x, v.z)), s.position[..., 2])


def observation_noise(p: FootModelParams, s: FootState, u: FootControl) -> FootObservation:
    """Variances of the zero velocity, from the control, and of the height of level ground."""
    del s
    return FootObservation(u.velocity_variance, p.height_variance)


def local(reference: FootState, s: FootState) -> FootError:
    """The error of the state `s` relative to `reference`."""
    return FootError(*differences(reference, s))


def initial(p: FootModelParams) -> Belief:
    """The belief of a sensor at rest with its z axis vertical."""
    del p
    return standing_belief(np.eye(4)[0], np.zeros(3), FootError(1e-8, 1e-6, 4e-4, 1e-7, 4e-4))


def standing_belief(attitude: Values, gyr_bias: Values, variances: FootError) -> Belief:
    """The belief about a sensor at rest, before the first sample; gyroscope bias [rad/s]."""
    zero = jnp.zeros_like(gyr_bias)
    return Belief(FootState(zero, zero, attitude, gyr_bias, zero), Covariance.from_variances(variances))


MODEL = Model(initial, transition, transition_noise, observation, observation_noise, retract, local)
"""State-space model of one foot."""
