"""Butterworth filters against SciPy's, online against offline, and their gradients in the cut-off."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal as scipy_signal

from jgait.signal import butterworth

RATE = 100.0
X = np.cumsum(np.random.default_rng(0).normal(size=(150, 2)), axis=0)


@pytest.mark.parametrize("of", [np.asarray, jnp.asarray])
@pytest.mark.parametrize("cutoff", [4.0, 12.5])
def test_both_ways_equals_scipy(cutoff, of):
    ours = butterworth.low_pass_both_ways(of(X), cutoff, RATE)
    b, a = scipy_signal.butter(2, cutoff, fs=RATE)
    np.testing.assert_allclose(ours, scipy_signal.filtfilt(b, a, X, axis=0), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("of", [np.asarray, jnp.asarray])
def test_causal_equals_scipy_from_rest(of):
    sos = scipy_signal.butter(2, 4.0, fs=RATE, output="sos")
    zi = scipy_signal.sosfilt_zi(sos)[:, :, None] * X[0]
    expected = scipy_signal.sosfilt(sos, X, axis=0, zi=zi)[0]
    np.testing.assert_allclose(butterworth.low_pass(of(X), 4.0, RATE), expected, rtol=1e-10, atol=1e-10)


def test_sample_by_sample_as_over_the_recording():
    cascade = butterworth.section(4.0, RATE)
    state, online = butterworth.at_rest(cascade, X[0]), []
    step = jax.jit(butterworth.step)
    for sample in X:
        state, value = step(cascade, state, sample)
        online.append(value)
    np.testing.assert_allclose(online, butterworth.low_pass(jnp.asarray(X), 4.0, RATE), rtol=1e-12, atol=1e-12)


def test_a_ramp_leaves_late_by_the_delay():
    ramp = np.arange(400) / RATE
    late = ramp[-1] - butterworth.low_pass(ramp, 4.0, RATE)[-1]
    np.testing.assert_allclose(butterworth.delay(4.0, RATE), late, rtol=1e-8)


def test_a_signal_that_cannot_be_filtered_is_refused_with_the_reason():
    with pytest.raises(ValueError, match="half the sampling rate of 100 Hz; got 60"):
        butterworth.low_pass(X, 60.0, RATE)
    with pytest.raises(ValueError, match="at least 10 samples"):
        butterworth.low_pass_both_ways(X[:9], 4.0, RATE)
    with pytest.raises(ValueError, match="floating point; got int64"):
        butterworth.low_pass(np.arange(20), 4.0, RATE)
