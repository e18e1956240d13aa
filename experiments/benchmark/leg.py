"""The problem that the filter benchmark runs: a leg of 8 states and two gyroscopes, 50 Hz, 6 noise parameters.

    x ← x + T (−a₁ sin θ₁ ω₁ − a₂ sin(θ₁+θ₂)(ω₁+ω₂)),    θ₁ ← θ₁ + T ω₁,
    y ← y + T ( a₁ cos θ₁ ω₁ + a₂ cos(θ₁+θ₂)(ω₁+ω₂)),    θ₂ ← θ₂ + T ω₂,

observed as ω₁ + β₁ and ω₁ + ω₂ + β₂. Once on named scalars, as jgait takes it, and once on vectors, as others do.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jgait.filtering import Belief, Covariance, Model

DT = 0.02
THIGH, SHANK = 0.42, 0.43
START = (0.0, -THIGH - SHANK, -np.pi / 2, 0.0, -0.5, 0.0, 0.0, 0.0)
SPREAD = (1e-4, 1e-4, 0.05, 1.0, 0.05, 1.0, 1e-3, 1e-3)
"""Variances of the start."""

LOG_NOISE = np.log([1e-6, 1e-5, 5e-2, 1e-8, 2.5e-3, 5e-3]).astype(np.float32)
"""Of position, angle, rate and bias, each step; of both gyroscopes. Rounded, so that every type gets the same."""


class State(NamedTuple):
    x: Any
    y: Any
    thigh_angle: Any
    thigh_rate: Any
    knee_angle: Any
    knee_rate: Any
    thigh_bias: Any
    shin_bias: Any


class Rates(NamedTuple):
    thigh: Any
    shin: Any


# --- on named scalars ---


def transition(noise: Any, state: State, control: None, dt: Any) -> State:
    shin = state.thigh_angle + state.knee_angle
    shank_sin, shank_cos = SHANK * jnp.sin(shin), SHANK * jnp.cos(shin)
    leg_sin, leg_cos = THIGH * jnp.sin(state.thigh_angle) + shank_sin, THIGH * jnp.cos(state.thigh_angle) + shank_cos
    return state._replace(
        x=state.x - dt * (leg_sin * state.thigh_rate + shank_sin * state.knee_rate),
        y=state.y + dt * (leg_cos * state.thigh_rate + shank_cos * state.knee_rate),
        thigh_angle=state.thigh_angle + dt * state.thigh_rate,
        knee_angle=state.knee_angle + dt * state.knee_rate,
    )


def transition_noise(noise: Any, state: State, control: None, dt: Any) -> State:
    position, angle, rate, bias = noise[:4]
    return State(position, position, angle, rate, angle, rate, bias, bias)


def observation(noise: Any, state: State, control: None) -> Rates:
    thigh = state.thigh_rate + state.thigh_bias
    return Rates(thigh, state.thigh_rate + state.knee_rate + state.shin_bias)


def observation_noise(noise: Any, state: State, control: None) -> Rates:
    return Rates(*noise[4:])


def initial(noise: Any) -> Belief:
    return Belief(State(*START), Covariance.from_variances(State(*SPREAD)))


MODEL = Model(initial, transition, transition_noise, observation, observation_noise)


def noise_of(theta: Any) -> tuple[Any, ...]:
    """The six variances from their logarithms (6,)."""
    return tuple(jnp.exp(theta))


# --- on vectors ---


def transition_vector(state: Any) -> Any:
    return jnp.stack(transition(None, State(*state), None, DT))


def observation_vector(state: Any) -> Any:
    return jnp.stack(observation(None, State(*state), None))


def variances(theta: Any) -> tuple[Any, Any]:
    """Diagonals of Q (8,) and R (2,)."""
    noise = noise_of(theta)
    return jnp.stack(transition_noise(noise, None, None, None)), jnp.stack(observation_noise(noise, None, None))


def start_vector(dtype: Any) -> tuple[Any, Any]:
    """Mean (8,) and covariance (8, 8) before the first interval."""
    return jnp.asarray(START, dtype), jnp.diag(jnp.asarray(SPREAD, dtype))


# --- recordings ---


def recordings(count: int, samples: int, seed: int = 0) -> tuple[Any, Any]:
    """Simulated walks: rates (count, samples, 2) with noise and bias, and the ankle's path (count, samples, 2).

    All numbers are representable in float32, so that the error of a float32 filter is that of its arithmetic.
    """
    draw = np.random.default_rng(seed)
    phase = 2 * np.pi * (draw.uniform(0.8, 1.1, (count, 1)) * np.arange(samples) * DT + draw.uniform(0, 1, (count, 1)))
    thigh = -np.pi / 2 + draw.uniform(0.3, 0.45, (count, 1)) * np.sin(phase)
    knee = -0.5 + draw.uniform(0.4, 0.6, (count, 1)) * np.sin(phase + 1.0)
    rates = np.gradient(np.stack([thigh, thigh + knee], -1), DT, axis=1)
    rates += draw.normal(0.0, 0.02, (count, 1, 2)) + draw.normal(0.0, 0.05, rates.shape)
    x = THIGH * np.cos(thigh) + SHANK * np.cos(thigh + knee)
    y = THIGH * np.sin(thigh) + SHANK * np.sin(thigh + knee)
    return rates.astype(np.float32), np.stack([x, y], -1).astype(np.float32)
