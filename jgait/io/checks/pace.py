"""Units and rate of all sensors together: whether the movement of the legs is that of walking.

A leg that takes a stride in the time T turns by an angle that does not depend on T, and is accelerated in proportion
to 1/T². The root mean square rate times T, and the standard deviation of the specific force times T², are therefore
nearly the same for all walking people. If all rates of turn are half as large as they should be, or the sampling rate
is twice as high, they are not.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.io.checks import limits as at
from jgait.notes import Kind, Note
from jgait.types import Imu, as_float

PACE_UNUSUAL = Kind(
    "pace_unusual",
    "check",
    "{sensors}: in a stride of {seconds:.2f} s a leg turns {angle:.2f} times as far and is shaken {shaking:.2f} times "
    "as hard as in usual walking; {cause}",
    "If the person did not run, limp or take very short steps, angles, lengths and speeds of this recording are wrong. "
    "A sensor on another segment than stated, such as a foot for a shank, looks the same.",
)


class LegPace(NamedTuple):
    """Of a sensor in walking: duration of a stride [s], and angle and shaking over the usual."""

    seconds: float
    angle: float
    shaking: float


def paces_of(sensors: Mapping[str, Imu], lost: Mapping[str, np.ndarray], rate_hz: float) -> dict[str, LegPace]:
    """Placement → pace of the sensors of the legs that agree about the duration of a stride; the median of pieces, for
    two strides of walking can look like one of running. `lost` holds the samples (T,) in long gaps.
    """
    size, paces = int(at.PIECE_S * rate_hz), {}
    for placement, imu in sensors.items():
        usual, length = at.USUAL_PACE.get(placement.partition("_")[0]), min(len(imu.time), int(at.LONGEST_S * rate_hz))
        if usual is None or imu.acc is None or length <= at.SHORTEST_S * rate_hz:
            continue
        gyr, force = as_float(imu.gyr)[:length], np.linalg.norm(as_float(imu.acc)[:length], axis=1)
        width = int(at.WINDOW_S * rate_hz)
        mean = np.convolve(np.sum(gyr * gyr, axis=1), np.ones(width) / width, "same")
        walks = (mean > at.ACTIVE * mean.max()) & ~lost[placement][:length]
        cuts = [slice(begin, begin + size) for begin in range(0, max(length - size // 2, 1), size)]
        piece_paces = [_pace(gyr[cut], force[cut], walks[cut], rate_hz, usual) for cut in cuts]
        if known := [pace for pace in piece_paces if pace is not None]:
            paces[placement] = sorted(known)[len(known) // 2]
    seconds = float(np.median([pace.seconds for pace in paces.values()])) if paces else 0.0
    return {place: pace for place, pace in paces.items() if abs(pace.seconds / seconds - 1.0) < at.SAME_STRIDE}


def pace_notes(paces: Mapping[str, LegPace]) -> list[Note]:
    """The note about legs that do not move as in walking."""
    if not paces:
        return []
    seconds, angle, shaking = (float(np.exp(np.mean(np.log(part)))) for part in zip(*paces.values(), strict=True))
    cause = _cause(seconds, angle, shaking)
    worn = next(iter(paces)) if len(paces) == 1 else "all sensors of the legs"
    return [PACE_UNUSUAL(sensors=worn, seconds=seconds, angle=angle, shaking=shaking, cause=cause)] if cause else []


def _pace(
    gyr: np.ndarray, force: np.ndarray, walks: np.ndarray, rate_hz: float, usual: tuple[float, float]
) -> LegPace | None:
    """The pace of rates (T, 3) and forces (T,) in walking (T,); None if it does not repeat itself, or too seldom."""
    if not walks.any():
        return None
    moves, shakes = float(np.sqrt(np.sum(gyr[walks] ** 2, axis=1).mean())), float(force[walks].std())
    if moves < at.SLOWEST_LEG[0] or shakes < at.SLOWEST_LEG[1]:
        return None
    moved = np.where(walks[:, None], gyr - gyr[walks].mean(axis=0), 0.0)
    length, farthest = 1 << int(2 * len(gyr)).bit_length(), int(at.STRIDE_S[1] * rate_hz)
    power = np.sum(np.abs(np.fft.rfft(moved, length, axis=0)) ** 2, axis=1)
    common = np.fft.irfft(np.abs(np.fft.rfft(walks.astype(float), length)) ** 2, length)[:farthest]
    alike = np.fft.irfft(power, length)[:farthest] / np.maximum(common, 1.0)
    alike = np.where(common < at.COUNTERPARTS * walks.sum(), 0.0, alike) / alike[0]
    low = alike < at.UNLIKE
    first = max(int(np.argmax(low)) if low.any() else int(np.argmin(alike)), int(at.STRIDE_S[0] * rate_hz)) + 1
    inner = np.arange(first, farthest - 1)
    peaks = inner[(alike[inner] >= alike[inner - 1]) & (alike[inner] >= alike[inner + 1])]
    if not peaks.size or not alike[peaks].max() > at.LEAST_AUTOCORRELATION:
        return None
    stride = int(peaks[alike[peaks] > at.NEARLY * alike[peaks].max()][0])
    if at.FEWEST_STRIDES * stride > walks.sum():
        return None
    seconds = stride / rate_hz
    return LegPace(seconds, moves * seconds / usual[0], shakes * seconds**2 / usual[1])


def _cause(seconds: float, angle: float, shaking: float) -> str:
    """What makes a pace unusual, in words; an empty string for a usual one."""
    ratio = shaking / angle
    if angle > at.LARGE and ratio > 1.0:
        return "the sampling rate or the unit of time may be wrong: time passes half as fast as it should"
    if angle > at.LARGE:
        return "the gyroscopes' unit or scale may be wrong: they read twice what they should"
    if angle < at.SMALL and ratio > at.SHAKEN_FAR and shaking < at.LARGE:
        return (
            "the gyroscopes' unit or scale may be wrong, so that they read half of what they should, or the person "
            "shuffles"
        )
    if angle < at.SMALLER and ratio < (at.SPARED if seconds > at.SHORT_STRIDE_S else at.SPARED_FAST):
        return "the sampling rate or the unit of time may be wrong: time passes twice as fast as it should"
    return ""
