"""Rows that are missing or written twice although time goes on.

Where a row is missing, all sensors turn by what they turn in two steps; where it is written twice, none changes while
it turns.
"""

from collections.abc import Mapping

import numpy as np

from jgait.notes import Kind, Note
from jgait.signal.windows import true_runs
from jgait.types import Imu

FEWEST_SENSORS = 4
"""[1] Least number of sensors for a single jump: a landing makes one or two jump, never all."""

SURE_JUMP = 0.8
"""[1] Least mean over the sensors of the logarithm of a change of the angular rate over the largest change within
`AROUND`. Undamaged public recordings of four sensors and more reach 0.30, five of 420 simulated ones 0.4."""

AROUND = 3
"""[samples] Distance up to which changes are compared."""

STRAIGHT = {True: 0.8, False: 0.95}
"""[1] Least cosine between a change of the angular rate and the one expected from its neighbours, with three sensors or
more and with fewer, for the step to count."""

SLOWEST = 0.3
"""[1] Share of the steps of a sensor, those with the smallest changes, that do not count."""

TWO_STEPS, LONGER = np.log([1.6, 2.6]), np.log([1.2, 1.6])
"""[1] Logarithm of a change over the expected one if one row is missing, and if the change is only somewhat longer."""

AGREE = 0.25
"""[1] Least share of double steps of a sensor over that of another: else readings of one are missing, not rows, as
where tables of two rates were merged. Chosen."""

LEAST_SHARE, FEWEST = 0.02, 10
"""[1] Least share and number of steps over which rows are missing."""

FAST_HZ = {True: 80.0, False: 160.0}
"""[Hz] Rate from which on neighbours tell the change well, with three sensors or more and with fewer; below half of it,
a landing is as short as a sample."""

LEAST_RATIO = {True: 0.45, False: 0.85}
"""[1] Least number of double steps over that of the somewhat longer ones, at `FAST_HZ` or more and below. The changes
of undamaged recordings have one peak, and reach 0.38 and 0.82."""

TWICE_SHARE, ONE_STEP = 0.008, 1.45
"""[1] Least share of rows written twice, while the sensors turn; and largest change after them over the expected one.
In undamaged recordings, 0.003 of the rows equal the one before, mostly at the limit of a range. A sensor that holds
its last reading where one is lost changes by two steps afterwards: there, time is right."""

RESOLVED = 10.0
"""[1] Least expected change, in steps of the sensor's resolution, for a row to count."""

LONGEST_S = 600.0
"""[s] Part of a recording in which double steps are counted."""

LONG_GAP = 3
"""[samples] Shortest gap around which jumps do not count; shorter ones are bridged."""

MOST_LOST = 0.3
"""[1] Largest share of lost samples of a sensor: lines over them are too many straight steps."""

SMALLEST = 1e-3
"""[rad/s] Added to the changes, so that sensors at rest do not count."""

ROWS_LOST = Kind(
    "rows_lost",
    "check",
    "all sensors jump at {places} {places:place|places}, first at {begin_s:.2f} s: rows are missing there although "
    "time goes on, or "
    "the recording was joined from parts",
    "Where rows are missing without time stamps, movements come out too fast and too small; lengths and angles after "
    "the place are wrong.",
)
ROWS_TWICE = Kind(
    "rows_twice",
    "check",
    "{rows} rows repeat the one before in all sensors while they turn, first at {begin_s:.2f} s: rows are written "
    "twice although time goes on",
    "Where rows are written twice without time stamps, movements come out too slow and too large; lengths and angles "
    "are wrong. A file without the repeated rows mends this.",
)


def _shifted(values: np.ndarray, by: int) -> np.ndarray:
    """Values moved by some samples; the ends are repeated."""
    return values[np.clip(np.arange(len(values)) - by, 0, len(values) - 1)]


def splice_notes(sensors: Mapping[str, Imu], rate_hz: float) -> tuple[Note, ...]:
    """A note if all sensors jump at the same time, more than around it, or often turn by two steps in one."""
    masks = [np.asarray(imu.mask) for imu in sensors.values()]
    there = all(mask.any() and mask.mean() > 1.0 - MOST_LOST for mask in masks)
    if len({len(mask) for mask in masks}) != 1 or len(masks[0]) < 10 * AROUND or not there:
        return ()
    gaps, longest = np.zeros(len(masks[0]), bool), int(LONGEST_S * rate_hz)
    total, changes = np.zeros(len(masks[0]) - 1), []
    for imu, mask in zip(sensors.values(), masks, strict=True):
        for start, end in true_runs(~mask):
            if end - start >= LONG_GAP:
                gaps[max(start - AROUND - 1, 0) : end + AROUND + 1] = True
        change = np.diff(np.asarray(imu.gyr), axis=0)
        changes.append(change[:longest])
        if len(masks) >= FEWEST_SENSORS:
            total += _jump(change)
    whole = ~(gaps[1:] | gaps[:-1])
    twice = _written_twice(changes, whole[:longest])
    if twice.any():
        return (ROWS_TWICE(rows=twice.sum(), begin_s=(np.argmax(twice) + 1) / rate_hz),)
    lost = _double_steps(changes, whole[:longest], rate_hz)
    if lost is None:
        lost = (total > SURE_JUMP * len(masks)) & whole
    if not lost.any():
        return ()
    return (ROWS_LOST(places=lost.sum(), begin_s=(np.argmax(lost) + 1) / rate_hz),)


def _written_twice(changes: list[np.ndarray], whole: np.ndarray) -> np.ndarray:
    """(n,) bool, steps over which a row is repeated; none unless they are frequent and the next step is not longer."""
    same = whole & np.all([~change.any(axis=1) for change in changes], axis=0)
    same &= ~(_shifted(same, 1) | _shifted(same, -1))  # a longer stretch is a sensor at its limit, or one that stopped
    at = np.flatnonzero(same)
    turns, found, usual = np.zeros(len(same), bool), 0.0, 0.0
    for change in changes if at.size else ():
        expected = 0.5 * (_shifted(change, 1) + _shifted(change, -2))[at]
        size = np.sum(expected * expected, axis=1)
        steps = np.abs(change)
        resolution = np.min(steps, where=steps > 0.0, initial=np.inf)
        counts = size > max(RESOLVED * resolution, SMALLEST) ** 2
        turns[at[counts]] = True
        along = np.sum(_shifted(change, -1)[at] * expected, axis=1)
        usual += float(np.sum(np.sqrt(size[counts])))
        found += float(np.sum(along[counts] / np.sqrt(size[counts])))
    if turns.sum() < max(FEWEST, TWICE_SHARE * whole.sum()) or found > ONE_STEP * usual:
        return np.zeros(len(same), bool)
    return np.asarray(turns)


def _jump(change: np.ndarray) -> np.ndarray:
    """(T − 1,) logarithm of the size of a sensor's changes (T − 1, 3) over the largest around each."""
    size = np.sqrt(np.sum(change * change, axis=1)) + SMALLEST
    around = np.max([_shifted(size, by) for by in range(-AROUND, AROUND + 1) if by], axis=0)
    return np.asarray(np.log(size / around))


def _double_steps(changes: list[np.ndarray], whole: np.ndarray, rate_hz: float) -> np.ndarray | None:
    """(n,) bool, steps over which a row is missing; None unless they are frequent, and some are double in each of the
    sensors.

    The expected change is interpolated, by a cubic, from two steps on either side.
    """
    many = len(changes) >= 3
    if rate_hz < 0.5 * FAST_HZ[many]:
        return None
    ratios = np.full((len(changes), len(whole)), np.nan)
    for number, change in enumerate(changes):
        expected = (
            4.0 * (_shifted(change, 1) + _shifted(change, -1)) - _shifted(change, 2) - _shifted(change, -2)
        ) / 6.0
        along, size = np.sum(change * expected, axis=1), np.sum(expected * expected, axis=1)
        straight = along > STRAIGHT[many] * np.sqrt(size * np.sum(change * change, axis=1))
        counts = straight & (size > np.quantile(size, SLOWEST)) & (size > SMALLEST**2)
        ratios[number, counts] = np.log(along[counts] / size[counts])
    known = np.isfinite(ratios)
    counts = whole & (2 * known.sum(axis=0) >= len(changes))
    if not counts.any():
        return None
    middle = np.zeros(len(whole))
    middle[counts] = np.nanmedian(ratios[:, counts], axis=0)
    double, longer = ((middle > low) & (middle < high) for low, high in (TWO_STEPS, LONGER))
    number, usual = int(double.sum()), LEAST_RATIO[rate_hz >= FAST_HZ[many]]
    if number < max(FEWEST, LEAST_SHARE * counts.sum()) or number < usual * longer.sum():
        return None
    each = np.sum((ratios > TWO_STEPS[0]) & (ratios < TWO_STEPS[1]), axis=1) / np.maximum(known.sum(axis=1), 1)
    return np.asarray(double) if each.min() >= AGREE * each.max() else None
