"""Laws of the integrals of a gait cycle: what the ends pin down, what β and a bias do, which cut-off is the best."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.estimators.waist.velocity_update import (
    Cycles,
    direct_reverse_cycles,
    optimum_cutoffs,
    signal_and_steps,
    since,
    weight,
)

DT, SAMPLES = 0.01, 111
TIME = np.arange(SAMPLES) * DT
ACC = jnp.asarray(
    1.2 * np.sin(2.0 * np.pi * TIME / 0.55 + 0.4) + 0.2 + 0.1 * np.random.default_rng(0).standard_normal(SAMPLES)
)
START, END = 1.1, 1.25
STEPS = signal_and_steps(ACC, DT)[1]
ONE = Cycles(jnp.asarray([0], jnp.int32), jnp.asarray([SAMPLES - 1], jnp.int32), 1)


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
    expected = [float(ACC[0])]
    for before, now in zip(np.asarray(ACC), np.asarray(ACC)[1:], strict=False):
        expected.append(alpha * (expected[-1] + now - before))
    np.testing.assert_allclose(since(ACC, STEPS, cutoff).filtered, expected, atol=1e-13)
    sums = np.concatenate([[0.0], np.cumsum(0.5 * DT * (np.array(expected)[1:] + np.array(expected)[:-1]))])
    np.testing.assert_allclose(direct(ACC, cutoff), START + sums, atol=1e-13)
    np.testing.assert_array_equal(since(ACC, STEPS, 0.0).filtered, ACC)


def test_both_ends_are_kept_and_the_way_does_not_depend_on_beta():
    for cutoff in (0.0, 0.3):
        ahead, found = direct(ACC, cutoff), both(ACC, cutoff, 0.1)
        assert float(found[-1]) == pytest.approx(END, abs=1e-14)
        # what is left between OFDRI and the direct integral is w times one number
        gap = (np.asarray(found) - np.asarray(ahead)[1:]) / np.asarray(weight(TIME / TIME[-1]))[1:]
        np.testing.assert_allclose(gap, END - float(ahead[-1]), rtol=1e-9)

    def way(beta):
        velocity = jnp.concatenate([jnp.asarray([START]), both(ACC, 0.2, beta)])
        return DT * jnp.sum(0.5 * (velocity[1:] + velocity[:-1]))

    np.testing.assert_allclose([way(beta) for beta in (0.02, 0.1, 0.4)], way(3.0), rtol=1e-13)
    assert np.abs(both(ACC, 0.2, 0.02) - both(ACC, 0.2, 3.0)).max() > 0.01
    assert abs(float(jax.grad(way)(0.1))) < 1e-14


@pytest.mark.parametrize("change", [0.05, 0.15, 0.22])
def test_the_best_cutoff_makes_the_residual_zero_where_any_does(change):
    fine = np.linspace(0.0, 1.0, 1001)
    ends = np.asarray(jax.vmap(lambda f: direct(ACC, f)[-1])(fine)) - START
    found = float(best(ACC, change))
    np.testing.assert_allclose(np.interp(found, fine, ends), change, atol=1e-6)
    first = np.flatnonzero(np.diff(np.sign(ends - change)))[0]
    assert 0.0 < fine[first] <= found <= fine[first + 1] < 1.0


def test_where_none_does_it_is_the_nearest():
    inner = float(best(ACC, -0.5))  # in between, where the slope of the residual is zero
    _, flat = jax.jvp(lambda f: direct(ACC, f)[-1], (inner,), (1.0,))
    assert 0.5 < inner < 1.0 and abs(float(flat)) < 1e-12
    for change, highest, expected in ((0.5, 1.0, 0.0), (-0.5, 0.3, 1.0)):
        assert float(best(ACC, change, highest)) == highest * expected
