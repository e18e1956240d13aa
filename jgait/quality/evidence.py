"""Facts about sensors, and evidence about strides: how far the signals, and a stride, are from those of a good one.

Each piece of evidence is a number for each stride that is 0 where nothing is remarkable and grows with what is. A piece
that an estimator, or an online session, does not have is left out, which counts as 0.

| name | logarithm of, or value |
|---|---|
| `innovation` | normalised innovation squared (NIS) of the stride over that of usual strides |
| `sensor_innovation` | NIS of all observations of the sensor over that of usual sensors |
| `rise` | geometric mean of `innovation` and the logarithm of the rise over its deviation; stairs have a small NIS |
| `apart` | median length of the stride's side over that of the other side |
| `cramped` | length times duration below 1 m s, as in shuffling |
| `rows` | rows of the file that are missing or written twice, and one |
| `contradicts` | 1 if the sensor's signals contradict gravity or each other |
| `scale` | relative difference of the specific force at rest from gravity, if it is larger than usual |
| `rates` | factor of the angular rates with which signals fit from stance to stance, if it is far from 1 |
| `lever` | distance of the sensor's estimated place from where it is worn, if it is far [m] |
| `outside` | relative deviation of strides outside those from which the method was learned |
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.geometry.arrays import xp
from jgait.notes import record
from jgait.types import SIDES, Counts, Estimate, Strides, Values, as_float

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
    def rates_error(self) -> float:
        """Logarithm of the factor of the rates if it is far from 1, without its sign [1]; a factor below 0.1 counts as
        0.1, because one that is negative fits a gyroscope whose sign is reversed.
        """
        return abs(math.log(max(self.rates_factor, 0.1))) * self.rates_off

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


EVIDENCE = (
    "innovation", "sensor_innovation", "rise", "apart", "cramped", "rows", "contradicts", "scale", "rates", "lever",
    "outside",
)  # fmt: skip
"""Names of the evidence, in the order of the model's weights."""

USUAL_NIS = 0.05
"""[1] NIS of usual strides, whose noise covers errors that last for a stance; chosen by hand, and the model learns what
more means."""

FAR_OFF = 0.06
"""[1] Largest error of an accelerometer at rest, over gravity, that is usual: data sheets allow a bias of 0.05 and
more; sensors that are calibrated stay far below it."""


@record
class StrideQuality(NamedTuple):
    """What is known about the quality of each stride of an estimate, (n,) each."""

    doubt: np.ndarray  #: probability that the length is off by more than three of the stated deviations [1].
    factor: np.ndarray  #: by which the method's own deviations were multiplied [1].
    interval: np.ndarray  #: deviations, so multiplied, that contain 95 % of the errors [1].
    evidence: dict[str, np.ndarray]  #: name, see the module → evidence [1].


def nis_between(nis: Values, count: Counts, begin: Counts, end: Counts) -> Values:
    """Mean normalised innovation squared (n,) [1] of the observations after sample `begin` and up to sample `end` of
    each stride, from that of each sample (T,), 0 without an observation, and the number of observed components (T,).
    """
    values = xp.where(xp.isfinite(nis), nis, 0.0)
    both = xp.cumsum(xp.stack([values, count.astype(nis.dtype)], axis=1), axis=0)
    squares, many = (both[end] - both[begin]).T
    return squares / xp.maximum(many, 1.0)


def excess(values: Values, usual: float) -> Values:
    """The logarithm of values over a usual one, where it is positive, else 0; also for NaN."""
    return xp.log(xp.maximum(xp.where(xp.isfinite(values), values, 0.0), usual) / usual)


def of_stride(nis: Values, rise: Values, rise_spread: Values) -> dict[str, Values]:
    """The evidence of each stride by itself, for a recording and online: NIS (n,) [1], rise and its deviation [m]."""
    innovation = excess(nis, USUAL_NIS)
    rises = excess(xp.abs(rise) / xp.maximum(rise_spread, 1e-9), 1.0)
    return {"innovation": innovation, "rise": xp.sqrt(innovation * rises)}


def among(strides: Strides) -> dict[str, np.ndarray]:
    """The evidence of strides beside the others of their recording; shorter ones count as 5 cm, or as 0.05 m s."""
    length, side, least = as_float(strides.length), np.asarray(strides.side), 0.05
    usual = [float(np.median(length[side == k])) if (side == k).any() else math.nan for k in (0, 1)]
    apart = abs(math.log(max(usual[0], least) / max(usual[1], least))) if np.isfinite(usual).all() else 0.0
    lasts = as_float(strides.end) - as_float(strides.start)
    slowly = np.maximum(np.abs(length) * lasts, least)
    cramped = excess(1.0 / slowly, 1.0)  # cadence and length grow together: less than 1 m s is little for their product
    return {"apart": np.full(length.shape, min(apart, 1.0)), "cramped": np.asarray(cramped)}


def of_estimate(estimate: Estimate, placements: Mapping[int, str]) -> dict[str, np.ndarray]:
    """All evidence about the strides of an estimate by one sensor on each side; `placements` as of `of_sensors`."""
    strides, spread = estimate.strides, estimate.strides_stddev
    innovations = of_stride(estimate.diagnostics["stride_nis"], strides.height, spread.height)
    return {**innovations, **among(strides), **of_sensors(estimate, placements)}


def of_sensors(estimate: Estimate, placements: Mapping[int, str]) -> dict[str, np.ndarray]:
    """The evidence about the sensors that measure the strides; `placements` are sides (0 right, 1 left) → sensor."""
    names = ("sensor_innovation", "scale", "rates", "lever", "rows", "contradicts")
    diagnostics, each = estimate.diagnostics, np.zeros((len(SIDES), len(names)))
    for side, name in placements.items():
        sensor = of_sensor(diagnostics["sensors"], name)
        off, rows = abs(sensor.force_off), sensor.rows_lost + sensor.rows_twice
        nis = float(excess(as_float(diagnostics.get(f"nis_{SIDES[side]}", 0.0)), USUAL_NIS))
        each[side] = (
            nis, off * (off > FAR_OFF), sensor.rates_error, sensor.lever_off, math.log1p(rows), sensor.contradicts
        )  # fmt: skip
    return dict(zip(names, each[np.asarray(estimate.strides.side, int)].T, strict=True))
