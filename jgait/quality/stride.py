"""Evidence about strides: how far the signals, and a stride itself, are from those of a good stride.

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

Durations and lengths beside those of other strides, turns, speed, first and last strides, lost and clipped samples, the
sampling rate, the stated deviation itself, delays, free fall and rises of the trunk were evidence, too; no weight was
learned for them.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from jgait.geometry.arrays import xp
from jgait.notes import record
from jgait.quality.sensor import SensorQuality, of_sensor
from jgait.types import SIDES, AnyArray, Counts, Estimate, Strides, Values, as_float

EVIDENCE = (
    "innovation", "sensor_innovation", "rise", "apart", "cramped", "rows", "contradicts", "scale", "rates", "lever",
    "outside",
)  # fmt: skip
"""Names of the evidence, in the order of the model's weights."""

USUAL_NIS = 0.05
"""[1] NIS of usual strides, whose noise covers errors that last for a stance; the model learns what more means."""

FAR_OFF = 0.06
"""[1] Largest error of an accelerometer at rest, over gravity, that is usual: data sheets allow a bias of 0.05 and
more; sensors that are calibrated stay far below it."""

LEAST_FACTOR = 0.1
"""[1] Factor of the rates that smaller ones count as; one that is negative fits a gyroscope whose sign is reversed."""

LEAST_M = 0.05
"""[m], [m s] Length, and length times duration, that shorter strides count as."""


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


def above(values: Values, usual: float) -> Values:
    """The logarithm of values over a usual one, where it is positive, else 0; also for NaN."""
    return xp.log(xp.maximum(xp.where(xp.isfinite(values), values, 0.0), usual) / usual)


def of_stride(nis: Values, rise: Values, rise_spread: Values) -> dict[str, Values]:
    """The evidence of each stride by itself, for a recording and online: NIS (n,) [1], rise and its deviation [m]."""
    innovation = above(nis, USUAL_NIS)
    rises = above(xp.abs(rise) / xp.maximum(rise_spread, 1e-9), 1.0)
    return {"innovation": innovation, "rise": xp.sqrt(innovation * rises)}


def among(strides: Strides) -> dict[str, np.ndarray]:
    """The evidence of strides beside the others of their recording."""
    length, side = as_float(strides.length), np.asarray(strides.side)
    usual = [float(np.median(length[side == k])) if (side == k).any() else math.nan for k in (0, 1)]
    apart = abs(math.log(max(usual[0], LEAST_M) / max(usual[1], LEAST_M))) if np.isfinite(usual).all() else 0.0
    lasts = as_float(strides.end) - as_float(strides.start)
    slowly = np.maximum(np.abs(length) * lasts, LEAST_M)
    cramped = above(1.0 / slowly, 1.0)  # cadence and length grow together: less than 1 m s is little for their product
    return {"apart": np.full(length.shape, min(apart, 1.0)), "cramped": np.asarray(cramped)}


def of_estimate(estimate: Estimate, placements: Mapping[int, str]) -> dict[str, np.ndarray]:
    """All evidence about the strides of an estimate by one sensor on each side; `placements` as of `of_sensors`."""
    strides, spread = estimate.strides, estimate.strides_stddev
    innovations = of_stride(estimate.diagnostics["stride_nis"], strides.height, spread.height)
    return {**innovations, **among(strides), **of_sensors(estimate, placements)}


def by_side(side: AnyArray, values: Mapping[int, float]) -> np.ndarray:
    """(n,) of strides from a value of each side (0 right, 1 left); 0 for a side without."""
    return np.array([values.get(number, 0.0) for number in (0, 1)], np.float64)[np.asarray(side, int)]


def of_sensors(estimate: Estimate, placements: Mapping[int, str]) -> dict[str, np.ndarray]:
    """The evidence about the sensors that measure the strides; `placements` are sides (0 right, 1 left) → sensor."""
    diagnostics, side = estimate.diagnostics, estimate.strides.side
    facts = {number: of_sensor(diagnostics["sensors"], name) for number, name in placements.items()}
    nis = {k: float(above(as_float(diagnostics.get(f"nis_{SIDES[k]}", 0.0)), USUAL_NIS)) for k in placements}
    each: dict[str, Callable[[SensorQuality], float]] = {
        "scale": lambda sensor: abs(sensor.force_off) * (abs(sensor.force_off) > FAR_OFF),
        "rates": lambda sensor: abs(math.log(max(sensor.rates_factor, LEAST_FACTOR))) * sensor.rates_off,
        "lever": lambda sensor: sensor.lever_off,
        "rows": lambda sensor: math.log1p(sensor.rows_lost + sensor.rows_twice),
        "contradicts": lambda sensor: float(sensor.contradicts),
    }
    return {
        "sensor_innovation": by_side(side, nis),
        **{name: by_side(side, {k: value(sensor) for k, sensor in facts.items()}) for name, value in each.items()},
    }
