"""The numbers of a whole recording, for people."""

from typing import NamedTuple

import numpy as np

from jgait.estimators.about import StrideFlag
from jgait.estimators.columns import COLUMNS, QUANTITIES
from jgait.estimators.combined import Analysis
from jgait.estimators.plausible import distance_implausible
from jgait.estimators.stride_flags import BREAK, STRIDE_FLAGS, marks, pauses, without
from jgait.estimators.totals import distance_of, joint_ranges
from jgait.io.strides import counted, strides_to_dataframe
from jgait.types import Estimate


class Total(NamedTuple):
    """A number of a whole recording."""

    words: str  #: what it is.
    text: str  #: the number, ± its standard deviation, with its unit.
    quantity: str = ""  #: its `Comparison.quantity`, or "".
    source: str = ""  #: the sensors that it is from, or "".


UNUSABLE = ", not usable"
"""Text behind a number that a note forbids to use."""

CAPTION = (
    "± one standard deviation, of one stride or of the distance; medians over strides that are no turns, stairs, "
    "half-steps or uneven, of lengths and speeds also without clipped and doubtful ones; stance of those that a foot's "
    "sensor measured, mean of both sides; angles: smallest … largest flexion; whole tables in the files"
)
"""Text below the numbers of `totals`."""


def totals(estimate: Estimate, flags: tuple[StrideFlag, ...], by_feet: np.ndarray | None = None) -> list[Total]:
    """The numbers of a whole recording, for people: strides, distance, medians over regular strides, ranges of angles.

    Args:
        estimate: of one recording.
        flags: flags of its strides.
        by_feet: (rows,) bool, whether a foot's sensor saw the stride, for the rows of the table of strides; a shank's
            shows the final contact too late. None: all, if the estimate has feet.
    """
    rows: list[Total] = []
    if estimate.strides is not None:
        table, marked = strides_to_dataframe(estimate), marks(estimate, flags)
        usual = counted(table, marked, flags)
        rows.append(Total("strides", f"{len(table)}, {without(marked, flags, len(table)).sum()} regular", "strides"))
        timed = len(table) > 0 and {"start_s", "end_s"} <= set(table)
        if timed:
            start, end = table["start_s"].to_numpy(float), table["end_s"].to_numpy(float)
            breaks = pauses(start, end)[pauses(start, end) > BREAK]
            lasts, bouts = np.nanmax(end) - start[0] - breaks.sum(), len(breaks) + 1
            rows.append(Total("walking", f"{lasts:.1f} s in {bouts} {'bout' if bouts == 1 else 'bouts'}"))
    if (whole := distance_of(estimate)) is not None:
        usable = "" if not distance_implausible(estimate) else UNUSABLE
        rows.append(Total("distance", COLUMNS["distance_m"].text(*whole) + usable, "distance"))
    if estimate.strides is not None and len(table):
        medians = usual.select_dtypes("number").median()
        for column in (COLUMNS[name] for name in ("stride_length_m", "walking_speed_mps", "stride_width_m")):
            if column.name != "stride_width_m" or (column.name in table and table[column.name].notna().any()):
                text = column.text(medians.get(column.name), medians.get(column.deviation))
                rows.append(Total(column.words, text, column.quantity))
        if timed:
            rows.append(Total("cadence", COLUMNS["cadence_spm"].text(120.0 / medians["stride_duration_s"])))
            stands = (usual.get("final_contact_s", np.nan) - usual["start_s"]) / usual["stride_duration_s"]
            feet = np.full(len(table), estimate.feet is not None) if by_feet is None else by_feet
            stance = 100.0 * stands[feet].groupby(usual["side"][feet]).median().mean()
            rows.append(Total("stance", f"{stance:.0f} % of the stride" if np.isfinite(stance) else "–"))
    for joint, pair in joint_ranges(estimate).items():
        if pair is not None:
            usable = estimate.diagnostics.get(f"angles_valid_{joint.split()[1]}", True)
            rows.append(Total(joint, f"{pair[0]:z.0f} … {pair[1]:z.0f} °{'' if usable else UNUSABLE}"))
    return rows


def totals_by_source(analysis: Analysis) -> list[Total]:
    """The numbers of an analysis, each with its sources, and what each of them measures alone if that is known."""
    alone: dict[str, list[str]] = {}
    for comparison in analysis.comparisons:
        if comparison.source != "combined":
            value = f"{comparison.value:.{QUANTITIES[comparison.quantity].digits}f}"
            alone.setdefault(comparison.quantity, []).append(f"{comparison.source} {value}")
    first = () if analysis.strides is None else analysis.strides.first
    known = {quantity: ", ".join(values) for quantity, values in alone.items()}
    known |= dict.fromkeys(joint_ranges(analysis.estimate), "legs")
    every = ", ".join(dict.fromkeys(first))
    return [
        total._replace(source=known.get(total.quantity or total.words, every))
        for total in totals(analysis.estimate, STRIDE_FLAGS, np.array(first) == "feet" if first else None)
    ]
