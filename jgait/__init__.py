"""Gait estimators from wearable sensors, differentiable, in JAX."""

import importlib
from typing import TYPE_CHECKING, Any

from jgait.version import __version__

if TYPE_CHECKING:
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


def __getattr__(name: str) -> Any:
    """A name of `jgait.types`, which is imported, and JAX with it, when the first of them is asked for."""
    if name == "types" or name in __all__:
        module = importlib.import_module("jgait.types")
        return module if name == "types" else getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
