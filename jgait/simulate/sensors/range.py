"""Distance between the feet by ultrasound: measured while one foot passes the other, sometimes from a late echo."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from jgait.simulate.sensors.imu import check_fields
from jgait.types import AnyArray, RangeReadings, Scalar, Values


class Ranging(NamedTuple):
    """Settings and errors of an ultrasonic range sensor between the legs; every field is a scalar.

    Attributes:
        rate_hz: pings a second [Hz].
        phase: time from the start to the first ping, in intervals between pings [1].
        noise: standard deviation of the distance [m].
        bias: constant error of every distance, such as the distance between sensor and skin [m].
        half_angle: greatest angle from the sender's axis at which the echo is detected [rad].
        facing_half_angle: greatest angle from the receiver's axis to the sender [rad]; π: any direction.
        min_distance: least distance with a reading [m].
        max_distance: greatest distance with a reading [m].
        outlier: probability that a reading is a late echo [1].
        outlier_size: mean additional distance of a late echo, exponentially distributed [m].
        dropout: probability that a detectable ping is lost [1].
    """

    rate_hz: Values = 30.0
    phase: Values = 0.0
    noise: Values = 0.0
    bias: Values = 0.0
    half_angle: Values = math.pi / 12.0
    facing_half_angle: Values = math.pi
    min_distance: Values = 0.0
    max_distance: Values = 4.0
    outlier: Values = 0.0
    outlier_size: Values = 0.0
    dropout: Values = 0.0


def measure_range(
    key: PRNGKeyArray,
    time: Float[AnyArray, "time"],
    sender: Float[AnyArray, "time 3"],
    receiver: Float[AnyArray, "time 3"],
    sender_axis: Float[AnyArray, "time 3"],
    receiver_axis: Float[AnyArray, "time 3"],
    ranging: Ranging,
) -> RangeReadings:
    """Simulate readings of the distance between two feet, where the echo is detected.

    A ping is evaluated at the first sample at or after it. It is detected if the receiver lies within `half_angle` of
    the sender's axis and the sender within `facing_half_angle` of the receiver's axis. For an echo off a leg, the
    receiver is the nearest point of that leg (`nearest_point`), and `facing_half_angle` stays π.

    Args:
        key: PRNG key.
        time: (T,) [s], evenly spaced.
        sender: (T, 3) position of the sender in the world [m].
        receiver: (T, 3) position of the receiver, or of the point that reflects the echo [m].
        sender_axis: (T, 3) direction of the sender's axis, of any length above 0.
        receiver_axis: (T, 3) direction of the receiver's axis, of any length above 0.
        ranging: settings and errors of the sensor.

    Returns:
        The readings. Gradients flow to positions, noise, bias and size of outliers; not to the decisions on detection.

    Source: the sensor is that of section III of Potter's stride width filter: 30 Hz, one foot passing the other.
    """
    r, dtype = ranging, sender.dtype
    dt = time[1] - time[0]
    way = receiver - sender
    square = jnp.sum(way * way, axis=1)
    apart = square > 0.0
    distance = jnp.where(apart, jnp.sqrt(jnp.where(apart, square, jnp.ones_like(square))), 0.0)

    def seen(
        direction: Float[AnyArray, "time 3"], axis: Float[AnyArray, "time 3"], half_angle: Scalar
    ) -> Bool[Array, "time"]:
        return _cosine(direction, axis) >= jnp.cos(jnp.asarray(half_angle, dtype)) - 1e-6  # π: any direction

    # the sample has a ping if the count of pings has increased; the small number keeps t = k / rate in its sample
    since = jnp.concatenate([-dt[None], time - time[0]])
    pings = jnp.floor(since * r.rate_hz - r.phase + 1e-3)
    in_view = seen(way, sender_axis, r.half_angle) & seen(-way, receiver_axis, r.facing_half_angle)
    in_reach = apart & (distance >= r.min_distance) & (distance <= r.max_distance)

    draws = jax.random.normal(key, (time.shape[0], 4), dtype)
    late, size, lost = jnp.moveaxis(jax.scipy.special.ndtr(draws[:, 1:]), 1, 0)
    mask = (pings[1:] > pings[:-1]) & in_view & in_reach & (lost >= r.dropout)
    # minus the logarithm of a uniform number is exponential; the floor avoids log 0
    delay = -r.outlier_size * jnp.log(jnp.maximum(size, jnp.finfo(dtype).tiny))
    read = distance + r.bias + r.noise * draws[:, 0] + jnp.where(late < r.outlier, delay, jnp.zeros_like(delay))
    return RangeReadings(time, jnp.where(mask, read, jnp.zeros_like(read)), mask)


def _cosine(a: Float[AnyArray, "time 3"], b: Float[AnyArray, "time 3"]) -> Float[Array, "time"]:
    """Cosine of the angle between rows (T, 3); 0 where one has no length."""
    squares = jnp.sum(a * a, axis=1) * jnp.sum(b * b, axis=1)
    long = squares > 0.0
    return jnp.where(long, jnp.sum(a * b, axis=1) / jnp.sqrt(jnp.where(long, squares, jnp.ones_like(squares))), 0.0)


def nearest_point(
    point: Float[AnyArray, "time 3"], start: Float[AnyArray, "time 3"], end: Float[AnyArray, "time 3"]
) -> Float[AnyArray, "time 3"]:
    """The point of a limb, a straight line from start to end, nearest to another point: it reflects the echo. (T, 3)
    [m].
    """
    along = end - start
    share = jnp.sum((point - start) * along, axis=1) / jnp.sum(along * along, axis=1)
    return start + jnp.clip(share, 0.0, 1.0)[:, None] * along


def check_ranging(ranging: Ranging) -> None:
    """Check the settings and errors of a range sensor.

    Raises:
        TypeError: if a field is no number.
        ValueError: if a field lies outside its range, or the least distance is above the greatest.
    """
    shares, angles = ("phase", "outlier", "dropout"), ("half_angle", "facing_half_angle")
    ranges = {
        **dict.fromkeys(shares, (0.0, 1.0)),
        **dict.fromkeys(angles, (0.0, math.pi + 1e-6)),
        "bias": (-math.inf, math.inf),
    }
    check_fields(ranging, ranges, ("rate_hz", "max_distance"))
    if not ranging.min_distance < ranging.max_distance:
        nearest, farthest = ranging.min_distance, ranging.max_distance
        raise ValueError(f"Ranging.min_distance must be below max_distance; got {nearest:g} and {farthest:g}")
