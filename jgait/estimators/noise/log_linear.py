"""The log-linear noise model: the logarithm of a variance is a weighted sum of features, a product of powers."""

from typing import Annotated, NamedTuple

import jax.numpy as jnp

from jgait.estimators.noise.features import FEATURES
from jgait.estimators.noise.interface import NoiseModel
from jgait.params import Param, Parameter, documented, normal, real
from jgait.types import Values

PRIOR = normal(0.0, 4.0)
"""Of every weight: a power of 4 is that of a detector with a nearly hard threshold."""


@documented
class LogLinear(NamedTuple):
    """Weights of the features; 0 leaves a feature out."""

    rate: Annotated[Param, Parameter(real, "1", "power of `rate`", PRIOR)] = 0.0
    shake: Annotated[Param, Parameter(real, "1", "power of `shake`", PRIOR)] = 0.0
    weight: Annotated[Param, Parameter(real, "1", "power of `weight`", PRIOR)] = 0.0
    rate_long: Annotated[Param, Parameter(real, "1", "power of `rate_long`", PRIOR)] = 0.0
    shake_long: Annotated[Param, Parameter(real, "1", "power of `shake_long`", PRIOR)] = 0.0
    weight_long: Annotated[Param, Parameter(real, "1", "power of `weight_long`", PRIOR)] = 0.0
    speed: Annotated[Param, Parameter(real, "1", "power of `speed`", PRIOR)] = 0.0
    jolt: Annotated[Param, Parameter(real, "1", "power of `jolt`", PRIOR)] = 0.0
    jerk: Annotated[Param, Parameter(real, "1", "power of `jerk`", PRIOR)] = 0.0
    stance: Annotated[Param, Parameter(real, "1", "power of `stance`", PRIOR)] = 0.0
    since_contact: Annotated[Param, Parameter(real, "1", "power of `since_contact`", PRIOR)] = 0.0
    clipped: Annotated[Param, Parameter(real, "1", "power of `clipped`", PRIOR)] = 0.0


def log_scale(p: LogLinear, columns: Values) -> Values:
    """Σ_f w_f φ_f (T,) for features (T, F)."""
    weights = jnp.stack([jnp.asarray(getattr(p, name), columns.dtype) for name in FEATURES])
    return columns @ weights


LOG_LINEAR = NoiseModel(LogLinear(), log_scale)
