"""Measures, totals and figures that several estimators share in their `about`."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from jaxtyping import PyTree

from jgait.estimators.about import BodyMeasure, CommandOption, EstimateFigure, MissingMeasure, StrideFlag
from jgait.estimators.columns import COLUMNS
from jgait.estimators.plausible import distance_implausible
from jgait.estimators.stride_flags import BREAK, durations, in_order, marks, pauses, regular
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
        raise ValueError(f"--option level is {', '.join(LEVELS)}; got {text!r}")
    return LEVELS[text]


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


class Total(NamedTuple):
    """A number of a whole recording: what it is in words, the number as text, and its `Comparison.quantity` or ""."""

    words: str
    text: str
    quantity: str = ""


UNUSABLE = ", not usable"
"""Text behind a number that a note forbids to use."""

CAPTION = (
    "± one standard deviation, of one stride or of the distance; medians over regular strides (no turns, stairs, "
    "half-steps, clipped swings, uneven or doubtful ones), stance of those that a foot's sensor saw, mean of both "
    "sides; angles: smallest … largest flexion; whole tables in the files"
)
"""Text below the numbers of `totals`."""


def totals(estimate: Estimate, flags: tuple[StrideFlag, ...], seen: np.ndarray | None = None) -> list[Total]:
    """The numbers of a whole recording, for people: strides, distance, medians over regular strides, ranges of angles.

    Args:
        estimate: of one recording.
        flags: flags of its strides.
        seen: (strides,) bool, whether a foot's sensor saw the stride; a shank's shows the final contact too late. None:
            all, if the estimate has feet.
    """
    rows: list[Total] = []
    strides, spread = estimate.strides, estimate.strides_stddev
    order = np.zeros(0, int) if strides is None else in_order(estimate)
    usual = order[regular(estimate, flags)] if strides is not None else order
    if strides is not None:
        rows.append(Total("strides", f"{order.size}, {usual.size} regular", "strides"))
        words = {flag.name: flag.word for flag in flags}
        counts = {words[name]: int(flagged.sum()) for name, flagged in marks(estimate, flags).items()}
        special = ", ".join(f"{count} {word}" for word, count in counts.items() if count)
        rows += [Total("special strides", special)] if special else []
    if order.size and strides.start is not None and strides.end is not None:
        start, end = as_float(strides.start)[order], as_float(strides.end)[order]
        breaks = pauses(start, end)[pauses(start, end) > BREAK]
        lasts, bouts = np.nanmax(end) - start[0] - breaks.sum(), len(breaks) + 1
        rows.append(Total("walking", f"{lasts:.1f} s in {bouts} {'bout' if bouts == 1 else 'bouts'}"))
    if (whole := distance_of(estimate)) is not None:
        usable = "" if not distance_implausible(estimate) else UNUSABLE
        rows.append(Total("distance", COLUMNS["distance_m"].text(*whole) + usable, "distance"))
    for field, name in (("length", "stride_length_m"), ("speed", "walking_speed_mps"), ("width", "stride_width_m")):
        values, stated = (None if table is None else getattr(table, field) for table in (strides, spread))
        there, column = usual, COLUMNS[name]
        if field == "width" and order.size:
            trusted = np.asarray(estimate.diagnostics.get("width_valid", np.ones(np.size(strides.side))), bool)
            there = usual[trusted[usual]]
        if order.size and (field != "width" or (values is not None and np.isfinite(as_float(values)).any())):
            text = column.text(median(values, there), median(stated, there))
            rows.append(Total(column.words, text, "" if field == "width" else column.quantity))
    if order.size and strides.start is not None and strides.end is not None:
        lasts = durations(strides)
        lasted = median(lasts, usual)
        rows.append(Total("cadence", "–" if lasted is None else f"{120.0 / lasted:.0f} steps/min"))
        feet = np.full(lasts.size, estimate.feet is not None) if seen is None else seen
        toe_off = np.nan if strides.final_contact is None else as_float(strides.final_contact)
        stands, sides = (toe_off - as_float(strides.start)) / lasts, np.asarray(strides.side)
        both = [median(stands, usual[feet[usual] & (sides[usual] == side)]) for side in range(len(SIDES))]
        stance = median([of_side for of_side in both if of_side is not None])  # of two, the mean
        rows.append(Total("stance", "–" if stance is None else f"{100.0 * stance:.0f} % of the stride"))
    for joint, pair in joint_ranges(estimate).items():
        if pair is not None:
            usable = estimate.diagnostics.get(f"angles_valid_{joint.split()[1]}", True)
            rows.append(Total(joint, f"{pair[0]:z.0f} … {pair[1]:z.0f} °{'' if usable else UNUSABLE}"))
    return rows


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
    for side in SIDES:
        for joint in ("hip", "knee"):
            angle = stated_angle(estimate, side, joint)
            ranges[f"{joint} {side}"] = (float(angle.min()), float(angle.max())) if angle.size else None
    return ranges


def stated_angle(estimate: Estimate, side: str, joint: str) -> np.ndarray:
    """(n,) flexion of a joint, "hip" or "knee", at the samples at which it is stated, before a sensor slipped [°]."""
    if (leg := getattr(estimate.legs, side)) is None:
        return np.zeros(0)
    angle = np.degrees(as_float(getattr(leg, f"{joint}_angle")))
    holds = np.asarray(estimate.valid, bool) & ~np.asarray(estimate.diagnostics.get(f"slipped_{side}", False), bool)
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
