"""Data of gaitmap and mobgap as recordings, every frame and unit by their documentation.

gaitmap (feet): m/s², deg/s. Its *sensor frame* has x towards the toes, y to the left, z up; its *body frame* (`pa`
along the foot, `ml` outwards, `si` down for the acceleration) is mirrored between the feet, and its rates have signs of
their own: forth and back is the same change of signs. mobgap (lower back): m/s², deg/s. Its sensor frame has x up, y to
the right, z forward; its body frame only has other names for the same axes (`is`, `ml`, `pa`). Recordings keep the
sensor frame. Source: gaitmap 2, `utils.consts`; mobgap 1, `consts` and `utils.conversions`; both are tested against
them.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from jgait.io.dates import clock_of
from jgait.io.names import CHANNELS, placement_of
from jgait.io.part import Measured, Part
from jgait.io.recording import settle
from jgait.types import Recording, RecordingError

if TYPE_CHECKING:
    import pandas as pd

GAITMAP_PLACEMENTS = {"left_sensor": "foot_left", "right_sensor": "foot_right"}
"""Name of a sensor in gaitmap's examples → its placement."""

BODY_GAITMAP = ("gyr_pa", "gyr_ml", "gyr_si", "acc_pa", "acc_ml", "acc_si")
"""gaitmap's names in the body frame, of the channels `gyr_x` … `acc_z`."""

SIGNS_GAITMAP = {"left": (-1, -1, -1, 1, 1, -1), "right": (1, -1, 1, 1, -1, -1)}
"""Body frame over sensor frame of each, for either foot."""

BODY_MOBGAP = ("gyr_is", "gyr_ml", "gyr_pa", "acc_is", "acc_ml", "acc_pa")
"""mobgap's names in the body frame, of the channels `gyr_x` … `acc_z`."""


def recording_from_gaitmap(
    dataset: "Mapping[str, pd.DataFrame] | pd.DataFrame",
    sampling_rate_hz: float,
    *,
    placements: Mapping[str, str] = GAITMAP_PLACEMENTS,
    gyr_unit: str | None = None,
    acc_unit: str | None = None,
    name: str = "recording",
    subject: str = "subject",
) -> Recording:
    """A recording from gaitmap's data of several sensors, in gaitmap's sensor frame.

    Args:
        dataset: sensor → table, or one table with two levels of columns, sensor and channel; m/s² and deg/s. The names
            state the frame: sensor (`acc_x`, …) or body (`acc_pa`, …), which is mirrored between the feet.
        sampling_rate_hz: of the data [Hz].
        placements: gaitmap's name of a sensor → its placement.
        gyr_unit: for data that are not in deg/s; this and the rest as `recording_from_arrays`.
        acc_unit: for data that are not in m/s².
        name: of the recording.
        subject: name of the person.

    Raises:
        RecordingError: if columns are missing, sensors cannot be placed, or the recording is unusable.
    """
    if isinstance(dataset, Mapping):
        tables = {str(sensor): table for sensor, table in dataset.items()}
    elif dataset.columns.nlevels == 2:
        tables = {str(sensor): dataset[sensor] for sensor in dataset.columns.unique(0)}
    else:
        raise RecordingError(
            f"{name}: expected gaitmap's data of several sensors, columns of two levels; found "
            f"{list(dataset.columns)}; pass one sensor as {{'left_sensor': table}}"
        )
    parts = gaitmap_parts(tables, name, placements)
    chosen = {part.label: placements[part.label] for part in parts if part.label in placements}
    return settle(
        Measured(parts, name, subject), placements=chosen, gyr_unit=gyr_unit, acc_unit=acc_unit,
        sampling_rate_hz=sampling_rate_hz,
    )  # fmt: skip


def recording_from_mobgap(
    table: "pd.DataFrame",
    sampling_rate_hz: float,
    *,
    placement: str = "lower_back",
    gyr_unit: str | None = None,
    acc_unit: str | None = None,
    name: str = "recording",
    subject: str = "subject",
) -> Recording:
    """A recording from mobgap's data of one sensor, in mobgap's sensor frame.

    Args:
        table: `acc_x` … `gyr_z`, or `acc_is` … `gyr_pa`; m/s² and deg/s.
        sampling_rate_hz: of the data [Hz].
        placement: placement of the sensor.
        gyr_unit: for data that are not in deg/s; this and the rest as `recording_from_arrays`.
        acc_unit: for data that are not in m/s².
        name: of the recording.
        subject: name of the person.

    Raises:
        RecordingError: if columns are missing, as in mobgap's global frames, or the recording is unusable.
    """
    part = mobgap_part(table, name)._replace(placement=placement)
    return settle(
        Measured([part], name, subject), gyr_unit=gyr_unit, acc_unit=acc_unit, sampling_rate_hz=sampling_rate_hz
    )


def gaitmap_parts(
    tables: "Mapping[str, pd.DataFrame]", name: str, placements: Mapping[str, str] = GAITMAP_PLACEMENTS
) -> list[Part]:
    """Parts of gaitmap's sensors, turned to its sensor frame."""
    parts = []
    for sensor, table in tables.items():
        where = placements.get(sensor) or placement_of(sensor)
        part, body = _part(table, BODY_GAITMAP, f"{name}, {sensor}")
        signs = np.array(SIGNS_GAITMAP.get((where or "").rpartition("_")[2], ()))
        if body and not signs.size:
            why = f"gaitmap's body frame is mirrored between the feet, and {sensor!r} is not known to be of either"
            raise RecordingError(f"{name}: {why}; give its placement")
        if body:
            part = part._replace(gyr=part.gyr * signs[:3], acc=part.acc * signs[3:])
        parts.append(part._replace(label=sensor, placement=where))
    return parts


def mobgap_part(table: "pd.DataFrame", name: str) -> Part:
    """The part of mobgap's sensor, which sat at the lower back."""
    return _part(table, BODY_MOBGAP, name)[0]._replace(placement="lower_back")


def _part(table: "pd.DataFrame", body: tuple[str, ...], name: str) -> tuple[Part, bool]:
    """The sensor of a table, and whether its columns are named as in the body frame."""
    names = list(map(str, table.columns))
    in_body = not set(body).isdisjoint(names)
    columns = list(body if in_body else CHANNELS)
    if lacking := [column for column in columns if column not in names]:
        raise RecordingError(f"{name} lacks {', '.join(lacking)}: expected columns {columns}, found {names}")
    try:
        values = table[columns].to_numpy(np.float64)
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{name}: {', '.join(columns)} must be numbers: {error}") from error
    time, begin_s = clock_of(table, name)
    return Part(
        "lower_back", values[:, :3], values[:, 3:], time, gyr_unit="deg/s", acc_unit="m/s^2", units_by="names",
        begin_s=begin_s,
    ), in_body  # fmt: skip
