"""Notes on the sensors of a recording, written from their `SensorQuality`."""

from collections.abc import Mapping

from jgait.notes import Kind, Note
from jgait.quality.sensor import SensorQuality, above, opposite

SENSOR_LEFT_OUT = Kind(
    "sensor_left_out",
    "check",
    "{placement} is left out: {reason}",
    "The numbers of this sensor cannot be right. What the other sensors measure does not depend on it.",
)
SIDES_DIFFER = Kind(
    "sides_differ",
    "check",
    "{placement} turns {ratio:.2f} times as fast as {other}: unless one leg is spared, the scale or unit of one of the "
    "two gyroscopes is wrong, or one of the two sensors sat on another segment",
    "Both legs of a person turn alike, also in most illnesses that affect one side.",
)
SIDES_OUT_OF_STEP = Kind(
    "sides_out_of_step",
    "check",
    "{placement} follows {other} by {share:.2f} of a stride in place of a half: one of the two clocks is wrong, or the "
    "person limps",
    "What is computed from both feet together needs sensors on one clock.",
)
SENSOR_LATE = Kind(
    "sensor_late",
    "check",
    "{placement} is {milliseconds:.0f} ms {side} {other}; one of the two clocks is wrong",
    "Angles between two segments, and what is computed from them, need sensors on one clock.",
)


def left_out(quality: Mapping[str, SensorQuality]) -> list[Note]:
    """Notes on sensors that a reader left out."""
    return [SENSOR_LEFT_OUT(placement=name, reason=facts.left_out) for name, facts in quality.items() if facts.left_out]


def contradictions(quality: Mapping[str, SensorQuality]) -> list[Note]:
    """Notes on contradictions between two sensors of the legs."""
    notes = []
    for placement, facts in quality.items():
        if facts.faster != 1.0:
            notes.append(SIDES_DIFFER(placement=placement, ratio=facts.faster, other=opposite(placement)))
        if facts.step_share != 0.5:
            notes.append(SIDES_OUT_OF_STEP(placement=placement, other=opposite(placement), share=facts.step_share))
        if facts.late:
            milliseconds, side = 1e3 * abs(facts.late), delayed(facts.late)
            notes.append(SENSOR_LATE(placement=placement, milliseconds=milliseconds, side=side, other=above(placement)))
    return notes


def delayed(delay: float) -> str:
    """Where a delayed signal is, in words."""
    return "behind" if delay > 0.0 else "ahead of"
