"""Strides sample by sample of the sensors at the ankles, on the shanks or on the feet, as devices."""

from types import ModuleType

import jax
from jaxtyping import PyTree

from jgait.estimators.ankle_stride import online as ankle_online
from jgait.estimators.foot_ins import online as foot_online
from jgait.estimators.online.device import Device, Readings
from jgait.geometry.arrays import stacked
from jgait.types import SIDES, Counts, Recording


def device(source: str, p: PyTree, recording: Recording) -> Device:
    """The device for a source, "feet", "ankles" or "shanks", of a person who walks in a recording.

    Its constants are the parameters, and the mountings of n sensors, leaves (n, …).

    Raises:
        RecordingError: as `worn` of `foot_ins.online` or `ankle_stride.online`.
    """
    of, site = (foot_online, "foot") if source == "feet" else (ankle_online, source.removesuffix("s"))
    sides = tuple(number for number, side in enumerate(SIDES) if f"{site}_{side}" in recording.sensors)
    names = tuple(f"{site}_{SIDES[number]}" for number in sides)
    alone = recording._replace(sensors={name: recording.sensors[name] for name in names})
    mountings = stacked(*(of.worn(p, alone, SIDES[number]) for number in sides))
    return Device(source, names, (p, mountings), begin, advance, of, sides)


def begin(constants: PyTree, sample: Readings, of: ModuleType) -> PyTree:
    """The state before the first sample, see `Device`; `of` is the estimator's module."""
    p, mountings = constants
    return jax.vmap(lambda worn, gyr, acc: of.begin(p, worn, gyr, acc))(mountings, sample.gyr, sample.acc)


def advance(
    constants: PyTree, state: PyTree, samples: Readings, count: Counts, of: ModuleType
) -> tuple[PyTree, PyTree]:
    """A block of samples, see `Device`."""
    p, mountings = constants
    return jax.vmap(
        lambda worn, before, gyr, acc, there: of.over(p, worn, before, gyr, acc, there, count),
        in_axes=(0, 0, 1, 1, 1), out_axes=(0, 1),
    )(mountings, state, samples.gyr, samples.acc, samples.turned & samples.acc_measured)  # fmt: skip
