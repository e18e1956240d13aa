"""A model on named tuples seen as a model on vectors: the inside of the dense filters, and of nothing else.

Errors δ are taken about a reference state x: x ⊕ δ by `retract`, x' ⊖ x by `local`; plain sum and difference unless
the model says otherwise. What the model's functions return is checked here, while tracing, against the state.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jgait.filtering.covariance import Covariance, names_of, structure_names
from jgait.filtering.linear_algebra import congruence
from jgait.filtering.model import Model


class Moments(NamedTuple):
    """Mean (k,), and covariance of the error about it (n, n)."""

    mean: Any
    cov: Any


class VectorModel(NamedTuple):
    """The functions of a model, with its parameters, on vectors; see `Model` for what each does.

    Attributes:
        state: tree structure of the state tuple (k leaves).
        error: of the error tuple (n leaves).
        observed: of the observation tuple (m leaves).
        curved: whether the model brings its own retract and local.
    """

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

    def recentred(self, reference: Any, delta: Any, cov: Any) -> Any:
        """The covariance about `reference`, turned into one about the state at `delta` from it."""
        if not self.curved:
            return cov
        return congruence(self.turn(reference, delta), cov)

    def turn(self, reference: Any, delta: Any) -> Any:
        """∂/∂δ of ((reference ⊕ δ) ⊖ (reference ⊕ delta)) at `delta` (n, n)."""
        state = self.retract(reference, delta)
        return jax.jacfwd(lambda d: self.local(state, self.retract(reference, d)))(delta)


def pack(tree: Any, structure: Any, dtype: Any, what: str) -> Any:
    """A tuple of scalars as one vector.

    Raises:
        ValueError: if the tuple is of another type than expected, or a leaf is not a scalar.
    """
    leaves, found = jax.tree.flatten(tree)
    if found != structure:
        expected = jax.tree.unflatten(structure, range(structure.num_leaves))
        raise ValueError(
            f"{what} must be a {type(expected).__name__} of ({', '.join(structure_names(structure))}); "
            f"got a {type(tree).__name__} of ({', '.join(names_of(tree))})"
        )
    for name, leaf in zip(structure_names(structure), leaves, strict=True):
        if jnp.shape(leaf) != ():
            raise ValueError(f"{what} must be a tuple of scalars; '{name}' has shape {jnp.shape(leaf)}")
    return jnp.stack([jnp.asarray(leaf, dtype) for leaf in leaves])


def unpack(vector: Any, structure: Any) -> Any:
    """A vector (or its stack over time) as the tuple it came from."""
    return jax.tree.unflatten(structure, [vector[..., i] for i in range(structure.num_leaves)])


def pack_noise(noise: Any, structure: Any, dtype: Any, what: str) -> Any:
    """A `Covariance`, or a tuple of variances, as a matrix; raises ValueError like `pack`."""
    if not isinstance(noise, Covariance):
        variances = pack(noise, structure, dtype, f"{what}, where it is no Covariance,")
        return jnp.where(jnp.eye(structure.num_leaves, dtype=bool), variances[:, None], 0.0)
    if noise.structure != structure:
        raise ValueError(f"{what} must be a covariance of ({', '.join(structure_names(structure))}); got {noise!r}")
    for entry in noise.upper:
        if jnp.shape(entry) != ():
            raise ValueError(f"{what} must have scalar entries; got one of shape {jnp.shape(entry)}")
    upper = tuple(jnp.asarray(entry, dtype) for entry in noise.upper)
    return Covariance(upper, structure).dense()


def _error_structure(model: Model, state: Any, dtype: Any) -> Any:
    """The tree structure of the error tuple: the state's, or what `local` gives."""
    if (model.retract is None) != (model.local is None):
        given = "retract" if model.local is None else "local"
        raise ValueError(f"a model gives both retract and local, or neither; this one gives only {given}")
    if model.local is None:
        return state
    like = jax.tree.unflatten(state, [jax.ShapeDtypeStruct((), dtype)] * state.num_leaves)
    return jax.tree.structure(jax.eval_shape(model.local, like, like))


def vector_model(model: Model, params: Any, mean: Any, observation: Any, dtype: Any) -> VectorModel:
    """See a model as one on vectors.

    Args:
        model: on named tuples.
        params: passed on to its functions.
        mean: a tuple of the state's type.
        observation: a tuple of the observation's type, or None where nothing is observed.
        dtype: of all vectors.

    Raises:
        ValueError: now, if retract and local do not go together; while tracing, if a function of the model does not
            return what its neighbours need.
    """
    state, observed = jax.tree.structure(mean), jax.tree.structure(observation)
    error = _error_structure(model, state, dtype)
    names = {field: _named(field, getattr(model, field)) for field in ("transition", "observation")}

    def transition(x: Any, control: Any, dt: Any) -> Any:
        moved = model.transition(params, unpack(x, state), control, dt)
        return pack(moved, state, dtype, f"what {names['transition']} returns")

    def transition_noise(x: Any, control: Any, dt: Any) -> Any:
        noise = model.transition_noise(params, unpack(x, state), control, dt)
        return pack_noise(noise, error, dtype, "what transition_noise returns")

    def predicted(x: Any, control: Any) -> Any:
        sensed = model.observation(params, unpack(x, state), control)
        return pack(sensed, observed, dtype, f"what {names['observation']} returns")

    def observation_noise(x: Any, control: Any) -> Any:
        noise = model.observation_noise(params, unpack(x, state), control)
        return pack_noise(noise, observed, dtype, "what observation_noise returns")

    def retract(x: Any, delta: Any) -> Any:
        if model.retract is None:
            return x + delta
        return pack(model.retract(unpack(x, state), unpack(delta, error)), state, dtype, "what retract returns")

    def local(reference: Any, x: Any) -> Any:
        if model.local is None:
            return x - reference
        return pack(model.local(unpack(reference, state), unpack(x, state)), error, dtype, "what local returns")

    def residual(measured: Any, expected: Any) -> Any:
        if model.residual is None:
            return measured - expected
        difference = model.residual(unpack(measured, observed), unpack(expected, observed))
        return pack(difference, observed, dtype, "what residual returns")

    return VectorModel(
        state, error, observed, model.local is not None, names, transition, transition_noise, predicted,
        observation_noise, retract, local, residual,
    )  # fmt: skip


def _named(field: str, function: Any) -> str:
    """`transition`, or `transition (pendulum_transition)`, for messages."""
    name = getattr(function, "__name__", "")
    return field if name.lstrip("_") in ("", field) else f"{field} ({name})"
