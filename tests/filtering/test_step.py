"""Inverses of small matrices, number by number and by halves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.filtering.step import ENTRIES, inverse


def matrices(size: int, count: int = 3) -> np.ndarray:
    """Symmetric positive definite matrices, the batch last."""
    half = np.random.default_rng(size).normal(size=(count, size, size + 3))
    return np.moveaxis(half @ half.transpose(0, 2, 1), 0, -1)


@pytest.mark.parametrize("size", [3, ENTRIES, ENTRIES + 1, 13])
def test_inverses_and_determinants_are_numpys(size):
    s = matrices(size)
    found, log_det, good = jax.jit(inverse)(s)
    rows = np.moveaxis(s, -1, 0)
    np.testing.assert_allclose(np.moveaxis(found, -1, 0), np.linalg.inv(rows), rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(log_det, np.linalg.slogdet(rows)[1], rtol=1e-12)
    np.testing.assert_array_equal(found, jnp.swapaxes(found, 0, 1))
    assert bool(jnp.all(good))
