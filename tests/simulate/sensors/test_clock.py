"""Clocks that are ahead or run fast."""

import jax.numpy as jnp
import numpy as np

from jgait.simulate.sensors import Clock, true_times

TIME = jnp.arange(0.0, 600.0, 0.5)


def test_a_right_clock_changes_nothing():
    np.testing.assert_array_equal(true_times(Clock(), TIME), TIME)


def test_the_clock_shows_at_the_true_time_what_was_asked():
    clock = Clock(offset=0.3, drift=-40e-6)
    true = true_times(clock, TIME)
    np.testing.assert_allclose((1.0 + clock.drift) * true + clock.offset, TIME, rtol=0, atol=1e-10)
    assert float(true[0]) < 0.0  # a clock that is ahead shows a time before it has come


def test_single_precision_keeps_the_correction():
    clock = Clock(drift=20e-6)
    late = TIME.astype(jnp.float32) - true_times(clock, TIME.astype(jnp.float32))
    np.testing.assert_allclose(late, 20e-6 * np.asarray(TIME), rtol=0, atol=6.2e-5)  # the spacing of numbers near 600
