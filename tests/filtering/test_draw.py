"""What is drawn from a model has the moments that the model states, and its own filter finds it consistent."""

from typing import Any, NamedTuple

import jax
import numpy as np

from jgait.filtering import Belief, Covariance, Model, draw


class Cart(NamedTuple):
    position: Any
    speed: Any


class Seen(NamedTuple):
    position: Any


class Noise(NamedTuple):
    process: Any
    sensor: Any


CART = Model(
    lambda p: Belief(Cart(1.0, -1.0), Covariance.from_variances(Cart(0.25, 0.04))),
    lambda p, s, u, dt: Cart(s.position + dt * s.speed, 0.9 * s.speed),
    # singular: the position has no noise of its own
    lambda p, s, u, dt: Covariance.from_variances(Cart(dt**2 * p.process, p.process)).with_entries(
        {("position", "speed"): dt * p.process}
    ),
    lambda p, s, u: Seen(s.position),
    lambda p, s, u: Seen(p.sensor),
)
P = Noise(0.3, 0.5)
KEYS = jax.random.split(jax.random.key(0), 20_000)


def test_moments_are_those_of_the_model():
    drawn = jax.jit(jax.vmap(lambda key: draw(key, CART, P, 3, dt=0.5)))(KEYS)
    states, seen = jax.tree.map(np.asarray, drawn)
    mean, cov = np.array([1.0, -1.0]), np.diag([0.25, 0.04])
    matrix, noise = np.array([[1.0, 0.5], [0.0, 0.9]]), 0.3 * np.array([[0.25, 0.5], [0.5, 1.0]])
    for k in range(3):
        mean, cov = matrix @ mean, matrix @ cov @ matrix.T + noise
        now = np.stack([states.position[:, k], states.speed[:, k]], axis=1)
        error = np.sqrt(np.diag(cov) / len(KEYS))
        assert np.all(np.abs(now.mean(axis=0) - mean) < 6.0 * error)
        spread = np.sqrt((cov**2 + np.outer(np.diag(cov), np.diag(cov))) / len(KEYS))
        assert np.all(np.abs(np.cov(now.T) - cov) < 6.0 * spread)
        sensed = seen.position[:, k] - states.position[:, k]
        assert abs(sensed.var() - 0.5) < 6.0 * 0.5 * np.sqrt(2.0 / len(KEYS))
