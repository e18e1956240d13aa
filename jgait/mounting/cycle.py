"""How sensors on legs turn over a stride: harmonics of their rates, and the mean inclination in walking; on the host.

Rates are read in whole strides, so that neither a gyroscope's bias nor a rest is needed: over a stride a leg returns to
where it was, and the mean of its specific force, turned along with the segment, is gravity.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jgait.signal.windows import true_runs
from jgait.types import Imu, as_float

HARMONICS = 4
"""[1] Number of harmonics of the stride frequency: they hold 97 % of the power of a thigh and a shank."""

WALKING_RATE = 0.4
"""[rad/s] Root mean square of the legs' rates above which a person walks: below simulated walks of 0.25 m/s."""

USUAL_STRIDE_TIME = 1.1
"""[s] Stride time that is assumed if the search finds none: that of usual walking."""

SEGMENTS = ("thigh", "shank", "foot")
"""Segments of a leg."""

POWER = {"thigh": 0.4, "shank": 1.6, "foot": 2.4}
"""[1] Power of the sagittal harmonics of each segment over the mean of thigh and shank, by which walks of any speed and
with any of these sensors have one scale. From simulated people, as `places.json`."""


class Turning(NamedTuple):
    """How one sensor turns in walking, in its own axes, the sign of its axis unknown."""

    up: np.ndarray | None  #: (3,) direction of the mean specific force in walking [1]; None without an accelerometer.
    axis: np.ndarray  #: (3,) axis of most rotation [1].
    bias: np.ndarray  #: (3,) mean rate over whole strides [rad/s], without its part about the vertical.
    #: (2, HARMONICS) complex harmonics of the rate about `axis`, and of that about up × axis (NaN without `up`), over
    #: the root of the power of all sensors over that of `POWER`.
    waves: np.ndarray


class Cycle(NamedTuple):
    """The sensors of a walking person over a stride."""

    stride_time: float  #: [s].
    turning: dict[str, Turning]  #: placement → how its sensor turns.
    windows: list[slice]  #: samples of two strides each.
    walks: np.ndarray  #: (T,) bool, samples of walking.


def smooth(values: np.ndarray, seconds: float, sampling_rate_hz: float) -> np.ndarray:
    """(T,) moving average with a triangular kernel; the first and the last value are repeated beyond the ends."""
    width = max(1, round(seconds * sampling_rate_hz / 2))
    kernel = np.convolve(np.ones(width), np.ones(width)) / width**2
    padded = np.pad(values, (kernel.size // 2, kernel.size - 1 - kernel.size // 2), mode="edge")
    return np.convolve(padded, kernel, mode="valid")


def stride_time(
    rates: Sequence[np.ndarray], sampling_rate_hz: float, masks: Sequence[np.ndarray] | None = None
) -> float:
    """Stride time [s] from sagittal rates of legs, (T,) each [rad/s]: the first maximum of the sum of their
    autocorrelations from 0.6 to 4 s of at least 0.7 of the highest; `USUAL_STRIDE_TIME` if there is none. `masks` tell
    the samples (T,) of each that were measured: all by default.
    """
    first, last = round(0.6 * sampling_rate_hz), round(4.0 * sampling_rate_hz)
    size = len(rates[0])
    lags = slice(first, min(last, size))
    again = np.zeros(max(0, lags.stop - lags.start))
    for rate, mask in zip(rates, masks or [np.ones(size, bool)] * len(rates), strict=True):
        together, pairs = (
            np.fft.irfft(np.abs(np.fft.rfft(values, 2 * size)) ** 2, 2 * size)
            for values in (np.where(mask, rate - rate[mask].mean() if mask.any() else 0.0, 0.0), mask.astype(float))
        )
        whole = size - np.arange(size)[lags]
        share = pairs[lags] / whole
        alike = np.where(share > 0.1, together[lags] / np.maximum(share, 0.1), 0.0)  # of few pairs a lag is not judged
        again += alike / max(float(together[0]) / max(mask.mean(), 1e-9), 1e-12)
    if again.size < 3:
        return USUAL_STRIDE_TIME
    top = np.flatnonzero((again[1:-1] > again[:-2]) & (again[1:-1] >= again[2:])) + 1
    top = top[again[top] > 0.7 * max(again[top], default=0.0)]
    return float(first + top[0]) / sampling_rate_hz if top.size else USUAL_STRIDE_TIME


def sagittal_axis(gyr: np.ndarray, up: np.ndarray | None, walks: np.ndarray, sampling_rate_hz: float) -> np.ndarray:
    """The axis (3,) about which a segment turns in straight walking, in sensor axes, up to its sign: the first
    principal axis of the angular rate (T, 3) [rad/s] in walking (T,) that is no turn, without its part along `up`.
    """
    if up is not None:
        straight = walks & (np.abs(smooth(gyr @ up, 1.0, sampling_rate_hz)) <= 0.6)  # [rad/s] turns hide the axis
        walks = straight if np.count_nonzero(straight) > sampling_rate_hz else walks
    samples = gyr[walks] - gyr[walks].mean(axis=0)
    axis = np.linalg.eigh(samples.T @ samples)[1][:, -1]
    if up is not None:
        axis = axis - (axis @ up) * up
    return np.asarray(axis / np.linalg.norm(axis))


def walking(sensors: Mapping[str, Imu], sampling_rate_hz: float) -> np.ndarray:
    """(T,) bool, samples in which the sensors, all at the same times, turn as much as in most of the walk."""
    masks = [np.asarray(imu.mask, bool) for imu in sensors.values()]
    rates = zip(sensors.values(), masks, strict=True)
    powers = [np.where(mask, np.sum(as_float(imu.gyr) ** 2, axis=1), 0.0) for imu, mask in rates]
    power, weight = (smooth(np.sum(parts, axis=0, dtype=float), 1.0, sampling_rate_hz) for parts in (powers, masks))
    level = power / np.maximum(weight, 1e-9)
    return np.asarray(level > max(0.15 * np.percentile(level, 90.0), WALKING_RATE**2)) & (weight > 1e-9)


def cycle_of(sensors: Mapping[str, Imu]) -> Cycle | None:
    """The sensors on thighs, shanks and feet, all at the same times, over a stride; None if no stride is whole."""
    legs = [name for name in sensors if name.partition("_")[0] in SEGMENTS[:2]]
    if not legs:
        return None
    time = as_float(sensors[legs[0]].time)
    if time.size < 3:
        return None
    hz = 1.0 / float(np.median(np.diff(time)))
    walks = walking({name: sensors[name] for name in legs}, hz)
    axes_of: dict[str, tuple[np.ndarray | None, np.ndarray]] = {}
    rates: dict[str, np.ndarray] = {}
    for name, imu in sensors.items():
        gyr, kept = as_float(imu.gyr), np.asarray(imu.mask, bool) & walks
        if name.partition("_")[0] not in SEGMENTS or kept.sum() < hz:
            continue
        up = None
        if imu.acc is not None:
            mean = as_float(imu.acc)[kept].mean(axis=0)
            up = mean / max(float(np.linalg.norm(mean)), 1e-9)
        axis = sagittal_axis(gyr, up, kept, hz)
        axes_of[name] = up, axis
        rolls = np.zeros(3) if up is None else np.cross(up, axis)
        rates[name] = np.column_stack([gyr @ axis, gyr @ rolls, gyr])
    if not any(name in axes_of for name in legs):
        return None
    legs = [name for name in legs if name in axes_of]
    last = stride_time(
        [np.where(walks, rates[n][:, 0], 0.0) for n in legs], hz, [np.asarray(sensors[n].mask, bool) for n in legs]
    )
    long, step = round(2.0 * last * hz), max(1, round(last * hz))
    windows = [
        slice(at, at + long) for at in range(0, time.size - long + 1, step) if walks[at : at + long].mean() > 0.9
    ]
    if not windows and walks.any():  # a walk of a stride or two
        windows = [slice(*max(true_runs(walks), key=lambda run: run[1] - run[0]))]
    if not windows:
        return None
    windows = _repeating([(rates[n][:, 0], np.asarray(sensors[n].mask, bool)) for n in legs], windows, last, hz)
    waves = {name: _harmonics(rate, np.asarray(sensors[name].mask, bool), windows, last, hz)
             for name, rate in rates.items()}  # fmt: skip
    strongest = max(legs, key=lambda name: float(np.nansum(np.abs(waves[name][:, 1:, 0]) ** 2)))
    turned = np.exp(-1j * np.angle(waves[strongest][:, 1, 0])[:, None] * np.arange(HARMONICS + 1))
    middle: dict[str, np.ndarray] = {}
    for name, each in waves.items():
        every = each * turned[:, :, None]
        known = np.isfinite(every[:, 0, 0].real)
        if known.any():
            middle[name] = np.median(every[known].real, axis=0) + 1j * np.median(every[known].imag, axis=0)
    power = sum(float(np.sum(np.abs(wave[1:, 0]) ** 2)) for wave in middle.values())
    if not power > 0.0:
        return None
    size = np.sqrt(power / sum(POWER[name.partition("_")[0]] for name in middle))
    turning = {}
    for name, wave in middle.items():
        up, axis = axes_of[name]
        bias = wave[0, 2:].real
        turning[name] = Turning(
            up, axis, bias if up is None else bias - (bias @ up) * up,
            np.stack([wave[1:, 0], np.full(HARMONICS, np.nan) if up is None else wave[1:, 1]]) / size,
        )  # fmt: skip
    return Cycle(last, turning, windows, walks)


def _design(samples: int, last: float, hz: float) -> np.ndarray:
    """(samples, 1 + 2 HARMONICS) a constant, cosines and sines of the stride's harmonics."""
    phases = 2.0 * np.pi / last * np.outer(np.arange(samples) / hz, np.arange(1, HARMONICS + 1))
    return np.column_stack([np.ones(samples), np.cos(phases), np.sin(phases)])


def _fit(rows: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(1 + 2 HARMONICS, …) constant and harmonics of values at rows of the design; zero where no sample shows them."""
    return np.asarray(np.linalg.solve(rows.T @ rows + 0.01 * len(rows) * np.eye(rows.shape[1]), rows.T @ values))


def _repeating(legs: list[tuple[np.ndarray, np.ndarray]], windows: list[slice], last: float, hz: float) -> list[slice]:
    """The windows in which the harmonics hold half of the power of the legs' rates (T,), each with its mask: less where
    the stride time is another, as in a slower part; all if there is none.
    """
    design = _design(windows[0].stop - windows[0].start, last, hz)
    held = []
    for window in windows:
        left = power = 0.0
        for rate, mask in legs:
            rows, values = design[mask[window]], rate[window][mask[window]]
            if len(values) > 2 * design.shape[1]:
                left += float(np.sum((values - rows @ _fit(rows, values)) ** 2))
                power += float(np.sum((values - values.mean()) ** 2))
        held.append(left <= 0.5 * power)
    return [window for window, whole in zip(windows, held, strict=True) if whole] or windows


def _harmonics(rate: np.ndarray, mask: np.ndarray, windows: list[slice], last: float, hz: float) -> np.ndarray:
    """(windows, 1 + HARMONICS, n) mean and harmonics of rates (T, n); NaN where too few are measured."""
    design = _design(windows[0].stop - windows[0].start, last, hz)
    every = np.full((len(windows), HARMONICS + 1, rate.shape[1]), np.nan + 0j)
    for number, window in enumerate(windows):
        kept = mask[window]
        if kept.mean() < 0.4:
            continue
        fit = _fit(design[kept], rate[window][kept])
        every[number, 0] = fit[0]
        every[number, 1:] = fit[1 : HARMONICS + 1] - 1j * fit[HARMONICS + 1 :]
    return every


def mean_force(imu: Imu, rows: np.ndarray, cycle: Cycle) -> complex | None:
    """Gravity over whole strides in the axes of a segment at its mean inclination [m/s²]: the part along the up axis of
    `rows` (3, 3), and as imaginary part that along the forward axis. None if no stride is measured as a whole. Its
    angle is the segment's mean inclination [rad], positive with the distal end forward.
    """
    if imu.acc is None:
        return None
    step, mask = float(np.median(np.diff(as_float(imu.time)))), np.asarray(imu.mask, bool)
    rate, force = -(as_float(imu.gyr) @ rows[1]), as_float(imu.acc) @ (rows[2] + 1j * rows[0])
    means = []
    for window in cycle.windows:
        if mask[window].all():
            angle = np.cumsum(rate[window] - rate[window].mean()) * step
            means.append(np.mean(force[window] * np.exp(-1j * (angle - angle.mean()))))
    return complex(np.median(np.real(means)), np.median(np.imag(means))) if means else None
