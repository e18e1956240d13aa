"""Gait estimators from wearable sensors, differentiable, in JAX."""

import importlib
from typing import TYPE_CHECKING, Any

from jgait.version import __version__

if TYPE_CHECKING:
    from jgait.estimators.combined import Analysis, analyse
    from jgait.estimators.online import News, Online, online
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
    "Analysis",
    "Estimate",
    "Feet",
    "FootTrajectory",
    "Imu",
    "LegTrajectory",
    "Legs",
    "News",
    "Online",
    "RangeReadings",
    "Recording",
    "RecordingError",
    "Strides",
    "Walk",
    "__version__",
    "analyse",
    "leg_of",
    "online",
]


def __getattr__(name: str) -> Any:
    """A public name or `types`, imported, and JAX with it, when it is first asked for."""
    if name in ("Analysis", "analyse"):
        return getattr(importlib.import_module("jgait.estimators.combined"), name)
    if name in ("News", "Online", "online"):
        return getattr(importlib.import_module("jgait.estimators.online"), name)
    if name == "types" or name in __all__:
        module = importlib.import_module("jgait.types")
        return module if name == "types" else getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
