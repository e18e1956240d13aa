"""Noise models: how the variance of a measurement follows the signals, learned from walks.

A model is a record of parameters with one method, log_scale(features) → (T,), the logarithm of the factor on a
variance. With the parameters of `MODELS` every factor is 1, so that a tuning starts at the constant; their priors keep
them near 0 where walks are few. The type of the parameters selects the model, so an estimator needs no option.

`features.py` has the features, and says which of them use samples after the one that they describe.
"""

from jgait.estimators.noise.features import FEATURES, features
from jgait.estimators.noise.models import Constant, LogLinear, Network

type NoiseModel = Constant | LogLinear | Network

MODELS: dict[str, NoiseModel] = {"constant": Constant(), "log_linear": LogLinear(), "network": Network()}
"""Name → parameters with which every factor is 1."""


def model_of(name: str) -> NoiseModel:
    """The noise model of this name, with its start values. Raises ValueError for an unknown name."""
    if name not in MODELS:
        raise ValueError(f"the noise model must be one of {', '.join(MODELS)}; got {name!r}")
    return MODELS[name]


__all__ = ["FEATURES", "MODELS", "Constant", "LogLinear", "Network", "NoiseModel", "features", "model_of"]
