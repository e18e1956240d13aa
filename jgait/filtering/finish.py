"""States and covariances that a filter or smoother returns, from what the core computes about the predictions."""

import functools
import operator
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt
from jaxtyping import PyTree

from jgait.filtering.component_model import Shape
from jgait.filtering.lanes import held
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
    local, pattern = LocalModel(_alone(shape), [], flat.shape[-1]), _influences(shape)
    pattern = (pattern if move is None else pattern @ pattern)[np.ix_(chosen, chosen)]
    groups = _apart_in_rows(pattern)
    seeds = np.zeros((shape.sizes[1], max(groups) + 1))
    seeds[list(chosen), groups] = 1.0
    columns = [jnp.broadcast_to(jnp.asarray(row[:, None], shape.dtype), (len(row), flat.shape[-1])) for row in seeds]
    turned = local.turned(list(flat), list(around), columns)
    if move is not None:
        turned = local.turned(*_updated(local, flat, around, *others), turned)
    turn = held(jnp.stack([turned[i] for i in chosen]))

    def half(matrix: PyTree) -> PyTree:
        """The turning matrix times another one, by its entries that are not zero."""
        terms = [[turn[i, groups[j]][None] * matrix[j] for j in np.flatnonzero(row)] for i, row in enumerate(pattern)]
        return held(jnp.stack([functools.reduce(operator.add, row) for row in terms]))

    return _apart(half(jnp.swapaxes(half(about), 0, 1)), x)


def _apart_in_rows(pattern: npt.NDArray[np.bool_]) -> list[int]:
    """A group of each column, so that no row has entries in two columns of a group: they are computed together."""
    taken: list[npt.NDArray[np.bool_]] = []
    groups = []
    for column in pattern.T:
        group = next((i for i, rows in enumerate(taken) if not (rows & column).any()), len(taken))
        taken[group:] = [column | taken[group] if group < len(taken) else column, *taken[group + 1 :]]
        groups.append(group)
    return groups


def selected(cov: PyTree, inner: tuple[int, ...], components: tuple[int, ...]) -> PyTree:
    """The covariances (T, s, s, B) of components among those of their `closure`."""
    place = jnp.asarray([inner.index(i) for i in components])
    return cov if inner == components else cov[:, place[:, None], place[None]]


def _together(*arguments: PyTree) -> list[PyTree]:
    """Arrays (T, ..., B) with all samples of all recordings as last axis."""
    lanes = max(v.shape[-1] for v in arguments)
    wide = [jnp.moveaxis(jnp.broadcast_to(v, (*v.shape[:-1], lanes)), 0, -2) for v in arguments]
    return [held(v.reshape(*v.shape[:-2], -1)) for v in wide]


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
    pattern, needed = _influences(shape), {*components}
    while (more := {*np.flatnonzero(pattern[sorted(needed)].any(axis=0)).tolist()} | needed) != needed:
        needed = more
    return tuple(sorted(needed))


@functools.cache
def _influences(shape: Shape) -> npt.NDArray[np.bool_]:
    """(n, n): whether a component of an error about x (column) influences one about another state (row)."""
    k, n, _ = shape.sizes
    local = LocalModel(_alone(shape), [], 1)

    def turned(x: PyTree, delta: PyTree, column: list[PyTree]) -> PyTree:
        return local.turned(list(x), list(delta), [v[None] for v in column])

    like = (jnp.ones((k, 1), shape.dtype), jnp.ones((n, 1), shape.dtype), [jnp.ones(1, shape.dtype)] * n)
    jaxpr = jax.make_jaxpr(turned)(*like).jaxpr
    return np.array([reached(jaxpr, {variable}) for variable in jaxpr.invars[2:]]).T


def _alone(shape: Shape) -> Shape:
    """The model for its functions of states and errors, which have no parameters."""
    return replace(shape, params=jax.tree.structure(()))
