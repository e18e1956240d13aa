"""The update of a covariance keeps its digits in single precision."""

import jax
import jax.numpy as jnp
import numpy as np

from jgait.filtering.lanes import product, product_transposed
from jgait.filtering.update import joseph, updated


def covariance(dtype: type, steps: int = 100) -> np.ndarray:
    """P of three positions and three velocities, after updates by nearly exact velocities from a wide prior."""
    rows = np.hstack([np.zeros((3, 3)), np.eye(3)]) + 0.01 * np.random.default_rng(0).normal(size=(3, 6))
    moves = np.eye(6) + 0.01 * np.eye(6, k=3)
    matrix, observation, spread, noise, start = (
        jnp.asarray(v, dtype)[..., None] for v in (moves, rows, 1e-6 * np.eye(3), 1e-8 * np.eye(6), 100.0 * np.eye(6))
    )

    def step(cov, _):
        prior = product_transposed(product(matrix, cov), matrix) + noise
        update = updated(prior, observation, jnp.zeros((3, 1), dtype), spread)
        return joseph(prior, update.gain, observation, spread), None

    return np.asarray(jax.lax.scan(step, start, length=steps)[0][..., 0], np.float64)


def test_single_precision_is_near_double_precision_after_nearly_exact_observations():
    exact, rough = covariance(np.float64), covariance(np.float32)
    deviation = np.sqrt(np.diag(exact))
    assert np.abs((rough - exact) / np.outer(deviation, deviation)).max() < 0.05


def test_it_is_the_update_of_joseph():
    rng = np.random.default_rng(1)
    half, rows = rng.normal(size=(4, 4)), rng.normal(size=(2, 4))
    cov, spread = half @ half.T, np.diag([0.5, 2.0])
    gain = rng.normal(size=(4, 2))  # of any gain
    left = np.eye(4) - gain @ rows
    found = joseph(*(jnp.asarray(v)[..., None] for v in (cov, gain, rows, spread)))[..., 0]
    np.testing.assert_allclose(found, left @ cov @ left.T + gain @ spread @ gain.T, atol=1e-12)
