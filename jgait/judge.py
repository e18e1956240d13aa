"""Judging the leg estimator: errors in named windows of a walk, and the loss that tunes towards them."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jgait import losses
from jgait.estimators import leg_ekf
from jgait.estimators.leg_ekf import LegOptions, LegParams
from jgait.estimators.leg_inputs import LegInputs
from jgait.types import SIDES, Estimate, as_float

FIELDS = {
    "hip_deg": ("hip_angle", 180.0 / np.pi),
    "knee_deg": ("knee_angle", 180.0 / np.pi),
    "x_cm": ("x", 100.0),
    "y_cm": ("y", 100.0),
}
"""Column → field of `LegTrajectory` and what multiplies it."""


class Judged(NamedTuple):
    """Errors over one window.

    Attributes:
        rmse: side → column → root mean square error, relative to standing.
        distance_error_pct: signed, of the distance walked within the window; None where either has none.
        within_two_sigma: share of the angle samples inside two stated standard deviations; None without any.
    """

    rmse: dict[str, dict[str, float]]
    distance_error_pct: float | None
    within_two_sigma: float | None


def judge(
    estimate: Estimate, reference: Estimate, window: tuple[int, int], standing: tuple[int, int] | None = None
) -> Judged:
    """Errors of an estimate over a window of the reference, each relative to its own standing value.

    Args:
        estimate: at any sampling times; interpolated to the reference's.
        reference: motion capture or simulated truth.
        window: half-open sample range of the reference to judge.
        standing: half-open sample range of quiet standing whose mean is taken off both; None for absolute errors.

    Returns:
        Errors of every leg that both have.
    """
    times = as_float(reference.time)
    part = slice(*window)

    def at_reference(values: Any) -> np.ndarray:
        return np.interp(times, as_float(estimate.time), as_float(values))

    rmse: dict[str, dict[str, float]] = {}
    inside: list[np.ndarray] = []
    for side in SIDES:
        ours, theirs = getattr(estimate.legs, side), getattr(reference.legs, side)
        if ours is None or theirs is None:
            continue
        rmse[side] = {}
        for column, (field, scale) in FIELDS.items():
            error = at_reference(getattr(ours, field)) - as_float(getattr(theirs, field))
            if standing is not None:
                error = error - error[slice(*standing)].mean()
            rmse[side][column] = float(scale * np.sqrt(np.mean(error[part] ** 2)))
            if estimate.stddev is not None and column.endswith("_deg"):
                spread = at_reference(getattr(getattr(estimate.stddev, side), field))
                inside.append(np.abs(error[part]) <= 2.0 * spread[part])
    share = float(np.mean(np.concatenate(inside))) if inside else None
    return Judged(rmse, _distance_error(estimate, reference, window, at_reference), share)


def _distance_error(
    estimate: Estimate, reference: Estimate, window: tuple[int, int], at_reference: Any
) -> float | None:
    if estimate.distance is None or reference.distance is None:
        return None
    first, last = window[0], window[1] - 1
    true = as_float(reference.distance)
    ours = at_reference(estimate.distance)
    return float(100.0 * ((ours[last] - ours[first]) / (true[last] - true[first]) - 1.0))


class Lesson(NamedTuple):
    """One walk to tune on; every leaf is an array, so lessons stack.

    Attributes:
        inputs: from `leg_ekf.prepared`.
        reference: at the same times.
        look: (T,) bool, where the trajectory is judged.
        standing: (T,) bool, the stretch that errors are relative to.
        first: first sample of the part whose distance is judged.
        last: last sample of that part.
        lengths: thigh right, left, shank right, left [m]; NaN-free.
    """

    inputs: LegInputs
    reference: Estimate
    look: Any
    standing: Any
    first: Any
    last: Any
    lengths: Any


def lesson(
    inputs: LegInputs, reference: Estimate, window: tuple[int, int], standing: tuple[int, int], p: LegParams
) -> Lesson:
    """A walk to tune on: look at `window`, relative to `standing`, with the leg lengths of `p`."""
    index = np.arange(inputs.time.size)

    def within(span: tuple[int, int]) -> np.ndarray:
        return (index >= span[0]) & (index < span[1])

    lengths = np.asarray([*p.thigh_length, *p.shank_length], float)
    bare = reference._replace(stddev=None, diagnostics={})
    return Lesson(
        inputs, bare, within(window), within(standing), np.asarray(window[0]), np.asarray(window[1] - 1), lengths
    )


def with_lengths(p: LegParams, lengths: Any) -> LegParams:
    """The parameters with a person's own leg lengths: thigh right, left, shank right, left [m]."""
    side = leg_ekf.BySide
    return p._replace(thigh_length=side(lengths[0], lengths[1]), shank_length=side(lengths[2], lengths[3]))


def leg_loss(p: LegParams, item: Lesson, options: LegOptions = leg_ekf.DEFAULT) -> Any:
    """Trajectory error in squared degrees and centimetres, plus the squared percent error of the distance.

    Args:
        p: parameters; the leg lengths are taken from the lesson.
        item: the walk.
        options: as of `leg_ekf.run`.

    Returns:
        A scalar [1].
    """
    estimate = leg_ekf.run(with_lengths(p, item.lengths), item.inputs, options)
    error = losses.trajectory(estimate, item.reference, window=item.look, relative_to=item.standing)
    true = jnp.asarray(item.reference.distance)
    walked, reference = (d[item.last] - d[item.first] for d in (estimate.distance, true))
    return error + (100.0 * (walked / reference - 1.0)) ** 2
