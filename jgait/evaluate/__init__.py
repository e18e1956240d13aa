"""How good an estimate is, for one recording and for a cohort; on the host, in NumPy and pandas."""

from jgait.evaluate.errors import (
    FIELDS,
    DistanceError,
    Window,
    bootstrap_interval,
    distance_error,
    summary,
    trajectory_errors,
)

__all__ = [
    "FIELDS",
    "DistanceError",
    "Window",
    "bootstrap_interval",
    "distance_error",
    "summary",
    "trajectory_errors",
]
