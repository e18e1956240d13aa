"""Checks of the sensors of a recording that all estimators use; the errors name sensor and cause."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from jaxtyping import PyTree

from jgait.geometry.vectors import GRAVITY
from jgait.quality.notes import left_out
from jgait.types import Imu, Recording, RecordingError, as_float

LEAST_S, FEWEST_SAMPLES = 0.5, 10
"""[s], [1] Least duration and number of samples of a recording: no step is shorter."""

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
    recording: Recording, names: Sequence[str], caller: str, what: str, *, acc: bool = True, least_s: float = LEAST_S
) -> np.ndarray:
    """The common time (T,) [s] of several sensors; their signals are checked as well.

    `caller` is the estimator in error messages, `what` describes the sensors in them, such as "both feet"; a walk has
    to last `least_s` [s].

    Raises:
        RecordingError: a recording too short for a step, clocks that run backwards or differ, signals of the wrong
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
    samples = np.size(imu.time)
    for what, values, shape in (
        ("gyr", imu.gyr, (samples, 3)), ("acc", imu.acc, (samples, 3)), ("mask", imu.mask, (samples,))
    ):  # fmt: skip
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


BLOCK, BUSIEST, RESTS, RARE = 100, 60, 0.2, 0.3
"""[samples] Length of a block. It is rest if its mean rate is below `RESTS` [1] times that of block number `BUSIEST`,
in the order of falling rates, or of the median block of a short recording; so a minute of handling at 100 Hz has no
effect. Rest is left out only if less than `RARE` [1] of a recording moves."""


def busy(imu: Imu) -> np.ndarray:
    """(T,) bool: the measured samples, without those of rest if these are most, as in a recording of hours."""
    mask = np.asarray(imu.mask, bool)
    size = np.linalg.norm(as_float(imu.gyr), axis=1)
    blocks = np.arange(len(size)) // BLOCK
    counts = np.bincount(blocks, mask)
    mean = np.bincount(blocks, np.where(mask, size, 0.0)) / np.maximum(counts, 1.0)
    known = np.sort(mean[counts > 0])[::-1]
    least = RESTS * known[min(BUSIEST, len(known) // 2)] if len(known) else 0.0
    moves = mask & (mean[blocks] >= least)
    return np.asarray(moves if moves.sum() < RARE * mask.sum() else mask)


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
