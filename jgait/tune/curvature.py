"""Scores and curvature of a sum of losses, as one small program."""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, PyTree

from jgait.params import Transform, constrain
from jgait.tune.problem import Problem, penalty
from jgait.types import AnyArray


class Curvature(NamedTuple):
    """Values and derivatives of a loss at one point, in free coordinates."""

    losses: Float[AnyArray, "item"]  #: (items,) loss of each item.
    scores: Float[AnyArray, "item free"]  #: (items, p) gradient of each item's loss.
    hessian: PyTree  #: (p, p) second derivatives of the sum of the losses; None if `second` is False.
    #: value, gradient (p,) and second derivatives (p, p) of the negative log-prior; zeros without one.
    prior: tuple[Array, Array, Array]


@lru_cache(maxsize=8)
def program(
    loss: Callable[..., PyTree],
    priors: tuple[PyTree, ...] | None,
    leaves: tuple[Transform, ...],
    treedef: PyTree,
    second: bool,
) -> Callable[..., Curvature]:
    """(free, params, data) → `Curvature`, jitted; the last few programs are cached, so later calls compile nothing.

    `leaves` are the transforms, `priors` those beside them; `second` asks for second derivatives.
    """
    transforms, told = (None if part is None else jax.tree.unflatten(treedef, part) for part in (leaves, priors))
    problem = Problem(loss, transforms, told, None)

    def run(free: PyTree, params: PyTree, data: PyTree) -> Curvature:
        flat, unflatten = ravel_pytree(free)

        def item_loss(vector: Float[Array, "free"], item: PyTree) -> Float[Array, ""]:
            return loss(constrain(unflatten(vector), transforms, params), item)

        def both(vector: Float[Array, "free"]) -> tuple[Array, Array]:
            return jax.vmap(jax.value_and_grad(item_loss), in_axes=(None, 0))(vector, data)

        def along(direction: Float[Array, "free"]) -> tuple[Array, ...]:
            (losses, scores), (_, bends) = jax.jvp(both, (flat,), (direction,))
            return losses, scores, jnp.sum(bends, axis=0)

        def prior(vector: Float[Array, "free"]) -> Float[Array, ""]:
            given = jnp.zeros(()) if told is None else penalty(problem, unflatten(vector), params)
            return given.astype(vector.dtype)

        slope = jax.jacfwd(prior)
        beside = (prior(flat), slope(flat), jax.jacfwd(slope)(flat))
        if not second:
            return Curvature(*both(flat), None, beside)
        losses, scores, bends = jax.lax.map(along, jnp.eye(flat.size, dtype=flat.dtype))  # one evaluation is compiled
        return Curvature(losses[0], scores[0], (bends + bends.T) / 2.0, beside)

    return jax.jit(run)
