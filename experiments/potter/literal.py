"""Potter's filter as printed: row 5 of equation 3 and row 2 of equation 6 (deviation 1 of `stride_width_ekf`)."""

from functools import partial
from typing import Any

import jax.numpy as jnp

from jgait.estimators import stride_width_ekf
from jgait.estimators.stride_width_ekf import model as width_model
from jgait.estimators.stride_width_ekf.model import WidthControl, WidthObservation, WidthState
from jgait.estimators.stride_width_ekf.params import WidthParams


def transition(params: WidthParams, state: WidthState, control: WidthControl, dt: Any) -> WidthState:
    """Equation 3 as printed: its row 5 takes the left foot's way forward off its y."""
    moved = width_model.transition(params, state, control, dt)
    twice = 2.0 * control.left.dx * jnp.sin(moved.heading_left)
    return moved._replace(apart_y=moved.apart_y - twice, moved_y_left=moved.moved_y_left - twice)


def observation(params: WidthParams, state: WidthState, control: WidthControl) -> WidthObservation:
    """Equation 6 as printed: − (y_R − y_L) sin θ_L in its second row."""
    right = width_model.observation(params, state, control)
    return right._replace(along=right.along + 2.0 * state.apart_y * jnp.sin(state.heading_left))


MODEL = width_model.MODEL._replace(transition=transition, observation=observation)

run = partial(stride_width_ekf.run, model=MODEL)
"""As `stride_width_ekf.run`, with the printed model."""
