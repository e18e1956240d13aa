"""Stationary wavelet transforms against pywavelets', their laws, and the paper's thresholds."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import pywt

from jgait.signal import wavelet

RNG = np.random.default_rng(0)
X = RNG.normal(size=1024)
SHARES = (1 / 5, 1 / 4, 1 / 3)


@pytest.mark.parametrize(("name", "levels"), [("haar", 1), ("db5", 10), ("sym4", 3), ("bior2.4", 3)])
def test_there_and_back_as_pywavelets(name, levels):
    expected = pywt.swt(X, name, level=levels)
    ours = wavelet.transform(X, name, levels)
    np.testing.assert_allclose(ours.approximation, expected[0][0], rtol=0.0, atol=1e-12)
    for detail, (_, theirs) in zip(ours.details, reversed(expected), strict=True):
        np.testing.assert_allclose(detail, theirs, rtol=0.0, atol=1e-12)
    # Not a transform of any signal: the ways back differ, and the mean of them is taken.
    changed = [(RNG.normal(size=X.size), RNG.normal(size=X.size)) for _ in expected]
    made = wavelet.Decomposition(jnp.asarray(changed[0][0]), tuple(jnp.asarray(d) for _, d in reversed(changed)))
    np.testing.assert_allclose(wavelet.inverse(made, name), pywt.iswt(changed, name), rtol=0.0, atol=1e-12)


def test_three_levels_give_exactly_what_ten_give():
    three, ten = wavelet.transform(X, "db5", 3), wavelet.transform(X, "db5", 10)
    nothing = jnp.zeros_like(X)
    for detail, same in zip(three.details, ten.details[:3], strict=True):
        np.testing.assert_array_equal(detail, same)
    few = wavelet.inverse(wavelet.Decomposition(nothing, three.details), "db5")
    many = wavelet.inverse(wavelet.Decomposition(nothing, ten.details[:3] + (nothing,) * 7), "db5")
    np.testing.assert_array_equal(few, many)


def by_pywavelets(x, relative_to, hard):
    """The paper's filter with ten levels, in plain NumPy."""
    more = -len(x) % 1024
    before = more // 2
    padded = np.pad(x, (before, more - before), mode="symmetric")
    rows = []
    for level, (approximation, d) in zip(range(10, 0, -1), pywt.swt(padded, "db5", level=10), strict=True):
        kept, inside = np.zeros_like(d), d[before : before + len(x)]
        if level <= 3:
            size = np.abs(inside).max() if relative_to == "max" else np.sqrt(np.mean(inside**2))
            kept = pywt.threshold(d, SHARES[level - 1] * size, "hard" if hard else "soft")
        rows.append((np.zeros_like(approximation), kept))
    return pywt.iswt(rows, "db5")[before : before + len(x)]


@pytest.mark.parametrize(("relative_to", "hard"), [("max", True), ("rms", False)])
def test_details_thresholded_as_with_ten_levels_of_pywavelets(relative_to, hard):
    ours = wavelet.from_details(X[:700], SHARES, relative_to=relative_to, hard=hard)
    np.testing.assert_allclose(ours, by_pywavelets(X[:700], relative_to, hard), rtol=0.0, atol=1e-12)


def test_magnitudes_count_what_the_mask_counts():
    mask = np.arange(6) < 4
    x = np.array([3.0, -4.0, 0.0, 0.0, 100.0, 100.0])
    assert float(wavelet.magnitude(x, "max", mask)) == 4.0
    assert float(wavelet.magnitude(x, "rms", mask)) == 2.5
    assert float(wavelet.magnitude(x, "rms", np.zeros(6, bool))) == 0.0
    assert np.isfinite(jax.grad(lambda y: wavelet.magnitude(y, "rms"))(np.zeros(6))).all()


@pytest.mark.parametrize("samples", [5, 700, 1024])
def test_padding_is_symmetric_and_takes_turns_when_short(samples):
    ours, before = wavelet.padded(X[:samples])
    more = 1024 - samples
    np.testing.assert_array_equal(ours, np.pad(X[:samples], (more // 2, more - more // 2), mode="symmetric"))
    assert before == more // 2


def test_a_signal_that_cannot_be_transformed_is_refused_with_the_reason():
    with pytest.raises(ValueError, match="3 levels need a multiple of 8 samples along the first axis; got 1023"):
        wavelet.transform(X[:1023], "db5", 3)
    with pytest.raises(ValueError, match="got 'morl'"):
        wavelet.transform(X, "morl", 3)
    with pytest.raises(ValueError, match="levels must be at least 1; got 0"):
        wavelet.transform(X, "db5", 0)
    with pytest.raises(ValueError, match="floating point; got int64"):
        wavelet.transform(np.arange(8), "db5", 1)
    with pytest.raises(ValueError, match="all of the approximation's shape"):
        wavelet.inverse(wavelet.Decomposition(X, (X[:512],)), "db5")
    with pytest.raises(ValueError, match="max, rms; got 'mean'"):
        wavelet.magnitude(X, "mean")
