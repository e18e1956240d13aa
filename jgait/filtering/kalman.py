r"""Kalman filtering as one scan of predict and update; the same step serves online, a sample at a time.

    predict   m⁻ = f(m),            P⁻ = A P Aᵀ + Ω + Q
    update    S = H P⁻ Hᵀ + Ω + R,  K = P⁻ Hᵀ S⁻¹,  m = m⁻ ⊕ K (y − ŷ),  P = (I − K H) P⁻ (I − K H)ᵀ + K (R + Ω) Kᵀ

All in error coordinates δ about the predicted state, so rotations need no special case. An iterated update takes
its linearisation at its own result, but always starts again from the same prior.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jgait.filtering.linear_algebra import cholesky, forward_substitution, product, symmetric
from jgait.filtering.linearise import EKF, Affine, Method, linearise
from jgait.filtering.model import Belief, Coordinates, Covariance, Model, as_covariance, coordinates, flat, names_of

LOG_2PI = float(np.log(2.0 * np.pi))

FIELDS = (
    "mean", "cov", "predicted_mean", "predicted_cov", "innovation", "log_likelihood", "nis", "count", "valid",
)  # fmt: skip
"""What a filter can return, see `Posterior`."""


class Updated(NamedTuple):
    """One update.

    Attributes:
        belief: after the observation.
        innovation: measured − predicted, observation tuple; 0 where masked.
        log_likelihood: of the measured components given the past [nat].
        nis: normalised innovation squared, χ² with `count` degrees of freedom.
        count: measured components.
        valid: False where the numbers broke down and the prediction was kept.
    """

    belief: Belief
    innovation: Any
    log_likelihood: Any
    nis: Any
    count: Any
    valid: Any


class Step(NamedTuple):
    """One predict and update: the prediction, and the update."""

    predicted: Belief
    updated: Updated

    @property
    def belief(self) -> Belief:
        """The belief after the sample: what the next step starts from."""
        return self.updated.belief


class Posterior(NamedTuple):
    """A filtered recording; every leaf has the time axis in front, and a field not asked for is None.

    Attributes:
        mean: filtered mean, in the state's type.
        cov: its covariance.
        predicted_mean: mean before each sample.
        predicted_cov: its covariance.
        innovation: measured − predicted, in the observation's type; 0 where masked.
        log_likelihood: (T,) of each sample given the past [nat].
        nis: (T,) normalised innovation squared.
        count: (T,) measured components.
        valid: (T,) False where the numbers broke down and the prediction was kept.
    """

    mean: Any = None
    cov: Any = None
    predicted_mean: Any = None
    predicted_cov: Any = None
    innovation: Any = None
    log_likelihood: Any = None
    nis: Any = None
    count: Any = None
    valid: Any = None


def transition_affine(
    model: Model, params: Any, belief: Belief, control: Any, dt: Any, method: Method
) -> tuple[Any, Affine, Any]:
    """The state that the mean moves to, the affine model of the error about it, and Q (n, n)."""
    space = coordinates(model, belief.mean)
    moved = model.transition(params, belief.mean, control, dt)

    def g(delta: Any) -> Any:
        return space.between(moved, model.transition(params, space.moved(belief.mean, delta), control, dt))

    cov = belief.cov.dense()
    affine = linearise(method, g, jnp.zeros((cov.shape[0],), cov.dtype), cov, "transition")
    noise = as_covariance(model.transition_noise(params, belief.mean, control, dt)).dense()
    return moved, affine, noise.astype(cov.dtype)


def predict(
    model: Model, params: Any, belief: Belief, *, control: Any = None, dt: Any = 1.0, method: Method = EKF()  # noqa: B008
) -> Belief:
    """The belief one interval later, before its sample.

    Args:
        model: state-space model.
        params: passed on to the model's functions.
        belief: now.
        control: input over the interval, or None.
        dt: length of the interval [s].
        method: how to linearise.

    Returns:
        The predicted belief.
    """
    moved, affine, noise = transition_affine(model, params, belief, control, dt, method)
    space = coordinates(model, moved)
    cov = symmetric(product(product(affine.matrix, belief.cov.dense()), affine.matrix.T) + affine.spread + noise)
    return Belief(space.moved(moved, affine.value), Covariance.from_dense(cov, belief.cov.structure))


def _residual(model: Model, measured: Any, predicted: Any) -> Any:
    if model.residual is None:
        return jax.tree.map(lambda a, b: a - b, measured, predicted)
    return model.residual(measured, predicted)


class _Innovation(NamedTuple):
    """Linear update in vectors: whitened innovation, gain and pieces for the covariance."""

    error: Any  # innovation at the prior mean (m,)
    whitened: Any  # S^-1/2 innovation (m,)
    log_det: Any  # log |S|
    gain: Any  # (n, m)
    matrix: Any  # H (m, n)
    noise: Any  # R + Ω (m, m)


def _innovation(
    model: Model, params: Any, space: Coordinates, prior: Belief, observation: Any, control: Any, mask: Any,
    method: Method, delta: Any, spread: Any,
) -> _Innovation:  # fmt: skip
    """Linearise the observation at error `delta` with covariance `spread`; update terms for the prior at 0."""

    def predicted(d: Any) -> Any:
        return model.observation(params, space.moved(prior.mean, d), control)

    at = predicted(delta)

    def g(d: Any) -> Any:
        # In residual coordinates about the prediction at `delta`, so that wrapped angles stay small.
        return -flat(_residual(model, at, predicted(d)))

    affine = linearise(method, g, delta, spread, "observation")
    seen = mask.astype(affine.value.dtype)
    error = flat(_residual(model, observation, at)) - affine.value + product(affine.matrix, delta)
    error = jnp.where(mask, error, 0.0)
    matrix = seen[:, None] * affine.matrix
    state = space.moved(prior.mean, delta)
    noise = as_covariance(model.observation_noise(params, state, control)).dense().astype(error.dtype) + affine.spread
    noise = jnp.where(mask[:, None] & mask[None, :], noise, jnp.eye(noise.shape[0], dtype=noise.dtype))
    cov = prior.cov.dense()
    cross = product(matrix, cov)  # H P
    lower = cholesky(product(cross, matrix.T) + noise)
    whitened = forward_substitution(lower, error)
    half = forward_substitution(lower, cross)  # S^-1/2 H P
    inverse = forward_substitution(lower, jnp.eye(lower.shape[0], dtype=lower.dtype))
    gain = product(half.T, inverse)
    log_det = 2.0 * jnp.sum(jnp.log(jnp.diagonal(lower)))
    return _Innovation(error, whitened, log_det, gain, matrix, noise)


def _joseph(cov: Any, terms: _Innovation) -> Any:
    left = jnp.eye(cov.shape[0], dtype=cov.dtype) - product(terms.gain, terms.matrix)
    spread = product(product(terms.gain, terms.noise), terms.gain.T)
    return symmetric(product(product(left, cov), left.T) + spread)


def transported(space: Coordinates, reference: Any, delta: Any, cov: Any) -> Any:
    """A covariance about `reference`, turned into one about the state at `delta` from it (manifolds only)."""
    if space.model.retract is None:
        return cov
    state = space.moved(reference, delta)
    turn = jax.jacfwd(lambda d: space.between(state, space.moved(reference, d)))(delta)
    return symmetric(product(product(turn, cov), turn.T))


def update(
    model: Model, params: Any, belief: Belief, observation: Any, *, control: Any = None, mask: Any = None,
    method: Method = EKF(),  # noqa: B008
) -> Updated:  # fmt: skip
    """The belief after an observation.

    Args:
        model: state-space model.
        params: passed on to the model's functions.
        belief: before the observation.
        observation: observation tuple of scalars; what the mask hides may be any finite number.
        control: passed on to the model's functions.
        mask: observation tuple of bools, one bool for all, or None for all there.
        method: how to linearise.

    Returns:
        The updated belief with innovation, log-likelihood and normalised innovation squared.
    """
    space = coordinates(model, belief.mean)
    seen = _mask_vector(mask, observation)
    prior_cov = belief.cov.dense()
    delta, spread = jnp.zeros((prior_cov.shape[0],), prior_cov.dtype), prior_cov
    first = terms = _innovation(
        model, params, space, belief, observation, control, seen, method, delta, spread
    )
    for _ in range(method.iterations - 1):
        delta, spread = product(terms.gain, terms.error), _joseph(prior_cov, terms)
        terms = _innovation(model, params, space, belief, observation, control, seen, method, delta, spread)
    delta, spread = product(terms.gain, terms.error), _joseph(prior_cov, terms)
    good = jnp.all(jnp.isfinite(delta)) & jnp.all(jnp.isfinite(spread))
    delta = jnp.where(good, delta, 0.0)
    cov = jnp.where(good, transported(space, belief.mean, delta, spread), prior_cov)
    after = Belief(space.moved(belief.mean, delta), Covariance.from_dense(cov, belief.cov.structure))
    count = jnp.sum(seen.astype(prior_cov.dtype))
    nis = jnp.where(good, jnp.sum(terms.whitened * terms.whitened), 0.0)
    log_likelihood = jnp.where(good, -0.5 * (nis + terms.log_det + count * LOG_2PI), 0.0)
    structure = jax.tree.structure(observation)
    return Updated(after, jax.tree.unflatten(structure, list(first.error)), log_likelihood, nis, count, good)


def _mask_vector(mask: Any, observation: Any) -> Any:
    size = len(jax.tree.leaves(observation))
    if mask is None:
        return jnp.ones((size,), bool)
    leaves = jax.tree.leaves(mask)
    if len(leaves) == 1 and jax.tree.structure(mask) != jax.tree.structure(observation):
        leaves = leaves * size
    return jnp.stack([jnp.asarray(leaf, bool) for leaf in leaves])


@partial(jax.jit, static_argnames=("model", "method"))
def step(
    model: Model, params: Any, belief: Belief, observation: Any, *, control: Any = None, dt: Any = 1.0,
    mask: Any = None, method: Method = EKF(),  # noqa: B008
) -> Step:  # fmt: skip
    """Predict over dt, then update: one sample online, and what `kalman_filter` scans.

    Args:
        model: state-space model.
        params: passed on to the model's functions.
        belief: after the sample before.
        observation: observation tuple of scalars.
        control: control tuple of scalars, or None.
        dt: time since the sample before [s].
        mask: observation tuple of bools, one bool, or None.
        method: how to linearise.

    Returns:
        Prediction and update; `.belief` is what the next step starts from.
    """
    return _step(model, params, belief, observation, control, dt, mask, method)


def _step(
    model: Model, params: Any, belief: Belief, observation: Any, control: Any, dt: Any, mask: Any, method: Method
) -> Step:
    predicted = predict(model, params, belief, control=control, dt=dt, method=method)
    return Step(predicted, update(model, params, predicted, observation, control=control, mask=mask, method=method))


def kalman_filter(
    model: Model, params: Any, observations: Any, *, controls: Any = None, dt: Any = 1.0, mask: Any = None,
    method: Method = EKF(), initial: Belief | None = None,  # noqa: B008
    keep: tuple[str, ...] = ("mean", "cov", "innovation", "log_likelihood", "nis", "count", "valid"),
) -> Posterior:  # fmt: skip
    """Filter a recording: a jitted scan over its samples.

    Args:
        model: state-space model; functions at module level, since the model is a static argument of `jax.jit`.
        params: any pytree, passed on to the model's functions; differentiable.
        observations: observation tuple of (T,) arrays.
        controls: control tuple of (T,) arrays, or None; entry k acts over the interval that ends at sample k.
        dt: interval [s], scalar or (T,); dt[k] is the time from sample k−1 to k, so dt[0] = 0 puts the initial
            belief at the first sample.
        mask: observation tuple of (T,) bools, one (T,) bool for whole samples, or None.
        method: `KF()`, `EKF()`, `IteratedEKF(k)`, `UKF()` or `CKF()`.
        initial: belief before the first interval; None takes the model's.
        keep: fields of `Posterior` to return.

    Returns:
        The posterior, every leaf with the time axis in front.

    Raises:
        ValueError: observations, controls, mask or dt do not fit the model or each other; NaN in observations.
    """
    unknown = [name for name in keep if name not in FIELDS]
    if unknown:
        raise ValueError(f"keep names fields of Posterior ({', '.join(FIELDS)}); got {unknown[0]!r}")
    belief, observations, controls, dt, mask = ready(model, params, observations, controls, dt, mask, initial)
    return _filter(model, params, belief, observations, controls, dt, mask, method, tuple(keep))


@partial(jax.jit, static_argnames=("model", "method", "keep"))
def _filter(
    model: Model, params: Any, belief: Belief, observations: Any, controls: Any, dt: Any, mask: Any, method: Method,
    keep: tuple[str, ...],
) -> Posterior:  # fmt: skip
    def scanned(before: Belief, sample: Any) -> tuple[Belief, Posterior]:
        observation, control, interval, seen = sample
        predicted, updated = _step(model, params, before, observation, control, interval, seen, method)
        everything = Posterior(
            updated.belief.mean, updated.belief.cov, predicted.mean, predicted.cov, updated.innovation,
            updated.log_likelihood, updated.nis, updated.count, updated.valid,
        )  # fmt: skip
        kept = Posterior(**{name: getattr(everything, name) for name in keep})
        return updated.belief, kept

    return lax.scan(scanned, belief, (observations, controls, dt, mask))[1]


def ready(
    model: Model, params: Any, observations: Any, controls: Any, dt: Any, mask: Any, initial: Belief | None
) -> tuple[Belief, Any, Any, Any, Any]:
    """Check what a filter is given and bring it to one dtype and one length; raises ValueError, see `kalman_filter`."""
    observations = jax.tree.map(jnp.asarray, observations)
    leaves = jax.tree.leaves(observations)
    names = names_of(observations)
    for name, leaf in zip(names, leaves, strict=True):
        if leaf.ndim != 1:
            raise ValueError(f"observations hold one value a sample: '{name}' must have shape (T,); got {leaf.shape}")
        if leaf.shape != leaves[0].shape:
            raise ValueError(f"'{name}' has {leaf.shape[0]} samples, '{names[0]}' has {leaves[0].shape[0]}")
        if not isinstance(leaf, jax.core.Tracer) and not bool(jnp.all(jnp.isfinite(leaf))):
            raise ValueError(
                f"observation '{name}' holds NaN or infinity; put any finite number there and False in the mask"
            )
    if not leaves or leaves[0].shape[0] == 0:
        raise ValueError("a filter needs at least one sample; got none")
    length, dtype = leaves[0].shape[0], jnp.result_type(*leaves)
    if not jnp.issubdtype(dtype, jnp.floating):
        raise ValueError(f"observations must be floating point; got {dtype}")
    belief = model.initial(params) if initial is None else initial
    belief = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype), belief)
    coordinates(model, belief.mean)
    for name, leaf in zip(names_of(controls), jax.tree.leaves(controls), strict=True):
        if jnp.shape(leaf)[:1] != (length,):
            raise ValueError(f"control '{name}' must have {length} samples; got shape {jnp.shape(leaf)}")
    dt = jnp.asarray(dt, dtype)
    if dt.ndim > 1 or (dt.ndim == 1 and dt.shape != (length,)):
        raise ValueError(f"dt must be a scalar or have shape ({length},); got {dt.shape}")
    mask = _full_mask(mask, observations, length)
    control = jax.tree.map(lambda leaf: jnp.asarray(leaf)[0], controls)
    expected = jax.eval_shape(lambda: model.observation(params, belief.mean, control))
    if jax.tree.structure(expected) != jax.tree.structure(observations):
        raise ValueError(f"the model observes {names_of(expected)}; the observations hold {names}")
    return belief, observations, controls, jnp.broadcast_to(dt, (length,)), mask


def _full_mask(mask: Any, observations: Any, length: int) -> Any:
    if mask is None:
        return jax.tree.map(lambda _: jnp.ones((length,), bool), observations)
    if jax.tree.structure(mask) != jax.tree.structure(observations):
        if len(jax.tree.leaves(mask)) != 1 or jnp.ndim(mask) != 1:
            raise ValueError(
                f"the mask is one array of {length} bools or a tuple like the observations "
                f"({', '.join(names_of(observations))}); got {names_of(mask) or type(mask).__name__}"
            )
        mask = jax.tree.map(lambda _: mask, observations)
    for name, leaf in zip(names_of(observations), jax.tree.leaves(mask), strict=True):
        if jnp.shape(leaf) != (length,) or jnp.asarray(leaf).dtype != jnp.bool_:
            raise ValueError(
                f"the mask of '{name}' must be {length} bools; got shape {jnp.shape(leaf)} of {jnp.asarray(leaf).dtype}"
            )
    return jax.tree.map(jnp.asarray, mask)
