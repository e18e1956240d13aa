"""The functions of a model on named tuples as functions on lists of scalars, with checks of their results.

An error δ is relative to a reference state x: `retract` computes x ⊕ δ, `local` computes x' ⊖ x; these are sum and
difference unless the model defines other functions. The checks run while tracing, once for each compilation.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import PyTree

from jgait.filtering.components import Matrix, from_upper, symmetric
from jgait.filtering.covariance import Covariance, names_of, structure_names
from jgait.filtering.model import Model
from jgait.types import Values


@dataclass(frozen=True)
class Shape:
    """What a filter knows before it is compiled.

    Attributes:
        model: state-space model.
        params, controls: tree structures of the parameters and of the controls.
        state, error, observed: tree structures of the model's tuples.
        dtype: dtype of all floats.
    """

    model: Model
    params: Any
    controls: Any
    state: Any
    error: Any
    observed: Any
    dtype: Any

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of components of state, error and observation."""
        return self.state.num_leaves, self.error.num_leaves, self.observed.num_leaves


class ComponentModel(NamedTuple):
    """The functions of a model, with its parameters, on lists of scalars; see `Model` for the meaning of each."""

    state: PyTree  #: tree structure of the state tuple (k leaves).
    error: PyTree  #: tree structure of the error tuple (n leaves).
    observed: PyTree  #: tree structure of the observation tuple (m leaves).
    curved: bool  #: whether the model defines `retract` and `local`.
    wrapped: bool  #: whether the model defines `residual`.
    names: PyTree  #: names of the model's functions in messages.
    transition: Callable[[Sequence[PyTree], PyTree, PyTree], list[PyTree]]
    transition_noise: Callable[[Sequence[PyTree], PyTree, PyTree], Matrix]
    observation: Callable[[Sequence[PyTree], PyTree], list[PyTree]]
    observation_noise: Callable[[Sequence[PyTree], PyTree], Matrix]
    retract: Callable[[Sequence[PyTree], Sequence[PyTree]], list[PyTree]]
    local: Callable[[Sequence[PyTree], Sequence[PyTree]], list[PyTree]]
    residual: Callable[[Sequence[PyTree], Sequence[PyTree]], list[PyTree]]
    #: the functions that propagate an error one after another, each (x, delta, control, dt) → delta; empty if the model
    #: defines none.
    error_transition: tuple[Callable[[Sequence[PyTree], Sequence[PyTree], PyTree, PyTree], list[PyTree]], ...]
    #: (x, delta, control) → observation, or None.
    error_observation: Callable[[Sequence[PyTree], Sequence[PyTree], PyTree], list[PyTree]] | None
    #: (x, delta, error) → error, or None.
    error_shift: Callable[[Sequence[PyTree], Sequence[PyTree], Sequence[PyTree]], list[PyTree]] | None


def scalars(tree: PyTree, structure: PyTree, dtype: DTypeLike, what: str) -> list[PyTree]:
    """The leaves of a tuple of scalars: Python numbers as floats, all other leaves as arrays of the dtype.

    Raises:
        ValueError: if the tuple is of another type than expected, or a leaf is not a scalar.
    """
    leaves, treedef = jax.tree.flatten(tree)
    if treedef != structure:
        expected = jax.tree.unflatten(structure, range(structure.num_leaves))
        raise ValueError(
            f"{what} must be a {type(expected).__name__} of ({', '.join(structure_names(structure))}); "
            f"got a {type(tree).__name__} of ({', '.join(names_of(tree))})"
        )
    for name, leaf in zip(structure_names(structure), leaves, strict=True):
        if jnp.shape(leaf) != ():
            raise ValueError(f"{what} must be a tuple of scalars; '{name}' has shape {jnp.shape(leaf)}")
    return [_scalar(leaf, dtype) for leaf in leaves]


def noise_matrix(noise: PyTree, structure: PyTree, dtype: DTypeLike, what: str) -> Matrix:
    """A `Covariance`, or a tuple of variances, as a matrix of scalars; raises ValueError like `scalars`."""
    size = structure.num_leaves
    if not isinstance(noise, Covariance):
        variances = scalars(noise, structure, dtype, f"{what}, where it is no Covariance,")
        return symmetric(size, lambda i, j: variances[i] if i == j else 0.0)
    if noise.structure != structure:
        raise ValueError(f"{what} must be a covariance of ({', '.join(structure_names(structure))}); got {noise!r}")
    for entry in noise.upper:
        if jnp.shape(entry) != ():
            raise ValueError(f"{what} must have scalar entries; got one of shape {jnp.shape(entry)}")
    return from_upper([_scalar(entry, dtype) for entry in noise.upper], size)


def _scalar(value: PyTree, dtype: DTypeLike) -> PyTree:
    return float(value) if isinstance(value, int | float) else jnp.asarray(value, dtype)


def error_structure(model: Model, state: PyTree, dtype: DTypeLike) -> PyTree:
    """The tree structure of the error tuple: that of the state, or that of the result of `local`.

    Raises:
        ValueError: if only one of `retract` and `local` is defined.
    """
    if (model.retract is None) != (model.local is None):
        given = "retract" if model.local is None else "local"
        raise ValueError(f"a model gives both retract and local, or neither; this one gives only {given}")
    if model.local is None:
        return state
    like = jax.tree.unflatten(state, [jax.ShapeDtypeStruct((), dtype)] * state.num_leaves)
    return jax.tree.structure(jax.eval_shape(model.local, like, like))


def component_model(shape: Shape, params: PyTree) -> ComponentModel:
    """Convert a model to functions on lists of scalars.

    Args:
        shape: the model on named tuples, and their structures.
        params: passed on to its functions.

    Raises:
        ValueError: while tracing, if the result of a function of the model has the wrong type.
    """
    model, state, error, observed, dtype = shape.model, shape.state, shape.error, shape.observed, shape.dtype
    names = {field: _named(field, getattr(model, field)) for field in ("transition", "observation")}

    def transition(x: Sequence[PyTree], control: PyTree, dt: Values) -> list[PyTree]:
        moved = model.transition(params, state.unflatten(x), control, dt)
        return scalars(moved, state, dtype, f"what {names['transition']} returns")

    def transition_noise(x: Sequence[PyTree], control: PyTree, dt: Values) -> Matrix:
        noise = model.transition_noise(params, state.unflatten(x), control, dt)
        return noise_matrix(noise, error, dtype, "what transition_noise returns")

    def predicted(x: Sequence[PyTree], control: PyTree) -> list[PyTree]:
        sensed = model.observation(params, state.unflatten(x), control)
        return scalars(sensed, observed, dtype, f"what {names['observation']} returns")

    def observation_noise(x: Sequence[PyTree], control: PyTree) -> Matrix:
        noise = model.observation_noise(params, state.unflatten(x), control)
        return noise_matrix(noise, observed, dtype, "what observation_noise returns")

    def retract(x: Sequence[PyTree], delta: Sequence[PyTree]) -> list[PyTree]:
        if model.retract is None:
            return [a + d for a, d in zip(x, delta, strict=True)]
        return scalars(model.retract(state.unflatten(x), error.unflatten(delta)), state, dtype, "what retract returns")

    def local(reference: Sequence[PyTree], x: Sequence[PyTree]) -> list[PyTree]:
        if model.local is None:
            return [a - r for a, r in zip(x, reference, strict=True)]
        return scalars(model.local(state.unflatten(reference), state.unflatten(x)), error, dtype, "what local returns")

    def residual(measured: Sequence[PyTree], expected: Sequence[PyTree]) -> list[PyTree]:
        if model.residual is None:
            return [a - b for a, b in zip(measured, expected, strict=True)]
        difference = model.residual(observed.unflatten(measured), observed.unflatten(expected))
        return scalars(difference, observed, dtype, "what residual returns")

    return ComponentModel(
        state, error, observed, model.local is not None, model.residual is not None, names, transition,
        transition_noise, predicted, observation_noise, retract, local, residual,
        *_error_functions(model, params, state, error, observed, dtype),
    )  # fmt: skip


def _error_functions(
    model: Model, params: PyTree, state: PyTree, error: PyTree, observed: PyTree, dtype: DTypeLike
) -> PyTree:
    """The model's functions of errors, as functions on lists of scalars."""
    stated = model.error_transition
    steps = stated if isinstance(stated, tuple) else () if stated is None else (stated,)
    if model.local is None and (steps or model.error_observation or model.error_shift):
        raise ValueError("a model that states how errors move gives retract and local; this one gives neither")

    def moved(
        step: Callable[..., PyTree], x: Sequence[PyTree], delta: Sequence[PyTree], control: PyTree, dt: Values
    ) -> list[PyTree]:
        after = step(params, state.unflatten(x), error.unflatten(delta), control, dt)
        return scalars(after, error, dtype, f"what {_named('error_transition', step)} returns")

    def shown(x: Sequence[PyTree], delta: Sequence[PyTree], control: PyTree) -> list[PyTree]:
        difference = model.error_observation(params, state.unflatten(x), error.unflatten(delta), control)  # type: ignore[misc]
        return scalars(difference, observed, dtype, "what error_observation returns")

    def shifted(x: Sequence[PyTree], delta: Sequence[PyTree], e: Sequence[PyTree]) -> list[PyTree]:
        after = model.error_shift(state.unflatten(x), error.unflatten(delta), error.unflatten(e))  # type: ignore[misc]
        return scalars(after, error, dtype, "what error_shift returns")

    return (
        tuple(partial(moved, step) for step in steps),
        None if model.error_observation is None else shown,
        None if model.error_shift is None else shifted,
    )


def _named(field: str, function: PyTree) -> str:
    """The name of a function in messages: `transition`, or `transition (pendulum_transition)`."""
    name = getattr(function, "__name__", "")
    return field if name.lstrip("_") in ("", field) else f"{field} ({name})"
