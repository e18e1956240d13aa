"""Whether the movement of the legs is that of walking: how far they turn and how hard they are shaken in a stride.

A leg that takes a stride in the time T turns by an angle that does not depend on T, and is accelerated in proportion
to 1/T². The root mean square rate times T, and the standard deviation of the specific force times T², are therefore
nearly the same for all walking people. If both rates of turn are half as large as they should be, or the sampling rate
is twice as high, they are not. Both feet do the same, half a stride apart.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.io.damage.agreement import LONGEST_S, WINDOW_S, in_long_gaps
from jgait.notes import Kind, Note
from jgait.types import SIDES, Imu

USUAL = {"foot": (4.8, 10.7), "ankle": (4.0, 7.8), "shank": (3.3, 6.8), "thigh": (1.95, 5.3)}
"""[rad], [m] Root mean square rate times the duration of a stride, and standard deviation of the size of the specific
force times its square, by segment: means of undamaged recordings, public and simulated."""

ACTIVE = 0.5
"""[1] Share of the largest mean square rate over `WINDOW_S` above which a person walks."""

STRIDE_S = 0.3, 3.0
"""[s] Durations between which a stride is looked for."""

UNLIKE, ALIKE, NEARLY = 0.3, 0.45, 0.8
"""[1] Autocorrelation below which the first stride ends, least one at the duration of a stride, and its share of the
largest one from which on a shorter duration is taken."""

LEAST = 0.15, 0.3
"""[rad/s], [m/s²] Least root mean square rate and standard deviation of the size of the specific force of a leg that
walks; undamaged ones have 0.6 and 1.1."""

FEWEST_STRIDES = 3.0
"""[1] Least time of walking over the duration of a stride. In shorter walks, two strides look like one."""

PAIRS = 0.5
"""[1] Least share of the samples of walking that have a counterpart a stride later: in short bouts the
few of them that are further apart can be more alike."""

TOGETHER = 0.1
"""[1] Largest difference of a sensor's stride from the median of all, as a share of it."""

SHORTEST_S = 5.0
"""[s] Shortest recording that is examined."""

LARGE, SMALL, SMALLER = 1.55, 0.62, 0.7
"""[1] Angle, or shaking, over its usual value from which on it is too large; and angle below which it is too small if
the shaking is that of usual walking, or that of a slower walk. Undamaged walks have 0.67 (on stairs) to 1.26."""

SHAKEN, SPARED, SPARED_FAST = 1.45, 0.58, 0.8
"""[1] Shaking over angle, both over their usual values, above and below which the angle or the time is wrong; the last
for strides shorter than `SHORT_S`. Undamaged walks with small angles have 0.62 to 1.14, others 0.60 to 1.91; short
steps change both alike."""

SHORT_S = 0.65
"""[s] Stride of 185 steps a minute, with which nobody walks; undamaged ones last 0.72 and longer."""

PIECE_S, FEWEST_PIECES, CONFIRMED = 10.0, 2, 0.3
"""[s], [1], [1] Duration of pieces of a recording, least number of those with a pace to judge by, and least share of
them whose strides last as long as those of the whole: of walking and running, two strides of one can look like one of
the other."""

OUT_OF_STEP = 0.1
"""[1] Largest distance from half a stride of the delay of one foot behind the other, in strides; chosen, above all
of undamaged public walks. People who limp strongly reach it, and the note says so."""

PACE_UNUSUAL = Kind(
    "pace_unusual",
    "check",
    "{sensors}: in a stride of {seconds:.2f} s a leg turns {angle:.2f} times as far and is shaken {shaking:.2f} times "
    "as hard as in usual walking; {cause}",
    "If the person did not run, limp or take very short steps, angles, lengths and speeds of this recording are wrong.",
)
SIDES_OUT_OF_STEP = Kind(
    "sides_out_of_step",
    "check",
    "{placement} follows {other} by {share:.2f} of a stride in place of a half: one of the two clocks is wrong, or the "
    "person limps",
    "What is computed from both feet together needs sensors on one clock.",
)

CAUSES = {
    "gyroscope small": "the gyroscopes' unit or scale may be wrong, so that they read half of what they should, or the "
    "person shuffles",
    "gyroscope large": "the gyroscopes' unit or scale may be wrong: they read twice what they should",
    "rate high": "the sampling rate or the unit of time may be wrong: time passes twice as fast as it should",
    "rate low": "the sampling rate or the unit of time may be wrong: time passes half as fast as it should",
}


class Stepping(NamedTuple):
    """Of a sensor in walking: duration of a stride [s], and angle and shaking over the usual."""

    seconds: float
    angle: float
    shaking: float


def pace_of(imu: Imu, rate_hz: float, segment: str) -> Stepping | None:
    """The pace of a sensor with an accelerometer; None if it does not repeat itself, or not often enough."""
    samples = min(len(imu.time), int(LONGEST_S * rate_hz))
    gyr, acc = (np.asarray(part)[:samples] for part in (imu.gyr, imu.acc))
    square = np.sum(gyr * gyr, axis=1)
    width = int(WINDOW_S * rate_hz)
    mean = np.convolve(square, np.ones(width) / width, "same")
    walks = (mean > ACTIVE * mean.max()) & ~in_long_gaps(imu, rate_hz)[:samples]
    if not walks.any():
        return None
    moves, shakes = float(np.sqrt(square[walks].mean())), float(np.linalg.norm(acc, axis=1)[walks].std())
    if moves < LEAST[0] or shakes < LEAST[1]:
        return None
    moved = np.where(walks[:, None], gyr - gyr[walks].mean(axis=0), 0.0)
    length = 1 << int(2 * samples).bit_length()
    farthest = int(STRIDE_S[1] * rate_hz)
    power = np.sum(np.abs(np.fft.rfft(moved, length, axis=0)) ** 2, axis=1)
    common = np.fft.irfft(np.abs(np.fft.rfft(walks.astype(float), length)) ** 2, length)[:farthest]
    alike = np.fft.irfft(power, length)[:farthest] / np.maximum(common, 1.0)
    alike[common < PAIRS * walks.sum()] = 0.0
    if not alike[0] > 0.0:
        return None
    alike = alike / alike[0]
    low = alike < UNLIKE
    first = max(int(np.argmax(low)) if low.any() else int(np.argmin(alike)), int(STRIDE_S[0] * rate_hz)) + 1
    inner = np.arange(first, farthest - 1)
    peaks = inner[(alike[inner] >= alike[inner - 1]) & (alike[inner] >= alike[inner + 1])]
    if not peaks.size or not alike[peaks].max() > ALIKE:
        return None
    stride = int(peaks[alike[peaks] > NEARLY * alike[peaks].max()][0])
    seconds = stride / rate_hz
    if FEWEST_STRIDES * stride > walks.sum():
        return None
    turn, size = USUAL[segment]
    return Stepping(seconds, moves * seconds / turn, shakes * seconds**2 / size)


def _cause(seconds: float, angle: float, shaking: float) -> str:
    """Key of `CAUSES`, or an empty string for a usual pace."""
    ratio = shaking / angle
    if angle > LARGE:
        return "rate low" if ratio > 1.0 else "gyroscope large"
    if angle < SMALL and ratio > SHAKEN and shaking < LARGE:
        return "gyroscope small"
    return "rate high" if angle < SMALLER and ratio < (SPARED if seconds > SHORT_S else SPARED_FAST) else ""


def _paces(sensors: Mapping[str, Imu], rate_hz: float) -> dict[str, Stepping]:
    """Placement → pace, of the sensors that agree about the duration of a stride."""
    paces = {}
    for placement, imu in sensors.items():
        segment = placement.partition("_")[0]
        if segment in USUAL and imu.acc is not None and len(imu.time) > SHORTEST_S * rate_hz:
            pace = pace_of(imu, rate_hz, segment)
            if pace is not None:
                paces[placement] = pace
    seconds = float(np.median([pace.seconds for pace in paces.values()])) if paces else 0.0
    return {place: pace for place, pace in paces.items() if abs(pace.seconds / seconds - 1.0) < TOGETHER}


def _piece(imu: Imu, rows: slice) -> Imu:
    return Imu(imu.time[rows], imu.gyr[rows], None if imu.acc is None else imu.acc[rows], imu.mask[rows])


def _confirmed(sensors: Mapping[str, Imu], rate_hz: float, seconds: float) -> bool:
    """Whether strides last as long in enough of the pieces of a recording (see `PIECE_S`)."""
    size = int(PIECE_S * rate_hz)
    samples = min(max(len(imu.time) for imu in sensors.values()), int(LONGEST_S * rate_hz))
    pieces = [
        _paces({place: _piece(imu, slice(begin, begin + size)) for place, imu in sensors.items()}, rate_hz)
        for begin in range(0, samples - size + 1, size)
    ]
    found = [abs(next(iter(paces.values())).seconds / seconds - 1.0) < TOGETHER for paces in pieces if paces]
    return len(found) < FEWEST_PIECES or bool(np.mean(found) >= CONFIRMED)


def pace_notes(sensors: Mapping[str, Imu], rate_hz: float) -> tuple[Note, ...]:
    """Notes about legs that do not move as in walking, and about feet that are not half a stride apart."""
    paces = _paces(sensors, rate_hz)
    if not paces:
        return ()
    notes = []
    seconds, angle, shaking = (float(np.exp(np.mean(np.log(part)))) for part in zip(*paces.values(), strict=True))
    cause = _cause(seconds, angle, shaking)
    if cause:
        worn = next(iter(paces)) if len(paces) == 1 else "all sensors of the legs"
        notes.append(PACE_UNUSUAL(sensors=worn, seconds=seconds, angle=angle, shaking=shaking, cause=CAUSES[cause]))
    right, left = (f"foot_{side}" for side in SIDES)
    if right in paces and left in paces and len(sensors[right].time) == len(sensors[left].time):
        share = _behind(sensors[right], sensors[left], round(seconds * rate_hz), int(LONGEST_S * rate_hz))
        if abs(share - 0.5) > OUT_OF_STEP:
            notes.append(SIDES_OUT_OF_STEP(placement=left, other=right, share=share))
    return tuple(notes) if notes and _confirmed(sensors, rate_hz, seconds) else ()


def _behind(first: Imu, second: Imu, stride: int, longest: int) -> float:
    """Delay of the second sensor behind the first where they are most alike, in strides, 0 to 1; means over a stride do
    not count, so that pauses do not.
    """
    sizes = [np.linalg.norm(np.asarray(imu.gyr)[:longest], axis=1) for imu in (first, second)]
    moves = [one - np.convolve(one, np.ones(stride) / stride, "same") for one in sizes]
    a, b = (np.fft.rfft(one, 1 << int(2 * len(one)).bit_length()) for one in moves)
    alike = np.fft.irfft(np.conj(a) * b)
    lags = np.arange(stride)
    return float(np.argmax(alike[lags] + alike[lags - stride])) / stride
