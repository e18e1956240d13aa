"""What must hold for every Gaussian filter, whatever it estimates."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from filtering.problems import CART, Cart, Case, P, case, filtered, smoothed

from jgait import filtering
from jgait.filtering import CKF, EKF, KF, UKF, Belief, Covariance, IteratedEKF, Model

SAMPLES = 25


@pytest.fixture(scope="module")
def problem() -> Case:
    c = case("cart", SAMPLES)
    return c._replace(mask=jax.tree.map(lambda leaf: leaf.at[7].set(False), c.mask))


PRIOR = np.array([0.5, -0.2]), np.array([[2.0, 0.3], [0.3, 1.0]])


def samples_of(c: Case) -> list[reference.Sample]:
    """The cart as matrices, a sample at a time."""
    q, r, friction, excess = map(float, c.params)
    H = np.array([[1.0, 0.0], [2.0, 1.0 + excess]])
    R = r * np.array([[1.0, 0.3], [0.3, 2.0]])
    readings, seen = np.stack(c.observations, -1), np.stack(c.mask, -1)
    out = []
    for k, dt in enumerate(np.asarray(c.dt)):
        u = float(c.controls.acceleration[k])
        F = np.array([[1.0, dt], [0.0, 1.0 - friction * dt]])
        Q = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        b, c_ = np.array([0.0, dt]) * u, np.array([0.0, 0.1 * u])
        out.append(reference.Sample(F, b, Q, H, c_, R, readings[k], seen[k]))
    return out


@pytest.mark.parametrize("method", [KF(), CKF()], ids=str)
def test_smoothing_is_batch_least_squares(problem, method):
    found = smoothed(problem, "auto", method)
    means, covs = reference.least_squares(*PRIOR, samples_of(problem))
    np.testing.assert_allclose(np.stack(found.mean, -1), means, rtol=0, atol=1e-10)
    np.testing.assert_allclose(np.asarray(found.cov.dense()), covs, rtol=0, atol=1e-10)


def test_likelihood_is_the_joint_density_of_the_readings(problem):
    density = reference.joint_log_density(*PRIOR, samples_of(problem))
    assert np.sum(filtered(problem).log_likelihood) == pytest.approx(density, abs=1e-9)


@pytest.mark.parametrize("execution", ["core", "fast"])
def test_an_all_false_mask_is_prediction_only(problem, execution):
    blind = filtered(problem._replace(mask=jax.tree.map(jnp.zeros_like, problem.mask)), execution)
    blind = jax.tree.map(np.asarray, blind)
    mean, cov = PRIOR
    covs = np.asarray(blind.cov.dense())
    for k, sample in enumerate(samples_of(problem)):
        mean, cov = sample.F @ mean + sample.b, sample.F @ cov @ sample.F.T + sample.Q
        np.testing.assert_allclose([leaf[k] for leaf in blind.mean], mean, rtol=0, atol=1e-12)
        np.testing.assert_allclose(covs[k], cov, rtol=0, atol=1e-12)
    assert not np.any(np.asarray(blind.log_likelihood))
    assert not np.any(np.asarray(blind.nis))
    assert not np.any(np.asarray(blind.count))


def test_what_is_hidden_for_good_is_left_out_and_as_if_masked_everywhere(problem):
    model, p, observations, controls, dt, mask = problem
    hidden, masked = (
        filtering.kalman_smoother(
            model, p, observations, controls=controls, dt=dt, mask=mask._replace(far=far), execution="core"
        )
        for far in (False, np.zeros(SAMPLES, bool))
    )
    assert hidden.filtered.innovation.far is None
    for ours, theirs in zip((hidden.mean, hidden.cov.dense(), hidden.filtered.innovation.near, hidden.log_likelihood),
                            (masked.mean, masked.cov.dense(), masked.filtered.innovation.near, masked.log_likelihood),
                            strict=True):  # fmt: skip
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12), ours, theirs)


@pytest.mark.parametrize("execution", ["core", "fast"])
def test_gradients_are_finite_in_float32(problem, execution):
    p, *cast = jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), problem[1:-1])

    def value(p: Any) -> Any:
        found = smoothed(Case(CART, p, *cast, problem.mask), execution, covariance=execution == "core")
        return jnp.sum(found.mean.position**2) + jnp.sum(found.filtered.log_likelihood)

    gradient = jax.jit(jax.grad(value))(p)
    assert gradient.dtype == jnp.float32
    assert bool(jnp.all(jnp.isfinite(gradient)))


class Pendulum(NamedTuple):
    """Angle from hanging, and its rate."""

    angle: Any
    rate: Any


class Shadow(NamedTuple):
    """Where the bob's shadow falls."""

    x: Any


PENDULUM = Model(
    lambda p: Belief(Pendulum(0.8, 0.0), Covariance.from_variances(Pendulum(0.2, 0.1))),
    lambda p, s, u, dt: Pendulum(s.angle + dt * s.rate, s.rate - dt * p * jnp.sin(s.angle)),
    lambda p, s, u, dt: Pendulum(1e-4 * dt, 1e-2 * dt),
    lambda p, s, u: Shadow(jnp.sin(s.angle)),
    lambda p, s, u: Shadow(0.01),
)


@pytest.mark.parametrize("method", [EKF(), IteratedEKF(3), UKF(), CKF()], ids=str)
def test_filters_are_consistent_on_a_pendulum(method):
    keys = jax.random.split(jax.random.key(0), 40)
    truth, shadows = jax.jit(jax.vmap(lambda key: filtering.draw(key, PENDULUM, 9.81, 200, dt=0.05)))(keys)
    solve = jax.vmap(lambda x: filtering.kalman_filter(PENDULUM, 9.81, x, dt=0.05, method=method))
    posterior = jax.jit(solve)(shadows)
    error = np.asarray(posterior.mean.angle - truth.angle)[:, 50::50]
    nees = error**2 / np.asarray(posterior.cov["angle", "angle"])[:, 50::50]
    assert abs(nees.mean() - 1.0) < 6.0 * np.sqrt(2.0 / nees.size)
    nis = np.asarray(posterior.nis)[:, 20:]
    assert abs(nis.mean() - 1.0) < 6.0 * np.sqrt(2.0 / nis.size)


def test_exactly_known_states_do_not_break_smoothing_or_sigma_points(problem):
    known = Belief(Cart(jnp.asarray(0.0), jnp.asarray(1.0)), Covariance.from_variances(Cart(0.0, 0.0)))

    def last(scale: Any, method: Any) -> Any:
        p = jnp.stack([0.0 * scale, scale, P[2], P[3]])
        out = smoothed(problem._replace(params=p), "core", method, initial=known)
        return out.mean.position[-1] + out.cov["position", "position"][0]

    for method in (EKF(), UKF()):
        value, slope = jax.jit(jax.value_and_grad(last), static_argnums=1)(jnp.asarray(0.2), method)
        assert np.isfinite(float(value))
        assert np.isfinite(float(slope))
