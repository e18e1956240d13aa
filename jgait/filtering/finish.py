"""States and covariances that a filter or smoother returns, from what the core computes about the predictions."""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from jgait.filtering.component_model import Shape
from jgait.filtering.lanes import held, product, product_transposed
from jgait.filtering.local_model import LocalModel
from jgait.filtering.methods import reached


def states(shape: Shape, x: PyTree, delta: PyTree, move: PyTree = None) -> PyTree:
    """The states x ⊕ δ (T, k, B), or corrected by `move` (T, n, B): an error about x, mapped to errors about x ⊕ δ."""
    if shape.model.local is None:
        return x + delta if move is None else x + delta + move
    flat, *others = _together(x, delta, *(() if move is None else (move,)))
    local = LocalModel(_alone(shape), [], flat.shape[-1])
    after, error = _updated(local, flat, *others)
    return _apart(jnp.stack(after if move is None else local.retracted(after, error)), x)


def covariances(
    shape: Shape, chosen: tuple[int, ...], x: PyTree, delta: PyTree, cov: PyTree, move: PyTree = None
) -> PyTree:
    """Covariances (T, s, s, B) of errors about `states`, from those about x; `chosen` is a `closure`."""
    if shape.model.local is None:
        return cov
    flat, around, about, *others = _together(x, delta, cov, *(() if move is None else (move,)))
    local = LocalModel(_alone(shape), [], flat.shape[-1])
    columns = [row[jnp.asarray(chosen)] for row in local.identity()]
    turned = local.turned(list(flat), list(around), columns)
    if move is not None:
        turned = local.turned(*_updated(local, flat, around, *others), turned)
    turn = held(jnp.stack([turned[i] for i in chosen]))
    return _apart(product_transposed(product(turn, about), turn), x)


def selected(cov: PyTree, inner: tuple[int, ...], components: tuple[int, ...]) -> PyTree:
    """The covariances (T, s, s, B) of components among those of their `closure`."""
    place = jnp.asarray([inner.index(i) for i in components])
    return cov if inner == components else cov[:, place[:, None], place[None]]


def _together(*arguments: PyTree) -> list[PyTree]:
    """Arrays (T, ..., B) with all samples of all recordings as last axis."""
    lanes = max(v.shape[-1] for v in arguments)
    wide = [jnp.moveaxis(jnp.broadcast_to(v, (*v.shape[:-1], lanes)), 0, -2) for v in arguments]
    return [v.reshape(*v.shape[:-2], -1) for v in wide]


def _apart(value: PyTree, like: PyTree) -> PyTree:
    """The inverse of `_together`; `like` (T, ..., B)."""
    return jnp.moveaxis(value.reshape(*value.shape[:-1], like.shape[0], -1), -2, 0)


def _updated(local: LocalModel, x: PyTree, delta: PyTree, move: PyTree = None) -> tuple[list[PyTree], list[PyTree]]:
    """The state x ⊕ δ, and the error `move` about x as an error about it."""
    after = local.retracted(list(x), list(delta))
    if move is None:
        return after, []
    return after, [v[0] for v in local.turned(list(x), list(delta), [v[None] for v in move])]


def closure(shape: Shape, components: tuple[int, ...]) -> tuple[int, ...]:
    """The components of the error that influence the covariances of `components` about another state."""
    if shape.model.local is None or not components:
        return components
    k, n, _ = shape.sizes
    local = LocalModel(_alone(shape), [], 1)

    def turned(x: PyTree, delta: PyTree, column: list[PyTree]) -> PyTree:
        return local.turned(list(x), list(delta), [v[None] for v in column])

    like = (jnp.ones((k, 1), shape.dtype), jnp.ones((n, 1), shape.dtype), [jnp.ones(1, shape.dtype)] * n)
    jaxpr = jax.make_jaxpr(turned)(*like).jaxpr
    columns = jaxpr.invars[2:]
    needed = set(components)
    for j, variable in enumerate(columns):
        touched = reached(jaxpr, {variable})
        if any(touched[i] for i in components):
            needed.add(j)
    return tuple(sorted(needed)) if needed == set(components) else closure(shape, tuple(sorted(needed)))


def _alone(shape: Shape) -> Shape:
    """The model for its functions of states and errors, which have no parameters."""
    return replace(shape, params=jax.tree.structure(()))
