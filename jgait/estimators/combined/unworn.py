"""Times in which the sensors of both legs are not worn, left out of the strides of the shanks."""

import jax
import numpy as np

from jgait.estimators.ankle_stride.estimator import PER_STRIDE
from jgait.estimators.combined.sources import SourceEstimate
from jgait.types import SIDES, as_float


def without_unworn(estimates: list[SourceEstimate]) -> tuple[list[SourceEstimate], float]:
    """The sources without strides of the shanks where neither leg's sensors are worn, by the angles of `leg_ekf`; and
    the distance of these strides, if it is walking [m]. A single sensor that is not worn changes no other.
    """
    by_name = {source.name: source for source in estimates}
    if "legs" not in by_name or "shanks" not in by_name:
        return estimates, 0.0
    legs, shanks = by_name["legs"].estimate, by_name["shanks"].estimate
    if any(f"worn_{side}" not in legs.diagnostics for side in SIDES):
        return estimates, 0.0
    worn, time = legs.diagnostics["worn_right"] | legs.diagnostics["worn_left"], as_float(legs.time)
    if worn.all() or len(shanks.time) != len(worn):
        return estimates, 0.0
    middle = 0.5 * (as_float(shanks.strides.start) + as_float(shanks.strides.end))
    off = np.interp(middle, time, worn.astype(float)) < 0.5
    per_stride = {name: shanks.diagnostics[name] for name in PER_STRIDE if name in shanks.diagnostics}
    strides, spread, per_stride = jax.tree.map(
        lambda column: column[~off], (shanks.strides, shanks.strides_stddev, per_stride)
    )
    way = np.cumsum(np.where(worn, np.diff(as_float(shanks.distance), prepend=0.0), 0.0))
    left = shanks._replace(
        strides=strides, strides_stddev=spread, distance=way, diagnostics={**shanks.diagnostics, **per_stride}
    )
    metres = float(as_float(shanks.strides.length)[off].sum()) / len(SIDES)
    return [source._replace(estimate=left) if source.name == "shanks" else source for source in estimates], metres
