"""The strides of a report: one table for all estimators, special strides, means by side."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jgait import io
from jgait.estimators import stride_flags
from jgait.estimators.columns import COLUMNS, QUANTITIES, Column
from jgait.estimators.cycles import swing_cycles
from jgait.estimators.stride_flags import STRIDE_FLAGS
from jgait.io.combined import angles_sound, joint_extremes
from jgait.io.summary import CONTACTS, summary
from jgait.report.page import Cell, Table, cell, number
from jgait.types import SIDES, Estimate, as_float

if TYPE_CHECKING:
    import pandas as pd


CYCLES = (
    "Cycles of each leg, from the largest bend of the swinging knee to the next; the length is how far the distance "
    "grows meanwhile."
)


class ReportStrides(NamedTuple):
    """The strides of an estimate."""

    #: a row a stride, in the order in which they start; `io.strides_to_dataframe` with `cadence_spm`.
    table: "pd.DataFrame"
    marks: dict[str, np.ndarray]  #: flag of `STRIDE_FLAGS` → (rows,) bool.
    regular: np.ndarray  #: (rows,) bool; the strides in the means.
    cycles: bool  #: whether these are cycles of leg angles instead of strides between contacts.
    source: str  #: "feet" for strides of shoes, whose contacts are those of both sides alike.


def strides_of(estimate: Estimate) -> ReportStrides:
    """The strides of an estimate, or the cycles of its leg angles, see `leg_cycles`."""
    cycles = estimate.strides is None
    table = leg_cycles(estimate) if cycles else io.strides_to_dataframe(estimate)
    marks = stride_flags.marks(estimate, STRIDE_FLAGS)
    if "stride_duration_s" in table:
        duration = table["stride_duration_s"].where(~marks.get("half", np.zeros(len(table), bool)))
        table = table.assign(cadence_spm=120.0 / duration)
    if not cycles:
        for name, values in joint_extremes(estimate, table).items():
            table[name] = np.where(angles_sound(estimate, table), values, np.nan)
    regular = stride_flags.without(marks, STRIDE_FLAGS, len(table))
    return ReportStrides(table, marks, regular, cycles, "legs" if estimate.feet is None else CONTACTS)


def leg_cycles(estimate: Estimate) -> "pd.DataFrame":
    """The cycles of leg angles, from the largest knee flexion of a swing to the largest of the next swing.

    Columns as of `io.strides_to_dataframe`, as far as known, and the extremes of each joint [°]. The length of a cycle
    is the gain of the distance in its time. The knee flexion of a cycle is that of the swing at its start, so that each
    swing counts once; the last swing of a leg has no cycle.
    """
    import pandas as pd

    time = as_float(estimate.time)
    way = np.full(time.size, np.nan) if estimate.distance is None else as_float(estimate.distance)
    rows = []
    for side, leg in zip(SIDES, estimate.legs, strict=True):
        if leg is None:
            continue
        for a, b in swing_cycles(time, leg, estimate.valid):
            knee, hip = (np.rad2deg(as_float(angle)[a:b]) for angle in (leg.knee_angle, leg.hip_angle))
            rows.append({
                "side": side, "start_s": time[a], "end_s": time[b], "stride_length_m": way[b] - way[a],
                "stride_duration_s": time[b] - time[a], "walking_speed_mps": (way[b] - way[a]) / (time[b] - time[a]),
                "hip_flexion_max_deg": hip.max(), "hip_flexion_min_deg": hip.min(),
                "knee_flexion_max_deg": knee[0], "knee_flexion_min_deg": knee.min(),
            })  # fmt: skip
    table = (
        pd.DataFrame(rows).dropna(axis="columns", how="all")
        if rows
        else pd.DataFrame(columns=["side", "start_s", "end_s"])
    )
    table = table.sort_values("start_s", kind="stable", ignore_index=True)
    table.insert(0, "s_id", np.arange(len(table)))
    return table


def stride_table(of: ReportStrides) -> Table:
    """All strides, a row each, with standard deviations and remarks."""
    shown = [m for m in COLUMNS.values() if m.listed and m.name != "cadence_spm" and m.name in of.table]
    known = [m for m in shown if of.table[m.name].notna().any()]
    rows: list[list[Cell]] = []
    legs = sides(of)
    for k, stride in enumerate(of.table.to_dict("records")):
        start = stride.get("start_s", stride.get("standing_s"))
        cells = [Cell(str(k + 1), k + 1.0), Cell(legs[k] or "–"), cell(start, 2)]
        for measure in known:
            spread = measure.scale * stride.get(measure.deviation, np.nan)
            cells.append(cell(measure.scale * stride[measure.name], measure.digits, spread))
        words = [flag.label for flag in STRIDE_FLAGS if flag.name in of.marks and of.marks[flag.name][k]]
        rows.append([*cells, Cell(", ".join(words))])
    spread = any("_std_" in name for name in of.table)
    caption = CYCLES if of.cycles else "Strides, from one contact of a foot to its next."
    caption += " ± is one standard deviation of the error, by the estimator." if spread else ""
    caption += " A click on a heading sorts."
    return Table(caption, ("no.", "leg", "start [s]", *(m.heading for m in known), "remarks"), rows, True, 1)


def sides(of: ReportStrides) -> np.ndarray:
    """(rows,) the side of each stride, "" where it is not known."""
    side = of.table["side"].to_numpy(object)
    return np.where(of.marks.get(stride_flags.SIDE_UNKNOWN.name, np.zeros(len(side), bool)), "", side)


def means(of: ReportStrides) -> "pd.DataFrame":
    """The summary of the strides, see `io.summary.summary`; flagged strides lack what their flag leaves out."""
    means = io.strides.counted(of.table, of.marks, STRIDE_FLAGS)
    return summary(means.assign(source=of.source, side_known=sides(of) != ""))


def mean_text(row: dict[str, Any], measure: Column) -> str:
    """The mean of a row of `means` with its standard deviation between strides."""
    spread = f" ± {number(measure.scale * row['std'], max(measure.digits, 1))}" if np.isfinite(row["std"]) else ""
    return number(measure.scale * row["mean"], measure.digits) + spread


def mean_table(rows: "pd.DataFrame") -> Table:
    """Table of the means of strides and of each side, and of the differences between the sides; from `means`. It has no
    rows if no stride counts.
    """
    both = bool(rows["asymmetry_pct"].notna().any())
    made = []
    for row in rows.to_dict("records"):
        measure = QUANTITIES[row["measure"]]
        if not measure.listed:  # the distance and ranges of motion: the page shows them, or their two ends, elsewhere
            continue
        cells = [Cell(measure.heading), Cell(mean_text(row, measure))]
        cells += [cell(measure.scale * row[side], measure.digits) for side in SIDES]
        cells.append(cell(measure.scale * row["error_std"], max(measure.digits, 1)))
        if both:
            spread = row["asymmetry_std_pct"]
            cells.append(cell(row["asymmetry_pct"], 1, spread))
        made.append([*cells, Cell(str(row["n_strides"]))])
    columns = ["", "mean ± SD", *(f"{side} leg" for side in SIDES), "error of a stride",
               *(["asymmetry [%]"] if both else []), "strides"]  # fmt: skip
    caption = (
        "Steady strides: regular ones between regular ones." if rows.loc[rows["measure"] != "distance", "steady"].all()
        else "Regular strides: there are too few steady ones for variability and asymmetry."
    ) + (
        " SD: from stride to stride within a side. Error of a stride: its standard deviation by the estimator. The SD "
        "contains this error; an SD that is not clearly larger says little about the person."
    )  # fmt: skip
    if both:
        caption += " Asymmetry: (right − left) / mean, ± one SD; within two of them it may be the sensors' error."
    return Table(caption, columns, made)
