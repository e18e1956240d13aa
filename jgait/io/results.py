"""The results of one recording on the host: tables and totals, which files, the terminal and pages show."""

import itertools
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jgait.estimators.columns import COLUMNS, QUANTITIES
from jgait.estimators.cycles import swing_cycles
from jgait.estimators.plausible import distance_implausible
from jgait.estimators.stride_flags import EVERY, SIDE_UNKNOWN, STRIDE_FLAGS, marks, without
from jgait.estimators.totals import angles_usable, distance_of, joint_ranges
from jgait.io.strides import bout_numbers, strides_to_dataframe
from jgait.io.summary import SUMMARY, USABLE, summary
from jgait.io.write import to_dataframe
from jgait.types import SIDES, Estimate, as_float

if TYPE_CHECKING:
    import pandas as pd

    from jgait.estimators.combined import Analysis

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

CAPTION = (
    "± one standard deviation, of one stride or of the distance; medians over regular strides, which are no turns, "
    "stairs, half-steps or uneven (a stride can be several of these), of lengths and speeds also without clipped and "
    "doubtful ones; stance of those that a foot's "
    "sensor measured, mean of both sides; angles: smallest … largest flexion; whole tables in the files"
)
"""Text below the numbers of `Results.totals`."""


class Total(NamedTuple):
    """A number of a whole recording, for people."""

    words: str  #: what it is.
    text: str  #: the number, ± its standard deviation, with its unit.
    quantity: str = ""  #: its `Comparison.quantity`, "joint angles", or "".
    source: str = ""  #: the sensors that it is from, or "".
    usable: bool = True  #: False where the estimate itself states that it is not.


class Results:
    """Tables and totals of one recording, made when they are asked for.

    Attributes:
        estimate: of one estimator, a simulator or motion capture, or the joined one of an analysis.
        analysis: the analysis of all sensors, or None.
    """

    def __init__(self, made: "Estimate | Analysis") -> None:
        """From an estimate of one recording, or from an analysis of all its sensors."""
        self.analysis = None if isinstance(made, Estimate) else made
        self.estimate: Estimate = made if isinstance(made, Estimate) else made.estimate

    @cached_property
    def marks(self) -> dict[str, np.ndarray]:
        """Name of a flag of `STRIDE_FLAGS` → (rows,) bool for the rows of `every`; only flags that are known."""
        return marks(self.estimate, STRIDE_FLAGS)

    @property
    def cycles(self) -> bool:
        """Whether the rows of `every` are cycles of leg angles instead of strides between contacts."""
        return self.estimate.strides is None

    @cached_property
    def measured_by(self) -> list[str]:
        """The sensors of the times of each row of `every`: "feet" are those whose contacts are of both sides alike."""
        if self.analysis is None or self.analysis.strides is None:
            return ["legs" if self.estimate.feet is None else "feet"] * len(self.base)
        return list(self.analysis.strides.first)

    @cached_property
    def base(self) -> "pd.DataFrame":
        """The table of `strides_to_dataframe`, or of `leg_cycles` where the estimate has no strides."""
        return leg_cycles(self.estimate) if self.cycles else strides_to_dataframe(self.estimate)

    @cached_property
    def regular(self) -> np.ndarray:
        """(rows,) bool, the strides that count in means of lengths."""
        return without(self.marks, STRIDE_FLAGS, len(self.base))

    @cached_property
    def special(self) -> list[str]:
        """The flags of each stride in words."""
        joined = None if self.analysis is None else self.analysis.strides
        flagged = {flag.word: self.marks[flag.name] for flag in STRIDE_FLAGS if flag.name in self.marks}
        flagged |= {} if joined is None else {"sources contradict": joined.contradicts}
        return ["; ".join(w for w, values in flagged.items() if values[row]) for row in range(len(self.base))]

    @cached_property
    def sides(self) -> np.ndarray:
        """(rows,) the side of each stride, "" where it is not known."""
        side = self.base["side"].to_numpy(object)
        return np.where(self.marks.get(SIDE_UNKNOWN.name, np.zeros(len(side), bool)), "", side)

    @cached_property
    def every(self) -> "pd.DataFrame":
        """All that is known of each stride, see `analysis_to_dataframes`."""
        table = self.base.copy()
        if not self.cycles:
            table["stance_duration_s"], table["swing_duration_s"] = np.nan, np.nan
            if {"start_s", "final_contact_s", "end_s"} <= set(table):
                stance = table["final_contact_s"] - table["start_s"]
                table["stance_duration_s"] = stance.where(stance > 0.0)
                table["swing_duration_s"] = table["end_s"] - table["final_contact_s"]
            extremes = joint_extremes(self.estimate, table)
            table = table.assign(**extremes)
            if extremes:
                time, legs = as_float(self.estimate.time), zip(SIDES, self.estimate.legs, strict=True)
                usable = {side: angles_usable(self.estimate, side) & (leg is not None) for side, leg in legs}
                spans = zip(table["side"], table["start_s"], table["end_s"], strict=True)
                table["angles_valid"] = [usable[side][(time >= a) & (time <= b)].all() for side, a, b in spans]
        if {"start_s", "end_s"} <= set(table):
            table["wb_id"] = bout_numbers(table["start_s"].to_numpy(), table["end_s"].to_numpy())
        table["source"] = self.measured_by
        if self.analysis is not None and self.analysis.strides is not None:
            used = self.analysis.strides.used.items()
            table["combined"] = ["+".join(name for name, rows in used if rows[i]) for i in range(len(table))]
        return table.assign(special=self.special, regular=self.regular)

    @cached_property
    def counted(self) -> "pd.DataFrame":
        """`every` with NaN where a flag leaves a value out of means, and `regular`, False if it leaves out all."""
        table, count = self.every, len(self.every)
        known = {name: column for name in table if (column := name.replace("_std_", "_")) in EVERY}
        left = {name: table[name].where(without(self.marks, STRIDE_FLAGS, count, of)) for name, of in known.items()}
        return table.assign(**left, regular=without(self.marks, STRIDE_FLAGS, count, "stride_duration_s"))

    @cached_property
    def summary(self) -> "pd.DataFrame":
        """Mean, variability and asymmetry of each measure, and the distance, see `io.summary.summary`."""
        apart = bool(self.estimate.diagnostics.get("clocks_apart", False))
        means = self.counted.dropna(axis="columns", how="all") if len(self.base) else self.counted
        return summary(means.assign(side_known=self.sides != ""), distance_of(self.estimate), apart)

    @cached_property
    def bouts(self) -> "pd.DataFrame":
        """One row for each walking bout, with what the distance gains from a second before to a second after it; the
        bout begins where the distance begins to grow there, and ends where it stops growing.
        """
        import pandas as pd

        strides, estimate = self.counted.assign(regular=self.regular), self.estimate
        bouts = [(number, of_bout, of_bout["start_s"].min(), of_bout["end_s"].max())
                 for number, of_bout in strides.groupby("wb_id")]  # fmt: skip
        distances, error = np.full(len(bouts), np.nan), np.nan
        if estimate.distance is not None:
            time, way = as_float(estimate.time), as_float(estimate.distance)
            middles = [0.5 * (before[3] + after[2]) for before, after in itertools.pairwise(bouts)]
            first, last = (np.array([bout[at] for bout in bouts]) for at in (2, 3))
            begin = np.maximum(first - 1.0, [time[0], *middles])
            end = np.minimum(last + 1.0, [*middles, time[-1]])
            gone, until = np.interp(begin, time, way), np.interp(end, time, way)
            distances = until - gone
            for row, (name, of_bout, start, stop) in enumerate(bouts):
                grows = (time >= begin[row]) & (time <= end[row]) & (way > gone[row]) & (way < until[row])
                walks = time[grows & ~np.isclose(way, gone[row]) & ~np.isclose(way, until[row])]
                bouts[row] = name, of_bout, min([start, *walks[:1]]), max([stop, *walks[-1:]])
            spread = (distance_of(estimate) or (0.0, None))[1]
            error = np.nan if spread is None or not way[-1] > 0.0 else spread / way[-1]
        rows = []
        for (number, of_bout, start, end), distance in zip(bouts, distances, strict=True):
            names = ["stride_length_m", "walking_speed_mps", "stride_duration_s"]
            medians = of_bout.reindex(columns=names).median()  # an estimate may state no speed
            rows.append({
                "wb_id": number, "start_s": start, "end_s": end, "duration_s": end - start, "n_strides": len(of_bout),
                "n_regular": int(of_bout["regular"].sum()), "distance_m": distance, "distance_std_m": error * distance,
                "stride_length_m": medians["stride_length_m"], "walking_speed_mps": medians["walking_speed_mps"],
                "cadence_spm": 120.0 / medians["stride_duration_s"],
            })  # fmt: skip
        return pd.DataFrame(rows, columns=BOUTS)

    @cached_property
    def contacts(self) -> "pd.DataFrame":
        """Initial and final contacts of the strides; of the waist's contacts those of which no other source has
        strides.
        """
        import pandas as pd

        from jgait.estimators.combined.strides import SAME_CONTACT
        from jgait.estimators.waist import SIDE_KNOWN

        rows: list[tuple[float, str, str, str]] = []
        diagnostics = self.estimate.diagnostics
        if "initial_contact" in diagnostics and (self.cycles or set(self.measured_by) <= {"waist"}):
            names = ("initial_contact", "initial_contact_side", "initial_contact_side_probability")
            for time, side, likely in zip(*(diagnostics[name] for name in names), strict=True):
                rows.append((float(time), SIDES[int(side)] if likely >= SIDE_KNOWN else "unknown", "initial", "waist"))
        elif not self.cycles:
            table = self.base
            final = table.get("final_contact_s", pd.Series(np.nan, table.index))
            # a stride from standing has no contact before it
            begins = table["start_s"].where(~(table["start_s"] >= final))
            for event, times in (("initial", table["end_s"]), ("final", final), ("initial", begins)):
                every = zip(times, table["side"], self.measured_by, strict=True)
                rows += [(time, side, event, source) for time, side, source in every if np.isfinite(time)]
        preferred = [] if self.analysis is None else [source.name for source in self.analysis.sources]
        order = {name: number for number, name in enumerate(dict.fromkeys([*preferred, *(row[3] for row in rows)]))}
        once: list[tuple[float, str, str, str]] = []
        for row in sorted(rows, key=lambda row: (order[row[3]], row[0])):
            if not any(abs(row[0] - other[0]) < SAME_CONTACT and row[1:3] == other[1:3] for other in once):
                once.append(row)
        return pd.DataFrame(sorted(once), columns=["time_s", "side", "event", "source"])

    @cached_property
    def totals(self) -> list[Total]:
        """The numbers of the recording, for people: strides, distance, medians over regular strides, ranges of angles.

        Of an analysis, each with its sources, and what each of them measures alone if that is known.
        """
        totals, estimate = list[Total](), self.estimate
        timed = not self.cycles and len(self.base) > 0 and {"start_s", "end_s"} <= set(self.base)
        if not self.cycles:
            totals.append(Total("strides", f"{len(self.base)}, {self.regular.sum()} regular", "strides"))
        if timed:
            lasts, bouts = self.bouts["duration_s"].sum(), len(self.bouts)
            totals.append(Total("walking", f"{lasts:.1f} s in {bouts} {'bout' if bouts == 1 else 'bouts'}"))
        if (whole := distance_of(estimate)) is not None:
            text, usable = COLUMNS["distance_m"].text(*whole), not distance_implausible(estimate)
            totals.append(Total("distance", text, "distance", usable=usable))
        if not self.cycles and len(self.base):
            medians = self.summary.set_index("measure")["median"]
            counted = self.counted[self.counted["regular"].astype(bool)]
            wide = "stride_width_m" in self.base and bool(self.base["stride_width_m"].notna().any())
            for name in ("stride_length_m", "walking_speed_mps", *["stride_width_m"] * wide):
                column = COLUMNS[name]
                usable = counted.get(USABLE.get(column.quantity, ""), counted["regular"]).astype(bool)
                spread = counted.loc[usable & counted[name].notna()].get(column.deviation)
                # as of one stride; sensors of one side can be far better than those of the other
                error = None if spread is None else float((spread**2).mean()) ** 0.5
                text = column.text(medians.get(column.quantity), error)
                totals.append(Total(column.words, text, column.quantity))
            if timed:
                totals.append(Total("cadence", COLUMNS["cadence_spm"].text(medians.get("cadence"))))
            if "stance" in medians:
                totals.append(Total("stance", f"{medians['stance']:.0f} % of the stride"))
        for joint, pair in joint_ranges(estimate).items():
            if pair is not None:
                usable = bool(estimate.diagnostics.get(f"angles_valid_{joint.split()[1]}", True))
                text = f"{pair[0]:z.0f} … {pair[1]:z.0f} °".replace("-", "−")
                totals.append(Total(joint, text, "joint angles", usable=usable))
        if (analysis := self.analysis) is None:
            return totals
        for k, total in enumerate(totals):
            alone = [
                f"{c.source} {c.value:.{QUANTITIES[c.quantity].digits}f}" for c in analysis.comparisons
                if c.source != "combined" and c.quantity == (total.quantity or total.words)
            ]  # fmt: skip
            of = ["legs"] if total.quantity == "joint angles" else alone or dict.fromkeys(self.measured_by)
            totals[k] = total._replace(source=", ".join(of))
        return totals


def analysis_to_dataframes(analysis: "Analysis") -> "dict[str, pd.DataFrame]":
    """The tables of an analysis; without strides, those of strides, their summary and bouts have no rows.

    `strides`: columns of `strides_to_dataframe`, then `stance_duration_s swing_duration_s`, smallest and largest
    `hip_flexion_…_deg knee_flexion_…_deg` in the stride where thigh and shank are measured and the range between them,
    with their deviations `…_std_deg`, see `joint_extremes`, `angles_valid`, False if these angles are
    not usable, `wb_id` of the walking bout, `source` of the times, `combined` sources of the length,
    `special` flags in words, and `regular`, True if the stride counts in medians of all columns: not in a turn, on
    stairs, from or to standing, clipped, uneven, or in doubt. A clipped or doubtful stride counts in those of times. A
    regular stride can have other flags, such as "sources contradict".
    `summary`: median of each measure over the regular strides, mean, variability and asymmetry over the steady ones,
    and the distance, see `io.summary.summary`.
    `contacts`: `time_s side event source`, initial and final contacts; side "unknown" where it is not certain.
    `bouts`: `wb_id start_s end_s duration_s n_strides n_regular distance_m distance_std_m stride_length_m
    walking_speed_mps cadence_spm`; a bout ends with a break of more than 3 s; lengths and speeds are medians
    over its `n_regular` regular strides, the cadence also over clipped and doubtful ones; they say little about a bout
    on stairs or in turns; `distance_m` is the bout's part of the combined distance, from `start_s` to `end_s`, where it
    grows, steps before the first and after the last stride included. The bouts add up to it, unless
    samples are lost between them. `distance_std_m` is the same part of the distance's deviation: as there, errors of
    strides are taken to have one cause, so that they add up. Errors of single strides do not, and a bout of a few
    strides can be off by more.
    `sources`: `quantity unit source value std n_strides`, each quantity as each source measures it, and combined.
    `samples`: columns of `to_dataframe`.
    """
    import pandas as pd

    results = Results(analysis)
    if analysis.strides is None:
        empty = {"strides": STRIDES, "summary": SUMMARY, "bouts": BOUTS}
        tables = {name: pd.DataFrame(columns=columns) for name, columns in empty.items()}
    else:
        strides = results.every.dropna(axis="columns", how="all")
        tables = {"strides": strides, "summary": results.summary, "bouts": results.bouts}
    rows = [
        (c.quantity, QUANTITIES[c.quantity].unit, c.source, c.value, c.stddev, c.strides) for c in analysis.comparisons
    ]
    return tables | {
        "contacts": results.contacts, "sources": pd.DataFrame(rows, columns=SOURCES),
        "samples": to_dataframe(analysis.estimate),
    }  # fmt: skip


def joint_extremes(estimate: Estimate, table: "pd.DataFrame") -> dict[str, np.ndarray]:
    """Smallest and largest flexion of hip and knee [°] in each stride, of its own leg, and the range between them; NaN
    where a sample lacks. Deviations are those of the samples, mostly of the standing pose; that of a range takes them
    as not correlated, which makes up for soft tissue that moves more than the estimate states.
    """
    extremes: dict[str, np.ndarray] = {}
    time = as_float(estimate.time)
    for side, leg, spread in zip(SIDES, estimate.legs, estimate.stddev or (None, None), strict=True):
        if leg is None:
            continue
        known = np.asarray(estimate.valid, bool) & np.isfinite(as_float(leg.knee_angle))
        for joint, end in itertools.product(("hip", "knee"), ("min", "max", "range")):
            for suffix in ("", "_std") if spread is not None else ("",):
                extremes.setdefault(f"{joint}_flexion_{end}{suffix}_deg", np.full(len(table), np.nan))
        for row in np.flatnonzero(table["side"] == side):
            there = (time >= table["start_s"].iloc[row]) & (time <= table["end_s"].iloc[row])
            if not there.any() or not known[there].all():  # the extreme may lie where there is no angle
                continue
            for joint in ("hip", "knee"):
                angles = np.rad2deg(
                    [
                        as_float(getattr(values, f"{joint}_angle"))[there]
                        for values in (leg, spread)
                        if values is not None
                    ]
                )
                low, high = (angles[:, at] for at in (np.argmin(angles[0]), np.argmax(angles[0])))
                between = [high[0] - low[0], *np.hypot(low[1:], high[1:])]
                for end, values in (("min", low), ("max", high), ("range", between)):
                    for suffix, value in zip(("", "_std"), values, strict=False):
                        extremes[f"{joint}_flexion_{end}{suffix}_deg"][row] = value
    return extremes


def leg_cycles(estimate: Estimate) -> "pd.DataFrame":
    """The cycles of leg angles, from the largest knee flexion of a swing, which is that of the cycle, to that of the
    next swing: columns of `strides_to_dataframe`, as far as known, and the extremes of each joint [°].
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
    table = pd.DataFrame(rows).dropna(axis="columns", how="all") if rows else pd.DataFrame(
        columns=["side", "start_s", "end_s"]
    )  # fmt: skip
    table = table.sort_values("start_s", kind="stable", ignore_index=True)
    table.insert(0, "s_id", np.arange(len(table)))
    return table
