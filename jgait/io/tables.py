"""Convert a user's CSV file or table to a `Recording` in SI units."""

import difflib
import itertools
import os
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jgait.io.arrays import recording_from_arrays
from jgait.io.files import check_columns, check_width, reading
from jgait.io.names import CHANNELS, recognised, states_milliseconds
from jgait.notes import DEDUCED, LEFT_OUT, LOSSES, Kind, Note
from jgait.types import PLACEMENTS, Recording, RecordingError

if TYPE_CHECKING:
    import pandas as pd

COLUMNS_MATCHED = Kind("columns_matched", "info", "columns recognised by their names: {columns}", DEDUCED)
COLUMNS_LEFT_OUT = Kind("columns_left_out", "info", "columns left out: {columns}", LEFT_OUT)
CELLS_WITHOUT_NUMBER = Kind(
    "cells_without_number", "check",
    "{column}: {cells} cells are no numbers and count as missing, the first {value} in data row {row}", LOSSES,
)  # fmt: skip


SHORT_CELLS = 1_000_000
"""Number of cells that rows of a table may lack."""


class Columns(NamedTuple):
    """The signals in the columns of a table, in the table's units.

    Attributes:
        sensors: placement → {"gyr": (T, 3), "acc": (T, 3) or absent}.
        time: (T,) or None.
        feet_range: (T,) or None.
        others: names of columns that are not used.
        matched: the table's name and jgait's name of each column with a lab's name.
        odd: notes about cells without a number.
        milliseconds: whether the name of the time column states ms.
    """

    sensors: dict[str, dict[str, np.ndarray]]
    time: np.ndarray | None
    feet_range: np.ndarray | None
    others: tuple[str, ...]
    matched: tuple[tuple[str, str], ...] = ()
    odd: tuple[Note, ...] = ()
    milliseconds: bool = False


def recording_from_dataframe(
    table: "pd.DataFrame",
    *,
    columns: Mapping[str, str] | None = None,
    placement: str | None = None,
    needs: Iterable[str] = (),
    sampling_rate_hz: float | None = None,
    time_unit: str | None = None,
    gyr_unit: str = "deg/s",
    acc_unit: str = "m/s^2",
    range_unit: str = "m",
    name: str = "recording",
    subject: str = "subject",
    check_sizes: bool = True,
) -> Recording:
    """A recording from a table with columns `<placement>_gyr_x` … `<placement>_acc_z`, perhaps `time` and `feet_range`.

    Names are compared without regard to case and surrounding blanks; a lab's names (`GyroThighR_x`) are recognised, and
    noted. Accelerometer columns are optional for each placement, all three or none. `feet_range` is the distance from
    the inner side of the left ankle to the right leg, empty where it was not measured. Other columns are left out and
    noted.

    Args:
        table: one row a sample.
        columns: the table's name → the expected name, for example {"Gx R": "thigh_right_gyr_x"}.
        placement: placement of the sensor, for a table of one sensor with columns `gyr_x` … `acc_z`.
        needs: required placements.
        sampling_rate_hz: as `recording_from_arrays`.
        time_unit: as `recording_from_arrays`.
        gyr_unit: as `recording_from_arrays`.
        acc_unit: as `recording_from_arrays`.
        range_unit: as `recording_from_arrays`.
        name: name of the recording in tables and figures.
        subject: name of the person.
        check_sizes: as `recording_from_arrays`.

    Returns:
        The recording in SI units.

    Raises:
        ValueError: for an unknown unit.
        RecordingError: if columns are missing (the message lists the expected and the given columns, and similar
            names) or contain no numbers, or if the recording is unusable.
    """
    content = columns_of(table, columns=columns, placement=placement, needs=needs, name=name)
    recording = recording_from_arrays(
        content.sensors,
        time=content.time,
        feet_range=content.feet_range,
        sampling_rate_hz=sampling_rate_hz,
        time_unit="ms" if time_unit is None and content.milliseconds else time_unit,
        gyr_unit=gyr_unit,
        acc_unit=acc_unit,
        range_unit=range_unit,
        name=name,
        subject=subject,
        check_sizes=check_sizes,
    )
    return recording._replace(notes=(*recording.notes, *about(content)))


def columns_of(
    table: "pd.DataFrame",
    *,
    columns: Mapping[str, str] | None = None,
    placement: str | None = None,
    needs: Iterable[str] = (),
    name: str = "recording",
) -> Columns:
    """The signals in a table, in its units, identified by the names of its columns; see `recording_from_dataframe`.

    Raises:
        RecordingError: if columns are missing or contain no numbers.
    """
    given = [str(column) for column in table.columns]
    renamed = _renamed(given, columns or {}, placement, name)
    ours = recognised(given, renamed, placement)
    renamed = [ours.get(index, column) for index, column in enumerate(renamed)]
    position = {column: index for index, column in reversed(list(enumerate(renamed)))}
    placements_found = _placements(position, given, tuple(needs), name)
    sensors: dict[str, dict[str, np.ndarray]] = {}
    used = {position["time"]} if "time" in position else set()
    for where, kinds in placements_found.items():
        sensors[where] = {}
        for kind in kinds:
            indices = [position[f"{where}_{kind}_{axis}"] for axis in "xyz"]
            used.update(indices)
            sensors[where][kind] = np.stack([_numbers(table.iloc[:, i], given[i], name) for i in indices], axis=1)
    odd = tuple(note for i in sorted(used) if (note := _no_number(table.iloc[:, i], given[i])))
    time = _numbers(table.iloc[:, position["time"]], "time", name) if "time" in position else None
    apart = None
    if "feet_range" in position:
        used.add(position["feet_range"])
        apart = _numbers(table.iloc[:, position["feet_range"]], "feet_range", name)
    others = tuple(column for index, column in enumerate(given) if index not in used)
    matched = tuple((given[index], renamed[index]) for index in sorted(used & set(ours)))
    milliseconds = "time" in position and states_milliseconds(given[position["time"]])
    return Columns(sensors, time, apart, others, matched, odd, milliseconds)


def about(content: Columns) -> tuple[Note, ...]:
    """Notes about columns whose names were recognised, and about columns that are not used."""
    notes = [*content.odd]
    if content.matched:
        notes.append(COLUMNS_MATCHED(columns=[f"{theirs!r} as {name}" for theirs, name in content.matched]))
    if content.others:
        notes.append(COLUMNS_LEFT_OUT(columns=content.others))
    return tuple(notes)


def _renamed(given: list[str], columns: Mapping[str, str], placement: str | None, name: str) -> list[str]:
    """The names of the table's columns, converted to jgait's names."""
    absent = [column for column in columns if column not in given]
    if absent:
        near = difflib.get_close_matches(absent[0], given, 1, 0.5)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise RecordingError(f"{name} has no column {absent[0]!r} (named in columns); it has {given}{hint}")
    renamed = [columns.get(column, column).strip().lower() for column in given]
    if placement is not None:
        renamed = [f"{placement}_{column}" if column in CHANNELS else column for column in renamed]
    return renamed


def _placements(
    position: Mapping[str, int], given: list[str], needs: tuple[str, ...], name: str
) -> dict[str, list[str]]:
    """Placement → kinds of signal for which all three axes are present."""
    placements: dict[str, list[str]] = {}
    for placement in PLACEMENTS:
        for kind in ("gyr", "acc"):
            expected = [f"{placement}_{kind}_{axis}" for axis in "xyz"]
            lacking = [column for column in expected if column not in position]
            if len(lacking) == 3 and (kind == "acc" or placement not in needs):
                continue
            if lacking:
                raise _lacking(lacking, expected, given, name)
            if kind == "acc" and placement not in placements:
                raise RecordingError(
                    f"{name} has {placement}_acc_x, _y, _z but no {placement}_gyr_x, _y, _z; "
                    "a sensor needs its gyroscope"
                )
            placements.setdefault(placement, []).append(kind)
    if not placements:
        expected = [f"thigh_right_gyr_{axis}" for axis in "xyz"]
        raise _lacking(expected, expected, given, name, "such as ")
    return placements


def _lacking(lacking: list[str], expected: list[str], given: list[str], name: str, such_as: str = "") -> RecordingError:
    every = [f"{placement}_{channel}" for placement in PLACEMENTS for channel in CHANNELS]
    clean = {column: column.strip().lower() for column in given}
    hint, argument, value = "", "", ""
    if any(column in CHANNELS for column in clean.values()):
        hint, argument, value = (
            "; for one sensor with bare names give its place, such as {argument}",
            "placement",
            "waist",
        )
    else:
        among = every if such_as else lacking
        near = {c: difflib.get_close_matches(c, among, 1, 0.6) for c in clean.values() if c not in (*every, "time")}
        meant = [f"{column!r} for {near[c][0]!r}" for column, c in clean.items() if near.get(c)]
        if meant:
            hint = f"; did you mean {', '.join(meant[:3])}? Rename them by {{argument}}"
            argument = "columns"
    message = f"{name} lacks {', '.join(lacking)}: expected columns {such_as}{expected}, found {given}{hint}"
    return RecordingError(message, argument=argument, value=value)


def _no_number(column: "pd.Series", label: str) -> Note | None:
    """The note about cells of a column that are no numbers; None if all cells are numbers."""
    import pandas as pd

    odd = column[pd.to_numeric(column, errors="coerce").isna() & column.notna()]
    if not len(odd) or len(odd) == len(column):
        return None
    row = int(np.flatnonzero(column.index == odd.index[0])[0])
    return CELLS_WITHOUT_NUMBER(column=label, cells=len(odd), value=repr(odd.iloc[0]), row=row + 1)


def _numbers(column: "pd.Series", label: str, name: str) -> np.ndarray:
    """A column as floats; cells without a number become NaN."""
    import pandas as pd

    values = pd.to_numeric(column, errors="coerce").to_numpy(np.float64, na_value=np.nan)
    if len(values) and not np.isfinite(values).any() and column.notna().any():
        raise RecordingError(
            f"{name}: column {label!r} holds no numbers; its first value is {column.dropna().iloc[0]!r}"
        )
    return values


def read_csv(
    path: str | os.PathLike[str],
    *,
    columns: Mapping[str, str] | None = None,
    placement: str | None = None,
    needs: Iterable[str] = (),
    sampling_rate_hz: float | None = None,
    time_unit: str | None = None,
    gyr_unit: str = "deg/s",
    acc_unit: str = "m/s^2",
    range_unit: str = "m",
    name: str | None = None,
    subject: str = "subject",
    check_sizes: bool = True,
) -> Recording:
    """A recording from a CSV file with a header; comma, semicolon or tab, decimal point or comma.

    Arguments as `recording_from_dataframe`; the name is that of the file without its ending, if none is given.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: for an unknown unit.
        RecordingError: if the file is empty, no text, has no rows, lacks columns, or its recording is unusable.
    """
    file = Path(path)
    with reading(file, "a table"):
        return recording_from_dataframe(
            read_table(file),
            columns=columns,
            placement=placement,
            needs=needs,
            sampling_rate_hz=sampling_rate_hz,
            time_unit=time_unit,
            gyr_unit=gyr_unit,
            acc_unit=acc_unit,
            range_unit=range_unit,
            name=file.stem if name is None else name,
            subject=subject,
            check_sizes=check_sizes,
        )


def read_table(file: Path) -> "pd.DataFrame":
    """A table from a text file with a header; comma, semicolon or tab, decimal point or comma.

    Raises:
        FileNotFoundError: if there is no such file.
        RecordingError: if the file is empty, no text, has no rows, or rows that are longer than the header.
    """
    import pandas as pd

    try:
        with file.open(encoding="utf-8-sig") as stream:
            lines = list(itertools.islice((line for line in stream if line.strip()), 2))
    except UnicodeDecodeError as error:
        raise RecordingError(f"{file.name} is no text file in UTF-8: {error}") from error
    if not lines:
        raise RecordingError(f"{file.name} is empty; expected a header and one row a sample")
    separator = max((",", ";", "\t"), key=lines[0].count)
    for line in lines:
        check_width(line, separator, file.name)
    _check_rows(file, lines[0].count(separator) + 1)
    decimal = "," if separator != "," and "," in lines[-1] else "."
    try:
        with warnings.catch_warnings():
            # Without index_col=False, rows that are longer than the header would shift all columns by one, silently.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            table = pd.read_csv(
                file, sep=separator, decimal=decimal, encoding="utf-8-sig", skipinitialspace=True, index_col=False
            )
    except pd.errors.ParserWarning as error:
        raise RecordingError(f"{file.name} has rows with more values than the header has columns") from error
    except (pd.errors.ParserError, UnicodeDecodeError) as error:
        raise RecordingError(f"{file.name} is no table: {error}") from error
    check_columns([str(column) for column in table.columns], file.name)
    if not len(table):
        raise RecordingError(f"{file.name} has a header and no rows; its columns are {list(table.columns)}")
    return table


def _check_rows(file: Path, columns: int) -> None:
    """Refuse a file of more rows than it can have cells: each cell or its separator is a byte."""
    with file.open("rb") as stream:
        rows = sum(block.count(b"\n") for block in iter(lambda: stream.read(2**20), b""))
    if rows * columns > file.stat().st_size + SHORT_CELLS:
        raise RecordingError(f"{file.name} has {columns} columns and {rows} rows, most of which are cut off or empty")
