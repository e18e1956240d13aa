"""A model of a batch of recordings, linearised at one sample: A, Q and x⁻; H, R and e. Arrays have the batch last.

Jacobians are computed by `jax.linearize`, once for all directions of the error.
"""

from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jgait.filtering.covariance import Covariance, Entries, Places, Tree, placed
from jgait.filtering.methods import CKF, UKF, Method
from jgait.filtering.model import Shape
from jgait.filtering.regression import regressed_observation, regressed_transition
from jgait.filtering.step import held

type Rows = Array | Sequence[Float[Array, "B"]]
"""Components, each for all recordings: an array (component, B), or a sequence."""

type Matrices = Float[Array, "row column B"]


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
        values: list[Tree] = self._wide(list(rows))
        return self._batched(function, len(rows))(self.params, *values)

    def _batched[T](self, function: Callable[..., T], rows: int) -> Callable[..., T]:
        return jax.vmap(function, in_axes=(self.axes, *[-1] * rows), out_axes=-1, axis_size=self.lanes)

    def _wide[T](self, rows: T) -> T:
        return jax.tree.map(lambda v: jnp.broadcast_to(v, (*v.shape[:-1], self.lanes)), rows)

    def pushed(
        self, function: Callable[..., list[Array]], values: Tree, at: Rows, columns: list[Array]
    ) -> tuple[list[Array], list[Array]]:
        """A function of (parameters, values, components) at components (B,), and its derivatives along columns (n, B).

        One linearisation for all columns: what it keeps of the function is computed once for each recording.
        """
        value, along = jax.linearize(self.about(function, values), self._wide(list(at)))
        return [held(v) for v in value], jax.vmap(along)(columns)

    def about(self, function: Callable[..., list[Array]], values: Tree) -> Callable[[list[Array]], list[Array]]:
        """A function of (parameters, values, components) of one recording as a function of the batch's components."""
        return partial(self._batched(function, 2), self.params, self._wide(values))

    def transition(
        self, x: Rows, delta: Rows, P: Matrices, control: Rows, dt: Float[Array, "B"]
    ) -> tuple[Matrices, Matrices, Float[Array, "k B"]]:
        """A, Q and x⁻ = f(x ⊕ δ); A is from errors about x, of mean δ, to errors about x⁻."""
        shape, places = self.shape, list[Places]()
        x, delta, control = list(x), list(delta)[: self.size], list(control)

        def moved(params: list[Array], given: tuple[list[Array], Array], x: list[Array]) -> list[Array]:
            p, u = self.unpacked(params, given[0])
            return shape.arrays(shape.transition(p, x, u, given[1]))

        def apart(_: Tree, after: list[Array], x: list[Array]) -> list[Array]:
            return shape.local(after, x)

        def noise(params: list[Array], x: list[Array], u: list[Array], dt: Array) -> list[Array]:
            p, control = self.unpacked(params, u)
            return distinct(shape.transition_noise(p, x, control, dt), places, shape)

        if isinstance(method := self.method, UKF | CKF):

            def sigma(
                params: list[Array], x: list[Array], delta: list[Array], P: Array, u: list[Array], dt: Array
            ) -> tuple[Array, Array, list[Array], list[Array]]:
                return regressed_transition(shape, method, partial(moved, params, (u, dt)), x, delta, P)

            A, spread, before, after = self.over(sigma, x, delta, P, control, dt)
            return (
                A,
                spread + self.matrix(self.over(noise, before, control, dt), places, self.size),
                jnp.stack(after),
            )
        before, columns = self.pushed(self.near, x, delta, self.directions)
        after, derivative = jax.linearize(self.about(moved, (control, dt)), before)
        after, columns = [held(v) for v in after], jax.vmap(derivative)(columns)
        if shape.curved:
            _, columns = self.pushed(apart, after, after, columns)
        Q = self.matrix(self.over(noise, before, control, dt), places, self.width)
        return jnp.pad(jnp.stack(columns), ((0, self.width - self.size), (0, 0), (0, 0))), Q, jnp.stack(after)

    def matrix(self, values: Sequence[Float[Array, "B"]], places: Sequence[Places], size: int) -> Matrices:
        """The symmetric matrices that have each value at its places, and zeros."""
        return placed([value[None, None] for value in values], places, (size, size, 1), self.shape.dtype)

    def near(self, _: list[Array], x: list[Array], d: list[Array]) -> list[Array]:
        """The components of x ⊕ d, as `pushed` takes a function."""
        return self.shape.retract(x, d)

    def unpacked(self, params: list[Array], control: list[Array]) -> tuple[Tree, Tree]:
        """Parameters and control as the model's functions take them."""
        return self.shape.params.unflatten(params), self.shape.control.tuple(control)

    def observation(
        self, x: Rows, control: Rows, measured: Rows, visible: Rows, at: Rows | None = None, P: Matrices | None = None
    ) -> tuple[Matrices, Matrices, Float[Array, "m B"]]:
        """H, R and e = y − h(x ⊕ at) about an error `at` of the predicted state, by default 0.

        Where a component is not seen, its row of H and e are zero, and R has a 1.
        """
        shape, places = self.shape, list[Places]()
        x, control, measured, visible = map(list, (x, control, measured, visible))

        def shown(params: list[Array], u: list[Array], x: list[Array]) -> list[Array]:
            p, control = self.unpacked(params, u)
            return shape.arrays(shape.observation(p, x, control))

        def apart(_: Tree, expected: list[Array], y: list[Array]) -> list[Array]:
            return shape.residual(y, expected)

        def rest(
            params: list[Array], x: list[Array], u: list[Array], measured: list[Array], visible: list[Array],
            expected: list[Array],
        ) -> tuple[list[Array], list[Array]]:  # fmt: skip
            filled = [jnp.where(s, y, e) for s, y, e in zip(visible, measured, expected, strict=True)]
            p, control = self.unpacked(params, u)
            R = distinct(shape.observation_noise(p, x, control), places, shape)
            return shape.residual(filled, expected), R

        about = [jnp.zeros_like(x[0])] * self.size if at is None else list(at)[: self.size]
        shift: Array | float = 0.0
        spread: Matrices | float = 0.0
        if isinstance(method := self.method, UKF | CKF):

            def sigma(
                params: list[Array], x: list[Array], at: list[Array], P: Array, u: list[Array]
            ) -> tuple[Array, list[Array], Array, Array]:
                return regressed_observation(shape, method, partial(shown, params, u), x, at, P)

            H, expected, shift, spread = self.over(sigma, x, about, P, control)
        else:
            place, columns = x, self.directions
            if at is not None or shape.curved:
                place, columns = self.pushed(self.near, x, about, columns)
            expected, columns = self.pushed(shown, control, x if at is None else place, columns)
            if shape.model.residual is not None:
                _, columns = self.pushed(apart, expected, expected, columns)
            H = jnp.stack(columns)
        innovation, noise = self.over(rest, x, control, measured, visible, expected)
        e, R = jnp.stack(innovation) - shift, self.matrix(noise, places, len(shape.measured)) + spread
        here = jnp.stack(visible)
        unit = jnp.eye(len(here), dtype=shape.dtype)[:, :, None]
        R = jnp.where(here[:, None] & here[None], R, unit)
        return jnp.where(here[:, None], H, 0.0), R, jnp.where(here, e, 0.0)


def distinct(entries: Entries, places: list[Places], shape: Shape) -> list[Array]:
    """The distinct values of a noise matrix as arrays; `places` gets the rows and columns of each."""
    noise = Covariance.of(entries, shape.error)
    places[:] = noise.places or ()
    return shape.arrays(list(noise.values))
