"""Strides of the sensors on the feet sample by sample: `foot_ins.online` as a device."""

from typing import NamedTuple

import jax
import numpy as np

from jgait.estimators.foot_ins import online as foot_online
from jgait.estimators.foot_ins.online import ONLINE, FootNow, FootOnlineState
from jgait.estimators.foot_ins.params import FootOptions, FootParams
from jgait.estimators.foot_ins.prepare import worn_sides
from jgait.estimators.foot_ins.worn import FootWorn, worn
from jgait.estimators.online.device import Device, Readings
from jgait.types import SIDES, Counts, Flags, Recording, Values


class FeetConstants(NamedTuple):
    """Parameters; mounting of n sensors, leaves (n, …)."""

    p: FootParams
    worn: FootWorn


def device(p: FootParams, recording: Recording) -> Device:
    """The device for the sensors on the feet of a person who walks in a recording.

    Raises:
        RecordingError: as `foot_ins.online.worn`.
    """
    sides = worn_sides(recording)
    stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *(worn(recording, side) for side in sides))
    names, numbers = tuple(f"foot_{side}" for side in sides), tuple(SIDES.index(side) for side in sides)
    return Device("feet", "foot_ins", names, FeetConstants(p, stacked), begin, advance, ONLINE, numbers)


def begin(c: FeetConstants, sample: Readings, options: FootOptions) -> FootOnlineState:
    """The state before the first sample, see `Device`."""
    return jax.vmap(lambda one, gyr, acc: foot_online.begin(c.p, one, gyr, acc, options))(
        c.worn, sample.gyr, sample.acc
    )


def advance(
    c: FeetConstants, state: FootOnlineState, samples: Readings, count: Counts, options: FootOptions
) -> tuple[FootOnlineState, FootNow]:
    """A block of samples, see `Device`."""

    def one(own: FootWorn, before: FootOnlineState, gyr: Values, acc: Values, there: Flags) -> tuple[
        FootOnlineState, FootNow
    ]:  # fmt: skip
        return foot_online.over(c.p, own, before, gyr, acc, there, options, count)

    along = (0, 0, 1, 1, 1)
    signals = (samples.gyr, samples.acc, samples.turned & samples.felt)
    return jax.vmap(one, in_axes=along, out_axes=(0, 1))(c.worn, state, *signals)
