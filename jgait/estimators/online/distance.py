"""Walked distance from the strides of both sides as they become known, and the time without samples that it misses."""

import numpy as np

from jgait.estimators.notes import LONGEST_LOSS
from jgait.estimators.sides import of_turns
from jgait.types import Strides

ALONE = 3
"""[1] Strides of one side in a row, without one of the other, from which on the other counts as missing. With a pause
or a missed stride there are two."""


class StridesWay:
    """Distance along strides: the mean over the sides, or that of one where the strides of the other are missing.

    A side is missing whose sensor is stuck or lost for some strides. Then each stride of the side that is left counts
    as one of both; of the strides in a row, the first has its partner before them.
    """

    def __init__(self, sides: int) -> None:
        self._share = 1.0 / sides
        self._side, self._number, self._uncounted = -1, 0, 0.0
        self.total = 0.0  #: [m]

    def add(self, strides: Strides) -> float:
        """The distance after strides (n,) that have become known, in order [m]."""
        ways = of_turns(strides.length, strides.turn)[0]
        for side, way in zip(np.asarray(strides.side), ways, strict=True):
            if side != self._side:
                # before the first stride of all, the other side has not had one either
                self._uncounted, self._number = 0.0, int(self._side < 0)
                self._side = int(side)
            self._number += 1
            self.total += self._share * float(way)
            self._uncounted += (1.0 - self._share) * float(way) * (self._number > 1)
            if self._number >= ALONE:
                self.total, self._uncounted = self.total + self._uncounted, 0.0
        return self.total


class LostTime:
    """Time in gaps without samples, each longer than a stride may have (`LONGEST_LOSS`)."""

    def __init__(self) -> None:
        self._seen: float | None = None
        self._closed = 0.0

    def after(self, time: np.ndarray, there: np.ndarray) -> float:
        """That time [s] since the first sample, after samples (n,) at `time` [s]; those `there` were measured."""
        known = time[there]
        if self._seen is None:
            self._seen = float(time[0])
        if known.size:
            gaps = np.diff(known, prepend=self._seen)
            self._closed += float(gaps[gaps > LONGEST_LOSS].sum())
            self._seen = float(known[-1])
        gap = float(time[-1]) - self._seen
        return self._closed + (gap if gap > LONGEST_LOSS else 0.0)
