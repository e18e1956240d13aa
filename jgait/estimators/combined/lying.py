"""Sensors on one leg that lie still while the other leg walks: they fell off, or are not worn yet."""

from collections.abc import Mapping

import numpy as np

from jgait.estimators.combined.sources import SourceEstimate
from jgait.notes import Kind, Note
from jgait.types import SIDES, Imu, as_float

LIES_STILL = Kind(
    "lies_still", "check", "{placement} is still from {from_s:.0f} to {to_s:.0f} s, while the other leg walks: it fell "
    "off, or is not worn then",
    "No strides of this leg are measured there. The distance is that of the other leg.",
)  # fmt: skip

STILL, MOSTLY = 0.3, 0.9
"""[rad/s], [1] Rate below which a sensor is still, and least share of the time: a leg in walking swings longer."""

FEWEST_STRIDES = 3
"""Least number of successive strides of the other leg."""


def lying(source: SourceEstimate, sensors: Mapping[str, Imu]) -> tuple[dict[str, float], list[Note]]:
    """Placement → duration for which its sensor is still while the other leg walks [s], and notes on it."""
    strides = source.estimate.strides
    seconds: dict[str, float] = {}
    notes: list[Note] = []
    if strides is None or len(source.placements) != len(SIDES):
        return seconds, notes
    spans = np.stack([as_float(strides.start), as_float(strides.end)], axis=1)
    valid, sides = np.asarray(strides.valid, bool), np.asarray(strides.side)
    for name in source.placements:
        of = next(number for number, side in enumerate(SIDES) if name.endswith(side))
        leg_spans, other = (spans[valid & (sides == side)] for side in (of, 1 - of))
        leg_spans = leg_spans[np.argsort(leg_spans[:, 0])]
        after = np.concatenate([[-np.inf], np.maximum.accumulate(leg_spans[:, 1])])
        for begin, until in zip(after, [*leg_spans[:, 0], np.inf], strict=True) if len(leg_spans) else ():
            alone = other[(other[:, 0] >= begin) & (other[:, 1] <= until)]
            if len(alone) < FEWEST_STRIDES:
                continue
            first, last = float(alone[:, 0].min()), float(alone[:, 1].max())
            imu, time = sensors[name], as_float(sensors[name].time)
            there = (time >= first) & (time <= last) & np.asarray(imu.mask, bool)
            still = np.linalg.norm(as_float(imu.gyr)[there], axis=1) < STILL
            if still.size and still.mean() > MOSTLY:
                seconds[name] = seconds.get(name, 0.0) + last - first
                notes.append(LIES_STILL(placement=name, from_s=first - time[0], to_s=last - time[0]))
    return seconds, notes
