"""A model on lists of scalars as a model on vectors, for the filters on vectors and matrices."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import PyTree

from jgait.filtering.component_model import ComponentModel, component_model, noise_matrix, scalars
from jgait.filtering.components import Matrix
from jgait.filtering.linear_algebra import congruence
from jgait.filtering.model import Model
from jgait.types import Values


class Moments(NamedTuple):
    """Mean (k,), and covariance of the error about the mean (n, n)."""

    mean: PyTree
    cov: PyTree


class VectorModel(NamedTuple):
    """The functions of a `ComponentModel` on vectors."""

    state: PyTree
    error: PyTree
    observed: PyTree
    curved: bool
    names: PyTree
    transition: Callable[[PyTree, PyTree, PyTree], PyTree]
    transition_noise: Callable[[PyTree, PyTree, PyTree], PyTree]
    observation: Callable[[PyTree, PyTree], PyTree]
    observation_noise: Callable[[PyTree, PyTree], PyTree]
    retract: Callable[[PyTree, PyTree], PyTree]
    local: Callable[[PyTree, PyTree], PyTree]
    residual: Callable[[PyTree, PyTree], PyTree]
    error_transition: Callable[[PyTree, PyTree, PyTree, PyTree], PyTree] | None
    error_observation: Callable[[PyTree, PyTree, PyTree], PyTree] | None
    error_shift: Callable[[PyTree, PyTree, PyTree], PyTree] | None

    def recentred(self, reference: PyTree, delta: PyTree, cov: PyTree) -> PyTree:
        """The covariance of errors about `reference`, mapped to errors about the state reference ⊕ delta."""
        if not self.curved:
            return cov
        return congruence(self.turn(reference, delta), cov)

    def turn(self, reference: PyTree, delta: PyTree) -> PyTree:
        """∂/∂δ of ((reference ⊕ δ) ⊖ (reference ⊕ delta)) at `delta` (n, n)."""
        if self.error_shift is not None:
            shift = self.error_shift
            return jax.jacfwd(lambda e: shift(reference, delta, e))(jnp.zeros_like(delta))
        state = self.retract(reference, delta)
        return jax.jacfwd(lambda d: self.local(state, self.retract(reference, d)))(delta)


def pack(tree: PyTree, structure: PyTree, dtype: DTypeLike, what: str) -> PyTree:
    """A tuple of scalars as one vector; raises ValueError if the tuple has another structure."""
    return stacked(scalars(tree, structure, dtype, what), dtype)


def unpack(vector: PyTree, structure: PyTree) -> PyTree:
    """A vector, or a stack of vectors over time, as a tuple; inverse of `pack`."""
    return jax.tree.unflatten(structure, [vector[..., i] for i in range(structure.num_leaves)])


def pack_noise(noise: PyTree, structure: PyTree, dtype: DTypeLike, what: str) -> PyTree:
    """A `Covariance`, or a tuple of variances, as a matrix; raises ValueError like `pack`."""
    return dense_matrix(noise_matrix(noise, structure, dtype, what), dtype)


def stacked(values: list[PyTree], dtype: DTypeLike) -> PyTree:
    """Scalars as a vector of the dtype."""
    return jnp.stack([jnp.asarray(value, dtype) for value in values])


def dense_matrix(matrix: Matrix, dtype: DTypeLike) -> PyTree:
    """Rows of scalars as an array of the dtype."""
    return jnp.stack([stacked(row, dtype) for row in matrix])


def vector_model(model: Model, params: PyTree, mean: PyTree, observation: PyTree, dtype: DTypeLike) -> VectorModel:
    """Convert a model to functions on vectors; arguments and errors as in `component_model`."""
    return on_vectors(component_model(model, params, mean, observation, dtype), dtype)


def on_vectors(cm: ComponentModel, dtype: DTypeLike) -> VectorModel:
    """Convert a model on lists of scalars to functions on vectors."""
    return VectorModel(
        cm.state, cm.error, cm.observed, cm.curved, cm.names,
        lambda x, control, dt: stacked(cm.transition(list(x), control, dt), dtype),
        lambda x, control, dt: dense_matrix(cm.transition_noise(list(x), control, dt), dtype),
        lambda x, control: stacked(cm.observation(list(x), control), dtype),
        lambda x, control: dense_matrix(cm.observation_noise(list(x), control), dtype),
        (lambda x, delta: stacked(cm.retract(list(x), list(delta)), dtype)) if cm.curved else jnp.add,
        (lambda reference, x: stacked(cm.local(list(reference), list(x)), dtype))
        if cm.curved else (lambda reference, x: x - reference),
        (lambda measured, expected: stacked(cm.residual(list(measured), list(expected)), dtype))
        if cm.wrapped else jnp.subtract,
        *_error_functions(cm, dtype),
    )  # fmt: skip


def _error_functions(cm: ComponentModel, dtype: DTypeLike) -> PyTree:
    def moved(x: PyTree, delta: PyTree, control: PyTree, dt: Values) -> PyTree:
        error = list(delta)
        for step in cm.error_transition:
            error = step(list(x), error, control, dt)
        return stacked(error, dtype)

    shown, shifted = cm.error_observation, cm.error_shift
    return (
        moved if cm.error_transition else None,
        shown and (lambda x, delta, control: stacked(shown(list(x), list(delta), control), dtype)),
        shifted and (lambda x, delta, e: stacked(shifted(list(x), list(delta), list(e)), dtype)),
    )
