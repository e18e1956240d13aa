"""A small network as noise model: one hidden layer on the features of a causal window."""

from typing import Annotated, NamedTuple

import jax.numpy as jnp
import numpy as np

from jgait.estimators.noise.features import FEATURES
from jgait.estimators.noise.interface import NoiseModel
from jgait.params import Param, Parameter, documented, normal, real
from jgait.types import Values

HIDDEN = 8
"""Number of hidden units."""

LAGS = (0, 8)
"""[samples] Each unit takes the features of now and of 8 samples, 40 ms at 200 Hz, before."""

PRIOR = normal(0.0, 1.0)

_DRAWN = np.random.default_rng(0).normal(size=(len(LAGS) * len(FEATURES), HIDDEN)) / len(FEATURES)


@documented
class Network(NamedTuple):
    """Weights of the network, 208 in all. At the start the output is 0; the first layer is drawn, with a fixed seed."""

    first: Annotated[Param, Parameter(real, "1", "weights (inputs, units) of the first layer", PRIOR)] = _DRAWN
    shift: Annotated[Param, Parameter(real, "1", "(units,) added to the first layer", PRIOR)] = np.zeros(HIDDEN)
    last: Annotated[Param, Parameter(real, "1", "weights (units,) of the output", PRIOR)] = np.zeros(HIDDEN)


def log_scale(p: Network, columns: Values) -> Values:
    """wᵀ tanh(W [φ_k, φ_{k−8}] + c) (T,) for features (T, F); before the first sample the first is repeated."""
    before = [jnp.concatenate([jnp.repeat(columns[:1], lag, axis=0), columns])[: len(columns)] for lag in LAGS]
    first, shift, last = (jnp.asarray(leaf, columns.dtype) for leaf in p)
    return jnp.tanh(jnp.concatenate(before, axis=1) @ first + shift[None, :]) @ last


NETWORK = NoiseModel(Network(), log_scale)
