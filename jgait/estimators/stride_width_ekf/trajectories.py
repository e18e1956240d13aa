"""Checked trajectories of both feet: positions, headings of strides, contacts. NumPy, on the host."""

import itertools
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jgait.notes import LOSSES, Kind, Note
from jgait.types import SIDES, Feet, FootTrajectory, RecordingError

FOOT_BRIDGED = Kind(
    "foot_bridged", "check", "the {side} foot is not known at {samples} {samples:sample|samples}; bridged", LOSSES
)
SHORTEST_WAY = 0.15
"""[m] Shortest way of a stride whose direction is known; chosen by hand."""


class FootTrack(NamedTuple):
    """One foot's trajectory."""

    time: np.ndarray  #: (T,) [s].
    position: np.ndarray  #: (T, 3) [m] in a world whose x axis is the first stride; interpolated over gaps.
    mids: np.ndarray  #: (n,) middles of the stances [s].
    #: (n − 1,) headings of the strides [rad], 0 for the first, without jumps; (1,), 0, without strides.
    heading: np.ndarray
    gaps: tuple[tuple[float, float], ...]  #: start and end of each gap in the positions [s].

    def at(self, times: np.ndarray) -> np.ndarray:
        """(k, 3) position at given times [m]."""
        return np.stack([np.interp(times, self.time, part) for part in self.position.T], axis=1)

    def speed(self) -> np.ndarray:
        """(T,) horizontal speed [m/s]."""
        return np.hypot(*(np.gradient(self.position[:, axis], self.time) for axis in (0, 1)))


type Pair = tuple[FootTrack, FootTrack]
"""The right and the left foot."""


def checked_feet(
    time: npt.ArrayLike, feet: Feet, stances: tuple[npt.ArrayLike, npt.ArrayLike]
) -> tuple[Pair, list[Note]]:
    """Trajectories of both feet, and notes. Raises RecordingError as `prepare_from_feet`."""
    time = np.asarray(time, np.float64)
    if time.ndim != 1 or time.size < 3:
        raise RecordingError(f"stride_width_ekf needs times (T,) of a walk; got shape {time.shape}")
    if not np.all(np.diff(time) > 0):
        row = int(np.argmin(np.diff(time) > 0)) + 1
        raise RecordingError(f"time must increase; got {time[row - 1]:g} s, then {time[row]:g} s at sample {row}")
    if len(stances) != 2:
        raise RecordingError(f"stances must be given for the right and the left foot; got {len(stances)} of them")
    notes: list[Note] = []
    right, left = (
        _checked(side, time, foot, np.asarray(mids), notes)
        for side, foot, mids in zip(SIDES, feet, stances, strict=True)
    )
    return (right, left), notes


def _checked(
    side: str, time: np.ndarray, foot: FootTrajectory | None, mids: np.ndarray, notes: list[Note]
) -> FootTrack:
    if foot is None:
        raise RecordingError(f"stride_width_ekf needs both feet; the {side} one was not measured")
    position = np.asarray(foot.position, np.float64)
    if position.shape != (time.size, 3):
        raise RecordingError(f"the {side} foot needs positions of shape ({time.size}, 3); got {position.shape}")
    if mids.ndim != 1 or (mids.size and not np.issubdtype(mids.dtype, np.integer)):
        raise RecordingError(f"stances of the {side} foot must be samples, whole numbers (n,); got {mids!r}")
    if np.any(mids < 0) or np.any(mids >= time.size) or np.any(np.diff(mids) <= 0):
        raise RecordingError(
            f"stances of the {side} foot must be increasing samples from 0 to {time.size - 1}; got {mids.tolist()}"
        )
    finite = np.isfinite(position).all(axis=1)
    if np.sum(finite) < 2:
        raise RecordingError(f"the {side} foot needs finite positions; got {int(np.sum(finite))} of {time.size}")
    if not finite.all():
        notes.append(FOOT_BRIDGED(side=side, samples=np.sum(~finite)))
    mids = mids[finite[mids]] if mids.size else np.zeros(0, int)
    at = time[finite]
    step = np.diff(at)
    wide = np.flatnonzero(step > max(0.1, 1.5 * float(np.median(step))))  # [s] a range in a longer gap is not used
    x, y, z = (np.interp(time, at, part) for part in position[finite].T)
    heading, first = _headings(np.stack([x, y], axis=1)[mids])
    c, s = np.cos(first), np.sin(first)
    gaps = tuple((float(at[k]), float(at[k + 1])) for k in wide)
    return FootTrack(time, np.stack([c * x + s * y, c * y - s * x, z], axis=1), time[mids], heading, gaps)


def _headings(stood: np.ndarray) -> tuple[np.ndarray, float]:
    """Headings of the strides between stances (n, 2) relative to the first stride, and that of the first [rad].

    A stride shorter than `SHORTEST_WAY` has the heading of the stride before it, or else of the first longer one.
    """
    way = np.diff(stood, axis=0)
    long = np.hypot(*way.T) >= SHORTEST_WAY
    if not long.any():
        return np.zeros(max(len(way), 1)), 0.0
    which = np.maximum.accumulate(np.where(long, np.arange(len(way)), np.argmax(long)))
    heading = np.unwrap(np.arctan2(way[which, 1], way[which, 0]))
    return heading - heading[0], float(heading[0])


def contact_times(foot: FootTrack) -> tuple[np.ndarray, np.ndarray]:
    """Final and initial contact of each stride [s], from the horizontal speed.

    A foot is on the ground below 0.3 m/s, and below 0.15 of its largest speed in the stride.
    """
    speed = foot.speed()
    contacts = []
    for a, b in itertools.pairwise(np.searchsorted(foot.time, foot.mids)):
        moves = a + np.flatnonzero(speed[a : b + 1] > max(0.3, 0.15 * float(speed[a : b + 1].max())))
        contacts.append((moves[0], moves[-1]) if moves.size else (a, b))
    leave, land = foot.time[np.array(contacts, int).reshape(-1, 2).T]
    return leave, land
