"""A model of a batch of recordings, linearised at one sample: A, Q and x⁻; H, R and e. Arrays have the batch last.

Jacobians are computed by one `jax.jvp` over all directions of the error.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from jgait.filtering.methods import CKF, UKF, Method
from jgait.filtering.model import Shape
from jgait.filtering.regression import regressed_observation, regressed_transition

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
        """The directions of the error: for each component its row (width,) of the identity."""
        # Made where they are used: as constants of a scan they would be read from memory at each sample.
        return list(jnp.eye(self.size, self.width, dtype=self.shape.dtype))

    def over(self, function: Callable[..., Any], *rows: Any, columns: Any = None, out: Any = 0) -> Any:
        """Outputs of a function of (parameters, values of one recording, column) for each recording and column (n,).

        `out` has 0 for outputs that depend on the column, and None for others.
        """
        values = jax.tree.map(lambda v: jnp.broadcast_to(v, (*v.shape[:-1], self.lanes)), list(rows))
        every = jax.vmap(function, in_axes=(self.axes, -1, None), out_axes=-1, axis_size=self.lanes)
        if columns is None:
            return every(self.params, values, [])
        return jax.vmap(every, in_axes=(None, None, 0), out_axes=out)(self.params, values, columns)

    def transition(
        self, x: Rows, delta: Rows, P: Matrices, control: Rows, dt: Float[Array, "B"]
    ) -> tuple[Matrices, Matrices, Float[Array, "k B"]]:
        """A, Q and x⁻ = f(x ⊕ δ); A is from errors about x, of mean δ, to errors about x⁻."""
        shape, places = self.shape, list[Any]()

        def one(params: Any, values: Any, column: Any) -> Any:
            x, delta, u, dt = values
            p, u = shape.params.unflatten(params), shape.control.tuple(u)
            before, tangent = jax.jvp(lambda d: shape.retract(x, d), (delta,), (column,))
            before = lax.optimization_barrier(before)

            def moved(x: list[Any]) -> list[Any]:
                after = shape.model.transition(p, shape.state.tuple(x), u, dt)
                return shape.arrays(shape.state.components(after, shape.dtype, "what transition returns"))

            after, change = jax.jvp(moved, (before,), (tangent,))
            if shape.curved:
                after, change = lax.optimization_barrier((after, change))
                change = jax.jvp(lambda x: shape.local(after, x), (after,), (change,))[1]
            noise = shape.model.transition_noise(p, shape.state.tuple(before), u, dt)
            entries = shape.noise(noise, shape.error, "what transition_noise returns")
            return after, change, distinct(entries, places=places, shape=shape)

        if isinstance(self.method, UKF | CKF):
            sigma = partial(regressed_transition, shape, self.method, partial(distinct, places=places, shape=shape))
            A, spread, after, noise = self.over(sigma, list(x), list(delta), P, list(control), dt)
            return A, spread + placed(noise, places, self.size), jnp.stack(after)
        after, rows, noise = self.over(
            one, list(x), list(delta)[: self.size], list(control), dt, columns=self.directions, out=(None, 0, None)
        )
        A = jnp.pad(jnp.stack(rows), ((0, self.width - self.size), (0, 0), (0, 0)))
        return A, placed(noise, places, self.width), jnp.stack(after)

    def observation(
        self, x: Rows, control: Rows, measured: Rows, seen: Rows, at: Any = None, P: Any = None
    ) -> tuple[Matrices, Matrices, Float[Array, "m B"]]:
        """H, R and e = y − h(x ⊕ at) about an error `at` of the predicted state, by default 0.

        Where a component is not seen, its row of H and e are zero, and R has a 1.
        """
        shape, places = self.shape, list[Any]()

        def one(params: Any, values: Any, column: Any) -> Any:
            x, at, u, measured, seen = values
            p, u = shape.params.unflatten(params), shape.control.tuple(u)
            place, tangent = x, column
            if at or shape.curved:
                zero = at or [jnp.zeros_like(v) for v in column]
                place, tangent = jax.jvp(lambda d: shape.retract(x, d), (zero,), (column,))
                place, tangent = lax.optimization_barrier((place if at else x, tangent))

            def shown(x: list[Any]) -> list[Any]:
                told = shape.model.observation(p, shape.state.tuple(x), u)
                every = shape.arrays(shape.observed.components(told, shape.dtype, "what observation returns"))
                return [every[i] for i in shape.measured]

            expected, change = jax.jvp(shown, (place,), (tangent,))
            if shape.model.residual is not None:
                change = jax.jvp(lambda y: shape.residual(y, expected), (expected,), (change,))[1]
            visible = [jnp.where(s, y, e) for s, y, e in zip(seen, measured, expected, strict=True)]
            noise = shape.model.observation_noise(p, shape.state.tuple(x), u)
            entries = shape.noise(noise, shape.observed, "what observation_noise returns")
            row = {place: i for i, place in enumerate(shape.measured)}
            known = {(row[i], row[j]): v for (i, j), v in entries.items() if i in row and j in row}
            return shape.residual(visible, expected), change, distinct(known, places=places, shape=shape)

        values = list(x), [] if at is None else list(at)[: self.size], list(control), list(measured), list(seen)
        innovation, rows, noise = self.over(one, *values, columns=self.directions, out=(None, 0, None))
        H, e, R = jnp.stack(rows), jnp.stack(innovation), placed(noise, places, len(shape.measured))
        if isinstance(self.method, UKF | CKF):
            H, e, spread = self.over(partial(regressed_observation, shape, self.method), *values, P)
            R = R + spread
        here = jnp.stack(list(seen))
        unit = jnp.eye(len(here), dtype=shape.dtype)[:, :, None]
        R = jnp.where(here[:, None] & here[None], R, unit)
        return jnp.where(here[:, None], H, 0.0), R, jnp.where(here, e, 0.0)


def distinct(entries: dict[tuple[int, int], Any], *, places: list[Any], shape: Shape) -> list[Any]:
    """The distinct values of a noise matrix as arrays; `places` gets the rows and columns of each."""
    found: dict[Any, tuple[Any, list[tuple[int, int]]]] = {}
    for place, value in entries.items():
        key = ("number", value) if isinstance(value, float | int) else id(value)
        found.setdefault(key, (value, []))[1].append(place)
    places[:] = [where for _, where in found.values()]
    return shape.arrays([value for value, _ in found.values()])


def placed(values: Sequence[Float[Array, "B"]], places: Sequence[Any], size: int) -> Matrices:
    """The symmetric matrices that have each value at its places, and zeros."""
    total: Any = 0.0
    for value, where_ in zip(values, places, strict=True):
        pattern = np.zeros((size, size, 1), bool)
        rows, columns = np.transpose(where_)
        pattern[rows, columns] = pattern[columns, rows] = True
        total = jnp.where(pattern, value[None, None], total)
    return total
