"""Whether the sensors of a person turn together: in a turn, every segment turns by the same angle about the vertical.

Over a window of two strides the swing of the legs has no mean, and the mean specific force points up. The mean rate
about that direction, times the window, is the person's turn, whatever the mounting. A gyroscope with a wrong sign,
scale, unit or order of axes shows another turn than the other sensors. A straight walk tells nothing.
"""

from collections.abc import Mapping

import numpy as np

from jgait.notes import Kind, Note
from jgait.types import Imu, as_float

WINDOW_S = 2.24
"""[s] Length of a window: two strides of usual walking."""

LEAST_TURN = 1.0
"""[rad] Least turn of the person within a window from which on turns are compared."""

PAIR = (0.33, 3.0)
"""[1] Ratio of the turns of two sensors without a third outside of which one of them is wrong; both are named."""

TOGETHER = {"foot": (0.45, 1.6), "": (0.7, 1.45)}
"""[1] Ratio of a sensor's turn to the person's, by segment, outside of which its gyroscope is wrong. In undamaged
recordings it is 0.58 to 1.2 at the foot, which turns in steps, and 0.82 to 1.33 elsewhere."""

SEGMENTS = ("foot", "ankle", "shank", "thigh", "pelvis", "lower", "waist")
"""First words of the placements of the trunk and the legs, which turn together."""

TURNS_APART = Kind(
    "turns_apart",
    "check",
    "{placement}: in a turn by {degrees:.0f}° it turns {ratio:.2f} times as far as the person's other sensors; its "
    "gyroscope has a wrong sign, order of axes, unit or scale",
    "All segments of a person turn together. What is computed from this sensor is wrong as well.",
)


def turns_of(imu: Imu, rate_hz: float) -> np.ndarray:
    """(n,) angle by which a sensor with an accelerometer turns about the vertical in windows [rad]."""
    samples = round(WINDOW_S * rate_hz)
    gyr, acc = (_means(as_float(part), samples)[:: max(samples // 8, 1)] for part in (imu.gyr, imu.acc))
    up = acc / np.maximum(np.linalg.norm(acc, axis=1, keepdims=True), 1e-9)
    return np.asarray(np.sum(gyr * up, axis=1) * WINDOW_S)


def _means(values: np.ndarray, samples: int) -> np.ndarray:
    """Moving means (T − samples + 1, 3) over windows of some samples."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray((sums[samples:] - sums[:-samples]) / samples)


def turn_notes(sensors: Mapping[str, Imu], rate_hz: float) -> tuple[Note, ...]:
    """Notes about sensors that turn otherwise than the person does.

    Args:
        sensors: placement → sensor; samples of the gyroscope that are missing are 0.
        rate_hz: sampling rate [Hz].
    """
    worn = {p: imu for p, imu in sensors.items() if p.partition("_")[0] in SEGMENTS and imu.acc is not None}
    lengths = {len(imu.time) for imu in worn.values()}
    if len(worn) < 2 or len(lengths) > 1 or lengths.pop() < 2.0 * WINDOW_S * rate_hz:
        return ()
    turns = {placement: turns_of(imu, rate_hz) for placement, imu in worn.items()}
    if len(turns) == 2:
        first, second = turns
        compared = {first: turns[second], second: turns[first]}
    else:  # the median is the person's turn even if one sensor is wrong
        compared = dict.fromkeys(turns, np.median(list(turns.values()), axis=0))
    notes = []
    for placement, person in compared.items():
        largest = float(np.abs(person).max())
        looked = np.abs(person) > 0.5 * largest
        if largest < LEAST_TURN:
            continue
        ratio = float(turns[placement][looked] @ person[looked] / (person[looked] @ person[looked]))
        low, high = PAIR if len(turns) == 2 else TOGETHER["foot" if placement.startswith("foot") else ""]
        if not low <= ratio <= high:
            notes.append(TURNS_APART(placement=placement, degrees=np.rad2deg(largest), ratio=ratio))
    return tuple(notes)
