"""Foot switches and insoles over a few steps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.simulate.sensors import FootSwitch, Insole, check_contact, measure_insole, measure_switch

RATE = 100.0
TIME = jnp.arange(500.0) / RATE
HEEL = jnp.clip(jnp.sin(2.0 * jnp.pi * TIME), 0.0, 1.0)
TOE = jnp.clip(jnp.sin(2.0 * jnp.pi * TIME - 0.8), 0.0, 1.0)
KEY = jax.random.key(0)

switched, pressed = jax.jit(measure_switch), jax.jit(measure_insole)


def test_a_switch_is_closed_above_its_threshold():
    closed = switched(KEY, TIME, HEEL, FootSwitch(threshold=0.3))
    assert closed.dtype == jnp.bool_
    np.testing.assert_array_equal(closed, HEEL > 0.3)


def test_a_late_switch_says_what_was():
    on_time, late = (np.asarray(switched(KEY, TIME, HEEL, FootSwitch(0.3, delay=delay))) for delay in (0.0, 0.05))
    np.testing.assert_array_equal(late[5:], on_time[:-5])


def test_hysteresis_opens_later_than_it_closes():
    closed = np.asarray(switched(KEY, TIME, HEEL, FootSwitch(0.5, hysteresis=0.3)))
    expected, state = [], False
    for load in np.asarray(HEEL):
        state = load > 0.5 or (state and load > 0.5 - 0.3)
        expected.append(state)
    np.testing.assert_array_equal(closed, expected)
    assert not np.array_equal(closed, np.asarray(HEEL) > 0.5)


def test_chatter_is_confined_to_the_time_after_a_change():
    clean, noisy = (np.asarray(switched(KEY, TIME, HEEL, FootSwitch(0.3, chatter=c))) for c in (0.0, 0.095))
    changes = np.flatnonzero(np.diff(clean.astype(int))) + 1
    near = np.zeros_like(clean)
    for change in changes:
        near[change : change + 10] = True
    np.testing.assert_array_equal(noisy[~near], clean[~near])
    flipped = (noisy != clean)[near]
    assert flipped.mean() == pytest.approx(0.5, abs=3.0 / np.sqrt(flipped.size))


def test_a_perfect_insole_reads_the_loads():
    pressure = pressed(KEY, HEEL, TOE, Insole(gain=200.0))
    np.testing.assert_allclose(pressure.heel, 200.0 * HEEL, atol=1e-12)
    np.testing.assert_allclose(pressure.toe, 200.0 * TOE, atol=1e-12)
    np.testing.assert_allclose(pressure.midfoot, 200.0 * HEEL * TOE, atol=1e-12)


def test_noise_gain_and_offset_of_the_cells():
    ones = jnp.ones(400)
    noise = np.asarray(jnp.stack(pressed(KEY, ones, ones, Insole(noise=0.05)))) - 1.0
    assert noise.std() == pytest.approx(0.05, rel=6.0 / np.sqrt(2 * noise.size))
    keys, few = jax.random.split(KEY, 200), jnp.ones(2)
    for insole in (Insole(gain_error=0.1), Insole(offset=0.1)):
        cells = np.stack(jax.jit(jax.vmap(measure_insole, in_axes=(0, None, None, None)))(keys, few, few, insole)) - 1.0
        assert np.ptp(cells, axis=2).max() < 1e-12
        assert cells[..., 0].std() == pytest.approx(0.1, rel=6.0 / np.sqrt(2 * cells[..., 0].size))
    swing = jnp.stack(pressed(KEY, 0.0 * ones, 0.0 * ones, Insole(noise=0.05)))
    assert float(swing.min()) == 0.0 and float(swing.max()) > 0.0


def test_a_smooth_load_has_the_gradient_of_the_gain():
    def total(load):
        return jnp.sum(measure_insole(KEY, load, TOE, Insole(gain=3.0)).heel)

    np.testing.assert_allclose(jax.grad(total)(HEEL + 0.1), 3.0)


def test_impossible_ones_are_refused():
    check_contact(FootSwitch())
    check_contact(Insole())
    with pytest.raises(ValueError, match=r"FootSwitch\.threshold must be .*\[0, 1\]; got 2"):
        check_contact(FootSwitch(threshold=2.0))
    with pytest.raises(ValueError, match=r"Insole\.noise must be .*; got -1"):
        check_contact(Insole(noise=-1.0))
