"""Intervals keep their promise: tried by simulation, through a filter."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made.models import LOCAL_LEVEL, Level, Noise

from jgait.filtering import KF, kalman_filter
from jgait.params import positive
from jgait.tune.identifiability import identifiability


def level_loss(params, values):
    kept = kalman_filter(LOCAL_LEVEL, params, Level(values), method=KF(), dt=1.0, keep=("log_likelihood",))
    return -jnp.sum(kept.log_likelihood)


@pytest.mark.release
def test_intervals_of_noise_variances_cover_the_truth_at_the_nominal_rate():
    """Of 95 % intervals, 300 replicates cover in 87.5 % to 100 % of the cases (6 σ): 85 % would be found out."""
    replicates, samples, truth = 300, 150, np.log([1.0, 1.0])
    rng = np.random.default_rng(7)
    level = np.sqrt(10.0) * rng.normal(size=(replicates, 1)) + np.cumsum(rng.normal(size=(replicates, samples)), axis=1)
    measured = jnp.asarray(level + rng.normal(size=(replicates, samples)))

    def newton(values):
        def of(logs):
            return level_loss(Noise(*jnp.exp(logs)), values)

        def step(_, logs):
            slope, bend = jax.jacfwd(of)(logs), jax.jacfwd(jax.jacfwd(of))(logs)
            move = jnp.linalg.solve(bend, slope)
            return logs - move * jnp.minimum(1.0, 1.0 / jnp.max(jnp.abs(move)))

        return jax.lax.fori_loop(0, 8, step, jnp.asarray(truth))

    best = np.exp(jax.jit(jax.vmap(newton))(measured))
    covered, lengths = np.zeros(2), []
    for values, at in zip(measured, best, strict=True):
        found = identifiability(level_loss, Noise(*at), Noise(positive, positive), values[None])
        assert found.minimum and found.decrement < 1e-6
        covered += (found.low < 1.0) & (found.high > 1.0)
        lengths.append(found.stderr_free)
    rate = covered / replicates
    wide = 6.0 * np.sqrt(0.95 * 0.05 / replicates)
    assert 0.95 - wide > 0.85
    assert np.all(np.abs(rate - 0.95) < wide)
    spread = np.log(best).std(axis=0)  # and the standard errors are the spread of the estimates themselves
    assert np.all(np.abs(np.median(lengths, axis=0) / spread - 1.0) < 6.0 / np.sqrt(2.0 * replicates))
