"""Damage of signals: what is masked or corrected before any estimator sees a recording, and what is flagged."""

from jgait.io.damage.agreement import agreement_notes
from jgait.io.damage.delays import delay_notes
from jgait.io.damage.paces import pace_notes
from jgait.io.damage.samples import without_damage
from jgait.io.damage.splices import splice_notes
from jgait.io.damage.tilts import tilt_notes
from jgait.io.damage.turns import turn_notes
from jgait.notes import Note
from jgait.types import Recording

__all__ = ["damage_notes", "without_damage"]

SLOWEST_HZ = 10.0
"""[Hz] Least sampling rate at which sensors are compared: a stride has ten samples."""


def damage_notes(recording: Recording) -> tuple[Note, ...]:
    """Notes about sensors that contradict themselves or each other: scale, sign, axes, delays, rows without stamps."""
    sensors, rate_hz = recording.sensors, recording.sampling_rate_hz
    if rate_hz < SLOWEST_HZ:
        return ()
    return (
        *agreement_notes(sensors, rate_hz),
        *delay_notes(sensors, rate_hz),
        *splice_notes(sensors, rate_hz),
        *turn_notes(sensors, rate_hz),
        *tilt_notes(sensors, rate_hz),
        *pace_notes(sensors, rate_hz),
    )
