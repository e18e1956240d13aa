"""A model on components: of one recording (`Shape`), and linearised at a sample of a batch (`Linear`), batch last.

Jacobians are computed by `jax.linearize`, once for all directions of the error.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree, PyTreeDef

from jgait.filtering.covariance import Covariance, Entries, Layout, Places, Scalar, Tree, placed
from jgait.filtering.methods import UKF, Method, regression
from jgait.filtering.model import Model
from jgait.filtering.step import held

type Rows = Array | Sequence[Float[Array, "B"]]
"""Components, each for all recordings: an array (component, B), or a sequence."""

type Matrices = Float[Array, "row column B"]

type Leaves = Sequence[Array]
"""Leaves of the parameters, or components of the control."""

type Interval = tuple[Leaves, Scalar]
"""The control that acts over an interval, and the length of the interval [s]."""


@dataclass(frozen=True)
class Shape:
    """What a filter knows of a model before it is compiled, and the model's functions on components."""

    model: Model
    params: PyTreeDef  #: tree structure of the parameters.
    control: Layout
    state: Layout
    error: Layout
    observed: Layout
    measured: tuple[int, ...]  #: numbers of the observation's components that are ever measured.
    dtype: np.dtype[np.floating]  #: of all floats.

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

    def turned(self, x: list[Array], delta: list[Array], error: list[Array]) -> list[Array]:
        """T e: the error about x ⊕ δ for δ + e about x, to first order in e."""
        at = self.retract(x, delta)
        return jax.jvp(lambda d: self.local(at, self.retract(x, d)), (delta,), (error,))[1]

    def turn(self, x: list[Array], delta: list[Array]) -> Array:
        """T (n, n)."""
        columns = jax.vmap(lambda e: jnp.stack(self.turned(x, delta, list(e))), out_axes=1)
        return columns(jnp.eye(len(delta), dtype=self.dtype))

    def residual(self, measured: list[Array], expected: list[Array]) -> list[Array]:
        """The components of measured − expected, of those that are ever measured."""
        if self.model.residual is None:
            return [a - b for a, b in zip(measured, expected, strict=True)]
        zeros = [jnp.zeros((), self.dtype)] * self.observed.size

        def whole(values: list[Array]) -> Tree:
            known = dict(zip(self.measured, values, strict=True))
            return self.observed.tuple([known.get(i, zero) for i, zero in enumerate(zeros)])

        difference = self.model.residual(whole(measured), whole(expected))
        every = self.arrays(self.observed.components(difference, self.dtype, "what residual returns"))
        return [every[i] for i in self.measured]

    def transition(self, params: Leaves, over: Interval, x: Sequence[Scalar]) -> list[Array]:
        """The components of the state after an interval; `params` are the leaves of the parameters."""
        p, control = self.params.unflatten(params), self.control.tuple(over[0])
        after = self.model.transition(p, self.state.tuple(x), control, over[1])
        return self.arrays(self.state.components(after, self.dtype, "what transition returns"))

    def transition_noise(self, params: Leaves, over: Interval, x: Sequence[Scalar]) -> Entries:
        """Q."""
        p, control = self.params.unflatten(params), self.control.tuple(over[0])
        noise = self.model.transition_noise(p, self.state.tuple(x), control, over[1])
        return self.noise(noise, self.error, "what transition_noise returns").entries()

    def observation(self, params: Leaves, control: Leaves, x: Sequence[Scalar]) -> list[Array]:
        """The components of the expected observation that are ever measured."""
        p = self.params.unflatten(params)
        expected = self.model.observation(p, self.state.tuple(x), self.control.tuple(control))
        every = self.arrays(self.observed.components(expected, self.dtype, "what observation returns"))
        return [every[i] for i in self.measured]

    def observation_noise(self, params: Leaves, control: Leaves, x: Sequence[Scalar]) -> Entries:
        """R, of the components that are ever measured."""
        p = self.params.unflatten(params)
        noise = self.model.observation_noise(p, self.state.tuple(x), self.control.tuple(control))
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

    def arrays(self, components: Sequence[Scalar]) -> list[Array]:
        """Components as arrays of the dtype."""
        return [jnp.asarray(value, self.dtype) for value in components]


class Linear:
    """The functions of a model, with parameters (..., B) or (..., 1), about states of a batch.

    Errors have `width` components, as many as the model's or more; those behind the model's are zero.
    """

    def __init__(self, shape: Shape, params: Sequence[Array], lanes: int, method: Method, width: int = 0) -> None:
        shared = [leaf.shape[-1] == 1 for leaf in params]
        self.shape, self.lanes, self.method, self.wide = shape, lanes, method, list(params)
        self.params = [leaf[..., 0] if same else leaf for leaf, same in zip(params, shared, strict=True)]
        self.axes = [None if same else -1 for same in shared]
        self.size = shape.error.size
        self.width = width or self.size

    @property
    def directions(self) -> list[Array]:
        """The directions of the error: for each component its part (width, B) of the identity."""
        # Made where they are used: as constants of a scan they would be read from memory at each sample.
        rows = jnp.eye(self.size, self.width, dtype=self.shape.dtype)
        return [jnp.broadcast_to(row[:, None], (self.width, self.lanes)) for row in rows]

    def over[T](self, function: Callable[..., T], *rows: Tree) -> T:
        """Outputs, batch behind, of a function of (parameters, values of one recording …)."""
        values: list[Tree] = widened(list(rows), self.lanes)
        return self._batched(function, len(rows))(self.params, *values)

    def _batched[T](self, function: Callable[..., T], rows: int) -> Callable[..., T]:
        return jax.vmap(function, in_axes=(self.axes, *[-1] * rows), out_axes=-1, axis_size=self.lanes)

    def pushed(
        self, function: Callable[..., list[Array]], values: Tree, at: Rows, columns: list[Array]
    ) -> tuple[list[Array], list[Array]]:
        """A function of (parameters, values, components) at components (B,), and its derivatives along columns (n, B).

        One linearisation for all columns: what it keeps of the function is computed once for each recording.
        """
        value, along = jax.linearize(self._about(function, values), widened(list(at), self.lanes))
        return [held(v) for v in value], jax.vmap(along)(columns)

    def _about(self, function: Callable[..., list[Array]], values: Tree) -> Callable[[list[Array]], list[Array]]:
        """A function of (parameters, values, components) of one recording as a function of the batch's components."""
        return partial(self._batched(function, 2), self.params, widened(values, self.lanes))

    def transition(
        self, x: Rows, delta: Rows, P: Matrices, control: Rows, dt: Float[Array, "B"]
    ) -> tuple[Matrices, Matrices, Float[Array, "k B"]]:
        """A, Q and x⁻ = f(x ⊕ δ); A is from errors about x, of mean δ, to errors about x⁻."""
        shape, places = self.shape, list[Places]()
        x, delta, interval = list(x), list(delta)[: self.size], (list(control), dt)

        def noise(params: list[Array], over: Interval, x: list[Array]) -> list[Array]:
            return distinct(shape.transition_noise(params, over, x), places, shape)

        if isinstance(method := self.method, UKF):

            def sigma(
                params: list[Array], over: Interval, x: list[Array], delta: list[Array], P: Array
            ) -> tuple[Array, Array, list[Array], list[Array]]:
                before, turned = shape.retract(x, delta), shape.turn(x, delta)
                after = shape.transition(params, over, before)

                def g(e: Array) -> Array:
                    return jnp.stack(shape.local(after, shape.transition(params, over, shape.retract(before, list(e)))))

                value, A, spread = regression(method, g, jnp.zeros_like(P[0]), turned @ P @ turned.T)
                turn = shape.turn(after, list(value))  # errors are about x⁻, which the value moves
                return turn @ A @ turned, turn @ spread @ turn.T, before, shape.retract(after, list(value))

            A, spread, before, after = self.over(sigma, interval, x, delta, P)
            Q = spread + self._matrix(self.over(noise, interval, before), places, self.size)
            return A, Q, jnp.stack(after)
        before, columns = self.pushed(self._near, x, delta, self.directions)
        after, along = jax.linearize(self._about(shape.transition, interval), before)
        after, columns = [held(v) for v in after], jax.vmap(along)(columns)
        if shape.curved:
            _, columns = self.pushed(lambda _, after, x: shape.local(after, x), after, after, columns)
        Q = self._matrix(self.over(noise, interval, before), places, self.width)
        return jnp.pad(jnp.stack(columns), ((0, self.width - self.size), (0, 0), (0, 0))), Q, jnp.stack(after)

    def observation(
        self, x: Rows, control: Rows, measured: Rows, visible: Rows, at: Rows | None = None, P: Matrices | None = None
    ) -> tuple[Matrices, Matrices, Float[Array, "m B"]]:
        """H, R and e = y − h(x ⊕ at) about an error `at` of the predicted state, by default 0.

        Where a component is not seen, its row of H and e are zero, and R has a 1.
        """
        shape, places = self.shape, list[Places]()
        x, control, measured, visible = map(list, (x, control, measured, visible))

        def rest(params: list[Array], u: list[Array], *given: list[Array]) -> tuple[list[Array], list[Array]]:
            x, measured, visible, expected = given
            filled = [jnp.where(s, y, e) for s, y, e in zip(visible, measured, expected, strict=True)]
            R = distinct(shape.observation_noise(params, u, x), places, shape)
            return shape.residual(filled, expected), R

        about = [jnp.zeros_like(x[0])] * self.size if at is None else list(at)[: self.size]
        shift: Array | float = 0.0
        spread: Matrices | float = 0.0
        if isinstance(method := self.method, UKF):

            def sigma(
                params: list[Array], u: list[Array], x: list[Array], at: list[Array], P: Array
            ) -> tuple[Array, list[Array], Array, Array]:
                expected = shape.observation(params, u, shape.retract(x, at))

                def g(e: Array) -> Array:
                    # The difference from the prediction at `at` keeps wrapped angles small.
                    shown = shape.observation(params, u, shape.retract(x, list(e)))
                    return jnp.stack(shape.residual(shown, expected))

                value, H, spread = regression(method, g, jnp.stack(at), P)
                return H, expected, value, spread

            H, expected, shift, spread = self.over(sigma, control, x, about, P)
        else:
            place, columns = x, self.directions
            if at is not None or shape.curved:
                place, columns = self.pushed(self._near, x, about, columns)
            expected, columns = self.pushed(shape.observation, control, x if at is None else place, columns)
            if shape.model.residual is not None:
                _, columns = self.pushed(lambda _, h, y: shape.residual(y, h), expected, expected, columns)
            H = jnp.stack(columns)
        innovation, noise = self.over(rest, control, x, measured, visible, expected)
        e, R = jnp.stack(innovation) - shift, self._matrix(noise, places, len(shape.measured)) + spread
        here = jnp.stack(visible)
        unit = jnp.eye(len(here), dtype=shape.dtype)[:, :, None]
        R = jnp.where(here[:, None] & here[None], R, unit)
        return jnp.where(here[:, None], H, 0.0), R, jnp.where(here, e, 0.0)

    def _near(self, _: list[Array], x: list[Array], d: list[Array]) -> list[Array]:
        return self.shape.retract(x, d)

    def _matrix(self, values: Sequence[Float[Array, "B"]], places: Sequence[Places], size: int) -> Matrices:
        """The symmetric matrices that have each value at its places, and zeros."""
        return placed([value[None, None] for value in values], places, (size, size, 1), self.shape.dtype)


def distinct(entries: Entries, places: list[Places], shape: Shape) -> list[Array]:
    """The distinct values of a noise matrix as arrays; `places` gets the rows and columns of each."""
    noise = Covariance.of(entries, shape.error)
    places[:] = noise.places or ()
    return shape.arrays(list(noise.values))


def widest(*trees: PyTree) -> int:
    """The number of recordings, from arrays (..., B) and (..., 1)."""
    return max(leaf.shape[-1] for leaf in jax.tree.leaves(trees))


def widened[T](tree: T, lanes: int) -> T:
    """Arrays (..., 1) or (..., B) as (..., B)."""
    return jax.tree.map(lambda v: jnp.broadcast_to(v, (*v.shape[:-1], lanes)), tree)
