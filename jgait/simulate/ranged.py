"""The distance between the legs of a simulated walk, as a range sensor at an ankle measures it."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray, PyTree

from jgait.simulate.sensors import HC_SR04, Ranging, check_ranging, measure_range, nearest_point
from jgait.simulate.worn import Truth
from jgait.types import RangeReadings

SKIN = 0.04
"""Distance from the axis of a shank to its inner side, above the ankle [m]; chosen."""

_read = jax.jit(measure_range)


def feet_range(
    key: PRNGKeyArray, truth: Truth, ranging: Ranging = HC_SR04
) -> tuple[RangeReadings, Float[np.ndarray, "time"]]:
    """Readings of a range sensor on the inner side of the left ankle, which points at the right leg.

    `recording._replace(feet_range=readings)` is the recording with them.

    Returns:
        The readings, and the true distance between the skin of both legs (T,) [m], which is 2 `SKIN` less than that of
        the shanks' axes.

    Raises:
        TypeError, ValueError: if the sensor cannot be like that, see `check_ranging`.
    """
    check_ranging(ranging)
    segments = truth.motion.pose

    def rows(vector: PyTree) -> Float[Array, "time 3"]:
        return jnp.stack([jnp.asarray(part) for part in vector], axis=1)

    looks = -rows(segments.shank_left.y)
    sender = rows(segments.foot_left.origin) + 0.04 * rows(segments.shank_left.z) + SKIN * looks
    bone = nearest_point(sender, rows(segments.shank_right.origin), rows(segments.foot_right.origin))
    towards = sender - bone
    away = jnp.sqrt(jnp.sum(towards * towards, axis=1, keepdims=True))
    receiver = bone + SKIN / away * towards
    read = _read(key, jnp.asarray(truth.estimate.time), sender, receiver, looks, ranging)
    return jax.tree.map(np.asarray, read), np.asarray(away[:, 0] - SKIN)
