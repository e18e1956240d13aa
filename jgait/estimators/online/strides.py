"""Strides sample by sample of the sensors at the ankles, on the shanks or on the feet, as devices."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from jgait.estimators.ankle_stride import online as ankle_online
from jgait.estimators.ankle_stride.params import AnkleParams
from jgait.estimators.foot_ins import online as foot_online
from jgait.estimators.foot_ins.params import FootParams
from jgait.estimators.online.device import Device, Readings
from jgait.types import SIDES, Counts, Recording


class StridesConstants(NamedTuple):
    """Parameters; mounting of n sensors, leaves (n, …)."""

    p: AnkleParams | FootParams
    worn: PyTree


def _online(p: AnkleParams | FootParams) -> Any:
    """The module that processes the samples."""
    return foot_online if isinstance(p, FootParams) else ankle_online


def device(source: str, p: AnkleParams | FootParams, recording: Recording) -> Device:
    """The device for a source, "feet", "ankles" or "shanks", of a person who walks in a recording.

    Raises:
        RecordingError: as `worn` of `foot_ins.online` or `ankle_stride.online`.
    """
    site = "foot" if source == "feet" else source.removesuffix("s")
    sides = tuple(number for number, side in enumerate(SIDES) if f"{site}_{side}" in recording.sensors)
    names = tuple(f"{site}_{SIDES[number]}" for number in sides)
    alone = recording._replace(sensors={name: recording.sensors[name] for name in names})
    mounting = [
        foot_online.worn(alone, SIDES[number])
        if isinstance(p, FootParams)
        else ankle_online.worn(p, alone, SIDES[number])
        for number in sides
    ]
    constants = StridesConstants(p, jax.tree.map(lambda *leaves: np.stack(leaves), *mounting))
    return Device(source, names, constants, begin, advance, None, sides)


def begin(c: StridesConstants, sample: Readings, _: None) -> PyTree:
    """The state before the first sample, see `Device`."""
    return jax.vmap(lambda worn, gyr, acc: _online(c.p).begin(c.p, worn, gyr, acc))(c.worn, sample.gyr, sample.acc)


def advance(c: StridesConstants, state: PyTree, samples: Readings, count: Counts, _: None) -> tuple[PyTree, PyTree]:
    """A block of samples, see `Device`."""
    measured = samples.turned & samples.felt
    return jax.vmap(
        lambda worn, before, gyr, acc, there: _online(c.p).over(c.p, worn, before, gyr, acc, there, count),
        in_axes=(0, 0, 1, 1, 1),
        out_axes=(0, 1),
    )(c.worn, state, samples.gyr, samples.acc, measured)
