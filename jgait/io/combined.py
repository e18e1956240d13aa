"""The tables of an analysis of all sensors: strides, their summary, contacts, walking bouts, sources, samples."""

import itertools
from typing import TYPE_CHECKING

import numpy as np

from jgait.estimators.columns import QUANTITIES
from jgait.estimators.stride_flags import SIDE_UNKNOWN, STRIDE_FLAGS, marks
from jgait.estimators.totals import angles_usable
from jgait.io.strides import bout_numbers, counted, special, strides_to_dataframe
from jgait.io.summary import SUMMARY, summary
from jgait.io.write import to_dataframe
from jgait.types import SIDES, Estimate, as_float

if TYPE_CHECKING:
    import pandas as pd

    from jgait.estimators.combined import Analysis, JoinedStrides

BESIDE_S = 1.0
"""[s] Time before the first and after the last stride of a bout that is part of it."""

STRIDES = [
    "s_id", "side", "start_s", "final_contact_s", "end_s", "stride_length_m", "stride_length_std_m",
    "stride_duration_s", "walking_speed_mps", "hip_flexion_min_deg", "hip_flexion_max_deg", "hip_flexion_range_deg",
    "knee_flexion_min_deg", "knee_flexion_max_deg", "knee_flexion_range_deg", "angles_valid", "wb_id", "source",
    "combined", "special", "regular",
]  # fmt: skip
BOUTS = ["wb_id", "start_s", "end_s", "duration_s", "n_strides", "n_regular", "distance_m", "distance_std_m",
         "stride_length_m", "walking_speed_mps", "cadence_spm"]  # fmt: skip
SOURCES = ["quantity", "unit", "source", "value", "std", "n_strides"]
"""Columns of tables without rows; with rows, the table of strides has those that its sensors measure."""


def analysis_to_dataframes(analysis: "Analysis") -> "dict[str, pd.DataFrame]":
    """The tables of an analysis; without strides, those of strides, their summary and bouts have no rows.

    `strides`: columns of `strides_to_dataframe`, then `stance_duration_s swing_duration_s`, smallest and largest
    `hip_flexion_…_deg knee_flexion_…_deg` in the stride where thigh and shank are measured and the range between them,
    with their deviations `…_std_deg`, see `joint_extremes`, `angles_valid`, False if these angles are
    not usable, `wb_id` of the walking bout, `source` of the times, `combined` sources of the length,
    `special` flags in words, and `regular`, True if the stride counts in medians of all columns: not in a turn, on
    stairs, from or to standing, clipped, uneven, or in doubt. A clipped or doubtful stride counts in those of times. A
    regular stride can have other flags, such as "sources contradict".
    `summary`: mean, variability and asymmetry of each measure over the steady strides, and the distance, see
    `io.summary.summary`.
    `contacts`: `time_s side event source`, initial and final contacts; side "unknown" where it is not certain.
    `bouts`: `wb_id start_s end_s duration_s n_strides n_regular distance_m distance_std_m stride_length_m
    walking_speed_mps cadence_spm`; a bout ends with a break of more than 3 s; lengths and speeds are medians
    over its `n_regular` regular strides, the cadence also over clipped and doubtful ones; they say little about a bout
    on stairs or in turns; `distance_m` is the bout's part of the combined distance. The bouts add up to it, unless
    samples are lost between them. `distance_std_m` is the same part of the distance's deviation: as there, errors of
    strides are taken to have one cause, so that they add up. Errors of single strides do not, and a bout of a few
    strides can be off by more.
    `sources`: `quantity unit source value std n_strides`, each quantity as each source measures it, and combined.
    `samples`: columns of `to_dataframe`.
    """
    import pandas as pd

    empty = {"strides": STRIDES, "summary": SUMMARY, "bouts": BOUTS}
    tables = {name: pd.DataFrame(columns=columns) for name, columns in empty.items()}
    if analysis.strides is not None:
        every = _strides(analysis, analysis.strides)
        tables["strides"] = every.dropna(axis="columns", how="all")
        whole = [(comparison.value, comparison.stddev) for comparison in analysis.comparisons
                 if (comparison.source, comparison.quantity) == ("combined", "distance")]  # fmt: skip
        marked = marks(analysis.estimate, STRIDE_FLAGS)
        means, unknown = counted(every, marked, STRIDE_FLAGS), marked.get(SIDE_UNKNOWN.name, np.zeros(len(every), bool))
        tables["summary"] = summary(
            means.dropna(axis="columns", how="all").assign(side_known=~unknown), whole[0] if whole else None,
            bool(analysis.estimate.diagnostics.get("clocks_apart", False)),
        )  # fmt: skip
        tables["bouts"] = _bouts(means.assign(regular=every["regular"]), analysis.estimate)
    tables["contacts"] = _contacts(analysis)
    rows = [
        (c.quantity, QUANTITIES[c.quantity].unit, c.source, c.value, c.stddev, c.strides) for c in analysis.comparisons
    ]
    tables["sources"] = pd.DataFrame(rows, columns=SOURCES)
    tables["samples"] = to_dataframe(analysis.estimate)
    return tables


def _strides(analysis: "Analysis", joined: "JoinedStrides") -> "pd.DataFrame":
    from jgait.estimators.combined.compare import regular

    estimate = analysis.estimate
    table = strides_to_dataframe(estimate)
    table["stance_duration_s"], table["swing_duration_s"] = np.nan, np.nan
    if "final_contact_s" in table:
        stance = table["final_contact_s"] - table["start_s"]
        table["stance_duration_s"] = stance.where(stance > 0.0)
        table["swing_duration_s"] = table["end_s"] - table["final_contact_s"]
    extremes = joint_extremes(estimate, table)
    for name, values in extremes.items():
        table[name] = values
    if extremes:
        judged = [f"angles_valid_{side}" in estimate.diagnostics for side in table["side"]]
        table["angles_valid"] = angles_sound(estimate, table) & judged
    table["wb_id"] = bout_numbers(table["start_s"].to_numpy(), table["end_s"].to_numpy())
    table["source"] = list(joined.first)
    table["combined"] = ["+".join(name for name, used in joined.used.items() if used[i]) for i in range(len(table))]
    table["special"] = special(estimate, STRIDE_FLAGS, **{"sources contradict": joined.contradicts})
    table["regular"] = regular(joined)
    return table


def angles_sound(estimate: Estimate, table: "pd.DataFrame") -> np.ndarray:
    """(strides,) bool, whether joint angles of the stride's leg are usable all over it."""
    time, usable = as_float(estimate.time), {side: angles_usable(estimate, side) for side in SIDES}
    spans = zip(table["side"], table["start_s"], table["end_s"], strict=True)
    return np.array([usable[side][(time >= start) & (time <= end)].all() for side, start, end in spans], bool)


def joint_extremes(estimate: Estimate, table: "pd.DataFrame") -> dict[str, np.ndarray]:
    """Smallest and largest flexion of hip and knee [°] in each stride, of its own leg, and the range between them; NaN
    where a sample lacks. Each has its standard deviation if the estimate states that of the angles.

    The deviation of the smallest or largest is that of its sample: it is mostly of the standing pose, and so the same
    in all strides. That of a range takes the errors of both samples as not correlated. The part of the standing pose
    cancels in a range, so that the deviation is too large by it. Without this part it would be too small on the
    recording with motion capture, where soft tissue moves more than the estimate states, and makes ranges of the knee
    too large in every stride.
    """
    extremes: dict[str, np.ndarray] = {}
    time = as_float(estimate.time)
    for side, leg, spread in zip(SIDES, estimate.legs, estimate.stddev or (None, None), strict=True):
        if leg is None:
            continue
        known = np.asarray(estimate.valid, bool) & np.isfinite(as_float(leg.knee_angle))
        for row in np.flatnonzero(table["side"] == side):
            there = (time >= table["start_s"].iloc[row]) & (time <= table["end_s"].iloc[row])
            if not there.any() or not known[there].all():  # the extreme may lie where there is no angle
                there = np.zeros_like(there)
            for joint in ("hip", "knee"):
                angles = [
                    as_float(getattr(leg_or_stddev, f"{joint}_angle"))[there]
                    for leg_or_stddev in (leg, spread)
                    if leg_or_stddev is not None
                ]
                angles = [np.rad2deg(angle) if angle.size else np.full(1, np.nan) for angle in angles]
                first, last = np.argmin(angles[0]), np.argmax(angles[0])
                low, high = [angle[first] for angle in angles], [angle[last] for angle in angles]
                between = [high[0] - low[0], *np.hypot(low[1:], high[1:])]
                for word, values in (("min", low), ("max", high), ("range", between)):
                    for end, value in zip(("", "_std"), values, strict=False):
                        name = f"{joint}_flexion_{word}{end}_deg"
                        extremes.setdefault(name, np.full(len(table), np.nan))[row] = value
    return extremes


def _bouts(strides: "pd.DataFrame", estimate: Estimate) -> "pd.DataFrame":
    """One row for each walking bout, with what the combined distance gains from `BESIDE_S` before it to after it."""
    import pandas as pd

    bouts = [(number, of_bout, of_bout["start_s"].min(), of_bout["end_s"].max())
             for number, of_bout in strides.groupby("wb_id")]  # fmt: skip
    distances, error = np.full(len(bouts), np.nan), np.nan
    if estimate.distance is not None:
        time, way = as_float(estimate.time), as_float(estimate.distance)
        middles = [0.5 * (before[3] + after[2]) for before, after in itertools.pairwise(bouts)]
        first, last = (np.array([bout[at] for bout in bouts]) for at in (2, 3))
        begin = np.maximum(first - BESIDE_S, [time[0], *middles])
        end = np.minimum(last + BESIDE_S, [*middles, time[-1]])
        distances = np.interp(end, time, way) - np.interp(begin, time, way)
        error = float(as_float(estimate.diagnostics["distance_stddev"])[-1]) / way[-1] if way[-1] > 0.0 else np.nan
    rows = []
    for (number, of_bout, start, end), distance in zip(bouts, distances, strict=True):
        rows.append({
            "wb_id": number, "start_s": start, "end_s": end, "duration_s": end - start, "n_strides": len(of_bout),
            "n_regular": int(of_bout["regular"].sum()), "distance_m": distance, "distance_std_m": error * distance,
            "stride_length_m": float(of_bout["stride_length_m"].median()),
            "walking_speed_mps": float(of_bout["walking_speed_mps"].median()),
            "cadence_spm": float(120.0 / of_bout["stride_duration_s"].median()),
        })  # fmt: skip
    return pd.DataFrame(rows, columns=BOUTS)


def _contacts(analysis: "Analysis") -> "pd.DataFrame":
    """Initial and final contacts of the strides; of the waist's contacts those of which no other source has strides."""
    import pandas as pd

    from jgait.estimators.combined.strides import SAME_CONTACT
    from jgait.estimators.waist import SIDE_KNOWN

    rows: list[tuple[float, str, str, str]] = []
    diagnostics, joined = analysis.estimate.diagnostics, analysis.strides
    if "initial_contact" in diagnostics and (joined is None or set(joined.first) <= {"waist"}):
        names = ("initial_contact", "initial_contact_side", "initial_contact_side_probability")
        for time, side, likely in zip(*(diagnostics[name] for name in names), strict=True):
            rows.append((float(time), SIDES[int(side)] if likely >= SIDE_KNOWN else "unknown", "initial", "waist"))
    elif joined is not None:
        table = strides_to_dataframe(analysis.estimate)
        final = table.get("final_contact_s", pd.Series(np.nan, table.index))
        begins = table["start_s"].where(~(table["start_s"] >= final))  # a stride from standing has no contact before it
        for event, times in (("initial", table["end_s"]), ("final", final), ("initial", begins)):
            every = zip(times, table["side"], joined.first, strict=True)
            rows += [(time, side, event, source) for time, side, source in every if np.isfinite(time)]
    order = [source.name for source in analysis.sources]
    once: list[tuple[float, str, str, str]] = []
    for row in sorted(rows, key=lambda row: (order.index(row[3]), row[0])):
        if not any(abs(row[0] - other[0]) < SAME_CONTACT and row[1:3] == other[1:3] for other in once):
            once.append(row)
    return pd.DataFrame(sorted(once), columns=["time_s", "side", "event", "source"])
