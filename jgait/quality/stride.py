"""Evidence about strides: how far the signals, and a stride itself, are from those of a good stride.

Each piece of evidence is a number for each stride that is 0 where nothing is remarkable and grows with what is. A piece
that an estimator, or an online session, does not have is left out, which counts as 0.

| name | logarithm of, or value |
|---|---|
| `innovation` | normalised innovation squared (NIS) of the stride over that of usual strides |
| `sensor_innovation` | NIS of all observations of the sensor over that of usual sensors |
| `rise` | geometric mean of `innovation` and the logarithm of the rise over its deviation; stairs have a small NIS |
| `uncertainty` | stated relative deviation of the length over a usual one |
| `missing` | share of the stride's samples that are lost or clipped, root |
| `uneven` | duration over the median of the strides around it |
| `unlike` | length over the median of the recording |
| `apart` | median length of the stride's side over that of the other side |
| `turn` | change of heading over half a turn |
| `slow`, `fast` | speed below 1 m/s, above 1.5 m/s |
| `quick` | duration below 0.9 s |
| `end` | 1 for the first and the last stride of a side |
| `scale` | relative difference of the specific force at rest from gravity, if it is larger than usual |
| `rates` | factor of the angular rates with which signals fit from stance to stance, if it is far from 1 |
| `coarse` | interval between samples over 10 ms |
| `lever` | distance of the sensor's estimated place from where it is worn, if it is far [m] |
| `weightless` | least upward force in the steps over gravity, below half |
| `climb` | rise of the trunk over the stride [m] |
| `sparse` | steps by the trunk's frequency over contacts |
| `cramped` | length times duration below 1 m s, as in shuffling |
| `rows` | rows of the file that are missing or written twice, and one |
| `contradicts` | 1 if the sensor's signals contradict gravity or each other |
| `late` | delays of the accelerometer behind the gyroscope, and of the sensor behind that above it [s] |
| `outside` | relative deviation of strides outside those from which the method was learned |
| `differs` | rate over that of the other leg, if it is larger than usual |
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from jgait.geometry.arrays import xp
from jgait.quality.sensor import SensorQuality, of_sensor
from jgait.types import SIDES, AnyArray, Counts, Estimate, Strides, Values, as_float

EVIDENCE = (
    "innovation", "sensor_innovation", "rise", "uncertainty", "missing", "uneven", "unlike", "apart", "turn", "slow",
    "fast", "quick", "end", "scale", "rates", "coarse", "lever", "weightless", "climb", "sparse", "cramped", "rows",
    "contradicts", "late", "differs", "outside",
)  # fmt: skip
"""Names of the evidence, in the order of the model's weights."""

USUAL_NIS, USUAL_DEVIATION = 0.05, 0.01
"""[1] NIS of usual strides, whose noise covers errors that last for a stance, and their relative deviation; the model
learns what more than these means."""

LEISURELY, BRISK, QUICK_S, INTERVAL_S = 1.0, 1.5, 0.9, 0.01
"""[m/s], [m/s], [s], [s] Where `slow`, `fast`, `quick` and `coarse` begin: most public strides are inside."""

FAR_OFF = 0.06
"""[1] Largest error of an accelerometer at rest, over gravity, that is usual: data sheets allow a bias of 0.05 and
more; sensors that are calibrated stay far below it."""

CRAMPED = 1.0
"""[m s] Length times duration of a stride below which it is cramped: cadence and length of a person grow together."""

AROUND = 3
"""Number of strides before and after a stride, with which `uneven` compares it."""


class StrideQuality(NamedTuple):
    """What is known about the quality of each stride of an estimate, (n,) each."""

    doubt: np.ndarray  #: probability that the length is off by more than three of the stated deviations [1].
    factor: np.ndarray  #: by which the method's own deviations were multiplied [1].
    interval: np.ndarray  #: deviations, so multiplied, that contain 95 % of the errors [1].
    evidence: dict[str, np.ndarray]  #: name, see the module → evidence [1].


def nis_between(nis: Values, count: Counts, begin: Counts, end: Counts) -> Values:
    """Mean normalised innovation squared (n,) [1] of the observations after sample `begin` and up to sample `end`.

    Args:
        nis: (T,) normalised innovation squared of each sample, 0 without an observation.
        count: (T,) number of observed components.
        begin: (n,) first sample of each stride, exclusive.
        end: (n,) last sample.
    """
    values = xp.where(xp.isfinite(nis), nis, 0.0)
    both = xp.cumsum(xp.stack([values, count.astype(nis.dtype)], axis=1), axis=0)
    squares, many = (both[end] - both[begin]).T
    return squares / xp.maximum(many, 1.0)


def above(values: Values, usual: float) -> Values:
    """The logarithm of values over a usual one, where it is positive, else 0; also for NaN."""
    return xp.log(xp.maximum(xp.where(xp.isfinite(values), values, 0.0), usual) / usual)


def of_stride(length: Values, spread: Values, nis: Values, rise: Values, rise_spread: Values) -> dict[str, Values]:
    """The evidence of each stride by itself, for a recording and online: (n,) length and rise with their deviations [m]
    and NIS [1].
    """
    innovation = above(nis, USUAL_NIS)
    rises = above(xp.abs(rise) / xp.maximum(rise_spread, 1e-9), 1.0)
    return {
        "innovation": innovation,
        "rise": xp.sqrt(innovation * rises),
        "uncertainty": above(spread / xp.maximum(xp.abs(length), 0.1), USUAL_DEVIATION),
    }


def among(strides: Strides) -> dict[str, np.ndarray]:
    """The evidence of strides beside the others of their recording, for strides in the order of their ends."""
    length, side = as_float(strides.length), np.asarray(strides.side)
    lasts = as_float(strides.end) - as_float(strides.start)
    speed = as_float(strides.speed) if strides.speed is not None else length / np.maximum(lasts, 1e-3)
    turn = np.zeros(len(length)) if strides.turn is None else np.abs(np.nan_to_num(as_float(strides.turn)))
    uneven, end, apart = np.zeros(len(length)), np.zeros(len(length)), np.zeros(len(length))
    usual = [float(np.median(length[rows])) if (rows := side == k).any() else np.nan for k in (0, 1)]
    for k in (0, 1):
        rows = np.flatnonzero(side == k)
        end[rows[:1]] = end[rows[-1:]] = 1.0
        for number, row in enumerate(rows):
            near = lasts[rows[max(number - AROUND, 0) : number + AROUND + 1]]
            uneven[row] = _apart(lasts[row], float(np.median(near)))
        apart[rows] = _apart(usual[0], usual[1])
    middle = float(np.median(length)) if len(length) else 1.0
    return {
        "uneven": uneven,
        "unlike": _apart(length, middle),
        "apart": apart,
        "turn": np.minimum(turn / np.pi, 1.0),
        "slow": np.asarray(above(1.0 / np.maximum(speed, 0.05), 1.0 / LEISURELY)),
        "fast": np.asarray(above(speed, BRISK)),
        "quick": np.asarray(above(1.0 / np.maximum(lasts, 0.1), 1.0 / QUICK_S)),
        "end": end,
        "cramped": np.asarray(above(1.0 / np.maximum(np.abs(length) * lasts, 0.05), 1.0 / CRAMPED)),
    }


def _apart(value: np.ndarray | float, usual: float) -> np.ndarray:
    """The size of the logarithm of a ratio, at most 1; 0 if it is not known."""
    ratio = np.maximum(np.asarray(value, np.float64), 1e-3) / max(usual, 1e-3)
    return np.nan_to_num(np.minimum(np.abs(np.log(ratio)), 1.0))


def missing(strides: Strides, begin: np.ndarray, time: np.ndarray, damaged: Mapping[int, np.ndarray]) -> np.ndarray:
    """(n,) root of the share of each stride's samples, from `begin` [s] to its end, that are lost or clipped.

    `damaged` maps a side (0 right, 1 left) to flags of samples (T,) at times (T,) [s].
    """
    share = np.zeros(len(begin))
    first, last = np.searchsorted(time, begin), np.searchsorted(time, as_float(strides.end), side="right")
    for number, flags in damaged.items():
        total = np.concatenate([[0.0], np.cumsum(np.asarray(flags, np.float64))])
        rows = np.asarray(strides.side) == number
        share[rows] = ((total[last] - total[first]) / np.maximum(last - first, 1))[rows]
    return np.sqrt(share)


def by_side(side: AnyArray, values: Mapping[int, float]) -> np.ndarray:
    """(n,) of strides from a value of each side (0 right, 1 left); 0 for a side without."""
    return np.array([values.get(number, 0.0) for number in (0, 1)], np.float64)[np.asarray(side, int)]


def of_sensors(estimate: Estimate, placements: Mapping[int, str]) -> dict[str, np.ndarray]:
    """The evidence about the sensors that measure the strides; `placements` are sides (0 right, 1 left) → sensor."""
    diagnostics, side = estimate.diagnostics, estimate.strides.side
    facts = {number: of_sensor(diagnostics["sensors"], name) for number, name in placements.items()}
    nis = {k: float(above(as_float(diagnostics.get(f"nis_{SIDES[k]}", 0.0)), USUAL_NIS)) for k in placements}
    interval = float(np.median(np.diff(as_float(estimate.time))))
    each: dict[str, Callable[[SensorQuality], float]] = {
        "scale": lambda sensor: abs(sensor.force_off) * (abs(sensor.force_off) > FAR_OFF),
        "rates": lambda sensor: abs(math.log(sensor.rates_factor)) * sensor.rates_off,
        "lever": lambda sensor: sensor.lever_off,
        "rows": lambda sensor: math.log1p(sensor.rows_lost + sensor.rows_twice),
        "contradicts": lambda sensor: float(sensor.contradicts),
        "late": lambda sensor: abs(sensor.acc_late) + abs(sensor.late),
        "differs": lambda sensor: abs(math.log(sensor.faster)),
    }
    return {
        "sensor_innovation": by_side(side, nis),
        "coarse": np.full(np.shape(side), float(above(interval, INTERVAL_S))),
        **{name: by_side(side, {k: value(sensor) for k, sensor in facts.items()}) for name, value in each.items()},
    }
