"""Sine and cosine as polynomials, against higher precision."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.geometry.trigonometry import sincos

LIMITS = {
    np.float32: [(6433.0, 1.0e-7), (6e6, None)],
    np.float64: [(1.6e6, 2.1e-16), (3e15, None)],
}


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_errors_are_as_small_as_stated(kind):
    rng = np.random.default_rng(0)
    # As users compile it: beyond 1000 turns the error is that of rounding x only with fused multiply-adds.
    function = jax.jit(sincos, compiler_options={"xla_backend_optimization_level": 3})
    for limit, error in LIMITS[kind]:
        for reach in np.geomspace(1e-3, limit, 8):
            x = np.concatenate([rng.uniform(-reach, reach, 100_000), [0.0, reach, -reach]]).astype(kind)
            near = (np.round(x / (np.pi / 2)) * (np.pi / 2)).astype(kind)  # where a sine or cosine is nearly 0
            for values in (x, near[np.abs(near) <= limit]):
                exact = values.astype(np.longdouble)
                allowed = error if error is not None else 0.5 * np.spacing(kind(reach)) + 2 * np.finfo(kind).eps
                for ours, true in zip(function(values), (np.sin(exact), np.cos(exact)), strict=True):
                    assert ours.dtype == kind
                    assert float(np.max(np.abs(np.asarray(ours) - true))) <= allowed


@pytest.mark.parametrize("kind", [jnp.float32, jnp.float64])
def test_large_and_infinite_arguments(kind):
    sine, cosine = sincos(jnp.asarray([1e20, -1e30, jnp.inf, -jnp.inf, jnp.nan], kind))
    assert bool(jnp.all(jnp.abs(sine[:2]) <= 1.0 + 1e-6)) and bool(jnp.all(jnp.abs(cosine[:2]) <= 1.0 + 1e-6))
    assert bool(jnp.all(jnp.isnan(sine[2:]))) and bool(jnp.all(jnp.isnan(cosine[2:])))


@pytest.mark.parametrize("kind", [jnp.float32, jnp.float64])
def test_derivatives_are_cosine_and_minus_sine_in_every_mode(kind):
    x = jnp.asarray(np.random.default_rng(1).uniform(-50.0, 50.0, 200), kind)
    sine, cosine = jax.jit(sincos)(x)
    for which, expected in ((0, cosine), (1, -sine)):

        def one(v, which=which):
            return sincos(v)[which]

        for derivative in (jax.grad, jax.jacfwd):
            np.testing.assert_array_equal(jax.jit(jax.vmap(derivative(one)))(x), expected)
        np.testing.assert_allclose(jax.jit(jax.vmap(jax.grad(jax.grad(one))))(x), -one(x), atol=1e-6)


def test_other_types_are_refused():
    with pytest.raises(ValueError, match="sincos needs float32 or float64; got float16"):
        sincos(jnp.zeros(3, jnp.float16))
