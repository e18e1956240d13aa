"""Predict and update for the methods that approximate the model over the belief, or linearise an update repeatedly.

The linearised model then depends on the covariance, so these methods have no gradient in closed form.
"""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from jgait.filtering.component_model import ComponentModel
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
    matrix, predicted, noise = _transition(method, local, x, around, controls, dt)
    matrix = product(matrix, turn)
    prior = product_transposed(product(matrix, cov), matrix) + noise
    at = jnp.zeros_like(delta)
    spread_of = local.observation_noise(list(predicted), controls)
    unit = jnp.eye(observed.shape[0], dtype=prior.dtype)[:, :, None]
    updates: list[tuple[PyTree, Update]] = []
    near = prior
    for _ in range(method.iterations):
        residual, rows, spread = _observation(method, local, predicted, at, near, controls, measured, observed)
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


def _transition(
    method: Method, local: LocalModel, x: PyTree, cov: PyTree, controls: PyTree, dt: PyTree
) -> tuple[PyTree, PyTree, PyTree]:
    """A, x⁻ and Ω + Q; errors are about x⁻, which the mean of the sigma points moves."""

    def one(cm: ComponentModel, x: PyTree, cov: PyTree, u: PyTree, dt: PyTree) -> tuple[PyTree, PyTree, PyTree]:
        control = local.shape.controls.unflatten(u)
        moved = cm.transition(list(x), control, dt)

        def g(delta: PyTree) -> PyTree:
            return _stack(cm.local(moved, cm.transition(cm.retract(list(x), list(delta)), control, dt)), cov)

        affine = linearise(method, g, jnp.zeros_like(cov[0]), cov)
        matrix, spread = affine.matrix, affine.spread
        if cm.curved and isinstance(method, UKF | CKF):
            turn = _turn(cm, moved, affine.value)
            matrix, spread = turn @ matrix, turn @ spread @ turn.T
        return matrix, _stack(cm.retract(moved, list(affine.value)), cov), spread

    matrix, predicted, spread = local.call(one, x, cov, controls, dt)
    return matrix, predicted, spread + local.transition_noise(list(x), controls, dt)


def _observation(
    method: Method, local: LocalModel, x: PyTree, at: PyTree, near: PyTree, controls: PyTree, measured: PyTree,
    observed: PyTree,
) -> tuple[PyTree, PyTree, PyTree]:  # fmt: skip
    """The innovation, H and Ω of the observation about the error `at` with the covariance `near`."""

    def one(cm: ComponentModel, x: PyTree, at: PyTree, near: PyTree, u: PyTree, y: PyTree, s: PyTree) -> PyTree:
        control = local.shape.controls.unflatten(u)
        expected = cm.observation(cm.retract(list(x), list(at)), control)

        def g(delta: PyTree) -> PyTree:
            # The difference from the prediction at `at` keeps wrapped angles small.
            return _stack(cm.residual(cm.observation(cm.retract(list(x), list(delta)), control), expected), near)

        affine: Affine = linearise(method, g, at, near)
        shown = [jnp.where(f, v, e) for f, v, e in zip(s, y, expected, strict=True)]
        return _stack(cm.residual(shown, expected), near) - affine.value, affine.matrix, affine.spread

    return local.call(one, x, at, near, controls, measured, observed)


def _stack(values: list[PyTree], like: PyTree) -> PyTree:
    return jnp.stack([jnp.asarray(value, like.dtype) for value in values])


def _turn(cm: ComponentModel, x: list[PyTree], delta: PyTree) -> PyTree:
    """∂/∂δ of ((x ⊕ δ) ⊖ (x ⊕ delta)) at `delta` (n, n)."""
    if cm.error_shift is not None:
        shift = cm.error_shift
        return jax.jacfwd(lambda e: _stack(shift(x, list(delta), list(e)), delta))(jnp.zeros_like(delta))
    at = cm.retract(x, list(delta))
    return jax.jacfwd(lambda d: _stack(cm.local(at, cm.retract(x, list(d))), delta))(delta)
