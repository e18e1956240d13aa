"""The strides of a report: one table for all estimators, special strides, means by side."""

import itertools
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import PyTree

from jgait import io
from jgait.estimators import stride_flags
from jgait.estimators.about import StrideFlag
from jgait.estimators.stride_flags import STRIDE_FLAGS
from jgait.io.combined import joint_extremes
from jgait.report.page import Cell, Table, cell, number
from jgait.types import SIDES, Estimate, as_float

if TYPE_CHECKING:
    import pandas as pd

KNEE_SWING = np.deg2rad(20.0)
"""[rad] Smallest prominence of a maximum of knee flexion that counts as a swing."""

SHORTEST, LONGEST = 0.6, 2.5
"""[s] Shortest and longest cycle of a walking leg; longer ones contain standing."""

FEWEST = 3
"""Smallest number of strides of each side for a comparison of the sides."""


class Measure(NamedTuple):
    """A column of the table of strides: its name, its heading, and its number format."""

    name: str
    words: str
    unit: str
    digits: int
    scale: float = 1.0
    ratio: bool = True

    @property
    def heading(self) -> str:
        """The heading with its unit."""
        return f"{self.words} [{self.unit}]"


MEASURES = (
    Measure("stride_length_m", "stride length", "m", 2),
    Measure("stride_duration_s", "stride time", "s", 2),
    Measure("cadence_spm", "cadence", "steps/min", 0),
    Measure("walking_speed_mps", "speed", "m/s", 2),
    Measure("step_length_m", "step length", "m", 2),
    Measure("stride_width_m", "stride width", "cm", 1, 100.0),
    Measure("stride_height_m", "rise", "cm", 1, 100.0, ratio=False),
    Measure("turn_deg", "turn", "°", 0, ratio=False),
    Measure("lift_m", "sensor's lift", "cm", 1, 100.0),
    Measure("contact_angle_deg", "foot angle at contact", "°", 0, ratio=False),
    Measure("push_off_angle_deg", "foot angle at push-off", "°", 0, ratio=False),
    Measure("hip_flexion_deg", "largest hip flexion", "°", 0, ratio=False),
    Measure("hip_extension_deg", "smallest hip flexion", "°", 0, ratio=False),
    Measure("knee_flexion_deg", "largest knee flexion", "°", 0, ratio=False),
    Measure("knee_stance_deg", "smallest knee flexion", "°", 0, ratio=False),
)
"""The columns of the table of strides, in order."""

CYCLES = (
    "Cycles of each leg, from the largest bend of the swinging knee to the next; the length is how far the distance "
    "grows meanwhile."
)

EXTREMES = {
    "hip_flexion_max_deg": "hip_flexion_deg", "hip_flexion_min_deg": "hip_extension_deg",
    "knee_flexion_max_deg": "knee_flexion_deg", "knee_flexion_min_deg": "knee_stance_deg",
}  # fmt: skip
"""Column of `joint_extremes` → column of the table of strides."""

NOT_AVERAGED = ("turn_deg", "stride_height_m")
NOT_BY_STRIDE = ("cadence_spm",)


class ReportStrides(NamedTuple):
    """The strides of an estimate."""

    #: a row a stride, in the order in which they start; `io.strides_to_dataframe` with `cadence_spm`.
    table: "pd.DataFrame"
    marks: dict[str, np.ndarray]  #: flag → (rows,) bool.
    flags: tuple[StrideFlag, ...]  #: meanings of the flags.
    regular: np.ndarray  #: (rows,) bool; the strides in the means.
    cycles: bool  #: whether these are cycles of leg angles instead of strides between contacts.


def strides_of(estimate: Estimate, flags: tuple[StrideFlag, ...] = STRIDE_FLAGS) -> ReportStrides:
    """The strides of an estimate, or the cycles of its leg angles, see `leg_cycles`.

    The length of a cycle is the gain of the distance in its time.
    """
    cycles = estimate.strides is None
    table = leg_cycles(estimate) if cycles else io.strides_to_dataframe(estimate)
    marks = stride_flags.marks(estimate, flags)
    if "stride_duration_s" in table:
        duration = table["stride_duration_s"].where(~marks.get("half", np.zeros(len(table), bool)))
        table = table.assign(cadence_spm=120.0 / duration)
    if not cycles:
        for name, values in joint_extremes(estimate, table).items():
            sound = [bool(estimate.diagnostics.get(f"angles_valid_{side}", True)) for side in table["side"]]
            table[EXTREMES[name]] = np.where(sound, values, np.nan)
    regular = np.ones(len(table), bool) if cycles else stride_flags.regular(estimate, flags)
    return ReportStrides(table, marks, flags, regular, cycles)


def leg_cycles(estimate: Estimate) -> "pd.DataFrame":
    """The cycles of leg angles, from the largest knee flexion of a swing to the largest of the next swing.

    Columns as of `io.strides_to_dataframe`, as far as known, and the extremes of each joint [°]. The knee flexion of a
    cycle is that of the swing at its start, so that each swing counts once; the last swing of a leg has no cycle.
    """
    import pandas as pd
    from scipy.signal import find_peaks

    time = as_float(estimate.time)
    valid = np.asarray(estimate.valid, bool)
    rows: list[dict[str, PyTree]] = []
    for side, leg in zip(SIDES, estimate.legs, strict=True):
        if leg is None or time.size < 2:
            continue
        step = float(np.median(np.diff(time)))
        told = valid & np.isfinite(as_float(leg.knee_angle))
        knee, hip = (np.where(told, as_float(angle), 0.0) for angle in (leg.knee_angle, leg.hip_angle))
        peaks = find_peaks(knee, prominence=KNEE_SWING, distance=max(1, round(SHORTEST / step)))[0]
        for a, b in itertools.pairwise(peaks):
            if time[b] - time[a] > LONGEST or not told[a : b + 1].all():
                continue
            way = None if estimate.distance is None else float(estimate.distance[b] - estimate.distance[a])
            lasts = float(time[b] - time[a])
            rows.append({
                "side": side, "start_s": time[a], "end_s": time[b],
                **({} if way is None else {"stride_length_m": way}), "stride_duration_s": lasts,
                **({} if way is None else {"walking_speed_mps": way / lasts}),
                "hip_flexion_deg": np.rad2deg(hip[a:b].max()), "hip_extension_deg": np.rad2deg(hip[a:b].min()),
                "knee_flexion_deg": np.rad2deg(knee[a]), "knee_stance_deg": np.rad2deg(knee[a:b].min()),
            })  # fmt: skip
    table = pd.DataFrame(rows, columns=list(rows[0]) if rows else ["side", "start_s", "end_s"])
    table = table.sort_values("start_s", kind="stable", ignore_index=True)
    table.insert(0, "s_id", np.arange(len(table)))
    return table


def stride_table(of: ReportStrides) -> Table:
    """All strides, a row each, with standard deviations and remarks."""
    shown = [m for m in MEASURES if m.name not in NOT_BY_STRIDE and m.name in of.table]
    known = [m for m in shown if of.table[m.name].notna().any()]
    rows: list[list[Cell]] = []
    legs = sides(of)
    for k, stride in enumerate(of.table.to_dict("records")):
        start = stride.get("start_s", stride.get("standing_s"))
        cells = [Cell(str(k + 1), k + 1.0), Cell(legs[k] or "–"), cell(start, 2)]
        for measure in known:
            name, _, unit = measure.name.rpartition("_")
            spread = stride.get(f"{name}_std_{unit}")
            spread = None if spread is None else measure.scale * spread
            cells.append(cell(measure.scale * stride[measure.name], measure.digits, spread))
        words = [flag.label for flag in of.flags if flag.name in of.marks and of.marks[flag.name][k]]
        rows.append([*cells, Cell(", ".join(words))])
    spread = any("_std_" in name for name in of.table)
    caption = CYCLES if of.cycles else "Strides, from one contact of a foot to its next."
    caption += " ± is one standard deviation, as the estimator states it." if spread else ""
    caption += " A click on a heading sorts."
    return Table(caption, ("no.", "leg", "start [s]", *(m.heading for m in known), "remarks"), rows, True, 1)


def sides(of: ReportStrides) -> np.ndarray:
    """(rows,) the side of each stride, "" where it is not known."""
    side = of.table["side"].to_numpy(object)
    return np.where(of.marks.get(stride_flags.SIDE_UNKNOWN.name, np.zeros(len(side), bool)), "", side)


def means(of: ReportStrides) -> list[dict[str, PyTree]]:
    """Mean, standard deviation and number over the regular strides, of all and of each side, where it is known.

    Returns:
        A row a measure: "name", "unit", "all", "right", "left" (each "mean", "sd", "n", or None), "difference" of
        right − left and "difference_percent" of their mean, None where not both sides are known.
    """
    rows = []
    for measure in MEASURES:
        if measure.name in NOT_AVERAGED or measure.name not in of.table:
            continue
        values = of.table[measure.name].to_numpy(float)
        use = of.regular & np.isfinite(values)
        for flag in of.flags:
            if measure.name in flag.leaves_out and flag.name in of.marks:
                use &= ~of.marks[flag.name]
        if not use.any():
            continue
        side = sides(of)
        row: dict[str, Any] = {"name": measure.name, "unit": measure.name.rpartition("_")[2], "all": _mean(values[use])}
        for name in SIDES:
            row[name] = _mean(values[use & (side == name)])
        row |= {"difference": None, "difference_percent": None}
        if all(row[name] is not None and row[name]["n"] >= FEWEST for name in SIDES):
            right, left = row["right"]["mean"], row["left"]["mean"]
            row["difference"] = right - left
            row["difference_percent"] = 200.0 * (right - left) / (right + left) if measure.ratio else None
        rows.append(row)
    return rows


def _mean(values: np.ndarray) -> dict[str, Any] | None:
    if not values.size:
        return None
    sd = float(np.std(values, ddof=1)) if values.size > 1 else None
    return {"mean": float(np.mean(values)), "sd": sd, "n": int(values.size)}


def mean_text(mean: dict[str, Any] | None, measure: Measure) -> str:
    """A mean with its standard deviation between strides."""
    if mean is None:
        return "–"
    spread = "" if mean["sd"] is None else f" ± {number(measure.scale * mean['sd'], max(measure.digits, 1))}"
    return number(measure.scale * mean["mean"], measure.digits) + spread


def mean_table(of: ReportStrides, rows: list[dict[str, PyTree]]) -> Table:
    """Table of the means of all regular strides and of each side, and of the differences between the sides."""
    known = {m.name: m for m in MEASURES}
    sides = [name for name in SIDES if any(row[name] is not None for row in rows)]
    both = any(row["difference"] is not None for row in rows)
    made = []
    for row in rows:
        measure = known[row["name"]]
        cells = [
            Cell(measure.heading),
            Cell(mean_text(row["all"], measure)),
            *(Cell(mean_text(row[s], measure)) for s in sides),
        ]
        if both:
            cells.append(Cell(_difference(row, measure)))
        made.append([*cells, Cell(str(row["all"]["n"]))])
    columns = ["", "all", *(f"{side} leg" for side in sides), *(["right − left"] if both else []), "strides"]
    left_out = sorted(f.label for f in of.flags if not f.regular and f.name in of.marks and of.marks[f.name].any())
    caption = "Mean ± standard deviation from stride to stride" + (
        f"; left out: {', '.join(left_out)}." if left_out else "."
    )
    if both:
        caption += " Right − left in percent of the mean of both."
    return Table(caption, columns, made)


def _difference(row: dict[str, Any], measure: Measure) -> str:
    if row["difference"] is None:
        return "–"
    value = number(measure.scale * row["difference"], measure.digits)
    percent = row["difference_percent"]
    return value if percent is None else f"{value} ({number(percent, 1)} %)"
