"""Notes on the sensors of a recording, written from their `SensorQuality`."""

from collections.abc import Mapping

from jgait.notes import Kind, Note
from jgait.quality.evidence import SensorQuality, above, opposite

SENSOR_LEFT_OUT = Kind(
    "sensor_left_out", "check", "{placement} is left out: {reason}",
    "The numbers of this sensor cannot be right. What the other sensors measure does not depend on it.",
)  # fmt: skip
CONTRADICTS = Kind(
    "sensor_contradicts", "check", "",
    "Sign, order or handedness of the axes, the unit or the scale of a gyroscope or an accelerometer, or the sampling "
    "rate, is wrong, or the sensor sat elsewhere. What is computed from this sensor is wrong as well.",
)  # fmt: skip
"""A sensor that contradicts itself, or the other sensors of the person."""
CLOCKS_APART = Kind(
    "clocks_apart", "check", "",
    "Signals that are computed together have to be measured at the same time: angles between two segments, and speeds "
    "and lengths from both signals of one sensor, are wrong by many per cent.",
)  # fmt: skip
"""A signal that is late behind another one."""


def left_out(quality: Mapping[str, SensorQuality]) -> list[Note]:
    """Notes on sensors that a reader left out."""
    return [SENSOR_LEFT_OUT(placement=name, reason=facts.left_out) for name, facts in quality.items() if facts.left_out]


def contradictions(quality: Mapping[str, SensorQuality]) -> list[Note]:
    """Notes on contradictions between two sensors of the legs."""
    notes = []
    for placement, facts in quality.items():
        other = opposite(placement)
        if facts.faster != 1.0:
            differs = (
                "{placement}: it turns {ratio:.2f} times as fast as {other}: unless one leg is spared, the scale or "
                "unit of one of the two gyroscopes is wrong, or one of the two sensors sat on another segment"
            )
            notes.append(CONTRADICTS.note(differs, placement=placement, ratio=facts.faster, other=other))
        if facts.step_share != 0.5:
            follows = (
                "{placement}: it follows {other} by {share:.2f} of a stride in place of a half: one of the two clocks "
                "is wrong, or the person limps"
            )
            notes.append(CLOCKS_APART.note(follows, placement=placement, other=other, share=facts.step_share))
        if facts.late:
            notes.append(delayed(placement, "it", facts.late, f"{above(placement)}; one of the two clocks is wrong"))
    return notes


def delayed(placement: str, signal: str, delay: float, other: str) -> Note:
    """The note on a signal that is late, or early if the delay [s] is negative."""
    text = "{placement}: {signal} is {milliseconds:.0f} ms {side} {other}"
    side = "behind" if delay > 0.0 else "ahead of"
    return CLOCKS_APART.note(
        text, placement=placement, signal=signal, milliseconds=1e3 * abs(delay), side=side, other=other
    )
