"""Strides as tables: in metres and degrees, and as gaitmap and mobgap have them, in samples."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jgait.estimators.columns import COLUMNS
from jgait.estimators.stride_flags import (
    BREAK,
    CLIPPED,
    DOUBTFUL,
    HALF,
    STAIRS,
    STRIDE_COLUMNS,
    TURNING,
    UNEVEN_DURATION,
    in_order,
    pauses,
    regular,
)
from jgait.estimators.walking import durations
from jgait.notes import record
from jgait.types import SIDES, Estimate, as_float

if TYPE_CHECKING:
    import pandas as pd

TIMES = ("start", "final_contact", "end", "standing", "standing_end")

FLAGS = (TURNING, STAIRS, CLIPPED, HALF, UNEVEN_DURATION, DOUBTFUL)
"""Flags that keep a stride out of means, of all estimators; an estimate that lacks one is not marked by it."""


def strides_to_dataframe(estimate: Estimate) -> "pd.DataFrame":
    """The strides of an estimate, one row each, in the order in which they start.

    Columns: `s_id` from 0; `side`; times [s] `start_s final_contact_s end_s standing_s standing_end_s`;
    `stride_length_m stride_width_m step_length_m stride_duration_s walking_speed_mps stride_height_m lift_m turn_deg
    contact_angle_deg push_off_angle_deg`, see `jgait.types.Strides`; after each of these its standard deviation with
    `_std` before the unit (`stride_length_std_m`), where the estimate has one; `stride_length_low95_m
    stride_length_high95_m`, meant to contain 95 % of the lengths, and `doubt`, the probability that the length is off
    by more than three deviations, where the estimator has learned them (`jgait.quality`); `width_valid`, False for
    unreliable widths, where the estimator computes it. A quantity that the estimate lacks has no column; a value that
    is missing in a stride is an empty cell. So is the duration of a first stride from standing, which has no initial
    contact before it: its `start_s` is its toe-off, and its speed is from standing to standing.

    Args:
        estimate: of one recording, with `strides`.

    Raises:
        ValueError: if the estimate has no strides.
    """
    import pandas as pd

    rows = _rows(estimate)
    strides, stated = estimate.strides, estimate.strides_stddev
    columns: dict[str, np.ndarray] = {
        "s_id": np.arange(rows.size),
        "side": np.array(SIDES, dtype=object)[np.asarray(strides.side)[rows].astype(int)],
    }
    for name in TIMES:
        if getattr(strides, name) is not None:
            columns[f"{name}_s"] = as_float(getattr(strides, name))[rows]
    for column, (field, scale) in STRIDE_COLUMNS.items():
        timed = strides.start is not None and strides.end is not None
        values = getattr(strides, field) if field else durations(strides) if timed else None
        if values is None:
            continue
        columns[column] = scale * as_float(values)[rows]
        spread = None if stated is None or not field else getattr(stated, field)
        if spread is not None:
            deviation = scale * as_float(spread)[rows]
            columns[COLUMNS[column].deviation] = np.where(deviation > 0.0, deviation, np.nan)
            quality = estimate.diagnostics.get("quality")
            if field == "length" and quality is not None and np.shape(quality.doubt) == np.shape(strides.side):
                half = quality.interval[rows] * deviation
                columns["stride_length_low95_m"] = columns[column] - half
                columns["stride_length_high95_m"] = columns[column] + half
                columns["doubt"] = quality.doubt[rows]
    trusted = estimate.diagnostics.get("width_valid")
    if trusted is not None and np.shape(trusted) == np.shape(strides.side):
        columns["width_valid"] = np.asarray(trusted, bool)[rows]
    return pd.DataFrame(columns)


def bout_numbers(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(n,) number of the walking bout of each stride, from 0, for strides in the order of their starts [s]."""
    return np.concatenate([[0], np.cumsum(pauses(start, end) > BREAK)]) if len(start) else np.zeros(0, int)


def _rows(estimate: Estimate) -> np.ndarray:
    """The valid strides of an estimate, in the order in which they start."""
    strides = estimate.strides
    if strides is None:
        raise ValueError("the estimate has no strides, not even an empty table of them")
    if np.ndim(strides.side) != 1:
        raise ValueError(f"strides must be of one recording, fields (n,); got shape {np.shape(strides.side)}")
    return in_order(estimate)


def to_gaitmap(estimate: Estimate, sampling_rate_hz: float) -> "dict[str, pd.DataFrame]":
    """The strides of each foot as gaitmap's stride list of type `min_vel`: from standing to standing, in samples.

    Columns, all whole numbers: `start` and `min_vel`, when the foot stands; `end`, when the foot stands again, the
    first sample after the stride; `pre_ic`, the initial contact before the stride; `tc`, the final contact; `ic`, the
    initial contact that ends the swing. The index is the `s_id` of `strides_to_dataframe`. As in gaitmap, a stride
    whose events are not in this order is left out, for example the first from standing, which has no contact before it.

    Args:
        estimate: of one recording, with `strides` that have contacts and standing.
        sampling_rate_hz: of gaitmap's data [Hz], whose first sample is at time 0 of the estimate.

    Returns:
        "right_sensor" and "left_sensor" → stride list; the list of a foot without a sensor is empty.

    Raises:
        ValueError: if the estimate has no strides, no contacts or no standing, or the rate is not positive.
    """
    import pandas as pd

    if not sampling_rate_hz > 0.0:
        raise ValueError(f"sampling_rate_hz must be positive; got {sampling_rate_hz}")
    rows = _rows(estimate)
    strides = estimate.strides
    lacking = [name for name in TIMES if getattr(strides, name) is None]
    if lacking:
        raise ValueError(f"gaitmap's strides need contacts and standing; these have no {', '.join(lacking)}")
    start, final_contact, end, standing, standing_end = (
        np.round(as_float(getattr(strides, name))[rows] * sampling_rate_hz) for name in TIMES
    )
    events = {
        "start": standing, "end": standing_end, "min_vel": standing, "pre_ic": start, "tc": final_contact, "ic": end,
    }  # fmt: skip
    ordered = (start < standing) & (standing < final_contact) & (final_contact < end)
    side = np.asarray(strides.side)[rows]
    tables = {}
    for number, sensor in enumerate(("right_sensor", "left_sensor")):
        of_side = np.flatnonzero(ordered & (side == number))
        table = pd.DataFrame({name: values[of_side].astype(np.int64) for name, values in events.items()})
        table.index = pd.Index(of_side, name="s_id", dtype=np.int64)
        tables[sensor] = table
    return tables


@record
class MobgapTables(NamedTuple):
    """Tables of a recording with the names and units of mobgap's pipelines; times in samples."""

    ic_list: "pd.DataFrame"  #: initial contacts, index `step_id`: `ic`, `lr_label` ("left", "right").
    #: strides from contact to contact, index `wb_id`, `s_id`: `start`, `end`, `lr_label`, `stride_duration_s`,
    #: `cadence_spm` [steps/min], `stride_length_m`, `walking_speed_mps` (NaN where a length is not above 0), and
    #: `regular`, False for half-steps, turns, stairs, uneven and doubtful strides.
    per_stride_parameters: "pd.DataFrame"
    #: walking bouts, index `wb_id`: `start`, `end`, `n_strides`, `duration_s`, `n_raw_initial_contacts`, and the
    #: means of the parameters of the regular strides.
    per_wb_parameters: "pd.DataFrame"


def to_gaitmap_parameters(estimate: Estimate, sampling_rate_hz: float) -> "dict[str, pd.DataFrame]":
    """The parameters of each foot's strides under gaitmap's names, for the strides of `to_gaitmap`.

    Columns, each if the estimate has it: `stride_length` [m]; `gait_velocity` [m/s], the length over the time from
    contact to contact; `ic_angle`, `tc_angle` [deg] between foot and ground, toes up positive, relative to standing
    (gaitmap's own `tc_angle` is the elevation of the sensor's x axis at the final contact, some degrees apart);
    `turning_angle` [deg], left positive; `max_sensor_lift` [m] above the sensor's height at the stride's start;
    `stride_time`, `swing_time`, `stance_time` [s], not rounded to samples. The index is `s_id`.

    Args:
        estimate: of one recording, with `strides` that have contacts and standing.
        sampling_rate_hz: as `to_gaitmap`; the order of a stride's events is checked at this rate.

    Returns:
        Sensor → table; the table of a foot without a sensor is empty.

    Raises:
        ValueError: as `to_gaitmap`.
    """
    import pandas as pd

    lists = to_gaitmap(estimate, sampling_rate_hz)
    table = strides_to_dataframe(estimate).set_index("s_id")
    lift = None
    if {"lift_m", "stride_height_m"} <= set(table):
        # jgait's lift is above the higher foothold, gaitmap's above the first.
        lift = table["lift_m"] + table["stride_height_m"].clip(lower=0.0)
    given = {  # in gaitmap's order
        "stride_length": table.get("stride_length_m"),
        "gait_velocity": table.get("walking_speed_mps"),
        "ic_angle": table.get("contact_angle_deg"),
        "tc_angle": table.get("push_off_angle_deg"),
        "turning_angle": table.get("turn_deg"),
        "max_sensor_lift": lift,
        "stride_time": table["end_s"] - table["start_s"],
        "swing_time": table["end_s"] - table["final_contact_s"],
        "stance_time": table["final_contact_s"] - table["start_s"],
    }
    columns = {name: values for name, values in given.items() if values is not None}
    whole = pd.DataFrame(columns, index=table.index)
    return {sensor: whole.loc[rows.index] for sensor, rows in lists.items()}


def to_mobgap(estimate: Estimate, sampling_rate_hz: float) -> MobgapTables:
    """Initial contacts, strides and walking bouts under mobgap's names.

    In mobgap a stride begins and ends with an initial contact, so a first stride from standing is left out. A bout
    continues if the next stride begins at most `BREAK` after the end of the last; mobgap's selection of strides
    and bouts (`StrideSelection`, `WbAssembly`) can be run on `per_stride_parameters.reset_index("wb_id", drop=True)`.

    Args:
        estimate: of one recording, with `strides` that have contacts.
        sampling_rate_hz: of mobgap's data [Hz], whose first sample is at time 0 of the estimate.

    Returns:
        The tables; without rows if there are no strides.

    Raises:
        ValueError: if the estimate has no strides or no contacts, or the rate is not positive.
    """
    if not sampling_rate_hz > 0.0:
        raise ValueError(f"sampling_rate_hz must be positive; got {sampling_rate_hz}")
    table = strides_to_dataframe(estimate).assign(regular=regular(estimate, FLAGS))
    lacking = [name for name in ("start_s", "end_s") if name not in table]
    if lacking:
        raise ValueError(f"mobgap's strides need contacts; these have no {', '.join(lacking)}")
    if "standing_s" in table:
        table = table[~(table["standing_s"] < table["start_s"])]
    contacts = _contacts(estimate, table, sampling_rate_hz)
    strides = _strides(table, sampling_rate_hz)
    by_bout = strides.groupby(level="wb_id")
    bouts = by_bout.agg(start=("start", "min"), end=("end", "max"), n_strides=("start", "size"))
    bouts["duration_s"] = (bouts["end"] - bouts["start"]) / sampling_rate_hz
    spans = zip(bouts["start"], bouts["end"], strict=True)
    bouts["n_raw_initial_contacts"] = [int(contacts["ic"].between(start, end).sum()) for start, end in spans]
    measures = [name for name in strides.columns if name not in ("start", "end", "lr_label", "regular")]
    means = strides[strides["regular"]].groupby(level="wb_id")[measures].mean()
    return MobgapTables(contacts, strides, bouts.join(means))


def _samples(seconds: "np.ndarray", rate: float) -> np.ndarray:
    return np.round(np.asarray(seconds, np.float64) * rate).astype(np.int64)


def _sides(names: "np.ndarray | pd.Series") -> "pd.Categorical":
    import pandas as pd

    return pd.Categorical(names, categories=["left", "right"])


def _contacts(estimate: Estimate, table: "pd.DataFrame", rate: float) -> "pd.DataFrame":
    """Initial contacts in the estimate's diagnostics, or else those at the ends of its strides."""
    import pandas as pd

    listed = estimate.diagnostics
    if {"initial_contact", "initial_contact_side"} <= set(listed):
        seconds = as_float(listed["initial_contact"])
        side = np.asarray(SIDES, dtype=object)[np.asarray(listed["initial_contact_side"]).astype(int)]
    else:
        seconds, side = table[["start_s", "end_s"]].to_numpy().T.ravel(), np.tile(table["side"].to_numpy(object), 2)
    contacts = pd.DataFrame({"ic": _samples(seconds, rate), "lr_label": side}).drop_duplicates()
    contacts = contacts.sort_values("ic", kind="stable", ignore_index=True).rename_axis(index="step_id")
    return contacts.assign(lr_label=_sides(contacts["lr_label"]))


def _strides(table: "pd.DataFrame", rate: float) -> "pd.DataFrame":
    table = table.sort_values("start_s", kind="stable")
    begin, end = table["start_s"].to_numpy(np.float64), table["end_s"].to_numpy(np.float64)
    kept = ["s_id", *(name for name in ("stride_length_m", "walking_speed_mps") if name in table), "regular"]
    columns = table[kept].assign(
        wb_id=bout_numbers(begin, end), start=_samples(begin, rate), end=_samples(end, rate),
        lr_label=_sides(table["side"]), stride_duration_s=end - begin, cadence_spm=120.0 / (end - begin),
    ).set_index(["wb_id", "s_id"])  # fmt: skip
    columns[kept[1:-1]] = columns[kept[1:-1]].where(columns[kept[1:-1]] > 0.0)
    first = ["start", "end", "lr_label", "stride_duration_s", "cadence_spm"]
    return columns[[*first, *kept[1:]]]
