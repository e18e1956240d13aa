"""Sensors whose clock is wrong: when they really sampled."""

import math
from typing import NamedTuple

from jgait.simulate.sensors.imu import check_fields
from jgait.types import Values


class Clock(NamedTuple):
    """A clock that at the true time t shows (1 + drift) t + offset.

    Attributes:
        offset: by how much it is ahead at time zero [s].
        drift: by how much it runs fast [1]; 20e-6 is a common quartz.
    """

    offset: Values = 0.0
    drift: Values = 0.0


def true_times(clock: Clock, time: Values) -> Values:
    """When a sensor really sampled, t = (shown − offset) / (1 + drift).

    The motion is evaluated at these times, while the reading keeps the time that the clock showed.

    Args:
        clock: how it is wrong.
        time: (T,) what the clock showed [s].

    Returns:
        (T,) [s].
    """
    # as a correction: in single precision the quotient would lose the microseconds that a drift is about
    return time - (clock.offset + clock.drift * time) / (1.0 + clock.drift)


def check_clock(clock: Clock) -> None:
    """Refuse a clock that stands still or runs backwards, by the name of the field.

    Raises:
        TypeError: if a field is no number.
        ValueError: if the offset is not finite, or the drift is not within ±0.5.
    """
    check_fields(clock, {"offset": (-math.inf, math.inf), "drift": (-0.5, 0.5)})
