"""Strides as tables: in metres and degrees, and as gaitmap's stride lists in samples."""

from typing import TYPE_CHECKING

import numpy as np

from jgait.estimators.columns import COLUMNS
from jgait.estimators.stride_flags import BREAK, STRIDE_COLUMNS, in_order, pauses
from jgait.estimators.walking import durations
from jgait.types import SIDES, Estimate, as_float

if TYPE_CHECKING:
    import pandas as pd

TIMES = ("start", "final_contact", "end", "standing", "standing_end")


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
