"""Clipped samples: a sensor at the limit of its range, and what it cut off its peaks. On the host, in NumPy.

Some sensors filter, average or calibrate their readings after clipping, so that the readings at the limit are almost,
not exactly, equal. A peak counts as cut off if it is flat at the limit although its flanks are steep.
"""

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jgait.signal.windows import true_runs
from jgait.types import AnyArray, as_float

LOWEST_RANGE = 4.0
"""[rad/s] No gyroscope for gait has a smaller range; 250 °/s are 4.4 rad/s."""

NEAR, AXES = 0.98, 0.9
"""[1] A flat peak lies above the first share of its axis's largest reading, and above the second of the sensor's."""

FLAT = 3
"""[samples] Lower limit on the length of a flat peak."""

CUT_OFF = 0.02
"""[1] Least part of the largest reading by which the flanks must overshoot a flat peak."""

PEAKS = 2
"""[1] Fewer flat peaks in a recording are chance."""

AGAIN = 3
"""[samples] Least number of equal largest readings of impacts that are cut off."""

FINE = 1e-3
"""[1] Largest step of a sensor over its largest reading with which separate impacts do not reach equal readings."""

STEEP = 0.1
"""[1] Least change beside such a reading, over it: a peak that is not cut off is round."""

IN_PLANE, PLANE = 6, 1e-4
"""[1] Least number of the largest readings in one plane, and their largest distance from it over the largest reading,
if the axes were turned after clipping; chosen, undamaged public recordings have fewer."""

HELD, AGAIN_MOST = 0.1, 4
"""[1], [samples] Share of samples that repeat the one before in all axes from which on a sensor is slower than its
signal, and readings that are written again are no limit; longer runs of equal readings do not count, as of a sensor at
rest. Undamaged gyroscopes repeat 4 %."""

MOST = 2.0
"""[1] Largest part of a specific force above its limit that is restored, over the limit; chosen."""

UNSURE = 0.5
"""[1] Standard deviation of a restored peak over what was restored; one error for all samples of a peak."""

UNSURE_FORCE, UNSURE_IMPACT = 0.7, 1.5
"""[1] The same of a specific force, and of its peaks of fewer than `FLAT` samples. Chosen on recorded feet
that were clipped by hand, and simulated ones. Peaks of one swing are alike, and so are their errors."""


def _first(values: Float[AnyArray, "time axis"]) -> Bool[np.ndarray, "time"]:
    """Samples but those that repeat the one before, if a sensor is slower than its signal, see `HELD`."""
    again = np.concatenate([[False], ~np.diff(as_float(values), axis=0).any(axis=1)])[: len(values)]
    for first, last in true_runs(again):
        again[first:last] = last - first < AGAIN_MOST
    return ~again if again.sum() > HELD * len(again) and np.shape(values)[1] > 1 else np.ones(len(again), bool)


def at_limit(values: Float[AnyArray, "time axis"], above: float, least: int = 2) -> Bool[np.ndarray, "time"]:
    """Samples in runs of `least` or more equal readings within 0.1 % of the largest of their axis, if `above` it."""
    every, new = as_float(values), _first(values)
    if not new.all():
        return at_limit(every[new], above, least)[np.cumsum(new) - 1]
    flags = np.zeros(len(values), bool)
    for axis in every.T:
        top = np.abs(axis).max(initial=0.0)
        if top > above:
            equal = (np.diff(axis) == 0.0) & (np.abs(axis[1:]) >= 0.999 * top)
            for first, last in true_runs(equal):
                if last - first + 1 >= least:
                    flags[first : last + 1] = True
    return flags


def forces_clipped(acc: Float[AnyArray, "time axis"], above: float, least: int = 2) -> Bool[np.ndarray, "time"]:
    """Samples of an accelerometer at its limit, in its own axes or in axes that were turned afterwards."""
    new = _first(acc)
    once = as_float(acc)[new]
    return (at_limit(once, above, least) | cut_short(once, above) | in_planes(once, above))[np.cumsum(new) - 1]


def in_planes(values: Float[AnyArray, "time axis"], above: float) -> Bool[np.ndarray, "time"]:
    """Samples at the limit of axes other than the signal's, where the limit is `above` a value.

    As many of the outermost readings as `IN_PLANE` lie in one plane there. Without fine steps they do so by chance, and
    none are found.
    """
    from scipy.spatial import ConvexHull, QhullError

    signal = as_float(values)
    flags = np.zeros(len(signal), bool)
    size = np.linalg.norm(signal, axis=1)
    outer = np.flatnonzero(size > above)
    steps = np.abs(np.diff(signal, axis=0))
    if len(outer) < IN_PLANE or not steps[steps > 0.0].min(initial=np.inf) < FINE * size.max():
        return flags
    try:
        planes = ConvexHull(signal[outer]).equations
    except QhullError:  # all in one plane: not the readings of a sensor with three axes
        return flags
    for *normal, offset in np.unique(planes[-planes[:, 3] > above], axis=0):
        inside = signal[outer] @ normal >= -offset - PLANE * size.max()
        if inside.sum() >= IN_PLANE:
            flags[outer[inside]] = True
    return flags


def cut_short(values: Float[AnyArray, "time axis"], above: float) -> Bool[np.ndarray, "time"]:
    """Samples of impacts that a sensor's range, if `above` a limit, cuts off for one or two samples.

    All axes have one range: `AGAIN` readings or more of exactly the same size, the largest of all, between which the
    signal changes steeply. Without fine steps separate peaks can be equal, and none are found.
    """
    signal = as_float(values)
    size = np.abs(signal)
    top = float(size.max(initial=0.0))
    steps = np.abs(np.diff(signal, axis=0))
    if top <= above or not steps[steps > 0.0].min(initial=top) < FINE * top:
        return np.zeros(len(signal), bool)
    edge = np.zeros((1, signal.shape[1]))
    steep = np.maximum(np.vstack([edge, steps]), np.vstack([steps, edge])) > STEEP * top
    clipped = (size >= top - 1e-9) & steep
    return np.asarray(clipped.any(axis=1) & (clipped.sum() >= AGAIN))


class Restored(NamedTuple):
    """A sensor's signal with restored peaks."""

    signal: Float[np.ndarray, "time axis"]  #: (T, 3) in the sensor's unit, peaks that were cut off restored.
    #: (T,) standard deviation of the restored samples, else 0. As white noise it has the deviation of the integral over
    #: a peak, whose samples share one error.
    doubt: Float[np.ndarray, "time"]
    clipped: Bool[np.ndarray, "time"]  #: (T,) bool, restored samples.


def restored(gyr: Float[AnyArray, "time axis"]) -> Restored:
    """Restore the peaks of an angular rate (T, 3) [rad/s] that the gyroscope's range cut off.

    A cubic through the two readings before and the two after a flat peak takes its place, where it is higher. A
    recording with fewer than `PEAKS` of them is returned as it is.
    """
    rate = as_float(gyr)
    largest = np.abs(rate).max(initial=0.0)
    peaks = [
        (axis, sign, *peak) for axis in range(rate.shape[1]) for sign in (1.0, -1.0)
        for peak in _cut_off(sign * rate[:, axis], max(LOWEST_RANGE, AXES * largest))
    ]  # fmt: skip
    return _with(rate, peaks if len(peaks) >= PEAKS else [], UNSURE, UNSURE)


def restored_forces(acc: Float[AnyArray, "time axis"], clipped: Bool[AnyArray, "time"]) -> Restored:
    """Restore the peaks of a specific force (T, 3) [m/s²] where samples are `clipped`, see `forces_clipped`.

    Lost samples that are interpolated between two at the limit belong to a peak if they count as clipped. A parabola
    continues the mean slope of both flanks of a peak. Readings whose axes were turned after clipping are not
    flat, and stay as they are.
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
                peaks.append((axis, sign, first, np.minimum(missing, MOST * values[first])))
    return _with(force, peaks, UNSURE_FORCE, UNSURE_IMPACT)


def _with(
    signal: np.ndarray, peaks: list[tuple[int, float, int, np.ndarray]], unsure: float, unsure_short: float
) -> Restored:
    """The signal with what is missing of peaks: their axes, signs, first samples, and what is missing of each."""
    whole, doubt = signal.copy() if peaks else signal, np.zeros(len(signal))
    for axis, sign, first, missing in peaks:
        here = slice(first, first + len(missing))
        whole[here, axis] += sign * missing
        share = unsure if len(missing) >= FLAT else unsure_short
        deviation = share * np.sqrt(np.mean(missing**2) * len(missing))
        doubt[here] = np.maximum(doubt[here], deviation)
    return Restored(whole, doubt, doubt > 0.0)


def _cut_off(values: np.ndarray, least: float) -> list[tuple[int, np.ndarray]]:
    """The first sample of each flat peak, and what is missing of its samples."""
    top = float(values.max(initial=0.0))
    runs = []
    for first, last in true_runs(values >= NEAR * top) if top > least else []:
        if last - first < FLAT or first < 2 or last + 2 > len(values):
            continue
        flanks = np.array([first - 2, first - 1, last, last + 1])
        inside = np.arange(first, last)
        cubic = np.polynomial.Polynomial.fit(flanks, values[flanks], 3)(inside)
        if cubic.max() - values[inside].max() > CUT_OFF * top:
            runs.append((first, np.clip(cubic - values[inside], 0.0, top)))
    return runs
