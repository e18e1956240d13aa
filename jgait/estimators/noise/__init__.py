"""Noise models: how the variance of a measurement follows the signals, learned from walks.

A model is a record of parameters and one function, log_scale(parameters, features) → (T,), the logarithm of the factor
on a variance. With the parameters of `start` every factor is 1, so that a tuning starts at the constant; their priors
keep them near 0 where walks are few. The type of the parameters selects the model, so an estimator needs no option.

| name | parameters | file |
|---|---|---|
| `constant` | none | `constant.py` |
| `log_linear` | one for each feature | `log_linear.py` |
| `network` | 208 weights | `network.py` |

`features.py` has the features, and says which of them use samples after the one that they describe.
"""

from jgait.estimators.noise.constant import CONSTANT, Constant
from jgait.estimators.noise.features import FEATURES, features
from jgait.estimators.noise.interface import NoiseModel
from jgait.estimators.noise.log_linear import LOG_LINEAR, LogLinear
from jgait.estimators.noise.network import NETWORK, Network
from jgait.params import Param
from jgait.types import Values

MODELS: dict[str, NoiseModel] = {"constant": CONSTANT, "log_linear": LOG_LINEAR, "network": NETWORK}
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


__all__ = [
    "CONSTANT", "FEATURES", "LOG_LINEAR", "MODELS", "NETWORK", "Constant", "LogLinear", "Network", "NoiseModel",
    "features", "log_scale", "model_of",
]  # fmt: skip
