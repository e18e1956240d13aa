"""Masks that are False for good take observations out of the model; filtering and smoothing with one kind of result."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filtering.problems import case

from jgait import filtering
from jgait.estimators.leg_ekf import model as leg_model

SAMPLES = 30
_, PARAMS, OBSERVATIONS, CONTROLS, _, _ = case("leg", SAMPLES, masked=False)
HERE = np.ones(SAMPLES, bool)


def masks(gone):
    """Gyroscopes there, the closure never, the inclinations now and then."""
    some = jnp.asarray(np.arange(SAMPLES) % 3 == 0)
    return leg_model.LegObservation(HERE, HERE, gone, gone, some, some)


@pytest.mark.parametrize("smooth", [False, True])
def test_hidden_for_good_is_masked_everywhere(smooth):
    def infer(mask):
        return filtering.infer(
            leg_model.MODEL, PARAMS, OBSERVATIONS, smooth=smooth, controls=CONTROLS, dt=0.02, mask=mask,
            keep=(*filtering.SUMMARY, "innovation"),
        )  # fmt: skip

    hidden, masked = infer(masks(False)), infer(masks(~HERE))
    for ours, theirs in ((hidden.mean, masked.mean), (hidden.cov, masked.cov)):
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12), ours, theirs)
    for name in ("log_likelihood", "nis"):
        np.testing.assert_allclose(getattr(hidden, name), getattr(masked, name), rtol=1e-9)
    innovation = hidden.filtered.innovation
    assert innovation.closure_x is None and innovation.closure_y is None
    np.testing.assert_allclose(innovation.thigh_gyro, masked.filtered.innovation.thigh_gyro, rtol=1e-9, atol=1e-12)
