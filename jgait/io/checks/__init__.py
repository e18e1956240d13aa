"""Checks of the sensors of a recording, by whole kinds: range, stuck and clipped readings; losses; gravity and units;
order and rate of samples; sides and places. What cannot be right is masked, left out or refused, what contradicts
itself or others gets a note.
"""

from collections.abc import Mapping

import numpy as np

from jgait.io.checks import limits
from jgait.io.checks.gravity import gravity_notes
from jgait.io.checks.losses import in_long_gaps, loss_notes
from jgait.io.checks.order import accelerometer_late, row_notes, sensors_late
from jgait.io.checks.pace import pace_notes, paces_of
from jgait.io.checks.readings import channel_notes
from jgait.io.checks.sides import exchanged, out_of_step, sides_differ, turn_notes
from jgait.io.units import Unit
from jgait.notes import Note
from jgait.signal.windows import over_losses
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
        notes += loss_notes(placement, present, imu, recording.sampling_rate_hz)
        notes += channel_notes(placement, imu)
    return tuple(notes)


def contradictions(recording: Recording, units: Mapping[str, Unit] | None = None) -> tuple[Note, ...]:
    """Notes about sensors that contradict themselves or each other: scale, sign, axes, delays, rows without stamps.

    Args:
        recording: the recording, its sensors of one length.
        units: placement → unit in which its gyroscope was read, for messages.
    """
    rate_hz = recording.sampling_rate_hz
    if rate_hz < limits.SLOWEST_HZ or len({len(imu.time) for imu in recording.sensors.values()}) != 1:
        return ()
    lost = {placement: in_long_gaps(imu, rate_hz) for placement, imu in recording.sensors.items()}
    sensors = {placement: _bridged(imu, lost[placement]) for placement, imu in recording.sensors.items()}
    itself = {p: gravity_notes(p, imu, lost[p], rate_hz, (units or {}).get(p)) for p, imu in sensors.items()}
    # a gyroscope that hardly turns contradicts every other sensor: its note explains that
    slow = {p for p, found in itself.items() if any(note.code == "gyroscope_slow" for note in found)}
    worn = {placement: imu for placement, imu in sensors.items() if placement not in slow}
    notes = [note for found in itself.values() for note in found]
    pairs = {(f"{upper}_{side}", f"{lower}_{side}") for upper, lower in limits.BETWEEN_S for side in SIDES}
    paces = paces_of(worn, lost, rate_hz)
    notes += pace_notes(paces)
    for segment in dict.fromkeys(placement.removesuffix("_right") for placement in worn):
        right, left = (f"{segment}_{side}" for side in SIDES)
        if right in worn and left in worn and segment in limits.TILTED_DEG:
            notes += sides_differ(right, left, worn, rate_hz)
            if segment == "foot" and right in paces and left in paces:
                stride = round(float(np.median([pace.seconds for pace in paces.values()])) * rate_hz)
                notes += out_of_step(right, left, worn, stride, int(limits.LONGEST_S * rate_hz))
    accused = {placement for placement, found in itself.items() if found}
    notes += [n for n in turn_notes(sensors, lost, rate_hz, accused) if n.values["placement"] not in slow]
    wrong = exchanged(sensors, rate_hz) if len(next(iter(lost.values()))) > limits.SHORTEST_S * rate_hz else []
    apart = {word for note in wrong for word in str(note.values["kind"]).split(" or ")}
    for placement, imu in sensors.items():
        notes += accelerometer_late(placement, imu, rate_hz)
    for upper, lower in sorted(pairs):
        both = all(name in sensors and sensors[name].acc is not None for name in (upper, lower))
        if both and not {upper.partition("_")[0], lower.partition("_")[0]} & apart:
            notes += sensors_late(upper, lower, sensors, rate_hz)
    return (*notes, *wrong, *row_notes(sensors, rate_hz))


def _bridged(imu: Imu, lost: np.ndarray) -> Imu:
    """The sensor with its gyroscope interpolated over short gaps; it is 0 in long ones."""
    mask = np.asarray(imu.mask)
    if mask.all() or not mask.any():
        return imu
    return imu._replace(gyr=np.where(lost[:, None], 0.0, over_losses(np.arange(len(mask)), as_float(imu.gyr), mask)))
