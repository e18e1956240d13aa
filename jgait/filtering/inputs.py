"""The inputs of a filter: a model and a recording, checked, in one float type, as arrays."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float

from jgait.filtering import checks
from jgait.filtering.covariance import Covariance, Entries
from jgait.filtering.dependence import depends_on_place
from jgait.filtering.layout import Layout, Numbers, Scalar, Tree
from jgait.filtering.methods import KF
from jgait.filtering.model import Belief, Model, Shape


class Inputs(NamedTuple):
    """A filter's arguments, component by component."""

    shape: Shape
    params: Tree
    mean: list[Scalar]  #: initial mean (k scalars).
    cov: Entries  #: of the initial covariance.
    measured: list[Float[Array, "time"]]  #: the observed components that are ever measured.
    controls: list[Float[Array, "time"]]  #: components of the control.
    dt: Float[Array, "..."]  #: intervals [s], () or (T,).
    seen: list[Bool[Array, "time"] | bool]  #: the mask of `measured`, True if every sample is measured.

    @property
    def length(self) -> int:
        """T, the number of samples."""
        return len(self.measured[0])

    def arrays(self) -> list[Array]:
        """The arguments of `Recorded`, without a batch axis."""
        size, length, dtype = self.shape.error.size, (self.length,), self.shape.dtype
        cov = jnp.zeros((size, size), dtype)
        if self.cov:
            cov = Covariance.of(self.cov, self.shape.error).dense().astype(dtype)
        return [
            *jax.tree.leaves(self.params),
            jnp.stack([jnp.asarray(value, dtype) for value in self.mean]),
            cov,
            jnp.stack(self.measured, axis=-1),
            *(jnp.broadcast_to(leaf, length) for leaf in self.controls),
            jnp.broadcast_to(self.dt, length),
            jnp.stack([jnp.broadcast_to(jnp.asarray(leaf), length) for leaf in self.seen], axis=-1),
        ]


def inputs(
    model: Model, params: Tree, observations: Tree, controls: Tree, dt: Numbers, mask: Tree, initial: Belief | None
) -> Inputs:
    """Check structure and shapes, and cast everything to one dtype; raises as `kalman_filter`."""
    observations, length = checks.series(observations, "observation", None)
    controls, _ = checks.series(controls, "control", length)
    dtype = checks.common_dtype(params, observations, initial)
    params, controls = checks.in_dtype((params, controls), dtype)
    belief = model.initial(params) if initial is None else initial
    checks.check_belief(belief)
    first = jax.tree.map(lambda leaf: leaf[0], controls)
    mean = checks.in_dtype(belief.mean, dtype)
    observed = checks.observed_layout(model, params, mean, first, observations)
    seen, hidden = checks.mask_components(mask, observed, length)
    state = Layout.of(belief.mean)
    shape = Shape(
        model, jax.tree.structure(params), Layout.of(controls, axes=1), state, error_layout(model, state, dtype),
        observed, tuple(i for i in range(observed.size) if i not in hidden), jnp.dtype(dtype),
    )  # fmt: skip
    measured = _series(checks.in_dtype(observations, dtype), length)
    return Inputs(
        shape, params, state.components(belief.mean, dtype, "the mean of a belief"),
        shape.noise(belief.cov, shape.error, "the covariance of a belief"),
        [measured[i] for i in shape.measured], _series(controls, length), checks.interval(dt, length, dtype),
        [seen[i] for i in shape.measured],
    )  # fmt: skip


def _series(tree: Tree, length: int) -> list[Array]:
    """The components of a tuple of arrays (T, …), each (T,)."""
    return [part for leaf in jax.tree.leaves(tree) for part in jnp.unstack(leaf.reshape(length, -1), axis=1)]


def error_layout(model: Model, state: Layout, dtype: DTypeLike) -> Layout:
    """The layout of the error tuple: that of the state, or that of the result of `local`.

    Raises:
        ValueError: if only one of `retract` and `local` is defined.
    """
    if (model.retract is None) != (model.local is None):
        given = "retract" if model.local is None else "local"
        raise ValueError(f"a model gives both retract and local, or neither; this one gives only {given}")
    if model.local is None:
        return state
    like = state.structure.unflatten([jax.ShapeDtypeStruct(shape, dtype) for shape in state.shapes])
    return Layout.of(jax.eval_shape(model.local, like, like))


def check_linear(given: Inputs, method: object) -> None:
    """Raise if the method is `KF` and the model is nonlinear.

    Raises:
        ValueError: if a Jacobian depends on the state; the message names the function.
    """
    if not isinstance(method, KF):
        return
    shape, model = given.shape, given.shape.model
    control = shape.control.tuple([leaf[0] for leaf in given.controls])
    dt = given.dt[0] if jnp.ndim(given.dt) else given.dt
    functions = {
        "transition": (shape.state, lambda x: model.transition(given.params, shape.state.split(x), control, dt)),
        "observation": (shape.observed, lambda x: model.observation(given.params, shape.state.split(x), control)),
    }
    for field, (layout, function) in functions.items():

        def vector(
            x: Array, layout: Layout = layout, function: Callable[[Array], Tree] = function, field: str = field
        ) -> Array:
            return jnp.stack(shape.arrays(layout.components(function(x), shape.dtype, f"what {field} returns")))

        if depends_on_place(vector, jnp.zeros(shape.state.size, shape.dtype)):
            name = getattr(getattr(model, field), "__name__", "")
            named = field if name.lstrip("_") in ("", field) else f"{field} ({name})"
            raise ValueError(
                f"the KF needs a linear model, but the Jacobian of {named} depends on the state; use EKF(), UKF() or "
                "CKF()"
            )
