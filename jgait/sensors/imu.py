"""What a worn inertial sensor makes of an exact motion: mounting, noise, bias, range, steps of the converter, loss."""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jgait.kinematics import GRAVITY
from jgait.types import Imu

DEGREE = math.pi / 180.0


class SensorNoise(NamedTuple):
    """How a sensor errs and how carefully it is put on; every field is a scalar, 0 switches an error off.

    Attributes:
        gyr_noise: density of the gyroscope's white noise [rad/s/√Hz].
        gyr_bias: standard deviation over trials of its constant bias [rad/s].
        gyr_drift: random walk of that bias [rad/s/√s].
        gyr_range: where the gyroscope saturates [rad/s].
        gyr_resolution: one step of its converter [rad/s].
        acc_noise: density of the accelerometer's white noise [m/s²/√Hz].
        acc_bias: standard deviation over trials of its constant bias [m/s²].
        acc_range: where the accelerometer saturates [m/s²].
        acc_resolution: one step of its converter [m/s²].
        mounting: standard deviation of the angle by which it is turned about a random axis [rad].
        packet_loss: probability that a sample is lost [1].
        left_flipped: 1 if sensors of the left leg are worn turned half round the segment (x and z change sign).
    """

    gyr_noise: Any = 0.0
    gyr_bias: Any = 0.0
    gyr_drift: Any = 0.0
    gyr_range: Any = math.inf
    gyr_resolution: Any = 0.0
    acc_noise: Any = 0.0
    acc_bias: Any = 0.0
    acc_range: Any = math.inf
    acc_resolution: Any = 0.0
    mounting: Any = 0.0
    packet_loss: Any = 0.0
    left_flipped: Any = 0.0


IDEAL = SensorNoise()
"""A perfect sensor, perfectly mounted."""

IDG300 = SensorNoise(
    gyr_noise=0.014 * math.sqrt(140.0 * math.pi / 2.0 / 25.0) * DEGREE,
    gyr_bias=1.0 * DEGREE,
    gyr_drift=0.01 * DEGREE,
    gyr_range=500.0 * DEGREE,
    gyr_resolution=2.5 / 4096 / 0.002 * DEGREE,
    acc_noise=160e-6 * GRAVITY,
    acc_bias=0.02 * GRAVITY,
    acc_range=6.0 * GRAVITY,
    acc_resolution=GRAVITY / 340.0,
    mounting=5.0 * DEGREE,
    packet_loss=0.01,
)
"""A Telos mote with an IDG-300 gyroscope and an LIS3LV02DQ accelerometer.

From the data sheets: gyroscope ±500 °/s, 2 mV per °/s into a 12-bit converter of 2.5 V, 0.014 °/s/√Hz up to a
first-order filter at 140 Hz, which sampling at 50 Hz folds into 25 Hz (0.2 °/s in all); accelerometer ±6 g in 340
steps per g. Chosen, since no source states them for this mote: biases, drift, mounting, loss, accelerometer noise.
"""


def turn(axis: Any, angle: Any) -> Any:
    """Rotation matrix (3, 3) about a direction (3,) of any length, by an angle [rad] (Rodrigues' formula)."""
    x, y, z = axis / jnp.linalg.norm(axis)
    zero = jnp.zeros_like(x)
    cross = jnp.stack([jnp.stack([zero, -z, y]), jnp.stack([z, zero, -x]), jnp.stack([-y, x, zero])])
    return jnp.eye(3, dtype=x.dtype) + jnp.sin(angle) * cross + (1.0 - jnp.cos(angle)) * (cross @ cross)


def _quantise(value: Any, resolution: Any) -> Any:
    step = jnp.where(resolution > 0.0, resolution, 1.0)
    return jnp.where(resolution > 0.0, step * jnp.round(value / step), value)


def measure(key: Any, time: Any, rate: Any, force: Any, noise: SensorNoise, flipped: Any = 0.0) -> Imu:
    """Read an exact motion with one sensor.

    White noise fills the bandwidth up to half the sampling rate, the gyroscope's bias starts at random and walks,
    then the converter rounds and saturates.

    Args:
        key: PRNG key.
        time: (T,) [s], evenly spaced, T ≥ 2.
        rate: (T, 3) angular rate in the segment's axes [rad/s].
        force: (T, 3) specific force in the segment's axes [m/s²].
        noise: how the sensor errs.
        flipped: 1 if it is worn turned half round the segment's long axis.

    Returns:
        The readings in the sensor's axes; lost samples are 0 and masked.
    """
    dtype, samples, n = rate.dtype, time.shape[0], noise
    errors, losses = jax.random.split(key)
    draws = jax.random.normal(errors, (2 * samples + 2, 6), dtype)  # one draw: each costs a compilation
    white, steps, bias, mount = draws[:samples], draws[samples:-2], draws[-2], draws[-1]

    def channels(gyr: Any, acc: Any) -> Any:
        return jnp.repeat(jnp.stack([jnp.asarray(gyr, dtype), jnp.asarray(acc, dtype)]), 3)[None, :]

    mounting = turn(mount[:3], mount[3] * n.mounting)
    side = jnp.where(jnp.asarray(flipped, dtype) > 0.5, -jnp.ones((), dtype), jnp.ones((), dtype))
    half_turn = jnp.stack([side, jnp.ones_like(side), side])[None, :]
    exact = jnp.concatenate([(rate * half_turn) @ mounting, (force * half_turn) @ mounting], axis=1)
    dt = time[1] - time[0]
    read = exact + white * channels(n.gyr_noise, n.acc_noise) / jnp.sqrt(2.0 * dt)
    read = read + bias[None, :] * channels(n.gyr_bias, n.acc_bias)
    read = read + jnp.cumsum(steps, axis=0) * channels(n.gyr_drift, 0.0) * jnp.sqrt(dt)
    limit = channels(n.gyr_range, n.acc_range)
    read = jnp.clip(_quantise(read, channels(n.gyr_resolution, n.acc_resolution)), -limit, limit)
    mask = jax.random.uniform(losses, time.shape, dtype) >= n.packet_loss
    read = jnp.where(mask[:, None], read, jnp.zeros_like(read))
    return Imu(time, read[:, :3], read[:, 3:], mask)
