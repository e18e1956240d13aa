"""The smoother along ancestors: what it says of the particles that the filter drew, and how near RTS that is."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.filtering import (
    PARTICLE_KEEP,
    Belief,
    Covariance,
    Model,
    draw,
    kalman_smoother,
    particle_filter,
    particle_smoother,
)


class Cart(NamedTuple):
    position: Any
    speed: Any


class Seen(NamedTuple):
    position: Any


class Noise(NamedTuple):
    process: Any
    sensor: Any


def _initial(p):
    return Belief(Cart(0.0, 0.0), Covariance.from_variances(Cart(1.0, 1.0)))


def _shock(p, state, control, dt):  # singular: the position has none of its own
    cov = Covariance.from_variances(Cart(dt**2 * p.process, p.process))
    return cov.with_entries({("position", "speed"): dt * p.process})


CART = Model(
    _initial,
    lambda p, state, control, dt: Cart(state.position + dt * state.speed, 0.9 * state.speed),
    _shock,
    lambda p, state, control: Seen(state.position),
    lambda p, state, control: Seen(p.sensor),
)
# The speed has no noise at all: every descendant has that of its ancestor, to the last bit.
STEADY = CART._replace(
    transition=lambda p, state, control, dt: Cart(state.position + dt * state.speed, state.speed),
    transition_noise=lambda p, state, control, dt: Cart(p.process, 0.0),
)
P = Noise(jnp.asarray(0.3), jnp.asarray(0.5))
SAMPLES = 31
PARTICLES = 60
READ = draw(jax.random.key(0), CART, P, SAMPLES, dt=0.5)[1]
MASK = jnp.arange(SAMPLES) % 4 != 1
KEEP = (*PARTICLE_KEEP, "particles", "log_weights", "ancestors", "resampled")


@partial(jax.jit, static_argnames=("model", "particles", "keep", "lag"))
def run(model, p, read, mask, key, particles=PARTICLES, keep=PARTICLE_KEEP, lag=None):
    return particle_smoother(model, p, read, dt=0.5, mask=mask, key=key, particles=particles, keep=keep, lag=lag)


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_it_weighs_each_particle_by_its_descendants(dtype):
    p, read = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype), (P, READ))
    found = run(STEADY, p, read, MASK, jax.random.key(2), keep=KEEP)
    drawn = jax.tree.map(np.asarray, found.filtered)
    assert drawn.resampled.sum() > 5
    weights = np.exp(drawn.log_weights[-1].astype(float))
    epsilon = 100.0 * float(jnp.finfo(dtype).eps)
    for k in reversed(range(SAMPLES)):
        if k < SAMPLES - 1:
            weights = np.bincount(drawn.ancestors[k], weights, PARTICLES)
            speeds = drawn.particles.speed
            np.testing.assert_array_equal(speeds[k + 1], speeds[k][drawn.ancestors[k]])
        states = np.stack([drawn.particles.position[k], drawn.particles.speed[k]]).astype(float)
        mean = states @ weights
        cov = (weights * (states - mean[:, None])) @ (states - mean[:, None]).T
        np.testing.assert_allclose(np.stack([leaf[k] for leaf in found.mean]), mean, rtol=epsilon, atol=30 * epsilon)
        np.testing.assert_allclose(np.asarray(found.cov.dense())[k], cov, rtol=epsilon, atol=30 * epsilon)
        np.testing.assert_allclose(found.effective_size[k], 1.0 / np.sum(weights**2), rtol=epsilon)


def test_its_filter_is_the_filter():
    smoothed = run(CART, P, READ, MASK, jax.random.key(3))
    filtered = particle_filter(CART, P, READ, dt=0.5, mask=MASK, key=jax.random.key(3), particles=PARTICLES)
    for a, b in zip(jax.tree.leaves(smoothed.filtered), jax.tree.leaves(filtered), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9)
    np.testing.assert_allclose(smoothed.mean.speed[-1], filtered.mean.speed[-1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(smoothed.cov["speed", "speed"][-1], filtered.cov["speed", "speed"][-1], atol=1e-12)


def near(found, expected):
    found, expected = np.asarray(found, float), np.asarray(expected, float)
    spread = found.std(axis=0)
    assert np.all(np.abs(found.mean(axis=0) - expected) < 6.0 * spread / np.sqrt(len(found)))


def test_on_a_linear_model_it_is_the_rts_smoother_within_monte_carlo_error():
    read, mask = jax.tree.map(lambda leaf: leaf[:8], (READ, MASK))
    exact = kalman_smoother(CART, P, read, dt=0.5, mask=mask)
    keys = jax.random.split(jax.random.key(4), 48)
    found = jax.vmap(lambda key: run(CART, P, read, mask, key, particles=2000))(keys)
    near(found.mean.position, exact.mean.position)
    near(found.mean.speed, exact.mean.speed)
    near(found.cov["speed", "speed"], exact.cov["speed", "speed"])
    between = np.abs(np.asarray(exact.mean.position) - np.asarray(exact.filtered.mean.position))[:6]
    assert np.all(np.std(found.mean.position, axis=0)[:6] < between.max())  # near enough to tell it from the filter


def test_looking_ahead_less_leaves_more_particles_and_looking_far_is_looking_to_the_end():
    full, far, less = (run(CART, P, READ, MASK, jax.random.key(5), lag=lag) for lag in (None, 10 * SAMPLES, 4))
    for a, b in zip(jax.tree.leaves(far), jax.tree.leaves(full), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9)
    assert float(less.effective_size[0]) > 2.0 * float(full.effective_size[0])
    exact = kalman_smoother(CART, P, READ, dt=0.5, mask=MASK)

    def error(posterior):
        return float(jnp.sqrt(jnp.mean((posterior.mean.position - exact.mean.position) ** 2)))

    keys = jax.random.split(jax.random.key(6), 16)
    errors = {
        name: np.mean([error(posterior) for posterior in runs])
        for name, runs in {
            "full": [run(CART, P, READ, MASK, key) for key in keys],
            "lag": [run(CART, P, READ, MASK, key, lag=4) for key in keys],
        }.items()
    }
    filtered = np.mean([error(run(CART, P, READ, MASK, key).filtered) for key in keys])
    assert errors["lag"] < errors["full"] and errors["lag"] < filtered


def test_masked_samples_at_the_end_and_under_the_mask_change_nothing():
    alone = run(CART, P, READ, MASK, jax.random.key(7))
    other = run(CART, P, Seen(jnp.where(MASK, READ.position, 1e6)), MASK, jax.random.key(7))
    for a, b in zip(jax.tree.leaves(other), jax.tree.leaves(alone), strict=True):
        np.testing.assert_array_equal(a, b)
    longer = Seen(jnp.concatenate([READ.position, jnp.full(6, 5.0)]))
    padded = run(CART, P, longer, jnp.concatenate([MASK, jnp.zeros(6, bool)]), jax.random.key(7))
    for a, b in zip(jax.tree.leaves(padded), jax.tree.leaves(alone), strict=True):
        np.testing.assert_allclose(a[:SAMPLES], b, rtol=0, atol=1e-9)


def test_vmap_is_a_loop_and_gradients_are_finite():
    keys = jax.random.split(jax.random.key(8), 3)
    batch = jax.vmap(lambda key: run(CART, P, READ, MASK, key))(keys)
    for a, b in zip(jax.tree.leaves(batch), jax.tree.leaves(run(CART, P, READ, MASK, keys[1])), strict=True):
        np.testing.assert_allclose(a[1], b, rtol=0, atol=1e-9)
    slope = jax.grad(lambda p: jnp.sum(run(CART, p, READ, MASK, keys[0]).mean.position ** 2))(
        Noise(jnp.asarray(0.3), jnp.asarray(0.5))
    )
    assert all(np.isfinite(leaf) and leaf != 0.0 for leaf in slope)


@pytest.mark.parametrize("lag", [0, 2.0, True])
def test_a_lag_that_is_none_is_refused(lag):
    with pytest.raises(ValueError, match="lag must be a whole number"):
        particle_smoother(CART, P, READ, key=jax.random.key(0), lag=lag)
