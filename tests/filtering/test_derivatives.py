"""Derivatives of filters and smoothers by every argument: both modes, differences, and one within the other."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filtering.problems import LINE, case, filtered, padded, same, smoothed

from jgait.filtering import CKF, EKF, FIELDS, UKF, Belief, Covariance, IteratedEKF

EVERY = tuple(name for name in FIELDS if name not in ("count", "valid"))
SHORT = 6


def arguments(c: Any) -> dict[str, Any]:
    """Everything that a filter is differentiated by: all parameters of `problems`, the prior, the recording."""
    mean, cov = c.model.initial(c.params)
    given = {
        "p": c.params, "mean": mean, "cov": cov.dense(), "observations": c.observations,
        "acceleration": c.controls.acceleration, "dt": np.broadcast_to(c.dt, len(c.controls.acceleration)),
    }  # fmt: skip
    if c.model is LINE:  # its parameter is the first variance, and nothing pushes on it
        del given["p"], given["acceleration"]
    return jax.tree.map(lambda leaf: np.asarray(leaf, float), given)


def flattened(at: dict[str, Any]) -> tuple[np.ndarray, Any]:
    """As one vector; and its inverse."""
    leaves, structure = jax.tree.flatten(at)
    ends = np.cumsum([leaf.size for leaf in leaves])[:-1]

    def tree(vector: Any) -> Any:
        parts = zip(jnp.split(vector, ends), leaves, strict=True)
        return structure.unflatten([part.reshape(leaf.shape) for part, leaf in parts])

    return np.concatenate([np.ravel(leaf) for leaf in leaves]), tree


def weighted(tree: Any) -> Any:
    """All floats of a result, weighted at random."""
    flat = jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(tree)])
    return jnp.sum(flat * np.random.default_rng(0).normal(size=flat.size))


def loss_of(c: Any, method: Any, what: str, execution: str = "core") -> Any:
    """A function of `arguments`: of the likelihood, the filter's fields, what the smoother tells, or everything."""

    def loss(v: dict[str, Any]) -> Any:
        cov = 0.5 * (v["cov"] + v["cov"].T)
        initial = Belief(v["mean"], Covariance.from_dense(cov, c.model.initial(c.params).cov.variances()))
        now = c._replace(
            params=v.get("p", c.params), observations=v["observations"], dt=v["dt"],
            controls=c.controls._replace(acceleration=v.get("acceleration", c.controls.acceleration)),
        )  # fmt: skip
        if what == "likelihood":
            return jnp.sum(filtered(now, execution, method, ("log_likelihood",), initial).log_likelihood)
        if what == "filter":
            return weighted(filtered(now, execution, method, EVERY, initial))
        keep = EVERY if what == "everything" else ("log_likelihood",)
        found = smoothed(now, execution, method, keep, initial, what != "means")
        return weighted((found.mean, found.cov, found.filtered))

    return loss


Function = Callable[[Any], tuple[Any, Any]]
"""Of a vector: what is differentiated, and what else is told."""


def forward(function: Function, row: Any, way: Any) -> tuple[Any, Any]:
    """Derivatives along a direction, and what is told."""
    return jax.jvp(function, (row,), (way,), has_aux=True)[1:]


def derived(function: Function, at: Any, moves: Any) -> tuple[Any, Any, Any]:
    """Derivatives along every axis; what is told, and its central differences along `moves` (k, n).

    All are rows of one batch of derivatives, so that one program computes them.
    """
    rows = np.concatenate([np.tile(at, (at.size, 1)), at + STEP * moves, at - STEP * moves])
    ways = np.eye(len(rows), at.size)
    slopes, told = map(np.asarray, jax.jit(jax.vmap(lambda row, way: forward(function, row, way)))(rows, ways))
    ahead, behind = np.split(told[at.size :], 2)
    return slopes[: at.size], told[0], (ahead - behind) / (2.0 * STEP)


STEP = 1e-5
CASES = [
    ("bent", EKF(), "everything"), ("heading", EKF(), "everything"),
    ("bent", IteratedEKF(2), "covariances"), ("bent", UKF(), "filter"), ("line", CKF(), "means"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "method", "what"), CASES, ids=str)
def test_gradients_are_those_of_forward_mode_and_of_differences(name, method, what):
    c = case(name, SHORT)
    at = arguments(c)
    ahead, back = (loss_of(c, dataclasses.replace(method, derivative=mode), what) for mode in ("forward", "reverse"))
    point, tree = flattened(at)

    def value(flat: Any) -> tuple[Any, Any]:
        found = ahead(tree(flat))
        return found, found

    gradient = np.asarray(jax.jit(jax.grad(lambda flat: back(tree(flat))))(point))
    weights = np.random.default_rng(1).uniform(0.5, 1.0, point.size)
    owners, _ = flattened({key: jax.tree.map(lambda leaf, i=i: 0.0 * leaf + i, at[key]) for i, key in enumerate(at)})
    moves = np.stack([np.where(owners == i, weights, 0.0) for i in range(len(at))])  # an argument at a time
    slopes, _, differences = derived(value, point, moves)
    same(gradient, slopes, 1e-8)
    for key, ours, by_hand in zip(at, moves @ gradient, differences, strict=True):
        assert ours == pytest.approx(by_hand, rel=1e-5, abs=1e-6), key
        assert ours != 0.0


def test_gradients_of_batches_are_the_single_gradients():
    """More recordings than a block; also the gradient of their sum, and of a batch of parameters with one recording."""
    c = case("bent", SHORT)
    at = arguments(c)
    loss = loss_of(c, EKF(), "covariances")
    one = jax.jit(jax.grad(loss))
    scales = np.linspace(0.5, 1.5, 17)
    batch = {**at, "observations": jax.tree.map(lambda leaf: scales[:, None] * leaf, at["observations"])}
    axes = {name: 0 if name == "observations" else None for name in at}

    def found(function: Any, values: Any) -> Any:
        return jax.tree.map(np.asarray, jax.jit(function)(values))

    every = found(jax.vmap(jax.grad(loss), (axes,)), batch)
    for k in (0, 8, 16):
        alone = one({**at, "observations": jax.tree.map(lambda leaf, k=k: leaf[k], batch["observations"])})
        same(jax.tree.map(lambda leaf, k=k: leaf[k], every), alone, 1e-8)
    total = found(jax.grad(lambda v: jnp.sum(jax.vmap(loss, (axes,))(v))), batch)
    for name, value in total.items():
        summed = every[name] if name == "observations" else jax.tree.map(lambda leaf: np.sum(leaf, 0), every[name])
        same(value, summed, 1e-8)
    params = {**at, "p": at["p"] * scales[:3, None]}
    several = found(jax.vmap(jax.grad(loss), ({**dict.fromkeys(at), "p": 0},)), params)
    same(jax.tree.map(lambda leaf: leaf[2], several), one({**at, "p": params["p"][2]}), 1e-8)


@pytest.mark.parametrize(("name", "what"), [("bent", "covariances"), ("heading", "likelihood")])
def test_second_derivatives_are_differences_of_the_gradient(name, what):
    """Forward mode over the gradient in reverse mode, that of the loss by differences; of a padded recording."""
    c = padded(case(name, 3))
    at = arguments(c)
    loss = loss_of(c, EKF(), what)
    point, tree = flattened({"p": at["p"], "mean": at["mean"]})

    def gradient(flat: Any) -> tuple[Any, Any]:
        value, slope = jax.value_and_grad(lambda flat: loss({**at, **tree(flat)}))(flat)
        return slope, jnp.append(slope, value)

    second, told, differences = derived(gradient, point, np.eye(point.size))
    for ours, by_hand in ((second, differences[:, :-1]), (told[:-1], differences[:, -1])):
        np.testing.assert_allclose(ours, by_hand, rtol=1e-5, atol=1e-5 * np.max(np.abs(by_hand)))
