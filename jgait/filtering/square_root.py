r"""The filter on a factor of the covariance, P = L Lᵀ: the most accurate form in float32.

    predict   L⁻ = tria [A L, (Ω + Q)^½]
    update    [X 0; Y L] = tria [(R + Ω)^½, H L⁻; 0, L⁻],  S = X Xᵀ,  m = m⁻ ⊕ Y X⁻¹ (y − ŷ)

tria makes an array lower triangular by a rotation of its columns, which changes no product of two rows. Nothing is
subtracted from a covariance. But a factor that is rounded at every step drifts as a covariance does, by an epsilon
a step over the filter's memory: by half a thousandth for a memory of 10 000 steps. So the factor is never computed
anew. Each step computes the change of the factor to full precision, and the carry is a sum of two numbers, of which
the second is the rounding error of the first.

A noise matrix that is not positive semidefinite has no factor: such a step is marked, even if R + H P Hᵀ is
positive.

Sources: P. Kaminski, A. Bryson, S. Schmidt, "Discrete square root filtering: a survey of current techniques",
IEEE TAC 16(6), 1971; for the sum of two numbers D. Knuth, "The Art of Computer Programming 2", section 4.2.2.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import PyTree

from jgait.filtering.dense import LOG_2PI, Correction, affine_observation, affine_transition
from jgait.filtering.factors import added, changed, covariance, reduced, rooted, squares, triangularised
from jgait.filtering.inputs import PreparedInputs
from jgait.filtering.linear_algebra import backward_substitution, forward_substitution, product
from jgait.filtering.methods import Method
from jgait.filtering.vectors import Moments, VectorModel
from jgait.types import Values

SINGULAR = 8.0
"""Fraction of a state's standard deviation below which the smoother treats its remainder as rounding [epsilons]."""


class Root(NamedTuple):
    """A belief with a factored covariance.

    Attributes:
        mean: (k,) rounded mean.
        mean_rest: rounding error of `mean` (k,); 0 on manifolds.
        factor: L (n, n), lower triangular with no negative entry on its diagonal; the covariance is L Lᵀ.
        rest: rounding error of L (n, n).
    """

    mean: PyTree
    mean_rest: PyTree
    factor: PyTree
    rest: PyTree


def root_of(mean: PyTree, factor: PyTree) -> Root:
    """The belief with rounding errors 0."""
    return Root(mean, jnp.zeros_like(mean), factor, jnp.zeros_like(factor))


class _Move(NamedTuple):
    """An affine transition: the predicted mean and its rounding error, (A − I) L, and a factor of the noise.

    `good` is False where the transition was not finite and the belief stays unchanged.
    """

    mean: PyTree
    mean_rest: PyTree
    change: PyTree
    noise: PyTree
    good: PyTree


class _RootTerms(NamedTuple):
    """One linear update of the prior: [L + change, extra] is the updated factor; other fields as in `dense._Terms`."""

    delta: PyTree
    change: PyTree
    extra: PyTree
    innovation: PyTree
    stddev: PyTree
    nis: PyTree
    log_det: PyTree
    good: PyTree


def _affine(vm: VectorModel, before: Root, control: PyTree, dt: Values, method: Method) -> _Move:
    mean, rest, factor, _ = before
    prediction = affine_transition(vm, Moments(mean, covariance(factor)), control, dt, method)
    eye = jnp.eye(factor.shape[0], dtype=factor.dtype)
    change = product(prediction.matrix - eye, factor)
    moved = squares(factor + change)
    noise, positive = rooted(prediction.noise, moved)
    # Squares that overflow would make the factor and its gradient NaN.
    good = prediction.finite & positive & jnp.all(jnp.isfinite(moved + squares(change) + squares(noise)))
    ahead = (
        (prediction.mean, rest)
        if vm.curved
        else added(prediction.mean, jnp.zeros_like(rest), product(prediction.matrix, rest))
    )
    return _Move(
        jnp.where(good, ahead[0], mean), jnp.where(good, ahead[1], rest), jnp.where(good, change, 0.0),
        jnp.where(good, noise, 0.0), good,
    )  # fmt: skip


def predicted_root(vm: VectorModel, before: Root, control: PyTree, dt: Values, method: Method) -> tuple[Root, PyTree]:
    """The belief after the interval, and False where the transition was not finite and the belief is unchanged."""
    move = _affine(vm, before, control, dt, method)
    return Root(move.mean, move.mean_rest, *changed(before.factor, before.rest, move.change, move.noise)), move.good


def corrected_root(
    vm: VectorModel, prior: Root, measured: PyTree, control: PyTree, seen: PyTree, method: Method
) -> tuple[Root, Correction]:
    """`dense.corrected` for a factored covariance."""
    factor = prior.factor
    noise = vm.observation_noise(prior.mean, control)
    first = terms = _linear_update(
        vm, prior, measured, control, seen, noise, method, jnp.zeros_like(factor[0]), covariance(factor)
    )
    good = first.good
    for _ in range(method.iterations - 1):
        around = covariance(jnp.concatenate([factor + terms.change, terms.extra], axis=1))
        terms = _linear_update(vm, prior, measured, control, seen, noise, method, terms.delta, around)
        good = good & terms.good
    delta = jnp.where(good, terms.delta, 0.0)
    change, extra = terms.change, terms.extra
    if vm.curved:
        mean, rest = vm.retract(prior.mean, delta), prior.mean_rest
        turn = vm.turn(prior.mean, delta)
        change = change + product(turn - jnp.eye(factor.shape[0], dtype=factor.dtype), factor + change)
        extra = product(turn, extra)
    else:
        mean, rest = added(prior.mean, prior.mean_rest, delta)
    good = good & jnp.all(jnp.isfinite(mean)) & jnp.all(jnp.isfinite(change)) & jnp.all(jnp.isfinite(extra))
    after = Root(
        jnp.where(good, mean, prior.mean),
        jnp.where(good, rest, prior.mean_rest),
        *changed(factor, prior.rest, jnp.where(good, change, 0.0), jnp.where(good, extra, 0.0)),
    )
    count = jnp.where(good, jnp.sum(jnp.where(seen, 1.0, 0.0).astype(measured.dtype)), 0.0)
    log_likelihood = -0.5 * (first.nis + first.log_det + count * LOG_2PI)

    def kept(value: PyTree) -> PyTree:
        return jnp.where(good, value, 0.0)

    return after, Correction(
        kept(first.innovation), kept(first.stddev), kept(log_likelihood), kept(first.nis), count, good
    )


def _linear_update(
    vm: VectorModel, prior: Root, measured: PyTree, control: PyTree, seen: PyTree, noise: PyTree, method: Method,
    at: PyTree, around: PyTree,
) -> _RootTerms:  # fmt: skip
    """Update the prior with the observation linearised at error `at` (n,) with covariance `around` (n, n)."""
    x, factor = prior.mean, prior.factor
    size = seen.shape[0]
    expected = vm.observation(vm.retract(x, at), control)

    affine = affine_observation(vm, x, control, expected, method, at, around)
    residual = vm.residual(jnp.where(seen, measured, expected), expected) - affine.value
    eye = jnp.eye(size, dtype=factor.dtype)
    innovation = jnp.where(seen, residual, 0.0)
    matrix = jnp.where(seen[:, None], affine.matrix, 0.0)
    noise = jnp.where(seen[:, None] & seen[None, :], noise + affine.spread, eye)
    finite = jnp.all(jnp.isfinite(innovation)) & jnp.all(jnp.isfinite(matrix)) & jnp.all(jnp.isfinite(noise))
    innovation = jnp.where(finite, innovation, 0.0)
    matrix, noise = jnp.where(finite, matrix, 0.0), jnp.where(finite, noise, eye)

    shown = product(matrix, factor)
    root, positive = rooted(noise, squares(shown))
    finite = finite & positive & jnp.all(jnp.isfinite(squares(shown) + squares(root)))
    shown, root = jnp.where(finite, shown, 0.0), jnp.where(finite, root, eye)
    below = jnp.concatenate([jnp.zeros_like(factor, shape=(factor.shape[0], size)), factor], axis=1)
    lower, directions = reduced(jnp.concatenate([jnp.concatenate([root, shown], axis=1), below]), size)
    total, cross = lower[:size], lower[size:]
    # The remainder of [0, L] after the projection has more columns than L, but no loss of digits where R is small.
    left = -product(cross, directions)
    good = finite & jnp.all(jnp.diagonal(total) > 0.0)
    total = _regular(total)
    gained = forward_substitution(total, innovation + product(matrix, at))
    white = forward_substitution(total, innovation)
    log_det = 2.0 * jnp.sum(jnp.log(jnp.diagonal(total)))
    return _RootTerms(
        product(cross, gained), left[:, size:], left[:, :size], innovation, jnp.sqrt(squares(total)),
        jnp.sum(white * white), log_det, good,
    )  # fmt: skip


def _regular(lower: PyTree) -> PyTree:
    """The lower triangle, with 1 where the diagonal is 0."""
    eye = jnp.eye(lower.shape[0], dtype=bool)
    return jnp.where(eye & (lower <= 0.0), 1.0, lower)


def scanned(ready: PreparedInputs, method: Method, keep: tuple[str, ...]) -> dict[str, Any]:
    """`dense.scanned` on factors: fields of `Posterior` by name, as vectors and matrices over time.

    Args:
        ready: a filter's arguments.
        method: how to linearise.
        keep: fields to return: those of `Posterior`, "factor" and "predicted_factor" (T, n, n).
    """
    vm = ready.vm
    factor, positive = rooted(ready.start.cov, jnp.zeros_like(ready.start.cov[0]))

    def body(carry: tuple[Root, PyTree], sample: PyTree) -> tuple[tuple[Root, PyTree], dict[str, PyTree]]:
        before, sound = carry
        measured, control, interval, seen = sample
        predicted, moved = predicted_root(vm, before, control, interval, method)
        after, told = corrected_root(vm, predicted, measured, control, seen, method)
        everything = {
            "mean": after.mean, "cov": covariance(after.factor), "factor": after.factor,
            "predicted_mean": predicted.mean, "predicted_cov": covariance(predicted.factor),
            "predicted_factor": predicted.factor, "innovation": told.innovation, "innovation_stddev": told.stddev,
            "log_likelihood": told.log_likelihood, "nis": told.nis, "count": told.count,
            "valid": told.valid & moved & sound,
        }  # fmt: skip
        return (after, jnp.ones_like(sound)), {name: everything[name] for name in keep}

    # An initial covariance that is not positive semidefinite marks the first sample.
    start = (root_of(ready.start.mean, factor), positive)
    return lax.scan(body, start, (ready.measured, ready.controls, ready.dt, ready.seen))[1]


def smoothed_scan(ready: PreparedInputs, kept: dict[str, Any], method: Method) -> dict[str, Any]:
    """Rauch–Tung–Striebel smoothing on factors.

        [X 0; Y Z] = tria [A L, (Ω + Q)^½; L, 0],  G = Y X⁻¹,  L_s = tria [Z, G L_s']

    Args:
        ready: a filter's arguments.
        kept: "mean" and "factor" of `scanned`.
        method: how to linearise.

    Returns:
        "mean" (T, k), "cov" and "factor" (T, n, n).
    """
    filtered = kept["mean"], kept["factor"]
    last = jax.tree.map(lambda leaf: leaf[-1], filtered)

    def body(following: PyTree, sample: PyTree) -> tuple[PyTree, PyTree]:
        (mean, factor), control, interval = sample
        smoothed = smoothed_root(ready.vm, root_of(mean, factor), following, control, interval, method)
        return smoothed, smoothed

    before = jax.tree.map(lambda leaf: leaf[:-1], filtered)
    ahead = jax.tree.map(lambda leaf: leaf[1:], (ready.controls, ready.dt))
    _, smoothed = lax.scan(body, last, (before, *ahead), reverse=True)
    mean, factor = jax.tree.map(lambda body, end: jnp.concatenate([body, end[None]]), smoothed, last)
    return {"mean": mean, "cov": jax.vmap(covariance)(factor), "factor": factor}


def smoothed_root(
    vm: VectorModel, filtered: Root, following: tuple[PyTree, PyTree], control: PyTree, dt: Values, method: Method
) -> tuple[PyTree, PyTree]:
    """Smoothed mean and factor at a sample, from the filtered belief and the smoothed mean and factor at the next."""
    x, factor = filtered.mean, filtered.factor
    mean, _, change, noise, _ = _affine(vm, filtered, control, dt, method)
    step, ahead = vm.local(mean, following[0]), following[1]
    if vm.curved:
        zero = jnp.zeros_like(ahead[0])
        ahead = product(jax.jacfwd(lambda d: vm.local(mean, vm.retract(following[0], d)))(zero), ahead)
    size = factor.shape[0]
    above = jnp.concatenate([factor + change, noise], axis=1)
    below = jnp.concatenate([factor, jnp.zeros_like(noise)], axis=1)
    lower = triangularised(jnp.concatenate([above, below]), SINGULAR)
    gain = backward_substitution(_regular(lower[:size, :size]), lower[size:, :size].T).T
    delta, far = product(gain, step), product(gain, ahead)
    good = jnp.all(jnp.isfinite(delta)) & jnp.all(jnp.isfinite(squares(far)))
    near = jnp.where(good, lower[size:, size:], factor)
    delta, far = jnp.where(good, delta, 0.0), jnp.where(good, far, 0.0)
    smoothed = triangularised(jnp.concatenate([near, far], axis=1))
    return vm.retract(x, delta), product(vm.turn(x, delta), smoothed) if vm.curved else smoothed
