"""BIDS-motion: `*_tracksys-<system>_motion.tsv` with its `*_motion.json` and `*_channels.tsv`.

*Format*: Brain Imaging Data Structure, "Motion" (since 1.9; Jeung et al. 2024, Scientific Data 11:716). The motion file
has no header; `channels.tsv` lists in its order what the columns are: name, component (x, y, z), type (ACCEL, GYRO, …),
tracked_point, units, perhaps placement, status. `motion.json` states SamplingFrequency and
perhaps SamplingFrequencyEffective, the measured one, which counts [Hz]; a channel
of type LATENCY, where there is one, is the time [s]. Both may lie in a folder further up (the inheritance principle).
A header that repeats the names of the channels, which many writers add, is passed over and noted.

*Units* are stated, channel by channel; `n/a` is a question to the signals. *Placements*: tracked_point, else the
column placement. *Subject*: the entity `sub-`. Other tracking systems of the same walk are noted.
"""

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jgait.io.clock import TIME_UNITS
from jgait.io.files import (
    Tree,
    cells_in_lines,
    check_columns,
    check_file,
    check_size,
    json_object,
    library,
    numbers,
    positive,
)
from jgait.io.names import placement_of
from jgait.io.part import SAME_RATE, Measured, Part
from jgait.io.units import ACC_UNITS, GYR_UNITS, known_unit
from jgait.notes import AS_READ, LEFT_OUT, Kind, Note
from jgait.types import RecordingError

if TYPE_CHECKING:
    import pandas as pd

EXPECTED = "a BIDS motion file (*_motion.tsv)"
NEEDED = ("name", "component", "type", "units")
UNITS = {"GYRO": tuple(GYR_UNITS), "ACCEL": tuple(ACC_UNITS), "LATENCY": ("s", "ms")}  # type of channel → its units

CHANNELS_BAD = Kind(
    "channels_bad", "check", "{sensor}: channels.tsv calls {channels} bad",
    "Whoever made the data set had doubts about these signals; they are used as they are.",
)  # fmt: skip


def measured(path: Path) -> Measured:
    """Every tracked point of a motion file that has a gyroscope; the errors have file, expected and actual content."""
    check_file(path, EXPECTED)
    stem = re.sub(r"_motion\.tsv(\.gz)?$", "", path.name)
    channels, notes = _channels(path, stem), list[Note]()
    stated = _inherited(path, stem, "motion.json")
    if not stated:
        raise RecordingError(f"{path.name} needs {stem}_motion.json, which states its SamplingFrequency; there is none")
    about: Tree = {}
    for file in reversed(stated):  # a nearer one overrules
        about |= json_object(file)
    values = _values(path, list(channels["name"]), notes)
    nominal = positive(about.get("SamplingFrequency"))
    rate = positive(about.get("SamplingFrequencyEffective"), nominal)
    if rate and nominal and abs(rate / nominal - 1.0) > SAME_RATE:
        notes.append(AS_READ.note(f"motion.json: SamplingFrequencyEffective {rate:g} Hz beside {nominal:g} Hz"))
    _, latency, unit = _signal(path, "", channels, "LATENCY", values)
    time = None if latency is None else TIME_UNITS[unit or "s"] * latency[:, 0]
    points = {point: channels[channels["tracked_point"] == point] for point in dict.fromkeys(channels["tracked_point"])}
    parts = [_part(path, point, rows, values, time, rate, notes) for point, rows in points.items()
             if "GYRO" in set(rows["type"])]  # fmt: skip
    if not parts:
        kinds = ", ".join(sorted(set(channels["type"])))
        raise RecordingError(f"{path.name} holds no gyroscope: expected channels of type GYRO, found {kinds}")
    if left_out := [f"{point} (no gyroscope)" for point, rows in points.items() if "GYRO" not in set(rows["type"])]:
        notes.append(LEFT_OUT.note("left out: " + ", ".join(left_out)))
    pattern = re.sub(r"_tracksys-[^_]+", "_tracksys-*", stem) + "_motion.tsv*"
    if others := sorted(file.name for file in path.absolute().parent.glob(pattern) if file.name != path.name):
        notes.append(AS_READ.note("the same walk was measured by other systems too: {files}", files=others))
    entity = re.match(r"sub-([^_]+)", path.name)
    return Measured(parts, stem, entity.group(1) if entity else "", tuple(notes))


def _inherited(path: Path, stem: str, kind: str) -> list[Path]:
    """Files of a kind that apply to this file, the nearest first: their entities are a subset of this file's. Five
    folders at most are searched, up to the data set's root.
    """
    entities, files, folders = {*stem.split("_"), ""}, list[Path](), list(path.absolute().parents)[:5]
    root = next((k for k, folder in enumerate(folders) if (folder / "dataset_description.json").exists()), 5)
    for folder in folders[: root + 1]:
        here = [file for file in folder.glob(f"*{kind}") if set(file.name.removesuffix(kind).split("_")) <= entities]
        files += sorted(here, key=lambda file: -len(file.name))
    return files


def _table(file: Path, **options: Any) -> "pd.DataFrame":
    """A table with tabs, its cells as text or numbers; `n/a` is NaN."""
    pandas = library("pandas", EXPECTED)
    check_file(file, EXPECTED)
    if file.suffix == ".gz":  # whose last four bytes are the length of its content, without multiples of 4 GB
        with file.open("rb") as stream:
            stream.seek(-4, os.SEEK_END)
            declared = int.from_bytes(stream.read(), "little")
        check_size(declared + (2**32 if declared < file.stat().st_size // 2 else 0), file)
    else:
        cells_in_lines(file, ",")
    try:
        return pandas.read_csv(file, sep="\t", na_values=["n/a"], encoding="utf-8-sig", **options)
    except (pandas.errors.ParserError, pandas.errors.EmptyDataError, ValueError, EOFError) as error:
        raise RecordingError(f"{file.name} is no table with tabs: {error}") from error


def _channels(path: Path, stem: str) -> "pd.DataFrame":
    """The table of channels: text without surrounding blanks, empty for n/a."""
    file = next(iter(_inherited(path, stem, "channels.tsv")), None)
    if file is None:
        raise RecordingError(f"{path.name} needs {stem}_channels.tsv, which states what its columns are; there is none")
    table = _table(file, dtype=str).fillna("").rename(columns=str.strip)
    if lacking := [column for column in NEEDED if column not in table.columns]:
        expected, given = ", ".join(NEEDED), ", ".join(table.columns)
        raise RecordingError(f"{file.name} lacks {', '.join(lacking)}; expected {expected}, found {given}")
    table = table.apply(lambda column: column.str.strip())
    if "tracked_point" not in table:
        table["tracked_point"] = path.name
    table["type"] = table["type"].str.upper().replace({"ACC": "ACCEL", "GYR": "GYRO"})
    table["component"] = table["component"].str.lower()
    return table.reset_index(drop=True)


def _values(path: Path, names: list[str], notes: list[Note]) -> np.ndarray:
    """(T, channels) numbers, NaN for n/a."""
    check_columns(names, path.name)
    header = [str(cell).strip() for cell in _table(path, header=None, nrows=1, dtype=str).iloc[0]] == names
    table = _table(path, header=None, skiprows=int(header))
    if header:
        notes.append(AS_READ.note("the motion file has a header, which BIDS does not foresee; it was skipped"))
    if table.shape[1] != len(names):
        rows = f"{table.shape[1]} columns, its channels.tsv {len(names)} rows"
        raise RecordingError(f"{path.name} has {rows}; they must agree")
    values = np.zeros(table.shape)
    for k, name in enumerate(names):
        values[:, k], wrong = numbers(table.iloc[:, k])
        if len(wrong):
            cell = f"{wrong.iloc[0]!r} in row {wrong.index[0]}"
            raise RecordingError(f"{path.name}: {name} holds {cell}; expected a number")
    return values


def _signal(
    path: Path, point: str, rows: "pd.DataFrame", kind: str, values: np.ndarray
) -> tuple[list[str], np.ndarray | None, str | None]:
    """Names of the channels of a kind, their values (T, 3), and their unit; None where there are no such channels."""
    here = rows[rows["type"] == kind].sort_values("component", kind="stable")
    names, units = list(here["name"]), list(dict.fromkeys(here["units"]))
    if not names:
        return names, None, None
    if kind != "LATENCY" and list(here["component"]) != ["x", "y", "z"]:
        there = f"{', '.join(rows[rows['type'] == kind]['component'])} ({', '.join(names)})"
        needs = "must have the components x, y and z, once each"
        raise RecordingError(f"{path.name}: {kind} of {point!r} {needs}; it has {there}")
    if len(units) > 1:
        raise RecordingError(f"{path.name}: {', '.join(names)} must share a unit; they have {', '.join(units)}")
    unit = known_unit(units[0]) or units[0] or None
    if unit and unit not in UNITS[kind]:
        expected = ", ".join(UNITS[kind])
        raise RecordingError(f"{path.name}: {names[0]} ({kind}) is in {unit!r}; expected one of {expected}")
    return names, values[:, here.index.to_numpy()], unit


def _part(
    path: Path, point: str, rows: "pd.DataFrame", values: np.ndarray, time: np.ndarray | None, rate: float | None,
    notes: list[Note],
) -> Part:  # fmt: skip
    """One tracked point, which has a gyroscope."""
    names, gyr, gyr_unit = _signal(path, point, rows, "GYRO", values)
    more, acc, acc_unit = _signal(path, point, rows, "ACCEL", values)
    used, place = rows[rows["name"].isin([*more, *names])], None
    if placement_of(point) is None and "placement" in rows:
        place = next(filter(None, map(placement_of, used["placement"])), None)
        if place is not None:
            notes.append(AS_READ.note(f"{point}: at {place} by the column placement"))
    if "status" in rows and (bad := list(used["name"][used["status"].str.lower() == "bad"])):
        notes.append(CHANNELS_BAD(sensor=point, channels=bad))
    if "sampling_frequency" in rows:
        rate = positive(rate, *used["sampling_frequency"])
    return Part(point, np.asarray(gyr), acc, time, rate, gyr_unit, acc_unit, place)
