r"""Predict and update on vectors and matrices: the reference implementation, written to be read.

Numerical failures (an overflow, an innovation covariance that is not positive) do not raise, and do not reach other
samples: the belief is kept and the step is marked. Values that would fail are replaced before they are used, and
not only afterwards, so that gradients stay finite too.
"""

import math
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import PyTree

from jgait.filtering.inputs import PreparedInputs
from jgait.filtering.linear_algebra import (
    backward_substitution,
    cholesky,
    congruence,
    forward_substitution,
    product,
)
from jgait.filtering.methods import CKF, EKF, KF, UKF, Affine, Method, linearise
from jgait.filtering.vectors import Moments, VectorModel
from jgait.types import Values

LOG_2PI = math.log(2.0 * math.pi)


class Prediction(NamedTuple):
    """An affine transition: the error δ about x moves to A δ + e about `mean`, e ~ N(0, `noise`).

    Attributes:
        mean: the predicted state (k,).
        matrix: A (n, n).
        noise: Ω + Q (n, n).
        finite: False where the transition was not finite and the identity replaces it.
    """

    mean: PyTree
    matrix: PyTree
    noise: PyTree
    finite: PyTree


class Correction(NamedTuple):
    """Statistics of an update; see `jgait.filtering.Updated`."""

    innovation: PyTree
    stddev: PyTree
    log_likelihood: PyTree
    nis: PyTree
    count: PyTree
    valid: PyTree


class _Terms(NamedTuple):
    """One linear update of the prior: the updated error and covariance, and the innovation's statistics."""

    delta: PyTree
    cov: PyTree
    innovation: PyTree
    stddev: PyTree
    nis: PyTree
    log_det: PyTree
    good: PyTree
    adjoint: "Adjoint"


class Adjoint(NamedTuple):
    """The terms of an update for the backward pass over earlier samples: λ ← Cᵀ λ − g, Λ ← Cᵀ Λ C + N.

    Attributes:
        left: C (n, n), which maps errors before the update to errors about the updated state.
        gradient: g = Hᵀ S⁻¹ (y − ŷ) (n,).
        information: N = Hᵀ S⁻¹ H (n, n).
    """

    left: PyTree
    gradient: PyTree
    information: PyTree


def _all_finite(*arrays: PyTree) -> PyTree:
    good = jnp.asarray(True)
    for array in arrays:
        good = good & jnp.all(jnp.isfinite(array))
    return good


def affine_transition(vm: VectorModel, before: Moments, control: PyTree, dt: Values, method: Method) -> Prediction:
    """The transition as an affine model of the error about the predicted state.

    On a manifold the sigma methods' mean v moves the reference state of the errors: A and Ω are transformed to it.
    """
    x, cov = before
    moved = vm.transition(x, control, dt)

    def g(delta: PyTree) -> PyTree:
        if vm.error_transition is not None and isinstance(method, KF | EKF):
            return vm.error_transition(x, delta, control, dt)
        return vm.local(moved, vm.transition(vm.retract(x, delta), control, dt))

    affine = linearise(method, g, jnp.zeros_like(cov[0]), cov, vm.names["transition"])
    mean, matrix, spread = vm.retract(moved, affine.value), affine.matrix, affine.spread
    if vm.curved and isinstance(method, UKF | CKF):
        turn = vm.turn(moved, affine.value)
        matrix, spread = product(turn, matrix), congruence(turn, spread)
    noise = spread + vm.transition_noise(x, control, dt)
    finite = _all_finite(mean, matrix, noise)
    identity = jnp.eye(cov.shape[0], dtype=cov.dtype)
    return Prediction(
        jnp.where(finite, mean, x), jnp.where(finite, matrix, identity), jnp.where(finite, noise, 0.0), finite
    )


def predicted_moments(
    vm: VectorModel, before: Moments, control: PyTree, dt: Values, method: Method
) -> tuple[Moments, Prediction]:
    """The belief after the interval, and the affine transition."""
    prediction = affine_transition(vm, before, control, dt, method)
    return Moments(prediction.mean, congruence(prediction.matrix, before.cov) + prediction.noise), prediction


def corrected(
    vm: VectorModel, prior: Moments, measured: PyTree, control: PyTree, seen: PyTree, method: Method
) -> tuple[Moments, Correction]:
    """The belief after a measurement (m,) with mask `seen` (m,), and the statistics of the update."""
    return _corrected(vm, prior, measured, control, seen, method)[:2]


def _corrected(
    vm: VectorModel, prior: Moments, measured: PyTree, control: PyTree, seen: PyTree, method: Method
) -> tuple[Moments, Correction, Adjoint]:
    """The belief after a measurement, the statistics of the update, and its `Adjoint` for the smoother.

    Each iteration linearises at the result of the previous iteration, but updates the same prior. Innovation,
    likelihood and NIS are those of the first iteration, which is linearised at the prediction.
    """
    noise = vm.observation_noise(prior.mean, control)
    first = terms = _linear_update(
        vm, prior, measured, control, seen, noise, method, jnp.zeros_like(prior.cov[0]), prior.cov
    )
    good = first.good
    for _ in range(method.iterations - 1):
        terms = _linear_update(vm, prior, measured, control, seen, noise, method, terms.delta, terms.cov)
        good = good & terms.good
    delta = jnp.where(good, terms.delta, 0.0)
    mean, cov, left = vm.retract(prior.mean, delta), terms.cov, terms.adjoint.left
    if vm.curved:
        turn = vm.turn(prior.mean, delta)
        cov, left = congruence(turn, cov), product(turn, left)
    good = good & _all_finite(mean, cov)
    after = Moments(jnp.where(good, mean, prior.mean), jnp.where(good, cov, prior.cov))
    count = jnp.where(good, jnp.sum(jnp.where(seen, 1.0, 0.0).astype(measured.dtype)), 0.0)
    log_likelihood = -0.5 * (first.nis + first.log_det + count * LOG_2PI)

    def kept(value: PyTree) -> PyTree:
        return jnp.where(good, value, 0.0)

    correction = Correction(
        kept(first.innovation), kept(first.stddev), kept(log_likelihood), kept(first.nis), count, good
    )
    identity = jnp.eye(prior.cov.shape[0], dtype=prior.cov.dtype)
    back = Adjoint(jnp.where(good, left, identity), kept(terms.adjoint.gradient), kept(terms.adjoint.information))
    return after, correction, back


def _linear_update(
    vm: VectorModel, prior: Moments, measured: PyTree, control: PyTree, seen: PyTree, noise: PyTree, method: Method,
    at: PyTree, around: PyTree,
) -> _Terms:  # fmt: skip
    """Update the prior with the observation linearised at error `at` (n,) with covariance `around` (n, n)."""
    x, cov = prior
    expected = vm.observation(vm.retract(x, at), control)

    affine = affine_observation(vm, x, control, expected, method, at, around)
    residual = vm.residual(jnp.where(seen, measured, expected), expected) - affine.value
    # A masked component has a zero row in H and the innovation 0 ± 1, so the sample has no information about it.
    innovation = jnp.where(seen, residual, 0.0)
    matrix = jnp.where(seen[:, None], affine.matrix, 0.0)
    eye = jnp.eye(seen.shape[0], dtype=cov.dtype)
    noise = jnp.where(seen[:, None] & seen[None, :], noise + affine.spread, eye)
    finite = _all_finite(innovation, matrix, noise)
    innovation = jnp.where(finite, innovation, 0.0)
    matrix, noise = jnp.where(finite, matrix, 0.0), jnp.where(finite, noise, eye)

    cross = product(matrix, cov)
    total = product(cross, matrix.T) + noise
    lower, positive = cholesky(total)
    n = cov.shape[0]
    error = innovation + product(matrix, at)
    columns = jnp.concatenate([matrix, cross, error[:, None], innovation[:, None]], axis=1)
    whitened = forward_substitution(lower, columns)
    shown, half, white = whitened[:, :n], whitened[:, n : 2 * n], whitened[:, -1]
    gain = backward_substitution(lower, half).T
    left = jnp.eye(n, dtype=cov.dtype) - product(gain, matrix)
    joseph = congruence(left, cov) + congruence(gain, noise)
    adjoint = Adjoint(left, product(shown.T, whitened[:, -2]), product(shown.T, shown))
    good = finite & positive
    variance = jnp.diagonal(total)
    stddev = jnp.sqrt(jnp.where(variance > 0.0, variance, 1.0))
    log_det = 2.0 * jnp.sum(jnp.log(jnp.diagonal(lower)))
    return _Terms(product(gain, error), joseph, innovation, stddev, jnp.sum(white * white), log_det, good, adjoint)


def affine_observation(
    vm: VectorModel, x: PyTree, control: PyTree, expected: PyTree, method: Method, at: PyTree, around: PyTree
) -> Affine:
    """The observation minus `expected` as an affine function about error `at` (n,) with covariance `around` (n, n)."""

    def g(delta: PyTree) -> PyTree:
        # The model's error functions are valid at the reference state only; later iterations linearise elsewhere.
        if vm.error_observation is not None and isinstance(method, KF | EKF) and method.iterations == 1:
            return vm.error_observation(x, delta, control)
        # The difference from the prediction at `at` keeps wrapped angles small.
        return vm.residual(vm.observation(vm.retract(x, delta), control), expected)

    return linearise(method, g, at, around, vm.names["observation"])


def advanced(
    vm: VectorModel, before: Moments, measured: PyTree, control: PyTree, dt: Values, seen: PyTree, method: Method
) -> tuple[Moments, Moments, Correction]:
    """Predict, then update, in vectors: prediction, result, and the statistics of the update."""
    return _advanced(vm, before, measured, control, dt, seen, method)[:3]


def _advanced(
    vm: VectorModel, before: Moments, measured: PyTree, control: PyTree, dt: Values, seen: PyTree, method: Method
) -> tuple[Moments, Moments, Correction, PyTree, Adjoint]:
    """As `advanced`, with the transition's matrix (n, n) and the update's `Adjoint`."""
    predicted, prediction = predicted_moments(vm, before, control, dt, method)
    after, correction, back = _corrected(vm, predicted, measured, control, seen, method)
    valid = correction.valid & prediction.finite
    return predicted, after, correction._replace(valid=valid), prediction.matrix, back


def scanned(ready: PreparedInputs, method: Method, keep: tuple[str, ...]) -> dict[str, Any]:
    """The filter's one scan: fields of `Posterior` by name, as vectors and matrices over time."""

    def body(before: Moments, sample: PyTree) -> tuple[Moments, dict[str, PyTree]]:
        measured, control, interval, seen = sample
        predicted, after, told, matrix, back = _advanced(ready.vm, before, measured, control, interval, seen, method)
        everything = {
            "mean": after.mean, "cov": after.cov, "predicted_mean": predicted.mean, "predicted_cov": predicted.cov,
            "innovation": told.innovation, "innovation_stddev": told.stddev, "log_likelihood": told.log_likelihood,
            "nis": told.nis, "count": told.count, "valid": told.valid, "transition": matrix, **back._asdict(),
        }  # fmt: skip
        return after, {name: everything[name] for name in keep}

    return lax.scan(body, ready.start, (ready.measured, ready.controls, ready.dt, ready.seen))[1]


SMOOTHED_FROM = ("mean", "cov", "transition", *Adjoint._fields)
"""The fields of `scanned` that `smoothed_scan` needs."""


def smoothed_scan(ready: PreparedInputs, kept: dict[str, Any]) -> tuple[PyTree, PyTree]:
    """Modified Bryson–Frazier smoothing of the fields from `scanned`: mean (T, k), covariance (T, n, n)."""

    def body(carry: tuple[PyTree, PyTree], sample: PyTree) -> tuple[PyTree, Moments]:
        vector, matrix = carry
        x, cov, transition, left, gradient, information = sample
        smoothed = _adjusted(ready.vm, Moments(x, cov), vector, matrix)
        vector = product(left.T, vector) - gradient
        matrix = congruence(left.T, matrix) + information
        return (product(transition.T, vector), congruence(transition.T, matrix)), smoothed

    none = jnp.zeros_like(kept["cov"][0])
    return lax.scan(body, (none[0], none), tuple(kept[name] for name in SMOOTHED_FROM), reverse=True)[1]


def _adjusted(vm: VectorModel, filtered: Moments, vector: PyTree, matrix: PyTree) -> Moments:
    """The smoothed belief at a sample: x ⊕ (−P λ), P − P Λ P; the filtered belief where that is not finite."""
    x, cov = filtered
    delta, smoothed = -product(cov, vector), cov - congruence(cov, matrix)
    good = jnp.all(jnp.isfinite(delta)) & jnp.all(jnp.isfinite(smoothed))
    delta, smoothed = jnp.where(good, delta, 0.0), jnp.where(good, smoothed, cov)
    return Moments(vm.retract(x, delta), vm.recentred(x, delta, smoothed))
