"""Convert a user's CSV file or table to a `Recording` in SI units."""

import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jgait.io.arrays import recording_in_units
from jgait.io.atomic import check_path
from jgait.io.checks.sizes import are_counts, counts_without_unit
from jgait.io.clock import CLOCK_FROM_DATE, unwrapped
from jgait.io.dates import date_of, dated
from jgait.io.files import no_numbers, reading
from jgait.io.names import (
    CHANNELS,
    COUNTER,
    LONG_UNITS,
    SIDE_OF,
    column_of,
    like_a_signal,
    not_recognised,
    placement_of,
    recognised,
    unit_in_name,
)  # fmt: skip
from jgait.io.text import read_table
from jgait.io.units import Unit, unit_of_columns
from jgait.notes import DATA_LOST, DEDUCED, LEFT_OUT, Kind, Note
from jgait.types import PLACEMENTS, Recording, RecordingError

if TYPE_CHECKING:
    import pandas as pd

SIGNALS_LEFT_OUT = Kind(
    "signals_left_out", "check", "columns that look like those of a sensor are not used, because their names state no "
    "place that is known: {columns}",
    "If they are of a sensor on a leg or the trunk, write the place in their names, such as foot_left_gyr_x: without "
    "them a side, or a whole sensor, is missing in all results.",
)  # fmt: skip
ROWS_OF_SEVERAL = Kind(
    "rows_of_several", "check", "column {column} has {values} values, such as {first} and {second}: its rows are read "
    "as one recording",
    "If they are of several people or walks, strides and distance mix them. Read each on its own, as by "
    "table.groupby(column).",
)  # fmt: skip
WHOSE = ("subject", "person", "participant", "patient", "proband", "id", "trial", "walk", "session", "recording")
"""Names of columns that state of whom or which walk a row is."""

MOST_SENSORS = 20
"""Largest number of values of a column that states of which sensor a row is."""


class Columns(NamedTuple):
    """The signals in the columns of a table, in the table's units."""

    sensors: dict[str, dict[str, np.ndarray]]  #: placement → {"gyr": (T, 3), "acc": (T, 3) or absent}.
    time: np.ndarray | None  #: (T,) or None.
    feet_range: np.ndarray | None  #: (T,) or None.
    others: list[str]  #: names of columns that are not used.
    notes: tuple[Note, ...]  #: notes about cells without a number, rows of several people or walks, names of columns.
    time_unit: str | None  #: unit of `time`: "s" of dates, min and h, "ms" or "us" of a name; None: not stated.
    units: dict[str, dict[str, str]]  #: placement → "gyr", "acc" → unit, as far as the names of the columns state it.
    begin_s: float | None = None  #: [s] from 1970 to the first date, from which on `time` counts; None without dates.


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
    content = columns_of(
        table, placement=placement, units_of=[kind for kind, unit in given.items() if unit is None], name=name
    )
    if content.time is None and sampling_rate_hz is None:
        rest = f"; columns that are not of sensors: {', '.join(content.others)}" if content.others else ""
        index = table.index
        if index.name is None and index.dtype.kind == "f" and index.is_monotonic_increasing:
            rest += "; if the index without a name is the time, name it: table.rename_axis('time')"
        raise RecordingError(
            f"{name} has {len(table)} rows and no column called 'time', so {{argument}} is needed; it was not "
            f"given{rest}",
            argument="sampling_rate_hz",
        )
    units = {
        where: {
            kind: Unit(stated[kind], "header") if kind in stated else Unit(given[kind] or usual)
            for kind, usual in (("gyr", "deg/s"), ("acc", "m/s^2"))
        }
        for where, stated in content.units.items()
    }
    for where, signals in content.sensors.items():
        for kind, values in signals.items():
            if units[where][kind].origin == "argument" and given[kind] is None and are_counts(values):
                raise counts_without_unit(where, kind, name)
    recording = recording_in_units(
        content.sensors,
        units,
        time=content.time,
        feet_range=content.feet_range,
        sampling_rate_hz=sampling_rate_hz,
        time_unit=content.time_unit if content.time_unit == "s" else time_unit or content.time_unit,
        range_unit=range_unit,
        name=name,
        subject=subject,
    )
    dates = () if content.begin_s is None else (CLOCK_FROM_DATE(date=date_of(content.begin_s)),)
    return recording._replace(notes=(*dates, *recording.notes, *content.notes))


def columns_of(
    table: "pd.DataFrame",
    *,
    placement: str | None = None,
    units_of: Collection[str] = ("gyr", "acc"),
    name: str = "recording",
    placed: bool = False,
) -> Columns:
    """The signals in a table, in its units, identified by the names of its columns; see `recording_from_dataframe`.

    Args:
        table: one row a sample.
        placement: placement of the sensor, for a table of one sensor.
        units_of: kinds of signal whose unit is taken from the names of their columns.
        name: name of the recording in messages.
        placed: True if the table does not state the placements, so that no note says which columns are which.

    Raises:
        RecordingError: if columns are missing or contain no numbers.
    """
    if table.columns.nlevels > 1:
        raise RecordingError(
            f"{name} has columns of {table.columns.nlevels} levels, such as {tuple(map(str, table.columns[0]))}; "
            "expected <placement>_gyr_x, …; recording_from_gaitmap reads two levels, sensor and channel"
        )
    table = with_time(table)
    given = [str(column) for column in table.columns]
    _check_wide(table, given, name)
    renamed = [column.strip().lower() for column in given]
    if placement is not None:
        renamed = [f"{placement}_{column}" if column in CHANNELS else column for column in renamed]
    ours = recognised(given, renamed, placement)
    renamed = [ours.get(index, column) for index, column in enumerate(renamed)]
    position = {column: index for index, column in reversed(list(enumerate(renamed)))}
    if "time" not in position and COUNTER in position:
        counted = unwrapped(_numbers(table.iloc[:, position[COUNTER]], COUNTER, name))
        if counted is not None:
            table = table.assign(**{given[position[COUNTER]]: counted})
            position["time"] = position[COUNTER]
    placements_found = _placements(position, given, name)
    sensors: dict[str, dict[str, np.ndarray]] = {}
    units: dict[str, dict[str, str]] = {}
    used = {position["time"]} if "time" in position else set()
    for where, kinds in placements_found.items():
        sensors[where], units[where] = {}, {}
        for kind in kinds:
            indices = [position[f"{where}_{kind}_{axis}"] for axis in "xyz"]
            used.update(indices)
            stated = unit_of_columns([given[i] for i in indices], kind, name) if kind in units_of else None
            units[where] |= {} if stated is None else {kind: stated}
            sensors[where][kind] = np.stack([_numbers(table.iloc[:, i], given[i], name) for i in indices], axis=1)
    notes = [note for i in sorted(used) if (note := _no_number(table.iloc[:, i], given[i]))]
    for index, name_of_column in enumerate(renamed):
        whose = list(table.iloc[:, index].dropna().unique()) if name_of_column in WHOSE else []
        if len(whose) > 1:
            first, second = map(str, whose[:2])
            notes.append(ROWS_OF_SEVERAL(column=given[index], values=len(whose), first=first, second=second))
    time, unit, begin_s = None, None, None
    if "time" in position:
        clock = table.iloc[:, position["time"]]
        if (dates := dated(clock)) is not None:
            (time, begin_s), unit = dates, "s"
        else:
            time, unit = _numbers(clock, "time", name), unit_in_name(given[position["time"]])
        if unit in LONG_UNITS:
            time, unit = time * LONG_UNITS[unit], "s"
    apart = None
    if "feet_range" in position:
        used.add(position["feet_range"])
        apart = _numbers(table.iloc[:, position["feet_range"]], "feet_range", name)
    others = [column for index, column in enumerate(given) if index not in used]
    matched = [] if placed else [(given[index], renamed[index]) for index in sorted(used & set(ours))]
    notes += _about(matched, others)
    return Columns(sensors, time, apart, others, tuple(notes), unit, units, begin_s)


def _check_wide(table: "pd.DataFrame", given: list[str], name: str) -> None:
    """Refuse a table of one row for each sensor: a column tells apart rows whose times repeat, or states places."""
    if not set(CHANNELS[:3]) <= {column_of(column) for column in given}:
        return
    clock = next((index for index, column in enumerate(given) if column_of(column) == "time"), None)
    times = None if clock is None else table.iloc[:, clock]
    for index, column in enumerate(given):
        cells = table.iloc[:, index]
        values = list(cells.dropna().unique()) if index != clock and cells.dtype.kind != "f" else []
        if not 2 <= len(values) <= MOST_SENSORS:
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
        every = [f"{theirs!r} as {name}" for theirs, name in matched]
        sensors = [text for text, (_, name) in zip(every, matched, strict=True) if name != "time"]
        examples = " and ".join((sensors or every)[:2])
        notes.append(DEDUCED.note(f"columns recognised by their names: {len(every)}, such as {examples}"))
    signals = [name for name in others if like_a_signal(name)]
    if signals:
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


def _no_number(column: "pd.Series", label: str) -> Note | None:
    """The note about cells of a column that are no numbers; None if all cells are numbers."""
    odd = no_numbers(column)
    if not len(odd) or len(odd) == len(column):
        return None
    row = int(np.flatnonzero(column.index == odd.index[0])[0])
    first = f"the first {odd.iloc[0]!r} in data row {row + 1}"
    return DATA_LOST.note(f"{label}: cells without a number count as missing: {len(odd)}, {first}")


def _hint(value: str) -> str:
    """What to do about a cell that is no number."""
    if ":" in value:
        return ": write times as 2026-05-03 10:00:00.25, or seconds, or leave the column out and give the sampling rate"
    if "," in value:
        return ": for decimal commas, separate the columns by semicolons"
    return ""


def with_time(table: "pd.DataFrame") -> "pd.DataFrame":
    """The table with its index as the column `time`, if the index is a clock and no column is."""
    import pandas as pd

    index = table.index
    clock = isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex) or column_of(str(index.name)) == "time"
    if not clock or any(column_of(str(column)) == "time" for column in table.columns):
        return table
    return table.reset_index(names=str(index.name) if column_of(str(index.name)) == "time" else "time")


def _numbers(column: "pd.Series", label: str, name: str) -> np.ndarray:
    """A column as floats; cells without a number become NaN."""
    import pandas as pd

    values = pd.to_numeric(column, errors="coerce").to_numpy(np.float64, na_value=np.nan)
    if len(values) and not np.isfinite(values).any() and column.notna().any():
        raise RecordingError(
            f"{name}: column {label!r} holds no numbers; its first value is {column.dropna().iloc[0]!r}"
            f"{_hint(str(column.dropna().iloc[0]))}"
        )
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
            table,
            placement=placement,
            sampling_rate_hz=sampling_rate_hz,
            time_unit=time_unit,
            gyr_unit=gyr_unit,
            acc_unit=acc_unit,
            range_unit=range_unit,
            name=name or file.stem,
            subject=subject or name or file.stem,
        )
        return recording._replace(notes=(*notes, *recording.notes))
