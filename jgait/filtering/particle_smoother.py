r"""Smoothing along the ancestors of the particles.

    v_T^i = w_T^i,  v_k^i = Σ_{j: a_k(j) = i} v_{k+1}^j

What is smoothed at sample k is the filter's cloud at k, each particle with what its descendants weigh at the end.

Sources: G. Kitagawa, "Monte Carlo filter and smoother for non-Gaussian nonlinear state space models", JCGS 5(1), 1996;
G. Kitagawa, S. Sato, "Monte Carlo smoothing and self-organising state-space model", in "Sequential Monte Carlo methods
in practice", 2001, for the lag.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jgait.filtering import checks
from jgait.filtering.cloud import Cloud, drawn, moments
from jgait.filtering.compile import compiled
from jgait.filtering.filter import named_covariance, named_values
from jgait.filtering.inputs import Inputs, inputs
from jgait.filtering.model import Belief, Model
from jgait.filtering.particle import (
    PARTICLE_KEEP,
    ParticlePosterior,
    Settings,
    checked,
    joined,
    particle_posterior,
    segments,
    stepper,
)
from jgait.filtering.resampling import Resampling, Systematic, effective_size

MOMENTS = ("mean", "cov")
"""Fields that follow from the others."""

CLOUDS = ("particles", "log_weights", "ancestors", "resampled")
"""What is remembered of a segment to trace it back."""


class ParticleSmoothed(NamedTuple):
    """A smoothed recording; every leaf has the time axis in front.

    Attributes:
        mean: smoothed mean in the state's type.
        cov: its covariance.
        effective_size: (T,) 1 / Σ v² of the smoothed weights; near 1 the covariance means nothing.
        filtered: the filter's `ParticlePosterior`.
    """

    mean: Any
    cov: Any
    effective_size: Any
    filtered: ParticlePosterior


def particle_smoother(
    model: Model, params: Any, observations: Any, *, key: Any, particles: int = 1000, controls: Any = None,
    dt: Any = 1.0, mask: Any = None, initial: Belief | None = None, resampling: Resampling = Systematic(),
    threshold: float = 0.5, keep: tuple[str, ...] = PARTICLE_KEEP, lag: int | None = None,
) -> ParticleSmoothed:  # fmt: skip
    """Filter forward, then weigh each particle by what its descendants weigh at the end.

    It never asks for the density of a transition, so it serves models whose process noise is singular, where
    backward simulation would find that a state could only have come from the particle it did come from. The price
    is that each resampling leaves fewer ancestors: far before the end all particles descend from a few, the mean is
    theirs, and the covariance is too small. `effective_size` says how many are left. More particles leave more,
    and a lower threshold; so does a `lag`, which weighs by the descendants that much later instead of those at the
    end (Kitagawa and Sato 2001): right where what comes later than the lag tells nothing more.

    The recording is taken twice in segments of about √T samples, forward, and then from the last segment to the
    first, each drawn again from its start: memory holds the particles of about 2 √T samples.

    Args:
        model: state-space model; functions at module level, since the model is a static argument of `jax.jit`.
        params: any pytree, passed on to the model's functions; differentiable.
        observations: observation tuple of (T,) arrays; what the mask hides may be any finite number.
        key: PRNG key; the same key gives the same particles.
        particles: N, how many.
        controls: control tuple of (T,) arrays, or None.
        dt: interval [s], scalar or (T,), as of `kalman_filter`.
        mask: observation tuple of (T,) bools, one (T,) bool, or None.
        initial: belief before the first interval; None takes the model's.
        resampling: as of `particle_filter`.
        threshold: as of `particle_filter`.
        keep: fields of the filter's `ParticlePosterior` to return.
        lag: samples to look ahead, up to two segments more; None looks to the end.

    Returns:
        Smoothed means and covariances, how many particles they rest on, and the filter's posterior.

    Raises:
        ValueError: see `particle_filter`.
    """
    settings = checked(model, key, particles, resampling, threshold, keep)
    if lag is not None and (not isinstance(lag, int) or isinstance(lag, bool) or lag < 1):
        raise ValueError(f"lag must be a whole number of samples from 1 up, or None; got {lag!r}")
    checks.check_values(observations, controls, dt)
    return _smoother(model, params, observations, controls, dt, mask, initial, key, settings, lag)


class _Visited(NamedTuple):
    """What a pass over the segments tells of each: the particles it began with, and each one's ancestor among them."""

    starts: Cloud
    origins: Any  # (T / L, N)


def _smoothed(
    model: Model, params: Any, observations: Any, controls: Any, dt: Any, mask: Any, initial: Belief | None,
    key: Any, settings: Settings, lag: int | None,
) -> ParticleSmoothed:  # fmt: skip
    given = inputs(model, params, observations, controls, dt, mask, initial)
    begin, key = jax.random.split(key)
    # The filter's moments are left to the second pass, which has all it takes.
    asked = tuple(name for name in settings.keep if name not in MOMENTS)
    body = stepper(given, key, settings, tuple(dict.fromkeys((*asked, *CLOUDS))))
    size, leaves = segments(given)
    count = jax.tree.leaves(leaves)[0].shape[0]
    ahead = count if lag is None else min(-(-lag // size), count)

    # One loop does both passes, the second from the last segment to the first: what is compiled twice may round
    # differently, and particles drawn again by another program would not be the ones whose ancestors are known.
    @jax.checkpoint
    def visit(carry: tuple[Cloud, Any], at: Any, back: Any, seen: _Visited, last: Cloud) -> Any:
        cloud, weights = carry
        place = jnp.where(back, count - 1 - at, at)
        cloud = jax.tree.map(lambda a, b: jnp.where(back, a[place], b), seen.starts, cloud)
        end, kept = lax.scan(body, cloud, jax.tree.map(lambda leaf: leaf[place], leaves))

        def returning() -> Any:
            held = weights if ahead == count else _pulled_back(seen, last, place, ahead)
            return (*_traced_back(given, held, kept, settings.keep), jnp.zeros_like(seen.origins[0]))

        def going() -> Any:
            found = jax.eval_shape(returning)[1]
            return weights, jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), found), _origins(kept)

        before, found, origins = lax.cond(back, returning, going)
        return (end, before), (_Visited(cloud, origins), {name: kept[name] for name in asked}, found)

    def run(carry: tuple[_Visited, Cloud], back: Any) -> Any:
        seen, last = carry
        start = last, jnp.exp(last.log_weights)
        (end, _), (seen, told, found) = lax.scan(
            lambda c, at: visit(c, at, back, seen, last), start, jnp.arange(count)
        )  # fmt: skip
        return (seen, end), (told, found)

    cloud = drawn(given, begin, settings.particles)
    starts = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (count, *leaf.shape)), cloud)
    empty = _Visited(starts, jnp.zeros((count, settings.particles), jnp.int32))
    _, passes = lax.scan(run, (empty, cloud), jnp.asarray([False, True]))
    told, (smoothed, effective, filtered) = jax.tree.map(lambda leaf: joined(leaf[1, ::-1], given.length), passes)
    mean, cov = smoothed
    return ParticleSmoothed(
        named_values(list(mean), given.cm.state), named_covariance(list(cov), given.cm.error), effective,
        particle_posterior(given, told | filtered),
    )  # fmt: skip


_smoother = compiled(_smoothed, static_argnames=("model", "settings", "lag"))


def _origins(kept: dict[str, Any]) -> Any:
    """Which particle at the start of a segment each one at its end descends from (N,)."""

    def body(origins: Any, sample: Any) -> tuple[Any, None]:
        ancestors, moved = sample
        return lax.cond(moved, lambda: origins[ancestors], lambda: origins), None

    same = jnp.arange(kept["ancestors"].shape[1], dtype=jnp.int32)
    return lax.scan(body, same, (kept["ancestors"], kept["resampled"]))[0]


def _pulled_back(seen: _Visited, last: Cloud, place: Any, ahead: int) -> Any:
    """The weights (N,) at the end of a segment, by what its descendants weigh some segments later."""
    count = seen.origins.shape[0]
    until = jnp.minimum(place + ahead, count - 1)
    # A segment ends with what the next one begins with.
    ends = seen.starts.log_weights[jnp.minimum(until + 1, count - 1)]
    weights = jnp.exp(jnp.where(until == count - 1, last.log_weights, ends))

    def body(number: Any, after: Any) -> Any:
        at = until - number
        return jnp.where(at > place, jnp.zeros_like(after).at[seen.origins[at]].add(after), after)

    return lax.fori_loop(0, ahead, body, weights)


def _traced_back(given: Inputs, weights: Any, kept: dict[str, Any], keep: tuple[str, ...]) -> Any:
    """The weights (N,) at the start of a segment from those at its end, and the moments in between."""

    def body(after: Any, sample: dict[str, Any]) -> Any:
        state, ancestors = sample["particles"], sample["ancestors"]
        weights = lax.cond(sample["resampled"], lambda: jnp.zeros_like(after).at[ancestors].add(after), lambda: after)
        filtered: dict[str, Any] = {}
        if set(keep) & set(MOMENTS):
            found = dict(zip(MOMENTS, moments(given.cm, state, jnp.exp(sample["log_weights"])), strict=True))
            filtered = {name: value for name, value in found.items() if name in keep}
        return weights, (moments(given.cm, state, weights), effective_size(weights), filtered)

    return lax.scan(body, weights, {name: kept[name] for name in CLOUDS}, reverse=True)
