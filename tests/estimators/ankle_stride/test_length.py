"""Stride lengths of a made shank whose path is known, and the laws that they obey."""

import jax
import jax.numpy as jnp
import numpy as np

from jgait.estimators.ankle_stride import length as stride_length
from jgait.estimators.ankle_stride.length import StrideLengthParams
from jgait.geometry.rotation import turn
from jgait.geometry.vectors import GRAVITY, Vector
from jgait.signal.marks import marks

RATE, PERIOD, LENGTH, RISE, HEADING = 200.0, 1.2, 1.3, 0.06, 0.3
LEVER = jnp.asarray([0.02, -0.03, 0.18])
SAMPLES = int(2 * PERIOD * RATE) + 41
TIME = jnp.arange(SAMPLES, dtype=jnp.float64) / RATE - 0.1
BEGIN = 20 + jnp.asarray([0, int(PERIOD * RATE)])
END = BEGIN + int(PERIOD * RATE)
AT = marks(BEGIN, END, SAMPLES)


def step(u):
    """From 0 to 1, at rest at both ends, and the whole strides before."""
    whole = jnp.floor(u)
    v = u - whole
    return whole + v**4 * (35.0 - 84.0 * v + 70.0 * v**2 - 20.0 * v**3)


def attitude(time):
    """Pitch that keeps turning at the ends (the shank rolls over the foot), some roll, and a turn to the left."""
    u = time / PERIOD
    pitch = 0.1 + 0.45 * jnp.sin(2.0 * jnp.pi * u)
    yaw, roll = HEADING * step(u), 0.05 * jnp.sin(4.0 * jnp.pi * u)
    return (
        turn(jnp.asarray([0.0, 0.0, 1.0]), yaw)
        @ turn(jnp.asarray([0.0, 1.0, 0.0]), pitch)
        @ turn(jnp.asarray([1.0, 0.0, 0.0]), roll)
    )


def place(time):
    """The sensor: the ankle stands at whole strides and goes straight on between them."""
    u = time / PERIOD
    lift = 0.1 * jnp.sin(jnp.pi * u) ** 4
    ankle = jnp.stack([LENGTH * step(u), jnp.zeros_like(u), RISE * step(u) + lift])
    return ankle + attitude(time) @ LEVER


def felt(time):
    """What a sensor there reads."""
    axes, rate = attitude(time), jax.jacfwd(attitude)(time)
    spin = axes.T @ rate
    gyr = jnp.stack([spin[2, 1], spin[0, 2], spin[1, 0]])
    acc = jax.jacfwd(jax.jacfwd(place))(time) + jnp.asarray([0.0, 0.0, GRAVITY])
    return gyr, axes.T @ acc


GYR, ACC = jax.jit(jax.vmap(felt))(TIME)
P = StrideLengthParams(lever=Vector(*LEVER))
inertial = jax.jit(stride_length.inertial)


def test_the_known_path_is_measured():
    told = jax.tree.map(lambda v: v[END], inertial(P, GYR, ACC, AT, 1.0 / RATE))
    np.testing.assert_allclose(told.level, LENGTH, atol=1e-3)
    np.testing.assert_allclose(told.rise, RISE, atol=1e-3)
    np.testing.assert_allclose(told.length, np.hypot(LENGTH, RISE), atol=1e-3)
    np.testing.assert_allclose(told.turn, HEADING, atol=5e-3)  # `up` is no better than the integral of a sampled force
    np.testing.assert_allclose(told.duration, PERIOD, rtol=1e-12)


def swing(angle, samples):
    """A sagittal rate that turns by an angle, forwards, in so many samples, its ends at zero."""
    lobe = np.sin(np.pi * np.arange(samples + 1) / samples)
    return -angle * lobe / (lobe.sum() / RATE)


def test_pendulum_knows_the_angle_of_each_swing():
    rate = np.concatenate([np.zeros(10), swing(1.0, 60), np.zeros(30), swing(1.2, 80), np.zeros(5)])
    gyr = np.stack([0.3 + 0 * rate, rate, 0 * rate], axis=1)
    starts, ends = np.array([10, 101]), np.array([70, 181])
    at = marks(starts, ends, len(rate))
    p = StrideLengthParams(leg_length=0.9, angle_gain=0.88, time_gain=0.1)
    told = jax.tree.map(lambda v: v[ends], stride_length.pendulum(p, gyr, at, 1.0 / RATE))
    np.testing.assert_allclose(told.angle, [1.0, 1.2], rtol=1e-10)
    np.testing.assert_allclose(told.duration, [0.3, 0.4], rtol=1e-10)
    np.testing.assert_allclose(told.chord, 1.8 * np.sin([0.5, 0.6]), rtol=1e-10)
    np.testing.assert_allclose(told.arc, 0.9 * np.array([0.88 + 0.1 / 0.3, 1.2 * (0.88 + 0.1 / 0.4)]), rtol=1e-10)

    def arc(values):
        q = StrideLengthParams(leg_length=values[0], time_gain=values[1], gyr_bias=Vector(0.0, values[2], 0.0))
        return jnp.sum(stride_length.pendulum(q, gyr, at, 1.0 / RATE).arc)

    at_values = jnp.asarray([0.9, 0.1, 0.0])
    scale = np.array([1.0 + 0.1 / 0.3, 1.2 * 1.0 + 0.1 * 1.2 / 0.4])
    by_bias = -0.9 * np.sum(np.array([0.3, 0.4]) * (1.0 + 0.1 / np.array([0.3, 0.4])))
    expected = [scale.sum(), 0.9 * (1.0 / 0.3 + 1.2 / 0.4), -by_bias]
    np.testing.assert_allclose(jax.grad(arc)(at_values), expected, rtol=1e-9)
