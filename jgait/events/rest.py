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

STILL_RATE = 0.2
"""[rad/s] Threshold on the root mean square rate of a standing segment: the swing of a leg reaches 3 to 7 rad/s, the
stance of a shank 0.5 to 1.5 rad/s, and a standing leg with its gyroscope bias stays under 0.1 rad/s."""

STILL_WINDOW_S = 0.5
"""[s] Window of that root mean square: longer than the quiet part of a stance phase."""

LEGS_LOST_S = 0.25
"""[s] Longest loss of samples in which a person still stands, if they stand before and after."""

LEGS_RATE = 0.25
"""[rad/s] Threshold on the fastest leg gyroscope while a person stands; twice as much is accepted if nothing is slower,
and a note of the estimator names the leg that moves."""

LEGS_WINDOW_S = 0.25
"""[s] Time before and after a sample in which all leg gyroscopes must stay below the threshold."""

LEGS_SHORTEST_S = 0.5
"""[s] Shortest standing that can calibrate a leg."""

QUIET_WINDOW = 0.5
"""[s] Window of the spread of the rate of a foot."""

QUIET = 1.5
"""[1] A window rests if its spread is at most this many times the smallest spread of the recording."""

RESTLESS = 0.1
"""[rad/s] If the smallest spread is larger, the sensor never rests."""

TRUNK_WINDOW_S = 0.5
"""[s] Window of the spread of the trunk's signals."""

TRUNK_RATE, TRUNK_FORCE = 0.12, 0.25
"""[rad/s], [m/s²] Thresholds on the spread of the trunk's angular rate and specific force while a person stands."""

NOISY = 0.125
"""[m/s²] Noise of an accelerometer from sample to sample above which the noise is subtracted from the trunk's movement.
Trunks at rest have 0.05; only accelerometers with a range of 200 g have more."""

LEAST_REST_S = 2.0
"""[s] Shortest rest from which the bias of the trunk's gyroscope is computed; a shorter rest gives a worse bias."""

BIAS_KNOWN = 0.06
"""[rad/s] Largest expected bias of a gyroscope; a larger mean rate means that the trunk turns."""

BRIDGED_S = 0.1
"""[s] Longest loss of samples that does not end a rest."""


class Rest(NamedTuple):
    """A sensor at rest."""

    windows: list[tuple[int, int]]  #: half-open ranges of samples in which the sensor rests; empty if it never rests.
    gyr_bias: np.ndarray  #: (3,) gyroscope bias [rad/s].
    force: float  #: length of the mean specific force [m/s²]; 0 if the sensor never rests.
    time: float  #: duration of rest, √Σ t² of the windows [s].


NEVER_STILL = Kind(
    "never_still",
    "check",
    "nobody stands still for {seconds:g} s: the gyroscope is taken as it reads, and tilt is less certain",
    FEW_RESTS,
)


def rest(gyr: np.ndarray, acc: np.ndarray, mask: np.ndarray, sampling_rate_hz: float) -> Rest:
    """The rests of a sensor, its gyroscope bias and its specific force at rest.

    `gyr` [rad/s] and `acc` [m/s²] are (T, 3), finite. Rest is detected from the spread of the rate over half a second,
    because a bias shifts the rate itself. The error of a window's mean rate is the undetected turn of the sensor over
    the window's length; so windows weigh as length².
    """
    size = 2 * int(QUIET_WINDOW * sampling_rate_hz / 2) + 1
    if len(gyr) <= size:
        return Rest([], np.zeros(3), 0.0, 0.0)
    half = size // 2
    full = slice(half, len(gyr) - half)
    spread, there = held_spread(gyr, size)[full], held_mean(mask.astype(np.float64), size)[full] > 0.99
    least = np.min(spread[there], initial=np.inf)
    if not least < RESTLESS:
        return Rest([], np.zeros(3), 0.0, 0.0)
    # the middle of a window is half a window after its first sample; a rest is extended by a quarter window each way
    quiet = np.zeros(len(gyr), bool)
    quiet[full] = there & (spread <= max(QUIET * least, 1e-9))
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
    threshold: float = STILL_RATE,
    at_least_s: float = 0.0,
) -> tuple[int, int] | None:
    """The longest stretch (start, end) [samples], half-open, in which a segment stands still.

    The segment stands still where the gyroscope's root mean square over a centred window is low,
    √(Σ m |ω|² / Σ m) < threshold, m the mask; the ends of the recording are reflected.

    Args:
        gyr: (T, 3) angular rate [rad/s], finite.
        sampling_rate_hz: sampling rate [Hz].
        mask: (T,) bool, False where a sample is ignored; None: every sample counts.
        threshold: on the root mean square rate [rad/s].
        at_least_s: shortest stretch that counts [s].

    Returns:
        The stretch; None if no stretch is long enough, or the recording is shorter than a window.
    """
    size = window_size(STILL_WINDOW_S, sampling_rate_hz)
    if len(gyr) < size:
        return None
    power = (as_float(gyr) ** 2).sum(axis=-1)
    counts = np.ones_like(power) if mask is None else np.asarray(mask, np.float64)
    weight, mean = (window_sum(values, size, "reflect") / size for values in (counts, power * counts))
    still = np.asarray((mean < threshold**2 * weight) & (weight > 0.0))
    runs = [run for run in true_runs(still) if run[1] - run[0] >= max(1.0, at_least_s * sampling_rate_hz)]
    return max(runs, key=lambda run: run[1] - run[0], default=None)


def legs_at_rest(gyrs: Sequence[AnyArray], sampling_rate_hz: float, masks: Sequence[AnyArray] = ()) -> np.ndarray:
    """(T,) bool, where no leg moves, from angular rates (T, 3) [rad/s] and masks (T,) of all sensors on the legs; a
    person who sits rests too, nobody rests in a loss longer than `LEGS_LOST_S`.

    A sample is at rest when no gyroscope exceeds `LEGS_RATE` within `LEGS_WINDOW_S` of it, or twice as much if there is
    no rest of `LEGS_SHORTEST_S`.
    """
    half = max(1, round(LEGS_WINDOW_S * sampling_rate_hz))
    fastest = np.max([np.linalg.norm(as_float(gyr), axis=1) for gyr in gyrs], axis=0)
    around = window_maximum(fastest, 2 * half + 1)
    for mask in masks:
        for first, after in true_runs(~np.asarray(mask, bool)):
            if after - first > LEGS_LOST_S * sampling_rate_hz:
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

    @classmethod
    def none(cls, samples: int) -> "TrunkRest":
        """The result for a recording without rest."""
        return cls(np.zeros(samples, bool), np.zeros(3), 1.0, 0.0, np.array([0.0, 0.0, 1.0]), ())


def trunk_rest(imu: Imu, rows: np.ndarray, mask: np.ndarray, rate: float) -> TrunkRest:
    """Standing still from a sensor on the trunk, with gyroscope bias and accelerometer scale, in the trunk's axes.

    `rows` (3, 3) are these axes in the sensor's; lost samples are interpolated, with `mask` (T,) False.
    """
    gyr, acc = (as_float(v) @ rows.T for v in (imu.gyr, imu.acc))
    rests = rest(gyr, acc, mask, rate)
    reads = rests.gyr_bias if np.linalg.norm(rests.gyr_bias) < BIAS_KNOWN else np.zeros(3)
    size = window_size(TRUNK_WINDOW_S, rate)
    still = held_spread(gyr, size) < TRUNK_RATE
    shaken, noise = held_spread(acc, size), held_spread(np.diff(acc, axis=0, prepend=acc[:1]), size) / math.sqrt(2.0)
    # within half a second, the variance of noise is up to half larger than its own
    still &= shaken**2 - (1.5 * noise**2 if noise.min() > NOISY else 0.0) < TRUNK_FORCE**2
    # a person who leans or turns slowly does not stand still
    still &= np.linalg.norm(held_mean(gyr, size) - reads, axis=1) < TRUNK_RATE
    for a, b in true_runs(~mask):
        # a short loss was interpolated, and does not end a rest
        still[a:b] &= b - a <= BRIDGED_S * rate
    notes: list[Note] = []
    # without the ends of a rest, which may contain the push of the first step; the ends of the recording stay
    edge = size // 2
    runs = [(a + edge * (a > 0), b - edge * (b < len(gyr))) for a, b in true_runs(still)]
    runs = [(a, b) for a, b in runs if b > a]
    bias, seconds = _without_sway(gyr, acc, runs, rate)
    if seconds == 0.0:
        notes.append(NEVER_STILL(seconds=LEAST_REST_S))
    scale = 1.0
    if runs:
        a, b = max(runs, key=lambda run: run[1] - run[0])
        scale = GRAVITY / float(np.linalg.norm(acc[a:b].mean(axis=0)))
    early = next(((a, b) for a, b in runs if a < rate), None)
    first = acc[early[0] : early[1]].mean(axis=0) if early else np.array([0.0, 0.0, 1.0])
    return TrunkRest(still, bias, scale, seconds if early else 0.0, first / np.linalg.norm(first), tuple(notes))


def _without_sway(
    gyr: np.ndarray, acc: np.ndarray, runs: list[tuple[int, int]], rate: float
) -> tuple[np.ndarray, float]:
    """The gyroscope's bias (3,) [rad/s] and the duration of the rests from which it is computed [s].

    The mean rate of each rest, minus the turn of the trunk that gravity shows from the rest's start to its end; zero
    without a rest of `LEAST_REST_S`.
    """
    rates, weights = [], []
    edge = max(1, int(0.25 * rate))
    for a, b in runs:
        if b - a < LEAST_REST_S * rate:
            continue
        before, after = (acc[c:d].mean(axis=0) for c, d in ((a, a + edge), (b - edge, b)))
        before, after = before / np.linalg.norm(before), after / np.linalg.norm(after)
        seconds = (b - a - edge) / rate
        # in the trunk's axes the direction of gravity turns opposite to the trunk
        rates.append(gyr[a:b].mean(axis=0) + np.cross(before, after) / seconds)
        weights.append(seconds**2)
    if not rates:
        return np.zeros(3), 0.0
    return np.average(rates, axis=0, weights=weights), float(np.sqrt(np.sum(weights)))
