"""Noise models and the features of the signals that they use."""

from jgait.estimators.noise.features import FEATURES, features
from jgait.estimators.noise.models import MODELS, Constant, LogLinear, Network, NoiseModel, log_scale, model_of

__all__ = ["FEATURES", "MODELS", "Constant", "LogLinear", "Network", "NoiseModel", "features", "log_scale", "model_of"]
