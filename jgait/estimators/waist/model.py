r"""State-space model of walking over speed and accelerometer bias, one time step per step.

State at an initial contact: the distance walked D, the last step's length d and the last stride's length e, the forward
speed v, and the bias b of the forward acceleration (from accelerometer and tilt). With the integral J of the forward
acceleration over the step, the integral I of J, and the step's duration T,

    d' = v T + I − b T² / 2,    v' = v + J − b T,    D' = D + d',    e' = d + d'.

Two observations are zero: d − K λ, where λ is the inverted pendulum's step length and K its constant; and v while the
person stands. Steps beside standing are not those of a pendulum, and only integrated. Over a pause between bouts the
distance and the bias are kept, and the speed restarts from its prior.

Source: inverted pendulum after W. Zijlstra, A. L. Hof, "Assessment of spatio-temporal gait parameters from trunk
accelerations during human walking", Gait and Posture 18, 2003. Joining it and the integrated acceleration in one model
is this library's own.
"""

from typing import NamedTuple

import jax.numpy as jnp

from jgait.filtering import Belief, Covariance, Model
from jgait.types import Values


class WaistState(NamedTuple):
    """Distance [m], last step [m], last stride [m], speed [m/s], bias [m/s²]."""

    distance: Values
    step: Values
    stride: Values
    speed: Values
    bias: Values


class WaistControl(NamedTuple):
    """Inputs of the model for one interval between nodes."""

    gained: Values  #: J, change of speed from the accelerometer [m/s].
    went: Values  #: I, distance from the accelerometer, without the speed at the start [m].
    walks: Values  #: 1 where the person walks over the interval, 0 in a pause, at the start and in padding.
    turn: Values  #: turn of the walk over the interval [rad].
    pendulum: Values  #: λ, the inverted pendulum's step length for a constant of 1 [m].
    pendulum_variance: Values  #: variance of the pendulum's step length [m²].


class WaistObservation(NamedTuple):
    """Observations at a node, all zero: step minus the pendulum's [m], speed [m/s]."""

    pendulum: Values
    speed: Values


class WaistModelParams(NamedTuple):
    """Parameters of the model: variances and spectral densities, see `WaistParams`."""

    speed_density: Values
    bias_variance: Values
    bias_density: Values
    turn_variance: Values
    start_speed: Values
    start_speed_variance: Values
    standing_variance: Values
    constant: Values


_STILL = 1e-10
"""[m²] Process noise that keeps the covariance at full rank: the square of ten micrometres."""


def transition(p: WaistModelParams, s: WaistState, u: WaistControl, dt: Values) -> WaistState:
    """The state after one step or one pause."""
    step = u.walks * (dt * s.speed + u.went - 0.5 * dt * dt * s.bias)
    speed = u.walks * (s.speed + u.gained - dt * s.bias) + (1.0 - u.walks) * p.start_speed
    return WaistState(s.distance + step, step, u.walks * (s.step + step), speed, s.bias)


def transition_noise(p: WaistModelParams, s: WaistState, u: WaistControl, dt: Values) -> WaistState:
    """Process noise variances of speed and bias; a turn of the walk changes a bias that is fixed in the world."""
    del s
    turned = 0.5 - 0.5 * jnp.cos(u.turn)
    speed = u.walks * p.speed_density * dt + (1.0 - u.walks) * p.start_speed_variance
    bias = p.bias_density * dt + p.turn_variance * turned + _STILL
    return WaistState(_STILL, _STILL, _STILL, speed + _STILL, bias)


def observation(p: WaistModelParams, s: WaistState, u: WaistControl) -> WaistObservation:
    """The step minus the pendulum's step, and the speed."""
    return WaistObservation(s.step - p.constant * u.pendulum, s.speed)


def observation_noise(p: WaistModelParams, s: WaistState, u: WaistControl) -> WaistObservation:
    """Variances of the observations, whose errors are white from step to step."""
    del s
    return WaistObservation(u.pendulum_variance, p.standing_variance)


def initial(p: WaistModelParams) -> Belief:
    """The belief before the first node: distance zero, speed and bias uncertain."""
    zero = 0.0 * p.start_speed
    mean = WaistState(zero, zero, zero, p.start_speed, zero)
    variances = WaistState(_STILL, _STILL, _STILL, p.start_speed_variance, p.bias_variance)
    return Belief(mean, Covariance.from_variances(variances))


MODEL = Model(initial, transition, transition_noise, observation, observation_noise)
"""The model of one walk, one time step per step."""
