"""Orientation of the sensors on a thigh and a shank, from standing and walking; NumPy, on the host.

A leg in straight walking turns about one axis, the sagittal axis of each segment; gravity gives the vertical. The axes
are forward, left and up, as of a standing segment; the forward swing is a negative rate about the axis to the left.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.notes import WRONG_PLACE, Kind
from jgait.types import Imu, RecordingError, as_float

WALKING_RATE = 0.6
"""[rad/s] Smallest root mean square rate of a shank in walking."""

TURNING_RATE = 0.6
"""[rad/s] Threshold on the low-passed rate about the vertical; above it the person turns, and the sagittal axis is
hidden."""

SWAPPED = 1.25
"""[1] Ratio of the thigh's to the shank's turning rate above which the two sensors are exchanged."""

THIGH_LEAD = 0.145
"""[1] Share of a stride by which the forward swing of the thigh precedes that of the shank: with it, the correlation of
the rates is .3 to .9 on all 36 legs of `walking5m`, and .4 to .7 in simulated walks of 0.2 to 1.7 m/s. With a lead in
seconds the sign is wrong in slow walks."""

LEAST_CORRELATION = 0.15
"""[1] Correlation of both rates below which the forward direction of the thigh is uncertain."""

STRIDE_TIMES, USUAL_STRIDE_TIME = (0.6, 4.0), 1.1
"""[s] Limits of the stride time in the search, and the stride time that is assumed if the search finds none."""

SIDES_EXCHANGED = Kind(
    "sides_exchanged", "check", "the right and left {kind} sensors seem exchanged: they swing half a stride before or "
    "after {others}", WRONG_PLACE,
)  # fmt: skip


class LegMounting(NamedTuple):
    """Orientation of the sensors of one leg."""

    #: segment ("thigh", "shank") → placement whose sensor is on it; exchanged if the sensors are swapped.
    placements: dict[str, str]
    #: segment → (3, 3) forward, left and up in the sensor's axes [1]; `gyr @ rows.T` is in the segment's axes.
    rows: dict[str, np.ndarray]
    gyr_bias: dict[str, np.ndarray]  #: segment → (3,) mean rate at standing, in the sensor's axes [rad/s].
    swapped: bool  #: whether the thigh's sensor turns faster than the shank's by `SWAPPED`.
    sure: bool  #: whether it is certain which way is forward for the thigh, see `LEAST_CORRELATION`.


class _Turning(NamedTuple):
    bias: np.ndarray
    up: np.ndarray | None
    axis: np.ndarray
    swing: np.ndarray


def smooth(values: np.ndarray, seconds: float, sampling_rate_hz: float) -> np.ndarray:
    """(T,) moving average with a triangular kernel; the first and the last value are repeated beyond the ends."""
    width = max(1, round(seconds * sampling_rate_hz / 2))
    kernel = np.convolve(np.ones(width), np.ones(width)) / width**2
    padded = np.pad(values, (kernel.size // 2, kernel.size - 1 - kernel.size // 2), mode="edge")
    return np.convolve(padded, kernel, mode="valid")


def stride_time(rate: np.ndarray, sampling_rate_hz: float) -> float:
    """Stride time [s] from the sagittal rate of a shank (T,) [rad/s]: the first lag at which the rate repeats.

    That is the first maximum of its autocorrelation within `STRIDE_TIMES` of at least 0.7 of the highest;
    `USUAL_STRIDE_TIME` if there is none.
    """
    free = rate - rate.mean()
    first, last = (round(limit * sampling_rate_hz) for limit in STRIDE_TIMES)
    spectrum = np.abs(np.fft.rfft(free, 2 * free.size)) ** 2
    again = np.fft.irfft(spectrum, 2 * free.size)[first : min(last, free.size)]
    if again.size < 3:
        return USUAL_STRIDE_TIME
    top = np.flatnonzero((again[1:-1] > again[:-2]) & (again[1:-1] >= again[2:])) + 1
    top = top[again[top] > 0.7 * max(again[top], default=0.0)]
    return float(first + top[0]) / sampling_rate_hz if top.size else USUAL_STRIDE_TIME


def _correlation(values: np.ndarray, later: np.ndarray, lag: int) -> float:
    """Correlation about zero of values (T,) with others (T,) that come `lag` samples later."""
    a, b = values[: values.size - lag], later[lag:]
    return float(np.sum(a * b)) / max(float(np.sum(a**2) * np.sum(b**2)), 1e-12) ** 0.5


def sagittal_axis(
    gyr: np.ndarray, up: np.ndarray | None, still: np.ndarray, sampling_rate_hz: float, *, perpendicular: bool
) -> np.ndarray:
    """The axis (3,) about which a segment turns in straight walking, in sensor axes, up to its sign.

    The axis is the first principal axis of the angular rate (T, 3) without bias [rad/s] over the walking samples that
    are not part of a turn; with `perpendicular`, its part along `up` at standing is removed.
    """
    walking = ~still
    if up is not None:
        turning = np.abs(smooth(gyr @ up, 1.0, sampling_rate_hz)) > TURNING_RATE
        if np.count_nonzero(walking & ~turning) > sampling_rate_hz:
            walking = walking & ~turning
    samples = gyr[walking]
    _, vectors = np.linalg.eigh(samples.T @ samples)
    axis = vectors[:, -1]
    if perpendicular and up is not None:
        axis = axis - (axis @ up) * up
    return np.asarray(axis / np.linalg.norm(axis))


def segment_axes(right: np.ndarray, up: np.ndarray | None) -> np.ndarray:
    """(3, 3) rows forward, left, up in sensor axes, from the sagittal axis to the right and the vertical."""
    if up is None:
        up = np.eye(3)[np.argmin(np.abs(right))]
    forward = np.cross(up, right)
    forward = forward / np.linalg.norm(forward)
    return np.stack([forward, -right, np.cross(right, forward)])


def measured(imu: Imu, standing: slice) -> np.ndarray:
    """The samples of a standing that were measured; all samples if none was."""
    samples = np.arange(len(imu.mask))[standing]
    there = samples[np.asarray(imu.mask, bool)[samples]]
    return there if there.size else samples


def _turning(imu: Imu, standing: slice, still: np.ndarray, rate_hz: float, *, perpendicular: bool) -> _Turning:
    gyr, rests = as_float(imu.gyr), measured(imu, standing)
    bias = gyr[rests].mean(axis=0)
    up = None
    if imu.acc is not None:
        mean = as_float(imu.acc)[rests].mean(axis=0)
        up = mean / np.linalg.norm(mean)
    free = gyr - bias
    axis = sagittal_axis(free, up, still, rate_hz, perpendicular=perpendicular)
    return _Turning(bias, up, axis, smooth(free @ axis, 0.1, rate_hz))


def leg_mounting(
    sensors: Mapping[str, Imu],
    side: str,
    standing: slice,
    still: np.ndarray,
    sampling_rate_hz: float,
    *,
    perpendicular: bool = True,
    estimator: str,
) -> LegMounting:
    """The axes of thigh and shank in the axes of their sensors; swapped sensors are exchanged.

    The forward swing of a shank is faster than its backward rotation, which gives the sign of its sagittal axis; the
    thigh swings forward `THIGH_LEAD` of a stride before the shank, which gives the sign for the thigh: the correlation
    at the lead of this stride time or of a usual one, the stronger of the two.

    Args:
        sensors: with `thigh_SIDE` and `shank_SIDE`.
        side: "right" or "left".
        standing: samples of quiet standing.
        still: (T,) bool, where the person stands.
        sampling_rate_hz: sampling rate [Hz].
        perpendicular: make the sagittal axes perpendicular to gravity.
        estimator: its name, for the error.

    Raises:
        RecordingError: if the shank never moves as in walking.
    """
    placements = {segment: f"{segment}_{side}" for segment in ("thigh", "shank")}
    turning = {
        segment: _turning(sensors[name], standing, still, sampling_rate_hz, perpendicular=perpendicular)
        for segment, name in placements.items()
    }
    moving = {
        segment: float(np.sqrt(np.mean(each.swing[~still] ** 2))) if (~still).any() else 0.0
        for segment, each in turning.items()
    }
    if max(moving.values()) < WALKING_RATE:
        raise RecordingError(
            f"{estimator} found no walking: the {side} shank turns at {moving['shank']:.2f} rad/s RMS outside standing "
            f"(a walking shank exceeds {WALKING_RATE:g}); is the gyroscope in rad/s, or the walk very slow?"
        )
    swapped = moving["thigh"] > SWAPPED * moving["shank"]
    if swapped:
        placements = {"thigh": placements["shank"], "shank": placements["thigh"]}
        turning = {"thigh": turning["shank"], "shank": turning["thigh"]}
    shank, thigh = turning["shank"], turning["thigh"]
    sign = float(np.sign(np.sum(shank.swing**3)) or 1.0)
    # a gyroscope that sleeps half of the time shows every second or third stride alone: then the usual time fits better
    times = (USUAL_STRIDE_TIME, stride_time(shank.swing, sampling_rate_hz))
    leads = [round(THIGH_LEAD * time * sampling_rate_hz) for time in times]
    together = sign * max((_correlation(thigh.swing, shank.swing, lead) for lead in leads), key=abs)
    signs = {"shank": sign, "thigh": float(np.sign(together) or 1.0)}
    rows = {segment: segment_axes(signs[segment] * each.axis, each.up) for segment, each in turning.items()}
    bias = {segment: each.bias for segment, each in turning.items()}
    return LegMounting(placements, rows, bias, swapped, abs(together) >= LEAST_CORRELATION)
