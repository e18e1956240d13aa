r"""Attitude of the trunk in the world: a Kalman filter on attitude and the biases of gyroscope and accelerometer.

State: the attitude q_ws in a world with z up, the gyroscope bias b_g and the accelerometer bias b_a. Errors of the
attitude are rotation vectors in the world, δ with q' = exp(δ) q. Over an interval h with the mean rate ω,

    q' = q exp(h (ω − b_g)),        z = R(q) (f − b_a) = (0, 0, g) + noise,
    δ' = δ − h R(q) J(φ) δ_bg,      δ_z = δ × R(q) (f − b_a) − R(q) δ_ba,      φ = h (ω − b_g),

with J the left Jacobian of the exponential.

The noise of z is the acceleration of the trunk, small while standing and large while walking; while walking, tilt
follows the gyroscope over seconds and gravity over longer times. An accelerometer bias looks like a lean that turns
with the trunk; a turn of the walk separates bias from lean. Heading has no reference and is not needed.

The covariance at the start is small if the person stands: a large one takes the push of the first step for a lean.

Source: gravity as reference of a Kalman filter on attitude after A. M. Sabatini, "Kalman-filter-based orientation
determination using inertial/magnetic sensors", Sensors 11(10), 2011; Köse and others cite their own, whose equations
and parameters are not printed.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jgait.filtering import Belief, Covariance, Model
from jgait.geometry.arrays import xp
from jgait.geometry.rotation import differences, normalised, product, quaternion, retract, rotated, small_turn
from jgait.geometry.vectors import GRAVITY, Three, as_array, vector
from jgait.types import AnyArray, Values


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
    """Parameters of the model."""

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


MODEL = Model(
    initial, transition, transition_noise, observation, observation_noise, retract, local,
)  # fmt: skip
"""The model of one sensor on the trunk."""
