"""Checks of the sensors of a recording that all estimators use; the errors name sensor and cause."""

from collections.abc import Sequence

import numpy as np

from jgait.types import Imu, Recording, RecordingError, as_float

LEAST_S, FEWEST = 0.5, 10
"""[s], [1] Least duration and number of samples of a recording: no step is shorter."""

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
        RecordingError: a recording too short for a step, clocks that run backwards or differ, signals of the wrong
            shape, NaN, all samples masked, no accelerometer.
    """
    time = as_float(recording.sensors[names[0]].time)
    if time.size < FEWEST or np.ptp(time) < LEAST_S:
        lasts = float(np.ptp(time)) if time.size else 0.0
        raise RecordingError(
            f"{caller} needs a walk, {LEAST_S:g} s and {FEWEST} samples or more; '{names[0]}' has {time.size} samples "
            f"in {lasts:.2g} s"
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
    measured_hz = 1.0 / float(np.median(np.diff(time)))
    if abs(measured_hz / rate_hz - 1.0) > 0.05:
        raise RecordingError(
            f"'{name}' has a sample every {1.0 / measured_hz:.4g} s, and is said to have {rate_hz:g} Hz"
        )
