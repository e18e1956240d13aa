"""Covariances about the states that a filter or smoother returns, from those about the predictions."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from jgait.filtering.core import block_of
from jgait.filtering.lanes import held, product, transposed
from jgait.filtering.local_model import LocalModel, Shape
from jgait.filtering.methods import reached


@dataclass(frozen=True)
class Turned:
    """Covariances of errors about `States`, from those about x: x (T, k), δ (T, n), P (T, s, s) → (T, s, s).

    Attributes:
        shape: the model.
        chosen: the components of P, a `closure`.
    """

    shape: Shape
    chosen: tuple[int, ...]
    reverse = None

    @property
    def block(self) -> int:
        """Recordings computed at once."""
        return block_of(self.shape)

    @property
    def whole(self) -> "Turned":
        """The same function."""
        return self

    def part(self, outputs: list[PyTree]) -> list[PyTree]:
        """The same outputs."""
        return outputs

    def shapes(self, *arguments: jax.ShapeDtypeStruct) -> list[jax.ShapeDtypeStruct]:
        """The shape of P."""
        return [arguments[2]]

    def value(self, *arguments: PyTree) -> list[PyTree]:
        """The covariances, time axis in front and batch behind."""
        if self.shape.model.local is None:
            return [arguments[2]]
        x, delta, cov, *move = _together(arguments)
        local = LocalModel(_alone(self.shape), [], cov.shape[-1])
        unit = local.identity()
        columns = [row[jnp.asarray(self.chosen)] for row in unit]
        turned = local.turned(list(x), list(delta), columns)
        if move:
            turned = local.turned(*_updated(local, x, delta, *move), turned)
        turn = held(jnp.stack([turned[i] for i in self.chosen]))
        return [_apart(product(product(turn, cov), transposed(turn)), arguments)]


@dataclass(frozen=True)
class States:
    """The states after an update and, if there is one, a correction: x (T, k), δ (T, n), correction (T, n) → (T, k).

    A correction is an error about x, like δ, and is mapped to errors about x ⊕ δ.
    """

    shape: Shape
    reverse = None

    @property
    def block(self) -> int:
        """Recordings computed at once."""
        return block_of(self.shape)

    @property
    def whole(self) -> "States":
        """The same function."""
        return self

    def part(self, outputs: list[PyTree]) -> list[PyTree]:
        """The same outputs."""
        return outputs

    def shapes(self, *arguments: jax.ShapeDtypeStruct) -> list[jax.ShapeDtypeStruct]:
        """The shape of x."""
        return [arguments[0]]

    def value(self, *arguments: PyTree) -> list[PyTree]:
        """The states, time axis in front and batch behind."""
        if self.shape.model.local is None:
            return [sum(arguments[1:], arguments[0])]
        x, delta, *move = _together(arguments)
        local = LocalModel(_alone(self.shape), [], x.shape[-1])
        after, error = _updated(local, x, delta, *move)
        return [_apart(jnp.stack(local.retracted(after, error) if move else after), arguments)]


def _together(arguments: tuple[PyTree, ...]) -> list[PyTree]:
    """Arrays (T, ..., B) with all samples of all recordings as last axis."""
    lanes = max(v.shape[-1] for v in arguments)
    wide = [jnp.moveaxis(jnp.broadcast_to(v, (*v.shape[:-1], lanes)), 0, -2) for v in arguments]
    return [v.reshape(*v.shape[:-2], -1) for v in wide]


def _apart(value: PyTree, arguments: tuple[PyTree, ...]) -> PyTree:
    """The inverse of `_together`."""
    length = arguments[0].shape[0]
    return jnp.moveaxis(value.reshape(*value.shape[:-1], length, -1), -2, 0)


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
