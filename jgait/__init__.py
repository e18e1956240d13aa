"""Gait estimators from wearable sensors, differentiable, in JAX."""

import importlib
from typing import TYPE_CHECKING, Any

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
    )  # fmt: skip

__version__ = "0.1.0"

__all__ = [
    "PLACEMENTS", "SIDES", "Analysis", "Estimate", "Feet", "FootTrajectory", "Imu", "LegTrajectory", "Legs", "News",
    "Online", "RangeReadings", "Recording", "RecordingError", "Strides", "Walk", "__version__", "analyse", "leg_of",
    "online",
]  # fmt: skip

_MODULES = {"Analysis": "estimators.combined", "analyse": "estimators.combined"}
_MODULES |= dict.fromkeys(("News", "Online", "online"), "estimators.online")


def __getattr__(name: str) -> Any:
    """A public name or `types`, imported, and JAX with it, when it is first asked for."""
    if name != "types" and name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = importlib.import_module(f"jgait.{_MODULES.get(name, 'types')}")
    return module if name == "types" else getattr(module, name)
