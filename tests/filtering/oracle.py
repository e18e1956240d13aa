"""The oracle: a filter and a Bryson–Frazier smoother in plain matrices of NumPy, one sample after another.

Only the model's own functions are JAX: they are taken as functions of vectors, with Jacobians by
`jax.jacfwd`. What is not seen is deleted.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jgait.filtering import UKF, Covariance, Model


class Told(NamedTuple):
    """Arrays over time; the fields of `Posterior`, and mean and covariance of the smoother."""

    mean: Any
    cov: Any
    innovation: Any
    innovation_stddev: Any
    log_likelihood: Any
    nis: Any
    count: Any
    smoothed_mean: Any
    smoothed_cov: Any


def stacked(tree: Any) -> Any:
    """A tuple of scalars or of arrays over time as (size,) or (T, size)."""
    leaves = jax.tree.leaves(tree)
    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in leaves)
    return jnp.stack([jnp.asarray(leaf, float) for leaf in leaves], -1) if traced else np.stack(leaves, -1, dtype=float)


class Vectors:
    """A model's functions of vectors."""

    def __init__(self, model: Model, params: Any, seen: Any) -> None:
        mean, cov = model.initial(params)
        self.start = np.asarray(stacked(mean)), np.asarray(cov.dense())
        state, error = jax.tree.structure(mean), jax.tree.structure(cov.variances())

        def plus(x: Any, e: Any) -> Any:
            return x + e if model.retract is None else stacked(model.retract(state.unflatten(x), error.unflatten(e)))

        def minus(a: Any, b: Any) -> Any:
            return a - b if model.local is None else stacked(model.local(state.unflatten(b), state.unflatten(a)))

        def differ(y: Any, z: Any) -> Any:
            return y - z if model.residual is None else stacked(model.residual(seen.unflatten(y), seen.unflatten(z)))

        def matrix(noise: Any) -> Any:
            return noise.dense() if isinstance(noise, Covariance) else jnp.diag(stacked(noise))

        def f(x: Any, u: Any, dt: Any) -> Any:
            return stacked(model.transition(params, state.unflatten(x), u, dt))

        def h(x: Any, u: Any) -> Any:
            return stacked(model.observation(params, state.unflatten(x), u))

        def moved(e: Any, x: Any, u: Any, dt: Any) -> Any:
            return minus(f(plus(x, e), u, dt), f(x, u, dt))

        def observed(e: Any, x: Any, u: Any, about: Any) -> Any:
            return differ(h(plus(x, e), u), h(plus(x, about), u))

        def turned(e: Any, x: Any, delta: Any) -> Any:  # errors about x as errors about x ⊕ delta
            return minus(plus(x, e), plus(x, delta))

        self.f, self.h, self.plus, self.minus, self.differ = map(jax.jit, (f, h, plus, minus, differ))
        self.Q = jax.jit(lambda x, u, dt: matrix(model.transition_noise(params, state.unflatten(x), u, dt)))
        self.R = jax.jit(lambda x, u: matrix(model.observation_noise(params, state.unflatten(x), u)))
        self.moved, self.observed = affine(moved), affine(observed)
        self.turn = jax.jit(lambda x, delta: jax.jacfwd(turned)(delta, x, delta))


def vectors(c: Any) -> Vectors:
    """Of a case; those of one model are compiled once."""
    return _vectors(c.model, tuple(np.asarray(c.params).tolist()), jax.tree.structure(c.observations))


@functools.cache
def _vectors(model: Model, params: tuple[float, ...], seen: Any) -> Vectors:
    return Vectors(model, np.asarray(params), seen)


def affine(g: Any) -> Any:
    """(method, μ, P, …) → v, A, Ω with g(e) ≈ v + A (e − μ) + N(0, Ω) over N(μ, P)."""
    value, slope = jax.jit(g), jax.jit(jax.jacfwd(g))

    @functools.partial(jax.jit, static_argnums=0)
    def regression(method: Any, mean: Any, cov: Any, *rest: Any) -> Any:
        n = mean.size
        alpha, beta, kappa = method.alpha, method.beta, method.kappa
        scale = alpha**2 * (n + kappa)
        offsets = jnp.sqrt(scale) * jnp.linalg.cholesky(cov).T
        points = mean[None] + jnp.concatenate([jnp.zeros((1, n)), offsets, -offsets])
        weights = jnp.full(2 * n + 1, 0.5 / scale).at[0].set(1.0 - n / scale)
        spread_weights = weights.at[0].add(1.0 - alpha**2 + beta)
        values = jax.vmap(lambda e: g(e, *rest))(points)
        v = weights @ values
        ahead, after = points - mean[None], values - v[None]
        matrix = jnp.linalg.solve(cov, ahead.T @ (spread_weights[:, None] * after)).T
        return v, matrix, after.T @ (spread_weights[:, None] * after) - matrix @ cov @ matrix.T

    def approximated(method: Any, mean: Any, cov: Any, *rest: Any) -> Any:
        if isinstance(method, UKF):
            return map(np.asarray, regression(method, mean, cov, *rest))
        return np.asarray(value(mean, *rest)), np.asarray(slope(mean, *rest)), 0.0

    return approximated


def estimated(c: Any, method: Any) -> Told:
    """What filter and smoother tell of a case: model, params, observations, controls, dt, mask."""
    model = vectors(c)
    y = np.asarray(stacked(c.observations))
    samples, m = y.shape
    mask = jax.tree.map(lambda leaf: jnp.ones(samples, bool), c.observations) if c.mask is None else c.mask
    mask = np.asarray(stacked(mask)).astype(bool) if isinstance(mask, tuple) else np.tile(mask[:, None], (1, m))
    x, P = model.start
    n = len(P)
    zero = np.zeros(n)
    out, later = [], []
    for k, dt in enumerate(np.broadcast_to(np.asarray(c.dt, float), samples)):
        u = jax.tree.map(lambda leaf, k=k: leaf[k], c.controls)
        v, F, spread = model.moved(method, zero, P, x, u, dt)
        Q = np.asarray(model.Q(x, u, dt))
        centre = model.f(x, u, dt)
        turn = np.asarray(model.turn(centre, v))
        x, F = np.asarray(model.plus(centre, v)), turn @ F
        prior = F @ P @ F.T + turn @ np.broadcast_to(spread, (n, n)) @ turn.T + Q
        rows = np.flatnonzero(mask[k])
        innovation, stddev, level, nis, delta, P = np.zeros(m), np.ones(m), 0.0, 0.0, zero, prior
        H, G, error = np.zeros((0, n)), np.zeros((0, 0)), np.zeros(0)
        for iteration in range(method.iterations if rows.size else 0):
            v, H, spread = model.observed(method, delta, P, x, u, delta)
            R = np.asarray(model.R(x, u)) + spread
            expected = model.h(model.plus(x, delta), u)
            r = (np.asarray(model.differ(np.where(mask[k], y[k], expected), expected)) - v)[rows]
            H = H[rows]
            S = H @ prior @ H.T + R[np.ix_(rows, rows)]
            G = np.linalg.inv(S)
            if iteration == 0:
                innovation[rows], stddev[rows], nis = r, np.sqrt(np.diag(S)), r @ G @ r
                level = -0.5 * (nis + np.linalg.slogdet(2.0 * np.pi * S)[1])
            error = r + H @ delta
            delta, P = prior @ H.T @ G @ error, prior - prior @ H.T @ G @ H @ prior
        turn = np.asarray(model.turn(x, delta))
        later.append((F, H, turn @ (np.eye(n) - prior @ H.T @ G @ H), G, G @ error))
        told = innovation, stddev, level, nis, rows.size
        x, P = np.asarray(model.plus(x, delta)), turn @ P @ turn.T
        out.append((x, P, *told))
    vector, matrix, smoothed = zero, np.zeros((n, n)), []
    for (x, P, *_), (F, H, C, G, z) in zip(out[::-1], later[::-1], strict=True):
        delta = -P @ vector
        turn = np.asarray(model.turn(x, delta))
        smoothed.append((np.asarray(model.plus(x, delta)), turn @ (P - P @ matrix @ P) @ turn.T))
        vector = F.T @ (C.T @ vector - H.T @ z)
        matrix = F.T @ (C.T @ matrix @ C + H.T @ G @ H) @ F
    filtered = (np.array(column) for column in zip(*out, strict=True))
    return Told(*filtered, *(np.array(column) for column in zip(*smoothed[::-1], strict=True)))
