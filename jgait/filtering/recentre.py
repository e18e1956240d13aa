"""States and covariances that a filter returns, from what its scan computes about the predicted states.

On a manifold an error about one state is another error about the next: δ + e about x is T e about x ⊕ δ, with
T = ∂/∂e of (x ⊕ (δ + e)) ⊖ (x ⊕ δ). Arrays have the time axis in front.
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jgait.filtering.dependence import reached
from jgait.filtering.lanes import product, product_transposed
from jgait.filtering.model import Shape


def states(shape: Shape, x: Float[Array, "time k"], delta: Float[Array, "time n"]) -> Float[Array, "time k"]:
    """The states x ⊕ δ."""
    if not shape.curved:
        return x + delta
    return jnp.stack(_over_time(lambda x, d: shape.retract(x, d), x, delta), axis=-1)


def turned(
    shape: Shape, x: Float[Array, "time k"], delta: Float[Array, "time n"], error: Float[Array, "time n"]
) -> Float[Array, "time n"]:
    """Errors about x as errors about x ⊕ δ, for errors near δ."""
    if not shape.curved:
        return error
    return jnp.stack(_over_time(functools.partial(_turned, shape), x, delta, error), axis=-1)


def covariances(
    shape: Shape, chosen: tuple[int, ...], x: Float[Array, "time k"], delta: Float[Array, "time n"],
    cov: Float[Array, "time s s"],
) -> Float[Array, "time s s"]:  # fmt: skip
    """Covariances about x ⊕ δ of the components `chosen`, a `closure`, from those about x."""
    if not shape.curved:
        return cov
    pattern, varies = influences(shape)
    rows = [place for place, i in enumerate(chosen) if varies[i]]
    columns = [place for place, j in enumerate(chosen) if pattern[[chosen[i] for i in rows], j].any()]
    if not rows:
        return cov
    seeds = np.zeros((len(columns), shape.error.size))
    seeds[range(len(columns)), [chosen[j] for j in columns]] = 1.0

    def some(x: list[Array], delta: list[Array], seed: list[Array]) -> list[Array]:
        every = _turned(shape, x, delta, seed)
        return [every[chosen[i]] for i in rows]

    of_seed = jax.vmap(lambda seed: jnp.stack(_over_time(some, x, delta, jnp.broadcast_to(seed, delta.shape))))
    T = jnp.moveaxis(of_seed(jnp.asarray(seeds, shape.dtype)), 0, 1)  # (row, column, time)
    P = jnp.moveaxis(cov, 0, -1)
    P = P.at[jnp.asarray(rows)].set(product(T, P[jnp.asarray(columns)]))
    P = P.at[:, jnp.asarray(rows)].set(product_transposed(P[:, jnp.asarray(columns)], T))
    return jnp.moveaxis(P, -1, 0)


def closure(shape: Shape, components: tuple[int, ...]) -> tuple[int, ...]:
    """The components of the error that influence the covariances of `components` about another state."""
    if not shape.curved or not components:
        return components
    pattern, needed = influences(shape)[0], {*components}
    while (more := {*np.flatnonzero(pattern[sorted(needed)].any(axis=0)).tolist()} | needed) != needed:
        needed = more
    return tuple(sorted(needed))


@functools.cache
def influences(shape: Shape) -> tuple[Bool[np.ndarray, "n n"], Bool[np.ndarray, "n"]]:
    """Which components of an error (columns) influence which (rows) by T, and which rows of T are not constant.

    A constant row is that of the identity, for T is the identity at δ = 0.
    """
    k, n = shape.state.size, shape.error.size
    scalars = [jax.ShapeDtypeStruct((), shape.dtype)]
    jaxpr = jax.make_jaxpr(functools.partial(_turned, shape))(scalars * k, scalars * n, scalars * n).jaxpr
    touched = [reached(jaxpr, {v}) for v in jaxpr.invars[k + n :]]
    return np.array(touched).T, np.array(reached(jaxpr, {*jaxpr.invars[: k + n]}))


def _turned(shape: Shape, x: list[Array], delta: list[Array], error: list[Array]) -> list[Array]:
    """T e, the components of one error."""
    at = shape.retract(x, delta)
    return jax.jvp(lambda d: shape.local(at, shape.retract(x, d)), (delta,), (error,))[1]


def _over_time(function: Callable[..., list[Array]], *arrays: Float[Array, "time size"]) -> list[Array]:
    """The outputs (T,) of a function of lists of scalars at each sample of arrays (T, size)."""
    return jax.vmap(function)(*(list(jnp.unstack(v, axis=-1)) for v in arrays))
