"""Checks of the sensors of a recording, by whole kinds: range, stuck and clipped readings; losses; gravity and units;
order and rate of samples; sides and places. What cannot be right is masked, left out or refused, what contradicts
itself or others gets a note.
"""

import itertools
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.io.checks import limits
from jgait.io.checks.gravity import gravity_notes, slow_gyroscope
from jgait.io.checks.order import accelerometer_late, late_behind, rows_wrong
from jgait.io.checks.pace import LegPace, pace_notes, paces_of
from jgait.io.checks.readings import channel_notes
from jgait.io.checks.sides import out_of_step, sides_differ, turn_notes
from jgait.io.units import Unit
from jgait.mounting.places import places_in
from jgait.notes import DATA_LOST, Note, record
from jgait.quality import SensorQuality, merged
from jgait.quality import notes as writer
from jgait.signal.windows import over_losses, true_runs
from jgait.types import SIDES, Imu, Recording, as_float

__all__ = ["Contradictions", "contradictions", "quality_notes"]


@record
class Contradictions(NamedTuple):
    """Sensors that contradict themselves or each other."""

    quality: dict[str, SensorQuality]  #: placement → what is wrong with its sensor.
    notes: tuple[Note, ...]  #: the same in words.


def quality_notes(recording: Recording, noted: Mapping[str, np.ndarray] | None = None) -> tuple[Note, ...]:
    """Notes about doubtful signals of a structurally sound recording: missing samples, clipped or constant channels.

    Args:
        recording: the recording.
        noted: placement → (T,) bool, missing samples that other notes report.
    """
    notes: list[Note] = []
    for placement, imu in recording.sensors.items():
        present = np.asarray(imu.mask) | (False if noted is None else noted[placement])
        notes += _loss_notes(placement, present, imu, recording.sampling_rate_hz) + channel_notes(placement, imu)
    return tuple(notes)


def _long_gaps(present: np.ndarray, rate_hz: float) -> list[tuple[int, int]]:
    """The gaps that are too long to be bridged, each as its first sample and the one after its last."""
    return [(start, end) for start, end in true_runs(~present) if end - start > limits.LONG_GAP_S * rate_hz]


def _loss_notes(placement: str, present: np.ndarray, imu: Imu, rate_hz: float) -> list[Note]:
    """Notes about long stretches of samples that are not present (T,), and about the number of others."""
    long, notes = _long_gaps(present, rate_hz), []
    if len(long) < len(true_runs(~present)):
        many = "{placement}: samples missing: {missing} of {samples}"
        notes.append(DATA_LOST.note(many, placement=placement, missing=(~present).sum(), samples=len(present)))
    for start, end in long:
        text = f"{(end - start) / rate_hz:.2f} s missing from {float(imu.time[start] - imu.time[0]):.2f} s"
        notes.append(DATA_LOST.note(text, placement=placement))
    return notes


def contradictions(
    recording: Recording, units: Mapping[str, Unit] | None = None, whole: Recording | None = None
) -> Contradictions:
    """Sensors of one length that contradict themselves or each other in walking: scale, sign, axes, delays, rows
    without stamps. `units` are those of the gyroscopes, for messages; `whole` has movements that are no walking, too.
    """
    rate_hz = recording.sampling_rate_hz
    if rate_hz < limits.SLOWEST_HZ or len({len(imu.time) for imu in recording.sensors.values()}) != 1:
        return Contradictions({}, ())
    lost = {placement: np.zeros(len(imu.mask), bool) for placement, imu in recording.sensors.items()}
    for placement, imu in recording.sensors.items():
        for start, end in _long_gaps(np.asarray(imu.mask, bool), rate_hz):
            lost[placement][start:end] = True
    sensors = {placement: _bridged(imu, lost[placement]) for placement, imu in recording.sensors.items()}
    slow = {
        placement: note
        for each in (recording, whole or recording) for placement, imu in each.sensors.items()
        if (note := slow_gyroscope(placement, imu, rate_hz, (units or {}).get(placement)))
    }  # fmt: skip
    # a gyroscope that hardly turns contradicts every other sensor: its note explains that
    worn = {placement: imu for placement, imu in sensors.items() if placement not in slow}
    itself = {p: [slow[p]] if p in slow else gravity_notes(p, imu, lost[p], rate_hz) for p, imu in sensors.items()}
    wrong = {placement for placement, notes in itself.items() if notes}
    turns = [turn for turn in turn_notes(sensors, lost, rate_hz, wrong) if turn[0][0] not in slow]
    wrong |= {placement for placements, _ in turns for placement in placements}
    paces = paces_of(worn, lost, rate_hz)
    of_sides = _of_sides(worn, paces, rate_hz)
    late = {placement: accelerometer_late(placement, imu, rate_hz) for placement, imu in sensors.items()}
    of_legs, leg_notes = _of_legs(sensors, rate_hz)
    rows, row_notes = rows_wrong(sensors, rate_hz)
    quality = merged(
        {placement: SensorQuality(contradicts=placement in wrong) for placement in sensors}, of_sides,
        {placement: delay for placement, (delay, _) in late.items()}, of_legs, dict.fromkeys(sensors, rows),
    )  # fmt: skip
    notes = itertools.chain(
        *itself.values(), pace_notes(paces), writer.contradictions(of_sides), (note for _, note in turns),
        *(each for _, each in late.values()), leg_notes, row_notes,
    )  # fmt: skip
    return Contradictions(quality, tuple(notes))


def _of_sides(sensors: Mapping[str, Imu], paces: Mapping[str, LegPace], rate_hz: float) -> dict[str, SensorQuality]:
    """Sensors that contradict the same segment of the other leg."""
    quality: dict[str, SensorQuality] = {}
    for segment in limits.TILTED_DEG:
        right, left = (f"{segment}_{side}" for side in SIDES)
        if right in sensors and left in sensors:
            quality |= sides_differ(right, left, sensors, rate_hz)
            if segment == "foot" and right in paces and left in paces:
                stride = round(float(np.median([pace.seconds for pace in paces.values()])) * rate_hz)
                late = out_of_step(right, left, sensors, stride, int(limits.LONGEST_S * rate_hz))
                quality = merged(quality, late)
    return quality


def _of_legs(sensors: Mapping[str, Imu], rate_hz: float) -> tuple[dict[str, SensorQuality], list[Note]]:
    """Exchanged sensors, and delays between the others of each leg, and notes about them."""
    if len(next(iter(sensors.values())).time) <= limits.SHORTEST_S * rate_hz:
        return {}, []
    places = places_in(sensors)
    moved = places.moved if places else ()
    with_acc = {placement for placement, imu in sensors.items() if imu.acc is not None}
    late: dict[str, SensorQuality] = {}
    for pair, side in itertools.product(limits.BETWEEN_S, SIDES):
        upper, lower = (f"{segment}_{side}" for segment in pair)
        if {upper, lower} <= with_acc and not {upper, lower}.intersection(moved):
            late[lower] = SensorQuality(late=late_behind(upper, lower, sensors, rate_hz))
    return late, [*(places.notes() if places and moved else []), *writer.contradictions(late)]


def _bridged(imu: Imu, lost: np.ndarray) -> Imu:
    """The sensor with its gyroscope interpolated over short gaps; it is 0 in long ones."""
    mask = np.asarray(imu.mask)
    if mask.all() or not mask.any():
        return imu
    return imu._replace(gyr=np.where(lost[:, None], 0.0, over_losses(np.arange(len(mask)), as_float(imu.gyr), mask)))
