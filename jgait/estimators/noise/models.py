"""The noise models: records of parameters, each with the logarithm of the factor on a variance."""

from typing import Annotated, NamedTuple

import jax.numpy as jnp
import numpy as np

from jgait.estimators.noise.features import FEATURES
from jgait.notes import record
from jgait.params import Param, Parameter, documented, normal, real
from jgait.types import Values

POWER = normal(0.0, 4.0)
"""Prior of every weight of `LogLinear`: a power of 4 is that of a detector with a nearly hard threshold."""

HIDDEN = 8
"""Number of hidden units of `Network`."""

LAGS = (0, 8)
"""[samples] Each unit takes the features of now and of 8 samples, 40 ms at 200 Hz, before."""

WEIGHT = normal(0.0, 1.0)

_DRAWN = np.random.default_rng(0).normal(size=(len(LAGS) * len(FEATURES), HIDDEN)) / len(FEATURES)


class Constant(NamedTuple):
    """No parameters: every factor is 1."""

    def log_scale(self, columns: Values) -> Values:
        """Zeros (T,) for features (T, F)."""
        return jnp.zeros_like(columns[:, 0])


@documented
@record
class LogLinear(NamedTuple):
    """Weights of the features, so that a variance is a product of powers; 0 leaves a feature out."""

    rate: Annotated[Param, Parameter(real, "1", "power of `rate`", POWER)] = 0.0
    shake: Annotated[Param, Parameter(real, "1", "power of `shake`", POWER)] = 0.0
    weight: Annotated[Param, Parameter(real, "1", "power of `weight`", POWER)] = 0.0
    rate_long: Annotated[Param, Parameter(real, "1", "power of `rate_long`", POWER)] = 0.0
    shake_long: Annotated[Param, Parameter(real, "1", "power of `shake_long`", POWER)] = 0.0
    weight_long: Annotated[Param, Parameter(real, "1", "power of `weight_long`", POWER)] = 0.0
    speed: Annotated[Param, Parameter(real, "1", "power of `speed`", POWER)] = 0.0
    jolt: Annotated[Param, Parameter(real, "1", "power of `jolt`", POWER)] = 0.0
    jerk: Annotated[Param, Parameter(real, "1", "power of `jerk`", POWER)] = 0.0
    stance: Annotated[Param, Parameter(real, "1", "power of `stance`", POWER)] = 0.0
    since_contact: Annotated[Param, Parameter(real, "1", "power of `since_contact`", POWER)] = 0.0
    clipped: Annotated[Param, Parameter(real, "1", "power of `clipped`", POWER)] = 0.0

    def log_scale(self, columns: Values) -> Values:
        """Σ_f w_f φ_f (T,) for features (T, F)."""
        return columns @ jnp.stack([jnp.asarray(getattr(self, name), columns.dtype) for name in FEATURES])


@documented
@record
class Network(NamedTuple):
    """Weights of one hidden layer, 208 in all. At the start the output is 0; the first layer is drawn, with a fixed
    seed.
    """

    first: Annotated[Param, Parameter(real, "1", "weights (inputs, units) of the first layer", WEIGHT)] = _DRAWN
    shift: Annotated[Param, Parameter(real, "1", "(units,) added to the first layer", WEIGHT)] = np.zeros(HIDDEN)
    last: Annotated[Param, Parameter(real, "1", "weights (units,) of the output", WEIGHT)] = np.zeros(HIDDEN)

    def log_scale(self, columns: Values) -> Values:
        """wᵀ tanh(W [φ_k, φ_{k−8}] + c) (T,) for features (T, F); before the first sample the first is repeated."""
        before = [jnp.concatenate([jnp.repeat(columns[:1], lag, axis=0), columns])[: len(columns)] for lag in LAGS]
        first, shift, last = (jnp.asarray(leaf, columns.dtype) for leaf in self)
        return jnp.tanh(jnp.concatenate(before, axis=1) @ first + shift[None, :]) @ last
