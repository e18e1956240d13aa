"""A state-space model: functions on tuples of named numbers and arrays, and distributions of such tuples.

States, observations and controls are NamedTuples whose fields are scalars, arrays, or tuples of these; a rotation may
be an object of another library that is a pytree of arrays. The same names address the entries of a covariance.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree, PyTreeDef

from jgait.filtering.covariance import Covariance, Entries, Layout, Scalar, Tree
from jgait.notes import record


@record
class Belief(NamedTuple):
    """A distribution of a state: the mean, and the covariance of the error about the mean."""

    mean: PyTree
    cov: Covariance

    def joined(self) -> "Belief":
        """The same belief in the structure of a filter's results, for loops that begin with it."""
        return Belief(self.mean, Covariance.from_dense(self.cov.dense(), self.cov.layout))


@record
class Model(NamedTuple):
    """A state-space model; functions at module level, so that the model is hashable and compiles once.

    Attributes:
        initial: params → `Belief` one interval before the first sample.
        transition: (params, state, control, dt) → state after dt.
        transition_noise: (params, state, control, dt) → `Covariance`, or an error tuple of independent variances;
            computed at the mean before the interval.
        observation: (params, state, control) → expected observation.
        observation_noise: (params, state, control) → `Covariance`, or an observation tuple of variances; computed at
            the predicted mean.
        retract: (state, error) → state, for states on a manifold; None: their sum.
        local: (reference, state) → error with retract(reference, local(reference, state)) = state; None: difference.
        residual: (measured, predicted) → their difference, for angles that wrap; None: plain subtraction.

    In a tuple of variances one number stands for all entries of an array. All Jacobians come from autodiff.
    """

    initial: Callable[..., Belief]
    transition: Callable[..., Tree]
    transition_noise: Callable[..., Covariance | Tree]
    observation: Callable[..., Tree]
    observation_noise: Callable[..., Covariance | Tree]
    retract: Callable[..., Tree] | None = None
    local: Callable[..., Tree] | None = None
    residual: Callable[..., Tree] | None = None


@dataclass(frozen=True)
class Shape:
    """What a filter knows of a model before it is compiled.

    Attributes:
        model: state-space model.
        params: tree structure of its parameters.
        control, state, error, observed: layouts of its tuples.
        measured: numbers of the observation's components that are ever measured.
        dtype: dtype of all floats.
    """

    model: Model
    params: PyTreeDef
    control: Layout
    state: Layout
    error: Layout
    observed: Layout
    measured: tuple[int, ...]
    dtype: np.dtype[np.floating]

    @property
    def curved(self) -> bool:
        """Whether the state is on a manifold."""
        return self.model.local is not None

    def retract(self, x: list[Array], e: list[Array]) -> list[Array]:
        """The components of x ⊕ e."""
        if self.model.retract is None:
            return [a + b for a, b in zip(x, e, strict=True)]
        moved = self.model.retract(self.state.tuple(x), self.error.tuple(e))
        return self.arrays(self.state.components(moved, self.dtype, "what retract returns"))

    def local(self, reference: list[Array], x: list[Array]) -> list[Array]:
        """The components of x ⊖ reference."""
        if self.model.local is None:
            return [a - b for a, b in zip(x, reference, strict=True)]
        error = self.model.local(self.state.tuple(reference), self.state.tuple(x))
        return self.arrays(self.error.components(error, self.dtype, "what local returns"))

    def residual(self, measured: list[Array], expected: list[Array]) -> list[Array]:
        """The components of measured − expected, of those that are ever measured."""
        if self.model.residual is None:
            return [a - b for a, b in zip(measured, expected, strict=True)]
        zero = jnp.zeros((), self.dtype)

        def whole(values: list[Array]) -> Tree:
            known = dict(zip(self.measured, values, strict=True))
            return self.observed.tuple([known.get(i, zero) for i in range(self.observed.size)])

        difference = self.model.residual(whole(measured), whole(expected))
        every = self.arrays(self.observed.components(difference, self.dtype, "what residual returns"))
        return [every[i] for i in self.measured]

    def transition(self, params: Tree, x: Sequence[Scalar], control: Tree, dt: Scalar) -> list[Scalar]:
        """The components of the state after dt."""
        after = self.model.transition(params, self.state.tuple(x), control, dt)
        return self.state.components(after, self.dtype, "what transition returns")

    def transition_noise(self, params: Tree, x: Sequence[Scalar], control: Tree, dt: Scalar) -> Entries:
        """Q."""
        noise = self.model.transition_noise(params, self.state.tuple(x), control, dt)
        return self.noise(noise, self.error, "what transition_noise returns").entries()

    def observation(self, params: Tree, x: Sequence[Scalar], control: Tree) -> list[Scalar]:
        """The components of the expected observation that are ever measured."""
        expected = self.model.observation(params, self.state.tuple(x), control)
        every = self.observed.components(expected, self.dtype, "what observation returns")
        return [every[i] for i in self.measured]

    def observation_noise(self, params: Tree, x: Sequence[Scalar], control: Tree) -> Entries:
        """R, of the components that are ever measured."""
        noise = self.model.observation_noise(params, self.state.tuple(x), control)
        every = self.noise(noise, self.observed, "what observation_noise returns").entries()
        row = {place: i for i, place in enumerate(self.measured)}
        return {(row[i], row[j]): value for (i, j), value in every.items() if i in row and j in row}

    def noise(self, noise: Covariance | Tree, layout: Layout, what: str) -> Covariance:
        """A `Covariance`, or that of a tuple of variances; raises ValueError if it is of another type than expected."""
        if not isinstance(noise, Covariance):
            if jax.tree.structure(noise) != layout.structure:
                layout.components(noise, self.dtype, f"{what}, where it is no Covariance,")  # raises
            noise = Covariance.from_variances(noise)
        try:
            return noise.expanded(layout)
        except ValueError as error:
            raise ValueError(f"{what} must have {error}") from None

    def arrays(self, components: list[Scalar]) -> list[Array]:
        """Components as arrays of the dtype."""
        return [jnp.asarray(value, self.dtype) for value in components]


def depends_on_place(g: Callable[[Array], Array], at: Float[Array, "n"]) -> bool:
    """Whether the Jacobian of g depends on g's argument, determined from the trace of the derivative."""

    def directional(x: Array, tangent: Array) -> Array:
        return jax.jvp(g, (x,), (tangent,))[1]

    closed = jax.make_jaxpr(directional)(at, at)
    return any(reached(closed.jaxpr, {closed.jaxpr.invars[0]}))


def reached(jaxpr: Any, sources: set[Any]) -> list[bool]:
    """For each output of a jaxpr, whether any of the source variables can influence it.

    Called functions are analysed too; in a loop or branch every input counts as an influence on every output.
    """
    touched = set(sources)

    def hit(variable: Any) -> bool:
        return not hasattr(variable, "val") and variable in touched  # a literal has a value

    for equation in jaxpr.eqns:
        inputs = [hit(v) for v in equation.invars]
        if not any(inputs):
            continue
        body = _called(equation)
        if body is not None:
            outputs = reached(body, {v for v, touches in zip(body.invars, inputs, strict=True) if touches})
        else:
            outputs = [True] * len(equation.outvars)
        touched |= {v for v, touches in zip(equation.outvars, outputs, strict=True) if touches}
    return [hit(v) for v in jaxpr.outvars]


def _called(equation: Any) -> Any:
    """The jaxpr that an equation calls once with the equation's inputs, or None."""
    if equation.primitive.name in ("scan", "while", "cond"):
        return None
    inner = equation.params.get("jaxpr", equation.params.get("call_jaxpr"))
    body = getattr(inner, "jaxpr", inner)
    if body is None or len(body.invars) != len(equation.invars) or len(body.outvars) != len(equation.outvars):
        return None
    return body
