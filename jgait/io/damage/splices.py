"""Rows that are missing although time goes on: all sensors jump at once."""

from collections.abc import Mapping

import numpy as np

from jgait.notes import Kind, Note
from jgait.signal.windows import true_runs
from jgait.types import Imu

FEWEST_SENSORS = 4
"""[1] Least number of sensors: a landing makes one or two jump, never all."""

JUMP, SURE_JUMP = 0.4, 0.8
"""[1] Least mean over the sensors of the logarithm of a change of the angular rate over the largest change within
`AROUND`: of a jump of which there are `PLACES` or more, and of a single one. Undamaged public recordings of four
sensors and more reach 0.30; of 420 simulated ones five jump beyond 0.4, at two places at most."""

PLACES = 5
"""[1] Number of jumps from which on rows are missing here and there."""

AROUND = 3
"""[samples] Distance up to which changes are compared."""

LONG_GAP = 3
"""[samples] Shortest gap around which jumps do not count; shorter ones are bridged."""

SMALLEST = 1e-3
"""[rad/s] Added to the changes, so that sensors at rest do not count."""

ROWS_LOST = Kind(
    "rows_lost",
    "check",
    "all sensors jump at {places} places, first at {begin_s:.2f} s: rows are missing there although time goes on, or "
    "the recording was joined from parts",
    "Where rows are missing without time stamps, movements come out too fast and too small; lengths and angles after "
    "the place are wrong.",
)


def _shifted(values: np.ndarray, by: int) -> np.ndarray:
    """Values moved by some samples; the ends are repeated."""
    return values[np.clip(np.arange(len(values)) - by, 0, len(values) - 1)]


def splice_notes(sensors: Mapping[str, Imu], rate_hz: float) -> tuple[Note, ...]:
    """A note if all sensors jump at the same time, more than around it.

    Args:
        sensors: placement → sensor, on one clock.
        rate_hz: sampling rate [Hz].
    """
    if len(sensors) < FEWEST_SENSORS or len({len(imu.time) for imu in sensors.values()}) > 1:
        return ()
    total = np.zeros(len(next(iter(sensors.values())).time) - 1)
    masks = [np.asarray(imu.mask) for imu in sensors.values()]
    if len(masks[0]) < 10 * AROUND or not all(mask.any() for mask in masks):
        return ()
    gaps = np.zeros(len(masks[0]), bool)
    for imu, mask in zip(sensors.values(), masks, strict=True):
        gyr = np.asarray(imu.gyr)
        if not mask.all():
            row, known = np.arange(len(mask)), np.flatnonzero(mask)
            gyr = np.stack([np.interp(row, known, column[known]) for column in gyr.T], axis=1)
            for start, end in true_runs(~mask):
                if end - start >= LONG_GAP:
                    gaps[max(start - AROUND - 1, 0) : end + AROUND + 1] = True
        change = np.diff(gyr, axis=0)
        size = np.sqrt(np.sum(change * change, axis=1)) + SMALLEST
        around = np.max([_shifted(size, by) for by in range(-AROUND, AROUND + 1) if by], axis=0)
        total += np.log(size / around)
    total[gaps[1:] | gaps[:-1]] = 0.0
    jumps = total > JUMP * len(sensors)
    if jumps.sum() < PLACES:
        jumps = total > SURE_JUMP * len(sensors)
    if not jumps.any():
        return ()
    return (ROWS_LOST(places=jumps.sum(), begin_s=(np.argmax(jumps) + 1) / rate_hz),)
