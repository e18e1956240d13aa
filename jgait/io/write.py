"""Estimates and recordings as tables, in degrees and metres, one column for each quantity."""

import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import PyTree

from jgait.estimators.totals import angles_usable
from jgait.io.atomic import check_path, replaced
from jgait.io.files import cells_in_lines, check_file, library, read_parquet, reading
from jgait.types import SIDES, Estimate, RangeReadings, Recording

if TYPE_CHECKING:
    import pandas as pd

PARQUET = (".parquet", ".pq")  # endings of Parquet files

FORMULA = re.compile(r"'*[=+\-@\t\r]")
"""Pattern of the begin of a text that a spreadsheet computes, perhaps behind apostrophes."""

_LEG_COLUMNS = (("hip_angle", "deg"), ("knee_angle", "deg"), ("x", "m"), ("y", "m"))
_FOOT_COLUMNS = (("position", "xyz", "_m"), ("velocity", "xyz", "_mps"), ("orientation", "wxyz", ""))


def to_dataframe(estimate: Estimate) -> "pd.DataFrame":
    """An estimate as a table, one row a sample.

    Columns: `time_s`; for each measured leg `hip_angle_<side>_deg`, `knee_angle_<side>_deg`, `x_<side>_m`,
    `y_<side>_m`; for each measured foot `position_x_<side>_m` … `position_z`, `velocity_x_<side>_mps` …, and the unit
    quaternion `orientation_w_<side>` … `orientation_z` that rotates the sensor's vectors to the world; standard
    deviations, where the estimate has them, with `_std` before the unit, of an orientation
    `orientation_x_<side>_std_deg` … of the rotation about the world's axes; `angles_valid_<side>`, False where hip and
    knee angles of that leg are not usable, if `jgait.analyse` computes it; `distance_m`; `valid`. What is not
    estimated has no column; where `valid` is False the numbers are NaN. For strides see `strides_to_dataframe`.

    Args:
        estimate: of one recording, arrays of (T,).
    """
    import pandas as pd

    time = np.asarray(estimate.time)
    if time.ndim != 1:
        raise ValueError(f"to_dataframe takes one recording, time of shape (T,); got shape {time.shape}")
    columns: dict[str, np.ndarray] = {"time_s": time}
    for side in SIDES:
        for legs, suffix in ((estimate.legs, ""), (estimate.stddev, "_std")):
            leg = None if legs is None else getattr(legs, side)
            for field, unit in () if leg is None else _LEG_COLUMNS:
                values = np.asarray(getattr(leg, field))
                columns[f"{field}_{side}{suffix}_{unit}"] = np.rad2deg(values) if unit == "deg" else values
        if f"angles_valid_{side}" in estimate.diagnostics:
            columns[f"angles_valid_{side}"] = angles_usable(estimate, side)
        for feet, suffix in ((estimate.feet, ""), (estimate.feet_stddev, "_std")):
            foot = None if feet is None else getattr(feet, side)
            for field, axes, unit in () if foot is None else _FOOT_COLUMNS:
                if (values := getattr(foot, field)) is None:
                    continue
                if suffix and field == "orientation":
                    axes, unit, values = "xyz", "_deg", np.rad2deg(values)
                for i, axis in enumerate(axes):
                    columns[f"{field}_{axis}_{side}{suffix}{unit}"] = np.asarray(values)[:, i]
    if estimate.distance is not None:
        columns["distance_m"] = np.asarray(estimate.distance)
    valid = np.asarray(estimate.valid, bool)
    table = pd.DataFrame({
        name: values if name == "time_s" or values.dtype == bool else np.where(valid, values, np.nan)
        for name, values in columns.items()
    })  # fmt: skip
    table["valid"] = valid
    return table


def recording_to_dataframe(recording: Recording) -> "pd.DataFrame":
    """A recording as a table that `recording_from_dataframe` can read.

    Columns: `time` [s], `<placement>_gyr_x` … [deg/s] to `<placement>_acc_z` [m/s²], and `feet_range` [m] if there is
    one; missing samples are NaN. The sensors must be on one clock.

    Raises:
        ValueError: for sensors of different lengths, or ranges that are not at their samples.
    """
    import pandas as pd

    lengths = {placement: len(imu.time) for placement, imu in recording.sensors.items()}
    if len(set(lengths.values())) != 1:
        raise ValueError(f"a table needs sensors on one clock; {recording.name} has samples {lengths}")
    columns: dict[str, np.ndarray] = {"time": np.asarray(next(iter(recording.sensors.values())).time)}
    for placement, imu in recording.sensors.items():
        for kind, scale in (("gyr", np.pi / 180.0), ("acc", 1.0)):
            signal = getattr(imu, kind)
            if signal is None:
                continue
            values = np.where(np.asarray(imu.mask)[:, None], np.asarray(signal) / scale, np.nan)
            columns.update({f"{placement}_{kind}_{axis}": values[:, i] for i, axis in enumerate("xyz")})
    if recording.feet_range is not None:
        columns["feet_range"] = _ranges(recording.feet_range, columns["time"], recording.name)
    return pd.DataFrame(columns)


def _ranges(read: RangeReadings, time: np.ndarray, name: str) -> np.ndarray:
    """Ranges at the samples of the sensors [m], NaN where not measured."""
    measured = np.asarray(read.mask, bool)
    at = np.asarray(read.time)[measured]
    sample = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    sample = np.where(at - time[sample - 1] < time[sample] - at, sample - 1, sample)
    step = float(np.median(np.diff(time)))
    if np.unique(sample).size < sample.size or np.any(np.abs(time[sample] - at) > 0.5 * step + 1e-9):
        raise ValueError(f"a table has room for one range a sample; those of {name} come oftener, or at other times")
    column = np.full(time.size, np.nan)
    column[sample] = np.asarray(read.distance)[measured]
    return column


def write_csv(
    what: "Estimate | Recording | pd.DataFrame | Mapping[str, pd.DataFrame]", path: str | os.PathLike[str]
) -> Path:
    """Write an estimate, a recording (for `read_csv`), or a table as a CSV file, completely or not at all.

    The table of `to_dataframe`, or of `recording_to_dataframe`, is written to a temporary file that then replaces the
    target: a reader never reads half a file, and after a failure the old file is unchanged.

    Args:
        what: an estimate of one recording; a recording; a table, as `strides_to_dataframe` makes it; or tables by
            sensor, as `to_gaitmap` makes them, which are joined to one table with a first column `sensor`.
        path: the file; its folder must exist.

    Raises:
        FileNotFoundError: if the folder does not exist.
    """
    check_path(path)
    return _written(what, Path(path), ".csv")


def write_table(
    what: "Estimate | Recording | pd.DataFrame | Mapping[str, pd.DataFrame]", path: str | os.PathLike[str]
) -> Path:
    """Write a table as Parquet, JSON or CSV, by the file's ending, completely or not at all, and return the path.

    Args:
        what: as `write_csv`.
        path: the file, `.csv`, `.json` (a list of rows), `.parquet` or `.pq`; its folder must exist.

    Raises:
        ValueError: for another ending.
        FileNotFoundError: if the folder does not exist.
        ImportError: if Parquet needs a library that is not installed.
    """
    check_path(path)
    ending = Path(path).suffix.lower()
    if ending not in (".csv", ".json", *PARQUET):
        raise ValueError(f"a table is written as .csv, .json, {', '.join(PARQUET)}; got {Path(path).name!r}")
    return _written(what, Path(path), ending)


def in_cells(table: "pd.DataFrame") -> "pd.DataFrame":
    """A table whose texts a spreadsheet takes for texts: those that it would compute begin with an apostrophe.

    `jgait.io.read_table` removes it.
    """
    return _with_texts(table, lambda text: f"'{text}" if FORMULA.match(text) else text)


def from_cells(table: "pd.DataFrame") -> "pd.DataFrame":
    """The table that `in_cells` was given."""
    return _with_texts(table, lambda text: text[1:] if text[:1] == "'" and FORMULA.match(text[1:]) else text)


def _with_texts(table: "pd.DataFrame", change: Callable[[str], str]) -> "pd.DataFrame":
    """A table with its texts, and the names of its columns, changed."""

    def changed(cell: PyTree) -> PyTree:
        return change(cell) if isinstance(cell, str) else cell

    texts = {
        name: column.map(changed)
        for name, column in table.items()
        if not (isinstance(column.dtype, np.dtype) and column.dtype.kind in "fiubmM")
    }
    return table.assign(**texts).rename(columns=changed)


def read_table(path: str | os.PathLike[str]) -> "pd.DataFrame":
    """A table that `write_table` or `write_csv` wrote, its texts as they were.

    Args:
        path: the file, `.csv`, `.json`, `.parquet` or `.pq`.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: for another ending, or if the file is no such table.
    """
    import pandas as pd

    file = Path(path)
    check_file(file, "a table")
    with reading(file, "a table"):
        if file.suffix.lower() in PARQUET:
            return read_parquet(file)
        if file.suffix.lower() == ".json":
            return pd.read_json(file, orient="records", precise_float=True)
        cells_in_lines(file, ",")
        return from_cells(pd.read_csv(file, encoding="utf-8"))


def _written(what: PyTree, target: Path, ending: str) -> Path:
    """Write a table to a temporary file, which then replaces the target."""
    import pandas as pd

    if isinstance(what, Recording):
        table = recording_to_dataframe(what)
    elif isinstance(what, Estimate):
        table = to_dataframe(what)
    elif isinstance(what, Mapping):
        parts = [part.reset_index().assign(sensor=sensor) for sensor, part in what.items()]
        table = pd.concat(parts, ignore_index=True)
        table = table[["sensor", *(name for name in table.columns if name != "sensor")]]
    else:
        table = what if all(name is None for name in what.index.names) else what.reset_index()
    if ending in PARQUET:
        library("pyarrow", "or writing Parquet files")
    with replaced(target) as part:
        if ending in PARQUET:
            table.to_parquet(part, engine="pyarrow", index=False)
        elif ending == ".json":
            table.to_json(part, orient="records", double_precision=9, indent=1, force_ascii=False)
        else:
            in_cells(table).to_csv(part, index=False, float_format="%.9g", encoding="utf-8")
    return target
