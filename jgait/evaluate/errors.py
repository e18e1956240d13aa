"""Errors of an estimate against a reference, in the units that papers print; on the host, in NumPy and pandas."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jgait.geometry.matching import aligned_error, common_samples
from jgait.types import SIDES, Estimate, as_float

if TYPE_CHECKING:
    import pandas as pd

Window = tuple[float, float] | np.ndarray | None
"""An interval of the reference: its ends [s], both included; a mask (T,) over its samples; or None for all."""

FIELDS = {
    "hip_deg": ("hip_angle", 180.0 / np.pi),
    "knee_deg": ("knee_angle", 180.0 / np.pi),
    "x_cm": ("x", 100.0),
    "y_cm": ("y", 100.0),
}
"""Column → field of a `LegTrajectory`, and the factor from the field's SI unit to the column's unit."""


class DistanceError(NamedTuple):
    """Distance walked while estimate and reference are both valid [m]; errors are estimate − reference, `rel_error` is
    over the reference [1], `rmse` is that of the two distances over the walk, each from 0 at its start [m].
    """

    estimate: float
    reference: float
    error: float
    abs_error: float
    rel_error: float
    rmse: float


class PositionError(NamedTuple):
    """Root mean square distance between two trajectories of a foot [m]."""

    plan: float  #: in the horizontal plane, after the best-fitting turn about the vertical and shift.
    height: float  #: in height, after the best-fitting shift.


def _samples(reference: Estimate, common: np.ndarray, window: Window, name: str) -> np.ndarray:
    """The common samples within a window; at least one."""
    time = as_float(reference.time)
    mask = np.ones(time.shape, bool) if window is None else np.asarray(window)
    if isinstance(window, tuple) and len(window) == 2:
        if not window[0] < window[1]:
            raise ValueError(f"{name} must start before it ends; got ({window[0]:g}, {window[1]:g}) s")
        mask = (time >= window[0]) & (time <= window[1])
    if mask.dtype != np.bool_ or mask.shape != time.shape:
        raise ValueError(
            f"{name} must be (start, end) in seconds or a bool mask of {time.shape} samples; "
            f"got {mask.dtype} of shape {mask.shape}"
        )
    if not (common & mask).any():
        raise ValueError(f"{name} holds no sample where estimate and reference are both valid")
    return common & mask


def leg_errors(estimate: Estimate, reference: Estimate) -> Iterator[tuple[str, str, np.ndarray]]:
    """Side, column of `FIELDS` and error (T,) at the reference's times, of each leg that both have."""
    for side in SIDES:
        ours, theirs = getattr(estimate.legs, side), getattr(reference.legs, side)
        if ours is None or theirs is None:
            continue
        for column, (field, unit) in FIELDS.items():
            values = np.interp(as_float(reference.time), as_float(estimate.time), as_float(getattr(ours, field)))
            yield side, column, (values - as_float(getattr(theirs, field))) * unit


def trajectory_errors(
    estimate: Estimate, reference: Estimate, window: Window = None, relative_to: Window = None
) -> "pd.DataFrame":
    """Root mean square error of each leg's angles and foot path, at the reference's times.

    Errors are computed over `window`, an interval of the reference; the mean over `relative_to`, an interval of
    standing, is first subtracted from each of both; None for absolute errors.

    Returns:
        One row for each leg that both have (index `side`); columns `hip_deg knee_deg x_cm y_cm`.

    Raises:
        ValueError: if estimate and reference have no leg, no time, or no sample of a window in common.
    """
    import pandas as pd

    common = common_samples(estimate, reference)
    look = _samples(reference, common, window, "window")
    still = None if relative_to is None else _samples(reference, common, relative_to, "relative_to")
    rows: dict[str, dict[str, float]] = {}
    for side, column, error in leg_errors(estimate, reference):
        relative = error if still is None else error - error[still].mean()
        rows.setdefault(side, {})[column] = float(np.sqrt(np.mean(relative[look] ** 2)))
    if not rows:
        raise ValueError("estimate and reference share no leg")
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("side")


def distance_error(estimate: Estimate, reference: Estimate, window: Window = None) -> DistanceError:
    """Error of the distance walked from the first to the last time at which both are valid, within a window of the
    reference. Raises ValueError if either has no distance, they have no time in common, or the reference did not move.
    """
    for name, estimated in (("estimate", estimate), ("reference", reference)):
        if estimated.distance is None:
            raise ValueError(f"the {name} has no distance to compare")
    common = _samples(reference, common_samples(estimate, reference), window, "window")
    theirs = as_float(reference.distance)[common]
    ours = np.interp(as_float(reference.time), as_float(estimate.time), as_float(estimate.distance))[common]
    ours, theirs = ours - ours[0], theirs - theirs[0]
    if theirs[-1] == 0.0:
        raise ValueError("the reference distance is 0 m: no relative error can be formed")
    error = float(ours[-1] - theirs[-1])
    rmse = float(np.sqrt(np.mean((ours - theirs) ** 2)))
    return DistanceError(float(ours[-1]), float(theirs[-1]), error, abs(error), error / float(theirs[-1]), rmse)


def foot_position_error(estimate: Estimate, reference: Estimate, side: str) -> PositionError | None:
    """Error of one foot's position, after the estimate is turned about the vertical and shifted onto the reference;
    None where one of them does not have that foot. Both are compared at the instants of the one that has fewer.

    Raises ValueError if they have no valid time in common.
    """
    if estimate.feet is None or reference.feet is None:
        return None
    ways = [getattr(estimated.feet, side) for estimated in (estimate, reference)]
    if None in ways:
        return None
    times = [as_float(estimated.time) for estimated in (estimate, reference)]
    ours_every, theirs_every = ((time[-1] - time[0]) / max(time.size - 1, 1) for time in times)
    fine, coarse = (reference, estimate) if ours_every > 1.5 * theirs_every else (estimate, reference)
    at = as_float(coarse.time)[common_samples(fine, coarse)]
    ours, theirs = (np.stack([np.interp(at, time, axis) for axis in as_float(way.position).T], axis=1)
                    for time, way in zip(times, ways, strict=True))  # fmt: skip
    gap = yaw_aligned(ours, theirs) - theirs
    plan, height = np.sum(gap[:, :2] ** 2, axis=1), gap[:, 2] ** 2
    return PositionError(float(np.sqrt(np.mean(plan))), float(np.sqrt(np.mean(height))))


def yaw_aligned(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Positions (n, 3) [m] turned about the vertical and shifted onto other positions by least squares."""
    return theirs + aligned_error(ours, theirs, np.ones(len(ours), bool))
