"""A model and its Jacobians at one sample of a batch: arrays with the batch as last axis."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import PyTree

from jgait.filtering.component_model import ComponentModel, Shape, component_model
from jgait.filtering.components import known
from jgait.filtering.lanes import held, where


class Linearised(NamedTuple):
    """The model about the belief before an interval, and about the prediction."""

    matrix: PyTree  #: A (n, n, B), from errors about `before` to errors about `predicted`.
    noise: PyTree  #: Q (n, n, B).
    predicted: PyTree  #: the state after the interval (k, B).
    observation: PyTree  #: H (m, n, B).
    innovation: PyTree  #: measured − expected (m, B).
    observation_noise: PyTree  #: R (m, m, B).


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def placed(size: int, places: tuple[tuple[tuple[int, int], ...], ...], entries: list[PyTree]) -> PyTree:
    """The matrix (n, n, B) that has entries (B,) at their places (row, column), and zeros.

    Its derivative is put together from diagonals: in reverse mode these are slices, which cost less than sums.
    """
    total: PyTree = 0.0
    for entry, where_ in zip(entries, places, strict=True):
        pattern = np.zeros((size, size, 1))
        pattern[tuple(np.transpose(where_))] = 1.0
        total = total + jnp.asarray(pattern, entry.dtype) * entry[None, None]
    return total


@placed.defjvp
def _placed_derivative(size: int, places: PyTree, primals: PyTree, tangents: PyTree) -> tuple[PyTree, PyTree]:
    (entries,), (moved,) = primals, tangents
    at = {place: entry for entry, where_ in zip(moved, places, strict=True) for place in where_}
    zero, total = jnp.zeros_like(entries[0]), jnp.zeros((size * size, *entries[0].shape), entries[0].dtype)
    for offset in sorted({j - i for i, j in at}):
        first = max(offset, -offset * size)
        line = jnp.stack([at.get((i, i + offset), zero) for i in range(max(0, -offset), size - max(0, offset))])
        after = size * size - first - (size + 1) * (len(line) - 1) - 1
        total = total + lax.pad(line, zero[0] * 0.0, [(first, after, size), (0, 0, 0)])
    return placed(size, places, entries), total.reshape(size, size, -1)


class LocalModel:
    """The functions of a model with parameters (..., B) or (..., 1), on lists of arrays (B,), one for each component.

    Columns of errors are lists of arrays (j, B). Matrices have `width` ≥ n rows and columns of errors; those behind the
    model's own are zero.
    """

    def __init__(self, shape: Shape, params: Sequence[PyTree], lanes: int, width: int | None = None) -> None:
        self.shape, self.lanes, self.width = shape, lanes, width or shape.sizes[1]
        shared = [leaf.shape[-1] == 1 for leaf in params]
        self.params = [leaf[..., 0] if same else leaf for leaf, same in zip(params, shared, strict=True)]
        self.axes = [None if same else -1 for same in shared]
        self.curved = shape.model.local is not None

    def call(self, function: Callable[..., PyTree], *rows: PyTree, columns: PyTree = None) -> PyTree:
        """Outputs of a function of (model, values of one recording…) for each recording, and each column, if given."""
        shape = self.shape

        def one(params: list[PyTree], values: Sequence[PyTree], column: PyTree) -> PyTree:
            cm = component_model(shape, shape.params.unflatten(params))
            outputs = function(cm, *values, *(() if columns is None else (column,)))
            return [jnp.asarray(o, shape.dtype) for o in outputs]

        values = jax.tree.map(lambda v: jnp.broadcast_to(v, (*v.shape[:-1], self.lanes)), list(rows))
        mapped = jax.vmap(one, in_axes=(self.axes, -1, -1), out_axes=-1, axis_size=self.lanes)
        if columns is None:
            return mapped(self.params, values, [])
        return jax.vmap(mapped, in_axes=(None, None, 0))(self.params, values, columns)

    def identity(self) -> PyTree:
        """The identity on errors, as columns."""
        n = self.shape.sizes[1]
        eye = jnp.eye(n, self.width, dtype=self.shape.dtype)
        return [jnp.broadcast_to(row[:, None], (self.width, self.lanes)) for row in eye]

    def retracted(self, x: PyTree, delta: PyTree) -> PyTree:
        """The states x ⊕ δ."""
        if not self.curved:
            return [a + b for a, b in zip(x, delta, strict=True)]
        return self.call(lambda cm, x, d: cm.retract(x, d), x, delta)

    def between(self, x: PyTree, y: PyTree) -> PyTree:
        """The errors y ⊖ x."""
        if not self.curved:
            return [b - a for a, b in zip(x, y, strict=True)]
        return self.call(lambda cm, x, y: cm.local(x, y), x, y)

    def turned(self, x: PyTree, delta: PyTree, columns: PyTree) -> PyTree:
        """Errors about x ⊕ δ of the states x ⊕ (δ + e), for columns e near zero."""
        if not self.curved:
            return columns

        def shifted(cm: ComponentModel, x: list[PyTree], d: list[PyTree], e: list[PyTree]) -> list[PyTree]:
            if cm.error_shift is not None:
                return cm.error_shift(x, d, e)
            at = cm.retract(x, d)
            return jax.jvp(lambda d: cm.local(at, cm.retract(x, d)), (d,), (e,))[1]

        return self.call(shifted, x, delta, columns=columns)

    def carried(self, x: PyTree, delta: PyTree, columns: PyTree) -> PyTree:
        """Errors about x ⊕ δ of the states (x ⊕ e) ⊕ δ, for columns e near zero."""
        if not self.curved:
            return columns

        def shifted(cm: ComponentModel, x: list[PyTree], d: list[PyTree], e: list[PyTree]) -> list[PyTree]:
            at, zero = cm.retract(x, d), [jnp.zeros_like(v) for v in e]
            return jax.jvp(lambda e: cm.local(at, cm.retract(cm.retract(x, e), d)), (zero,), (e,))[1]

        return self.call(shifted, x, delta, columns=columns)

    def covariance_turned(self, x: PyTree, delta: PyTree, cov: PyTree) -> PyTree:
        """The covariance (n, n, B) of errors δ + e about x, mapped to errors about x ⊕ δ."""
        if not self.curved:
            return cov
        half = jnp.stack(self.turned(x, delta, list(cov)))
        return jnp.stack(self.turned(x, delta, list(jnp.swapaxes(half, 0, 1))))

    def moved(self, x: PyTree, controls: PyTree, dt: PyTree) -> PyTree:
        """The states after the interval."""
        return self.call(lambda cm, x, u, dt: cm.transition(x, self._controls(u), dt[0]), x, controls, [dt])

    def error_moved(self, x: PyTree, controls: PyTree, dt: PyTree, columns: PyTree) -> PyTree:
        """Errors after the interval, of columns before it."""

        def moved(cm: ComponentModel, x: list[PyTree], u: list[PyTree], dt: list[PyTree], e: PyTree) -> list[PyTree]:
            control = self._controls(u)
            if cm.error_transition:
                for step in cm.error_transition:
                    e = step(x, e, control, dt[0])
                return e
            if not cm.curved:
                return jax.jvp(lambda x: cm.transition(x, control, dt[0]), (x,), (e,))[1]
            mean = cm.transition(x, control, dt[0])
            zero = [jnp.zeros_like(v) for v in e]
            return jax.jvp(lambda d: cm.local(mean, cm.transition(cm.retract(x, d), control, dt[0])), (zero,), (e,))[1]

        return self.call(moved, x, controls, [dt], columns=columns)

    def transition_noise(self, x: PyTree, controls: PyTree, dt: PyTree) -> PyTree:
        """Q (n, n, B)."""
        return self._matrix(lambda cm, x, u, dt: cm.transition_noise(x, self._controls(u), dt[0]), x, controls, [dt])

    def observed(self, x: PyTree, controls: PyTree) -> PyTree:
        """The expected observation."""
        return self.call(lambda cm, x, u: cm.observation(x, self._controls(u)), x, controls)

    def error_observed(self, x: PyTree, controls: PyTree, columns: PyTree) -> PyTree:
        """Changes of the observation by columns of errors."""

        def seen(cm: ComponentModel, x: list[PyTree], u: list[PyTree], e: list[PyTree]) -> list[PyTree]:
            control = self._controls(u)
            if cm.error_observation is not None:
                return cm.error_observation(x, e, control)
            zero = [jnp.zeros_like(v) for v in e]
            expected = cm.observation(x, control)
            return jax.jvp(lambda d: cm.residual(cm.observation(cm.retract(x, d), control), expected), (zero,), (e,))[1]

        return self.call(seen, x, controls, columns=columns)

    def residual(self, measured: PyTree, expected: PyTree) -> PyTree:
        """Measured − expected."""
        if self.shape.model.residual is None:
            return [a - b for a, b in zip(measured, expected, strict=True)]
        return self.call(lambda cm, a, b: cm.residual(a, b), measured, expected)

    def observation_noise(self, x: PyTree, controls: PyTree) -> PyTree:
        """R (m, m, B)."""
        return self._matrix(lambda cm, x, u: cm.observation_noise(x, self._controls(u)), x, controls)

    def _controls(self, leaves: Sequence[PyTree]) -> PyTree:
        return self.shape.controls.unflatten(leaves)

    def _matrix(self, function: Callable[..., Any], *rows: PyTree) -> PyTree:
        """A noise matrix (n, n, B) as a sum of its distinct entries, each at its places."""
        constant, places = np.zeros((0, 0)), list[tuple[tuple[int, int], ...]]()

        def distinct(cm: ComponentModel, *values: PyTree) -> list[PyTree]:
            nonlocal constant
            matrix = function(cm, *values)
            constant = np.asarray([[entry if known(entry) else 0.0 for entry in row] for row in matrix])
            by_entry: dict[int, tuple[PyTree, list[tuple[int, int]]]] = {}
            for i, row in enumerate(matrix):
                for j, entry in enumerate(row):
                    if not known(entry):
                        by_entry.setdefault(id(entry), (entry, []))[1].append((i, j))
            places[:] = [tuple(where) for _, where in by_entry.values()]
            return [entry for entry, _ in by_entry.values()]

        entries = self.call(distinct, *rows)
        fixed = jnp.asarray(constant, self.shape.dtype)[:, :, None]
        return (
            placed(len(constant), tuple(places), entries) + fixed
            if entries
            else jnp.broadcast_to(fixed, (*constant.shape, self.lanes))
        )

    def linearised_transition(
        self, before: PyTree, delta: PyTree, x: PyTree, controls: PyTree, dt: PyTree
    ) -> tuple[PyTree, PyTree, PyTree]:
        """A, Q and the prediction."""
        x = list(held(*x))
        matrix = jnp.stack(self.error_moved(x, controls, dt, self.turned(before, delta, self.identity())))
        noise, more = self.transition_noise(x, controls, dt), (0, self.width - self.shape.sizes[1])
        if any(more):
            matrix, noise = jnp.pad(matrix, (more, (0, 0), (0, 0))), jnp.pad(noise, (more, more, (0, 0)))
        return matrix, noise, jnp.stack(self.moved(x, controls, dt))

    def linearised_observation(
        self, predicted: PyTree, controls: PyTree, measured: PyTree, observed: PyTree
    ) -> tuple[PyTree, PyTree, PyTree]:
        """H, the innovation and R about the prediction; zero and one where nothing was measured."""
        expected = self.observed(predicted, controls)
        shown = [jnp.where(s, y, e) for s, y, e in zip(observed, measured, expected, strict=True)]
        residual = self.residual(shown, expected)
        observation = self.error_observed(predicted, controls, self.identity())
        unit = jnp.eye(len(expected), dtype=self.shape.dtype)[:, :, None]
        return (
            jnp.stack([where(s, row, 0.0) for s, row in zip(observed, observation, strict=True)]),
            jnp.stack([jnp.where(s, r, 0.0) for s, r in zip(observed, residual, strict=True)]),
            jnp.where(observed[:, None] & observed[None], self.observation_noise(predicted, controls), unit),
        )
