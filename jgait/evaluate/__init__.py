"""Errors and agreement of estimates, for one recording and for a cohort; on the host, in NumPy and pandas."""

from jgait.evaluate.buckets import judged
from jgait.evaluate.cohort import cohort
from jgait.evaluate.errors import (
    FIELDS,
    DistanceError,
    PositionError,
    Window,
    distance_error,
    foot_position_error,
    trajectory_errors,
    yaw_aligned,
)
from jgait.evaluate.scores import Scores
from jgait.evaluate.statistics import (
    AGREEMENT,
    Icc,
    Limits,
    PairedDifference,
    agreement,
    icc21,
    limits_of_agreement,
    paired_difference,
    with_errors,
)
from jgait.evaluate.store import Cohort

__all__ = [
    "AGREEMENT", "FIELDS", "Cohort", "DistanceError", "Icc", "Limits", "PairedDifference", "PositionError", "Scores",
    "Window", "agreement", "cohort", "distance_error", "foot_position_error", "icc21", "judged", "limits_of_agreement",
    "paired_difference", "trajectory_errors", "with_errors", "yaw_aligned",
]  # fmt: skip
