"""Cycles of a walking leg, from its knee angle alone; NumPy, on the host."""

import itertools

import numpy as np

from jgait.signal.windows import peaks
from jgait.types import Flags, LegTrajectory, Values, as_float


def swing_cycles(time: Values, leg: LegTrajectory, valid: Flags) -> list[tuple[int, int]]:
    """The cycles of a leg, from the largest knee flexion of a swing to the largest of the next swing.

    A cycle has only `valid` samples (T,), and lasts 0.6 s to 2.5 s, for longer ones contain standing. It is given by
    its first sample and the first after it. In a swing knee flexion has a maximum with a prominence of 20°.
    """
    time, angle = as_float(time), as_float(leg.knee_angle)
    if time.size < 2:
        return []
    known = np.asarray(valid, bool) & np.isfinite(angle)
    distance = max(1, round(0.6 / float(np.median(np.diff(time)))))
    at = peaks(np.where(known, angle, 0.0), prominence=np.deg2rad(20.0), distance=distance)
    return [(int(a), int(b)) for a, b in itertools.pairwise(at) if time[b] - time[a] <= 2.5 and known[a : b + 1].all()]
