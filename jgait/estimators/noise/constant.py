"""The noise model without parameters: every factor is 1."""

from typing import NamedTuple

import jax.numpy as jnp

from jgait.estimators.noise.interface import NoiseModel
from jgait.types import Values


class Constant(NamedTuple):
    """No parameters."""


def log_scale(p: Constant, columns: Values) -> Values:
    """Zeros (T,) for features (T, F)."""
    del p
    return jnp.zeros_like(columns[:, 0])


CONSTANT = NoiseModel(Constant(), log_scale)
