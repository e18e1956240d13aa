"""Whether the sensors of a person turn together: in a turn, every segment turns by the same angle about the vertical.

Over a window of two strides the swing of the legs has no mean, and the mean specific force points up. The mean rate
about that direction, times the window, is the person's turn, whatever the mounting. A gyroscope with a wrong sign,
scale, unit or order of axes shows another turn than the other sensors. A straight walk tells nothing.
"""

from collections.abc import Collection, Mapping

import numpy as np

from jgait.io.damage.agreement import WINDOW_S, in_long_gaps, lies, moving_means
from jgait.notes import Kind, Note
from jgait.types import Imu, as_float

LEAST_TURN = 1.0
"""[rad] Least turn of the person within a window from which on turns are compared."""

PAIR = (0.33, 3.0)
"""[1] Ratio of the turns of two sensors without a third outside of which one of them is wrong."""

TOGETHER = {"foot": (0.45, 1.6), "": (0.7, 1.45)}
"""[1] Ratio of a sensor's turn to the person's, by segment, outside of which its gyroscope is wrong. In undamaged
recordings it is 0.58 to 1.2 at the foot, which turns in steps, and 0.82 to 1.33 elsewhere."""

SEGMENTS = ("foot", "ankle", "shank", "thigh", "pelvis", "lower", "waist")
"""First words of the placements of the trunk and the legs, which turn together."""

ALONE = 0.25
"""[1] Largest difference of the shares of a window in which two sensors lie still, with which their turns are compared:
one that is put on late, or taken off early, does not turn with the person."""

CUT_OFF = 2
"""[1] Number of first and last windows in which the largest turn is not whole: the recording begins or ends within it,
and a leg may have taken only one of its steps. The range is then that of a foot."""

TURNS_APART = Kind(
    "turns_apart",
    "check",
    "{placement}: in a turn by {degrees:.0f}° it turns {ratio:.2f} times as far as {others}; its gyroscope has a wrong "
    "sign, order of axes, unit or scale",
    "All segments of a person turn together. What is computed from this sensor is wrong as well.",
)
ONE_TURNS_APART = Kind(
    "one_turns_apart",
    "check",
    "{placement} and {other}: in a turn by {degrees:.0f}° one turns {ratio:.2f} times as far as the other; a "
    "sign, the order of axes, the unit or the scale is wrong in one of the two",
    "All segments of a person turn together. What is computed from one of the two sensors is wrong as well.",
)


def turns_of(imu: Imu, rate_hz: float) -> np.ndarray:
    """(n,) angle by which a sensor with an accelerometer turns about the vertical in windows [rad].

    NaN in windows with a long gap.
    """
    samples = round(WINDOW_S * rate_hz)
    every = max(samples // 8, 1)
    gyr, acc = (moving_means(as_float(part), samples)[::every] for part in (imu.gyr, imu.acc))
    lost = moving_means(in_long_gaps(imu, rate_hz).astype(float)[:, None], samples)[::every, 0]
    up = acc / np.maximum(np.linalg.norm(acc, axis=1, keepdims=True), 1e-9)
    return np.where(lost > 0.5 / samples, np.nan, np.sum(gyr * up, axis=1) * WINDOW_S)


def _rests(imu: Imu, rate_hz: float) -> np.ndarray:
    """(n,) share of the windows of `turns_of` in which a sensor lies or stands still [1]."""
    samples = round(WINDOW_S * rate_hz)
    return moving_means(lies(imu, rate_hz).astype(float)[:, None], samples)[:: max(samples // 8, 1), 0]


def turn_notes(sensors: Mapping[str, Imu], rate_hz: float, suspects: Collection[str] = ()) -> tuple[Note, ...]:
    """Notes about sensors that turn otherwise than the person does.

    Args:
        sensors: as in `jgait.io.damage.damage_notes`.
        rate_hz: sampling rate [Hz].
        suspects: placements of sensors that contradict themselves; of two sensors without a third, the one among them
            is named.
    """
    worn = {p: imu for p, imu in sensors.items() if p.partition("_")[0] in SEGMENTS and imu.acc is not None}
    lengths = {len(imu.time) for imu in worn.values()}
    if len(worn) < 2 or len(lengths) > 1 or lengths.pop() < 2.0 * WINDOW_S * rate_hz:
        return ()
    turns = {placement: turns_of(imu, rate_hz) for placement, imu in worn.items()}
    rests = np.array([_rests(imu, rate_hz) for imu in worn.values()])
    for placement, alone in zip(turns, np.abs(rests - np.median(rests, axis=0)) > 0.5 * ALONE, strict=True):
        turns[placement][alone] = np.nan
    if len(turns) == 2:
        return _of_two(turns, suspects)
    every = np.array(list(turns.values()))
    known = np.isfinite(every).sum(axis=0) > 2
    person = np.full(every.shape[1], np.nan)
    person[known] = np.nanmedian(every[:, known], axis=0)  # the person's turn even if one sensor is wrong
    notes = []
    for placement, rates in turns.items():
        largest, ratio, whole = _compared(rates, person)
        low, high = TOGETHER["" if whole and not placement.startswith("foot") else "foot"]
        if largest >= LEAST_TURN and not low <= ratio <= high:
            notes.append(
                TURNS_APART(
                    placement=placement, degrees=np.rad2deg(largest), ratio=ratio, others="the person's other sensors"
                )
            )
    return tuple(notes)


def _of_two(turns: Mapping[str, np.ndarray], suspects: Collection[str]) -> tuple[Note, ...]:
    """A note if two sensors turn apart: about the one that is suspected, or about both."""
    first, second = turns
    for one, other in ((first, second), (second, first)):
        largest, ratio, _ = _compared(turns[one], turns[other])
        if largest < LEAST_TURN or PAIR[0] <= ratio <= PAIR[1]:
            continue
        named = [placement for placement in (one, other) if placement in suspects]
        if len(named) != 1:
            return (ONE_TURNS_APART(placement=one, other=other, degrees=np.rad2deg(largest), ratio=ratio),)
        rest = other if named[0] == one else one
        largest, ratio, _ = _compared(turns[named[0]], turns[rest])
        return (TURNS_APART(placement=named[0], degrees=np.rad2deg(largest), ratio=ratio, others=rest),)
    return ()


def _compared(sensor: np.ndarray, person: np.ndarray) -> tuple[float, float, bool]:
    """Largest turn of the person [rad], a sensor's turn over it, and whether it lies within the recording."""
    both = np.flatnonzero(np.isfinite(sensor) & np.isfinite(person))
    size = np.abs(person[both])
    if not size.size or not size.max() > 0.0:
        return 0.0, 1.0, True
    looked = both[size > 0.5 * size.max()]
    ratio = float(sensor[looked] @ person[looked] / (person[looked] @ person[looked]))
    at = int(both[np.argmax(size)])
    return float(size.max()), ratio, CUT_OFF <= at < len(person) - CUT_OFF
