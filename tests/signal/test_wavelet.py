"""A signal rebuilt from wavelet details, against ten levels of pywavelets'."""

import jax
import numpy as np
import pytest
import pywt

from jgait.signal.wavelet import from_details

X = np.random.default_rng(0).normal(size=1024)
SHARES = (1 / 5, 1 / 4, 1 / 3)


def by_pywavelets(x, relative_to, hard, mask):
    """The paper's filter with ten levels, in plain NumPy."""
    more = -len(x) % 1024
    before = more // 2
    padded = np.pad(x, (before, more - before), mode="symmetric")
    rows = []
    for level, (approximation, d) in zip(range(10, 0, -1), pywt.swt(padded, "db5", level=10), strict=True):
        kept, inside = np.zeros_like(d), d[before : before + len(x)][mask]
        if level <= 3:
            size = np.abs(inside).max() if relative_to == "max" else np.sqrt(np.mean(inside**2))
            kept = pywt.threshold(d, SHARES[level - 1] * size, "hard" if hard else "soft")
        rows.append((np.zeros_like(approximation), kept))
    return pywt.iswt(rows, "db5")[before : before + len(x)]


@pytest.mark.parametrize("samples", [5, 700, 1024])
@pytest.mark.parametrize(("relative_to", "hard"), [("max", True), ("rms", False)])
def test_details_thresholded_as_with_ten_levels_of_pywavelets(relative_to, hard, samples):
    mask = np.arange(samples) % 7 > 0
    ours = from_details(X[:samples], SHARES, relative_to=relative_to, hard=hard, mask=mask)
    np.testing.assert_allclose(ours, by_pywavelets(X[:samples], relative_to, hard, mask), rtol=0.0, atol=1e-12)


def test_gradients_are_finite_where_nothing_counts():
    for signal, mask in ((np.zeros(8), np.ones(8, bool)), (X[:8], np.zeros(8, bool))):
        slope = jax.grad(lambda x, mask=mask: from_details(x, SHARES, mask=mask).sum())(signal)
        assert np.isfinite(slope).all()


def test_what_cannot_be_transformed_is_refused_with_the_reason():
    with pytest.raises(ValueError, match="floating point; got int64"):
        from_details(np.arange(8), SHARES)
    with pytest.raises(ValueError, match="max, rms; got 'mean'"):
        from_details(X, SHARES, relative_to="mean")
