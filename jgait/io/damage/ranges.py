"""Ranges between the feet that a stuck sensor repeats: they are masked, with a note."""

from collections.abc import Mapping

import numpy as np

from jgait.notes import NO_RANGE, Kind, Note
from jgait.types import SIDES, Imu, RangeReadings, as_float

HELD_S = 0.3
"""[s] Longest time without a gap in which the range of moving feet may be one number. Feet pass each other in less; a
file that holds the last reading until the next passing holds it for about 0.5 s."""

STUCK_S = 5.0
"""[s] Time from which on the first of equal readings is masked too: the sensor may have been stuck before it."""

FEWEST = 10
"""[1] Equal readings over `STUCK_S` from which on a sensor with gaps between its readings is stuck. Chosen: simulated
readings in steps of 1 cm, of which some neighbours are equal, are not masked."""

MOVING = 1.0
"""[rad/s] Mean rate of the faster foot from which on the feet move; in a simulated walk it is 5."""

RANGE_STUCK = Kind(
    "range_stuck",
    "check",
    "feet_range repeats one reading {times} {times:time|times} while the feet move, for {seconds:.2f} s in all, first "
    "at {begin_s:.2f} s; masked",
    NO_RANGE,
)


def without_repeats(read: RangeReadings, imus: Mapping[str, Imu]) -> tuple[RangeReadings, tuple[Note, ...]]:
    """The range with repeated readings masked, and the note about them.

    Args:
        read: the range, on the clock of `imus`.
        imus: sensors by placement; without one at a foot, nothing is masked.
    """
    feet = [imus[f"foot_{side}"] for side in SIDES if f"foot_{side}" in imus]
    rows = np.flatnonzero(read.mask)
    if not feet or not rows.size:
        return read, ()
    rates = [np.where(foot.mask, np.linalg.norm(as_float(foot.gyr), axis=1), 0.0) for foot in feet]
    rate, time = np.max(rates, axis=0), as_float(read.time)
    mask = np.array(read.mask, bool)
    runs = []
    for run in np.split(rows, np.flatnonzero(np.diff(read.distance[rows]) != 0.0) + 1):
        lasts = time[run[-1]] - time[run[0]]
        gapless = run[-1] - run[0] == run.size - 1
        stuck = lasts >= STUCK_S and run.size >= FEWEST
        if (stuck or (gapless and lasts > HELD_S)) and np.mean(rate[run[0] : run[-1] + 1]) > MOVING:
            mask[run if stuck else run[1:]] = False
            runs.append(run)
    if not runs:
        return read, ()
    seconds = sum(float(time[run[-1]] - time[run[0]]) for run in runs)
    note = RANGE_STUCK(times=len(runs), seconds=seconds, begin_s=float(time[runs[0][0]] - time[0]))
    return read._replace(distance=np.where(mask, read.distance, 0.0), mask=mask), (note,)
