"""Facts about one sensor in one recording."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.types import SIDES

ABOVE = {"shank": "thigh", "ankle": "shank", "foot": "shank"}
"""Segment of a leg → the segment above it, with whose impacts its own are compared."""


class SensorQuality(NamedTuple):
    """Facts about one sensor in one recording; each default is the value of a sensor without that fault.

    Readers fill the first part from the signals alone, estimators the second part from the walk that they measure.
    """

    left_out: str = ""  #: why a reader left the sensor out; "" if the reader kept the sensor.
    contradicts: bool = False  #: the signals contradict gravity, each other or the other sensors of the person.
    acc_late: float = 0.0  #: delay of the accelerometer behind the gyroscope [s].
    late: float = 0.0  #: delay behind the sensor above it on the same leg [s].
    faster: float = 1.0  #: rate over that of the same segment of the other leg, if larger than on a usual leg [1].
    step_share: float = 0.5  #: time from a step of the other foot to the next one of this foot [strides].
    rows_lost: int = 0  #: number of places at which rows of the file are missing although time goes on.
    rows_twice: int = 0  #: number of rows of the file that are written twice although time goes on.
    begin: float = 0.0  #: time of the first sample in the file [s], from which times count.
    time_spread: float = 0.0  #: relative deviation of the interval between samples [1]; 0 if time stamps measure it.
    force_off: float = 0.0  #: relative difference of the accelerometer at rest from gravity [1].
    rates_factor: float = 1.0  #: factor on the rates with which the signals fit from stance to stance [1].
    rates_off: bool = False  #: that factor is far from 1.
    lever_off: float = 0.0  #: distance of the place of the sensor that fits the strides from where it is worn [m].
    gyr_clipped: int = 0  #: number of samples in which the gyroscope clips.
    acc_clipped: int = 0  #: number of samples in which the accelerometer clips.
    lost: int = 0  #: number of lost samples.
    strides_missing: int = 0  #: number of strides that are left out because of lost samples.
    swings: int = 0  #: number of swings that are counted as strides, stated with `small_swings`.
    small_swings: int = 0  #: number of swings that are too small to be counted as strides, if they are many.
    walks_before: float = 0.0  #: duration of walking before the first whole stride [s].
    walks_after: float = 0.0  #: duration of walking after the last whole stride [s].
    quick_stride: float = np.inf  #: median duration of a stride, if it is as short as in running [s]; else inf.
    unlike: bool = False  #: the walk is unlike those from which the estimator's lengths were learned.
    unusable: bool = False  #: the estimator states that its numbers from this sensor must not be used.
    slips_at: float = np.inf  #: time from the first sample at which the sensor slipped on its segment [s]; inf: never.
    alone: bool = False  #: the sensor is not used because the other segment of its leg has no sensor.

    @property
    def incomplete(self) -> bool:
        """Whether strides of this sensor can be missing at the begin or the end of a walk."""
        return any((self.lost, self.strides_missing, self.small_swings, self.walks_before, self.walks_after))

    @property
    def runs(self) -> bool:
        """Whether strides are as short as in running."""
        return bool(np.isfinite(self.quick_stride))

    @property
    def wrong(self) -> bool:
        """Whether the signals of the sensor are wrong as a whole, and not in some samples alone."""
        return self.contradicts or self.acc_late != 0.0


SOUND = SensorQuality()
"""A sensor without a fault."""


def of_sensor(quality: Mapping[str, SensorQuality], placement: str) -> SensorQuality:
    """The quality of the sensor at a placement; that of a sound sensor if nothing is stated."""
    return quality.get(placement, SOUND)


def merged(*parts: Mapping[str, SensorQuality]) -> dict[str, SensorQuality]:
    """Placement → all facts of several parts; of two values that are not the default, the later one."""
    whole: dict[str, SensorQuality] = {}
    for part in parts:
        for placement, facts in part.items():
            changed = {name: value for name, value in facts._asdict().items() if value != getattr(SOUND, name)}
            whole[placement] = of_sensor(whole, placement)._replace(**changed)
    return whole


def above(placement: str) -> str:
    """The placement above on the same leg: "shank_right" for "foot_right"; "" if there is none."""
    segment, _, side = placement.partition("_")
    return f"{ABOVE[segment]}_{side}" if segment in ABOVE else ""


def opposite(placement: str) -> str:
    """The same segment of the other leg: "foot_left" for "foot_right"; "" if there is none."""
    segment, _, side = placement.partition("_")
    return f"{segment}_{SIDES[1 - SIDES.index(side)]}" if side in SIDES else ""
