"""Estimates and recordings as tables, in the units and names of the ecosystem: degrees, metres, one column each."""

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jgait.types import SIDES, Estimate, Recording

if TYPE_CHECKING:
    import pandas as pd

_LEG_COLUMNS = (("hip_angle", "deg"), ("knee_angle", "deg"), ("x", "m"), ("y", "m"))


def to_dataframe(estimate: Estimate) -> "pd.DataFrame":
    """An estimate as a table, one row a sample.

    Columns: `time_s`; for each measured side `hip_angle_<side>_deg`, `knee_angle_<side>_deg`, `x_<side>_m`,
    `y_<side>_m`, and the same with `_std` before the unit where standard deviations are stated; `distance_m`;
    `valid`. What is not measured has no column; where `valid` is False the numbers are NaN.

    Args:
        estimate: of one recording, arrays of (T,).

    Returns:
        The table, in degrees and metres.
    """
    import pandas as pd

    time = np.asarray(estimate.time)
    if time.ndim != 1:
        raise ValueError(f"to_dataframe takes one recording, time of shape (T,); got shape {time.shape}")
    columns: dict[str, Any] = {"time_s": time}
    for side in SIDES:
        for legs, suffix in ((estimate.legs, ""), (estimate.stddev, "_std")):
            leg = None if legs is None else getattr(legs, side)
            if leg is None:
                continue
            for field, unit in _LEG_COLUMNS:
                values = np.asarray(getattr(leg, field))
                columns[f"{field}_{side}{suffix}_{unit}"] = np.rad2deg(values) if unit == "deg" else values
    if estimate.distance is not None:
        columns["distance_m"] = np.asarray(estimate.distance)
    valid = np.asarray(estimate.valid, bool)
    table = pd.DataFrame({
        name: values if name == "time_s" else np.where(valid, values, np.nan) for name, values in columns.items()
    })  # fmt: skip
    table["valid"] = valid
    return table


def recording_to_dataframe(recording: Recording, *, gyr_unit: str = "deg/s", acc_unit: str = "m/s^2") -> "pd.DataFrame":
    """A recording as a table that `recording_from_dataframe` reads back.

    Columns: `time` [s], `<placement>_gyr_x` … `<placement>_acc_z`; missing samples are NaN.

    Args:
        recording: its sensors on one clock.
        gyr_unit: 'deg/s' or 'rad/s'.
        acc_unit: 'm/s^2' or 'g'.

    Returns:
        The table.

    Raises:
        ValueError: for an unknown unit, or sensors of different lengths.
    """
    import pandas as pd

    from jgait.io.read import ACC_UNITS, GYR_UNITS, unit_scale

    scales = {"gyr": unit_scale(gyr_unit, GYR_UNITS, "gyr_unit"), "acc": unit_scale(acc_unit, ACC_UNITS, "acc_unit")}
    lengths = {placement: len(imu.time) for placement, imu in recording.sensors.items()}
    if len(set(lengths.values())) != 1:
        raise ValueError(f"a table needs sensors on one clock; {recording.name} has samples {lengths}")
    columns: dict[str, Any] = {"time": np.asarray(next(iter(recording.sensors.values())).time)}
    for placement, imu in recording.sensors.items():
        for kind, scale in scales.items():
            signal = getattr(imu, kind)
            if signal is None:
                continue
            values = np.where(np.asarray(imu.mask)[:, None], np.asarray(signal) / scale, np.nan)
            columns.update({f"{placement}_{kind}_{axis}": values[:, i] for i, axis in enumerate("xyz")})
    return pd.DataFrame(columns)


def write_csv(what: Estimate | Recording, path: str | os.PathLike[str]) -> Path:
    """Write an estimate, or a recording that `read_csv` reads again, as a CSV file, whole or not at all.

    The table of `to_dataframe`, or of `recording_to_dataframe`, is written beside the target and then takes its place,
    so that a reader never sees half a file and a failure leaves the old one.

    Args:
        what: an estimate of one recording, or a recording.
        path: the file; its folder must exist.

    Returns:
        The path written.

    Raises:
        FileNotFoundError: if the folder does not exist.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise FileNotFoundError(f"the folder {target.parent} does not exist; write_csv makes no folders")
    table = recording_to_dataframe(what) if isinstance(what, Recording) else to_dataframe(what)
    handle, temporary = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".part", dir=target.parent)
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="") as stream:
            table.to_csv(stream, index=False, float_format="%.9g")
        os.chmod(temporary, 0o644)
        os.replace(temporary, target)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    return target
