"""Damage of signals: what is masked or corrected before any estimator sees a recording, and what is flagged."""

from collections.abc import Mapping

from jgait.io.damage.agreement import GYROSCOPE_SLOW, SIDES_DIFFER, agreement_notes, bridged
from jgait.io.damage.delays import delay_notes
from jgait.io.damage.paces import pace_notes
from jgait.io.damage.samples import without_damage
from jgait.io.damage.splices import splice_notes
from jgait.io.damage.tilts import tilt_notes
from jgait.io.damage.turns import turn_notes
from jgait.io.units import Unit
from jgait.notes import Note
from jgait.types import Recording

__all__ = ["damage_notes", "without_damage"]

SLOWEST_HZ = 10.0
"""[Hz] Least sampling rate at which sensors are compared: a stride has ten samples."""


def damage_notes(recording: Recording, units: Mapping[str, Unit] | None = None) -> tuple[Note, ...]:
    """Notes about sensors that contradict themselves or each other: scale, sign, axes, delays, rows without stamps.

    The functions that it calls take the sensors by placement, short gaps of the gyroscope bridged, and the rate [Hz].

    Args:
        recording: the recording.
        units: placement → unit in which its gyroscope was read, for messages.
    """
    rate_hz = recording.sampling_rate_hz
    if rate_hz < SLOWEST_HZ:
        return ()
    sensors = {placement: bridged(imu, rate_hz) for placement, imu in recording.sensors.items()}
    agreement, tilts = agreement_notes(sensors, rate_hz, units or {}), tilt_notes(sensors, rate_hz)
    # a gyroscope that hardly turns contradicts every other sensor: its note explains that
    slow = {note.values["placement"] for note in agreement if note.code == GYROSCOPE_SLOW.code}
    itself = [note for note in (*agreement, *tilts) if note.code != SIDES_DIFFER.code]
    turns = turn_notes(sensors, rate_hz, {str(note.values["placement"]) for note in itself})
    return (
        *agreement,
        *delay_notes(sensors, rate_hz),
        *splice_notes(sensors, rate_hz),
        *(note for note in turns if note.values["placement"] not in slow),
        *tilts,
        *pace_notes({placement: imu for placement, imu in sensors.items() if placement not in slow}, rate_hz),
    )
