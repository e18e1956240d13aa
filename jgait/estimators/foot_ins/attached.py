"""Sensors that move on the shoe: in later stances they lean otherwise than in the first ones.

If from one time on each of both sensors leans as the other one did before, the sensors are exchanged.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.notes import Kind, Note
from jgait.quality import SensorQuality
from jgait.types import Strides, as_float

STANCES, OTHERWISE_DEG = 6, 20.0
"""Number of successive stances whose median direction of gravity is compared, and [deg] its largest difference from
that of the first stances; chosen above those of all feet of public walks, which lie flat in stance."""

LEANS_OTHERWISE = Kind(
    "leans_otherwise",
    "check",
    "{placement}: from {at_s:.0f} s on the sensor leans otherwise in stance than at first, by {degrees:.0f}°: it "
    "slipped, or was put on anew",
    "Foot angles are wrong after that. Lengths, times and distances do not depend on it. Cut the recording there, and "
    "analyse both parts.",
)


SHOES_EXCHANGED = Kind(
    "shoes_exchanged",
    "check",
    "foot_right and foot_left seem to be exchanged from {at_s:.0f} s on: each leans in stance as the other one did "
    "before",
    "The sensors, or their names, have changed places in a pause. Which foot took a stride is not known after that, so "
    "that no asymmetry is stated; lengths and distances hold. Cut the recording there, name the sensors anew, and "
    "analyse both parts.",
)


class Moved(NamedTuple):
    """A sensor that leans otherwise from one stance on.

    Attributes:
        quality: from when on it leans otherwise, and by how much.
        pause: (2,) [s], the last stance before, and the first after.
        at: time between them at which the lean changes [s].
        before after: (3,) mean direction of gravity in stances, of length 1.
    """

    quality: SensorQuality
    pause: np.ndarray
    at: float
    before: np.ndarray
    after: np.ndarray


def moved(strides: Strides, side: int, time: np.ndarray, acc: np.ndarray) -> Moved | None:
    """The sensor of a side if it leans otherwise in later stances; `acc` (T, 3) [m/s²] at `time` (T,) [s]."""
    if strides.standing is None:
        return None
    mine = np.asarray(strides.valid, bool) & (np.asarray(strides.side) == side)
    at = as_float(strides.standing)[mine]
    at = np.sort(at[np.isfinite(at)])
    if len(at) < 2 * STANCES:
        return None
    up = acc[np.clip(np.searchsorted(time, at), 0, len(time) - 1)]
    up = up / np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-9)
    rows = np.arange(len(at) - STANCES + 1)[:, None] + np.arange(STANCES)
    middle = np.median(up[rows], axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    degrees = _degrees(middle, middle[0])
    worst = int(np.argmax(degrees))
    if degrees[worst] <= OTHERWISE_DEG:
        return None
    first = int(np.argmax(degrees > OTHERWISE_DEG)) + STANCES // 2
    quality = SensorQuality(leans_at=float(at[first] - time[0]), leans_deg=float(degrees[worst]))
    change = middle[worst] - middle[0]
    begin = int(np.clip(_first(up @ change > 0.0), 1, len(at) - 1))
    pause = at[[begin - 1, begin]]
    rows = np.searchsorted(time, pause)
    return Moved(quality, pause, time[rows[0] + _first(acc[slice(*rows)] @ change > 0.0)], middle[0], middle[worst])


def _first(later: np.ndarray) -> int:
    """The index that splits (n,) bool with the fewest True before it and the fewest False from it on."""
    wrong = np.cumsum(np.concatenate([[0], later])) + np.cumsum(np.concatenate([[0], ~later[::-1]]))[::-1]
    return int(np.argmin(wrong))


def exchanged(right: Moved | None, left: Moved | None) -> float | None:
    """The time [s] from which each shoe's sensor leans as the other one did before, because they were exchanged."""
    if right is None or left is None:
        return None
    begin, end = max(right.pause[0], left.pause[0]), min(right.pause[1], left.pause[1])
    apart = _degrees(right.after, left.before), _degrees(left.after, right.before)
    return None if begin >= end or max(apart) > OTHERWISE_DEG else 0.5 * (right.at + left.at)


def lean_notes(quality: Mapping[str, SensorQuality]) -> list[Note]:
    """Notes on sensors of shoes that lean otherwise from one time on, and on both if they changed places."""
    notes = [
        LEANS_OTHERWISE(placement=placement, at_s=facts.leans_at, degrees=facts.leans_deg)
        for placement, facts in quality.items() if np.isfinite(facts.leans_at)
    ]  # fmt: skip
    changed = {facts.exchanged_at for facts in quality.values() if np.isfinite(facts.exchanged_at)}
    return notes + [SHOES_EXCHANGED(at_s=at) for at in changed]


def _degrees(direction: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Angle between directions (…, 3) of length 1 [deg]."""
    return np.asarray(np.rad2deg(np.arccos(np.clip(direction @ other, -1.0, 1.0))))
