"""Ultrasonic ranges between two feet of which one passes the other."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.simulate.sensors import HC_SR04, Ranging, check_ranging, measure_range

RATE = 128.0
T = 1024
TIME = jnp.arange(float(T)) / RATE
X = 0.6 * jnp.sin(2.0 * jnp.pi * 0.9 * TIME)
ZERO = jnp.zeros_like(X)
SENDER = jnp.stack([X, ZERO + 0.18, ZERO + 0.1], axis=1)
RECEIVER = jnp.stack([-X, ZERO, ZERO + 0.1], axis=1)
RIGHT = jnp.asarray(np.tile([0.0, -1.0, 0.0], (T, 1)))
DISTANCE = np.linalg.norm(np.asarray(SENDER - RECEIVER), axis=1)
KEY = jax.random.key(0)

read = jax.jit(measure_range)
PLAIN = Ranging()
ALWAYS = Ranging(rate_hz=1e3, half_angle=np.pi)


def test_pings_come_at_their_rate_and_only_there():
    mask = np.asarray(read(KEY, TIME, SENDER, RECEIVER, RIGHT, Ranging(half_angle=np.pi)).mask)
    exact = np.ceil(np.arange(240) / 30.0 * RATE - 1e-9).astype(int)  # the first sample at or after each
    np.testing.assert_array_equal(np.flatnonzero(mask), exact)
    assert bool(read(KEY, TIME, SENDER, RECEIVER, RIGHT, ALWAYS).mask.all())


@pytest.mark.parametrize("ranging", [PLAIN, Ranging(half_angle=0.7)])
def test_only_a_foot_in_view_has_a_range(ranging):
    readings = read(KEY, TIME, SENDER, RECEIVER, RIGHT, ranging._replace(rate_hz=1e3))
    angle = np.arctan2(np.abs(2.0 * np.asarray(X)), 0.18)
    np.testing.assert_array_equal(readings.mask, angle <= ranging.half_angle)
    assert 0 < int(readings.mask.sum()) < T
    heard = np.asarray(readings.mask)
    np.testing.assert_allclose(np.asarray(readings.distance)[heard], DISTANCE[heard], rtol=0, atol=1e-12)
    assert np.all(np.asarray(readings.distance)[~heard] == 0.0)


def test_a_foot_too_near_or_too_far_has_no_range():
    mask = read(KEY, TIME, SENDER, RECEIVER, RIGHT, ALWAYS._replace(min_distance=0.3, max_distance=0.9)).mask
    np.testing.assert_array_equal(mask, (DISTANCE >= 0.3) & (DISTANCE <= 0.9))
    here = read(KEY, TIME, SENDER, SENDER, RIGHT, ALWAYS)
    assert not bool(here.mask.any())
    assert np.isfinite(here.distance).all()


def test_noise_and_late_echoes_are_as_stated():
    noisy = read(KEY, TIME, SENDER, RECEIVER, RIGHT, ALWAYS._replace(noise=0.002))
    error = np.asarray(noisy.distance) - DISTANCE
    assert error.mean() == pytest.approx(0.0, abs=6 * 0.002 / np.sqrt(T))
    assert error.std() == pytest.approx(0.002, rel=6.0 / np.sqrt(2 * T))
    readings = read(KEY, TIME, SENDER, RECEIVER, RIGHT, ALWAYS._replace(outlier=0.3, outlier_size=0.4))
    error = np.asarray(readings.distance) - DISTANCE
    late = error > 1e-9
    assert np.all(np.abs(error[~late]) < 1e-12)
    assert late.mean() == pytest.approx(0.3, abs=6.0 * np.sqrt(0.21 / T))
    assert error[late].mean() == pytest.approx(0.4, rel=6.0 / np.sqrt(late.sum()))


def test_gradients_flow_to_positions():
    def total(shift):
        sender = SENDER + shift * jnp.array([[0.0, 1.0, 0.0]])
        return jnp.sum(measure_range(KEY, TIME, sender, RECEIVER, RIGHT, HC_SR04).distance)

    heard = np.asarray(read(KEY, TIME, SENDER, RECEIVER, RIGHT, HC_SR04).mask)
    gradient = float(jax.jit(jax.grad(total))(0.0))
    assert gradient == pytest.approx(np.sum(0.18 / DISTANCE[heard]), rel=1e-10)
    same = jax.jit(jax.grad(lambda at: jnp.sum(read(KEY, TIME, at, SENDER, RIGHT, HC_SR04).distance)))(SENDER)
    assert np.isfinite(same).all()


@pytest.mark.parametrize(
    "change, message",
    [
        ({"rate_hz": 0.0}, r"Ranging\.rate_hz must be above 0; got 0"),
        ({"half_angle": 4.0}, r"Ranging\.half_angle must be"),
        ({"min_distance": 5.0}, r"Ranging\.min_distance must be below max_distance; got 5 and 4"),
    ],
)
def test_impossible_sensors_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        check_ranging(PLAIN._replace(**change))
