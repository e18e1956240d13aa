r"""Filter and smoother in parallel over time: log T passes over all samples instead of T steps, for GPUs and TPUs.

Both recursions are prefix sums of an associative operation. The element of a sample describes the effect of the
sample's transition and measurement on any earlier belief: p(x_k | y_k, x_{k−1}) = N(A x_{k−1} + b, C), and the
information of y_k about x_{k−1}, η and J. Two neighbours i, j are joined to one element; with W = C_i (I + J_j C_i)⁻¹,

    A = A_j (I − W J_j) A_i,  b = A_j ((I − W J_j) b_i + W η_j) + b_j,  C = A_j W A_jᵀ + C_j
    η = A_iᵀ (I − J_j W) (η_j − J_j b_i) + η_i,  J = A_iᵀ (I − J_j W) J_j A_i + J_i

The smoother's element is p(x_k | x_{k+1}, y_1 … y_k) = N(E x_{k+1} + g, L). All are in deviations δ from the states
at which the model is linearised, which must be known first: any states for a linear model, else a trajectory, such
as the smoothed trajectory of the previous round. The operations are several times those of the sequential filter,
so on a CPU the parallel filter is slower.

Source: S. Särkkä, Á. F. García-Fernández, "Temporal parallelization of Bayesian smoothers", IEEE TAC 66(1), 2021;
for rounds S. Yaghoobi et al., "Parallel iterated extended and sigma-point Kalman smoothers", ICASSP 2021.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import PyTree

from jgait.filtering.dense import LOG_2PI, affine_transition
from jgait.filtering.inputs import PreparedInputs
from jgait.filtering.linear_algebra import (
    backward_substitution,
    cholesky,
    congruence,
    forward_substitution,
    product,
    solve_covariance,
)
from jgait.filtering.methods import EKF, KF, linearise
from jgait.filtering.vectors import Moments, VectorModel
from jgait.types import Values


class AffineElement(NamedTuple):
    """One interval and the sample at its end, in deviations δ from the states of linearisation.

    δ ← F δ + u + N(0, Q), and the residual e = H δ + N(0, R); `seen` is the number of measured components of e.
    """

    F: PyTree
    u: PyTree
    Q: PyTree
    H: PyTree
    e: PyTree
    R: PyTree
    seen: PyTree
    good: PyTree


class Element(NamedTuple):
    """The effect of consecutive samples on the belief before them; see the module."""

    A: PyTree
    b: PyTree
    C: PyTree
    eta: PyTree
    J: PyTree


class BackwardElement(NamedTuple):
    """The smoothed belief of consecutive samples given the belief after them; see the module."""

    E: PyTree
    g: PyTree
    L: PyTree


class _FilteredElement(NamedTuple):
    """The samples, and each sample's deviation and covariance before and after its measurement."""

    samples: AffineElement
    predicted: Moments
    after: Moments


def parallel_filter(ready: PreparedInputs, about: PyTree = None) -> dict[str, Any]:
    """The Kalman filter, or the extended Kalman filter linearised about a given trajectory, in parallel over time.

    A sample with a numerical failure is filtered without its transition or without its measurement, and marked. The
    measurement must have a positive variance even if the previous state is known: R + H Q Hᵀ > 0.

    Args:
        ready: a filter's arguments.
        about: (T, k) states of linearisation, at which noises that depend on the state are computed, too: entry k − 1
            for the transition into sample k (the initial mean for the first), entry k for the observation. None for
            a linear model, which is linearised at its initial mean.

    Returns:
        Fields of `Posterior` by name, as vectors and matrices over time.

    Raises:
        ValueError: if the model's states form a manifold, `about` has another shape, or `about` is None and the
            model is not linear.
    """
    about = _about(ready, about)
    return _told(about[1], _filtered(ready, *about))


def parallel_smoother(ready: PreparedInputs, about: PyTree = None) -> dict[str, Any]:
    """The Rauch–Tung–Striebel smoother of `parallel_filter`, in parallel over time.

    Args:
        ready: a filter's arguments.
        about: as in `parallel_filter`.

    Returns:
        "mean" (T, k), "cov" (T, n, n), and "filtered": the result of `parallel_filter`.

    Raises:
        ValueError: as in `parallel_filter`.
    """
    method, points = _about(ready, about)
    filtered = _filtered(ready, method, points)
    ahead = jax.tree.map(lambda leaf: leaf[1:], (filtered.samples, filtered.predicted))
    now = jax.tree.map(lambda leaf: leaf[:-1], filtered.after)
    last = jax.tree.map(lambda leaf: leaf[-1:], filtered.after)
    elements = jax.vmap(_backward_element)(now, *ahead)
    end = BackwardElement(jnp.zeros_like(last.cov), last.mean, last.cov)
    elements = jax.tree.map(lambda body, tail: jnp.concatenate([body, tail]), elements, end)
    smoothed = lax.associative_scan(jax.vmap(_behind), elements, reverse=True)
    return {"mean": points + smoothed.g, "cov": smoothed.L, "filtered": _told(points, filtered)}


def _about(ready: PreparedInputs, about: PyTree) -> tuple[KF | EKF, PyTree]:
    """The method, and the states of linearisation (T, k)."""
    vm, start = ready.vm, ready.start.mean
    if vm.curved:
        raise ValueError(
            "the parallel filter needs a model whose states are vectors, but this one has retract and local; "
            "use kalman_filter"
        )
    shape = (ready.measured.shape[0], start.shape[0])
    if about is None:
        return KF(), jnp.broadcast_to(start[None, :], shape)
    if jnp.shape(about) != shape:
        raise ValueError(f"about must be states over time of shape {shape}; got shape {jnp.shape(about)}")
    return EKF(), jnp.asarray(about, start.dtype)


def _filtered(ready: PreparedInputs, method: KF | EKF, points: PyTree) -> _FilteredElement:
    start = ready.start

    def sample(x: PyTree, at: PyTree, measured: PyTree, control: PyTree, dt: Values, seen: PyTree) -> AffineElement:
        return _affine(ready.vm, Moments(x, jnp.zeros_like(start.cov)), at, measured, control, dt, seen, method)

    origins = jnp.concatenate([start.mean[None, :], points[:-1]])
    samples = jax.vmap(sample)(origins, points, ready.measured, ready.controls, ready.dt, ready.seen)
    zero = jnp.zeros_like(start.mean)
    # The initial belief is a sample whose transition does not depend on earlier states.
    first = Element(jnp.zeros_like(start.cov), zero, start.cov, zero, jnp.zeros_like(start.cov))
    elements, positive = jax.vmap(_element)(samples)
    elements = jax.tree.map(lambda head, body: jnp.concatenate([head[None], body]), first, elements)
    scanned = lax.associative_scan(jax.vmap(_joined), elements)
    before, after = Moments(scanned.b[:-1], scanned.C[:-1]), Moments(scanned.b[1:], scanned.C[1:])
    samples = samples._replace(good=samples.good & positive)
    return _FilteredElement(samples, jax.vmap(_moved)(samples, before), after)


def _affine(
    vm: VectorModel,
    origin: Moments,
    at: PyTree,
    measured: PyTree,
    control: PyTree,
    dt: Values,
    seen: PyTree,
    method: KF | EKF,
) -> AffineElement:
    """A sample's transition linearised about `origin`, and its observation about the state `at`."""
    prediction = affine_transition(vm, origin, control, dt, method)
    expected = vm.observation(at, control)

    def g(delta: PyTree) -> PyTree:
        return vm.residual(vm.observation(at + delta, control), expected)

    affine = linearise(method, g, jnp.zeros_like(at), origin.cov, vm.names["observation"])
    e = jnp.where(seen, vm.residual(jnp.where(seen, measured, expected), expected), 0.0)
    H = jnp.where(seen[:, None], affine.matrix, 0.0)
    eye = jnp.eye(seen.shape[0], dtype=at.dtype)
    R = jnp.where(seen[:, None] & seen[None, :], vm.observation_noise(at, control), eye)
    finite = jnp.all(jnp.isfinite(e)) & jnp.all(jnp.isfinite(H)) & jnp.all(jnp.isfinite(R))
    return AffineElement(
        prediction.matrix, prediction.mean - at, prediction.noise,
        jnp.where(finite, H, 0.0), jnp.where(finite, e, 0.0), jnp.where(finite, R, eye),
        jnp.sum(jnp.where(seen, 1.0, 0.0).astype(at.dtype)), finite & prediction.finite,
    )  # fmt: skip


def _element(s: AffineElement) -> tuple[Element, PyTree]:
    """One sample as an element, and False where its measurement is left out because R + H Q Hᵀ is not positive."""
    cross = product(s.H, s.Q)
    lower, positive = cholesky(product(cross, s.H.T) + s.R)
    H, e = jnp.where(positive, s.H, 0.0), jnp.where(positive, s.e, 0.0)
    cross = jnp.where(positive, cross, 0.0)
    gain = backward_substitution(lower, forward_substitution(lower, cross)).T
    left = jnp.eye(s.Q.shape[0], dtype=s.Q.dtype) - product(gain, H)
    error = e - product(H, s.u)
    white, shown = forward_substitution(lower, error), forward_substitution(lower, product(H, s.F))
    C = congruence(left, s.Q) + congruence(gain, s.R)
    J = product(shown.T, shown)
    return Element(product(left, s.F), s.u + product(gain, error), C, product(shown.T, white), J), positive


def _joined(i: Element, j: Element) -> Element:
    """Two neighbouring elements joined to one, i before j; see the module."""
    W, told = _met(i.C, j.J)
    stay = jnp.eye(W.shape[0], dtype=W.dtype) - _times(W, j.J)
    through = _times(j.A, stay)
    return Element(
        _times(through, i.A),
        _times(through, i.b) + _times(j.A, _times(W, j.eta)) + j.b,
        _around(j.A, W) + j.C,
        _times(i.A.T, _times(stay.T, j.eta) - _times(told, i.b)) + i.eta,
        _around(i.A.T, told) + i.J,
    )


def _times(a: PyTree, b: PyTree) -> PyTree:
    """The product as one batched call, for all samples faster than the fused form of `linear_algebra`."""
    return jnp.matmul(a, b, precision=lax.Precision.HIGHEST)


def _around(a: PyTree, p: PyTree) -> PyTree:
    result = _times(_times(a, p), a.T)
    return 0.5 * (result + result.T)


@jax.custom_jvp
def _met(C: PyTree, J: PyTree) -> tuple[PyTree, PyTree]:
    """A covariance C updated with information J: the new covariance C (I + J C)⁻¹, and (I + J C)⁻¹ J, new information.

    With C = B Bᵀ both follow from (I + Bᵀ J B)⁻¹, which exists in any units. Loops keep the program small, because
    it is compiled once for every level of the scan.
    """
    B = _factor(C)
    G = _inverse(_around(B.T, J) + jnp.eye(C.shape[0], dtype=C.dtype))
    thin = _times(B, G)
    W = _around(B, G)
    stay, seen = jnp.eye(C.shape[0], dtype=C.dtype) - _times(W, J), _times(J, thin)
    return W, _around(stay.T, J) + _times(seen, seen.T)


@_met.defjvp
def _met_jvp(primals: PyTree, tangents: PyTree) -> tuple[PyTree, PyTree]:
    """In W and V = J − J W J: dW = (I − W J) dC (I − J W) − W dJ W, dV = (I − J W) dJ (I − W J) − V dC V."""
    (C, J), (dC, dJ) = primals, tangents
    W, V = _met(C, J)
    stay = jnp.eye(C.shape[0], dtype=C.dtype) - _times(W, J)
    dW = _times(_times(stay, dC), stay.T) - _times(_times(W, dJ), W)
    dV = _times(_times(stay.T, dJ), stay) - _times(_times(V, dC), V)
    return (W, V), (dW, dV)


def _factor(p: PyTree) -> PyTree:
    """A factor B (n, n) of a possibly singular covariance, p = B Bᵀ up to rounding; as `scaled_cholesky`."""
    size = p.shape[0]
    rows, floor = jnp.arange(size), size * float(jnp.finfo(p.dtype).eps)
    variance = jnp.diagonal(p)
    known = variance <= 0.0
    d = jnp.where(known, 0.0, jnp.sqrt(jnp.where(known, 1.0, variance)))
    inverse = jnp.where(known, 0.0, 1.0 / jnp.where(known, 1.0, d))
    rest = jnp.where(rows[:, None] == rows[None, :], 1.0, p * inverse[:, None] * inverse[None, :])

    def column(k: PyTree, carry: PyTree) -> PyTree:
        rest, factor = carry
        pivot = jnp.maximum(rest[k, k], floor)
        values = jnp.where(rows > k, rest[:, k], jnp.where(rows == k, pivot, 0.0)) / jnp.sqrt(pivot)
        return rest - values[:, None] * values[None, :], factor.at[:, k].set(values)

    return d[:, None] * lax.fori_loop(0, size, column, (rest, jnp.zeros_like(rest)))[1]


def _inverse(p: PyTree) -> PyTree:
    """The inverse of a symmetric matrix (n, n) with eigenvalues ≥ 1, by Gauss and Jordan's exchange steps."""

    def exchange(k: PyTree, p: PyTree) -> PyTree:
        pivot, row, column = p[k, k], p[k], p[:, k]
        p = p - column[:, None] * row[None, :] / pivot
        return p.at[k].set(row / pivot).at[:, k].set(-column / pivot).at[k, k].set(1.0 / pivot)

    result = lax.fori_loop(0, p.shape[0], exchange, p)
    return 0.5 * (result + result.T)


def _moved(s: AffineElement, before: Moments) -> Moments:
    return Moments(product(s.F, before.mean) + s.u, congruence(s.F, before.cov) + s.Q)


def _told(points: PyTree, filtered: _FilteredElement) -> dict[str, Any]:
    """Fields of `Posterior`, each sample from the sample's prediction."""
    samples, predicted, after = filtered

    def told(s: AffineElement, predicted: Moments, after: Moments) -> dict[str, Any]:
        S = congruence(s.H, predicted.cov) + s.R
        lower, positive = cholesky(S)
        sound = jnp.all(jnp.isfinite(after.mean)) & jnp.all(jnp.isfinite(after.cov))
        good = s.good & positive & sound
        innovation = s.e - product(s.H, predicted.mean)
        white = forward_substitution(lower, innovation)
        nis, count = jnp.sum(white * white), jnp.where(good, s.seen, 0.0)
        log_det = 2.0 * jnp.sum(jnp.log(jnp.diagonal(lower)))
        variance = jnp.diagonal(S)
        fields = {
            "innovation": innovation, "innovation_stddev": jnp.sqrt(jnp.where(variance > 0.0, variance, 1.0)),
            "log_likelihood": -0.5 * (nis + log_det + count * LOG_2PI), "nis": nis,
        }  # fmt: skip
        fields = {name: jnp.where(good, value, 0.0) for name, value in fields.items()}
        return fields | {"count": count, "valid": good}

    moments = {
        "mean": points + after.mean, "cov": after.cov,
        "predicted_mean": points + predicted.mean, "predicted_cov": predicted.cov,
    }  # fmt: skip
    return moments | jax.vmap(told)(samples, predicted, after)


def _backward_element(now: Moments, ahead: AffineElement, predicted: Moments) -> BackwardElement:
    """The smoother's element of a filtered belief, from the transition to the next sample and its prediction."""
    gain = solve_covariance(predicted.cov, product(ahead.F, now.cov)).T
    left = jnp.eye(now.cov.shape[0], dtype=now.cov.dtype) - product(gain, ahead.F)
    spread = congruence(left, now.cov) + congruence(gain, ahead.Q)
    return BackwardElement(gain, now.mean - product(gain, predicted.mean), spread)


def _behind(after: BackwardElement, before: BackwardElement) -> BackwardElement:
    """Two neighbouring elements joined to one, the later first, in the order of a reversed scan."""
    return BackwardElement(
        _times(before.E, after.E), _times(before.E, after.g) + before.g, _around(before.E, after.L) + before.L
    )
