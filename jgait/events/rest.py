"""Standing still: rests of a person or a sensor, gyroscope bias and force at rest. NumPy and SciPy, on the host.

All rules use a centred window. They differ between segments: the legs never rest together in walking
(`legs_at_rest`), a foot rests at every stance (`rest`), the trunk moves little even in walking (`trunk_rest`).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jgait.geometry.vectors import GRAVITY
from jgait.notes import FEW_RESTS, Kind, Note
from jgait.signal.windows import held_mean, held_spread, true_runs, window_maximum, window_size, window_sum
from jgait.types import AnyArray, Imu, as_float

LEGS_RATE = 0.25
"""[rad/s] Threshold on the fastest leg gyroscope while a person stands, or on one shank between its swings; twice as
much is accepted if nothing is slower, and a note of the estimator names the leg that moves. Chosen by hand."""

LEGS_WINDOW_S = 0.25
"""[s] Time before and after a sample in which all leg gyroscopes must stay below the threshold. Chosen by hand."""

LEGS_SHORTEST_S = 0.5
"""[s] Shortest standing that can calibrate a leg, and shortest rest of a shank in a pause. Chosen by hand."""

JOLT = 5.0
"""[m/s²] Spread of the specific force that weighs as much as an angular rate of 1 rad/s in `unrest`. Chosen by hand."""

TRUNK_RATE = 0.12
"""[rad/s] Threshold on the spread of the trunk's angular rate, and on its mean, while a person stands. Chosen by
hand."""

LEAST_REST_S = 2.0
"""[s] Shortest rest from which the bias of the trunk's gyroscope is computed; a shorter rest gives a worse bias."""

BRIDGED_S = 0.1
"""[s] Longest loss of samples that is bridged: it does not end a rest, and rates of a leg are interpolated over it; a
swing lasts 0.4 s. Chosen by hand."""


class Rest(NamedTuple):
    """A sensor at rest."""

    windows: list[tuple[int, int]]  #: half-open ranges of samples in which the sensor rests; empty if it never rests.
    gyr_bias: np.ndarray  #: (3,) gyroscope bias [rad/s].
    force: float  #: length of the mean specific force [m/s²]; 0 if the sensor never rests.
    time: float  #: duration of rest, √Σ t² of the windows [s].


NEVER_STILL = Kind(
    "never_still", "check",
    "nobody stands still for {seconds:g} s: the gyroscope is taken as it reads, and tilt is less certain",
    FEW_RESTS,
)  # fmt: skip


def unrest(gyr: AnyArray, acc: AnyArray, size: int) -> np.ndarray:
    """√(ω² + (σ_f / `JOLT`)²) (T,) [rad/s]: root mean square of the rate, and spread of the specific force, over a
    centred window of an odd number of samples.
    """
    power = held_mean((np.asarray(gyr, np.float64) ** 2).sum(axis=1), size)
    return np.hypot(np.sqrt(np.maximum(power, 0.0)), held_spread(acc, size) / JOLT)


def rest(gyr: np.ndarray, acc: np.ndarray, mask: np.ndarray, sampling_rate_hz: float) -> Rest:
    """The rests of a sensor, its gyroscope bias and its specific force at rest.

    `gyr` [rad/s] and `acc` [m/s²] are (T, 3), finite. Rest is detected from the spread of the rate, because a bias
    shifts the rate itself. The error of a window's mean rate is the undetected turn of the sensor over the window's
    length; so windows weigh as length².
    """
    size = 2 * int(0.5 * sampling_rate_hz / 2) + 1  # [s]
    if len(gyr) <= size:
        return Rest([], np.zeros(3), 0.0, 0.0)
    half = size // 2
    full = slice(half, len(gyr) - half)
    spread, there = held_spread(gyr, size)[full], held_mean(mask.astype(np.float64), size)[full] > 0.99
    least = np.min(spread[there], initial=np.inf)
    if not least < 0.1:  # [rad/s] the sensor never rests
        return Rest([], np.zeros(3), 0.0, 0.0)
    # the middle of a window is half a window after its first sample; a rest is extended by a quarter window each way
    quiet = np.zeros(len(gyr), bool)
    quiet[full] = there & (spread <= max(1.5 * least, 1e-9))
    windows = [(max(0, a - half // 2), min(len(gyr), b + half // 2)) for a, b in true_runs(quiet)]
    weights = np.array([(b - a) / sampling_rate_hz for a, b in windows]) ** 2
    biases = np.array([gyr[a:b].mean(axis=0) for a, b in windows])
    longest = windows[int(np.argmax(weights))]
    force = float(np.linalg.norm(acc[slice(*longest)].mean(axis=0)))
    return Rest(windows, weights @ biases / weights.sum(), force, float(np.sqrt(weights.sum())))


def longest_still(
    gyr: AnyArray,
    sampling_rate_hz: float,
    *,
    mask: AnyArray | None = None,
    threshold: float = 0.2,
    at_least_s: float = 0.0,
) -> tuple[int, int] | None:
    """The longest stretch (start, end) [samples], half-open, in which a segment stands still; None if there is none.

    The gyroscope's root mean square over a centred window is low there, √(Σ m |ω|² / Σ m) < threshold, m the mask; the
    ends of the recording are reflected.

    Args:
        gyr: (T, 3) angular rate [rad/s], finite.
        sampling_rate_hz: sampling rate [Hz].
        mask: (T,) bool, False where a sample is ignored; None: every sample counts.
        threshold: on the root mean square rate [rad/s]: a leg swings at 3 to 7, the stance of a shank has 0.5 to 1.5.
        at_least_s: shortest stretch that counts [s].
    """
    size = window_size(0.5, sampling_rate_hz)  # [s] longer than the quiet part of a stance
    if len(gyr) < size:
        return None
    power = (as_float(gyr) ** 2).sum(axis=-1)
    counts = np.ones_like(power) if mask is None else np.asarray(mask, np.float64)
    weight, mean = (window_sum(values, size, "reflect") / size for values in (counts, power * counts))
    still = np.asarray((mean < threshold**2 * weight) & (weight > 0.0))
    runs = [run for run in true_runs(still) if run[1] - run[0] >= max(1.0, at_least_s * sampling_rate_hz)]
    return max(runs, key=lambda run: run[1] - run[0], default=None)


def legs_at_rest(gyrs: Sequence[AnyArray], sampling_rate_hz: float, masks: Sequence[AnyArray] = ()) -> np.ndarray:
    """(T,) bool, where no leg moves, from angular rates (T, 3) [rad/s] and masks (T,) of all sensors on the legs.

    No gyroscope exceeds `LEGS_RATE` within `LEGS_WINDOW_S` of a sample at rest, or twice as much if there is no rest of
    `LEGS_SHORTEST_S`; nobody rests in a loss longer than a quarter of a second.
    """
    half = max(1, round(LEGS_WINDOW_S * sampling_rate_hz))
    fastest = np.max([np.linalg.norm(as_float(gyr), axis=1) for gyr in gyrs], axis=0)
    around = window_maximum(fastest, 2 * half + 1)
    for mask in masks:
        for first, after in true_runs(~np.asarray(mask, bool)):
            if after - first > 0.25 * sampling_rate_hz:  # [s] with standing before and after
                around[max(0, first - half) : after + half] = np.inf
    still = np.asarray(around < LEGS_RATE)
    if any(after - first >= LEGS_SHORTEST_S * sampling_rate_hz for first, after in true_runs(still)):
        return still
    return np.asarray(around < 2.0 * LEGS_RATE)


class TrunkRest(NamedTuple):
    """Standing still of a person with a sensor on the trunk, and the sensor's errors computed from it."""

    still: np.ndarray  #: (T,) bool, True where the person stands still.
    gyr_bias: np.ndarray  #: (3,) gyroscope bias [rad/s].
    scale: float  #: factor on the accelerometer, so that its reading at rest is gravity [1].
    #: duration of the rests from which the bias is computed, if the recording begins with a rest; else 0 [s].
    time: float
    first: np.ndarray  #: (3,) upward vertical in the trunk's axes, at the rest that begins in the first second [1].
    notes: tuple[Note, ...]  #: notes on the rests.


def trunk_rest(imu: Imu, rows: np.ndarray, mask: np.ndarray, rate: float) -> TrunkRest:
    """Standing still from a sensor on the trunk, with gyroscope bias and accelerometer scale, in the trunk's axes.

    `rows` (3, 3) are these axes in the sensor's; lost samples are interpolated, with `mask` (T,) False.
    """
    gyr, acc = (as_float(v) @ rows.T for v in (imu.gyr, imu.acc))
    size = window_size(0.5, rate)  # [s]
    still = held_spread(gyr, size) < TRUNK_RATE
    shaken, noise = held_spread(acc, size), held_spread(np.diff(acc, axis=0, prepend=acc[:1]), size) / math.sqrt(2.0)
    # trunks at rest have 0.05; only accelerometers with a range of 200 g have more, whose noise varies by half
    still &= shaken**2 - (1.5 * noise**2 if noise.min() > 0.125 else 0.0) < 0.25**2  # [m/s²]
    # a person who leans or turns slowly does not stand still
    still &= np.linalg.norm(held_mean(gyr, size) - rest(gyr, acc, mask, rate).gyr_bias, axis=1) < TRUNK_RATE
    for a, b in true_runs(~mask):
        # a short loss was interpolated, and does not end a rest
        still[a:b] &= b - a <= BRIDGED_S * rate
    notes: list[Note] = []
    # without the ends of a rest, which may contain the push of the first step; the ends of the recording stay
    edge = size // 2
    runs = [(a + edge * (a > 0), b - edge * (b < len(gyr))) for a, b in true_runs(still)]
    runs = [(a, b) for a, b in runs if b > a]
    weights = [((b - a) / rate) ** 2 for a, b in runs if b - a >= LEAST_REST_S * rate]
    bias, seconds = np.zeros(3), math.sqrt(sum(weights))
    if weights:
        means = [gyr[a:b].mean(axis=0) for a, b in runs if b - a >= LEAST_REST_S * rate]
        bias = np.average(means, axis=0, weights=weights)
    else:
        notes.append(NEVER_STILL(seconds=LEAST_REST_S))
    scale = 1.0
    if runs:
        a, b = max(runs, key=lambda run: run[1] - run[0])
        scale = GRAVITY / float(np.linalg.norm(acc[a:b].mean(axis=0)))
    early = next(((a, b) for a, b in runs if a < rate), None)
    first = acc[early[0] : early[1]].mean(axis=0) if early else np.array([0.0, 0.0, 1.0])
    return TrunkRest(still, bias, scale, seconds if early else 0.0, first / np.linalg.norm(first), tuple(notes))
