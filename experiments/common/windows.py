"""Windows of a walk by their names, and errors of an estimate within a window, relative to standing."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import PyTree

from jgait.estimators.interface import Prepared
from jgait.evaluate.errors import FIELDS, distance_error, leg_errors, trajectory_errors
from jgait.tune import Windows
from jgait.types import AnyArray, Estimate, RecordingError, Walk, as_float

Samples = tuple[int, int] | AnyArray
"""Samples of a reference: a half-open range, or a mask (T,)."""


class Judged(NamedTuple):
    """Errors over one window."""

    rmse: dict[str, dict[str, float]]  #: side → column → root mean square error, relative to standing.
    #: signed error of the distance walked within the window; None where either has no distance.
    distance_error_pct: float | None
    #: share of the angle samples with errors inside two standard deviations; None without angles.
    within_two_sigma: float | None


def judge(estimate: Estimate, reference: Estimate, window: Samples, standing: Samples | None = None) -> Judged:
    """Errors of an estimate over a window of the reference, of every leg that both have.

    With `standing`, its mean is subtracted from both signals. The estimate is interpolated at the times of the
    reference.
    """
    look = _within(window, reference)
    still = None if standing is None else _within(standing, reference)
    rmse = trajectory_errors(estimate, reference, look, still).to_dict("index")
    error = None
    if estimate.distance is not None and reference.distance is not None:
        error = 100.0 * distance_error(estimate, reference, look).rel_error
    return Judged(rmse, error, _share_within(estimate, reference, look, still))


def _within(span: Samples, reference: Estimate) -> np.ndarray:
    if not isinstance(span, tuple):
        return np.asarray(span, bool)
    index = np.arange(as_float(reference.time).size)
    return (index >= span[0]) & (index < span[1])


def _share_within(estimate: Estimate, reference: Estimate, look: np.ndarray, still: np.ndarray | None) -> float | None:
    """Share of the joint angles with errors inside two standard deviations of the estimate."""
    if estimate.stddev is None:
        return None
    inside = []
    for side, column, error in leg_errors(estimate, reference):
        field, unit = FIELDS[column]
        stddev = getattr(estimate.stddev, side)
        if stddev is None or not column.endswith("_deg"):
            continue
        relative = error if still is None else error - error[still].mean()
        spread = unit * np.interp(as_float(reference.time), as_float(estimate.time), as_float(getattr(stddev, field)))
        inside.append(np.abs(relative[look]) <= 2.0 * spread[look])
    return float(np.mean(np.concatenate(inside)))


def named_windows(look: str) -> Callable[[Walk, Prepared[PyTree]], Windows]:
    """Windows from their names in `walk.info["windows"]`, which holds them in samples of the walk's reference.

    A walk without a window "standing" gets the standing that the estimator detected.
    """

    def windows(walk: Walk, prepared: Prepared[PyTree]) -> Windows:
        known = walk.info.get("windows") or {}
        if look not in known or walk.reference is None:
            raise RecordingError(f"the walk has no window {look!r}; it has {', '.join(known) or 'none'}")
        steps = (float(np.median(np.diff(as_float(time)))) for time in (prepared.inputs.time, walk.reference.time))
        every = round(next(steps) / next(steps))
        spans = {name: (start // every, end // every) for name, (start, end) in known.items()}
        return Windows(spans[look], spans.get("standing", prepared.standing))

    return windows
