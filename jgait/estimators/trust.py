"""Doubt about strides and recordings: innovations that do not fit the model, and rises and stances that contradict it.

The normalised innovation squared (NIS) of a stride is the mean over the observations from its first to its last
stance. The noise of zero velocities is set for errors that stay the same over a stance, so that the NIS of good strides
is about 0.05; limits below are for the default noise.
"""

from typing import Any, NamedTuple

import numpy as np

from jgait.geometry.arrays import xp
from jgait.notes import Kind, Note
from jgait.quality import SensorQuality, merged, of_sensor
from jgait.types import Counts, Estimate, Flags, Strides, Values, as_float

LARGEST_NIS = 4.0
"""[1] NIS above which a stride is in doubt. Chosen, as `RISES_FROM`, on 1602 strides of feet and shanks."""

RISE, RISES_FROM = 2.5, 0.15
"""[1] A rise of more than `RISE` deviations puts a stride in doubt, if its NIS is above `RISES_FROM`: real stairs are
measured with a small NIS."""

UNCERTAIN = 0.25
"""[m] Standard deviation of a stride's length above which the stride is in doubt, as after seconds without a stance."""

SLOW_SHARE = 0.05
"""[1] Relative standard deviation of a stride's length if the sensor is sampled slowly; chosen with simulated shanks at
25 and 30 Hz."""

SCALE_SHARE = 0.65
"""[1] Relative standard deviation of a stride's length, per relative error of the accelerometer at rest, which may come
from its scale or its bias; chosen with simulated feet and shanks with scales of 0.9 to 1.1."""

RATES_SHARE = 2.0
"""[1] Relative standard deviation of a stride's length, per logarithm of the factor of the rates; lengths grow with the
square of the interval between samples."""

_MEANING = (
    "Strides are measured between moments at which the foot stands still on the ground. Sliding, kneeling, crawling, "
    "running or a loose sensor breaks this, and lengths and positions can be off by far more than their stated "
    "deviations. Fasten the sensor and record the walk again, or use the strides that are not in doubt."
)

INCONSISTENT = Kind(
    "inconsistent_stances",
    "check",
    "{placement}: the foot does not seem to stand still between its swings: the motion of the sensor "
    "there is beyond what good walks have ({times:.2f} times their limit)",
    _MEANING,
)

STRIDES_DOUBTFUL = Kind(
    "strides_doubtful",
    "check",
    "{placement}: {strides} of {total} strides {strides:is|are} in doubt: the foot does not seem to stand still before "
    "or after {strides:it|them}",
    _MEANING,
)

STANCES_RARE = Kind(
    "stances_rare",
    "stop",
    "{placement}: no stance for so long that a stride is known to {deviation_m:.1f} m only",
    "The position is integrated from stance to stance, and drifts by metres without stances. Do not use positions and "
    "lengths. Stances are missing where samples are lost; a kneeling, crawling or carried foot does not stand.",
)

DOUBTS = (INCONSISTENT.code, STRIDES_DOUBTFUL.code, STANCES_RARE.code)
"""Codes of the notes of a recording that is in doubt."""


class Trust(NamedTuple):
    """Whether the stated deviations of an estimate can be trusted."""

    #: (n,) bool, in the order of `Estimate.strides`; None if the estimator does not judge strides.
    strides: np.ndarray | None
    recording: bool  #: False if the whole recording is in doubt.
    reasons: tuple[Note, ...]  #: the notes that put it in doubt.


def trust(estimate: Estimate) -> Trust:
    """The trust in an estimate, per stride and for the recording, from its diagnostics and notes."""
    doubted = estimate.diagnostics.get("doubtful")
    notes = estimate.diagnostics.get("notes", ())
    reasons = tuple(note for note in notes if note.code in DOUBTS or note.severity == "stop")
    return Trust(None if doubted is None else ~np.asarray(doubted, bool), not reasons, reasons)


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


def doubtful(strides: Strides, deviations: Strides, nis: Values) -> Flags:
    """(n,) bool, the strides that are in doubt, from their rises [m], standard deviations and NIS (n,) [1]."""
    rises = strides.height**2 > (RISE * deviations.height) ** 2
    return (nis > LARGEST_NIS) | (rises & (nis > RISES_FROM)) | (deviations.length > UNCERTAIN)


def judged(result: Estimate, placements: dict[int, str], limit: float, nis: dict[int, float]) -> Estimate:
    """The estimate with `doubtful` (n,) in its diagnostics, and notes on sensors that are in doubt.

    Args:
        result: without padding, with `stride_nis` (n,) in its diagnostics.
        placements: side (0 right, 1 left) → placement of the sensor.
        limit: NIS [1] of a sensor above which its results are in doubt, and with them the strides with twice this NIS.
        nis: side → NIS of all observations of the sensor [1].
    """
    result = _of_sensors(result, placements)
    strides, deviations, diagnostics = result.strides, result.strides_stddev, result.diagnostics
    each = as_float(diagnostics["stride_nis"])
    flags = doubtful(strides, deviations, each)
    notes: list[Note] = []
    rare: dict[str, SensorQuality] = {}
    for side, placement in placements.items():
        of_side = np.asarray(strides.side) == side
        deviation = float(np.max(as_float(deviations.length)[of_side], initial=0.0))
        many, total = int(flags[of_side].sum()), int(of_side.sum())
        rare[placement] = SensorQuality(unusable=deviation > UNCERTAIN)
        notes += doubts_of(placement, limit, nis[side], deviation, many, total)
        if nis[side] > limit:
            flags |= of_side & (each > 2.0 * limit)
    sensors = merged(diagnostics.get("sensors", {}), rare)
    more: dict[str, Any] = {"doubtful": flags, "notes": (*diagnostics.get("notes", ()), *notes), "sensors": sensors}
    return result._replace(diagnostics={**diagnostics, **more})


def _of_sensors(result: Estimate, placements: dict[int, str]) -> Estimate:
    """The estimate with larger deviations of the strides of sensors that are in doubt, see `share_of`."""
    share = np.zeros(np.shape(result.strides.side))
    for side, placement in placements.items():
        facts = of_sensor(result.diagnostics.get("sensors", {}), placement)
        share = np.where(np.asarray(result.strides.side) == side, share_of(facts), share)
    return wider(result, share)


def rates_share(facts: SensorQuality) -> float:
    """Relative standard deviation of stride lengths [1] because of rates that are off."""
    return RATES_SHARE * abs(float(np.log(facts.rates_factor)))


LEVER_SHARE = 0.7
"""[1/m] Relative standard deviation of a stride's length, per error of the sensor's estimated place; chosen with
simulated shanks with seated movements and cycling between walks."""


def share_of(facts: SensorQuality) -> float:
    """Relative standard deviation of the lengths of a sensor's strides [1] because of what is wrong with the sensor."""
    return max(
        SCALE_SHARE * abs(facts.force_off), rates_share(facts), SLOW_SHARE * facts.sampled_slowly,
        LEVER_SHARE * facts.lever_off,
    )  # fmt: skip


def wider(result: Estimate, share: np.ndarray) -> Estimate:
    """The estimate with an additional relative deviation (n,) [1] of strides, and of their part of the distance.

    Errors of strides are taken to have one cause, so that they add up in the distance.
    """
    strides, deviations, diagnostics = result.strides, result.strides_stddev, dict(result.diagnostics)
    if not share.any():
        return result
    if "distance_stddev" in diagnostics:
        lengths = np.where(np.asarray(strides.valid, bool), as_float(strides.length), 0.0)
        errors = np.cumsum(share * lengths) / max(float(lengths.sum()), 1e-9)
        so_far = np.interp(as_float(result.time), as_float(strides.end), errors, left=0.0)
        more = so_far * abs(float(result.distance[-1]))
        diagnostics["distance_stddev"] = np.hypot(as_float(diagnostics["distance_stddev"]), more)
    if deviations is not None:
        deviations = deviations._replace(**{
            name: np.hypot(as_float(spread), share * np.abs(as_float(getattr(strides, name))))
            for name in ("length", "speed", "step_length") if (spread := getattr(deviations, name)) is not None
        })  # fmt: skip
    return result._replace(strides_stddev=deviations, diagnostics=diagnostics)


def doubts_of(placement: str, limit: float, nis: float, deviation: float, many: int, total: int) -> list[Note]:
    """Notes on a sensor: `limit` and `nis` as of `judged`; the largest deviation of its strides' lengths [m]; how many
    of its strides are in doubt, and how many there are.
    """
    notes = []
    if deviation > UNCERTAIN:
        notes.append(STANCES_RARE(placement=placement, deviation_m=deviation))
    if nis > limit:
        notes.append(INCONSISTENT(placement=placement, times=(nis / limit) ** 0.5))
    elif many > DOUBTED_SHARE * total:
        notes.append(STRIDES_DOUBTFUL(placement=placement, strides=many, total=total))
    return notes


DOUBTED_SHARE = 0.2
"""[1] Share of a sensor's strides in doubt above which a note names them."""
