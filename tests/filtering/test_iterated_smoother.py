"""The iterated smoother reaches the most probable trajectory, which a general optimiser finds, too."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filtering.oracle import stacked, vectors
from filtering.problems import BROKEN, SAMPLES, Place, case, same, smoothed
from scipy.optimize import least_squares

from jgait.filtering import IteratedSmoother, kalman_filter


@functools.cache
def most_probable(name: str) -> tuple[Any, Any, Any]:
    """The states (T, k) with the greatest density, their covariances if they are flat, and the EKF's smoothed states.

    What a model states of its errors has no part in them.
    """
    c = case(name, masked=False)
    guess = stacked(smoothed(c).mean)
    v = vectors(c)
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
    states = jax.jit(jax.vmap(v.plus))(np.concatenate([start[None], guess]), found.x.reshape(length + 1, n))
    every = np.linalg.inv(found.jac.T @ found.jac).reshape(length + 1, n, length + 1, n)
    return np.asarray(states)[1:], np.stack([every[t, :, t] for t in range(1, length + 1)]), guess


@pytest.mark.parametrize("name", ["bent", "heading"])
def test_the_passes_end_at_the_most_probable_trajectory(name):
    expected, cov, once = most_probable(name)
    found = smoothed(case(name, masked=False), method=IteratedSmoother(12))
    assert np.max(np.abs(once - expected)) > 1e-3
    np.testing.assert_allclose(stacked(found.mean), expected, atol=1e-6)
    if name == "bent":
        np.testing.assert_allclose(found.cov.dense(), cov, atol=1e-6)


def test_another_pass_changes_nothing_where_the_model_is_linear():
    c = case("cart")
    once, again = smoothed(c), smoothed(c, method=IteratedSmoother(3))
    for field in ("filtered", "mean", "cov"):
        same(getattr(again, field), getattr(once, field))


def test_batches_and_selected_covariances_are_those_of_single_recordings():
    c, few = case("heading"), ("angle",)
    scales = np.asarray([0.8, 1.0, 1.3])

    def run(scale: Any) -> Any:
        found = smoothed(c._replace(params=scale * c.params), method=IteratedSmoother(2), covariance=few)
        return found.mean, found.cov["angle", "angle"]

    alone, every = jax.jit(run), jax.tree.map(np.asarray, jax.jit(jax.vmap(run))(scales))
    for i, scale in enumerate(scales):
        same(jax.tree.map(lambda leaf, i=i: leaf[i], every), alone(scale))
    whole = smoothed(c._replace(params=scales[0] * c.params), method=IteratedSmoother(2))
    same(alone(scales[0])[1], whole.cov["angle", "angle"])


def test_gradients_are_differences():
    c = case("line")

    @jax.jit
    def sloped(scale: Any) -> Any:
        def loss(scale: Any) -> Any:
            now = c._replace(params=scale * c.params, observations=Place(scale * c.observations.s), dt=scale * c.dt)
            found = smoothed(now, method=IteratedSmoother(2))
            return jnp.sum(jnp.cos(found.mean.s)) + jnp.sum(found.cov["e", "e"])

        return jax.value_and_grad(loss)(scale)

    step = 1e-5
    ahead, behind = (float(sloped(at)[0]) for at in (1.0 + step, 1.0 - step))
    assert float(sloped(1.0)[1]) == pytest.approx((ahead - behind) / (2.0 * step), rel=1e-6)


def test_a_broken_transition_is_left_out():
    c = case("bent")
    fault = c.controls.fault._replace(transition=jnp.asarray(np.where(np.arange(SAMPLES) == 4, 1e3, 0.0)))
    found = smoothed(c._replace(model=BROKEN, controls=c.controls._replace(fault=fault)), method=IteratedSmoother(3))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((found.mean, found.cov)))


def test_wrong_uses_are_named():
    c = case("cart")
    with pytest.raises(ValueError, match="from 2 up; got 1"):
        IteratedSmoother(1)
    with pytest.raises(ValueError, match="method must be"):
        kalman_filter(c.model, c.params, c.observations, controls=c.controls, method=IteratedSmoother(2), dt=0.1)
    with pytest.raises(ValueError, match="fast"):
        smoothed(c, "fast", IteratedSmoother(2), covariance=False)
