"""When both sensors of a leg are worn: not while the knee would bend as none does, if it does not in walking."""

import numpy as np

from jgait.estimators.cycles import swing_cycles
from jgait.estimators.leg_ekf.notes import NOT_WORN
from jgait.estimators.plausible import FEWEST_CYCLES, KNEE_SHARE, knee_beyond
from jgait.notes import Note
from jgait.signal.windows import true_runs
from jgait.types import LegTrajectory


def unworn(
    side: str, time: np.ndarray, leg: LegTrajectory, valid: np.ndarray, still: np.ndarray
) -> tuple[np.ndarray, list[Note]]:
    """(T,) bool, the rests and movements in which the knee of a leg is beyond what a knee does, and a note on each row
    of them; none if most strides of the leg are there, for then a sensor is wrong.

    `valid` and `still` (T,) are bool, `still` where no leg moves.
    """
    beyond, left_out = knee_beyond(leg) & valid, np.zeros(len(time), bool)
    if not valid.any() or beyond[valid].mean() <= KNEE_SHARE:
        return left_out, []
    for first, after in (*true_runs(still), *true_runs(~still)):
        left_out[first:after] = beyond[first:after].mean() > KNEE_SHARE
    good, bad = (len(swing_cycles(time, leg, part & valid)) for part in (~left_out, left_out))
    if good < max(FEWEST_CYCLES, bad):
        return np.zeros(len(time), bool), []
    times = [(time[first] - time[0], time[after - 1] - time[0]) for first, after in true_runs(left_out)]
    return left_out, [NOT_WORN(side=side, from_s=first, to_s=last) for first, last in times]
