"""Judging the leg estimator: errors in named windows of a walk, and the loss that tunes towards them."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jgait import losses
from jgait.estimators import leg_ekf
from jgait.estimators.leg_ekf import LegOptions, LegParams
from jgait.estimators.leg_inputs import LegInputs
from jgait.evaluate import FIELDS, distance_error, trajectory_errors
from jgait.types import SIDES, Estimate, as_float

__all__ = ["FIELDS", "Judged", "Lesson", "judge", "leg_loss", "lesson", "with_lengths"]


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
    look = _within(window, reference)
    still = None if standing is None else _within(standing, reference)
    rmse = trajectory_errors(estimate, reference, look, still).to_dict("index")
    error = None
    if estimate.distance is not None and reference.distance is not None:
        error = 100.0 * distance_error(estimate, reference, look).rel_error
    return Judged(rmse, error, _share_within(estimate, reference, look, still))


def _within(span: tuple[int, int], reference: Estimate) -> np.ndarray:
    index = np.arange(as_float(reference.time).size)
    return (index >= span[0]) & (index < span[1])


def _share_within(estimate: Estimate, reference: Estimate, look: np.ndarray, still: np.ndarray | None) -> float | None:
    """Share of the joint angles inside two stated standard deviations."""
    if estimate.stddev is None:
        return None
    inside = []
    for side in SIDES:
        legs = [getattr(record, side) for record in (estimate.legs, estimate.stddev, reference.legs)]
        if any(leg is None for leg in legs):
            continue
        for field in ("hip_angle", "knee_angle"):
            ours, spread = (
                np.interp(as_float(reference.time), as_float(estimate.time), as_float(getattr(leg, field)))
                for leg in legs[:2]
            )
            error = ours - as_float(getattr(legs[2], field))
            if still is not None:
                error = error - error[still].mean()
            inside.append(np.abs(error[look]) <= 2.0 * spread[look])
    return float(np.mean(np.concatenate(inside)))


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
    lengths = np.asarray([*p.thigh_length, *p.shank_length], float)
    bare = reference._replace(stddev=None, diagnostics={}, strides=None)
    look, still = _within(window, bare), _within(standing, bare)
    return Lesson(inputs, bare, look, still, np.asarray(window[0]), np.asarray(window[1] - 1), lengths)


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
