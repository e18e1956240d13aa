"""The readings of a worn inertial sensor for an exact motion: sway, mounting, bandwidth, noise, range, loss."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray, PyTree

from jgait.geometry.rotation import rotation, turn
from jgait.geometry.vectors import kept
from jgait.notes import record
from jgait.signal import butterworth
from jgait.types import AnyArray, Imu, Values


@record
class ImuErrors(NamedTuple):
    """Errors and mounting of an inertial sensor; every field is a scalar, and the default switches the error off."""

    gyr_noise: Values = 0.0  #: density of the gyroscope's white noise [rad/s/√Hz].
    gyr_bias: Values = 0.0  #: standard deviation over trials of the gyroscope's constant bias [rad/s].
    gyr_drift: Values = 0.0  #: random walk of the gyroscope's bias [rad/s/√s].
    gyr_scale: Values = 0.0  #: standard deviation over trials of the scale error of each axis [1].
    gyr_bandwidth: Values = math.inf  #: −3 dB frequency of a second-order Butterworth low-pass [Hz]; inf: none.
    gyr_range: Values = math.inf  #: rate at which the gyroscope saturates [rad/s]; inf: no saturation.
    gyr_resolution: Values = 0.0  #: one step of the gyroscope's converter [rad/s].
    acc_noise: Values = 0.0  #: density of the accelerometer's white noise [m/s²/√Hz].
    acc_bias: Values = 0.0  #: standard deviation over trials of the accelerometer's constant bias [m/s²].
    acc_drift: Values = 0.0  #: random walk of the accelerometer's bias [m/s²/√s].
    acc_scale: Values = 0.0  #: standard deviation over trials of the scale error of each axis [1].
    acc_bandwidth: Values = math.inf  #: −3 dB frequency of a second-order Butterworth low-pass [Hz]; inf: none.
    acc_range: Values = math.inf  #: specific force at which the accelerometer saturates [m/s²]; inf: no saturation.
    acc_resolution: Values = 0.0  #: one step of the accelerometer's converter [m/s²].
    mounting: Values = 0.0  #: standard deviation of the angle by which the sensor is turned about a random axis [rad].
    #: first component of the rotation vector from segment axes to sensor axes, constant over trials [rad].
    mounting_x: Values = 0.0
    mounting_y: Values = 0.0  #: second component of that rotation vector [rad].
    mounting_z: Values = 0.0  #: third component of that rotation vector [rad].
    packet_loss: Values = 0.0  #: probability that a single sample is lost [1].
    #: slow random turns of the sensor with the shoe or strap that it is on: standard deviation of their rate over that
    #: of the segment's own rate in the last half second [1].
    sway: Values = 0.0
    sway_arm: Values = 0.0  #: height of the sensor above the point about which it sways [m].
    #: vibration of the sensor in jolts, as when a heel lands: standard deviation of its acceleration over the change of
    #: the specific force within 5 ms [1]; readings at 200 Hz show two thirds of it, slower ones less.
    acc_jolt: Values = 0.0


_UNBOUNDED = ("gyr_bandwidth", "gyr_range", "acc_bandwidth", "acc_range")
_RANGES = {
    **dict.fromkeys(_UNBOUNDED, (0.0, math.inf)),
    **dict.fromkeys(("mounting_x", "mounting_y", "mounting_z", "sway_arm"), (-math.inf, math.inf)),
    "packet_loss": (0.0, 1.0),
}
"""Closed ranges of the fields; other fields must not be negative. Fields without an upper bound must not be zero."""


def check_fields(errors: PyTree, ranges: dict[str, tuple[float, float]], unbounded: tuple[str, ...] = ()) -> None:
    """Check that every number of a record, perhaps in arrays, lies within its range.

    Fields that have no range must not be negative; `unbounded` ones may be infinite, and may not be zero. Raises
    TypeError if a field is no number, and ValueError, naming the field, if it is outside its range or not finite.
    """
    kind = type(errors).__name__
    for name, value in zip(errors._fields, errors, strict=True):
        numbers = np.asarray(value)
        if not (np.issubdtype(numbers.dtype, np.number) or numbers.dtype == np.bool_):
            raise TypeError(f"{kind}.{name} must be a number; got {value!r}")
        low, high = ranges.get(name, (0.0, math.inf))
        good = (numbers >= low) & (numbers <= high)  # False for NaN
        good &= (numbers > 0.0) if name in unbounded else np.isfinite(numbers)
        if not good.all():
            expected = "above 0" if name in unbounded else f"finite and in [{low:g}, {high:g}]"
            raise ValueError(f"{kind}.{name} must be {expected}; got {float(numbers[~good].flat[0]):g}")


def check_errors(errors: ImuErrors) -> None:
    """Check the errors of a sensor, or, as arrays, of many; on the host; raises as `check_fields`."""
    check_fields(errors, _RANGES, _UNBOUNDED)


def _turned_back(values: Float[AnyArray, "time 3"], matrix: Float[Array, "*time 3 3"]) -> Float[Array, "time 3"]:
    """Rows of `values` (T, 3) in axes turned by `matrix` (1 or T, 3, 3): Rᵀ v, in full precision on any device."""
    return jnp.sum(values[:, :, None] * matrix, axis=1)


SHAKES_HZ = 30.0
"""[Hz] The frequency about which a jolt makes the sensor vibrate; chosen by hand."""


def _disturbed(
    white: Float[AnyArray, "time 6"], gyr: Float[AnyArray, "time 3"], acc: Float[AnyArray, "time 3"],
    errors: ImuErrors, dt: Values,
) -> tuple[Float[Array, "time 3"], Float[Array, "time 3"]]:  # fmt: skip
    """What moves a sensor on its segment, zero at rest: the drive of its sway [rad/s²], and its vibration [m/s²].

    From `white` noise of variance 1, whose first three columns drive the sway, and the exact motion.
    """
    change = jnp.diff(acc, axis=0, prepend=acc[:1]) * (0.005 / dt)  # within 5 ms
    squares = jnp.stack([jnp.sum(part * part, axis=1) for part in (gyr - gyr[:1], change)], axis=1)
    # before the recording the sensor rests: the low-pass takes the first sample for all that was before. Moving and
    # resting are told apart within a second; vibrations fade at 8 Hz, and noise up to 4 Hz drives the sway.
    smooth = low_pass(
        jnp.concatenate([squares, white], axis=1),
        jnp.asarray([1.0, 8.0, *[4.0] * 3, *[SHAKES_HZ] * 3], acc.dtype), dt,
    )  # fmt: skip
    moves, jolts = (jnp.sqrt(jnp.maximum(smooth[:, i], 1e-12))[:, None] for i in range(2))
    # A vibration goes back and forth: its velocity does not grow with time. The derivative of white noise after a
    # low-pass at ω has the variance S ω³ / √8 for the density S.
    size = (8.0**0.25 / (2.0 * math.pi * SHAKES_HZ) ** 1.5) / jnp.sqrt(dt)
    velocity = size * errors.acc_jolt * jolts * smooth[:, 5:]
    # 8.1 rad/s/√s: density of the driving noise, before its low-pass, for a rate of 1 rad/s
    drive = 8.1 / jnp.sqrt(dt) * errors.sway * moves * smooth[:, 2:5]
    return drive, jnp.diff(velocity, axis=0, prepend=velocity[:1]) / dt


def _swaying(
    gyr: Float[AnyArray, "time 3"], acc: Float[AnyArray, "time 3"], drive: Float[AnyArray, "time 3"],
    sway_arm: Values, dt: Values,
) -> tuple[Float[Array, "time 3"], Float[Array, "time 3"]]:  # fmt: skip
    """The readings of a sensor that sways about a point under it, driven by noise.

    The turn d of the sensor, from rest, d̈ + 2 ζ ω ḋ + ω² d = f₀ − f with ω of 2 Hz and ζ = 0.7, is exact for a drive f
    that is linear between samples.
    """
    push, omega, damping = drive[:1] - drive, 2.0 * math.pi * 2.0, 0.7
    swings = omega * math.sqrt(1.0 - damping**2)
    fade = jnp.exp(-damping * omega * dt)
    keep, lift = fade * jnp.cos(swings * dt), fade * jnp.sin(swings * dt) / swings
    rub = damping * omega * lift

    def step(
        carry: tuple[Values, Values], pushes: tuple[Values, Values]
    ) -> tuple[tuple[Values, Values], tuple[Values, Values]]:
        now, then = pushes
        slope = (then - now) / dt
        # The turn follows a linearly growing drive with a constant lag; the remainder is a free oscillation.
        lag = 2.0 * damping * slope / omega**3
        d, v = carry[0] - (now / omega**2 - lag), carry[1] - slope / omega**2
        after = (
            (keep + rub) * d + lift * v + then / omega**2 - lag,
            (keep - rub) * v - omega**2 * lift * d + slope / omega**2,
        )
        return after, after

    zero = jnp.zeros_like(push[0])
    _, moved = jax.lax.scan(step, (zero, zero), (push[:-1], push[1:]))
    sways, rate = (jnp.concatenate([zero[None, :], part]) for part in moved)
    turned = push - 2.0 * damping * omega * rate - omega**2 * sways
    swayed = sway_arm * jnp.stack([turned[:, 1], -turned[:, 0], jnp.zeros_like(turned[:, 0])], axis=1)
    matrix = rotation(sways)
    return _turned_back(gyr, matrix) + rate, _turned_back(acc + swayed, matrix)


def low_pass(values: Float[AnyArray, "time *rest"], frequency: Values, dt: Values) -> Float[Array, "time *rest"]:
    """`butterworth.low_pass` of the channels of a signal (T, C), each with its cut-off (C,) [Hz].

    A cut-off of 0.45 of the sampling rate or more, and inf, leave a channel unchanged.
    """
    on = frequency * dt < 0.45
    start = values[:1]  # the filtered signal begins at zero: no precision is lost by gravity
    filtered = butterworth.low_pass(values - start, jnp.where(on, frequency, 0.1 / dt), 1.0 / dt)
    return jnp.where(on[None, :], filtered + start, values)


def _quantise(value: Values, resolution: Values) -> Values:
    step = jnp.where(resolution > 0.0, resolution, 1.0)
    return jnp.where(resolution > 0.0, step * jnp.round(value / step), value)


def measure(
    key: PRNGKeyArray, time: Float[AnyArray, "time"], gyr: Float[AnyArray, "time 3"], acc: Float[AnyArray, "time 3"],
    errors: ImuErrors,
) -> Imu:  # fmt: skip
    """Simulate the readings of one sensor for an exact motion.

    read = clip(quantise(lowpass((1 + scale) Rᵀ(segment)) + noise + bias + drift)), with sway and jolts before Rᵀ.

    White noise fills the bandwidth up to half the sampling rate and is not low-passed again: a density in a data sheet
    holds after the sensor's filter, and sampling folds higher frequencies. Gradients flow to every field except
    `packet_loss`, which acts through decisions; rounding to a resolution stops the gradients of all preceding
    operations.

    Args:
        key: PRNG key of one sensor on one trial.
        time: (T,) [s], evenly spaced, T ≥ 2.
        gyr: (T, 3) exact angular rate in the segment's axes [rad/s].
        acc: (T, 3) exact specific force in the segment's axes, at the position of the sensor [m/s²].
        errors: errors of the sensor.

    Returns:
        The readings in the sensor's axes; lost samples are 0 and masked.
    """
    dtype, n, e = gyr.dtype, time.shape[0], errors
    dt = time[1] - time[0]
    # One draw, because each costs compiling; a key for each row, so that padding does not change the noise.
    # Keys are split in 14, as ever: another number would change the noise.
    keys = jnp.concatenate([jax.random.split(key, 14)[:13], jax.random.split(jax.random.fold_in(key, 1), 6)])
    draws = kept(jax.vmap(lambda row: jax.random.normal(row, (n + 2,), dtype))(keys))
    white, steps = draws[:6, 2:].T, draws[6:12, 2:].T
    bias, scale, mount = draws[:6, 0], draws[6:12, 0], draws[:6, 1]

    def channels(of_gyr: Values, of_acc: Values) -> Float[Array, "channel"]:
        return jnp.repeat(jnp.stack([jnp.asarray(of_gyr, dtype), jnp.asarray(of_acc, dtype)]), 3)

    drive, vibration = _disturbed(draws[13:, 2:].T, gyr, acc, e, dt)
    gyr, acc = _swaying(gyr, acc, drive, e.sway_arm, dt)
    fixed = jnp.stack([jnp.asarray(part, dtype) for part in (e.mounting_x, e.mounting_y, e.mounting_z)])
    # columns are the sensor's axes in the segment's axes; the random rotation comes last, in the intended sensor axes
    axes = _turned_back(rotation(fixed), turn(mount[:3], mount[3] * e.mounting)[None])[None]
    read = jnp.concatenate([_turned_back(part, axes) for part in (gyr, acc + vibration)], axis=1)
    read = read * (1.0 + scale * channels(e.gyr_scale, e.acc_scale))[None, :]
    read = low_pass(read, channels(e.gyr_bandwidth, e.acc_bandwidth), dt)
    read = read + white * channels(e.gyr_noise, e.acc_noise)[None, :] / jnp.sqrt(2.0 * dt)
    read = read + (bias * channels(e.gyr_bias, e.acc_bias))[None, :]
    _, drift = jax.lax.scan(lambda now, new: (now + new,) * 2, jnp.zeros_like(steps[0]), steps)
    read = read + drift * channels(e.gyr_drift, e.acc_drift)[None, :] * jnp.sqrt(dt)
    limit = channels(e.gyr_range, e.acc_range)[None, :]
    read = jnp.clip(_quantise(read, channels(e.gyr_resolution, e.acc_resolution)[None, :]), -limit, limit)
    mask = jax.scipy.special.ndtr(draws[12, 2:]) >= e.packet_loss
    read = kept(jnp.where(mask[:, None], read, jnp.zeros_like(read)))
    return Imu(time, read[:, :3], read[:, 3:], mask)
