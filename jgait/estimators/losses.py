"""Lost samples: which of them count, and how filters of motion pass them."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jgait.estimators.notes import LONGEST_LOSS
from jgait.signal.windows import true_runs

BRIDGED = 0.05
"""[s] Longest loss that is bridged by interpolation, and does not count as lost; chosen: 5 samples at 100 Hz."""

FROZEN = 1e-3
"""[s] Interval between samples that a filter uses within a long loss: its state hardly changes."""

MOST_RATE, MOST_FORCE = 5.0, 10.0
"""[rad/s], [m/s²] Upper limit on the mean error that slopes give for a loss; chosen: a swing's rate, gravity."""

HELD = 1.5
"""[1] Error of the integral over a loss if the reading is held, over the error if it is interpolated: median over
moving feet and shanks and losses of 0.1 to 0.9 s (experiment `damage.gaps`)."""


def not_bridged(lost: np.ndarray, time: np.ndarray, longest: float = BRIDGED) -> np.ndarray:
    """(T,) bool, True in losses longer than `longest` [s]; in shorter ones a signal is nearly straight."""
    step = np.diff(time, prepend=time[0])
    gone = np.zeros(len(time), bool)
    for first, after in true_runs(lost):
        gone[first:after] = step[first:after].sum() > longest
    return gone


def longest_loss(lost: np.ndarray, time: np.ndarray) -> float:
    """Duration [s] of the longest loss, from flags of lost samples (T,); 0 without losses."""
    step = np.diff(time, prepend=time[0])
    return max((float(step[first:after].sum()) for first, after in true_runs(lost)), default=0.0)


def integral_error[Seconds: (float, np.ndarray, Array)](seconds: Seconds, size: float, settling: float) -> Seconds:
    """Standard deviation of the integral of a signal that is interpolated over a loss of `seconds`.

    Over a long loss the error is like a constant of `size`, over one shorter than `settling` [s] it is smaller.
    """
    return size * seconds * seconds / (seconds + settling)


def bend_error(values: np.ndarray, time: np.ndarray, first: int, after: int) -> float:
    """Size of the error of the integral of signals (T, k), interpolated over the lost samples `first` to `after`.

    By the formula of Euler and Maclaurin a straight line errs by T² / 12 times the change of the slope over the time T.
    An impact within the loss has a far larger error. 0 at an end of the recording.
    """
    if first < 2 or after + 1 >= len(time):
        return 0.0
    before, behind = ((values[i] - values[i - 1]) / (time[i] - time[i - 1]) for i in (first - 1, after + 1))
    return float((time[after] - time[first - 1]) ** 2 / 12.0 * np.linalg.norm(behind - before))


class Bridge(NamedTuple):
    """How a filter passes lost samples, all (T,): intervals [s], and standard deviations of errors of single samples,
    independent of each other, of rate [rad/s] and specific force [m/s²]; 0 where a sample is measured.
    """

    dt: np.ndarray
    rate: np.ndarray
    force: np.ndarray


def bridged(
    lost: np.ndarray, time: np.ndarray, dt: np.ndarray, gyr: np.ndarray, acc: np.ndarray,
    rate: tuple[float, float], force: tuple[float, float],
) -> Bridge:  # fmt: skip
    """Over up to `LONGEST_LOSS`, interpolated readings are integrated, with errors of the sizes of `integral_error` and
    `bend_error`.

    Over a longer loss the state does not change, and has the errors of held readings after `LONGEST_LOSS`: a leg's
    posture changes less than an integral without readings would.
    """
    step = np.diff(time, prepend=time[0])
    bridge = Bridge(dt.copy(), np.zeros(len(time)), np.zeros(len(time)))
    for first, after in true_runs(lost):
        run = slice(first, after)
        seconds, steps, factor = float(step[run].sum()), np.maximum(step[run], 1e-6), 1.0
        if seconds > LONGEST_LOSS:
            seconds, steps, factor = LONGEST_LOSS, np.full(after - first, FROZEN), HELD
            bridge.dt[run] = np.minimum(dt[run], FROZEN)
        for values, noise, size, most in ((gyr, bridge.rate, rate, MOST_RATE), (acc, bridge.force, force, MOST_FORCE)):
            bend = bend_error(values, time, first, after) if seconds < LONGEST_LOSS else 0.0
            error = np.hypot(factor * integral_error(seconds, *size), min(bend, most * seconds))
            noise[run] = error / np.sqrt(steps.sum() * steps)
    return bridge


def held_bridge(
    lost: Array, seconds: Array, step: Array, rate: tuple[float, float], force: tuple[float, float]
) -> tuple[Array, Array, Array]:
    """`bridged` sample by sample, with held readings: whether the sample is integrated, and both standard deviations.

    Args:
        lost: (T,) 1 where a sample is lost, else 0.
        seconds: (T,) time lost since the last foothold, the sample included; losses of a stride count as one [s].
        step: interval of the samples [s].
        rate: see `bridged`.
        force: see `bridged`.
    """
    goes = seconds <= LONGEST_LOSS
    whole = jnp.maximum(seconds, step)
    noises = []
    for size in (rate, force):
        now, before = (HELD * integral_error(v, *size) for v in (whole, whole - step))
        noises.append(jnp.where(goes, lost * jnp.sqrt(now * now - before * before) / step, 0.0))
    return goes | (lost == 0.0), noises[0], noises[1]


def lost_between(lost: np.ndarray, time: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Time [s] that is lost after sample `begin` (n,) and up to sample `end`, by flags of lost samples (T,).

    Losses that are bridged do not count.
    """
    total = np.cumsum(np.where(not_bridged(lost, time), np.diff(time, prepend=time[0]), 0.0))
    return np.asarray(total[end] - total[begin])
