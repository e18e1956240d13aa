"""The inputs of a filter: a model and a recording, checked, in one float type, as components and as arrays."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import PyTree

from jgait.filtering import checks
from jgait.filtering.component_model import (
    ComponentModel,
    Shape,
    component_model,
    error_structure,
    noise_matrix,
    scalars,
)
from jgait.filtering.components import Matrix
from jgait.filtering.model import Belief, Model
from jgait.types import Values


class Inputs(NamedTuple):
    """A filter's arguments, component by component."""

    shape: Shape  #: the model, and the tree structures of its tuples.
    params: PyTree  #: its parameters.
    cm: ComponentModel  #: the model on lists of scalars.
    mean: list[PyTree]  #: initial mean (k scalars; known scalars are Python floats).
    cov: Matrix  #: initial covariance (n × n scalars).
    measured: list[PyTree]  #: observation (m arrays (T,)).
    controls: PyTree  #: control tuple of (T,) arrays, or None.
    dt: Values  #: intervals, () or (T,).
    seen: list[PyTree]  #: the mask (m arrays (T,) of bools, or True if every sample of the component is measured).
    dtype: DTypeLike  #: dtype of all floats.
    length: int  #: T, number of samples.

    def arrays(self) -> list[PyTree]:
        """The arguments of `core.Filter`, without a batch axis."""
        size, shape = len(self.cov), (self.length,)
        return [
            *jax.tree.leaves(self.params),
            jnp.stack([jnp.asarray(value, self.dtype) for value in self.mean]),
            jnp.stack([jnp.asarray(value, self.dtype) for row in self.cov for value in row]).reshape(size, size),
            jnp.stack(self.measured, axis=-1),
            *(jnp.broadcast_to(leaf, shape) for leaf in jax.tree.leaves(self.controls)),
            jnp.broadcast_to(self.dt, shape),
            jnp.stack([jnp.broadcast_to(jnp.asarray(leaf), shape) for leaf in self.seen], axis=-1),
        ]


def inputs(
    model: Model,
    params: PyTree,
    observations: PyTree,
    controls: PyTree,
    dt: Values,
    mask: PyTree,
    initial: Belief | None,
) -> Inputs:
    """Check structure and shapes, and cast everything to one dtype; raises as `kalman_filter`."""
    observations, length = checks.series(observations, "observation", None)
    controls, _ = checks.series(controls, "control", length)
    dtype = checks.common_dtype(params, observations, initial)
    params, controls = checks.in_dtype((params, controls), dtype)
    belief = model.initial(params) if initial is None else initial
    checks.check_belief(belief)
    first = jax.tree.map(lambda leaf: leaf[0], controls)
    checks.check_observation(model, params, checks.in_dtype(belief.mean, dtype), first, observations)
    state: PyTree = jax.tree.structure(belief.mean)
    shape = Shape(
        model, jax.tree.structure(params), jax.tree.structure(controls), state, error_structure(model, state, dtype),
        jax.tree.structure(observations), jnp.dtype(dtype),
    )  # fmt: skip
    cm = component_model(shape, params)
    return Inputs(
        shape,
        params,
        cm,
        scalars(belief.mean, cm.state, dtype, "the mean of a belief"),
        noise_matrix(belief.cov, cm.error, dtype, "the covariance of a belief"),
        [leaf.astype(dtype) for leaf in jax.tree.leaves(observations)],
        controls,
        checks.interval(dt, length, dtype),
        checks.mask_leaves(mask, observations, (length,)),
        dtype,
        length,
    )
