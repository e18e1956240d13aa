"""Measures, totals and figures that several estimators share in their `about`."""

import numpy as np
import numpy.typing as npt
from jaxtyping import PyTree

from jgait.estimators.about import BodyMeasure, CommandOption, EstimateFigure, MissingMeasure, TotalColumn
from jgait.types import SIDES, Estimate, as_float

THIGH = BodyMeasure("thigh_length", "m", 0.2, 0.7, "thigh length, hip to knee", "--thigh", 0.43)
SHANK = BodyMeasure("shank_length", "m", 0.2, 0.7, "shank length, knee to ankle", "--shank", 0.43)
HEIGHT = BodyMeasure("height", "m", 0.8, 2.4, "height of the person", "--height")
NO_LENGTHS = MissingMeasure(
    ("thigh_length", "shank_length"),
    "the default length of 0.43 m is taken, and distances are in proportion to it",
)  # fmt: skip
PIVOT = BodyMeasure(
    "pivot_height", "m", 0.0, 0.3, "height of the sensor over the ball of the foot", "--pivot", 0.08
)  # fmt: skip

LEVELS: dict[str, bool | str] = {"auto": "auto", "yes": True, "no": False}
"""Word of the command line → `FootOptions.level`."""


def level_of(text: str) -> bool | str:
    """`FootOptions.level` for a word of the command line. Raises ValueError if the word is not in `LEVELS`."""
    if text not in LEVELS:
        raise ValueError(f"--level is {', '.join(LEVELS)}; got {text!r}")
    return LEVELS[text]


LEVEL = CommandOption(
    "--level", "whether the ground is level: yes, no, or auto, which the rise of the strides decides.", str,
    parse=level_of,
)  # fmt: skip
"""The option without `settings`, which each estimator adds."""

DURATION = TotalColumn("duration_s", "duration", "s", 1)
DISTANCE = TotalColumn("distance_m", "distance", "m")
JOINT_COLUMNS = tuple(TotalColumn(f"{joint}_{side}_deg", f"{joint} {side}", "°", 0)
                      for side in SIDES for joint in ("hip", "knee"))  # fmt: skip
MEDIANS = (TotalColumn("stride_length_m", "length", "m"), TotalColumn("walking_speed_mps", "speed", "m/s"))


def has_strides(estimate: Estimate) -> bool:
    """True if any stride is valid."""
    return estimate.strides is not None and bool(np.any(estimate.strides.valid))


def has_legs(estimate: Estimate) -> bool:
    """True if the angles of any leg are estimated."""
    return any(leg is not None for leg in estimate.legs)


JOINT_ANGLES = EstimateFigure("joint_angles", "angles")
FOOT_PATH = EstimateFigure("foot_path", "foot_path")
WAY = EstimateFigure("distance", "distance")
LEG_STRIDES = EstimateFigure("leg_strides", "strides", has_strides)


def duration(estimate: Estimate) -> float:
    """Time from the first to the last sample [s]."""
    return float(estimate.time[-1] - estimate.time[0])


def distance(estimate: Estimate) -> float | None:
    """Distance walked [m]; None if it is not estimated."""
    return None if estimate.distance is None else float(estimate.distance[-1])


def joint_ranges(estimate: Estimate) -> dict[str, tuple[float, float] | None]:
    """Smallest and largest flexion [°] of each joint; None for a leg without sensors."""
    found: dict[str, tuple[float, float] | None] = {}
    for side, leg in zip(SIDES, estimate.legs, strict=True):
        for joint in ("hip", "knee"):
            angle = None if leg is None else np.degrees(as_float(getattr(leg, f"{joint}_angle")))
            found[f"{joint}_{side}_deg"] = None if angle is None else (float(np.min(angle)), float(np.max(angle)))
    return found


def median(values: npt.ArrayLike, rows: PyTree = slice(None)) -> float | None:
    """Median of the finite values; None if there are none."""
    if values is None:
        return None
    known = as_float(values)[rows]
    known = known[np.isfinite(known)]
    return float(np.median(known)) if known.size else None
