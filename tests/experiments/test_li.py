"""Li's planar stride length on a made shank that swings in its plane."""

import jax
import jax.numpy as jnp
import numpy as np

from experiments.silva2017 import li
from jgait.estimators.ankle_stride.length import StrideLengthParams
from jgait.geometry.vectors import GRAVITY
from jgait.signal.marks import marks

RATE, PERIOD, LENGTH = 200.0, 1.2, 1.3
SAMPLES = int(PERIOD * RATE) + 41
TIME = jnp.arange(SAMPLES, dtype=jnp.float64) / RATE - 0.1
END = 20 + int(PERIOD * RATE)
AT = marks(jnp.asarray([20]), jnp.asarray([END]), SAMPLES)


def rise(u):
    """From 0 to 1, at rest at both ends."""
    v = jnp.clip(u, 0.0, 1.0)
    return v**4 * (35.0 - 84.0 * v + 70.0 * v**2 - 20.0 * v**3)


def test_the_planar_method_needs_an_upright_sensor():
    def sagittal(lean):
        """A shank in its plane, leaning by as much when the stride begins and ends."""
        angle = lean + 0.45 * jnp.sin(2.0 * jnp.pi * TIME / PERIOD)
        gyr = jnp.stack([0 * TIME, 0.9 * jnp.pi / PERIOD * jnp.cos(2.0 * jnp.pi * TIME / PERIOD), 0 * TIME], axis=1)
        push = LENGTH * jax.vmap(jax.grad(jax.grad(lambda t: rise(t / PERIOD))))(TIME)
        forward = push * jnp.cos(angle) - GRAVITY * jnp.sin(angle)
        up = push * jnp.sin(angle) + GRAVITY * jnp.cos(angle)
        acc = jnp.stack([forward, 0 * TIME, up], axis=1)
        return li.planar(StrideLengthParams(), gyr, acc, AT, 1.0 / RATE).length[END]

    np.testing.assert_allclose(sagittal(0.0), LENGTH, atol=1e-3)
    np.testing.assert_allclose(sagittal(0.4), LENGTH * np.cos(0.4), atol=2e-3)
