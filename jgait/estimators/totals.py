"""Measures, totals and figures that several estimators share in their `about`."""

import itertools

import numpy as np
import numpy.typing as npt
from jaxtyping import PyTree

from jgait.estimators.about import BodyMeasure, CommandOption, EstimateFigure, MissingMeasure
from jgait.estimators.proportions import HEIGHTS
from jgait.types import SIDES, Estimate, as_float

THIGH, SHANK = (
    BodyMeasure(f"{name}_length", "m", 0.2, 0.7, f"{name} length, {ends}", f"--{name}", 0.43)
    for name, ends in (("thigh", "hip to knee"), ("shank", "knee to ankle"))
)
"""[m] Ranges of adults and children, and the length that is used where none is given; chosen by hand."""

HEIGHT = BodyMeasure("height", "m", *HEIGHTS, "height of the person", "--height")
NO_LENGTHS = MissingMeasure(
    ("thigh_length", "shank_length"),
    "the default length of 0.43 m is taken, and distances are in proportion to it",
)  # fmt: skip
PIVOT = BodyMeasure(
    "pivot_height", "m", 0.0, 0.3, "height of the sensor over the ball of the foot", "--pivot", 0.08
)  # fmt: skip
"""[m] Range of a sensor on a shoe, chosen by hand; the default is that of `FootParams`."""


def level_of(text: str) -> bool | str:
    """`FootOptions.level` for a word of the command line. Raises ValueError for another word."""
    levels: dict[str, bool | str] = {"auto": "auto", "yes": True, "no": False}
    if text not in levels:
        raise ValueError(f"--option level is {', '.join(levels)}; got {text!r}")
    return levels[text]


LEVEL = CommandOption(
    "--level", "whether the ground is level: yes, no, or auto, which the rise of the strides decides.", str,
    parse=level_of,
)  # fmt: skip
"""The option without `settings`, which each estimator adds."""


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


def distance_of(estimate: Estimate) -> tuple[float, float | None] | None:
    """Distance walked [m], and its standard deviation if the estimate has one; None without a distance."""
    if estimate.distance is None:
        return None
    way = as_float(estimate.distance)
    known = way[np.asarray(estimate.valid, bool) & np.isfinite(way)]
    known = known if known.size else way
    spread = estimate.diagnostics.get("distance_stddev")
    return float(known[-1] - known[0]), None if spread is None or not np.size(spread) else float(np.ravel(spread)[-1])


def joint_ranges(estimate: Estimate) -> dict[str, tuple[float, float] | None]:
    """Joint and side → smallest and largest flexion [°] where it is stated; None where it never is."""
    ranges: dict[str, tuple[float, float] | None] = {}
    for side, joint in itertools.product(SIDES, ("hip", "knee")):
        angle = stated_angle(estimate, side, joint)
        ranges[f"{joint} {side}"] = (float(angle.min()), float(angle.max())) if angle.size else None
    return ranges


def stated_angle(estimate: Estimate, side: str, joint: str) -> np.ndarray:
    """(n,) flexion of a joint, "hip" or "knee", at the samples at which it is stated, before a sensor slipped [°]."""
    if (leg := getattr(estimate.legs, side)) is None:
        return np.zeros(0)
    angle, slipped = np.degrees(as_float(getattr(leg, f"{joint}_angle"))), estimate.diagnostics.get(f"slipped_{side}")
    holds = np.asarray(estimate.valid, bool) & (slipped is None or ~np.asarray(slipped, bool))
    return np.asarray(angle[holds & np.isfinite(angle)])


def angles_usable(estimate: Estimate, side: str) -> np.ndarray:
    """(T,) bool, whether joint angles of a side are usable: unless notes say that they are not, or a sensor slipped."""
    usable = bool(estimate.diagnostics.get(f"angles_valid_{side}", True))
    slipped = np.asarray(estimate.diagnostics.get(f"slipped_{side}", False), bool)
    return np.asarray(np.broadcast_to(usable & ~slipped, np.shape(estimate.time)))


def median(values: npt.ArrayLike | None, rows: PyTree = slice(None)) -> float | None:
    """Median of the finite values; None if there are none."""
    if values is None:
        return None
    known = as_float(values)[rows]
    known = known[np.isfinite(known)]
    return float(np.median(known)) if known.size else None
