"""Checks of the sensors of a recording, by whole kinds: range, stuck and clipped readings; losses; gravity and units;
order and rate of samples; sides and places. What cannot be right is masked, left out or refused, what contradicts
itself or others gets a note.
"""

import itertools
from collections.abc import Mapping

import numpy as np

from jgait.io.checks import walking
from jgait.io.checks.gravity import LONGEST_S, gravity_notes, slow_gyroscope, turn_notes
from jgait.io.checks.readings import channel_notes
from jgait.io.units import Unit
from jgait.mounting.places import places_in
from jgait.notes import DATA_LOST, Note
from jgait.quality import SensorQuality, merged
from jgait.quality import notes as writer
from jgait.signal.windows import over_losses, true_runs
from jgait.types import SIDES, Imu, Recording, as_float

__all__ = ["contradictions", "quality_notes"]


def quality_notes(recording: Recording, noted: Mapping[str, np.ndarray] | None = None) -> tuple[Note, ...]:
    """Notes about doubtful signals of a structurally sound recording: missing samples, clipped or constant channels.

    Args:
        recording: the recording.
        noted: placement → (T,) bool, missing samples that other notes report.
    """
    notes: list[Note] = []
    for placement, imu in recording.sensors.items():
        present = np.asarray(imu.mask) | (False if noted is None else noted[placement])
        long = _long_gaps(present, recording.sampling_rate_hz)
        if len(long) < len(true_runs(~present)):
            many = "{placement}: samples missing: {missing} of {samples}"
            notes.append(DATA_LOST.note(many, placement=placement, missing=(~present).sum(), samples=len(present)))
        for start, end in long:
            seconds, after = (end - start) / recording.sampling_rate_hz, float(imu.time[start] - imu.time[0])
            notes.append(DATA_LOST.note(f"{seconds:.2f} s missing from {after:.2f} s", placement=placement))
        notes += channel_notes(placement, imu)
    return tuple(notes)


def _long_gaps(present: np.ndarray, rate_hz: float) -> list[tuple[int, int]]:
    """The gaps of 0.1 s and more, which are not bridged, each as its first sample and the one after its last."""
    return [(start, end) for start, end in true_runs(~present) if end - start > 0.1 * rate_hz]


def contradictions(
    recording: Recording, units: Mapping[str, Unit] | None = None, whole: Recording | None = None
) -> tuple[dict[str, SensorQuality], tuple[Note, ...]]:
    """Placement → how its sensor contradicts itself or others in walking: scale, sign, axes, delays, rows without
    stamps; and the same in notes. Of sensors of one length. `units` are those of the gyroscopes, for messages; `whole`
    has movements that are no walking, too.
    """
    rate_hz, sensors, lost = recording.sampling_rate_hz, dict(recording.sensors), dict[str, np.ndarray]()
    # a stride needs ten samples
    if rate_hz < 10.0 or len({len(imu.time) for imu in sensors.values()}) != 1:
        return {}, ()
    for placement, imu in recording.sensors.items():
        mask = np.asarray(imu.mask, bool)
        lost[placement] = np.zeros(len(mask), bool)
        for start, end in _long_gaps(mask, rate_hz):
            lost[placement][start:end] = True
        if mask.any() and not mask.all():  # the gyroscope is interpolated over short gaps, 0 in long ones
            rates = over_losses(np.arange(len(mask)), as_float(imu.gyr), mask)
            sensors[placement] = imu._replace(gyr=np.where(lost[placement][:, None], 0.0, rates))
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
    paces = walking.paces_of(worn, lost, rate_hz)
    of_sides: dict[str, SensorQuality] = {}
    for segment in ("foot", "ankle", "shank", "thigh"):
        right, left = (f"{segment}_{side}" for side in SIDES)
        if right in worn and left in worn:
            of_sides |= walking.sides_differ(right, left, worn, rate_hz)
            if segment == "foot" and right in paces and left in paces:
                stride = round(float(np.median([pace.seconds for pace in paces.values()])) * rate_hz)
                late_foot = walking.out_of_step(right, left, worn, stride, int(LONGEST_S * rate_hz))
                of_sides = merged(of_sides, late_foot)
    late = {placement: walking.accelerometer_late(placement, imu, rate_hz) for placement, imu in sensors.items()}
    of_legs, leg_notes = _of_legs(sensors, rate_hz)
    rows, row_notes = walking.rows_wrong(sensors, rate_hz)
    quality = merged(
        {placement: SensorQuality(contradicts=placement in wrong) for placement in sensors}, of_sides,
        {placement: delay for placement, (delay, _) in late.items()}, of_legs, dict.fromkeys(sensors, rows),
    )  # fmt: skip
    notes = itertools.chain(
        *itself.values(), walking.pace_notes(paces), writer.contradictions(of_sides), (note for _, note in turns),
        *(each for _, each in late.values()), leg_notes, row_notes,
    )  # fmt: skip
    return quality, tuple(notes)


def _of_legs(sensors: Mapping[str, Imu], rate_hz: float) -> tuple[dict[str, SensorQuality], list[Note]]:
    """Delays between the sensors of each leg, but for exchanged ones, and notes about both."""
    if len(next(iter(sensors.values())).time) <= walking.SHORTEST_S * rate_hz:
        return {}, []
    places = places_in(sensors)
    moved = places.moved if places else ()
    with_acc = {placement for placement, imu in sensors.items() if imu.acc is not None}
    late: dict[str, SensorQuality] = {}
    for pair, side in itertools.product(walking.BETWEEN_S, SIDES):
        upper, lower = (f"{segment}_{side}" for segment in pair)
        if {upper, lower} <= with_acc and not {upper, lower}.intersection(moved):
            late[lower] = SensorQuality(late=walking.late_behind(upper, lower, sensors, rate_hz))
    return late, [*(places.notes() if places and moved else []), *writer.contradictions(late)]
