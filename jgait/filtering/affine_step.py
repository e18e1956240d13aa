"""Predict and update for the methods that approximate the model over the belief, or linearise an update repeatedly.

The linearised model then depends on the covariance, so these methods have no gradient in closed form.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from jgait.filtering.component_model import ComponentModel, component_model
from jgait.filtering.lanes import applied, product, product_transposed
from jgait.filtering.local_model import Linearised, LocalModel
from jgait.filtering.methods import CKF, UKF, Affine, Method, linearise
from jgait.filtering.update import Update, kept, updated


def affine_step(
    method: Method, local: LocalModel, carry: PyTree, sample: PyTree
) -> tuple[Linearised, PyTree, Update, PyTree, Update]:
    """The affine model, P⁻, the last update, and the innovation and the update of the first iteration.

    Args:
        method: how to approximate.
        local: the model.
        carry: x⁻ and δ of the sample before, x⁻ ⊕ δ, and P.
        sample: measured (m, B), controls, dt (B,), seen (m, B).
    """
    before, delta, x, cov = carry
    measured, controls, dt, observed = sample
    x = jnp.stack(x)
    turn = jnp.stack(local.turned(list(before), list(delta), local.identity()))
    around = local.covariance_turned(list(before), list(delta), cov)
    matrix, predicted, noise = _Lanes(method, local).transition(x, around, controls, dt)
    matrix = product(matrix, turn)
    prior = product_transposed(product(matrix, cov), matrix) + noise
    at = jnp.zeros_like(delta)
    spread_of = local.observation_noise(list(predicted), controls)
    unit = jnp.eye(observed.shape[0], dtype=prior.dtype)[:, :, None]
    updates: list[tuple[PyTree, Update]] = []
    near = prior
    for _ in range(method.iterations):
        residual, rows, spread = _Lanes(method, local).observation(predicted, at, near, controls, measured, observed)
        innovation = jnp.where(observed, residual, 0.0)
        rows = jnp.where(observed[:, None], rows, 0.0)
        spread = jnp.where(observed[:, None] & observed[None], spread_of + spread, unit)
        error = innovation + applied(rows, at)
        update = updated(prior, rows, error, spread)
        updates.append((innovation, update))
        at = applied(update.gain, error)
        near = prior - product(update.gain, update.cross)
    good = functools.reduce(jnp.logical_and, [one.good for _, one in updates])
    last = kept(updates[-1][1], good)
    return Linearised(matrix, noise, predicted, rows, error, spread), prior, last, *updates[0]


class _Lanes:
    """`methods.linearise` of a model's functions, for each recording of a batch."""

    def __init__(self, method: Method, local: LocalModel) -> None:
        self.method, self.local = method, local

    def _mapped(self, function: Any, *arguments: PyTree) -> Any:
        local, shape = self.local, self.local.shape

        def one(params: list[PyTree], *values: PyTree) -> PyTree:
            cm = component_model(shape, shape.params.unflatten(params))
            return function(cm, *values)

        wide = jax.tree.map(lambda v: jnp.broadcast_to(v, (*v.shape[:-1], local.lanes)), arguments)
        axes = (local.axes, *(-1 for _ in arguments))
        return jax.vmap(one, in_axes=axes, out_axes=-1, axis_size=local.lanes)(local.params, *wide)

    def transition(self, x: PyTree, cov: PyTree, controls: PyTree, dt: PyTree) -> tuple[PyTree, PyTree, PyTree]:
        """A, x⁻ and Ω + Q; errors are about x⁻, which the mean of the sigma points moves."""
        method, shape = self.method, self.local.shape

        def one(cm: ComponentModel, x: PyTree, cov: PyTree, u: PyTree, dt: PyTree) -> tuple[PyTree, PyTree, PyTree]:
            control = shape.controls.unflatten(u)
            moved = cm.transition(list(x), control, dt)

            def g(delta: PyTree) -> PyTree:
                return _stack(cm.local(moved, cm.transition(cm.retract(list(x), list(delta)), control, dt)), cov)

            affine = linearise(method, g, jnp.zeros_like(cov[0]), cov, cm.names["transition"])
            matrix, spread = affine.matrix, affine.spread
            if cm.curved and isinstance(method, UKF | CKF):
                turn = _turn(cm, moved, affine.value)
                matrix, spread = turn @ matrix, turn @ spread @ turn.T
            return matrix, _stack(cm.retract(moved, list(affine.value)), cov), spread

        matrix, predicted, spread = self._mapped(one, x, cov, controls, dt)
        return matrix, predicted, spread + self.local.transition_noise(list(x), controls, dt)

    def observation(
        self, x: PyTree, at: PyTree, near: PyTree, controls: PyTree, measured: PyTree, observed: PyTree
    ) -> tuple[PyTree, PyTree, PyTree]:
        """The innovation, H and Ω of the observation about the error `at` with the covariance `near`."""
        method, shape = self.method, self.local.shape

        def one(cm: ComponentModel, x: PyTree, at: PyTree, near: PyTree, u: PyTree, y: PyTree, s: PyTree) -> PyTree:
            control = shape.controls.unflatten(u)
            expected = cm.observation(cm.retract(list(x), list(at)), control)

            def g(delta: PyTree) -> PyTree:
                # The difference from the prediction at `at` keeps wrapped angles small.
                return _stack(cm.residual(cm.observation(cm.retract(list(x), list(delta)), control), expected), near)

            affine: Affine = linearise(method, g, at, near, cm.names["observation"])
            shown = [jnp.where(f, v, e) for f, v, e in zip(s, y, expected, strict=True)]
            return _stack(cm.residual(shown, expected), near) - affine.value, affine.matrix, affine.spread

        return self._mapped(one, x, at, near, controls, measured, observed)


def _stack(values: list[PyTree], like: PyTree) -> PyTree:
    return jnp.stack([jnp.asarray(value, like.dtype) for value in values])


def _turn(cm: ComponentModel, x: list[PyTree], delta: PyTree) -> PyTree:
    """∂/∂δ of ((x ⊕ δ) ⊖ (x ⊕ delta)) at `delta` (n, n)."""
    if cm.error_shift is not None:
        shift = cm.error_shift
        return jax.jacfwd(lambda e: _stack(shift(x, list(delta), list(e)), delta))(jnp.zeros_like(delta))
    at = cm.retract(x, list(delta))
    return jax.jacfwd(lambda d: _stack(cm.local(at, cm.retract(x, list(d))), delta))(delta)
