"""Median, mean, variability and asymmetry of the strides of a recording: the table that studies compare people by."""

from typing import TYPE_CHECKING

import numpy as np

from jgait.estimators.columns import COLUMNS
from jgait.io.strides import bout_numbers
from jgait.types import SIDES

if TYPE_CHECKING:
    import pandas as pd

SUMMARY = ["measure", "unit", "n_strides", "steady", "median", "mean", "std", "cv_pct", "error_std", *SIDES,
           "asymmetry_pct", "asymmetry_std_pct"]  # fmt: skip
"""Columns of the table, also if it has no rows."""

MEASURES = tuple(column for column in COLUMNS.values() if column.summarised)

OF_POSE = tuple(f"{joint}_flexion_{end}" for joint in ("hip", "knee") for end in ("max", "min", "range"))
"""Measures whose error is mostly that of the standing pose, or of sensors that move with the skin, the same in all
strides: it hides no variability."""

USABLE = {"stride_width": "width_valid", "step_length": "width_valid", **dict.fromkeys(OF_POSE, "angles_valid")}
"""Measure → the column that is False in strides in which it is not usable."""

FEWEST_STEADY_STRIDES = 3
"""[1] Steady strides of a side of which a standard deviation is stated: of two it says nothing. Chosen by hand."""

HIDDEN = 2.0
"""[1] Stated error of a stride over the variability, above which the variability is not stated. Chosen so that lengths
from the waist are above it on recorded walks, those from shoes and shanks below."""

PACE = 0.15
"""[1] Largest difference of the duration of a stride from the median of its side and bout, over that; a person whose
strides last longer or shorter at an end of a bout speeds up or slows down there."""

CONTACTS = "feet"
"""The source whose contacts are those of both sides alike: stances and steps of others are off by how a leg moves."""

CONTACT_S = 0.01
"""[s] Standard deviation of the error of a side's contacts that is the same in all of its strides, by `CONTACTS`.
Chosen on `ipol_gait`, whose contacts are marked by hand: `experiments.unseen.asymmetry` prints what it covers."""


def summary(
    strides: "pd.DataFrame", distance: tuple[float, float | None] | None = None, clocks_apart: bool = False
) -> "pd.DataFrame":
    """One row for each measure, over the steady strides of a recording, and one for the distance.

    A stride is steady if it and its neighbours of the same side are regular, and no stride between it and the begin or
    the end of its bout lasts otherwise, see `PACE`: strides in which a person speeds up or slows down, beside standing,
    turns and stairs, do not count. Where a side has fewer than `FEWEST_STEADY_STRIDES` steady strides,
    the regular ones count, `steady` is False, and neither variability nor asymmetry is stated.

    Columns:
        measure unit n_strides steady: the measure, and how many strides of which kind count.
        median: over all regular strides, also those that are not steady, as `io.Results.totals` has it; of the stance
            the mean of both sides' medians.
        right left: means of the sides, over strides at the time of which the other side has one that counts as well:
            else the sides would differ because one of them measured other bouts. Of a single side, over all strides.
            Of a side whose errors are stated to be three times as large, or more, there is none: it is measured by
            another sensor, as by that of the waist beside one shoe.
        mean: mean of the means of both sides, each over all of its strides, or that of the only side, or of all strides
            where some are of an unknown side.
        std cv_pct: variability from stride to stride within a side and a walking bout, the root of the mean of both
            sides' variances, and 100 std / mean; no `cv_pct` of angles, whose zero is a matter of definition.
        error_std: stated standard deviation of the error in one stride. `std` contains the part of it that changes from
            stride to stride: one that is not clearly larger says little about the person, and where the error is more
            than `HIDDEN` times as large it is not stated, but for joint angles, see `OF_POSE`.
        asymmetry_pct asymmetry_std_pct: 100 (right − left) / mean of stride lengths, steps and stances, and the
            standard deviation of its error, if the error of a stride is the same in all strides of a side. Only where
            the same sensors measure both sides.

    `step_duration` is the time from a contact of the other foot to that of the side, `stance` the share of the stride
    with the foot on the ground. Both are stated of shoes alone: at a shank or the waist the measured contacts depend on
    how each leg moves, so that sides differ falsely. Where other sensors show that the clock of a shoe may be off, the
    sides of `step_duration` and its asymmetry are empty. `step_length` needs the range between the feet.

    `distance` is that of the whole recording, with all its strides: `mean` is the distance, `error_std` its deviation.

    Args:
        strides: the table `strides` of `analysis_to_dataframes`; a column `side_known` may be False where the side is a
            guess.
        distance: distance and its standard deviation [m]; None without a distance.
        clocks_apart: whether the clocks of both sides are not known to be one.

    Source: within-side variability, and the mean of both sides: B. Galna, S. Lord, L. Rochester, Gait & Posture 37(2),
    2013.
    """
    import pandas as pd

    start, end = ("start_s", "end_s") if "start_s" in strides else ("standing_s", "standing_end_s")
    strides = strides.assign(begins=strides[start], ends=strides[end])
    regular, ordered = strides["regular"].astype(bool), strides.sort_values("begins")
    bouts = bout_numbers(ordered["begins"].to_numpy(float), ordered["ends"].to_numpy(float))
    strides["bout"] = pd.Series(bouts, ordered.index)
    steady = regular & _beside_regular(strides)
    steady &= _at_pace(strides[steady]).reindex(strides.index, fill_value=False)
    table = strides[steady]
    sides = strides.loc[regular, "side"].unique()
    enough = bool(len(sides)) and bool(
        (table["side"].value_counts().reindex(sides, fill_value=0) >= FEWEST_STEADY_STRIDES).all()
    )
    table = table if enough else strides[regular]
    known = table.get("side_known", pd.Series(True, table.index)).astype(bool)
    sided = bool(known.all())
    alike = enough and sided and len({frozenset(of["source"]) for _, of in table.groupby("side")}) == 1
    two_sources = table.groupby("side")["source"].agg(lambda names: names.mode().iloc[0]).nunique() == len(SIDES)
    columns, every = _measures(table, strides), _measures(strides[regular], strides)
    rows = []
    for column in MEASURES:
        name, unit = column.quantity, column.unit
        if (usual := every.get(name)) is None or not len(usual):
            continue
        median = usual.groupby(strides["side"]).median().mean() if name == "stance" else usual.median()
        if not len(values := columns.get(name, usual.iloc[:0])):  # only strides that are not steady have the measure
            rows.append({"measure": name, "unit": unit, "n_strides": 0, "steady": False, "median": median})
            continue
        errors = table.get(column.deviation, pd.Series(np.nan, table.index))[values.index].dropna()
        each = errors.groupby(table.loc[errors.index, "side"]).median()
        if sided and two_sources and len(each) == len(SIDES) and each.max() > 3.0 * each.min():
            # another source, as the waist beside one shoe, measures this side far worse
            values = values[table.loc[values.index, "side"] != each.idxmax()]
            errors = errors[errors.index.isin(values.index)]
        by_side = [values[(table.loc[values.index, "side"] == side) & known[values.index]] for side in SIDES]
        groups = [side_values for side_values in by_side if len(side_values)] if sided else [values]
        mean = float(np.mean([group.mean() for group in groups]))
        variances = []  # of each side, about the means of its bouts
        for group in groups:
            of_bout = group.groupby(strides["bout"][group.index])
            if (freedom := len(group) - of_bout.ngroups) >= FEWEST_STEADY_STRIDES - 1:
                variances.append(float(((group - of_bout.transform("mean")) ** 2).sum()) / freedom)
        error = float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else np.nan
        std = float(np.sqrt(np.mean(variances))) if variances and enough else np.nan
        std = np.nan if error > HIDDEN * std and name not in OF_POSE else std
        both = _at_the_same_time(table.loc[values.index]) if all(map(len, by_side)) else values.index
        right, left = (
            float(paired.mean()) if len(paired) else np.nan for paired in (v[v.index.isin(both)] for v in by_side)
        )
        if clocks_apart and name == "step_duration":  # their mean holds: it is half a stride
            right, left = np.nan, np.nan
        unsure = np.nan  # standard deviation of the difference of both sides' means
        if alike and np.isfinite(right - left) and name == "stride_length":
            unsure = np.sqrt(2.0) * error
        elif alike and np.isfinite(right - left) and name == "step_duration":
            # what one side's contacts are late, its steps are longer and the other's shorter
            unsure = 2.0 * np.sqrt(2.0) * CONTACT_S
        elif alike and np.isfinite(right - left) and name == "stance":
            unsure = 200.0 * CONTACT_S / float(table["stride_duration_s"].mean())
        rows.append({
            "measure": name, "unit": unit, "n_strides": len(values), "steady": enough, "median": median, "mean": mean,
            "std": std, "cv_pct": np.nan if unit == "deg" else 100.0 * std / mean, "error_std": error,
            "right": right, "left": left,
            "asymmetry_pct": 100.0 * (right - left) / mean if np.isfinite(unsure) else np.nan,
            "asymmetry_std_pct": 100.0 * unsure / mean,
        })  # fmt: skip
    whole = {"measure": "distance", "unit": "m", "n_strides": len(strides), "steady": False}
    if distance is not None:
        rows.append({**whole, "mean": distance[0], "error_std": distance[1]})
    return pd.DataFrame(rows, columns=SUMMARY)


def _measures(table: "pd.DataFrame", strides: "pd.DataFrame") -> "dict[str, pd.Series]":
    """Measure → its usable values in the strides of a table, which are some of all strides."""
    import pandas as pd

    columns = {column.name: table.get(column.name) for column in MEASURES}
    columns |= {"step_duration_s": _step_durations(table, strides), "stance_pct": None}
    if {"final_contact_s", "stride_duration_s"} <= set(table):
        stance = 100.0 * (table["final_contact_s"] - table["start_s"]) / table["stride_duration_s"]
        columns["stance_pct"] = stance.where((table["source"] == CONTACTS) & (stance > 0.0))
    if "stride_duration_s" in table:
        columns["cadence_spm"] = 120.0 / table["stride_duration_s"]
    if "stride_width_m" not in table:
        columns["step_length_m"] = None
    every, values = pd.Series(True, table.index), {column.quantity: columns[column.name] for column in MEASURES}
    return {
        name: of[table.get(USABLE.get(name, ""), every).astype(bool)].dropna().astype(float)
        for name, of in values.items() if of is not None
    }  # fmt: skip


def _beside_regular(strides: "pd.DataFrame") -> "pd.Series":
    """Which strides begin and end where regular strides of the same side end and begin, within 0.2 s."""
    import pandas as pd

    joined = pd.Series(False, strides.index)
    for _, side_strides in strides.groupby("side"):
        beside = side_strides.sort_values("begins")
        regular = beside["regular"].astype(bool)
        joins = (beside["begins"] - beside["ends"].shift()).abs() < 0.2  # with the stride before it
        joined[beside.index] = joins & regular.shift(fill_value=False) & (joins & regular).shift(-1, fill_value=False)
    return joined


def _at_pace(strides: "pd.DataFrame") -> "pd.Series":
    """Which strides are not before the first or after the last ones of their side and bout that last as most do."""
    import pandas as pd

    at_pace = pd.Series(True, strides.index)
    for _, bout_strides in strides.groupby(["side", "bout"]):
        rows = bout_strides.sort_values("begins")
        lasts = rows["ends"] - rows["begins"]
        usual = ((lasts / lasts.median() - 1.0).abs() <= PACE).to_numpy()
        at_pace[rows.index] = np.maximum.accumulate(usual) & np.maximum.accumulate(usual[::-1])[::-1]
    return at_pace


def _at_the_same_time(strides: "pd.DataFrame") -> "pd.Index":
    """The strides that share time with one of the other side."""
    shares = np.zeros(len(strides), bool)
    right = strides["side"].to_numpy() == SIDES[0]
    for mine, theirs in ((right, ~right), (~right, right)):
        other = strides[theirs].sort_values("begins")
        until = np.maximum.accumulate(np.append(-np.inf, other["ends"].to_numpy(float)))
        before = np.searchsorted(other["begins"].to_numpy(float), strides.loc[mine, "ends"].to_numpy(float))
        shares[mine] = until[before] > strides.loc[mine, "begins"].to_numpy(float)
    return strides.index[shares]


def _step_durations(table: "pd.DataFrame", strides: "pd.DataFrame") -> "pd.Series | None":
    """Time from the other foot's contact within each stride to its end [s], by `CONTACTS`; None without contacts."""
    import pandas as pd

    if "start_s" not in strides:
        return None
    durations = pd.Series(np.nan, table.index)
    for side, other in zip(SIDES, reversed(SIDES), strict=True):
        theirs = strides[(strides["source"] == CONTACTS) & (strides["side"] == other)]
        times = np.append(-np.inf, np.unique(theirs[["start_s", "end_s"]].dropna()))
        mine = table[(table["source"] == CONTACTS) & (table["side"] == side)]
        last = times[np.searchsorted(times, mine["end_s"]) - 1]  # the other foot's last contact before the end
        durations[mine.index] = (mine["end_s"] - last).where(last > mine["start_s"]).astype(float)
    return durations
