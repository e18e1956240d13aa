"""Sensors on thighs and shanks that slip: the tilt of the segment changes, in standing and in movement."""

from collections.abc import Mapping

import numpy as np

from jgait.estimators.leg_ekf.notes import SLIPPED, STANDS_OTHERWISE
from jgait.events.rest import LEGS_SHORTEST_S
from jgait.notes import Note
from jgait.quality import SensorQuality
from jgait.signal.windows import true_runs
from jgait.types import Imu, as_float

OTHERWISE_DEG = 10.0
"""[deg] Largest change of a segment's tilt between two times of standing; chosen, above that of legs of public sets."""


def slips(
    sensors: Mapping[str, Imu], upright: np.ndarray, standing: slice, time: np.ndarray
) -> tuple[dict[str, SensorQuality], list[Note]]:
    """Sensors that slipped, and notes on those whose tilt in another standing differs from that in the calibrating one.

    If the last standing has such a tilt, and the movement before it too, the sensor slipped, see `_since`.
    """
    step = float(np.median(np.diff(time)))
    runs = [slice(first, after) for first, after in true_runs(upright) if after - first >= LEGS_SHORTEST_S / step]
    quality: dict[str, SensorQuality] = {}
    notes = []
    for name, imu in sensors.items():
        if imu.acc is None or not runs:
            continue
        force = as_float(imu.acc)
        down = force[standing].mean(axis=0)
        others = np.stack([force[run].mean(axis=0) for run in runs])
        cosines = others @ down / np.maximum(np.linalg.norm(others, axis=1) * np.linalg.norm(down), 1e-9)
        degrees = np.rad2deg(np.arccos(np.clip(cosines, -1.0, 1.0)))
        worst = int(np.argmax(degrees))
        if degrees[worst] <= OTHERWISE_DEG:
            continue
        since = None
        if degrees[-1] > OTHERWISE_DEG and runs[-1].start >= standing.stop:
            moving = np.flatnonzero(np.asarray(imu.mask, bool) & ~upright)
            moving = moving[(moving >= standing.stop) & (moving < runs[-1].start)]
            # [s] accelerations of walking vanish over it
            since = _since(force, moving, round(1.0 / step), down, others[-1])
        if since is None:
            notes.append(
                STANDS_OTHERWISE(placement=name, degrees=degrees[worst], at_s=time[runs[worst].start] - time[0])
            )
        else:
            quality[name] = SensorQuality(slips_at=float(time[since] - time[0]))
            notes.append(SLIPPED(placement=name, degrees=degrees[-1], from_s=quality[name].slips_at))
    return quality, notes


def _since(force: np.ndarray, moving: np.ndarray, width: int, before: np.ndarray, after: np.ndarray) -> int | None:
    """The sample from which on a sensor is tilted as in the standing `after` (3,), and not as in that `before`.

    It splits windows of the samples in which the person moves so that their tilts vary least around the mean of either
    part. None if the parts differ by less than half of the change in standing, and if none is after.
    """
    count = len(moving) // width
    if count < 2:
        return None
    change = after - before
    kept = moving[: count * width].reshape(count, width)
    tilts = (force[kept].mean(axis=1) - before) @ change / (change @ change)
    values = np.concatenate([[0.0], tilts])  # the standing before, from which a sensor may slip before the walk
    parts = [(values[:number], values[number:]) for number in range(1, len(values))]
    best = min(range(len(parts)), key=lambda number: sum(len(part) * float(np.var(part)) for part in parts[number]))
    first, last = parts[best]
    return None if last.mean() - first.mean() < 0.5 else int(kept[max(best - 1, 0), 0])


def slipped(quality: Mapping[str, SensorQuality], side: str, time: np.ndarray) -> np.ndarray:
    """(T,) bool, the samples after a sensor on the leg of a side slipped."""
    slips_at = (facts.slips_at for placement, facts in quality.items() if placement.endswith(side))
    return np.asarray(time - time[0] >= min(slips_at, default=np.inf))
