"""Cycles of a walking leg, from its knee angle alone; NumPy, on the host."""

import itertools

import numpy as np

from jgait.signal.windows import peaks
from jgait.types import Flags, LegTrajectory, Values, as_float

KNEE_SWING = np.deg2rad(20.0)
"""[rad] Smallest prominence of a maximum of knee flexion that counts as a swing."""

SHORTEST_CYCLE_S, LONGEST = 0.6, 2.5
"""[s] Shortest and longest cycle of a walking leg; longer ones contain standing."""


def swing_cycles(time: Values, leg: LegTrajectory, valid: Flags) -> list[tuple[int, int]]:
    """The cycles of a leg, from the largest knee flexion of a swing to the largest of the next swing.

    Args:
        time: (T,) [s].
        leg: angles (T,) [rad].
        valid: (T,) bool; a cycle has only valid samples.

    Returns:
        First sample of each cycle, and the first after it.
    """
    time, angle = as_float(time), as_float(leg.knee_angle)
    if time.size < 2:
        return []
    step = float(np.median(np.diff(time)))
    known = np.asarray(valid, bool) & np.isfinite(angle)
    distance = max(1, round(SHORTEST_CYCLE_S / step))
    at = peaks(np.where(known, angle, 0.0), prominence=KNEE_SWING, distance=distance)
    return [
        (int(a), int(b)) for a, b in itertools.pairwise(at) if time[b] - time[a] <= LONGEST and known[a : b + 1].all()
    ]
