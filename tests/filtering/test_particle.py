"""The particle filter: against the Kalman filter where that is exact, against a grid where it is not."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.filtering import (
    PARTICLE_FIELDS,
    PARTICLE_KEEP,
    Belief,
    Covariance,
    Model,
    Soft,
    Systematic,
    draw,
    kalman_filter,
    particle_filter,
)


class Cart(NamedTuple):
    position: Any
    speed: Any
    offset: Any


class Seen(NamedTuple):
    position: Any
    speed: Any


class Noise(NamedTuple):
    process: Any
    sensor: Any


def _initial(p):
    variances = Cart(0.25, 0.04, 0.0)  # the offset is known
    return Belief(
        Cart(1.0, -1.0, 0.5), Covariance.from_variances(variances).with_entries({("position", "speed"): 0.05})
    )


def _transition(p, state, control, dt):
    return Cart(state.position + dt * state.speed, 0.9 * state.speed, state.offset)


def _transition_noise(p, state, control, dt):  # singular: one shock moves both, and none the offset
    variances = Cart(0.25 * dt**2 * p.process, p.process, 0.0)
    return Covariance.from_variances(variances).with_entries({("position", "speed"): 0.5 * dt * p.process})


def _observation(p, state, control):
    return Seen(state.position + state.offset, state.speed)


def _observation_noise(p, state, control):
    return Covariance.from_variances(Seen(p.sensor, 4.0 * p.sensor)).with_entries(
        {("position", "speed"): 0.5 * p.sensor}
    )


CART = Model(_initial, _transition, _transition_noise, _observation, _observation_noise)
P = Noise(jnp.asarray(0.3), jnp.asarray(0.5))
SAMPLES = 12
RUNS = 64
HARD = Systematic()
KEYS = jax.random.split(jax.random.key(1), RUNS)
READ = draw(jax.random.key(0), CART, P, SAMPLES, dt=0.5)[1]
MASK = Seen(jnp.arange(SAMPLES) != 4, jnp.arange(SAMPLES) % 3 == 0)
EXACT = kalman_filter(CART, P, READ, dt=0.5, mask=MASK)


@partial(jax.jit, static_argnames=("particles", "resampling", "threshold", "keep"))
def run(p, read, mask, key, particles=500, resampling=HARD, threshold=0.5, keep=(*PARTICLE_KEEP, "resampled")):
    return particle_filter(
        CART, p, read, dt=0.5, mask=mask, key=key, particles=particles, resampling=resampling, threshold=threshold,
        keep=keep,
    )  # fmt: skip


def over_keys(keys, **settings):
    return jax.vmap(lambda key: run(P, READ, MASK, key, **settings))(keys)


@pytest.fixture(scope="module")
def posterior():
    return over_keys(KEYS)


# --- what it estimates ---


def near(found, expected):
    """The average over keys, and each key, within six of what keys differ by (and rounding)."""
    found, expected = np.asarray(found, float), np.asarray(expected, float)
    spread = found.std(axis=0)
    assert np.all(np.abs(found.mean(axis=0) - expected) < 6.0 * spread / np.sqrt(len(found)) + 1e-9)
    assert np.all(np.abs(found - expected) < 6.0 * spread + 1e-9)


@pytest.mark.parametrize("settings", [{}, {"resampling": Soft(0.5)}, {"threshold": 1.0}], ids=str)
def test_on_a_linear_model_it_is_the_kalman_filter_within_monte_carlo_error(settings):
    found = over_keys(KEYS, **settings)
    assert bool(jnp.any(found.resampled)) and bool(jnp.all(found.valid))
    near(found.mean.position, EXACT.mean.position)
    near(found.mean.speed, EXACT.mean.speed)
    near(found.cov["position", "position"], EXACT.cov["position", "position"])
    near(found.cov["position", "speed"], EXACT.cov["position", "speed"])
    np.testing.assert_allclose(found.mean.offset, 0.5, rtol=0, atol=1e-12)
    # Not its logarithm: the likelihood itself is estimated without bias.
    total = found.log_likelihood.sum(axis=1) - EXACT.log_likelihood.sum()
    near(jnp.exp(total), 1.0)
    assert float(total.std()) < 0.5
    np.testing.assert_array_equal(found.count, np.broadcast_to(EXACT.count, found.count.shape))


class Growth(NamedTuple):
    x: Any


class Drive(NamedTuple):
    push: Any


def _grown(p, state, control, dt):
    return Growth(0.5 * state.x + 25.0 * state.x / (1.0 + state.x**2) + control.push)


GROWTH = Model(
    lambda p: Belief(Growth(0.0), Covariance.from_variances(Growth(2.0))),
    _grown,
    lambda p, state, control, dt: Growth(10.0),
    lambda p, state, control: Growth(state.x**2 / 20.0),
    lambda p, state, control: Growth(1.0),
)


def test_where_beliefs_have_two_peaks_it_finds_what_a_grid_finds_and_the_ekf_does_not():
    push = Drive(8.0 * jnp.cos(1.2 * jnp.arange(10.0)))
    read = draw(jax.random.key(6), GROWTH, jnp.zeros(()), 10, controls=push)[1]
    keep = ("mean", "cov", "log_likelihood")
    filtered = jax.jit(
        jax.vmap(
            lambda key: particle_filter(GROWTH, 0.0, read, controls=push, key=key, particles=1000, keep=keep)
        )
    )  # fmt: skip
    found = filtered(KEYS)

    grid = np.linspace(-50.0, 50.0, 2001)
    step = grid[1] - grid[0]
    belief = np.exp(-0.25 * grid**2) / np.sqrt(4.0 * np.pi)
    means, variances, total = [], [], 0.0
    for u, y in zip(np.asarray(push.push), np.asarray(read.x), strict=True):
        moved = 0.5 * grid + 25.0 * grid / (1.0 + grid**2) + u
        kernel = np.exp(-0.05 * (grid[:, None] - moved[None, :]) ** 2) / np.sqrt(20.0 * np.pi)
        belief = kernel @ belief * step
        belief = belief * np.exp(-0.5 * (y - grid**2 / 20.0) ** 2) / np.sqrt(2.0 * np.pi)
        evidence = belief.sum() * step
        total, belief = total + np.log(evidence), belief / evidence
        means.append((grid * belief).sum() * step)
        variances.append(((grid - means[-1]) ** 2 * belief).sum() * step)
    near(found.mean.x, np.array(means))
    near(found.cov["x", "x"], np.array(variances))
    near(jnp.exp(found.log_likelihood.sum(axis=1) - total), 1.0)
    ekf = kalman_filter(GROWTH, 0.0, read, controls=push)
    assert float(jnp.sum(ekf.log_likelihood)) < total - 20.0
    assert np.sqrt(np.mean((np.asarray(ekf.mean.x) - means) ** 2)) > 2.0


class Circle(NamedTuple):
    """A direction in the plane."""

    cos: Any
    sin: Any


class Angle(NamedTuple):
    angle: Any


def _turned(state, error):
    c, s = jnp.cos(error.angle), jnp.sin(error.angle)
    return Circle(state.cos * c - state.sin * s, state.sin * c + state.cos * s)


def _between(reference, state):
    return Angle(
        jnp.arctan2(
            reference.cos * state.sin - reference.sin * state.cos, reference.cos * state.cos + reference.sin * state.sin
        )
    )


COMPASS = Model(
    lambda p: Belief(Circle(-1.0, 0.0), Covariance.from_variances(Angle(0.04))),
    lambda p, state, control, dt: _turned(state, Angle(0.1 * dt)),
    lambda p, state, control, dt: Angle(0.01),
    lambda p, state, control: Angle(jnp.arctan2(state.sin, state.cos)),
    lambda p, state, control: Angle(0.05),
    retract=_turned,
    local=_between,
    residual=lambda a, b: Angle(jnp.arctan2(jnp.sin(a.angle - b.angle), jnp.cos(a.angle - b.angle))),
)


def test_on_a_manifold_means_and_covariances_are_those_of_errors_about_them():
    read = Angle(jnp.asarray([3.0, -3.1, -2.7, 3.1, -2.8, -2.5]))
    exact = kalman_filter(COMPASS, 0.0, read)  # linear in the angle, which passes π here
    found = jax.jit(jax.vmap(lambda key: particle_filter(COMPASS, 0.0, read, key=key, particles=400)))(KEYS)
    np.testing.assert_allclose(found.mean.cos**2 + found.mean.sin**2, 1.0, rtol=0, atol=1e-12)
    off = jax.vmap(lambda mean: _between(exact.mean, mean).angle)(found.mean)
    near(off, 0.0)
    near(found.cov["angle", "angle"], exact.cov["angle", "angle"])
    assert float(jnp.ptp(jnp.arctan2(exact.mean.sin, exact.mean.cos))) > 5.0


def test_the_mean_is_where_the_errors_about_it_cancel():
    model = GROWTH._replace(
        initial=lambda p: Belief(Growth(0.0), Covariance.from_variances(Growth(0.04))),
        transition=lambda p, state, control, dt: state,
        transition_noise=lambda p, state, control, dt: Growth(0.01),
        retract=lambda state, error: Growth(state.x + jnp.arcsinh(error.x)),
        local=lambda reference, state: Growth(jnp.sinh(state.x - reference.x)),
    )
    found = particle_filter(
        model, 0.0, Growth(jnp.asarray([0.1, 0.2])), key=KEYS[0], particles=100, keep=PARTICLE_FIELDS
    )  # fmt: skip
    weights, x = np.exp(found.log_weights), np.asarray(found.particles.x)
    mean = 0.5 * np.log((weights * np.exp(x)).sum(axis=1) / (weights * np.exp(-x)).sum(axis=1))
    np.testing.assert_allclose(found.mean.x, mean, rtol=0, atol=1e-7)  # steps are few, see ROUNDS
    assert np.all(np.abs(mean - (weights * x).sum(axis=1)) > 1e-5)
    expected = (weights * np.sinh(x - mean[:, None]) ** 2).sum(axis=1)
    np.testing.assert_allclose(found.cov["x", "x"], expected, rtol=1e-6)


# --- masks, padding, keys, types ---


def test_what_is_masked_does_not_weigh(posterior):
    other = Seen(*(jnp.where(there, y, 77.0) for there, y in zip(MASK, READ, strict=True)))
    again = jax.vmap(lambda key: run(P, other, MASK, key))(KEYS)
    for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(posterior), strict=True):
        np.testing.assert_array_equal(a, b)
    assert np.all(np.asarray(posterior.log_likelihood)[:, 4] == 0.0)  # nothing was seen
    nothing = run(P, READ, Seen(MASK.position & False, MASK.speed & False), KEYS[0])
    assert np.all(np.asarray(nothing.log_likelihood) == 0.0) and not np.any(nothing.resampled)
    np.testing.assert_allclose(nothing.effective_size, 500.0, rtol=1e-9)


def test_samples_added_at_the_end_and_masked_change_nothing_before(posterior):
    longer = Seen(*(jnp.concatenate([y, jnp.full(5, -9.0)]) for y in READ))
    mask = Seen(*(jnp.concatenate([there, jnp.zeros(5, bool)]) for there in MASK))
    padded = run(P, longer, mask, KEYS[0])
    alone = run(P, READ, MASK, KEYS[0])
    for a, b in zip(jax.tree.leaves(padded), jax.tree.leaves(alone), strict=True):
        np.testing.assert_allclose(a[:SAMPLES], b, rtol=0, atol=1e-9)


def test_a_key_gives_the_same_bits_and_vmap_is_a_loop(posterior):
    first, second, other = run(P, READ, MASK, KEYS[0]), run(P, READ, MASK, KEYS[0]), run(P, READ, MASK, KEYS[1])
    for a, b, batched in zip(*map(jax.tree.leaves, (first, second, posterior)), strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_allclose(a, batched[0], rtol=0, atol=1e-9)
    assert float(jnp.max(jnp.abs(first.mean.position - other.mean.position))) > 1e-3


def test_float32_works():
    p, read = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), (P, READ))
    found = jax.vmap(lambda key: run(p, read, MASK, key))(KEYS)
    assert found.mean.position.dtype == found.log_likelihood.dtype == found.cov["speed", "speed"].dtype == jnp.float32
    near(found.mean.position, np.asarray(EXACT.mean.position))
    near(jnp.exp(found.log_likelihood.sum(axis=1) - float(EXACT.log_likelihood.sum())), 1.0)


def test_what_is_asked_for_is_returned():
    found = run(P, READ, MASK, KEYS[0], particles=50, keep=PARTICLE_FIELDS)
    assert all(getattr(found, name) is not None for name in PARTICLE_FIELDS)
    shape = (SAMPLES, 50)
    assert found.particles.speed.shape == found.log_weights.shape == found.ancestors.shape == shape
    weights = np.exp(found.log_weights)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose((weights * found.particles.speed).sum(axis=1), found.mean.speed, rtol=0, atol=1e-12)
    np.testing.assert_allclose(1.0 / (weights**2).sum(axis=1), found.effective_size, rtol=1e-12)
    np.testing.assert_array_equal(found.resampled[:-1], np.asarray(found.effective_size[:-1]) < 25.0)
    assert not bool(found.resampled[-1])  # no weight would come of it
    assert np.all(np.asarray(found.ancestors)[~np.asarray(found.resampled)] == np.arange(50))
    only = run(P, READ, MASK, KEYS[0], particles=50, keep=("log_likelihood",))
    assert only.mean is None and only.log_likelihood.shape == (SAMPLES,)


# --- numbers that break ---


def test_where_no_particle_is_left_the_sample_is_marked_and_nothing_is_nan():
    flat = CART._replace(observation_noise=lambda p, state, control: Seen(state.speed * 0.0 - 1.0, 1.0))
    found = particle_filter(flat, P, READ, dt=0.5, mask=MASK, key=KEYS[0], particles=50)
    assert not np.any(np.asarray(found.valid)[np.asarray(MASK.position)])
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(found))
    np.testing.assert_allclose(found.effective_size, 50.0, rtol=1e-9)
    assert np.all(np.asarray(found.log_likelihood)[np.asarray(MASK.position)] == 0.0)


def test_a_transition_that_overflows_is_marked_and_one_that_breaks_some_costs_only_those():
    def jump(p, state, control, dt):
        return Growth(jnp.where(control.push > 0.0, state.x * 1e200 * 1e200, state.x))

    def root(p, state, control, dt):  # not a number for every particle below zero
        return Growth(jnp.sqrt(state.x) + 1.0)

    push = Drive(jnp.asarray([0.0, 1.0, 0.0]))
    read = Growth(jnp.asarray([0.1, 0.2, 0.3]))
    found = particle_filter(GROWTH._replace(transition=jump), 0.0, read, controls=push, key=KEYS[0], particles=50)
    assert list(np.asarray(found.valid)) == [True, False, True]
    kept = GROWTH._replace(transition=root, transition_noise=lambda p, s, u, dt: Growth(0.01))
    some = particle_filter(kept, 0.0, read, controls=push, key=KEYS[0], particles=50)
    assert np.all(some.valid) and 10.0 < float(some.effective_size[0]) < 40.0
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((found, some)))


# --- gradients ---


def total(p, key, **settings):
    return jnp.sum(run(p, READ, MASK, key, keep=("log_likelihood",), **settings).log_likelihood)


def test_without_resampling_the_gradient_is_that_of_the_numbers():
    slope = jax.grad(partial(total, threshold=0.0))(P, KEYS[0])
    for name in P._fields:
        step = 1e-5
        ends = [
            float(total(P._replace(**{name: getattr(P, name) + sign * step}), KEYS[0], threshold=0.0))
            for sign in (1.0, -1.0)
        ]
        assert float(getattr(slope, name)) == pytest.approx((ends[0] - ends[1]) / (2.0 * step), rel=1e-5)


@pytest.mark.parametrize(
    "settings", [{}, {"resampling": Soft(0.5)}, {"threshold": 0.0, "particles": 4000}], ids=["hard", "soft", "never"]
)
def test_the_gradient_is_that_of_the_kalman_filter_on_average(settings):
    exact = jax.grad(lambda p: jnp.sum(kalman_filter(CART, p, READ, dt=0.5, mask=MASK).log_likelihood))(P)
    slopes = jax.jit(jax.vmap(jax.grad(partial(total, **settings)), in_axes=(None, 0)))(P, KEYS)
    for found, expected in zip(slopes, exact, strict=True):
        near(found, expected)
    assert abs(float(exact.process)) > 3.0 * float(slopes.process.std()) / np.sqrt(RUNS)


def test_gradients_of_means_are_finite_whatever_breaks():
    def loss(p, mask):
        found = run(p, READ, mask, KEYS[0], resampling=Soft(0.5))
        return jnp.sum(found.mean.position) + jnp.sum(found.cov["speed", "speed"]) + jnp.sum(found.effective_size)

    for p, mask in ((P, MASK), (Noise(jnp.asarray(0.0), P.sensor), MASK), (P, Seen(MASK.position & False, MASK.speed))):
        assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(jax.grad(loss)(p, mask)))


# --- arguments ---


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"key": 0}, "key must be one PRNG key"),
        ({"key": KEYS}, "key must be one PRNG key"),
        ({"particles": 1}, "particles must be a whole number from 2"),
        ({"particles": 10.0}, "particles must be a whole number"),
        ({"threshold": 1.5}, "threshold must be a share"),
        ({"resampling": Soft}, "resampling must be Systematic"),
        ({"keep": ("innovation",)}, "keep names fields"),
        ({"mask": jnp.ones(3, bool)}, "mask of 'position' must be bool of shape"),
    ],
)
def test_what_does_not_fit_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        particle_filter(CART, P, READ, **{"key": KEYS[0], **given})
