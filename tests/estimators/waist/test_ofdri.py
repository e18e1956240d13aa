"""Laws of the integrals of a gait cycle: what the ends pin down, what β and a bias do, which cut-off is the best."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.estimators.waist.ofdri import Cycles, direct_reverse_cycles, placed, signal_and_steps, since, weight
from jgait.estimators.waist.optimum import _least, optimum_cutoffs

DT, SAMPLES = 0.01, 111
TIME = np.arange(SAMPLES) * DT
ACC = jnp.asarray(
    1.2 * np.sin(2.0 * np.pi * TIME / 0.55 + 0.4) + 0.2 + 0.1 * np.random.default_rng(0).standard_normal(SAMPLES)
)
START, END = 1.1, 1.25


def way(velocity, dt=DT):
    return dt * jnp.sum(0.5 * (velocity[1:] + velocity[:-1]))


@pytest.fixture(scope="module")
def both():
    return jax.jit(lambda acc, cutoff, beta, end=END: direct_reverse(acc, START, end, DT, cutoff, beta))


ALL = jnp.ones(SAMPLES, bool)


@jax.jit
def direct(acc, start, dt, cutoff=0.0, mask=None):
    """OFI of one cycle."""
    return start + since(*signal_and_steps(acc, dt, mask), cutoff).change


@jax.jit
def direct_reverse(acc, start, end, dt, cutoff=0.0, beta=0.1, mask=None):
    """OFDRI of one cycle whose first and last velocity are known."""
    found = since(*signal_and_steps(acc, dt, mask), cutoff)
    part = weight(found.time / found.time[-1], beta)
    return start + found.change - part * (start + found.change[-1] - end)


def cutoff_of(acc, change, highest, mask):
    """The cut-off by the optimum rule, of one cycle."""
    data = (*signal_and_steps(acc, DT, mask), jnp.asarray(change, acc.dtype))
    return _least(lambda cutoff, given: since(*given[:2], cutoff).change[-1] - given[2], data, (), highest)


@pytest.fixture(scope="module")
def best():
    compiled = jax.jit(cutoff_of)
    return lambda acc, change, highest=1.0, mask=ALL: compiled(acc, change, highest, mask)


@pytest.fixture(scope="module")
def slope():
    """Gradient of the best cut-off in the signal, the change and the highest."""
    compiled = jax.jit(jax.grad(cutoff_of, (0, 1, 2)))
    return lambda acc, change, highest=1.0, mask=ALL: compiled(acc, change, highest, mask)


def padded(acc):
    """A cycle behind which there is nonsense, and where it is none."""
    more = SAMPLES - len(acc)
    return jnp.concatenate([acc, jnp.full(more, 1e3)]), jnp.arange(SAMPLES) < len(acc)


def test_the_filter_is_the_textbook_recursion_and_nothing_at_zero():
    cutoff, alpha = 0.4, 1.0 / (1.0 + 2.0 * np.pi * 0.4 * DT)
    expected = [float(ACC[0])]
    for before, now in zip(np.asarray(ACC), np.asarray(ACC)[1:], strict=False):
        expected.append(alpha * (expected[-1] + now - before))
    steps = jnp.full(SAMPLES, DT).at[0].set(0.0)
    found = since(ACC, steps, cutoff)
    np.testing.assert_allclose(found.filtered, expected, atol=1e-13)
    sums = np.concatenate([[0.0], np.cumsum(0.5 * DT * (np.array(expected)[1:] + np.array(expected)[:-1]))])
    np.testing.assert_allclose(direct(ACC, START, DT, cutoff), START + sums, atol=1e-13)
    np.testing.assert_array_equal(since(ACC, steps, 0.0).filtered, ACC)


def test_both_ends_are_kept_and_reverse_minus_direct_is_one_number(both):
    for cutoff in (0.0, 0.3):
        ahead = direct(ACC, START, DT, cutoff)
        found = both(ACC, cutoff, 0.1)
        np.testing.assert_allclose([found[0], found[-1]], [START, END], atol=1e-14)
        # What is left between OFDRI and the direct integral is w times that number.
        w = np.asarray(weight(TIME / TIME[-1]))
        gap = (np.asarray(found) - np.asarray(ahead))[1:] / w[1:]
        np.testing.assert_allclose(gap, END - float(ahead[-1]), rtol=1e-9)


def test_the_weight_is_symmetric_and_as_printed():
    s = np.linspace(0.0, 1.0, 31)
    for beta in (0.05, 0.1, 0.4):
        w = np.asarray(weight(s, beta))
        raw = np.arctan((2.0 * s - 1.0) / (2.0 * beta))
        np.testing.assert_allclose(w, (raw - raw[0]) / (raw[-1] - raw[0]), atol=1e-14)
        np.testing.assert_allclose(w + w[::-1], 1.0, atol=1e-14)
    np.testing.assert_allclose(weight(s, 1e4), s, atol=1e-8)


def test_the_way_does_not_depend_on_beta_but_the_velocity_does(both):
    ways = [float(way(both(ACC, 0.2, beta))) for beta in (0.02, 0.1, 0.4, 3.0)]
    np.testing.assert_allclose(ways, ways[0], rtol=1e-13)
    assert np.abs(both(ACC, 0.2, 0.02) - both(ACC, 0.2, 3.0)).max() > 0.01
    assert abs(float(jax.grad(lambda beta: way(both(ACC, 0.2, beta)))(0.1))) < 1e-14


def test_the_best_cutoff_makes_the_residual_zero_where_any_does(best, slope):
    fine = np.linspace(0.0, 1.0, 1001)
    ends = np.asarray(jax.vmap(lambda f: direct(ACC, 0.0, DT, f)[-1])(fine))
    for change in (0.05, 0.15, 0.22):
        found = float(best(ACC, change, 1.0))
        assert 0.0 < found < 1.0
        np.testing.assert_allclose(np.interp(found, fine, ends), change, atol=1e-6)
        # The least of those that do.
        first = np.flatnonzero(np.diff(np.sign(ends - change)))[0]
        assert fine[first] <= found <= fine[first + 1]
        by_signal, by_change, by_highest = slope(ACC, change, 1.0)
        theirs = (best(ACC, change + 1e-6, 1.0) - best(ACC, change - 1e-6, 1.0)) / 2e-6
        np.testing.assert_allclose(by_change, theirs, rtol=1e-6)
        theirs = (best(ACC * (1.0 + 1e-6), change, 1.0) - best(ACC * (1.0 - 1e-6), change, 1.0)) / 2e-6
        np.testing.assert_allclose(jnp.sum(by_signal * ACC), theirs, rtol=1e-6)
        assert float(by_highest) == 0.0


def test_where_none_does_it_is_the_nearest(best, slope):
    # In between: the slope of the residual is zero there.
    inner = float(best(ACC, -0.5, 1.0))
    assert 0.5 < inner < 1.0
    value, flat = jax.jvp(lambda f: direct(ACC, 0.0, DT, f)[-1], (inner,), (1.0,))
    assert float(value) > -0.4 and abs(float(flat)) < 1e-12
    by = jnp.asarray(0.1 * TIME**2)
    theirs = (best(ACC + 1e-5 * by, -0.5, 1.0) - best(ACC - 1e-5 * by, -0.5, 1.0)) / 2e-5
    assert abs(float(theirs)) > 1e-3
    by_signal, by_change, _ = slope(ACC, -0.5, 1.0)
    np.testing.assert_allclose(jnp.sum(by_signal * by), theirs, rtol=1e-6)
    assert abs(float(by_change)) < 1e-14
    # At the ends of the range: no gradient below, that of the range above.
    for change, highest, expected in ((0.5, 1.0, 0.0), (-0.5, 0.3, 1.0)):
        assert float(best(ACC, change, highest)) == (highest if expected else 0.0)
        by_signal, by_change, by_highest = slope(ACC, change, highest)
        assert not np.any(by_signal) and float(by_change) == 0.0 and float(by_highest) == expected


def test_two_roots_between_two_looks_are_found():
    """A residual that dips below zero only from 0.44 to 0.46 Hz is shallower than the grid can see."""
    found = jax.jit(lambda top: _least(lambda f, d: d[0] * ((f - 0.45) ** 2 - 1e-4), (jnp.ones(()),), (), top))(1.0)
    np.testing.assert_allclose(found, 0.44, atol=1e-9)


CYCLES = Cycles(jnp.asarray([5, 115, 240, 0], dtype=jnp.int32), jnp.asarray([115, 225, 345, 0], dtype=jnp.int32), 3)
LONG = jnp.asarray(np.tile(np.asarray(ACC), 4)[:370] * np.linspace(0.8, 1.3, 370))
STARTS, ENDS = jnp.asarray([1.0, 1.2, 0.9, 0.0]), jnp.asarray([1.2, 1.15, 1.0, 0.0])


def test_over_a_recording_each_cycle_is_as_by_itself(best):
    found, cutoffs = jax.jit(recorded)(LONG)
    inside = np.zeros(370, bool)
    for k in range(3):
        b, e = int(CYCLES.begin[k]), int(CYCLES.end[k])
        alone, real = padded(LONG[b : e + 1])
        cutoff = best(alone, ENDS[k] - STARTS[k], 1.0, real)
        np.testing.assert_allclose(cutoffs[k], cutoff, atol=1e-12)
        theirs = direct_reverse(alone, STARTS[k], ENDS[k], DT, cutoff, mask=real)
        np.testing.assert_allclose(found[b + 1 : e + 1], theirs[1 : e + 1 - b], atol=1e-12)
        np.testing.assert_allclose(theirs[e - b :], ENDS[k], atol=1e-14)  # to the end of the padding
        inside[b + 1 : e + 1] = True
    assert float(cutoffs[3]) == 0.0 and np.any(np.asarray(cutoffs) > 0.0)
    np.testing.assert_array_equal(np.asarray(found)[~inside], 0.0)
    np.testing.assert_array_equal(placed(CYCLES, 370).inside, inside)


def recorded(acc):
    cutoffs = optimum_cutoffs(acc, CYCLES, ENDS - STARTS, DT)
    return direct_reverse_cycles(acc, CYCLES, STARTS, ENDS, DT, cutoffs), cutoffs
