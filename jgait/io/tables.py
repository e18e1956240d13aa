"""Convert a user's CSV file or table to a `Recording` in SI units."""

import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jgait.io.atomic import check_path
from jgait.io.clock import TIME_UNITS, check_order, count_samples, time_unit_deduced, unit_of_time, unwrapped
from jgait.io.dates import dated, with_time
from jgait.io.files import numbers, reading
from jgait.io.names import (
    CHANNELS,
    COUNTER,
    LONG_UNITS,
    SIDE_OF,
    column_of,
    lettered,
    like_a_signal,
    no_placement,
    not_recognised,
    placement_of,
    recognised,
    unit_in_name,
)
from jgait.io.part import Measured, Part
from jgait.io.recording import settle
from jgait.io.text import read_table
from jgait.io.units import unit_of_columns
from jgait.notes import BY_NAME, DATA_LOST, LEFT_OUT, Kind, Note
from jgait.types import PLACEMENTS, Recording, RecordingError

if TYPE_CHECKING:
    import pandas as pd

SIGNALS_LEFT_OUT = Kind(
    "signals_left_out", "check", "columns that look like those of a sensor are not used, because their names state no "
    "place that is known: {columns}",
    "If they are of a sensor on a leg or the trunk, write the place in their names, such as foot_left_gyr_x: without "
    "them a side, or a whole sensor, is missing in all results.",
)  # fmt: skip


def recording_from_dataframe(
    table: "pd.DataFrame",
    *,
    placement: str | None = None,
    sampling_rate_hz: float | None = None,
    time_unit: str | None = None,
    gyr_unit: str | None = None,
    acc_unit: str | None = None,
    range_unit: str = "m",
    name: str = "recording",
    subject: str = "subject",
) -> Recording:
    """A recording from a table with columns `<placement>_gyr_x` … `<placement>_acc_z`, perhaps `time` and `feet_range`.

    Names are compared without regard to case and surrounding blanks; a lab's names (`GyroThighR_x`) are recognised, and
    noted. Accelerometer columns are optional for each placement, all three or none. `feet_range` is the distance from
    the inner side of the left ankle to the right leg, empty where it was not measured. Other columns are left out and
    noted.

    Args:
        table: one row a sample.
        placement: placement of the sensor, for a table of one sensor with columns `gyr_x` … `acc_z`.
        sampling_rate_hz: as `recording_from_arrays`.
        time_unit: as `recording_from_arrays`.
        gyr_unit: as `recording_from_arrays`; None: each sensor's as the names of its columns state it
            (`shank_right_gyr_x [rad/s]`), which is noted, else deg/s.
        acc_unit: as gyr_unit; else m/s².
        range_unit: as `recording_from_arrays`.
        name: name of the recording in tables and figures.
        subject: name of the person.

    Raises:
        ValueError: for an unknown unit.
        RecordingError: if columns are missing (the message lists the expected and the given columns, and similar
            names) or contain no numbers, if their names state an unknown unit, or different units of one signal, or if
            the recording is unusable.
    """
    given = {"gyr": gyr_unit, "acc": acc_unit}
    units_of = [kind for kind, unit in given.items() if unit is None]
    content = measured_table(table, placement=placement, units_of=units_of, time_unit=time_unit, name=name)
    if sampling_rate_hz is None and all(part.time is None and part.packets is None for part in content.parts):
        left_out = content.unread
        rest = f"; columns that are not of sensors: {', '.join(left_out)}" if left_out else ""
        index = table.index
        if index.name is None and index.dtype.kind == "f" and index.is_monotonic_increasing:
            rest += "; if the index without a name is the time, name it: table.rename_axis('time')"
        raise RecordingError(
            f"{name} has {len(table)} rows and no column called 'time', so {{argument}} is needed; it was not "
            f"given{rest}",
            argument="sampling_rate_hz",
        )
    return settle(
        content, gyr_unit=gyr_unit, acc_unit=acc_unit, range_unit=range_unit, sampling_rate_hz=sampling_rate_hz,
        usual={"gyr": "deg/s", "acc": "m/s^2"}, subject=subject,
    )  # fmt: skip


def measured_table(
    table: "pd.DataFrame",
    *,
    placement: str | None = None,
    units_of: Collection[str] = ("gyr", "acc"),
    time_unit: str | None = None,
    name: str = "recording",
    placed: bool = False,
) -> Measured:
    """The sensors in a table, in its units, identified by the names of its columns; see `recording_from_dataframe`.

    Args:
        table: one row a sample.
        placement: placement of the sensor, for a table of one sensor.
        units_of: kinds of signal whose unit is taken from the names of their columns.
        time_unit: unit of the times where their name states none; None: deduced from their steps.
        name: name of the recording.
        placed: True if the table does not state the placements, so that no note says which columns are which.
    """
    if table.columns.nlevels > 1:
        raise RecordingError(
            f"{name} has columns of {table.columns.nlevels} levels, such as {tuple(map(str, table.columns[0]))}; "
            "expected <placement>_gyr_x, …; recording_from_gaitmap reads two levels, sensor and channel"
        )
    table = with_time(table)
    given = lettered([str(column) for column in table.columns])
    _check_wide(table, given, name)
    renamed = [column.strip().lower() for column in given]
    if placement is not None and placement not in PLACEMENTS:
        raise RecordingError(f"{name}: {no_placement(placement)}")
    if placement is not None:
        renamed = [f"{placement}_{column}" if column in CHANNELS else column for column in renamed]
    ours = recognised(given, renamed, placement)
    renamed = [ours.get(index, column) for index, column in enumerate(renamed)]
    position = {column: index for index, column in reversed(list(enumerate(renamed)))}
    notes: list[Note] = []
    used = set[int]()

    def numbers_of(column: str) -> np.ndarray:
        index = position[column]
        used.add(index)
        return _numbers(table.iloc[:, index], given[index], name, notes)

    sensors: dict[str, dict[str, np.ndarray]] = {}
    units: dict[str, dict[str, str | None]] = {}
    for where, kinds in _placements(position, given, name).items():
        of = {kind: [f"{where}_{kind}_{axis}" for axis in "xyz"] for kind in kinds}
        sensors[where] = {
            kind: np.stack([numbers_of(column) for column in columns], axis=1) for kind, columns in of.items()
        }
        units[where] = {
            kind: unit_of_columns([given[position[column]] for column in columns], kind, name)
            for kind, columns in of.items() if kind in units_of
        }  # fmt: skip
    time, packets, begin_s = None, None, None
    if "time" in position and (dates := dated(table.iloc[:, position["time"]])) is not None:
        used.add(position["time"])
        time, begin_s = dates
    elif "time" in position:
        unit = unit_in_name(given[position["time"]])
        time, stated = numbers_of("time"), unit or time_unit
        if unit in LONG_UNITS:
            time, stated = time * LONG_UNITS[unit], "s"
        if stated is None and count_samples(time):
            time, packets = None, time
        elif len(time) > 1:
            check_order(time, name)
            unit = unit_of_time(time, stated, name)
            notes += [] if stated else [time_unit_deduced(unit, time)]
            time = TIME_UNITS[unit] * time
    elif COUNTER in position:
        packets = unwrapped(numbers_of(COUNTER))
        used -= {position[COUNTER]} if packets is None else set()
    feet_range = numbers_of("feet_range") if "feet_range" in position else None
    others = [column for index, column in enumerate(given) if index not in used]
    matched = [] if placed else [(given[index], renamed[index]) for index in sorted(used & set(ours))]
    parts = [
        Part(where, signals["gyr"], signals.get("acc"), time, gyr_unit=units[where].get("gyr"),
             acc_unit=units[where].get("acc"), packets=packets, units_by="header", begin_s=begin_s)
        for where, signals in sensors.items()
    ]  # fmt: skip
    return Measured(parts, name, notes=(*notes, *_about(matched, others)), feet_range=feet_range, unread=tuple(others))


def _check_wide(table: "pd.DataFrame", given: list[str], name: str) -> None:
    """Refuse a table of one row for each sensor: a column tells apart rows whose times repeat, or states places."""
    if not set(CHANNELS[:3]) <= {column_of(column) for column in given}:
        return
    clock = next((index for index, column in enumerate(given) if column_of(column) == "time"), None)
    times = None if clock is None else table.iloc[:, clock]
    for index, column in enumerate(given):
        cells = table.iloc[:, index]
        values = list(cells.dropna().unique()) if index != clock and cells.dtype.kind != "f" else []
        if not 2 <= len(values) <= 20:  # more are no sensors
            continue
        whose = [value for value in values if placement_of(str(value)) or str(value).strip().lower() in SIDE_OF]
        apart = times is not None and not times.is_unique
        if len(whose) > 1 or (apart and all(part.is_unique for _, part in times.groupby(cells))):  # type: ignore[union-attr]
            raise RecordingError(
                f"{name} has a row for each sensor, which its column {column!r} states ({values[0]}, {values[1]}): "
                "write the rows of each to a file called by its place, such as foot_left.csv, and give their folder"
            )


def _about(matched: list[tuple[str, str]], others: list[str]) -> list[Note]:
    """Notes about columns that were recognised, by the names in the table and in jgait, and about those not used."""
    notes = []
    if matched:
        sensors = [pair for pair in matched if pair[1] != "time"] or matched
        examples = " and ".join(f"{theirs!r} as {ours}" for theirs, ours in sensors[:2])
        notes.append(BY_NAME.note(f"columns recognised by their names: {len(matched)}, such as {examples}"))
    if signals := [name for name in others if like_a_signal(name)]:
        notes.append(SIGNALS_LEFT_OUT(columns=signals))
    if rest := [name for name in others if name not in signals]:
        notes.append(LEFT_OUT.note("columns left out: {columns}", columns=rest))
    return notes


def _placements(position: Mapping[str, int], given: list[str], name: str) -> dict[str, list[str]]:
    """Placement → kinds of signal for which all three axes are present."""
    placements: dict[str, list[str]] = {}
    for placement in PLACEMENTS:
        for kind in ("gyr", "acc"):
            expected = [f"{placement}_{kind}_{axis}" for axis in "xyz"]
            lacking = [column for column in expected if column not in position]
            if len(lacking) == 3:
                continue
            if kind == "acc" and placement not in placements:
                lacking = lacking or [column.replace("_acc_", "_gyr_") for column in expected]
            if lacking:
                raise not_recognised(lacking, position, given, name)
            placements.setdefault(placement, []).append(kind)
    if not placements:
        raise not_recognised([], position, given, name)
    return placements


def _numbers(column: "pd.Series", label: str, name: str, notes: list[Note]) -> np.ndarray:
    """A column as floats; cells without a number become NaN, which is noted."""
    values, odd = numbers(column)
    if len(odd) and not np.isfinite(values).any():
        first = str(odd.iloc[0])
        hint = ": for decimal commas, separate the columns by semicolons" if "," in first else ""
        if ":" in first:
            hint = ": write times as 2026-05-03 10:00:00.25, or seconds, or leave them out and give the sampling rate"
        raise RecordingError(f"{name}: column {label!r} holds no numbers; its first value is {odd.iloc[0]!r}{hint}")
    if len(odd):
        row = int(np.flatnonzero(column.index == odd.index[0])[0])
        first = f"the first {odd.iloc[0]!r} in data row {row + 1}"
        notes.append(DATA_LOST.note(f"{label}: cells without a number count as missing: {len(odd)}, {first}"))
    return values


def read_csv(
    path: str | os.PathLike[str],
    *,
    placement: str | None = None,
    sampling_rate_hz: float | None = None,
    time_unit: str | None = None,
    gyr_unit: str | None = None,
    acc_unit: str | None = None,
    range_unit: str = "m",
    name: str | None = None,
    subject: str | None = None,
) -> Recording:
    """A recording from a CSV file with a header; comma, semicolon or tab, decimal point or comma.

    Lines above the header are left out, and noted; a row of units below it counts as units in the columns' names.
    Arguments as `recording_from_dataframe`; the names of the recording and of the person are that of the file
    without its ending, if none is given.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: for an unknown unit.
        RecordingError: if the file is empty, no text, has no rows, lacks columns, or its recording is unusable. A last
            row that is cut off is left out, and noted.
    """
    check_path(path)
    file = Path(path)
    with reading(file, "a table"):
        table, notes = read_table(file)
        recording = recording_from_dataframe(
            table, placement=placement, sampling_rate_hz=sampling_rate_hz, time_unit=time_unit, gyr_unit=gyr_unit,
            acc_unit=acc_unit, range_unit=range_unit, name=name or file.stem, subject=subject or name or file.stem,
        )  # fmt: skip
        return recording._replace(notes=(*notes, *recording.notes))
