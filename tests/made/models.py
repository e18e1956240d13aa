"""Small models of which likelihoods are known, for tests of tuning."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jgait.filtering import Belief, Covariance, Model

Z = 1.959963984540054
"""97.5 % quantile of the normal distribution."""


def close(a, b, rtol=1e-10, atol=1e-12):
    np.testing.assert_allclose(np.asarray(a), np.asarray(b), rtol=rtol, atol=atol)


class Line(NamedTuple):
    coefficients: Any
    scale: Any


def straight(params, item):
    """Negative log-likelihood of one observation of a line [nat]."""
    x, y = item
    return 0.5 * ((y - jnp.sum(x * params.coefficients)) / params.scale) ** 2 + jnp.log(params.scale)


class Gauss(NamedTuple):
    mean: Any
    scale: Any


def gauss(params, item):
    """Negative log-likelihood of a normal number [nat]."""
    return 0.5 * ((item - params.mean) / params.scale) ** 2 + jnp.log(params.scale)


class Pair(NamedTuple):
    a1: Any
    rollover_radius: Any
    noise: Any


def product(params, item):
    """Sees a1 · rollover_radius only."""
    return 0.5 * ((item - params.a1 * params.rollover_radius) / params.noise) ** 2 + jnp.log(params.noise)


class Level(NamedTuple):
    value: Any


class Noise(NamedTuple):
    process: Any
    sensor: Any


def _initial(params):
    return Belief(Level(jnp.asarray(0.0)), Covariance.from_variances(Level(jnp.asarray(10.0))))


LOCAL_LEVEL = Model(
    _initial,
    lambda params, state, control, dt: state,
    lambda params, state, control, dt: Level(params.process),
    lambda params, state, control: Level(state.value),
    lambda params, state, control: Level(params.sensor),
)
"""A random walk that is measured, with the noise of both."""
