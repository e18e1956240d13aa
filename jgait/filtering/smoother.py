r"""Rauch–Tung–Striebel smoothing: a backward scan over the filtered beliefs.

    G = P Aᵀ (P⁻)⁻¹,  m_s = m ⊕ G (m_s' ⊖ m⁻),  P_s = (I − G A) P (I − G A)ᵀ + G (P_s' + Ω + Q) Gᵀ

A prime marks the next sample. The transition is linearised again at each filtered belief, so nothing but the
filtered beliefs is stored; the form of P_s keeps it symmetric and positive. The solve by P⁻ is scaled by its
diagonal, which keeps float32 usable where metres and radians per second meet.

Source: H. Rauch, F. Tung, C. Striebel (1965), AIAA Journal 3(8); S. Särkkä (2013), chapters 8 to 10.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jgait.filtering.kalman import Posterior, kalman_filter, ready, transition_affine, transported
from jgait.filtering.linear_algebra import product, solve_covariance, symmetric
from jgait.filtering.linearise import EKF, Method
from jgait.filtering.model import Belief, Covariance, Model, coordinates


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


def smooth_step(
    model: Model, params: Any, filtered: Belief, following: Belief, control: Any, dt: Any, method: Method
) -> Belief:
    """The smoothed belief at one sample from its filtered one and the smoothed one at the next.

    Args:
        model: state-space model.
        params: passed on to the model's functions.
        filtered: at this sample.
        following: smoothed, at the next sample.
        control: input over the interval between them.
        dt: length of that interval [s].
        method: how to linearise.
    """
    moved, affine, noise = transition_affine(model, params, filtered, control, dt, method)
    space = coordinates(model, moved)
    cov = filtered.cov.dense()
    added = affine.spread + noise
    ahead = product(affine.matrix, cov)  # A P
    predicted = symmetric(product(ahead, affine.matrix.T) + added)
    gain = solve_covariance(predicted, ahead).T
    # Both errors are taken about the moved state; `value` is 0 for the Jacobian methods.
    delta = product(gain, space.between(moved, following.mean) - affine.value)
    left = jnp.eye(cov.shape[0], dtype=cov.dtype) - product(gain, affine.matrix)
    spread = following.cov.dense() + added
    smoothed = symmetric(product(product(left, cov), left.T) + product(product(gain, spread), gain.T))
    good = jnp.all(jnp.isfinite(delta)) & jnp.all(jnp.isfinite(smoothed))
    delta = jnp.where(good, delta, 0.0)
    smoothed = jnp.where(good, transported(space, filtered.mean, delta, smoothed), cov)
    return Belief(space.moved(filtered.mean, delta), Covariance.from_dense(smoothed, filtered.cov.structure))


def kalman_smoother(
    model: Model, params: Any, observations: Any, *, controls: Any = None, dt: Any = 1.0, mask: Any = None,
    method: Method = EKF(), initial: Belief | None = None,  # noqa: B008
) -> Smoothed:  # fmt: skip
    """Filter forward, then smooth backward: every sample is judged by all of the recording.

    Args:
        model: state-space model.
        params: any pytree, passed on to the model's functions; differentiable.
        observations: observation tuple of (T,) arrays.
        controls: control tuple of (T,) arrays, or None.
        dt: interval [s], scalar or (T,).
        mask: observation tuple of (T,) bools, one (T,) bool, or None.
        method: how to linearise.
        initial: belief before the first interval; None takes the model's.

    Returns:
        Smoothed means and covariances, and the filter's posterior.

    Raises:
        ValueError: see `kalman_filter`.
    """
    filtered = kalman_filter(
        model, params, observations, controls=controls, dt=dt, mask=mask, method=method, initial=initial
    )
    _, _, controls, dt, _ = ready(model, params, observations, controls, dt, mask, initial)
    belief = _backward(model, params, Belief(filtered.mean, filtered.cov), controls, dt, method)
    return Smoothed(belief.mean, belief.cov, filtered)


@partial(jax.jit, static_argnames=("model", "method"))
def _backward(model: Model, params: Any, filtered: Belief, controls: Any, dt: Any, method: Method) -> Belief:
    last = jax.tree.map(lambda leaf: leaf[-1], filtered)

    def scanned(following: Belief, sample: Any) -> tuple[Belief, Belief]:
        belief, control, interval = sample
        smoothed = smooth_step(model, params, belief, following, control, interval, method)
        return smoothed, smoothed

    before = jax.tree.map(lambda leaf: leaf[:-1], filtered)
    ahead = jax.tree.map(lambda leaf: leaf[1:], (controls, dt))
    _, smoothed = lax.scan(scanned, last, (before, *ahead), reverse=True)
    return jax.tree.map(lambda body, end: jnp.concatenate([body, end[None]]), smoothed, last)
