r"""State-space model of one sensor at the ankle or on the shank: strapdown, and zero velocity of the ankle in stance.

State: the displacement of the *ankle* since the stride began, the sensor's velocity and attitude, the biases of its
gyroscope and accelerometer, and the lever r from the ankle to the sensor, in the sensor's axes. The sensor moves as the
foot's sensor does (functions of `foot_ins.model` are used); the ankle is a lever away from the sensor,

    p' = p + Δp_sensor − (R' r − R r),        r' = r.

Around the stance valley, and while the person stands, the ankle's velocity is zero:

    v − R ((ω − b_g) × r) = 0.

Positions count from the last stance that begins a stride: at the stance that ends the stride, the belief's position is
the stride, with its covariance. No information is lost, because no observation depends on the position of the walk.

Source: the zero velocity through a lever after H. D. Silva, J. A. Afonso, L. A. Rocha, "Walk distance estimation using
an ankle-mounted inertial measurement unit", 2017, who take it for zero at the sensor; error-state navigation after
E. Foxlin, "Pedestrian tracking with shoe-mounted inertial sensors", IEEE CG&A 25(6), 2005.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jgait.estimators.foot_ins import model as foot_model
from jgait.estimators.foot_ins.model import AGAIN, FootControl, FootModelParams, FootState
from jgait.filtering import Belief, Covariance, Model
from jgait.geometry.rotation import differences, quaternion, retract, rotated
from jgait.geometry.vectors import Three, as_array, cross, subtract, vector
from jgait.types import AnyArray, Values


class AnkleState(NamedTuple):
    """Ankle's position since the stride began [m], sensor's velocity [m/s], q_ws, biases [rad/s], [m/s²], r [m]."""

    position: Three
    velocity: Three
    attitude: Float[AnyArray, "*batch 4"]
    gyr_bias: Three
    acc_bias: Three
    lever: Three


class AnkleError(NamedTuple):
    """Error of an `AnkleState`; the error of the attitude is a rotation vector in the world [rad].

    As variances: a number is the variance of each component.
    """

    position: Three | Values
    velocity: Three | Values
    attitude: Three | Values
    gyr_bias: Three | Values
    acc_bias: Three | Values
    lever: Three | Values


class AnkleControl(NamedTuple):
    """Mean readings over the interval up to the sample, see `FootControl`, and the rate at the sample [rad/s]."""

    over: FootControl
    rate: Three


class AnkleObservation(NamedTuple):
    """Velocity of the ankle while it stands [m/s]; as a mask, whether it stands."""

    velocity: Three | Values | Bool[AnyArray, "*batch"]


def transition(p: FootModelParams, s: AnkleState, u: AnkleControl, dt: Values) -> AnkleState:
    """Strapdown of the sensor over one interval, and the displacement of the ankle."""
    moved = foot_model.transition(p, FootState(*s[:5]), u.over, dt)
    after, before = (rotated(quaternion(q), vector(s.lever)) for q in (moved.attitude, s.attitude))
    return AnkleState(*moved._replace(position=moved.position - as_array(subtract(after, before))), s.lever)


def transition_noise(p: FootModelParams, s: AnkleState, u: AnkleControl, dt: Values) -> Covariance:
    """Process noise as of the foot's sensor; the lever's, a nanometre, only keeps the covariance's rank.

    The ankle's displacement from noise of the rate times the lever is left out: a fifth of a millimetre a stride.
    """
    foot_noise = foot_model.transition_noise(p, FootState(*s[:5]), u.over, dt)
    v, crossed = foot_noise.variances(), {("position", "velocity"): foot_noise["position", "velocity"]}
    every = AnkleError(v.position, v.velocity, v.attitude, v.gyr_bias, v.acc_bias, 1e-18)
    return Covariance.from_variances(every).with_entries(crossed)


def observation(p: FootModelParams, s: AnkleState, u: AnkleControl) -> AnkleObservation:
    """Velocity of the ankle [m/s], zero while it stands."""
    del p
    through = rotated(quaternion(s.attitude), cross(vector(u.rate - s.gyr_bias), vector(s.lever)))
    return AnkleObservation(s.velocity - as_array(through))


def observation_noise(p: FootModelParams, s: AnkleState, u: AnkleControl) -> AnkleObservation:
    """Variance of the zero velocity, for each sample from the control."""
    del p, s
    return AnkleObservation(u.over.velocity_variance)


def local(reference: AnkleState, s: AnkleState) -> AnkleError:
    """The error of the state `s` relative to `reference`."""
    return AnkleError(*differences(reference, s))


def initial(p: FootModelParams) -> Belief:
    """The belief of a sensor at rest and level, its z axis up, the ankle 0.1 m below it."""
    del p
    variances = AnkleError(AGAIN, 1e-2, 4e-4, 1e-6, 4e-4, 1e-4)
    return standing_belief(np.eye(4)[0], np.zeros(3), np.zeros(3), np.array([0.0, 0.0, 0.1]), variances)


def standing_belief(
    attitude: Values, velocity: Values, gyr_bias: Values, lever: Values, variances: AnkleError
) -> Belief:
    """The belief at a stance, before its sample: the sensor's velocity [m/s] and lever from the ankle [m]."""
    nothing = jnp.zeros_like(gyr_bias)
    mean = AnkleState(nothing, velocity, attitude, gyr_bias, nothing, lever)
    return Belief(mean, Covariance.from_variances(variances))


MODEL = Model(initial, transition, transition_noise, observation, observation_noise, retract, local)
"""The model of one ankle."""
