r"""Predict and update on vectors and matrices: the readable reference.

Numbers that break down (an overflow, an innovation covariance that is not positive) never raise and never spread:
the belief is kept and the step is marked. What would break is replaced before it is used, and not only after, so
that gradients stay finite too.
"""

import math
from typing import Any, NamedTuple

import jax
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
    solve_covariance,
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
        finite: False where the transition was not, and the identity stands in for it.
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
    """One linear update from the prior: the error and covariance it ends at, and the innovation's statistics."""

    delta: PyTree
    cov: PyTree
    innovation: PyTree
    stddev: PyTree
    nis: PyTree
    log_det: PyTree
    good: PyTree


def _all_finite(*arrays: PyTree) -> PyTree:
    good = jnp.asarray(True)
    for array in arrays:
        good = good & jnp.all(jnp.isfinite(array))
    return good


def affine_transition(vm: VectorModel, before: Moments, control: PyTree, dt: Values, method: Method) -> Prediction:
    """The transition as an affine model of the error, about the state that the mean moves to.

    On a manifold the sigma methods' mean v moves the point that errors are taken about: A and Ω turn with it.
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
    """The belief after the interval, and the affine transition that led to it."""
    prediction = affine_transition(vm, before, control, dt, method)
    return Moments(prediction.mean, congruence(prediction.matrix, before.cov) + prediction.noise), prediction


def corrected(
    vm: VectorModel, prior: Moments, measured: PyTree, control: PyTree, seen: PyTree, method: Method
) -> tuple[Moments, Correction]:
    """The belief after a measurement (m,) of which `seen` (m,) is measured, and the statistics of the update.

    Each iteration linearises at the result of the one before, but updates the same prior. Innovation, likelihood
    and NIS are those of the first, which is linearised at the prediction.
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
    mean, cov = vm.retract(prior.mean, delta), vm.recentred(prior.mean, delta, terms.cov)
    good = good & _all_finite(mean, cov)
    after = Moments(jnp.where(good, mean, prior.mean), jnp.where(good, cov, prior.cov))
    count = jnp.where(good, jnp.sum(jnp.where(seen, 1.0, 0.0).astype(measured.dtype)), 0.0)
    log_likelihood = -0.5 * (first.nis + first.log_det + count * LOG_2PI)

    def kept(value: PyTree) -> PyTree:
        return jnp.where(good, value, 0.0)

    return after, Correction(
        kept(first.innovation), kept(first.stddev), kept(log_likelihood), kept(first.nis), count, good
    )


def _linear_update(
    vm: VectorModel, prior: Moments, measured: PyTree, control: PyTree, seen: PyTree, noise: PyTree, method: Method,
    at: PyTree, around: PyTree,
) -> _Terms:  # fmt: skip
    """Update the prior with the observation linearised at error `at` (n,) with covariance `around` (n, n)."""
    x, cov = prior
    expected = vm.observation(vm.retract(x, at), control)

    affine = affine_observation(vm, x, control, expected, method, at, around)
    residual = vm.residual(jnp.where(seen, measured, expected), expected) - affine.value
    # A masked component does not depend on the state and has the innovation 0 ± 1: it carries no information.
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
    half = forward_substitution(lower, cross)
    gain = backward_substitution(lower, half).T
    error = innovation + product(matrix, at)
    white = forward_substitution(lower, innovation)
    joseph = congruence(jnp.eye(cov.shape[0], dtype=cov.dtype) - product(gain, matrix), cov) + congruence(gain, noise)
    good = finite & positive
    variance = jnp.diagonal(total)
    stddev = jnp.sqrt(jnp.where(variance > 0.0, variance, 1.0))
    log_det = 2.0 * jnp.sum(jnp.log(jnp.diagonal(lower)))
    return _Terms(product(gain, error), joseph, innovation, stddev, jnp.sum(white * white), log_det, good)


def affine_observation(
    vm: VectorModel, x: PyTree, control: PyTree, expected: PyTree, method: Method, at: PyTree, around: PyTree
) -> Affine:
    """How what is observed differs from `expected`, that at error `at` (n,) with covariance `around` (n, n)."""

    def g(delta: PyTree) -> PyTree:
        # What the model states of errors holds at the state itself, where iterations do not stay.
        if vm.error_observation is not None and isinstance(method, KF | EKF) and method.iterations == 1:
            return vm.error_observation(x, delta, control)
        # As a difference from the prediction at `at`, so that wrapped angles stay small.
        return vm.residual(vm.observation(vm.retract(x, delta), control), expected)

    return linearise(method, g, at, around, vm.names["observation"])


def advanced(
    vm: VectorModel, before: Moments, measured: PyTree, control: PyTree, dt: Values, seen: PyTree, method: Method
) -> tuple[Moments, Moments, Correction]:
    """Predict, then update, in vectors: prediction, result, and the statistics of the update."""
    predicted, prediction = predicted_moments(vm, before, control, dt, method)
    after, correction = corrected(vm, predicted, measured, control, seen, method)
    return predicted, after, correction._replace(valid=correction.valid & prediction.finite)


def scanned(ready: PreparedInputs, method: Method, keep: tuple[str, ...]) -> dict[str, Any]:
    """The filter's one scan: fields of `Posterior` by name, as vectors and matrices over time."""

    def body(before: Moments, sample: PyTree) -> tuple[Moments, dict[str, PyTree]]:
        measured, control, interval, seen = sample
        predicted, after, told = advanced(ready.vm, before, measured, control, interval, seen, method)
        everything = {
            "mean": after.mean, "cov": after.cov, "predicted_mean": predicted.mean, "predicted_cov": predicted.cov,
            "innovation": told.innovation, "innovation_stddev": told.stddev, "log_likelihood": told.log_likelihood,
            "nis": told.nis, "count": told.count, "valid": told.valid,
        }  # fmt: skip
        return after, {name: everything[name] for name in keep}

    return lax.scan(body, ready.start, (ready.measured, ready.controls, ready.dt, ready.seen))[1]


def smoothed_scan(ready: PreparedInputs, kept: dict[str, Any], method: Method) -> tuple[PyTree, PyTree]:
    """Rauch–Tung–Striebel smoothing of what `scanned` kept as "mean" and "cov": mean (T, k), covariance (T, n, n)."""
    filtered = Moments(kept["mean"], kept["cov"])
    last = jax.tree.map(lambda leaf: leaf[-1], filtered)

    def body(following: Moments, sample: PyTree) -> tuple[Moments, Moments]:
        before, control, interval = sample
        smoothed = smoothed_moments(ready.vm, before, following, control, interval, method)
        return smoothed, smoothed

    before = jax.tree.map(lambda leaf: leaf[:-1], filtered)
    ahead = jax.tree.map(lambda leaf: leaf[1:], (ready.controls, ready.dt))
    _, smoothed = lax.scan(body, last, (before, *ahead), reverse=True)
    mean, cov = jax.tree.map(lambda body, end: jnp.concatenate([body, end[None]]), smoothed, last)
    return mean, cov


def smoothed_moments(
    vm: VectorModel, filtered: Moments, following: Moments, control: PyTree, dt: Values, method: Method
) -> Moments:
    """The smoothed belief at one sample, from its filtered one and the smoothed one at the next."""
    x, cov = filtered
    prediction = affine_transition(vm, filtered, control, dt, method)
    step = vm.local(prediction.mean, following.mean)
    ahead = following.cov
    if vm.curved:
        zero = jnp.zeros_like(ahead[0])
        turn = jax.jacfwd(lambda d: vm.local(prediction.mean, vm.retract(following.mean, d)))(zero)
        ahead = congruence(turn, ahead)
    cross = product(prediction.matrix, cov)
    predicted = congruence(prediction.matrix, cov) + prediction.noise
    gain = solve_covariance(predicted, cross).T
    delta = product(gain, step)
    left = jnp.eye(cov.shape[0], dtype=cov.dtype) - product(gain, prediction.matrix)
    smoothed = congruence(left, cov) + congruence(gain, ahead + prediction.noise)
    good = jnp.all(jnp.isfinite(delta)) & jnp.all(jnp.isfinite(smoothed))
    delta, smoothed = jnp.where(good, delta, 0.0), jnp.where(good, smoothed, cov)
    return Moments(vm.retract(x, delta), vm.recentred(x, delta, smoothed))
