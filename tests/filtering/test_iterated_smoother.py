"""The iterated smoother reaches the most probable trajectory, which a general optimiser finds, too."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filtering.oracle import Vectors, stacked
from filtering.problems import BROKEN, case, same, smoothed
from scipy.optimize import least_squares

from jgait.filtering import IteratedSmoother, kalman_filter


def most_probable(c: Any, guess: Any) -> tuple[Any, Any]:
    """The states (T, k) with the greatest density, and Gauss and Newton's covariances of flat ones (T, n, n)."""
    v = Vectors(c.model, c.params, c.observations)
    start, cov = v.start
    measured, n = stacked(c.observations), cov.shape[0]
    length = len(measured)

    def white(matrix: Any, error: Any) -> Any:
        return jnp.linalg.solve(jnp.linalg.cholesky(matrix), error)

    def of_sample(before: Any, now: Any, y: Any, u: Any) -> Any:
        moved = v.minus(now, v.f(before, u, c.dt))
        return white(v.Q(before, u, c.dt), moved), white(v.R(now, u), v.differ(y, v.h(now, u)))

    def residuals(errors: Any) -> Any:
        states = jax.vmap(v.plus)(jnp.concatenate([start[None], guess]), errors.reshape(length + 1, n))
        parts = jax.vmap(of_sample)(states[:-1], states[1:], measured, c.controls)
        return jnp.concatenate([white(cov, v.minus(states[0], start)), *(part.ravel() for part in parts)])

    value, slope = jax.jit(residuals), jax.jit(jax.jacfwd(residuals))
    found = least_squares(value, np.zeros((length + 1) * n), jac=slope, xtol=1e-15, ftol=1e-15, gtol=1e-14)
    states = jax.vmap(v.plus)(jnp.concatenate([start[None], guess]), found.x.reshape(length + 1, n))
    every = np.linalg.inv(found.jac.T @ found.jac).reshape(length + 1, n, length + 1, n)
    return states[1:], np.stack([every[t, :, t] for t in range(1, length + 1)])


@pytest.mark.parametrize("name", ["bent", "heading", "stated"])
def test_the_passes_end_at_the_most_probable_trajectory(name):
    c = case(name, masked=False)
    once = stacked(smoothed(c).mean)
    expected, cov = most_probable(c, once)
    found = smoothed(c, method=IteratedSmoother(12))
    assert float(jnp.max(abs(once - expected))) > 1e-3
    np.testing.assert_allclose(stacked(found.mean), expected, atol=1e-6)
    if name == "bent":
        np.testing.assert_allclose(found.cov.dense(), cov, atol=1e-6)


def test_another_pass_changes_nothing_where_the_model_is_linear():
    c = case("cart")
    once, again = smoothed(c), smoothed(c, method=IteratedSmoother(3))
    for field in ("filtered", "mean", "cov"):
        same(getattr(again, field), getattr(once, field))


def test_batches_gradients_and_selected_covariances_are_those_of_single_recordings():
    c, few = case("stated"), ("angle",)
    scales = jnp.asarray([0.8, 1.0, 1.3])

    def run(scale: Any) -> Any:
        found = smoothed(c._replace(params=scale * c.params), method=IteratedSmoother(2), covariance=few)
        return stacked(found.mean), found.cov["angle", "angle"]

    alone, every = jax.jit(run), jax.jit(jax.vmap(run))(scales)
    for i, scale in enumerate(scales):
        same(jax.tree.map(lambda leaf, i=i: leaf[i], every), alone(scale))
    same(
        alone(scales[0])[1],
        smoothed(c._replace(params=scales[0] * c.params), method=IteratedSmoother(2)).cov["angle", "angle"],
    )

    def loss(result: Any) -> Any:
        mean, variance = result
        return jnp.sum(jnp.cos(mean)) + jnp.sum(variance)

    step = 1e-5
    ahead, behind = (loss(alone(jnp.asarray(at))) for at in (1.0 + step, 1.0 - step))
    np.testing.assert_allclose(
        jax.jit(jax.grad(lambda scale: loss(run(scale))))(1.0), (ahead - behind) / (2.0 * step), rtol=1e-6
    )


def test_a_broken_transition_is_left_out():
    c = case("bent")
    fault = c.controls._replace(fault=c.controls.fault.at[4].set(1e3))
    found = smoothed(c._replace(model=BROKEN["transition"], controls=fault), method=IteratedSmoother(3))
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves((found.mean, found.cov.dense())))


def test_wrong_uses_are_named():
    c = case("cart")
    with pytest.raises(ValueError, match="from 2 up; got 1"):
        IteratedSmoother(1)
    with pytest.raises(ValueError, match="method must be"):
        kalman_filter(c.model, c.params, c.observations, controls=c.controls, method=IteratedSmoother(2))
    with pytest.raises(ValueError, match="fast"):
        smoothed(c, "fast", IteratedSmoother(2), covariance=False)
