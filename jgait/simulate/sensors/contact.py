"""What tells that a foot is on the ground: switches under heel and toe, and the pressure in an insole."""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jgait.simulate.sensors.imu import check_fields


class FootSwitch(NamedTuple):
    """How a foot switch errs; every field is a scalar.

    Attributes:
        threshold: load at which it closes, of the whole [1].
        hysteresis: how far below that it opens again [1].
        delay: how late it is [s].
        chatter: how long it bounces after each change [s].
    """

    threshold: Any = 0.05
    hysteresis: Any = 0.0
    delay: Any = 0.0
    chatter: Any = 0.0


class Insole(NamedTuple):
    """How the cells of an insole err; every field is a scalar.

    Attributes:
        gain: reading under full load, any unit of pressure.
        gain_error: standard deviation over trials of each cell's relative error of gain [1].
        offset: standard deviation over trials of each cell's reading without load, in the unit of `gain`.
        noise: standard deviation of each reading, in the unit of `gain`.
    """

    gain: Any = 1.0
    gain_error: Any = 0.0
    offset: Any = 0.0
    noise: Any = 0.0


class Pressure(NamedTuple):
    """Readings of an insole in the unit of its gain, each (T,); a cell reads no less than 0."""

    heel: Any
    midfoot: Any
    toe: Any


def measure_switch(key: Any, time: Any, load: Any, switch: FootSwitch) -> Any:
    """Read one switch: closed while the load, `delay` earlier, is above the threshold.

    Args:
        key: PRNG key, for the bouncing.
        time: (T,) [s], evenly spaced.
        load: (T,) share of the full load on the switch, 0 to 1 [1].
        switch: how it errs.

    Returns:
        (T,) bool; True while closed.
    """
    index = jnp.arange(1, time.shape[0] + 1)
    late = jnp.interp(time - switch.delay, time, load)
    closes, opens = late > switch.threshold, late <= switch.threshold - switch.hysteresis
    # between the two thresholds it stays: the later of the two events tells the state
    closed = _last(closes, index) > _last(opens, index)
    changes = jnp.concatenate([jnp.zeros_like(closed[:1]), closed[1:] != closed[:-1]])
    last = _last(changes, index)
    bouncing = (last > 0) & ((index - last).astype(time.dtype) * (time[1] - time[0]) < switch.chatter)
    return closed ^ (bouncing & jax.random.bernoulli(key, shape=time.shape))


def _last(event: Any, index: Any) -> Any:
    """Number of the last sample at which something was the case (T,), 0 before the first."""
    return jax.lax.cummax(jnp.where(event, index, jnp.zeros_like(index)))


def measure_insole(key: Any, heel: Any, toe: Any, insole: Insole) -> Pressure:
    """Read the pressure under heel, midfoot and toe.

    cell = max(0, gain (1 + gain error) load + offset + noise); the midfoot bears where both ends do, heel · toe.

    Args:
        key: PRNG key.
        heel: (T,) share of the full load under the heel, 0 to 1 [1].
        toe: (T,) the same under the toe [1].
        insole: how the cells err.

    Returns:
        The readings of the three cells.
    """
    loads = jnp.stack([heel, heel * toe, toe])
    draws = jax.random.normal(key, (3, heel.shape[0] + 2), heel.dtype)
    gain = insole.gain * (1.0 + insole.gain_error * draws[:, :1])
    return Pressure(*jnp.maximum(gain * loads + insole.offset * draws[:, 1:2] + insole.noise * draws[:, 2:], 0.0))


def check_contact(sensor: FootSwitch | Insole) -> None:
    """Refuse a switch or an insole that cannot be.

    Raises:
        TypeError: if a field is no number.
        ValueError: if a field lies outside its range; the message names it.
    """
    check_fields(sensor, {"threshold": (0.0, 1.0), "hysteresis": (0.0, 1.0), "gain": (0.0, math.inf)})
