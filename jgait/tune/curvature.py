"""Scores and curvature of a sum of losses, as one small program."""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, PyTree

from jgait.params import Transform, constrain
from jgait.tune.gradient import FORWARD_UP_TO, GRADIENTS
from jgait.types import AnyArray

Function = Callable[..., PyTree]


class Curvature(NamedTuple):
    """Values and derivatives of a loss at one point, in free coordinates."""

    losses: Float[AnyArray, "item"]  #: (items,) loss of each item.
    scores: Float[AnyArray, "item free"]  #: (items, p) gradient of each item's loss.
    hessian: PyTree  #: (p, p) second derivatives of the sum of the losses; None if `second` is False.
    #: value, gradient (p,) and second derivatives (p, p) of the negative log-prior; zeros without one.
    prior: tuple[Array, Array, Array]


@lru_cache(maxsize=8)
def program(
    loss: Function,
    priors: tuple[PyTree, ...] | None,
    leaves: tuple[Transform, ...],
    treedef: PyTree,
    gradient: str,
    second: bool,
) -> Function:
    """(free, params, data) → `Curvature`, jitted; the last few programs are cached, so later calls compile nothing.

    `leaves` are the transforms; with the gradient "together" all pairs of directions are computed at once; `second`
    asks for second derivatives.

    Raises:
        ValueError: for another gradient than `GRADIENTS`.
    """
    if gradient not in GRADIENTS:
        raise ValueError(f"gradient must be one of {', '.join(GRADIENTS)}; got {gradient!r}")
    transforms = jax.tree.unflatten(treedef, leaves)
    beside = (None,) * len(leaves) if priors is None else priors

    def run(free: PyTree, params: PyTree, data: PyTree) -> Curvature:
        flat, unflatten = ravel_pytree(free)

        def item_loss(vector: Float[Array, "free"], item: PyTree) -> Float[Array, ""]:
            return loss(constrain(unflatten(vector), transforms, params), item)

        def prior(vector: Float[Array, "free"]) -> Float[Array, ""]:
            natural = treedef.flatten_up_to(constrain(unflatten(vector), transforms, params))
            terms = [
                jnp.sum(jnp.asarray(one.penalty(value), vector.dtype))
                for one, value, transform in zip(beside, natural, leaves, strict=True)
                if one is not None and transform.to_free is not None
            ]
            return sum(terms, jnp.zeros_like(vector[0]))

        ways = _reverse if gradient == "reverse" or (gradient == "auto" and flat.size > FORWARD_UP_TO) else _forward
        found = ways(item_loss, flat, data, second, gradient == "together")
        slope = jax.jacfwd(prior)
        return Curvature(*found, (prior(flat), slope(flat), jax.jacfwd(slope)(flat)))

    return jax.jit(run)


def _forward(
    item_loss: Function, flat: Float[Array, "free"], data: PyTree, second: bool, together: bool
) -> tuple[Array, Array, Array | None]:
    """Forward over forward mode: nothing is stored along a filter's scan, and one evaluation is compiled."""
    eye = jnp.eye(flat.size, dtype=flat.dtype)

    def every(function: Function, over: PyTree) -> PyTree:
        return jax.vmap(function)(over) if together else lax.map(function, over)

    def losses(vector: Float[Array, "free"]) -> Float[Array, "item"]:
        return jax.vmap(item_loss, in_axes=(None, 0))(vector, data)

    def along(direction: Float[Array, "free"], vector: Float[Array, "free"] = flat) -> tuple[Array, ...]:
        return jax.jvp(losses, (vector,), (direction,))

    if not second:
        values, slopes = every(along, eye)
        return values[0], slopes.T, None

    def pair(directions: tuple[Array, Array]) -> tuple[Array, Array, Array]:
        one, other = directions
        (values, slopes), (_, bends) = jax.jvp(lambda vector: along(one, vector), (flat,), (other,))
        return values, slopes, jnp.sum(bends)

    rows, columns = np.triu_indices(flat.size)
    values, slopes, bends = every(pair, (eye[rows], eye[columns]))
    upper = jnp.zeros_like(eye).at[rows, columns].set(bends)
    return values[0], slopes[np.flatnonzero(rows == columns)].T, upper + jnp.triu(upper, 1).T


def _reverse(
    item_loss: Function, flat: Float[Array, "free"], data: PyTree, second: bool, together: bool
) -> tuple[Array, Array, Array | None]:
    """Forward over reverse mode: p tangents of the gradient; for many parameters."""

    def both(vector: Float[Array, "free"]) -> tuple[Array, Array]:
        return jax.vmap(jax.value_and_grad(item_loss), in_axes=(None, 0))(vector, data)

    if not second:
        return (*both(flat), None)

    def along(direction: Float[Array, "free"]) -> tuple[Array, ...]:
        (values, slopes), (_, bends) = jax.jvp(both, (flat,), (direction,))
        return values, slopes, jnp.sum(bends, axis=0)

    values, slopes, bends = lax.map(along, jnp.eye(flat.size, dtype=flat.dtype))
    return values[0], slopes[0], (bends + bends.T) / 2.0
