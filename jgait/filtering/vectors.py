"""A model on lists of scalars seen as a model on vectors: the inside of the dense filters, and of nothing else."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jgait.filtering.component_model import ComponentModel, component_model, noise_matrix, scalars
from jgait.filtering.components import Matrix
from jgait.filtering.linear_algebra import congruence
from jgait.filtering.model import Model


class Moments(NamedTuple):
    """Mean (k,), and covariance of the error about it (n, n)."""

    mean: Any
    cov: Any


class VectorModel(NamedTuple):
    """The functions of a `ComponentModel` on vectors."""

    state: Any
    error: Any
    observed: Any
    curved: bool
    names: Any
    transition: Callable[[Any, Any, Any], Any]
    transition_noise: Callable[[Any, Any, Any], Any]
    observation: Callable[[Any, Any], Any]
    observation_noise: Callable[[Any, Any], Any]
    retract: Callable[[Any, Any], Any]
    local: Callable[[Any, Any], Any]
    residual: Callable[[Any, Any], Any]
    error_transition: Callable[[Any, Any, Any, Any], Any] | None
    error_observation: Callable[[Any, Any, Any], Any] | None
    error_shift: Callable[[Any, Any, Any], Any] | None

    def recentred(self, reference: Any, delta: Any, cov: Any) -> Any:
        """The covariance about `reference`, turned into one about the state at `delta` from it."""
        if not self.curved:
            return cov
        return congruence(self.turn(reference, delta), cov)

    def turn(self, reference: Any, delta: Any) -> Any:
        """∂/∂δ of ((reference ⊕ δ) ⊖ (reference ⊕ delta)) at `delta` (n, n)."""
        if self.error_shift is not None:
            shift = self.error_shift
            return jax.jacfwd(lambda e: shift(reference, delta, e))(jnp.zeros_like(delta))
        state = self.retract(reference, delta)
        return jax.jacfwd(lambda d: self.local(state, self.retract(reference, d)))(delta)


def pack(tree: Any, structure: Any, dtype: Any, what: str) -> Any:
    """A tuple of scalars as one vector; raises ValueError if it is another tuple than expected."""
    return stacked(scalars(tree, structure, dtype, what), dtype)


def unpack(vector: Any, structure: Any) -> Any:
    """A vector (or its stack over time) as the tuple it came from."""
    return jax.tree.unflatten(structure, [vector[..., i] for i in range(structure.num_leaves)])


def pack_noise(noise: Any, structure: Any, dtype: Any, what: str) -> Any:
    """A `Covariance`, or a tuple of variances, as a matrix; raises ValueError like `pack`."""
    return dense_matrix(noise_matrix(noise, structure, dtype, what), dtype)


def stacked(values: list[Any], dtype: Any) -> Any:
    """Scalars as a vector of the dtype."""
    return jnp.stack([jnp.asarray(value, dtype) for value in values])


def dense_matrix(matrix: Matrix, dtype: Any) -> Any:
    """Rows of scalars as an array of the dtype."""
    return jnp.stack([stacked(row, dtype) for row in matrix])


def vector_model(model: Model, params: Any, mean: Any, observation: Any, dtype: Any) -> VectorModel:
    """See a model as one on vectors; arguments and errors as of `component_model`."""
    return on_vectors(component_model(model, params, mean, observation, dtype), dtype)


def on_vectors(cm: ComponentModel, dtype: Any) -> VectorModel:
    """The same model on vectors."""
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


def _error_functions(cm: ComponentModel, dtype: Any) -> Any:
    def moved(x: Any, delta: Any, control: Any, dt: Any) -> Any:
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
