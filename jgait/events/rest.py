"""Where a sensor on a foot or on the trunk rests, and what it reads there; NumPy, on the host."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jgait.signal.windows import moving_mean, true_runs, window_size

QUIET_WINDOW = 0.5
"""[s] Over which the spread of the rate tells whether a sensor rests."""

QUIET = 1.5
"""A window rests if its spread is at most this many times the least there is [1]."""

RESTLESS = 0.1
"""[rad/s] If even the quietest window spreads more than this, the sensor never rests."""


class Rest(NamedTuple):
    """A sensor at rest.

    Attributes:
        windows: half-open ranges of samples in which it rests; empty if it never does.
        gyr_bias: (3,) [rad/s].
        force: mean specific force [m/s²]; 0 if it never rests.
        time: how long it rests, as √Σ t² of the windows [s].
    """

    windows: list[tuple[int, int]]
    gyr_bias: np.ndarray
    force: float
    time: float


def rest(gyr: np.ndarray, acc: np.ndarray, mask: np.ndarray, sampling_rate_hz: float) -> Rest:
    """Where a sensor rests, and what it reads there.

    The spread of the rate over half a second tells it, not the rate itself, which a bias shifts. A window's mean errs
    by how far the sensor turns unseen, over its length; so windows weigh as their length squared.

    Args:
        gyr: (T, 3) [rad/s], finite.
        acc: (T, 3) [m/s²], finite.
        mask: (T,) bool, False where a sample was lost.
        sampling_rate_hz: of the samples [Hz].
    """
    size = 2 * int(QUIET_WINDOW * sampling_rate_hz / 2) + 1
    if len(gyr) <= size:
        return Rest([], np.zeros(3), 0.0, 0.0)
    half = size // 2

    def mean(values: np.ndarray) -> np.ndarray:
        total = np.concatenate([np.zeros((1, 3)), np.cumsum(values, axis=0)])
        return (total[size:] - total[:-size]) / size

    centred = gyr - np.median(gyr, axis=0)
    spread = np.sqrt(np.maximum(mean(centred**2) - mean(centred) ** 2, 0.0).sum(axis=1))
    there = mean(np.repeat(mask[:, None], 3, axis=1).astype(np.float64))[:, 0] > 0.99
    least = np.min(spread[there], initial=np.inf)
    if not least < RESTLESS:
        return Rest([], np.zeros(3), 0.0, 0.0)
    # a window's middle is half a window on; its edges rest as well, half of that is taken
    quiet = np.zeros(len(gyr), bool)
    quiet[half : half + len(spread)] = there & (spread <= max(QUIET * least, 1e-9))
    windows = [(max(0, a - half // 2), min(len(gyr), b + half // 2)) for a, b in true_runs(quiet)]
    weights = np.array([(b - a) / sampling_rate_hz for a, b in windows]) ** 2
    biases = np.array([gyr[a:b].mean(axis=0) for a, b in windows])
    longest = windows[int(np.argmax(weights))]
    force = float(np.linalg.norm(acc[slice(*longest)].mean(axis=0)))
    return Rest(windows, weights @ biases / weights.sum(), force, float(np.sqrt(weights.sum())))


STILL_RATE = 0.2
"""[rad/s] Root mean square rate below which a segment stands: swing reaches 3–7, stance of a shank 0.5–1.5,
a standing leg with its gyroscope's bias stays under 0.1."""

STILL_WINDOW_S = 0.5
"""[s] Window over which stillness is judged: longer than the quiet part of a stance phase."""


def still_mask(
    gyr: ArrayLike,
    sampling_rate_hz: float,
    *,
    mask: ArrayLike | None = None,
    threshold: float = STILL_RATE,
    window_s: float = STILL_WINDOW_S,
) -> Array:
    """Where a segment stands still: the gyroscope's root mean square over a window is below a threshold.

    √(Σ m |ω|² / Σ m) < threshold over the centred window, m the mask.

    Args:
        gyr: (T, 3) angular rate [rad/s], finite.
        sampling_rate_hz: rate of the samples [Hz]; static under jit.
        mask: (T,) bool, False where a sample is to be ignored; None: all count.
        threshold: root mean square rate below which it stands [rad/s].
        window_s: window [s], rounded up to an odd number of samples; static under jit.

    Returns:
        (T,) bool; False where a window has no sample that counts.

    Raises:
        ValueError: if the recording is shorter than half a window.
    """
    rate = jnp.asarray(gyr)
    power = (rate * rate).sum(axis=-1)
    counts = jnp.ones_like(power) if mask is None else jnp.asarray(mask).astype(power.dtype)
    size = window_size(window_s, sampling_rate_hz)
    weight = moving_mean(counts, size)
    return (moving_mean(power * counts, size) < threshold**2 * weight) & (weight > 0.0)


def longest_still(
    gyr: Any,
    sampling_rate_hz: float,
    *,
    mask: Any = None,
    threshold: float = STILL_RATE,
    window_s: float = STILL_WINDOW_S,
    at_least_s: float = 0.0,
) -> tuple[int, int] | None:
    """The longest stretch in which a segment stands still; on the host, not under jit.

    Args:
        gyr: (T, 3) angular rate [rad/s].
        sampling_rate_hz: rate of the samples [Hz].
        mask: (T,) bool, False where a sample is to be ignored; None: all count.
        threshold: as in `still_mask` [rad/s].
        window_s: as in `still_mask` [s].
        at_least_s: shorter stretches are ignored [s].

    Returns:
        (start, end) [samples], half-open; None if there is no such stretch, or the recording is shorter than a window.
    """
    rate = np.asarray(gyr)
    if len(rate) < window_size(window_s, sampling_rate_hz):
        return None
    still = np.asarray(still_mask(rate, sampling_rate_hz, mask=mask, threshold=threshold, window_s=window_s))
    runs = [run for run in true_runs(still) if run[1] - run[0] >= max(1.0, at_least_s * sampling_rate_hz)]
    return max(runs, key=lambda run: run[1] - run[0], default=None)
