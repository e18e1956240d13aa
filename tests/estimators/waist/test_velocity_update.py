"""The velocity update on made walks: what it keeps, what it takes out, and that all its ways agree where they must; and
laws of the integrals of a gait cycle: what the ends pin down, what β and a bias do, which cut-off is the best.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.kose2011.ways import frozen, integrated
from jgait.estimators.waist.params import VelocityUpdateParams
from jgait.estimators.waist.velocity_update import (
    Cycles,
    direct_reverse_cycles,
    optimum_cutoffs,
    signal_and_steps,
    since,
    updated,
    weight,
)

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


CYCLE = 111
WITHIN = np.arange(CYCLE) * DT
NOISY = jnp.asarray(
    1.2 * np.sin(2.0 * np.pi * WITHIN / 0.55 + 0.4) + 0.2 + 0.1 * np.random.default_rng(0).standard_normal(CYCLE)
)
START, END = 1.1, 1.25
STEPS = signal_and_steps(NOISY, DT)[1]
ONE = Cycles(jnp.asarray([0], jnp.int32), jnp.asarray([CYCLE - 1], jnp.int32), 1)


@jax.jit
def direct(acc, cutoff):
    """OFI of one cycle."""
    return START + since(acc, STEPS, cutoff).change


@jax.jit
def both(acc, cutoff, beta):
    """OFDRI of one cycle, at all samples but the first."""
    return direct_reverse_cycles(acc, ONE, START, END, DT, cutoff, beta)[1:]


@jax.jit
def best(acc, change, highest=1.0):
    """The cut-off by the optimum rule, of one cycle."""
    return optimum_cutoffs(acc, ONE, change, DT, highest)[0]


def test_the_filter_is_the_textbook_recursion_and_nothing_at_zero():
    cutoff, alpha = 0.4, 1.0 / (1.0 + 2.0 * np.pi * 0.4 * DT)
    expected = [float(NOISY[0])]
    for before, now in zip(np.asarray(NOISY), np.asarray(NOISY)[1:], strict=False):
        expected.append(alpha * (expected[-1] + now - before))
    np.testing.assert_allclose(since(NOISY, STEPS, cutoff).filtered, expected, atol=1e-13)
    sums = np.concatenate([[0.0], np.cumsum(0.5 * DT * (np.array(expected)[1:] + np.array(expected)[:-1]))])
    np.testing.assert_allclose(direct(NOISY, cutoff), START + sums, atol=1e-13)
    np.testing.assert_array_equal(since(NOISY, STEPS, 0.0).filtered, NOISY)


def test_both_ends_are_kept_and_the_way_does_not_depend_on_beta():
    for cutoff in (0.0, 0.3):
        ahead, found = direct(NOISY, cutoff), both(NOISY, cutoff, 0.1)
        assert float(found[-1]) == pytest.approx(END, abs=1e-14)
        # what is left between OFDRI and the direct integral is w times one number
        gap = (np.asarray(found) - np.asarray(ahead)[1:]) / np.asarray(weight(WITHIN / WITHIN[-1]))[1:]
        np.testing.assert_allclose(gap, END - float(ahead[-1]), rtol=1e-9)

    def way(beta):
        velocity = jnp.concatenate([jnp.asarray([START]), both(NOISY, 0.2, beta)])
        return DT * jnp.sum(0.5 * (velocity[1:] + velocity[:-1]))

    np.testing.assert_allclose([way(beta) for beta in (0.02, 0.1, 0.4)], way(3.0), rtol=1e-13)
    assert np.abs(both(NOISY, 0.2, 0.02) - both(NOISY, 0.2, 3.0)).max() > 0.01
    assert abs(float(jax.grad(way)(0.1))) < 1e-14


@pytest.mark.parametrize("change", [0.05, 0.15, 0.22])
def test_the_best_cutoff_makes_the_residual_zero_where_any_does(change):
    fine = np.linspace(0.0, 1.0, 1001)
    ends = np.asarray(jax.vmap(lambda f: direct(NOISY, f)[-1])(fine)) - START
    found = float(best(NOISY, change))
    np.testing.assert_allclose(np.interp(found, fine, ends), change, atol=1e-6)
    first = np.flatnonzero(np.diff(np.sign(ends - change)))[0]
    assert 0.0 < fine[first] <= found <= fine[first + 1] < 1.0


def test_where_none_does_it_is_the_nearest():
    inner = float(best(NOISY, -0.5))  # in between, where the slope of the residual is zero
    _, flat = jax.jvp(lambda f: direct(NOISY, f)[-1], (inner,), (1.0,))
    assert 0.5 < inner < 1.0 and abs(float(flat)) < 1e-12
    for change, highest, expected in ((0.5, 1.0, 0.0), (-0.5, 0.3, 1.0)):
        assert float(best(NOISY, change, highest)) == highest * expected
