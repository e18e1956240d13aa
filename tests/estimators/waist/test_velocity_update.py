"""The velocity update on made walks: what it keeps, what it takes out, and that all its ways agree where they must."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.kose2011.ways import frozen, integrated
from jgait.estimators.waist.params import VelocityUpdateParams
from jgait.estimators.waist.velocity_update import Cycles, updated

DT, SAMPLES, PERIOD, FIRST = 0.01, 1100, 105, 180
TIME = np.arange(SAMPLES) * DT
MARKS = FIRST + PERIOD * np.arange(9)
CYCLES = Cycles(jnp.asarray([*MARKS[:-1], 0, 0], dtype=jnp.int32), jnp.asarray([*MARKS[1:], 0, 0], dtype=jnp.int32), 8)
P = VelocityUpdateParams()


def ramp(at, width):
    """From 0 to 1, centred at a time [s], smooth."""
    return 0.5 * (1.0 + np.tanh((TIME - at) / width))


def speed(step=0.0, wave=0.15):
    """Standing, 1.2 m/s, and half a metre a second faster from the end of the fourth cycle on; a wave each step."""
    on = ramp(0.8, 0.12)
    middle = (MARKS[4] + 0.5 * PERIOD) * DT
    return on * (1.2 + wave * np.sin(4.0 * np.pi * (TIME - FIRST * DT) / (PERIOD * DT))) + step * ramp(middle, 0.08)


def way(velocity):
    return np.concatenate([[0.0], np.cumsum(0.5 * DT * (velocity[1:] + velocity[:-1]))])


WALK, FASTER = (jnp.asarray(np.gradient(speed(step), DT)) for step in (0.0, 0.5))


@pytest.fixture(scope="module")
def methods():
    return {
        "hard": jax.jit(lambda p, acc: updated(p, acc, CYCLES, DT, optimum=False)),
        "optimum": jax.jit(lambda p, acc: updated(p, acc, CYCLES, DT)),
        "frozen": jax.jit(lambda p, acc: frozen(p, acc, CYCLES, DT, optimum=False)),
        "integrated": jax.jit(lambda p, acc: integrated(p, acc, CYCLES, DT)),
    }


def test_without_errors_all_are_the_walk(methods):
    true = speed()
    for name, method in methods.items():
        found = method(P, WALK)
        # Trapezoids of a sampled acceleration: a few mm/s.
        np.testing.assert_allclose(found.velocity, true - true[0], atol=0.01, err_msg=name)
        np.testing.assert_allclose(found.displacement, way(np.asarray(found.velocity)), atol=1e-12)
        lengths = np.asarray(found.displacement)[MARKS[1:]] - np.asarray(found.displacement)[MARKS[:-1]]
        np.testing.assert_allclose(found.length[:8], lengths, atol=1e-13)
        np.testing.assert_allclose(found.length[:8], 1.2 * PERIOD * DT, rtol=0.01)


def test_the_recursion_is_the_papers(methods):
    """A loop in plain words, with noise and cycles of different length that leave a gap."""
    acc = np.asarray(FASTER) + 0.4 * np.random.default_rng(1).standard_normal(SAMPLES)
    begin, end = MARKS[:-1].copy(), MARKS[1:].copy()
    begin[3] += 20
    cycles = Cycles(jnp.asarray(begin, jnp.int32), jnp.asarray(end, jnp.int32), 8)
    found = jax.jit(lambda a: updated(P, a, cycles, DT, 0.1, optimum=False))(jnp.asarray(acc))

    def changes(a, b):
        return way(acc[a : b + 1])

    velocity, v, at, told = np.full(SAMPLES, 0.1), 0.1, 0, []
    for k, (a, b) in enumerate(zip(begin, end, strict=True)):
        velocity[at : a + 1] = v + changes(at, a)
        v = velocity[a]
        j = changes(a, b)
        s = np.arange(b - a + 1) / (b - a)
        w = 0.5 + np.arctan((s - 0.5) / 0.1) / (2.0 * np.arctan(5.0))
        keep = k > 1 and abs(j[-1]) < 0.3
        velocity[a : b + 1] = v + j - (w * j[-1] if keep else 0.0)
        v, at = velocity[b], b
        told.append(not keep)
    velocity[at:] = v + changes(at, SAMPLES - 1)
    np.testing.assert_array_equal(found.updated, told)
    assert 1 < sum(told) < 8
    np.testing.assert_allclose(found.velocity, velocity, atol=1e-11)
    np.testing.assert_allclose(found.displacement, way(velocity), atol=1e-10)
