"""Both sides of a person as one, with a first axis of sides; durations of strides, and the distance along them."""

import math

import jax
import numpy as np

from jgait.filtering import Covariance
from jgait.geometry.arrays import interpolated, xp
from jgait.types import Counts, Flags, Strides, Values, as_float


def stacked[Record](*records: Record) -> Record:
    """Records of the same structure as one, with a first axis for the records."""
    joined: Record = jax.tree.map(lambda *leaves: xp.stack(leaves), *records)
    return joined


def picked(index: Counts, *values: Values) -> tuple[Values, ...]:
    """The samples `index` (n,) of each of some signals (T,), by one function."""
    return tuple(xp.stack(values, axis=1)[index].T)


def entries(cov: Covariance, name: str, pairs: tuple[str, ...]) -> list[Values]:
    """Entries of the covariance (…, 3, 3) of a vector, by pairs of axes: "xx", "xy"."""
    block: Values = cov[name, name]
    return [block[..., "xyz".index(pair[0]), "xyz".index(pair[1])] for pair in pairs]


def of_turns(length: Values, turn: Values) -> tuple[Values, Values]:
    """Way of the person over strides that turn, and its standard deviation [m].

    Length (n,) is the chord from foothold to foothold [m], turn (n,) that of the foot [rad]. On a curve the person
    walks the arc, in turning on the spot the chord or less. The way is the mean of arc and chord, with the standard
    deviation of a uniform distribution between them.
    """
    arc = length / xp.sinc(xp.clip(turn / (2.0 * math.pi), -0.5, 0.5))
    return 0.5 * (length + arc), (arc - length) / math.sqrt(12.0)


def along(time: Values, start: Values, end: Values, real: Flags, lengths: Values) -> Values:
    """Running sums (T, m) of values of strides (n, m), each added linearly from the start [s] to the end [s] of its
    stride.

    The strides are in the order of their starts and do not overlap; those that are not `real` follow the others, and
    add nothing.
    """
    rows = xp.arange(start.shape[0], dtype=xp.int32).astype(time.dtype)
    beyond = time[-1] + 1.0 + rows  # after the recording, in order
    knots = xp.stack([xp.where(real, start, beyond), xp.where(real, end, beyond + 0.5)], axis=1).ravel()
    done = xp.cumsum(lengths, axis=0)
    values = xp.stack([done - lengths, done], axis=1).reshape(-1, lengths.shape[1])
    return interpolated(time, knots, values)


def durations(strides: Strides) -> np.ndarray:
    """(strides,) [s] from contact to contact; NaN for a first stride from standing, which has no contact before it.

    The strides have starts and ends.
    """
    lasts = as_float(strides.end) - as_float(strides.start)
    if strides.final_contact is None:
        return lasts
    return np.where(as_float(strides.final_contact) <= as_float(strides.start), np.nan, lasts)
