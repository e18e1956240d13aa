"""Whether a shoe's sensor is fixed to the shoe all the time: in every stance it leans as in the first ones."""

import numpy as np

from jgait.notes import Kind, Note
from jgait.types import Strides, as_float

STANCES, OTHERWISE_DEG = 6, 20.0
"""[1], [deg] Stances in a row whose median direction of gravity is compared, and largest difference from that of the
first ones; chosen, above all of feet of public walks, which lie flat in stance."""

LEANS_OTHERWISE = Kind(
    "leans_otherwise",
    "check",
    "{placement}: from {at_s:.0f} s on the sensor leans otherwise in stance than at first, by {degrees:.0f}°: it "
    "slipped, or was put on anew",
    "Foot angles are wrong after that. Lengths, times and distances do not depend on it. Cut the recording there, and "
    "analyse both parts.",
)


def leans(placement: str, strides: Strides, side: int, time: np.ndarray, acc: np.ndarray) -> list[Note]:
    """A note if the sensor of a side leans otherwise in later stances; `acc` (T, 3) [m/s²] at `time` (T,) [s]."""
    if strides.standing is None:
        return []
    mine = np.asarray(strides.valid, bool) & (np.asarray(strides.side) == side)
    at = as_float(strides.standing)[mine]
    at = np.sort(at[np.isfinite(at)])
    if len(at) < 2 * STANCES:
        return []
    up = acc[np.clip(np.searchsorted(time, at), 0, len(time) - 1)]
    rows = np.arange(len(at) - STANCES + 1)[:, None] + np.arange(STANCES)
    middle = np.median((up / np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-9))[rows], axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    degrees = np.rad2deg(np.arccos(np.clip(middle @ middle[0], -1.0, 1.0)))
    worst = int(np.argmax(degrees))
    if degrees[worst] <= OTHERWISE_DEG:
        return []
    first = int(np.argmax(degrees > OTHERWISE_DEG)) + STANCES // 2
    return [LEANS_OTHERWISE(placement=placement, at_s=at[first] - time[0], degrees=degrees[worst])]
