"""Noise models: how the variance of a measurement follows the signals, learned from walks.

A model is a record of parameters and one function, log_scale(parameters, features) → (T,), the logarithm of the factor
on a variance. With the parameters of `start` every factor is 1, so that a tuning starts at the constant; their priors
keep them near 0 where walks are few. The type of the parameters selects the model, so an estimator needs no option.

| name | factor on the variance | parameters |
|---|---|---|
| `constant` | 1 | none |
| `log_linear` | a product of powers of the features | one for each feature |
| `network` | from one hidden layer on the features of a causal window | 208 weights |

`noise.features` has the features, and says which of them use samples after the one that they describe.
"""

from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jgait.estimators.noise.features import FEATURES
from jgait.params import Param, Parameter, documented, normal, real
from jgait.types import Values

POWER = normal(0.0, 4.0)
"""Prior of every weight of `LogLinear`: a power of 4 is that of a detector with a nearly hard threshold."""

WEIGHT = normal(0.0, 1.0)
"""Prior of every weight of `Network`."""

HIDDEN = 8
"""Number of hidden units."""

LAGS = (0, 8)
"""[samples] Each unit takes the features of now and of 8 samples, 40 ms at 200 Hz, before."""

_DRAWN = np.random.default_rng(0).normal(size=(len(LAGS) * len(FEATURES), HIDDEN)) / len(FEATURES)


class NoiseModel(NamedTuple):
    """A noise model.

    Attributes:
        start: its parameters with which every factor is 1, a NamedTuple with declared ranges and priors.
        log_scale: (parameters, features (T, F)) → (T,), the logarithm of the factor on a variance; pure JAX.
    """

    start: Any
    log_scale: Callable[[Any, Values], Values]


class Constant(NamedTuple):
    """No parameters."""


@documented
class LogLinear(NamedTuple):
    """Weights of the features; 0 leaves a feature out."""

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


def _weighted(p: LogLinear, columns: Values) -> Values:
    """Σ_f w_f φ_f (T,) for features (T, F)."""
    weights = jnp.stack([jnp.asarray(getattr(p, name), columns.dtype) for name in FEATURES])
    return columns @ weights


@documented
class Network(NamedTuple):
    """Weights of the network, 208 in all. At the start the output is 0; the first layer is drawn, with a fixed seed."""

    first: Annotated[Param, Parameter(real, "1", "weights (inputs, units) of the first layer", WEIGHT)] = _DRAWN
    shift: Annotated[Param, Parameter(real, "1", "(units,) added to the first layer", WEIGHT)] = np.zeros(HIDDEN)
    last: Annotated[Param, Parameter(real, "1", "weights (units,) of the output", WEIGHT)] = np.zeros(HIDDEN)


def _network(p: Network, columns: Values) -> Values:
    """wᵀ tanh(W [φ_k, φ_{k−8}] + c) (T,) for features (T, F); before the first sample the first is repeated."""
    before = [jnp.concatenate([jnp.repeat(columns[:1], lag, axis=0), columns])[: len(columns)] for lag in LAGS]
    first, shift, last = (jnp.asarray(leaf, columns.dtype) for leaf in p)
    return jnp.tanh(jnp.concatenate(before, axis=1) @ first + shift[None, :]) @ last


MODELS: dict[str, NoiseModel] = {
    "constant": NoiseModel(Constant(), lambda _, columns: jnp.zeros_like(columns[:, 0])),
    "log_linear": NoiseModel(LogLinear(), _weighted),
    "network": NoiseModel(Network(), _network),
}
"""Noise models by name."""


def model_of(name: str) -> NoiseModel:
    """The noise model of this name. Raises ValueError if there is none."""
    if name not in MODELS:
        raise ValueError(f"the noise model must be one of {', '.join(MODELS)}; got {name!r}")
    return MODELS[name]


def log_scale(p: Param, columns: Values) -> Values:
    """The logarithm of the factor on a variance (T,) from features (T, F), by the model of the parameters' type."""
    model = next(model for model in MODELS.values() if isinstance(p, type(model.start)))
    return model.log_scale(p, columns)
