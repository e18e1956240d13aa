"""Derivatives of filters and smoothers by every argument: both modes, differences, and one within the other."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filtering.problems import case, filtered, same, smoothed
from jax.flatten_util import ravel_pytree

from jgait.filtering import CKF, EKF, FIELDS, UKF, Belief, Covariance, IteratedEKF

EVERY = tuple(name for name in FIELDS if name not in ("count", "valid"))
SHORT = 6


def arguments(c: Any) -> dict[str, Any]:
    """Everything that a filter is differentiated by: all parameters of `problems`, the prior, the recording."""
    mean, cov = c.model.initial(c.params)
    mean = jax.tree.map(jnp.asarray, mean)
    return {
        "p": c.params, "mean": mean, "cov": cov.dense(), "observations": c.observations,
        "acceleration": c.controls.acceleration, "dt": jnp.broadcast_to(jnp.asarray(c.dt), (len(c.controls.fault),)),
    }  # fmt: skip


def weighted(tree: Any) -> Any:
    """All floats of a result, weighted at random."""
    flat = jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(tree)])
    return jnp.sum(flat * np.random.default_rng(0).normal(size=flat.size))


def loss_of(c: Any, method: Any, what: str, execution: str = "core") -> Any:
    """A function of `arguments`."""

    def loss(v: dict[str, Any]) -> Any:
        cov = 0.5 * (v["cov"] + v["cov"].T)
        initial = Belief(v["mean"], Covariance.from_dense(cov, c.model.initial(c.params).cov.variances()))
        now = c._replace(
            params=v["p"], observations=v["observations"], dt=v["dt"],
            controls=c.controls._replace(acceleration=v["acceleration"]),
        )  # fmt: skip
        if what == "likelihood":
            return jnp.sum(filtered(now, execution, method, ("log_likelihood",), initial=initial).log_likelihood)
        if what == "filter":
            return weighted(filtered(now, execution, method, EVERY, initial=initial))
        found = smoothed(now, execution, method, initial=initial, covariance=what != "means")
        return weighted((found.mean, found.cov, found.filtered.log_likelihood))

    return loss


def forward(function: Any, at: Any, moves: Any, step: float) -> tuple[Any, Any]:
    """Of a function of a vector: its derivatives along every axis, and along `moves` (k, n) by central differences.

    Both are rows of one batch of derivatives in forward mode, so that one program computes them.
    """
    rows = jnp.concatenate([jnp.tile(at, (at.size, 1)), at[None] + step * moves, at[None] - step * moves])
    ways = jnp.eye(len(rows), at.size)
    values, slopes = jax.jit(jax.vmap(lambda row, way: jax.jvp(function, (row,), (way,))))(rows, ways)
    ahead, behind = jnp.split(values[at.size :], 2)
    return slopes[: at.size], (ahead - behind) / (2.0 * step)


CASES = [
    ("bent", EKF(), "likelihood"), ("bent", EKF(), "filter"), ("bent", EKF(), "means"), ("bent", EKF(), "covariances"),
    ("heading", EKF(), "filter"), ("stated", EKF(), "covariances"), ("bent", IteratedEKF(2), "covariances"),
    ("bent", UKF(), "filter"), ("heading", CKF(), "means"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "method", "what"), CASES, ids=str)
def test_gradients_are_those_of_forward_mode_and_of_differences(name, method, what):
    c = case(name, SHORT)
    at = arguments(c)
    loss = loss_of(c, method, what)
    point, tree = ravel_pytree(at)
    gradient = ravel_pytree(jax.jit(jax.grad(loss))(at))[0]
    weights = tree(jnp.asarray(np.random.default_rng(1).uniform(0.5, 1.0, point.size)))
    nothing = jax.tree.map(jnp.zeros_like, at)
    moves = jnp.stack([ravel_pytree({**nothing, key: weights[key]})[0] for key in at])  # an argument at a time
    slopes, differences = forward(lambda v: loss(tree(v)), point, moves, 1e-5)
    same(gradient, slopes, 1e-8)
    for key, ours, by_hand in zip(at, moves @ gradient, differences, strict=True):
        assert float(ours) == pytest.approx(float(by_hand), rel=1e-5, abs=1e-6), key
        assert float(ours) != 0.0


def test_gradients_of_batches_are_the_single_gradients():
    """More recordings than a block; also the gradient of their sum, and of a batch of parameters with one recording."""
    c = case("bent", SHORT)
    at = arguments(c)
    loss = loss_of(c, EKF(), "covariances")
    one = jax.jit(jax.grad(loss))
    scales = jnp.linspace(0.5, 1.5, 17)
    batch = {**at, "observations": jax.tree.map(lambda leaf: scales[:, None] * leaf[None], at["observations"])}
    axes = {name: 0 if name == "observations" else None for name in at}

    def of(k: int) -> dict[str, Any]:
        return {**at, "observations": jax.tree.map(lambda leaf: leaf[k], batch["observations"])}

    every = jax.jit(jax.vmap(jax.grad(loss), (axes,)))(batch)
    for k in (0, 8, 16):
        same(jax.tree.map(lambda leaf, k=k: leaf[k], every), one(of(k)), 1e-8)
    total = jax.jit(jax.grad(lambda v: jnp.sum(jax.vmap(loss, (axes,))(v))))(batch)
    for name, value in total.items():
        summed = every[name] if name == "observations" else jax.tree.map(lambda leaf: jnp.sum(leaf, 0), every[name])
        same(value, summed, 1e-8)
    params = {**at, "p": at["p"][None] * scales[:3, None]}
    found = jax.jit(jax.vmap(jax.grad(loss), ({**dict.fromkeys(at), "p": 0},)))(params)
    same(jax.tree.map(lambda leaf: leaf[2], found), one({**at, "p": params["p"][2]}), 1e-8)


@pytest.mark.parametrize(("name", "what"), [("bent", "covariances"), ("stated", "likelihood")])
def test_second_derivatives_are_differences_of_the_gradient(name, what):
    c = case(name, 3)
    at = arguments(c)
    loss = loss_of(c, EKF(), what)

    def value(flat: Any) -> Any:
        p, start = flat[:4], flat[4:]
        mean = ravel_pytree(at["mean"])[1](start)
        return loss({**at, "p": p, "mean": mean})

    point = jnp.concatenate([at["p"], ravel_pytree(at["mean"])[0]])
    gradient = jax.grad(value)
    rows, expected = forward(gradient, point, jnp.eye(point.size), 1e-5)
    same(rows, jax.jit(jax.jacrev(gradient))(point), 1e-8)
    np.testing.assert_allclose(rows, expected, rtol=1e-5, atol=1e-5 * float(jnp.max(jnp.abs(expected))))
