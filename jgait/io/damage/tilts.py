"""Whether gyroscope and accelerometer agree on the tilt of a sensor between standing and walking.

In standing the accelerometer reads gravity, and so it does in the mean over the strides that follow. Turned back by the
gyroscope to the axes in standing, both means point the same way. If a sign, the order or the handedness of axes is
wrong, they do not, even where the size of the mean is right: a thigh is on average bent while a person walks.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from jgait.io.damage.agreement import WINDOW_S, Averaged, averaged, moving_means, turned
from jgait.notes import Kind, Note
from jgait.signal.windows import true_runs
from jgait.types import Imu

RATE_HZ = 50.0
"""[Hz] Least rate of the samples that are averaged before they are turned."""

SLOWEST_HZ = 20.0
"""[Hz] Least sampling rate; between slower samples the legs turn too far."""

STANDING_S = 0.5
"""[s] Length of a window of standing."""

STILL = 0.05, 1.0
"""[rad/s], [m/s²] Largest standard deviation of the rate and of the specific force in standing."""

BIAS_S = 1.5
"""[s] Shortest standing whose mean rate is the bias of the gyroscope: in shorter ones people shift their weight. Chosen
on walks of `walking5m` that were cut before the first step."""

BESIDE_S = 5.0
"""[s] Time before and after standing that is examined; later, errors of the gyroscope weigh more."""

MOST_STANDINGS = 8
"""[1] Number of times of standing that are examined, the longest ones."""

MOVING = {"pelvis": 0.15, "lower": 0.15, "waist": 0.15, "": 1.0}
"""[rad/s] Least root mean square rate of a window of walking, by segment."""

ACTIVE = 0.4
"""[1] Share of the fastest window's mean square rate above which a window counts as walking."""

FIRST = 2
"""[1] Number of windows of walking nearest to the standing that are taken."""

FARTHEST_DEG = {
    "foot": 16.0, "ankle": 8.0, "shank": 8.0, "thigh": 7.0, "pelvis": 9.0, "lower": 9.0, "waist": 9.0,
}  # fmt: skip
"""[deg] Largest angle between both means, the least of all times of standing, by segment. Undamaged recordings, public
and simulated, reach 13.3 at the foot, 5.8 at the shank, 4.3 at the thigh and 6.3 at the trunk."""

TILTS_APART = Kind(
    "tilts_apart",
    "check",
    "{placement}: between standing and walking its gyroscope and its accelerometer tilt by up to {degrees:.0f}° more "
    "or less than each other; the sign, order or handedness of the axes of one of them is wrong",
    "Angles of this sensor, and what is computed from them, are wrong.",
)


def tilt_notes(sensors: Mapping[str, Imu], rate_hz: float) -> tuple[Note, ...]:
    """Notes about sensors whose gyroscope and accelerometer disagree on the tilt between standing and walking."""
    notes: list[Note] = []
    for placement, imu in sensors.items() if rate_hz >= SLOWEST_HZ else ():
        segment = placement.partition("_")[0]
        if segment not in FARTHEST_DEG or imu.acc is None:
            continue
        angles = tilts(imu, rate_hz, MOVING.get(segment, MOVING[""]))
        if angles and min(angles) > FARTHEST_DEG[segment]:
            notes.append(TILTS_APART(placement=placement, degrees=min(angles)))
    return tuple(notes)


def tilts(imu: Imu, rate_hz: float, moving: float) -> list[float]:
    """Angle between the mean forces of standing and walking for each time of standing [deg].

    Args:
        imu: a sensor with an accelerometer; short gaps of the gyroscope are bridged.
        rate_hz: sampling rate [Hz].
        moving: least root mean square rate of a window of walking [rad/s].
    """
    sensor = averaged(imu, rate_hz, RATE_HZ, WINDOW_S)
    if sensor is None:
        return []
    window, stand = round(WINDOW_S / sensor.step), round(STANDING_S / sensor.step)
    if len(sensor.gyr) < window + stand:
        return []
    weight = np.hanning(window + 2)[1:-1]
    windows = []
    for bias, down, rates, forces in _beside_standing(sensor, stand, round(BESIDE_S / sensor.step)):
        if len(rates) < window:
            continue
        rows = np.arange(0, len(rates) - window + 1, window // 2)[:, None] + np.arange(window)
        square = np.sum(rates[rows] ** 2, axis=2).mean(axis=1)
        walks = np.flatnonzero(square > max(ACTIVE * square.max(), moving**2))[:FIRST]
        if not walks.size:
            continue
        back = turned(rates - bias, forces, sensor.step).T
        mean = np.einsum("w,kwi->ki", weight, back[rows[walks]])
        cosine = mean @ down / (np.linalg.norm(mean, axis=1) * np.linalg.norm(down))
        windows.append(float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))).mean()))
    return windows


def _beside_standing(
    sensor: Averaged, stand: int, beside: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Bias and mean force in standing, and rates and forces after it; those before it backwards in time."""
    gyr, acc, lost, _ = sensor
    spread = [np.sqrt(np.maximum(_variance(part, stand), 0.0)) for part in (gyr, acc)]
    broken = np.convolve(lost, np.ones(stand), "valid") > 0
    runs = true_runs((spread[0] < STILL[0]) & (spread[1] < STILL[1]) & ~broken)
    longest = sorted(runs, key=lambda run: run[0] - run[1])[:MOST_STANDINGS]
    if not longest or (longest[0][1] - 1 + stand - longest[0][0]) * sensor.step < BIAS_S:
        return
    # a person who comes to rest still turns slowly: the longest standing has the bias
    bias = gyr[longest[0][0] : longest[0][1] - 1 + stand].mean(axis=0)
    for start, end in longest:
        for way, first in ((1, end - 1), (-1, start)):
            standing = slice(first, first + stand)
            after = np.arange(first + stand, min(first + stand + beside, len(gyr)))
            before = np.arange(first - 1, max(first - 1 - beside, -1), -1)
            rows = after if way == 1 else before
            ends = np.flatnonzero(lost[rows])
            rows = rows[: ends[0]] if ends.size else rows
            yield way * bias, acc[standing].mean(axis=0), way * gyr[rows], acc[rows]


def _variance(values: np.ndarray, samples: int) -> np.ndarray:
    """Sum over the axes of the variance in each window (T − samples + 1,)."""
    values = values - values.mean(axis=0)
    mean, square = (moving_means(power, samples) for power in (values, values * values))
    return np.asarray(np.sum(square - mean * mean, axis=1))
