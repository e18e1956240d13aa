"""Bennett's filter as printed: element C of equation 6, and powers of σ_θ in Q (deviations 1 and 2 of `leg_ekf`)."""

from functools import partial
from typing import Any

import jax.numpy as jnp

from jgait.estimators import leg_ekf
from jgait.estimators.leg_ekf import model as leg_model
from jgait.estimators.leg_ekf.model import LegControl, LegModelParams, LegState
from jgait.filtering import Covariance


def transition(params: LegModelParams, state: LegState, control: LegControl, dt: Any) -> LegState:
    """`leg_ekf.model.transition` with element C as printed, −a₁ sin θ₁ + a₂ sin(θ₁+θ₂), no derivative of equation 3."""
    shin = state.thigh_angle + state.knee_angle
    c = -params.thigh_length * jnp.sin(state.thigh_angle) + params.shank_length * jnp.sin(shin)
    shank_cos = params.shank_length * jnp.cos(shin)
    moved = leg_model.transition(params, state, control, dt)
    return moved._replace(y=state.y + dt * (c * state.thigh_rate + shank_cos * state.knee_rate))


def transition_noise(params: LegModelParams, state: LegState, control: LegControl, dt: Any) -> Covariance:
    """Q with the angle blocks as printed: [σ_θ³/3, σ_θ²/2; σ_θ²/2, σ_θ]."""
    del state, control, dt
    s = params.angle_noise
    return leg_model.angle_blocks(params, s**3 / 3.0, s**2 / 2.0, s)


MODEL = leg_model.MODEL._replace(transition=transition, transition_noise=transition_noise)

run = partial(leg_ekf.run, model=MODEL)
"""As `leg_ekf.run`, with the printed model."""
