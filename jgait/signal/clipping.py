"""Samples that a sensor clips at the limit of its range, and the peaks that it cuts off. On the host, in NumPy.

Some sensors filter, average or calibrate their readings after clipping, so that the readings at the limit are almost,
not exactly, equal. A peak counts as cut off if it is flat at the limit although its flanks are steep.
"""

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jgait.signal.windows import true_runs
from jgait.types import AnyArray, as_float

FLAT = 3
"""[samples] Lower limit on the length of a flat peak; chosen."""


def _first(values: Float[AnyArray, "time axis"]) -> Bool[np.ndarray, "time"]:
    """(T,) bool, False where a sensor that is slower than its signal repeats the sample before, in all axes.

    Such a sensor repeats a tenth of its samples or more, undamaged gyroscopes 4 %. Four equal samples in a row do not
    count: the sensor rests.
    """
    again = np.concatenate([[False], ~np.diff(as_float(values), axis=0).any(axis=1)])[: len(values)]
    for first, last in true_runs(again):
        again[first:last] = last - first < 4
    return ~again if again.sum() > 0.1 * len(again) and np.shape(values)[1] > 1 else np.ones(len(again), bool)


def at_limit(values: Float[AnyArray, "time axis"], above: float, least: int = 2) -> Bool[np.ndarray, "time"]:
    """(T,) bool, runs of `least` equal readings within 0.1 % of their axis's largest, if that is `above` a limit.

    In an axis of coarse resolution peaks that are not cut off are flat, too: none of its samples is returned if that
    explains all runs.
    """
    every, new = as_float(values), _first(values)
    if not new.all():
        return at_limit(every[new], above, least)[np.cumsum(new) - 1]
    flags = np.zeros(len(values), bool)
    for axis in every.T:
        top = np.abs(axis).max(initial=0.0)
        if top > above:
            equal = (np.diff(axis) == 0.0) & (np.abs(axis[1:]) >= 0.999 * top)
            runs = [(first, last + 1) for first, last in true_runs(equal) if last - first + 1 >= least]
            if runs and _by_rounding(axis, runs) < 0.01:
                for first, after in runs:
                    flags[first:after] = True
    return flags


def _by_rounding(axis: Float[np.ndarray, "time"], runs: list[tuple[int, int]]) -> float:
    """Chance [1] that the readings of each run, from its first to before its last index, are equal by rounding alone.

    Two readings of a steep signal are equal with a chance of one step of the resolution over the change beside them. A
    parabola that stays within one step over n readings falls by less than ((n + 1) / (n - 1))² steps beside them.
    """
    step, chance = float(np.diff(np.unique(axis)).min(initial=np.inf)), 1.0
    for first, after in runs:
        size = after - first
        beside = axis[[row for row in (first - 1, after) if 0 <= row < len(axis)]]
        falls = float(np.abs(axis[first] - beside).min(initial=np.inf))
        chance *= min(((size + 1) / (size - 1)) ** 2 * step / falls, 1.0) ** (size - 1)
    return chance


def forces_clipped(acc: Float[AnyArray, "time axis"], above: float, least: int = 2) -> Bool[np.ndarray, "time"]:
    """Samples of an accelerometer at its limit."""
    new = _first(acc)
    once = as_float(acc)[new]
    return (at_limit(once, above, least) | cut_short(once, above))[np.cumsum(new) - 1]


def cut_short(values: Float[AnyArray, "time axis"], above: float) -> Bool[np.ndarray, "time"]:
    """Samples of impacts that a sensor cuts off, `above` a limit, for one or two samples.

    At least three readings then have exactly the largest size of all axes, and the signal changes beside them by a
    tenth of it: a peak that is not cut off is round. In a signal whose resolution is coarser than a thousandth of it,
    separate peaks can be equal: none of its samples is returned.
    """
    signal = as_float(values)
    size = np.abs(signal)
    top = float(size.max(initial=0.0))
    steps = np.abs(np.diff(signal, axis=0))
    if top <= above or not steps[steps > 0.0].min(initial=top) < 1e-3 * top:
        return np.zeros(len(signal), bool)
    edge = np.zeros((1, signal.shape[1]))
    steep = np.maximum(np.vstack([edge, steps]), np.vstack([steps, edge])) > 0.1 * top
    clipped = (size >= top - 1e-9) & steep
    return np.asarray(clipped.any(axis=1) & (clipped.sum() >= 3))


class Restored(NamedTuple):
    """A sensor's signal with restored peaks."""

    signal: Float[np.ndarray, "time axis"]  #: (T, 3) in the sensor's unit, peaks that were cut off restored.
    #: (T,) standard deviation of the restored samples, else 0. As white noise it has the deviation of the integral over
    #: a peak, whose samples share one error.
    doubt: Float[np.ndarray, "time"]
    clipped: Bool[np.ndarray, "time"]  #: (T,) bool, restored samples.


def restored(gyr: Float[AnyArray, "time axis"]) -> Restored:
    """Restore the peaks of an angular rate (T, 3) [rad/s] that the gyroscope's range cut off.

    A cubic through the two readings before and the two after a flat peak replaces the peak where the cubic is higher. A
    recording with fewer than two flat peaks is returned unchanged: one occurs by chance. A flat peak has nine tenths of
    the sensor's largest reading, and 4 rad/s: the smallest range of a gyroscope for gait is 250 °/s, 4.4 rad/s.
    """
    rate = as_float(gyr)
    largest = np.abs(rate).max(initial=0.0)
    peaks = [
        (axis, sign, *peak) for axis in range(rate.shape[1]) for sign in (1.0, -1.0)
        for peak in _cut_off(sign * rate[:, axis], max(4.0, 0.9 * largest))
    ]  # fmt: skip
    return _with(rate, peaks if len(peaks) > 1 else [], 0.5, 0.5)


def restored_forces(acc: Float[AnyArray, "time axis"], clipped: Bool[AnyArray, "time"]) -> Restored:
    """Restore the peaks of a specific force (T, 3) [m/s²] where samples are `clipped`, see `forces_clipped`.

    A parabola continues the mean slope of both flanks of a peak, up to three times the limit (chosen). Interpolated
    samples between two clipped ones belong to the peak if `clipped` contains them. Deviations are chosen on recorded
    and simulated feet that were clipped afterwards.
    """
    force = as_float(acc)
    peaks = []
    for axis, sign in itertools.product(range(force.shape[1]), (1.0, -1.0)):
        values = sign * force[:, axis]
        at = np.asarray(clipped, bool) & (values >= 0.999 * np.abs(values).max(initial=0.0))
        for first, last in true_runs(at):
            if first >= 2 and last + 2 <= len(values):
                before, after = values[first - 2 : first + 1], values[last + 1 : last - 2 : -1]
                slope = 0.5 * (np.diff(before).max() + np.diff(after).max())
                along = (np.arange(last - first) + 0.5) / (last - first)
                missing = slope * (last - first) * along * (1.0 - along)
                peaks.append((axis, sign, first, np.minimum(missing, 2.0 * values[first])))
    return _with(force, peaks, 0.7, 1.5)


def _with(
    signal: np.ndarray, peaks: list[tuple[int, float, int, np.ndarray]], unsure: float, unsure_short: float
) -> Restored:
    """The signal with the missing parts of its peaks; a peak has an axis, a sign, a first sample and a missing part.

    `unsure` is the standard deviation of a missing part over that part, `unsure_short` that in peaks of fewer than
    `FLAT` samples [1]; all samples of a peak share the error.
    """
    whole, doubt = signal.copy() if peaks else signal, np.zeros(len(signal))
    for axis, sign, first, missing in peaks:
        here = slice(first, first + len(missing))
        whole[here, axis] += sign * missing
        share = unsure if len(missing) >= FLAT else unsure_short
        deviation = share * np.sqrt(np.mean(missing**2) * len(missing))
        doubt[here] = np.maximum(doubt[here], deviation)
    return Restored(whole, doubt, doubt > 0.0)


def _cut_off(values: np.ndarray, least: float) -> list[tuple[int, np.ndarray]]:
    """The first sample of each flat peak, within 2 % of the largest value, and the missing part at each of its samples;
    the flanks must overshoot it by 2 %.
    """
    top = float(values.max(initial=0.0))
    runs = []
    for first, last in true_runs(values >= 0.98 * top) if top > least else []:
        if last - first < FLAT or first < 2 or last + 2 > len(values):
            continue
        flanks = np.array([first - 2, first - 1, last, last + 1])
        inside = np.arange(first, last)
        cubic = np.polynomial.Polynomial.fit(flanks, values[flanks], 3)(inside)
        if cubic.max() - values[inside].max() > 0.02 * top:
            runs.append((first, np.clip(cubic - values[inside], 0.0, top)))
    return runs
