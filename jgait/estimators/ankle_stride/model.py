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

from jgait.estimators.error_state import differences, retract
from jgait.estimators.foot_ins import model as foot_model
from jgait.estimators.foot_ins.model import AGAIN, FootControl, FootModelParams, FootState
from jgait.filtering import Belief, Covariance, Model
from jgait.geometry.rotation import Quaternion, rotated
from jgait.geometry.vectors import Vector, cross, subtract
from jgait.types import Values


class AnkleState(NamedTuple):
    """Ankle's position since the stride began [m], sensor's velocity [m/s], q_ws, biases [rad/s], [m/s²], r [m]."""

    position: Vector
    velocity: Vector
    attitude: Quaternion
    gyr_bias: Vector
    acc_bias: Vector
    lever: Vector


class AnkleError(NamedTuple):
    """Error of an `AnkleState`; the error of the attitude is a rotation vector in the world [rad]."""

    position: Vector
    velocity: Vector
    attitude: Vector
    gyr_bias: Vector
    acc_bias: Vector
    lever: Vector


class AnkleControl(NamedTuple):
    """Mean readings over the interval up to the sample, see `FootControl`, and the rate at the sample [rad/s]."""

    over: FootControl
    rate: Vector


def transition(p: FootModelParams, s: AnkleState, u: AnkleControl, dt: Values) -> AnkleState:
    """Strapdown of the sensor over one interval, and the displacement of the ankle."""
    moved = foot_model.transition(p, _sensor(s), u.over, dt)
    swung = subtract(rotated(moved.attitude, s.lever), rotated(s.attitude, s.lever))
    return AnkleState(*moved._replace(position=subtract(moved.position, swung)), s.lever)


def transition_noise(p: FootModelParams, s: AnkleState, u: AnkleControl, dt: Values) -> Covariance:
    """Process noise as of the foot's sensor; the lever's, a nanometre, only keeps the covariance's rank.

    The ankle's displacement from noise of the rate times the lever is left out: a fifth of a millimetre a stride.
    """
    foot_noise = foot_model.transition_noise(p, _sensor(s), u.over, dt)
    v = foot_noise.variances()
    every = AnkleError(v.position, v.velocity, v.attitude, v.gyr_bias, v.acc_bias, Vector(_STILL, _STILL, _STILL))
    crossed = {
        (f"position.{axis}", f"velocity.{axis}"): foot_noise[f"position.{axis}", f"velocity.{axis}"] for axis in "xyz"
    }
    return Covariance.from_variances(every).with_entries(crossed)


_STILL = 1e-18


def observation(p: FootModelParams, s: AnkleState, u: AnkleControl) -> Vector:
    """Velocity of the ankle [m/s], zero while it stands."""
    del p
    through = rotated(s.attitude, cross(subtract(u.rate, s.gyr_bias), s.lever))
    return subtract(s.velocity, through)


def observation_noise(p: FootModelParams, s: AnkleState, u: AnkleControl) -> Vector:
    """Variance of the zero velocity, for each sample from the control."""
    del p, s
    return Vector(*(u.over.velocity_variance,) * 3)


def local(reference: AnkleState, s: AnkleState) -> AnkleError:
    """The error of the state `s` relative to `reference`."""
    return AnkleError(*differences(reference, s))


def initial(p: FootModelParams) -> Belief:
    """The belief of a sensor at rest and level, its z axis up, the ankle 0.1 m below it."""
    del p
    nothing = Vector(0.0, 0.0, 0.0)
    return standing_belief(
        Quaternion(1.0, 0.0, 0.0, 0.0), nothing, nothing, Vector(0.0, 0.0, 0.1),
        AnkleError(*(Vector(v, v, v) for v in (AGAIN, 1e-2, 4e-4, 1e-6, 4e-4, 1e-4))),
    )  # fmt: skip


def standing_belief(
    attitude: Quaternion, velocity: Vector, gyr_bias: Vector, lever: Vector, variances: AnkleError
) -> Belief:
    """The belief at a stance, before its sample: the sensor's velocity [m/s] and lever from the ankle [m]."""
    zero = 0.0 * gyr_bias.x
    nothing = Vector(zero, zero, zero)
    mean = AnkleState(nothing, velocity, attitude, gyr_bias, nothing, lever)
    return Belief(mean, Covariance.from_variances(variances))


def _sensor(s: AnkleState) -> FootState:
    return FootState(*s[:5])


MODEL = Model(
    initial, transition, transition_noise, observation, observation_noise, retract, local,
)  # fmt: skip
"""The model of one ankle."""
