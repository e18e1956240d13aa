r"""Rauch–Tung–Striebel smoothing: a backward scan over the filtered beliefs.

    G = P Aᵀ (P⁻)⁻¹,  m_s = m ⊕ G (m_s' ⊖ m⁻),  P_s = (I − G A) P (I − G A)ᵀ + G (P_s' + Ω + Q) Gᵀ

A prime marks the next sample. The transition is linearised again at each filtered belief, so nothing but the
filtered beliefs is stored; the form of P_s keeps it symmetric and positive. The solve by P⁻ is scaled by its
diagonal, which keeps float32 usable where metres and radians per second meet. On a manifold P_s' is first turned
from errors about m_s' to errors about m⁻, and P_s at last to errors about m_s.

Source: H. Rauch, F. Tung, C. Striebel (1965), AIAA Journal 3(8); S. Särkkä (2013), chapters 8 to 10.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jgait.filtering import checks
from jgait.filtering.covariance import Covariance
from jgait.filtering.dense import affine_transition
from jgait.filtering.kalman import FIELDS, KEEP, Posterior, posterior, prepared, scanned
from jgait.filtering.linear_algebra import congruence, product, solve_covariance
from jgait.filtering.linearise import EKF, Method
from jgait.filtering.model import Belief, Model
from jgait.filtering.vectors import Moments, VectorModel, unpack


class Smoothed(NamedTuple):
    """A smoothed recording.

    Attributes:
        mean: smoothed mean in the state's type, time axis in front.
        cov: its covariance.
        filtered: the filter's `Posterior`.
    """

    mean: Any
    cov: Covariance
    filtered: Posterior


def kalman_smoother(
    model: Model, params: Any, observations: Any, *, controls: Any = None, dt: Any = 1.0, mask: Any = None,
    method: Method = EKF(), initial: Belief | None = None, keep: tuple[str, ...] = KEEP,
) -> Smoothed:  # fmt: skip
    """Filter forward, then smooth backward: every sample is judged by all of the recording.

    Args:
        model: state-space model; functions at module level, since the model is a static argument of `jax.jit`.
        params: any pytree, passed on to the model's functions; differentiable.
        observations: observation tuple of (T,) arrays; what the mask hides may be any finite number.
        controls: control tuple of (T,) arrays, or None; entry k acts over the interval that ends at sample k.
        dt: interval [s], scalar or (T,), as of `kalman_filter`.
        mask: observation tuple of (T,) bools, one (T,) bool, or None.
        method: how to linearise.
        initial: belief before the first interval; None takes the model's.
        keep: fields of the filter's `Posterior` to return.

    Returns:
        Smoothed means and covariances, and the filter's posterior.

    Raises:
        ValueError: see `kalman_filter`.
    """
    checks.check_arguments(model, method, keep, FIELDS)
    checks.check_values(observations, controls, dt)
    return _smoother(model, params, observations, controls, dt, mask, initial, method, tuple(keep))


@partial(jax.jit, static_argnames=("model", "method", "keep"))
def _smoother(
    model: Model, params: Any, observations: Any, controls: Any, dt: Any, mask: Any, initial: Belief | None,
    method: Method, keep: tuple[str, ...],
) -> Smoothed:  # fmt: skip
    ready = prepared(model, params, observations, controls, dt, mask, initial)
    kept = scanned(ready, method, tuple(dict.fromkeys((*keep, "mean", "cov"))))
    filtered = Moments(kept["mean"], kept["cov"])
    last = jax.tree.map(lambda leaf: leaf[-1], filtered)

    def body(following: Moments, sample: Any) -> tuple[Moments, Moments]:
        before, control, interval = sample
        smoothed = smoothed_moments(ready.vm, before, following, control, interval, method)
        return smoothed, smoothed

    before = jax.tree.map(lambda leaf: leaf[:-1], filtered)
    ahead = jax.tree.map(lambda leaf: leaf[1:], (ready.controls, ready.dt))
    _, smoothed = lax.scan(body, last, (before, *ahead), reverse=True)
    mean, cov = jax.tree.map(lambda body, end: jnp.concatenate([body, end[None]]), smoothed, last)
    return Smoothed(
        unpack(mean, ready.vm.state),
        Covariance.from_dense(cov, ready.vm.error),
        posterior(ready.vm, {name: kept[name] for name in keep}),
    )


def smoothed_moments(
    vm: VectorModel, filtered: Moments, following: Moments, control: Any, dt: Any, method: Method
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
