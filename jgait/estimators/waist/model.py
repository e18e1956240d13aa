r"""Walking as the waist feels it, one step at a time: a state-space model over speed, bias and pendulum.

State at an initial contact: the way walked D, the last step d and the last stride e, the forward speed v, what the
forward accelerometer (and the tilt behind it) reads too much, b, and the logarithm of the pendulum's constant, k. With
the integral of the forward acceleration over the step, J, its integral I, and its duration T,

    d' = v T + I − b T² / 2,    v' = v + J − b T,    D' = D + d',    e' = d + d'.

What is known of each step, all of it zero: d − exp(k) λ, where λ is the inverted pendulum's step; d − T u, where u is
the mean speed that the velocity update gives; and v while standing. A pause carries the way, bias and constant over,
and speed starts anew.

Source: inverted pendulum after W. Zijlstra, A. L. Hof, "Assessment of spatio-temporal gait parameters from trunk
accelerations during human walking", Gait and Posture 18, 2003; velocity update after A. Köse, A. Cereatti, U. Della
Croce, 2011. Joining them in one model is this library's own.
"""

from typing import NamedTuple

import jax.numpy as jnp

from jgait.filtering import Belief, Covariance, Model
from jgait.types import Values


class WaistState(NamedTuple):
    """Way [m], last step [m], last stride [m], speed [m/s], bias [m/s²], logarithm of the pendulum's constant [1]."""

    distance: Values
    step: Values
    stride: Values
    speed: Values
    bias: Values
    log_constant: Values


class WaistControl(NamedTuple):
    """What is known of one interval.

    Attributes:
        gained: J, change of speed that the accelerometer tells [m/s].
        went: I, way that it tells beyond the speed at the start [m].
        walks: 1 where the person walks over the interval, 0 in a pause, at the start and in padding.
        turn: by how much the person turns over it [rad].
        pendulum: λ, the inverted pendulum's step for a constant of 1 [m].
        pendulum_variance: of it [m²].
        update: u, mean speed by the velocity update [m/s].
        update_variance: of it [m²/s²].
        duration: T [s].
    """

    gained: Values
    went: Values
    walks: Values
    turn: Values
    pendulum: Values
    pendulum_variance: Values
    update: Values
    update_variance: Values
    duration: Values


class WaistObservation(NamedTuple):
    """What holds at a node, all zero: step beside the pendulum's [m], beside the update's [m]; speed [m/s]."""

    pendulum: Values
    update: Values
    speed: Values


class WaistModelParams(NamedTuple):
    """What the model needs to know: variances and spectral densities, see `WaistParams`."""

    speed_density: Values
    bias_variance: Values
    bias_density: Values
    turn_variance: Values
    start_speed: Values
    start_speed_variance: Values
    standing_variance: Values
    log_constant: Values
    constant_variance: Values


_STILL = 1e-10
"""Variance that keeps a covariance's rank: of a way of ten micrometres [m²]."""


def transition(p: WaistModelParams, s: WaistState, u: WaistControl, dt: Values) -> WaistState:
    """One step, or a pause."""
    step = u.walks * (dt * s.speed + u.went - 0.5 * dt * dt * s.bias)
    speed = u.walks * (s.speed + u.gained - dt * s.bias) + (1.0 - u.walks) * p.start_speed
    return WaistState(s.distance + step, step, u.walks * (s.step + step), speed, s.bias, s.log_constant)


def transition_noise(p: WaistModelParams, s: WaistState, u: WaistControl, dt: Values) -> WaistState:
    """Of speed and bias; a bias fixed in the world turns round with the person."""
    del s
    turned = 0.5 - 0.5 * jnp.cos(u.turn)
    speed = u.walks * p.speed_density * dt + (1.0 - u.walks) * p.start_speed_variance
    bias = p.bias_density * dt + p.turn_variance * turned + _STILL
    return WaistState(_STILL, _STILL, _STILL, speed + _STILL, bias, _STILL)


def observation(p: WaistModelParams, s: WaistState, u: WaistControl) -> WaistObservation:
    """By how much the step differs from the pendulum's and the update's, and the speed."""
    del p
    return WaistObservation(s.step - jnp.exp(s.log_constant) * u.pendulum, s.step - u.duration * u.update, s.speed)


def observation_noise(p: WaistModelParams, s: WaistState, u: WaistControl) -> WaistObservation:
    """White from step to step."""
    del s
    return WaistObservation(u.pendulum_variance, u.duration * u.duration * u.update_variance, p.standing_variance)


def initial(p: WaistModelParams) -> Belief:
    """Before the first node: nothing walked, speed and bias not known."""
    zero = 0.0 * p.start_speed
    mean = WaistState(zero, zero, zero, p.start_speed, zero, p.log_constant)
    variances = WaistState(_STILL, _STILL, _STILL, p.start_speed_variance, p.bias_variance, p.constant_variance)
    return Belief(mean, Covariance.from_variances(variances))


MODEL = Model(initial, transition, transition_noise, observation, observation_noise)
"""One walk, a row a step."""
