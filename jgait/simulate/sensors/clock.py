"""Sensors with clock errors: the true times of their samples."""

from typing import NamedTuple

from jgait.types import Values


class Clock(NamedTuple):
    """A clock that at the true time t shows (1 + drift) t + offset.

    Attributes:
        offset: lead of the clock at time zero [s].
        drift: relative error of the clock's rate, positive if fast [1]; 20e-6 is a common quartz.
    """

    offset: Values = 0.0
    drift: Values = 0.0


def true_times(clock: Clock, time: Values) -> Values:
    """The true times of a sensor's samples, t = (shown − offset) / (1 + drift) [s].

    The motion is evaluated at these times; the reading keeps the time that the clock showed.
    """
    # computed as a correction: in single precision the quotient loses the microseconds of a drift
    return time - (clock.offset + clock.drift * time) / (1.0 + clock.drift)
