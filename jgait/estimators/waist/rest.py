"""Where a person stands still, and what a sensor on the trunk reads there. On the host, in NumPy."""

from typing import NamedTuple

import numpy as np

from jgait.events.rest import rest
from jgait.geometry.vectors import GRAVITY
from jgait.mounting.trunk import TrunkAxes
from jgait.signal.windows import true_runs, window_size
from jgait.types import Imu, as_float

STILL_WINDOW_S = 0.5
"""[s] Over which the spread tells whether one stands."""
STILL_RATE, STILL_FORCE = 0.12, 0.25
"""[rad/s], [m/s²] Spread of rate and of the specific force's magnitude over the window, below which one stands."""

LEAST_REST_S = 2.0
"""[s] A gyroscope's bias is read only from so long a rest; a shorter one tells less than nothing."""

BIAS_KNOWN = 0.06
"""[rad/s] No gyroscope reads more than this at rest; what does, turns."""

BRIDGED_S = 0.1
"""[s] A shorter loss in a rest is no end of it."""


class TrunkRest(NamedTuple):
    """Where the person stands still, and what the sensor reads there.

    Attributes:
        still: (T,) bool.
        gyr_bias: (3,) [rad/s].
        scale: what the accelerometer is multiplied by, so that it reads gravity at rest [1].
        time: of rest that tells the bias, where the recording begins with one; else 0 [s].
        first: (3,) direction of gravity in the trunk's axes in the first second, upwards [1].
        notes: in words, what was noticed.
    """

    still: np.ndarray
    gyr_bias: np.ndarray
    scale: float
    time: float
    first: np.ndarray
    notes: tuple[str, ...]

    @classmethod
    def none(cls, samples: int) -> "TrunkRest":
        """Nobody rests."""
        return cls(np.zeros(samples, bool), np.zeros(3), 1.0, 0.0, np.array([0.0, 0.0, 1.0]), ())


def trunk_rest(imu: Imu, axes: TrunkAxes, mask: np.ndarray, rate: float) -> TrunkRest:
    """Where the person stands still, what the gyroscope and the accelerometer read there; in the trunk's axes.

    Args:
        imu: without lost samples (see `shank_axes.filled`).
        axes: of the trunk in the sensor's.
        mask: (T,) bool, False where a sample was lost.
        rate: of the samples [Hz].
    """
    gyr, acc = (as_float(v) @ axes.rows.T for v in (imu.gyr, imu.acc))
    found = rest(gyr, acc, mask, rate)
    reads = found.gyr_bias if np.linalg.norm(found.gyr_bias) < BIAS_KNOWN else np.zeros(3)
    size = window_size(STILL_WINDOW_S, rate)
    still = _spread(gyr, size) < STILL_RATE
    still &= _spread(acc, size) < STILL_FORCE
    # who leans or turns slowly does not stand
    still &= np.linalg.norm(_mean(gyr, size) - reads, axis=1) < STILL_RATE
    for a, b in true_runs(~mask):
        # a short loss was bridged, and does not end a rest
        still[a:b] &= b - a <= BRIDGED_S * rate
    notes: list[str] = []
    runs = [_inner(run, size // 2, len(gyr)) for run in true_runs(still)]
    runs = [(a, b) for a, b in runs if b > a]
    bias, seconds = _without_sway(gyr, acc, runs, rate)
    if seconds == 0.0:
        notes.append(
            f"nobody stands still for {LEAST_REST_S:g} s: the gyroscope is taken as it reads, and tilt is less certain"
        )
    scale = 1.0
    if runs:
        a, b = max(runs, key=lambda run: run[1] - run[0])
        felt = float(np.linalg.norm(acc[a:b].mean(axis=0))) / GRAVITY
        scale = 1.0 / felt
        if abs(felt - 1.0) > 0.01:
            notes.append(f"the accelerometer reads {100.0 * (felt - 1.0):+.1f} % of gravity at rest; corrected")
    early = next(((a, b) for a, b in runs if a < rate), None)
    first = acc[early[0] : early[1]].mean(axis=0) if early else np.array([0.0, 0.0, 1.0])
    return TrunkRest(still, bias, scale, seconds if early else 0.0, first / np.linalg.norm(first), tuple(notes))


def _inner(run: tuple[int, int], edge: int, samples: int) -> tuple[int, int]:
    """A rest without its ends, in which the push of the first step may lie; not those of the recording."""
    a, b = run
    return a + (edge if a > 0 else 0), b - (edge if b < samples else 0)


def _without_sway(
    gyr: np.ndarray, acc: np.ndarray, runs: list[tuple[int, int]], rate: float
) -> tuple[np.ndarray, float]:
    """The gyroscope's bias (3,) [rad/s] and the time of rest that tells it [s].

    A rest's mean, less the turn that gravity shows from end to end; zero where nobody rests for long enough.
    """
    told, weights = [], []
    edge = max(1, int(0.25 * rate))
    for a, b in runs:
        if b - a < LEAST_REST_S * rate:
            continue
        before, after = (acc[c:d].mean(axis=0) for c, d in ((a, a + edge), (b - edge, b)))
        before, after = before / np.linalg.norm(before), after / np.linalg.norm(after)
        seconds = (b - a - edge) / rate
        # gravity's direction in the trunk's axes turns against the trunk
        told.append(gyr[a:b].mean(axis=0) + np.cross(before, after) / seconds)
        weights.append(seconds**2)
    if not told:
        return np.zeros(3), 0.0
    return np.average(told, axis=0, weights=weights), float(np.sqrt(np.sum(weights)))


def _mean(values: np.ndarray, size: int) -> np.ndarray:
    """(T, …) mean over a centred window, the ends held."""
    padded = np.pad(values, [(size // 2, size // 2), (0, 0)], mode="edge")
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(padded, axis=0)])
    return np.asarray((total[size:] - total[:-size]) / size)


def _spread(values: np.ndarray, size: int) -> np.ndarray:
    """(T,) standard deviation over a centred window, of all columns together."""
    centred = values - np.median(values, axis=0)
    return np.sqrt(np.maximum(_mean(centred**2, size) - _mean(centred, size) ** 2, 0.0).sum(axis=1))
