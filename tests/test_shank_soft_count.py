"""A count with a slope: the hard one in the limit, its gradient, and thresholds tuned with it."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from jgait import shank_events, tune
from jgait.shank_events import LOBES, Detector
from jgait.shank_soft_count import TRANSFORMS, Widths, soft_count, weights

RATE, SAMPLES = 50.0, 512
TIME = np.arange(SAMPLES) / RATE
FIDGETS = (0.5, 9.3)


def walk(peaks, width=0.12):
    """Swings of some peak rates [rad/s], and a leg that trembles, and fidgets before and after."""
    rate = 0.02 * np.sin(20.0 * TIME)
    for k, peak in enumerate(peaks):
        at = 1.6 + 1.2 * k
        for bump in (at - 0.45, at + 0.4):  # push-off and landing
            rate += 0.4 * peak * np.exp(-0.5 * ((TIME - bump) / 0.1) ** 2)
        rate -= peak * np.exp(-0.5 * ((TIME - at) / width) ** 2)
    for at in FIDGETS:
        rate -= 0.7 * np.exp(-0.5 * ((TIME - at) / 0.1) ** 2)
    return rate


MIXED = walk([4.0, 2.2, 1.6, 3.0, 0.9, 2.0])
hard = jax.jit(lambda rate, d: jnp.sum(shank_events.swings(rate, RATE, d).stride))
soft = jax.jit(lambda rate, d, widths: soft_count(rate, RATE, d, widths))


@pytest.mark.parametrize("threshold", [10.0, 60.0, 100.0, 150.0, 400.0])
def test_without_width_it_is_the_count(threshold):
    d = LOBES._replace(threshold=np.deg2rad(threshold))
    count = int(hard(MIXED, d))
    assert float(soft(MIXED, d, Widths(1e-6, 1e-6))) == pytest.approx(count, abs=1e-9)
    assert float(soft(MIXED, d, Widths())) == pytest.approx(count, abs=1.5)


def test_each_lobe_counts_once_where_it_ends():
    told = np.asarray(weights(MIXED, RATE))
    found = shank_events.swings(MIXED, RATE)
    assert np.all((told >= 0.0) & (told <= 1.0))
    np.testing.assert_array_equal(told[np.asarray(found.stride)] > 0.5, True)
    assert np.sum(told > 0.5) == int(found.stride.sum())
    behind = np.arange(SAMPLES) < 300
    np.testing.assert_array_equal(weights(MIXED, RATE, measured=behind), np.where(behind, told, 0.0))


def test_the_gradient_is_that_of_finite_differences():
    # a threshold and an angle among those of the lobes, so that all of them matter
    values = np.array([5.0, 1.7, 0.45])

    def count(v):
        return soft_count(MIXED, RATE, LOBES._replace(cutoff_hz=v[0], threshold=v[1], least_angle=v[2]))

    slope = np.asarray(jax.jit(jax.grad(count))(jnp.asarray(values)))
    count = jax.jit(count)
    ends = [[float(count(values + s * 1e-5 * row)) for s in (1.0, -1.0)] for row in np.eye(3)]
    np.testing.assert_allclose(slope, [(a - b) / 2e-5 for a, b in ends], rtol=1e-5)
    assert np.all(np.abs(slope) > 1e-2)
    assert np.all(slope[1:] < 0.0)  # a higher threshold counts less


def test_a_threshold_that_misses_slow_strides_is_mended_by_counts():
    # slow gait: 1.5 to 2.2 rad/s, below the 150 °/s = 2.6 rad/s from which the search starts; fidgets are no strides
    slow = [[1.8, 1.6, 2.0], [1.5, 1.7, 1.9, 1.6, 2.2], [2.1, 1.9, 1.7, 1.8]]
    rates = np.stack([walk(peaks, 0.2) for peaks in slow])
    counts = np.array([3.0, 5.0, 4.0])
    start = Detector(6.0, np.deg2rad(150.0), np.deg2rad(13.0), LOBES.rest_share, LOBES.rest_s)
    count_all = jax.jit(jax.vmap(lambda rate, d: jnp.sum(shank_events.swings(rate, RATE, d).stride), (0, None)))
    np.testing.assert_array_equal(count_all(rates, start), 0)

    def loss(d, item):
        return (soft_count(item[0], RATE, d) - item[1]) ** 2

    found = tune.fit(loss, start, TRANSFORMS, (rates, counts), optax.adam(0.05), steps=40)
    tuned = found.params
    assert found.best_loss < 0.05 * found.losses[0]
    assert np.deg2rad(20.0) < tuned.threshold < np.deg2rad(100.0)
    np.testing.assert_array_equal(count_all(rates, tuned), counts)
    assert tuned.rest_share == LOBES.rest_share  # what is fixed stays


def test_widths_that_are_none_are_refused():
    with pytest.raises(ValueError, match="width of the angle must be positive; got 0"):
        soft_count(MIXED, RATE, widths=Widths(0.1, 0.0))
