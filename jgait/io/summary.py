"""Mean, variability and asymmetry of the strides of a recording: the table that studies compare people by."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from jgait.types import SIDES

if TYPE_CHECKING:
    import pandas as pd

SUMMARY = ["measure", "unit", "n_strides", "mean", "std", "cv_pct", "error_std", *SIDES, "asymmetry_pct"]
"""Columns of the table, also if it has no rows."""

MEASURES = {
    "stride_length": "m", "stride_duration": "s", "walking_speed": "mps", "step_length": "m", "step_duration": "s",
    "stance": "pct", "stride_width": "m", "lift": "m", "hip_flexion_min": "deg", "hip_flexion_max": "deg",
    "knee_flexion_max": "deg", "contact_angle": "deg", "push_off_angle": "deg",
}  # fmt: skip
"""Measure → its unit; with `_` between, the column of the table of strides, but for `step_duration` and `stance`."""

USABLE = {"stride_width": "width_valid", "hip_flexion_min": "angles_valid", "hip_flexion_max": "angles_valid",
          "knee_flexion_max": "angles_valid"}  # fmt: skip
"""Measure → the column that is False in strides in which it is not usable."""

FEWEST = 3
"""[1] Steady strides of a side of which a standard deviation is stated."""

HIDDEN = 2.0
"""[1] Stated error of a stride over the variability, above which the variability is not stated. Chosen so that lengths
from the waist are above it on recorded walks, those from shoes and shanks below."""

JOINS_S = 0.2
"""[s] Largest time between the end of a stride and the start of the next of its side."""


def summary(strides: "pd.DataFrame") -> "pd.DataFrame":
    """One row for each measure, over the steady strides of a recording.

    A stride is steady if it and its neighbours of the same side are regular: strides in which a person speeds up or
    slows down, beside standing, turns and stairs, do not count. Where a side has fewer than `FEWEST` steady strides,
    the regular ones count, and variability is not stated.

    Columns: `measure unit n_strides mean std cv_pct error_std right left asymmetry_pct`. `mean` is the mean of both
    sides' means `right` and `left`, or that of the only side. `std` is the variability from stride to stride within a
    side, the root of the mean of both sides' variances; `cv_pct` is 100 std / mean. `asymmetry_pct` is 100 (right −
    left) / mean. Angles have neither `cv_pct` nor `asymmetry_pct`: their zero is a matter of definition. `error_std` is
    the stated standard deviation of the error in one stride. `std` contains the part of it that changes from stride to
    stride: one that is not clearly larger says little about the person, and where the error is more than `HIDDEN` times
    as large it is not stated. `step_duration` is the time from a contact of the other foot to that of the side,
    `stance` the share of the stride with the foot on the ground.

    Args:
        strides: the table `strides` of `analysis_to_dataframes`.

    Source: within-side variability, and the mean of both sides: B. Galna, S. Lord, L. Rochester, Gait & Posture 37(2),
    2013.
    """
    import pandas as pd

    steady = _steady(strides)
    sides = strides.loc[strides["regular"].astype(bool), "side"]
    enough = bool((strides.loc[steady, "side"].value_counts().reindex(sides.unique(), fill_value=0) >= FEWEST).all())
    table = strides[steady if enough else strides["regular"].astype(bool)]
    columns = {f"{name}_{unit}": table.get(f"{name}_{unit}") for name, unit in MEASURES.items()}
    columns["step_duration_s"] = _step_durations(table, strides)
    if "stance_duration_s" in table:
        columns["stance_pct"] = 100.0 * table["stance_duration_s"] / table["stride_duration_s"]
    rows = []
    for name, unit in MEASURES.items():
        values = columns[f"{name}_{unit}"]
        if values is None:
            continue
        usable = table.get(USABLE.get(name, ""), pd.Series(True, table.index)).astype(bool)
        row = _row(values[usable].astype(float), table["side"][usable], unit != "deg", enough)
        error = table.get(f"{name}_std_{unit}", pd.Series(np.nan, table.index))[usable & values.notna()]
        if not row["n_strides"]:
            continue
        stated = float(np.sqrt(np.mean(np.square(error)))) if len(error) else np.nan
        hidden = {"std": np.nan, "cv_pct": np.nan} if stated > HIDDEN * row["std"] else {}
        rows.append({"measure": name, "unit": unit, **row, **hidden, "error_std": stated})
    return pd.DataFrame(rows, columns=SUMMARY)


def _steady(strides: "pd.DataFrame") -> "pd.Series":
    """Which strides are regular, as are the strides of the same side before and after them."""
    found = strides["regular"].astype(bool)
    for _, one in strides.groupby("side"):
        beside = one.sort_values("start_s")
        regular = beside["regular"].astype(bool)
        joins = (beside["start_s"] - beside["end_s"].shift()).abs() < JOINS_S  # with the stride before it
        before = joins & regular.shift(fill_value=False)
        after = (joins & regular).shift(-1, fill_value=False)
        found[beside.index] = regular & before & after
    return found


def _row(values: "pd.Series", side: "pd.Series", ratio: bool, steady: bool) -> Mapping[str, float]:
    """The numbers of one measure, from its value in each stride.

    `ratio`: whether its zero is that of a length; `steady`: whether a variability is stated.
    """
    by_side = [values[side == one].dropna() for one in SIDES]
    means = np.array([one.mean() if len(one) else np.nan for one in by_side])
    variances = [one.var() for one in by_side if steady and len(one) >= FEWEST]
    known = np.isfinite(means)
    mean = float(np.mean(means[known])) if known.any() else np.nan
    std = float(np.sqrt(np.mean(variances))) if variances else np.nan
    share = 100.0 / mean if ratio and mean > 0.0 else np.nan
    return {
        "n_strides": sum(map(len, by_side)), "mean": mean, "std": std, "cv_pct": share * std,
        **dict(zip(SIDES, map(float, means), strict=True)), "asymmetry_pct": share * float(means[0] - means[1]),
    }  # fmt: skip


def _step_durations(table: "pd.DataFrame", strides: "pd.DataFrame") -> "pd.Series | None":
    """Time from the other foot's contact within each stride to its end [s]; None if one side alone has strides."""
    import pandas as pd

    contacts = {side: np.unique(strides.loc[strides["side"] == side, ["start_s", "end_s"]].dropna()) for side in SIDES}
    if not all(len(times) for times in contacts.values()):
        return None
    other = dict(zip(SIDES, reversed(SIDES), strict=True))
    durations = pd.Series(np.nan, table.index)
    for row, stride in table[["side", "start_s", "end_s"]].iterrows():
        times = contacts[other[stride["side"]]]
        within = times[(times > stride["start_s"]) & (times < stride["end_s"])]
        if len(within):
            durations[row] = stride["end_s"] - within[-1]
    return durations
