"""Times in which the sensors of both legs are not worn, removed from a recording."""

import numpy as np

from jgait.estimators.combined.sources import SourceEstimate
from jgait.types import SIDES, Recording, as_float


def without_unworn(recording: Recording, estimates: list[SourceEstimate]) -> tuple[Recording, float]:
    """The recording, with samples of thighs and shanks masked where neither leg's sensors are worn, by the angles of
    `leg_ekf`; and the distance of the shanks in that time, if it is walking [m]. A single sensor that is not worn
    changes no other.
    """
    by_name = {source.name: source for source in estimates}
    if "legs" not in by_name or "shanks" not in by_name:
        return recording, 0.0
    legs, strides = by_name["legs"], by_name["shanks"].estimate.strides
    found = legs.estimate.diagnostics
    if any(f"worn_{side}" not in found for side in SIDES):
        return recording, 0.0
    worn, time = found["worn_right"] | found["worn_left"], as_float(legs.estimate.time)
    if worn.all() or any(len(recording.sensors[name].mask) != len(worn) for name in legs.placements):
        return recording, 0.0
    sensors = dict(recording.sensors)
    for name in legs.placements:
        sensors[name] = sensors[name]._replace(mask=np.asarray(sensors[name].mask, bool) & worn)
    middle = 0.5 * (as_float(strides.start) + as_float(strides.end))
    off = np.asarray(strides.valid, bool) & (np.interp(middle, time, worn.astype(float)) < 0.5)
    return recording._replace(sensors=sensors), float(as_float(strides.length)[off].sum()) / len(SIDES)
