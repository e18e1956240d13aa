"""Gait estimators from wearable sensors, differentiable, in JAX."""

from jgait.types import (
    PLACEMENTS,
    SIDES,
    Estimate,
    Feet,
    FootTrajectory,
    Imu,
    Legs,
    LegTrajectory,
    RangeReadings,
    Recording,
    RecordingError,
    Strides,
    Walk,
    leg_of,
)
from jgait.version import __version__

__all__ = [
    "PLACEMENTS",
    "SIDES",
    "Estimate",
    "Feet",
    "FootTrajectory",
    "Imu",
    "LegTrajectory",
    "Legs",
    "RangeReadings",
    "Recording",
    "RecordingError",
    "Strides",
    "Walk",
    "__version__",
    "leg_of",
]
