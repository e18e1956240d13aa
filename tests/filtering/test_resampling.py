"""Laws of resampling: how often a particle goes on, what it then weighs, and what gradient is left."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.filtering import Soft, Systematic, systematic_ancestors
from jgait.filtering.resampling import normalised, resampled

SIZE = 40
KEYS = jax.random.split(jax.random.key(3), 4000)
SCORES = jax.random.normal(jax.random.key(4), (SIZE,), jnp.float64) * 2.0
VALUES = jax.random.normal(jax.random.key(5), (SIZE,), jnp.float64)
WEIGHTS = np.asarray(jax.nn.softmax(SCORES))


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_counts_are_within_one_of_what_is_due_and_right_on_average(dtype):
    ancestors = jax.vmap(lambda key: systematic_ancestors(key, jnp.asarray(WEIGHTS, dtype)))(KEYS)
    counts = np.asarray(jax.vmap(lambda a: jnp.bincount(a, length=SIZE))(ancestors))
    due = SIZE * WEIGHTS
    assert np.all(np.diff(np.asarray(ancestors), axis=1) >= 0)
    assert np.all(np.abs(counts - due) < 1.0)
    spread = np.sqrt(np.modf(due)[0] * (1.0 - np.modf(due)[0]) / len(KEYS))
    assert np.all(np.abs(counts.mean(axis=0) - due) < 6.0 * spread + 1e-6)


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_what_weighs_nothing_is_never_drawn(dtype):
    weights = np.zeros(1000)
    weights[[3, 500, 501, 900]] = 0.1, 1e-3, 0.7, 0.2
    ancestors = jax.vmap(lambda key: systematic_ancestors(key, jnp.asarray(weights, dtype)))(KEYS[:500])
    assert set(np.unique(ancestors)) == {3, 500, 501, 900}


def _sum_after(scores, key, resampling):
    """Σ w'_j g_{a_j}, not normalised: what resampling makes of Σ w_i g_i."""
    log_weights = normalised(scores)
    ancestors, after = resampled(key, log_weights, resampling)
    held = jax.lax.stop_gradient(log_weights)
    if isinstance(resampling, Soft):
        held = jnp.log(resampling.share * jnp.exp(held) + (1.0 - resampling.share) / SIZE)
    weights = jnp.exp(log_weights[ancestors] - held[ancestors]) / SIZE
    return jnp.sum(weights * VALUES[ancestors]), after - jax.lax.stop_gradient(jnp.log(weights))


@pytest.mark.parametrize("resampling", [Systematic(), Soft(0.5), Soft(0.9)], ids=str)
def test_sums_and_their_gradients_are_kept_on_average(resampling):
    run = jax.jit(jax.vmap(jax.value_and_grad(_sum_after, has_aux=True), in_axes=(None, 0, None)), static_argnums=2)
    (sums, ratio), slopes = run(SCORES, KEYS, resampling)
    assert float(jnp.max(jnp.ptp(ratio, axis=1))) < 1e-12  # the library's weights are these, normalised
    value, slope = jax.value_and_grad(lambda s: jnp.sum(jax.nn.softmax(s) * VALUES))(SCORES)
    assert abs(sums.mean() - value) < 6.0 * sums.std() / np.sqrt(len(KEYS))
    assert np.all(np.abs(slopes.mean(axis=0) - slope) < 6.0 * slopes.std(axis=0) / np.sqrt(len(KEYS)))
    assert np.linalg.norm(slopes.mean(axis=0)) > 0.5 * np.linalg.norm(slope)


def test_after_systematic_resampling_all_weigh_the_same_and_soft_spares_the_light():
    scores = normalised(SCORES)
    _, after = resampled(KEYS[0], scores, Systematic())
    np.testing.assert_allclose(after, -np.log(SIZE), rtol=0, atol=1e-12)
    distinct = [
        np.mean([len(np.unique(resampled(key, scores, scheme)[0])) for key in KEYS[:20]])
        for scheme in (Systematic(), Soft(0.5))
    ]
    assert distinct[1] > distinct[0] + 5.0


@pytest.mark.parametrize("share", [0.0, -0.1, 1.1, float("nan"), "half"])
def test_a_share_that_is_none_is_refused(share):
    with pytest.raises(ValueError, match="share above 0"):
        Soft(share)
