"""Strides of the sensors at the ankles or shanks sample by sample: `ankle_stride.online` as a device."""

from typing import NamedTuple

import jax
import numpy as np

from jgait.estimators.ankle_stride import online as ankle_online
from jgait.estimators.ankle_stride.online_state import AnkleOnlineState, Now
from jgait.estimators.ankle_stride.params import AnkleOptions, AnkleParams
from jgait.estimators.ankle_stride.worn import ONLINE, Worn, worn
from jgait.estimators.online.device import Device, Readings
from jgait.types import SIDES, Counts, Flags, Recording, Values


class AnklesConstants(NamedTuple):
    """Parameters; mounting of n sensors, leaves (n, …)."""

    p: AnkleParams
    worn: Worn


def device(p: AnkleParams, recording: Recording, site: str) -> Device:
    """The device for the sensors at a site, "ankle" or "shank", of a person who walks in a recording.

    Raises:
        RecordingError: as `ankle_stride.online.worn`.
    """
    sides = [number for number, side in enumerate(SIDES) if f"{site}_{side}" in recording.sensors]
    names = tuple(f"{site}_{SIDES[number]}" for number in sides)
    own = recording._replace(sensors={name: recording.sensors[name] for name in names})
    mounting = [worn(p, own, SIDES[number]) for number in sides]
    stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *mounting)
    constants = AnklesConstants(p, stacked)
    return Device(f"{site}s", "ankle_stride", names, constants, begin, advance, ONLINE, tuple(sides))


def begin(c: AnklesConstants, sample: Readings, options: AnkleOptions) -> AnkleOnlineState:
    """The state before the first sample, see `Device`."""
    return jax.vmap(lambda one, gyr, acc: ankle_online.begin(c.p, one, gyr, acc, options))(
        c.worn, sample.gyr, sample.acc
    )


def advance(
    c: AnklesConstants, state: AnkleOnlineState, samples: Readings, count: Counts, options: AnkleOptions
) -> tuple[AnkleOnlineState, Now]:
    """A block of samples, see `Device`."""

    def one(own: Worn, before: AnkleOnlineState, gyr: Values, acc: Values, there: Flags) -> tuple[
        AnkleOnlineState, Now
    ]:  # fmt: skip
        return ankle_online.over(c.p, own, before, gyr, acc, there, options, count)

    along = (0, 0, 1, 1, 1)
    signals = (samples.gyr, samples.acc, samples.turned & samples.felt)
    return jax.vmap(one, in_axes=along, out_axes=(0, 1))(c.worn, state, *signals)
