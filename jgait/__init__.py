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
    Recording,
    RecordingError,
    Strides,
    Walk,
    leg_of,
)

__version__ = "0.1.0"

__all__ = [
    "PLACEMENTS",
    "SIDES",
    "Estimate",
    "Feet",
    "FootTrajectory",
    "Imu",
    "LegTrajectory",
    "Legs",
    "Recording",
    "RecordingError",
    "Strides",
    "Walk",
    "__version__",
    "leg_of",
]
