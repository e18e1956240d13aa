"""Kinds of notes that `ankle_stride` makes about a recording."""

from jgait.estimators.notes import ACCELEROMETER_OFF, CLIPPED
from jgait.notes import Kind, Note
from jgait.quality import SensorQuality
from jgait.quality.evidence import FAR_OFF

STRIDES_QUICK = Kind(
    "strides_quick",
    "check",
    "{placement}: strides last {seconds:.2f} s, as in running",
    "In running the leg does not stand as in walking: lengths and distance, and angles with sleeping gyroscopes, may "
    "be wrong by much more than their deviations say. Small children walk with such strides too.",
)

SWINGS_SMALL = Kind(
    "swings_too_small",
    "check",
    "{placement}: {swings} {swings:swing is|swings are} too slow or too small to be counted, beside {strides} "
    "{strides:stride|strides}",
    "Strides and distance lack steps if the person took very short or very slow steps there; legs that tremble make "
    "such swings too. The deviation of the distance from all sensors contains half a stride for each.",
)


def shank_notes(placement: str, facts: SensorQuality) -> list[Note]:
    """Notes on steps that a sensor lacks, on signals that are off or clip, and on running."""
    notes = []
    if facts.small_swings:
        notes.append(SWINGS_SMALL(placement=placement, swings=facts.small_swings, strides=facts.swings))
    if abs(facts.force_off) > FAR_OFF:
        notes.append(ACCELEROMETER_OFF(placement=placement, percent=100.0 * facts.force_off, when="at rest"))
    for signal, samples in (("gyroscope", facts.gyr_clipped), ("accelerometer", facts.acc_clipped)):
        if samples:
            notes.append(CLIPPED(signal=signal, placement=placement, samples=samples))
    return notes + ([STRIDES_QUICK(placement=placement, seconds=facts.quick_stride)] if facts.runs else [])
