"""Sensors of a recording, for all estimators: checks whose errors name sensor and cause, lost samples, and the readings
of a foot's or a shank's sensor without holes and clipped peaks.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import PyTree

from jgait.estimators.notes import CLIPPED, LONGEST_LOSS
from jgait.geometry.arrays import xp
from jgait.geometry.vectors import GRAVITY
from jgait.notes import Note
from jgait.quality.notes import left_out
from jgait.signal import clipping
from jgait.signal.windows import over_losses, true_runs, window_maximum
from jgait.types import Imu, Recording, RecordingError, Values, as_float

FEWEST_SAMPLES = 10
"""[1] Least number of samples of a recording; chosen: no step is shorter."""

FASTEST = 35.0
"""[rad/s] Largest rate of a walking person's limb: 2000 deg/s, the range of common gyroscopes."""

UNIT_FORCES = ((0.5, 2.0, "g"), (500.0, 2000.0, "mg"), (60.0, 150.0, "m/s², and was converted as if in g"))
"""[m/s²], lowest and highest median specific force, and the unit that it suggests; other values are left to the
readers' checks."""


def sensors_of(recording: Recording) -> str:
    """Which sensors a recording has, and why readers left others out: the end of a message about missing sensors."""
    reasons = "".join(f"; {note}" for note in left_out(recording.quality))
    return f"the recording has {sorted(recording.sensors)}{reasons}"


def common_time(
    recording: Recording, names: Sequence[str], caller: str, what: str, *, acc: bool = True, least_s: float = 0.5
) -> np.ndarray:
    """The common time (T,) [s] of several sensors; their signals are checked as well.

    `caller` is the estimator in error messages, `what` describes the sensors in them, such as "both feet".

    Raises:
        RecordingError: a recording shorter than `least_s`, clocks that run backwards or differ, signals of the wrong
            shape, NaN, all samples masked, no accelerometer, other units.
    """
    time = as_float(recording.sensors[names[0]].time)
    if time.size < FEWEST_SAMPLES or np.ptp(time) < least_s:
        lasts = float(np.ptp(time)) if time.size else 0.0
        raise RecordingError(
            f"{caller} needs a walk, {least_s:g} s and {FEWEST_SAMPLES} samples or more; "
            f"'{names[0]}' has {time.size} samples in {lasts:.2g} s"
        )
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
        _check_signals(imu, name)
    return time


def check_shapes(imu: Imu, name: str) -> None:
    """Raise RecordingError if the signals or the mask of a sensor have not one row for each time."""
    for what, axes in (("gyr", (3,)), ("acc", (3,)), ("mask", ())):
        values, shape = getattr(imu, what), (np.size(imu.time), *axes)
        if values is not None and np.shape(values) != shape:
            raise RecordingError(f"{what} of '{name}' must have shape {shape}; got {np.shape(values)}")


def _check_signals(imu: Imu, name: str) -> None:
    check_shapes(imu, name)
    for values in (imu.gyr, imu.acc):
        if values is not None and not np.all(np.isfinite(as_float(values))):
            raise RecordingError(f"'{name}' holds NaN or infinity; lost samples belong in the mask (see jgait.io)")
    if not np.any(imu.mask):
        raise RecordingError(f"every sample of '{name}' is masked as lost")
    if (rate := fast_rate(imu)) > FASTEST:
        raise RecordingError(
            f"gyr of '{name}' must be in rad/s; it reaches {rate:.4g} (99th percentile), but nothing worn while "
            f"walking exceeds {FASTEST:g} rad/s: is it in deg/s?"
        )
    force, unit = force_unit(imu)
    if unit:
        raise RecordingError(
            f"acc of '{name}' must be in m/s²; its median is {force:.3g}, where gravity alone is {GRAVITY:.3g}: is it "
            f"in {unit}?"
        )


def busy(imu: Imu) -> np.ndarray:
    """(T,) bool: the measured samples, without those of rest if less than 30 % of them move, as in hours of wear.

    A block of 100 samples is rest if its mean rate is below a fifth of that of block 60 in the order of falling rates,
    or of the median block of a short recording; so a minute of handling at 100 Hz has no effect.
    """
    mask = np.asarray(imu.mask, bool)
    size = np.linalg.norm(as_float(imu.gyr), axis=1)
    blocks = np.arange(len(size)) // 100
    counts = np.bincount(blocks, mask)
    mean = np.bincount(blocks, np.where(mask, size, 0.0)) / np.maximum(counts, 1.0)
    known = np.sort(mean[counts > 0])[::-1]
    least = 0.2 * known[min(60, len(known) // 2)] if len(known) else 0.0
    moves = mask & (mean[blocks] >= least)
    return np.asarray(moves if moves.sum() < 0.3 * mask.sum() else mask)


def fast_rate(imu: Imu) -> float:
    """99th percentile of the norm of the angular rate [rad/s] in samples that are `busy`; 0 without samples."""
    rates = np.linalg.norm(as_float(imu.gyr)[busy(imu)], axis=1)
    return float(np.percentile(rates, 99.0)) if rates.size else 0.0


def force_unit(imu: Imu) -> tuple[float, str]:
    """The median specific force [m/s²], and the unit that it suggests if it is not in m/s²; else ""."""
    if imu.acc is None or not np.any(imu.mask):
        return GRAVITY, ""
    middle = float(np.median(np.linalg.norm(as_float(imu.acc)[np.asarray(imu.mask, bool)], axis=1)))
    return middle, next((unit for low, high, unit in UNIT_FORCES if low < middle < high), "")


def check_options(options: PyTree, known: Mapping[str, Collection[str]]) -> None:
    """Raise ValueError for an unknown option, with the known ones; `known` maps each option to its values."""
    for name, values in known.items():
        if getattr(options, name) not in values:
            raise ValueError(f"{name} must be one of {', '.join(values)}; got {getattr(options, name)!r}")


def check_nominal_rate(time: np.ndarray, name: str, rate_hz: float) -> None:
    """Compare the nominal sampling rate [Hz] with that of the clock (T,) [s].

    Raises:
        RecordingError: if the rates differ by more than a twentieth.
    """
    measured_hz = 1.0 / float(np.median(np.diff(time)))
    if abs(measured_hz / rate_hz - 1.0) > 0.05:
        raise RecordingError(
            f"'{name}' has a sample every {1.0 / measured_hz:.4g} s, and is said to have {rate_hz:g} Hz"
        )


# --- lost samples: which of them count, and how filters of motion pass them ---

HELD = 1.5
"""[1] Error of the integral over a loss if the reading is held, over the error if it is interpolated: median over
moving feet and shanks and losses of 0.1 to 0.9 s (experiment `damage.gaps`)."""


def not_bridged(lost: np.ndarray, time: np.ndarray, longest: float = 0.05) -> np.ndarray:
    """(T,) bool, True in losses longer than `longest` [s]: shorter ones, such as five samples at 100 Hz, are bridged by
    interpolation and do not count as lost, for the signal is nearly straight in them.
    """
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
    `bend_error`, which may not exceed a mean error of 5 rad/s, the rate of a swing, and of 10 m/s², that of gravity.

    Over a longer loss the state hardly changes, with intervals of 1 ms, and has the errors of held readings after
    `LONGEST_LOSS`: a leg's posture changes less than an integral without readings would.
    """
    step = np.diff(time, prepend=time[0])
    bridge = Bridge(dt.copy(), np.zeros(len(time)), np.zeros(len(time)))
    for first, after in true_runs(lost):
        run = slice(first, after)
        seconds, steps, factor = float(step[run].sum()), np.maximum(step[run], 1e-6), 1.0
        if seconds > LONGEST_LOSS:
            seconds, steps, factor = LONGEST_LOSS, np.full(after - first, 1e-3), HELD
            bridge.dt[run] = np.minimum(dt[run], 1e-3)
        for values, noise, size, most in ((gyr, bridge.rate, rate, 5.0), (acc, bridge.force, force, 10.0)):
            bend = bend_error(values, time, first, after) if seconds < LONGEST_LOSS else 0.0
            error = np.hypot(factor * integral_error(seconds, *size), min(bend, most * seconds))
            noise[run] = error / np.sqrt(steps.sum() * steps)
    return bridge


def held_bridge(
    lost: Array, seconds: Array, step: Array, rate: tuple[float, float], force: tuple[float, float]
) -> tuple[Array, Array, Array]:
    """`bridged` sample by sample, with held readings: whether the sample is integrated, and both standard deviations.

    `lost` (T,) is 1 where a sample is lost, else 0; `seconds` (T,) is the time lost since the last foothold, the sample
    included [s], so that the losses of a stride count as one; `step` is the interval of the samples [s].
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


# --- readings without holes and clipped peaks ---

JUMP_S = 0.0075
"""[s] Half width of the window whose largest change of the readings gives a reading's noise."""


class RepairedReadings(NamedTuple):
    """Readings of a sensor whose lost samples are interpolated and whose clipped peaks are restored, leaves (T, …)."""

    gyr: np.ndarray  #: (3,) angular rate [rad/s].
    acc: np.ndarray  #: (3,) specific force [m/s²].
    lost: np.ndarray  #: bool, the sample was not measured, or comes late.
    gyr_clipped: np.ndarray  #: bool, the gyroscope clipped.
    acc_clipped: np.ndarray  #: bool, the accelerometer clipped.
    gyr_doubt: np.ndarray  #: standard deviation of the rate where it clipped, else 0 [rad/s].
    acc_doubt: np.ndarray  #: standard deviation of the specific force where it clipped, else 0 [m/s²].

    def notes(self, placement: str) -> list[Note]:
        """Notes on signals that clipped."""
        signals = {"accelerometer": self.acc_clipped, "gyroscope": self.gyr_clipped}
        return [
            CLIPPED(signal=signal, placement=placement, samples=clipped.sum())
            for signal, clipped in signals.items() if clipped.any()
        ]  # fmt: skip


def readings(
    imu: Imu, time: np.ndarray, clips_above: tuple[float, float], doubt: tuple[float, float], least: int = 2
) -> RepairedReadings:
    """The readings of a sensor with an accelerometer, of which at least one sample was measured at `time` (T,) [s].

    `least` equal samples or more at the maximum of an axis clip above `clips_above` [rad/s, m/s²]; `doubt` are standard
    deviations of clipped samples that cannot be restored [rad/s, m/s²].
    """
    mask = np.asarray(imu.mask, bool)
    gyr, acc = (over_losses(time, values, mask) for values in (imu.gyr, imu.acc))
    as_read = [np.where(mask[:, None], as_float(values), 0.0) for values in (imu.gyr, imu.acc)]
    peaks = clipping.restored(gyr)
    equal = clipping.at_limit(as_read[0], clips_above[0], least) & ~peaks.clipped
    clipped = clipping.forces_clipped(as_read[1], clips_above[1], least)
    forces = clipping.restored_forces(acc, clipped | ~mask)
    step = np.diff(time, prepend=time[0])
    return RepairedReadings(
        peaks.signal, forces.signal, ~mask | (step > 1.5 * np.median(step[1:])), equal | peaks.clipped, clipped,
        np.maximum(peaks.doubt, doubt[0] * equal), np.where(forces.clipped, forces.doubt, doubt[1] * clipped),
    )  # fmt: skip


def jumps(gyr: np.ndarray, acc: np.ndarray, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """(T,) largest change of rate and of force from sample to sample, over `JUMP_S` before and after each sample."""
    size = max(3, 2 * round(JUMP_S * rate_hz) + 1)
    gyr_jump, acc_jump = (
        window_maximum(np.linalg.norm(np.gradient(values, axis=0), axis=1), size) for values in (gyr, acc)
    )
    return gyr_jump, acc_jump


def mean_over_interval(values: Values) -> Values:
    """(T, …) mean of each sample and the one before it; the first sample is as it is."""
    return xp.concatenate([values[:1], 0.5 * (values[1:] + values[:-1])])
