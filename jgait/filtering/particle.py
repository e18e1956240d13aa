r"""The particle filter, in its bootstrap form: particles drawn from the transition, weighed by the observation.

    draw     x_k^i = f(x_{k−1}^i) ⊕ N(0, Q)
    weigh    w_k^i ∝ w_{k−1}^i N(y_k ⊖ h(x_k^i); 0, R),  log p(y_k | y_{<k}) ≈ log Σ_i w_{k−1}^i N(y_k ⊖ h(x_k^i); 0, R)
    resample where 1 / Σ w² < threshold · N, see `resampling`

Each particle has its own Q and R, taken at its own state, as `draw` takes them; Q, R and P₀ may couple components,
and Q and P₀ may be singular. Samples of which nothing was seen only draw: they neither weigh nor resample, and
nothing is resampled after the last sample that was seen, since no weight would come of it.

Gradients. What is drawn is a function of key and parameters, so the results differentiate along the particles and
through their weights. Where nothing is resampled, the gradient of the log-likelihood is the derivative of what was
returned. Where resampling happens, the value jumps with the parameters while the gradient estimates that of the
likelihood, see `resampling`; its variance grows with the number of times. In reverse mode, memory holds the
particles of about 2 √T samples.

Sources: N. Gordon, D. Salmond, A. Smith, "Novel approach to nonlinear/non-Gaussian Bayesian state estimation",
IEE Proceedings F 140(2), 1993; G. Kitagawa, "Monte Carlo filter and smoother for non-Gaussian nonlinear state space
models", JCGS 5(1), 1996.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jgait.filtering import checks
from jgait.filtering.cloud import Cloud, drawn, moments, moved, weighed
from jgait.filtering.compile import compiled
from jgait.filtering.fast import filled, sample_of, segment_length, series
from jgait.filtering.filter import named_covariance, named_values
from jgait.filtering.inputs import Inputs, inputs
from jgait.filtering.methods import EKF
from jgait.filtering.model import Belief, Model
from jgait.filtering.resampling import (
    Resampling,
    Systematic,
    check_resampling,
    effective_size,
    lowest,
    normalised,
    resampled,
)


class ParticlePosterior(NamedTuple):
    """A filtered recording; every leaf has the time axis in front, and a field not asked for is None.

    Attributes:
        mean: of the weighted particles, in the state's type; on a manifold where the errors about it cancel.
        cov: covariance of the error about it.
        log_likelihood: (T,) of each sample given the past [nat]; 0 where nothing was seen.
        effective_size: (T,) 1 / Σ w² after the sample and before resampling: 1 to N.
        count: (T,) measured components, as a float; 0 where valid is False.
        valid: (T,) False where the numbers of all particles broke down; those kept their states, or their weights.
        resampled: (T,) whether the particles were resampled after the sample.
        particles: state tuple of (T, N) arrays, before resampling.
        log_weights: (T, N), normalised, before resampling.
        ancestors: (T, N) which particle of this sample each one of the next descends from.
    """

    mean: Any = None
    cov: Any = None
    log_likelihood: Any = None
    effective_size: Any = None
    count: Any = None
    valid: Any = None
    resampled: Any = None
    particles: Any = None
    log_weights: Any = None
    ancestors: Any = None


PARTICLE_FIELDS = ParticlePosterior._fields
"""What a particle filter can return, see `ParticlePosterior`."""

PARTICLE_KEEP = ("mean", "cov", "log_likelihood", "effective_size", "count", "valid")
"""What it returns unless told otherwise."""


class Settings(NamedTuple):
    """What a particle filter is compiled for; see `particle_filter`."""

    particles: int
    resampling: Resampling
    threshold: float
    keep: tuple[str, ...]


def particle_filter(
    model: Model, params: Any, observations: Any, *, key: Any, particles: int = 1000, controls: Any = None,
    dt: Any = 1.0, mask: Any = None, initial: Belief | None = None, resampling: Resampling = Systematic(),
    threshold: float = 0.5, keep: tuple[str, ...] = PARTICLE_KEEP,
) -> ParticlePosterior:  # fmt: skip
    """Filter a recording with weighted particles: for beliefs that no Gaussian describes.

    Args:
        model: state-space model; functions at module level, since the model is a static argument of `jax.jit`.
        params: any pytree, passed on to the model's functions; differentiable.
        observations: observation tuple of (T,) arrays; what the mask hides may be any finite number.
        key: PRNG key; the same key gives the same particles.
        particles: N, how many.
        controls: control tuple of (T,) arrays, or None; entry k acts over the interval that ends at sample k.
        dt: interval [s], scalar or (T,), as of `kalman_filter`.
        mask: observation tuple of (T,) bools, one (T,) bool for whole samples, or None.
        initial: belief before the first interval; None takes the model's.
        resampling: `Systematic()` or `Soft(share)`.
        threshold: resample where the effective size falls below this share of N; 0 never does, 1 always.
        keep: fields of `ParticlePosterior` to return; particles, weights and ancestors take T · N numbers each.

    Returns:
        The posterior, every leaf with the time axis in front.

    Raises:
        ValueError: see `kalman_filter`; a key that is none, or fewer than two particles.
    """
    settings = checked(model, key, particles, resampling, threshold, keep)
    checks.check_values(observations, controls, dt)
    return _filter(model, params, observations, controls, dt, mask, initial, key, settings)


def checked(model: Any, key: Any, particles: Any, resampling: Any, threshold: Any, keep: tuple[str, ...]) -> Settings:
    """The settings; raises ValueError for what is none, see `particle_filter`."""
    checks.check_arguments(model, EKF(), keep, PARTICLE_FIELDS)
    check_resampling(resampling)
    if not isinstance(particles, int) or isinstance(particles, bool) or particles < 2:
        raise ValueError(f"particles must be a whole number from 2 up; got {particles!r}")
    if not isinstance(threshold, int | float) or not 0.0 <= threshold <= 1.0:
        raise ValueError(f"threshold must be a share of the particles from 0 to 1; got {threshold!r}")
    dtype = getattr(key, "dtype", None)
    typed = dtype is not None and jnp.issubdtype(dtype, jax.dtypes.prng_key)
    if not (typed and key.shape == ()) and not (dtype == jnp.uint32 and jnp.ndim(key) == 1):
        raise ValueError(f"key must be one PRNG key, such as jax.random.key(0); got {key!r}")
    return Settings(particles, resampling, float(threshold), tuple(keep))


def _filtered(
    model: Model, params: Any, observations: Any, controls: Any, dt: Any, mask: Any, initial: Belief | None,
    key: Any, settings: Settings,
) -> ParticlePosterior:  # fmt: skip
    given = inputs(model, params, observations, controls, dt, mask, initial)
    begin, key = jax.random.split(key)
    body = jax.checkpoint(stepper(given, key, settings, settings.keep), prevent_cse=False)
    leaves = segments(given)[1]

    @jax.checkpoint
    def segment(cloud: Cloud, part: Any) -> tuple[Cloud, Any]:
        return lax.scan(body, cloud, part)

    start = drawn(given, begin, settings.particles)
    kept = jax.tree.map(lambda leaf: joined(leaf, given.length), lax.scan(segment, start, leaves)[1])
    return particle_posterior(given, kept)


_filter = compiled(_filtered, static_argnames=("model", "settings"))


def segments(given: Inputs) -> tuple[int, Any]:
    """The length L of segments, and what happens in them: arrays (T / L, L).

    Samples that fill up the last segment are marked, and change nothing.
    """
    length = given.length
    size = segment_length(length)
    count = -(-length // size)
    seen = jnp.zeros(length, bool)
    for there in given.seen:
        seen = seen | there
    ahead = jnp.concatenate([lax.cummax(seen[1:].astype(jnp.int32), reverse=True) > 0, jnp.zeros(1, bool)])
    leaves = (series(given), seen, ahead, jnp.arange(length))
    folded = jax.tree.map(lambda leaf: filled(leaf, count * size).reshape(count, size), leaves)
    return size, (*folded, (jnp.arange(count * size) < length).reshape(count, size))


def joined(leaf: Any, length: int) -> Any:
    """An array (T / L, L, …) as (T, …)."""
    return leaf.reshape(-1, *leaf.shape[2:])[:length]


def stepper(given: Inputs, key: Any, settings: Settings, keep: tuple[str, ...]) -> Callable[[Cloud, Any], Any]:
    """The body of the scan: a sample's particles from those of the sample before, and the fields to keep."""
    particles = settings.particles
    same = jnp.arange(particles, dtype=jnp.int32)

    def body(before: Cloud, sample: Any) -> tuple[Cloud, dict[str, Any]]:
        leaves, seen, ahead, index, there = sample
        move, pick = jax.random.split(jax.random.fold_in(key, index))
        after, told = _advanced(given, before, leaves, seen, move)
        size = effective_size(jnp.exp(after.log_weights))

        def chosen() -> tuple[Cloud, Any]:
            ancestors, log_weights = resampled(pick, after.log_weights, settings.resampling)
            return Cloud(tuple(leaf[ancestors] for leaf in after.state), log_weights), ancestors

        poor = seen & ahead & there & (size < settings.threshold * particles)
        following, ancestors = after, same
        if settings.threshold > 0.0:
            following, ancestors = lax.cond(poor, chosen, lambda: (after, same))
        following = jax.tree.map(lambda new, old: jnp.where(there, new, old), following, before)
        told |= {
            "effective_size": size, "resampled": poor, "particles": after.state, "log_weights": after.log_weights,
            "ancestors": ancestors,
        }  # fmt: skip
        if "mean" in keep or "cov" in keep:
            told["mean"], told["cov"] = moments(given.cm, after.state, jnp.exp(after.log_weights))
        return following, {name: told[name] for name in keep}

    return body


def _advanced(given: Inputs, before: Cloud, leaves: Any, seen: Any, key: Any) -> tuple[Cloud, dict[str, Any]]:
    """Move, then weigh: the particles after a sample, and what it tells."""
    at = sample_of(leaves, given)
    state, sound = moved(given, before.state, at.control, at.dt, key)
    least = lowest(given.dtype)
    usable = jnp.max(jnp.where(sound, before.log_weights, least)) > 0.5 * least
    prior = jnp.where(
        jnp.all(sound) | ~usable, before.log_weights, normalised(jnp.where(sound, before.log_weights, least))
    )
    zero = jnp.zeros((), given.dtype)

    def weigh() -> tuple[Any, Any, Any]:
        joint = prior + weighed(given, state, at.measured, at.control, at.seen)
        good = jnp.max(joint) > 0.5 * least
        evidence = jax.nn.logsumexp(joint) - jax.nn.logsumexp(prior)
        return jnp.where(good, normalised(joint), prior), jnp.where(good, evidence, 0.0), good

    log_weights, evidence, good = lax.cond(seen, weigh, lambda: (prior, zero, jnp.asarray(True)))
    count = sum((jnp.asarray(there).astype(given.dtype) for there in at.seen), zero)
    return Cloud(state, log_weights), {
        "log_likelihood": evidence, "valid": good & usable, "count": jnp.where(good & usable, count, 0.0),
    }  # fmt: skip


def particle_posterior(given: Inputs, kept: dict[str, Any]) -> ParticlePosterior:
    """What a scan kept, under the names it belongs to."""
    names: dict[str, Callable[[Any], Any]] = {
        "mean": lambda value: named_values(list(value), given.cm.state),
        "particles": lambda value: named_values(list(value), given.cm.state),
        "cov": lambda value: named_covariance(list(value), given.cm.error),
    }
    return ParticlePosterior(**{name: names[name](value) if name in names else value for name, value in kept.items()})
