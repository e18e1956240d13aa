"""Distance between the feet by ultrasound: measured while one foot passes the other, sometimes from a late echo."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float, PRNGKeyArray

from jgait.notes import record
from jgait.simulate.sensors.imu import check_fields
from jgait.types import AnyArray, RangeReadings, Values


@record
class Ranging(NamedTuple):
    """Settings and errors of an ultrasonic range sensor between the legs; every field is a scalar."""

    rate_hz: Values = 30.0  #: pings a second [Hz].
    noise: Values = 0.0  #: standard deviation of the distance [m].
    half_angle: Values = math.pi / 12.0  #: greatest angle from the sender's axis at which the echo is detected [rad].
    min_distance: Values = 0.0  #: least distance with a reading [m].
    max_distance: Values = 4.0  #: greatest distance with a reading [m].
    outlier: Values = 0.0  #: probability that a reading is a late echo [1].
    outlier_size: Values = 0.0  #: mean additional distance of a late echo, exponentially distributed [m].


def measure_range(
    key: PRNGKeyArray, time: Float[AnyArray, "time"], sender: Float[AnyArray, "time 3"],
    receiver: Float[AnyArray, "time 3"], sender_axis: Float[AnyArray, "time 3"], ranging: Ranging,
) -> RangeReadings:  # fmt: skip
    """Simulate readings of the distance between two feet, where the echo is detected.

    A ping is evaluated at the first sample at or after it. It is detected if the receiver lies within `half_angle` of
    the sender's axis. For an echo off a leg, the receiver is the nearest point of that leg (`nearest_point`).

    Args:
        key: PRNG key.
        time: (T,) [s], evenly spaced.
        sender: (T, 3) position of the sender in the world [m].
        receiver: (T, 3) position of the receiver, or of the point that reflects the echo [m].
        sender_axis: (T, 3) direction of the sender's axis, of any length above 0.
        ranging: settings and errors of the sensor.

    Returns:
        The readings. Gradients flow to positions, noise and size of outliers; not to the decisions on detection.

    Source: the sensor is that of section III of Potter's stride width filter: 30 Hz, one foot passing the other.
    """
    r, dtype = ranging, sender.dtype
    dt = time[1] - time[0]
    way = receiver - sender
    square = jnp.sum(way * way, axis=1)
    apart = square > 0.0
    distance = jnp.where(apart, jnp.sqrt(jnp.where(apart, square, jnp.ones_like(square))), 0.0)

    # the sample has a ping if the count of pings has increased; the small number keeps t = k / rate in its sample
    since = jnp.concatenate([-dt[None], time - time[0]])
    pings = jnp.floor(since * r.rate_hz + 1e-3)
    # the cosine of the angle between both directions, 0 where one has no length
    squares = square * jnp.sum(sender_axis * sender_axis, axis=1)
    long = squares > 0.0
    size = jnp.sqrt(jnp.where(long, squares, jnp.ones_like(squares)))
    cosine = jnp.where(long, jnp.sum(way * sender_axis, axis=1) / size, 0.0)
    in_view = cosine >= jnp.cos(jnp.asarray(r.half_angle, dtype)) - 1e-6  # π: any direction
    in_reach = apart & (distance >= r.min_distance) & (distance <= r.max_distance)

    draws = jax.random.normal(key, (time.shape[0], 4), dtype)  # with three columns, keys would give other noise
    late, size = jnp.moveaxis(jax.scipy.special.ndtr(draws[:, 1:3]), 1, 0)
    mask = (pings[1:] > pings[:-1]) & in_view & in_reach
    # minus the logarithm of a uniform number is exponential; the floor avoids log 0
    delay = -r.outlier_size * jnp.log(jnp.maximum(size, jnp.finfo(dtype).tiny))
    read = distance + r.noise * draws[:, 0] + jnp.where(late < r.outlier, delay, jnp.zeros_like(delay))
    return RangeReadings(time, jnp.where(mask, read, jnp.zeros_like(read)), mask)


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
    """Check the settings and errors of a range sensor; raises as `check_fields`, or ValueError if the least distance is
    above the greatest.
    """
    check_fields(ranging, {"outlier": (0.0, 1.0), "half_angle": (0.0, math.pi + 1e-6)}, ("rate_hz", "max_distance"))
    if not ranging.min_distance < ranging.max_distance:
        nearest, farthest = ranging.min_distance, ranging.max_distance
        raise ValueError(f"Ranging.min_distance must be below max_distance; got {nearest:g} and {farthest:g}")
