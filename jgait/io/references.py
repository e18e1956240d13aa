"""A reference from tables: joint angles, distance and positions sample by sample, and strides.

The columns are those of `to_dataframe` and `strides_to_dataframe`; others are ignored.
"""

import difflib
import itertools
from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from jgait.estimators.stride_flags import STRIDE_COLUMNS
from jgait.io.strides import TIMES
from jgait.types import (
    SIDES,
    AnyArray,
    Estimate,
    Feet,
    FootTrajectory,
    Legs,
    LegTrajectory,
    RecordingError,
    Strides,
    as_float,
)

if TYPE_CHECKING:
    import pandas as pd

STRIDE_NEEDS = ("side", "start_s", "end_s", "stride_length_m")  # columns that a table of strides must have

STRIDE_NAMES = (
    "s_id", "side", "valid", *(f"{name}_s" for name in TIMES), *STRIDE_COLUMNS,
    *(f"{name.rpartition('_')[0]}_std_{name.rpartition('_')[2]}" for name in STRIDE_COLUMNS),
)  # fmt: skip
"""Columns that a table of strides may have."""

SAMPLES = ("distance_m", *(
    name for side in SIDES for name in (
        f"hip_angle_{side}_deg", f"knee_angle_{side}_deg", *(f"{axis}_{side}_m" for axis in "xy"),
        *(f"position_{axis}_{side}_m" for axis in "xyz"))
))  # fmt: skip
"""Columns of a table of samples that are read, beside `time_s` and `valid`."""

LEAST_WAY = 2.0
"""[m] Way from which on knees and strides of a reference are compared with it; chosen by hand."""

LEAST_STRIDES = 4
"""[1] Number of strides from which on they are; chosen by hand."""


def reference_from_tables(
    time: Float[AnyArray, "time"], samples: "pd.DataFrame | None" = None, strides: "pd.DataFrame | None" = None,
    distance: float | None = None,
) -> Estimate:  # fmt: skip
    """A reference for `evaluate` and `tune`, from a motion capture system, a walkway or a simulation.

    Args:
        time: (T,) times of the reference [s], those of the recording's sensors.
        samples: columns `time_s`, on the recording's clock, which begins with 0, and any of `hip_angle_<side>_deg` with
            `knee_angle_<side>_deg`, `x_<side>_m` and `y_<side>_m` (ankle relative to hip), `position_x_<side>_m` with
            `_y` and `_z` (foot in the world), `distance_m`, `valid`. Values are interpolated to `time`; samples with an
            empty cell are not valid. A foot path that is not given is NaN.
        strides: columns `side` (right, left), `start_s` and `end_s` (initial contacts, on the recording's clock),
            `stride_length_m`, and any other of `strides_to_dataframe`.
        distance: distance walked in the whole recording [m], as by a tape; a table of samples has it in `distance_m`.

    Raises:
        RecordingError: a column that is needed is missing or misspelt, cells that are no numbers, a side that is none,
            times that do not increase or are those of another recording, numbers in another unit, strides that overlap,
            are negative, zero or steps, or no table at all.
    """
    if samples is None and strides is None and distance is None:
        raise RecordingError("a reference needs a table of samples or of strides, or a distance; got none")
    if distance is not None and (samples is not None or not 0.0 < distance < np.inf):
        raise RecordingError(
            "distance is that of the whole recording [m], above 0, without a table of samples, which has a column "
            f"'distance_m'; got {distance!r}{'' if samples is None else ' and a table of samples'}"
        )
    at = as_float(time)
    columns, valid = ({}, np.ones(len(at), bool)) if samples is None else _at(at, samples)
    none = np.full(len(at), np.nan)
    legs, feet = dict[str, LegTrajectory](), dict[str, FootTrajectory]()
    for side in SIDES:
        angles = [columns[name] for joint in ("hip", "knee") if (name := f"{joint}_angle_{side}_deg") in columns]
        if len(angles) == 2:
            path = [columns.get(f"{axis}_{side}_m", none) for axis in "xy"]
            legs[side] = LegTrajectory(*map(np.deg2rad, angles), *path)
        place = [columns[name] for axis in "xyz" if (name := f"position_{axis}_{side}_m") in columns]
        if len(place) == 3:
            feet[side] = FootTrajectory(np.stack(place, axis=1), None, None)
    reference = Estimate(
        at, Legs(*map(legs.get, SIDES)), None, columns.get("distance_m"), valid, {},
        None if strides is None else strides_from_dataframe(strides), Feet(*map(feet.get, SIDES)) if feet else None,
    )  # fmt: skip
    _check_units(reference)
    if distance is None:
        return reference
    # the person stands for a quarter of a second at both ends, where the distance is 0 and the whole distance
    start, end = at <= at[0] + 0.25, at >= at[-1] - 0.25
    return reference._replace(distance=np.where(start, 0.0, distance), valid=(start | end) & (start != end))


def _check_units(reference: Estimate) -> None:
    """Raise if numbers are far from those of walking people."""
    valid, table, strides, way = np.asarray(reference.valid, bool), reference.strides, 0, 0.0
    if table is not None and np.any(table.valid):
        known = np.asarray(table.valid, bool)
        strides, length = int(known.sum()), float(np.median(as_float(table.length)[known]))
        lasts = float(np.median((as_float(table.end) - as_float(table.start))[known]))
        if length > 4.0:
            raise RecordingError(f"column 'stride_length_m' is in metres; the median of the table is {length:.4g}")
        if lasts > 10.0:
            raise RecordingError(
                f"columns 'start_s' and 'end_s' are in seconds; a stride of the table lasts {lasts:.4g}"
            )
    if reference.distance is not None:
        time, distance = as_float(reference.time)[valid], as_float(reference.distance)[valid]
        way, seconds = float(np.ptp(distance)), max(float(np.ptp(as_float(reference.time))), 1e-9)
        if way > 12.0 * seconds:
            raise RecordingError(f"column 'distance_m' is in metres; {way:.4g} m in {seconds:.4g} s is no walking")
        if table is not None:
            start, end = as_float(table.start), as_float(table.end)
            known = np.asarray(table.valid, bool) & (start >= time[0]) & (end <= time[-1])
            length = float(as_float(table.length)[known].sum())
            gained = float((np.interp(end, time, distance) - np.interp(start, time, distance))[known].sum())
            # in public references lengths are 0.99 to 1.25 of the distance, those of steps a half
            if known.sum() >= LEAST_STRIDES and gained > LEAST_WAY and length < 0.6 * gained:
                raise RecordingError(
                    "column 'stride_length_m' is the way of a foot from a contact to its next one; lengths of the "
                    f"table are {length / gained:.2f} of 'distance_m' in the same time: they seem to be of steps"
                )
    for side, leg in zip(SIDES, reference.legs, strict=True):
        bends = 180.0 if leg is None else float(np.ptp(np.rad2deg(as_float(leg.knee_angle)[valid])))
        if (way > LEAST_WAY or strides >= LEAST_STRIDES) and bends < 5.0:
            varies = f"it varies by {bends:.2g}, which in walking is the angle in radians"
            raise RecordingError(f"column 'knee_angle_{side}_deg' is in degrees; {varies}")


def _check_columns(table: "pd.DataFrame", known: Collection[str], needed: Collection[str], what: str) -> None:
    """Raise if a column that is not known is nearly one that the table lacks, or a needed one is missing."""
    lacking = [name for name in known if name not in table]
    for column in map(str, table.columns):
        if column not in known and (near := difflib.get_close_matches(column, lacking, 1, 0.85)):
            raise RecordingError(f"{what} has a column {column!r}, which is not read; did you mean {near[0]!r}?")
    if missing := [name for name in needed if name in lacking]:
        raise RecordingError(f"{what} needs a column {missing[0]!r}; it has {', '.join(map(repr, table.columns[:12]))}")


def strides_from_dataframe(table: "pd.DataFrame") -> Strides:
    """Strides of a table with the columns of `strides_to_dataframe`: see `reference_from_tables`, also for errors."""
    _check_columns(table, STRIDE_NAMES, STRIDE_NEEDS, "a table of strides")
    numbers = {word: number for number, name in enumerate(SIDES) for word in (name, name[0])}
    sides = table["side"].astype(str).str.strip().str.lower().map(numbers)
    if sides.isna().any():
        wrong = table["side"][sides.isna()].iloc[0]
        raise RecordingError(f"column 'side' of a table of strides has 'right' or 'left'; got {wrong!r}")
    fields = {
        field: _numbers(table, column) / scale
        for column, (field, scale) in STRIDE_COLUMNS.items() if field and column in table
    }  # fmt: skip
    times = {name: _numbers(table, f"{name}_s") for name in TIMES if f"{name}_s" in table}
    start, end, length = times["start"], times["end"], fields["length"]
    valid = np.isfinite(start) & np.isfinite(end) & np.isfinite(length)
    if np.any(end[valid] <= start[valid]):
        raise RecordingError("every stride must end (end_s) after it starts (start_s); a row of the table does not")
    if (least := float(np.min(length[valid], initial=0.0))) < 0.0:
        raise RecordingError(f"column 'stride_length_m' has no negative lengths; got {least:.4g}")
    if zeros := int(np.sum(length[valid] == 0.0)):
        empty = "lengths that are 0; leave cells of lengths that are not known empty"
        raise RecordingError(f"column 'stride_length_m' has {zeros} of {int(valid.sum())} {empty}")
    for number, side in enumerate(SIDES):
        rows = np.flatnonzero(valid & (sides.to_numpy() == number))
        for first, then in itertools.pairwise(rows[np.argsort(start[rows], kind="stable")]):
            # joined strides of an analysis overlap by 0.22 at most; a wrong side by a half, a row that is twice by 1
            if end[first] - start[then] > 0.4 * min(end[first] - start[first], end[then] - start[then]):
                spans = f"{start[first]:g} to {end[first]:g} s and {start[then]:g} to {end[then]:g} s"
                why = "a row is twice in the table of strides, or has the wrong side"
                raise RecordingError(f"strides of the {side} foot overlap, {spans}; {why}")
    none, contact = np.full(len(table), np.nan), times.pop("final_contact", None)
    return Strides(**{"width": none, "height": none, **fields, **times}, side=sides.to_numpy(np.int64),
                   final_contact=contact, valid=valid)  # fmt: skip


def _numbers(table: "pd.DataFrame", column: str) -> np.ndarray:
    try:
        return table[column].to_numpy(np.float64)
    except (TypeError, ValueError) as error:
        raise RecordingError(f"column {column!r} of a reference must have numbers; {error}") from error


def _at(time: np.ndarray, samples: "pd.DataFrame") -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The columns of numbers of a table of samples at other times, and (T,) bool where they are known."""
    _check_columns(samples, ("time_s", "valid", *SAMPLES), ("time_s",), "a table of samples")
    given = _numbers(samples, "time_s")
    if len(given) < 2 or not np.all(np.diff(given) > 0.0):
        raise RecordingError("column 'time_s' of a reference must have two times or more, which increase")
    if (step := float(np.median(np.diff(given)))) > 0.5:
        raise RecordingError(
            f"column 'time_s' of a reference is in seconds, with 2 samples a second or more; its samples are "
            f"{step:.4g} s apart; if the distance is known at the end alone, give distance= without samples"
        )
    columns = {name: _numbers(samples, name) for name in SAMPLES if name in samples}
    known = np.isfinite(list(columns.values())).all(axis=0) if columns else np.zeros(len(given), bool)
    if "valid" in samples:
        known &= samples["valid"].astype(bool).to_numpy()
    if not known.any():
        raise RecordingError("a table of samples needs a sample in which every column of the reference has a number")
    there = given[known]
    after = np.minimum(np.searchsorted(there, time), len(there) - 1)
    apart = np.minimum(np.abs(time - there[after]), np.abs(time - there[np.maximum(after - 1, 0)]))
    valid = apart <= 2.0 * step
    if not valid.any():
        ours, theirs = (f"{float(t[0]):g} to {float(t[-1]):g} s" for t in (time, given))
        raise RecordingError(f"the reference has samples from {theirs}, the recording from {ours}: no time in common")
    return {name: np.interp(time, there, values[known]) for name, values in columns.items()}, valid
