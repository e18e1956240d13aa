"""Checks of the sensors of a recording that all estimators use; the errors name sensor and cause."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jgait.estimators.notes import LONGEST_LOSS
from jgait.signal.windows import true_runs
from jgait.types import Imu, Recording, RecordingError, as_float

BRIDGED = 0.05
"""[s] Longest loss that is bridged by interpolation, and does not count as lost; chosen: 5 samples at 100 Hz."""

FROZEN = 1e-3
"""[s] Interval of a filter over a sample of a long loss."""

HELD = 1.5
"""[1] Integrals of a reading that is held over a loss err by this factor more than those of one that is interpolated:
measured on feet and shanks of five data sets, losses of 0.1 to 0.9 s."""


SENSOR_LEFT_OUT = "sensor_left_out"
"""Code of a reader's note that a sensor is left out."""


def sensors_of(recording: Recording) -> str:
    """Which sensors a recording has, and why readers left others out: the end of a message about missing sensors."""
    left_out = [f"; {note}" for note in recording.notes if note.code == SENSOR_LEFT_OUT]
    return f"the recording has {sorted(recording.sensors)}{''.join(left_out)}"


def common_time(recording: Recording, names: Sequence[str], caller: str, what: str, *, acc: bool = True) -> np.ndarray:
    """The common time (T,) [s] of several sensors; their signals are checked as well.

    `caller` is the estimator in error messages, `what` describes the sensors in them, such as "both feet".

    Raises:
        RecordingError: clocks that run backwards or differ, signals of the wrong shape, NaN, all samples
            masked, no accelerometer.
    """
    time = as_float(recording.sensors[names[0]].time)
    step = np.diff(time)
    if not np.all(step > 0):
        row = int(np.argmin(step > 0)) + 1
        raise RecordingError(
            f"time must increase from sample to sample; '{names[0]}' has {time[row - 1]:.4f} s, then {time[row]:.4f} s "
            f"at sample {row}"
        )
    for name in names:
        imu = recording.sensors[name]
        other = as_float(imu.time)
        if other.shape != time.shape or np.max(np.abs(other - time)) > 0.5 * np.median(step):
            raise RecordingError(
                f"{caller} needs {what} on one clock; '{name}' has {other.size} samples from {other[0]:.3f} s, "
                f"'{names[0]}' has {time.size} from {time[0]:.3f} s: resample them together first"
            )
        if acc and imu.acc is None:
            raise RecordingError(f"{caller} needs an accelerometer; '{name}' has only a gyroscope")
        _check_signals(imu, name, time.size)
    return time


def _check_signals(imu: Imu, name: str, samples: int) -> None:
    for what, values in (("gyr", imu.gyr), ("acc", imu.acc)):
        if values is None:
            continue
        if np.shape(values) != (samples, 3):
            raise RecordingError(f"{what} of '{name}' must have shape ({samples}, 3); got {np.shape(values)}")
        if not np.all(np.isfinite(as_float(values))):
            raise RecordingError(f"'{name}' holds NaN or infinity; lost samples belong in the mask (see jgait.io)")
    if not np.any(imu.mask):
        raise RecordingError(f"every sample of '{name}' is masked as lost")


def check_nominal_rate(time: np.ndarray, name: str, rate_hz: float) -> None:
    """Compare the nominal sampling rate [Hz] with that of the clock (T,) [s].

    Raises:
        RecordingError: if the rates differ by more than a twentieth.
    """
    own = 1.0 / float(np.median(np.diff(time)))
    if abs(own / rate_hz - 1.0) > 0.05:
        raise RecordingError(f"'{name}' has a sample every {1.0 / own:.4g} s, and is said to have {rate_hz:g} Hz")


def not_bridged(lost: np.ndarray, time: np.ndarray) -> np.ndarray:
    """(T,) bool, the lost samples in a row for more than `BRIDGED`: in shorter losses a signal is nearly straight."""
    step = np.diff(time, prepend=time[0])
    gone = np.zeros(len(time), bool)
    for first, after in true_runs(lost):
        gone[first:after] = step[first:after].sum() > BRIDGED
    return gone


def longest_loss(lost: np.ndarray, time: np.ndarray) -> float:
    """Longest time [s] that is lost in a row, by flags of lost samples (T,); 0 without losses."""
    step = np.diff(time, prepend=time[0])
    return max((float(step[first:after].sum()) for first, after in true_runs(lost)), default=0.0)


def integral_error[Seconds: (float, np.ndarray, Array)](seconds: Seconds, size: float, settling: float) -> Seconds:
    """Standard deviation of the integral of a signal that is interpolated over a loss of `seconds`.

    Over a long loss the error is like a constant of `size`, over one shorter than `settling` [s] it is smaller.
    """
    return size * seconds * seconds / (seconds + settling)


class Bridge(NamedTuple):
    """How a filter passes lost samples, all (T,): intervals [s], and standard deviations of errors of single samples,
    independent of each other, of rate [rad/s] and specific force [m/s²]; 0 where a sample is measured.
    """

    dt: np.ndarray
    rate: np.ndarray
    force: np.ndarray


def bridged(
    lost: np.ndarray, time: np.ndarray, dt: np.ndarray, rate: tuple[float, float], force: tuple[float, float]
) -> Bridge:
    """Over up to `LONGEST_LOSS`, interpolated readings are integrated, with errors of the size of `integral_error`.

    Over a longer loss the state stays as it was, with the errors that held readings have after `LONGEST_LOSS`: a leg
    keeps its posture better than an integral of readings that it did not have.
    """
    step = np.diff(time, prepend=time[0])
    told = Bridge(dt.copy(), np.zeros(len(time)), np.zeros(len(time)))
    for first, after in true_runs(lost):
        run = slice(first, after)
        seconds, own, factor = float(step[run].sum()), np.maximum(step[run], 1e-6), 1.0
        if seconds > LONGEST_LOSS:
            seconds, own, factor = LONGEST_LOSS, np.full(after - first, FROZEN), HELD
            told.dt[run] = np.minimum(dt[run], FROZEN)
        for noise, size in ((told.rate, rate), (told.force, force)):
            noise[run] = factor * integral_error(seconds, *size) / np.sqrt(own.sum() * own)
    return told


def held_bridge(
    lost: Array, seconds: Array, step: Array, rate: tuple[float, float], force: tuple[float, float]
) -> tuple[Array, Array, Array]:
    """As `bridged`, sample by sample with readings that are held: whether time goes on, and both deviations.

    Args:
        lost: (T,) 1 where a sample is lost, else 0.
        seconds: (T,) time lost so far [s].
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
