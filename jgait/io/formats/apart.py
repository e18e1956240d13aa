"""Sensors whose signals lie apart: a file a signal, each with a clock of its own, or gravity beside the acceleration.

*Format*: phone apps (Sensor Logger, phyphox) and MetaBase write a folder with a table for each signal, such as
`Accelerometer.csv` and `Gyroscope.csv`: a clock, and three columns that are called by their axes. iOS's CoreMotion, as
MotionSense and SensorLog write it, has one table with `rotationRate.x`, `gravity.x` and `userAcceleration.x`. Which
signal columns hold, is stated by their names, by the name of the file, or by their unit.

*Signals*: the accelerometer is the one that measures gravity; else what is without gravity, and gravity itself, are
added. *Units*: those of the header; Sensor Logger's are m/s² and rad/s, CoreMotion's g and rad/s, by their
documentation; else they are questioned. *Signs*: at rest, an axis that points up reads +1 g on Android and in phyphox,
and −1 g on an iPhone: CoreMotion's signs are turned round, and Sensor Logger's where `Metadata.csv` states iOS and no
standardisation. The signals do not show it. *Clock*: each file's; both signals are interpolated to one. *Placement*:
not stated; a sensor is called by its folder, or by its device's address. *Axes*: those of the phone or the sensor.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jgait.io.checks.sizes import measures_gravity
from jgait.io.dates import clock_of
from jgait.io.files import check_file, first_bytes, numbers
from jgait.io.names import KINDS, placement_of
from jgait.io.part import UP_UNSURE, Measured, Part, on_one_zero
from jgait.io.text import read_table, separator_of, split
from jgait.io.units import unit_of_columns
from jgait.notes import AS_READ, Note
from jgait.types import RecordingError

EXPECTED = "a folder with a table for each signal of a sensor, such as Accelerometer.csv and Gyroscope.csv"

AXIS = re.compile(r"(?P<what>.*?)[\W_]*(?P<axis>[xyz])(?:[\W_]*axis)?\s*(?:[(\[][^()\[\]]*[)\]])?", re.IGNORECASE)
"""Pattern of a column's name: a signal, its axis, and perhaps a unit in brackets."""

SIGNALS = {
    "gravity": r"gravit[a-z]*|schwerkraft",
    "linear": r"lin(ear)?acc|linear|user|without|ohne|free",
    "gyr": "|".join((*KINDS["gyr"], "rotationrate", "gyrorotation")),
    "acc": "|".join(KINDS["acc"]),
}
"""Signal → pattern of a name that states it; the first that fits counts."""

UNCALIBRATED = r"uncalibrated|raw"
APPLE = r"rotationrate|useracc|gyrorotation"
"""Pattern of the words for signals that only CoreMotion, and apps that write its values, have."""

LOGGER = "Sensor Logger"  # whose acceleration has no gravity, unless called total, and the signs of the phone's system
APPS = {LOGGER: r"seconds_elapsed", "phyphox": r"\w+ \(s\)", "MetaBase": r"epoc \(ms\)"}
"""Program → pattern of the name of a column that it writes."""

ADDRESS = re.compile(r"(?<![0-9A-F])[0-9A-F]{12}(?![0-9A-F])")  # of a device, in the name of a file


class AxisColumns(NamedTuple):
    """Three columns of a table that are the axes of one signal."""

    signal: str  #: a key of `SIGNALS`.
    names: tuple[str, ...]  #: of x, y and z.
    words: str  #: the name that states the signal, in lower case, without anything but letters.


class Signal(NamedTuple):
    """One signal on its clock."""

    columns: AxisColumns
    values: np.ndarray  #: (T, 3) in the file's unit.
    unit: str | None
    time: np.ndarray | None  #: (T,) [s].
    begin_s: float | None  #: [s] from 1970 to 0 of `time`.
    file: Path
    app: str  #: a key of `APPS`; "" for another program.


def _letters(name: str) -> str:
    return re.sub(r"[^a-z]", "", name.lower())


def _signals(names: Sequence[str], stem: str) -> list[AxisColumns]:
    """The signals in a table, by the names of its columns, and by that of its file where these are bare axes."""
    axes: dict[str, dict[str, str]] = {}
    for name in names:
        if match := AXIS.fullmatch(name.strip()):
            axes.setdefault(match["what"], {})[match["axis"].lower()] = name
    result = []
    for what, of_axis in axes.items():
        if set(of_axis) != set("xyz") or placement_of(what):
            continue
        columns, words = tuple(of_axis[axis] for axis in "xyz"), _letters(what or stem)
        signal = next((signal for signal, pattern in SIGNALS.items() if re.search(pattern, words)), None)
        if signal is None and not what:
            signal = next((kind for kind in ("gyr", "acc") if _unit(columns, kind)), None)
        result += [AxisColumns(signal, columns, words)] if signal else []
    return result


def _unit(names: Sequence[str], kind: str) -> str | None:
    """The unit of a kind of signal that the names of columns state; None if they state none, or another kind's."""
    try:
        return unit_of_columns(names, kind, "")
    except RecordingError:
        return None


def _head(file: Path) -> list[AxisColumns]:
    """The signals in the header of a file; none of a file that is no table."""
    if file.suffix.lower() not in (".csv", ".tsv", ".txt") or file.name.startswith(".") or not file.is_file():
        return []
    lines = first_bytes(file).decode("utf-8-sig", "replace").splitlines()
    line = next(filter(str.strip, lines), "")
    return _signals(split(line, separator_of(line)), file.stem)


def _key(file: Path) -> str:
    """What the names of the files of one device share."""
    words = "|".join(("total", UNCALIBRATED, "data", r"[\d.]+ ?hz", *SIGNALS.values()))
    return re.sub(words, "", file.stem, flags=re.IGNORECASE).strip("_- .")


def _devices(folder: Path) -> list[list[Path]]:
    """The files of each device of a folder, where some files have a gyroscope and others the accelerometer."""
    signal_of = {file: head[0].signal for file in sorted(folder.iterdir()) if len(head := _head(file)) == 1}
    groups: dict[str, list[Path]] = {}
    for file in signal_of:
        groups.setdefault(_key(file), []).append(file)
    whole = [files for files in groups.values() if {"gyr"} < {signal_of[file] for file in files}]
    if not whole and list(signal_of.values()).count("gyr") == 1 and len(signal_of) > 1:
        return [list(signal_of)]
    if not signal_of:  # a folder for each place
        below = [_devices(inner) for inner in sorted(folder.iterdir()) if inner.is_dir() and placement_of(inner.name)]
        return [devices[0] for devices in below] if all(len(devices) == 1 for devices in below) else []
    return whole


def _place(file: Path) -> str | None:
    """The placement that the name of a device's file states, or that of its folder."""
    return placement_of(ADDRESS.sub("", _key(file))) or placement_of(file.parent.name)


def recognises(path: Path, head: bytes) -> bool:
    """Whether it is such a folder or a file of one, an accelerometer's alone, or a table with gravity apart or of
    CoreMotion.
    """
    if path.is_dir():
        signals = {columns.signal for file in path.iterdir() for columns in _head(file)}
        return bool(_devices(path)) or ("acc" in signals and "gyr" not in signals)
    columns = _head(path)
    if len(columns) == 1:
        return any(path in files for files in _devices(path.parent))
    return {"gyr", "gravity"} <= {each.signal for each in columns} or any(
        each.signal == "gyr" and re.search(APPLE, each.words) for each in columns
    )


def measured(path: Path) -> Measured:
    """The sensors of a folder, or the one to which a file belongs. Raises RecordingError without a gyroscope or
    gravity.
    """
    devices = _devices(path if path.is_dir() else path.parent)
    if not path.is_dir():
        check_file(path, EXPECTED)
        devices = [files for files in devices if path in files] or [[path]]
        if len(devices[0]) > 1 and _head(path)[0].signal != "gyr":
            gyroscope = next(file.name for file in devices[0] if _head(file)[0].signal == "gyr")
            where = f"that of the same sensor is in {gyroscope}: give this file, or the folder of both"
            raise RecordingError(f"{path.name} holds no gyroscope; {where}")
    if not devices:
        raise RecordingError(f"{path.name} holds no gyroscope, which every method needs; expected {EXPECTED}")
    matches = [ADDRESS.search(files[0].name) for files in devices]
    addresses, places = [match and match.group() for match in matches], [_place(files[0]) for files in devices]
    if None in places or len(set(places)) < len(devices):
        places = [None] * len(devices)
    labels = places if None in addresses or len(set(addresses)) < len(devices) else addresses
    if len(devices) > 1 and None in labels:
        named = ", ".join(files[0].name for files in devices[:3])
        what = f"{len(devices)} recordings, such as {named}: give the gyroscope's file of one of them"
        raise RecordingError(f"{path.name} holds {what}")
    notes: list[Note] = []
    name = path.name if path.is_dir() else path.stem if len(devices[0]) == 1 else _key(path) or path.parent.name
    if len(devices) == 1:
        return Measured([_part(devices[0], name, notes)], name, notes=tuple(notes))
    parts = [
        _part(files, str(label), notes)._replace(placement=place)
        for files, label, place in zip(devices, labels, places, strict=True)
    ]
    return Measured(on_one_zero(parts, name), name, notes=tuple(notes))


def _part(files: Sequence[Path], label: str, notes: list[Note]) -> Part:
    """The sensor of some files."""
    every = [signal for file in files for signal in _read(file, notes)]
    if len(files) > 1:
        notes.append(AS_READ.note(f"{label}: the signals of {', '.join(file.name for file in files)} belong together"))
    every.sort(key=lambda signal: bool(re.search(UNCALIBRATED, signal.columns.words)))
    of = {kind: [signal for signal in every if signal.columns.signal == kind] for kind in SIGNALS}
    if not of["gyr"]:
        raise RecordingError(f"{files[0].name} holds no gyroscope; expected {EXPECTED}")
    gyr, acc = of["gyr"][0], _accelerometer(of, label, notes)
    part = Part(label, gyr.values, None, gyr.time, gyr_unit=gyr.unit, begin_s=gyr.begin_s)
    if acc is None:
        return part
    if (acc.begin_s is None) != (gyr.begin_s is None):
        raise RecordingError(f"{label}: {gyr.file.name} and {acc.file.name} have different kinds of times")
    if acc.time is None and len(acc.values) != len(gyr.values):
        raise RecordingError(f"{label}: {acc.file.name} and {gyr.file.name} have no times, and are not of one length")
    if not (gyr.app or re.search(APPLE, gyr.columns.words)):
        text = "at rest, the accelerometer's axis that points up is taken to read +1 g; on an iPhone it may read −1 g"
        notes.append(UP_UNSURE.note(f"{label}: {text}: the files name no program whose signs are known"))
    turned = _turned_round(files[0].parent, every)
    if turned:
        why = "the signs of the accelerometer are turned round, for the phone's system is iOS"
        notes.append(AS_READ.note(f"{label}: {why}"))
    since = (acc.begin_s or 0.0) - (gyr.begin_s or 0.0)
    acc_time = None if acc.file == gyr.file or acc.time is None else acc.time + since
    return part._replace(acc=-acc.values if turned else acc.values, acc_unit=acc.unit, acc_time=acc_time)


def _accelerometer(of: dict[str, list[Signal]], label: str, notes: list[Note]) -> Signal | None:
    """The specific force: the first signal that measures gravity, or the sum of gravity and the rest."""
    rest, gravity = next(iter(of["linear"] + of["acc"]), None), next(iter(of["gravity"]), None)
    candidates = of["acc"] if gravity is not None else of["acc"] + of["linear"]
    for signal in candidates:
        if measures_gravity(signal.values):
            return signal
    if rest is None:
        return None
    if gravity is None:
        raise RecordingError(
            f"{label}: gravity is not in {rest.file.name} ({', '.join(rest.columns.names)}), and in no other signal; "
            "record the accelerometer with gravity, or gravity beside it"
        )
    if rest.unit != gravity.unit:
        raise RecordingError(f"{label}: acceleration is in {rest.unit}, gravity in {gravity.unit}; expected one unit")
    values = gravity.values
    if rest.time is not None and gravity.time is not None:
        since = (gravity.begin_s or 0.0) - (rest.begin_s or 0.0)
        values = np.stack([np.interp(rest.time, gravity.time + since, column) for column in values.T], axis=1)
    notes.append(AS_READ.note(f"{label}: accelerometer without gravity, and gravity, were added"))
    return rest._replace(values=rest.values + values)


def _turned_round(folder: Path, every: Sequence[Signal]) -> bool:
    """Whether an axis that points up reads −1 g at rest: on an iPhone, unless the app states Android's signs."""
    about = next((file for file in folder.iterdir() if file.name.lower() == "metadata.csv"), None)
    if about is not None:
        facts = {str(key).lower(): str(values.iloc[0]).lower() for key, values in read_table(about)[0].items()}
        if facts.get("platform") in ("ios", "android"):
            return facts["platform"] == "ios" and facts.get("standardisation") != "true"
    if any(re.search(APPLE, signal.columns.words) for signal in every):
        return True
    if every[0].app == LOGGER and not any("total" in signal.columns.words for signal in every):
        raise RecordingError(
            f"{folder.name} lacks Metadata.csv, which states the phone's system: iPhone and Android have opposite "
            "signs; keep it with the other files of the export"
        )
    return False


def _read(file: Path, notes: list[Note]) -> list[Signal]:
    """The signals of a file, in its units, on its clock."""
    table, of_table = read_table(file)
    notes += of_table
    time, begin_s = clock_of(table, file.name)
    names = [str(name) for name in table.columns]
    app = next((app for app, pattern in APPS.items() if any(re.fullmatch(pattern, name) for name in names)), "")
    signals = []
    for columns in _signals(names, file.stem):
        kind = "gyr" if columns.signal == "gyr" else "acc"
        unit = _unit(columns.names, kind)
        if columns.signal == "acc" and app == LOGGER and not re.search(f"total|{UNCALIBRATED}", columns.words):
            columns = columns._replace(signal="linear")
        if unit is None and (kind == "gyr" or not re.search(UNCALIBRATED, columns.words)):
            if app == LOGGER:
                unit = "rad/s" if kind == "gyr" else None if "rotationrate" in _letters("".join(names)) else "m/s^2"
            elif any(re.search(APPLE, _letters(name)) for name in names):
                unit = "rad/s" if kind == "gyr" else "g"
        values = np.stack([numbers(table[name])[0] for name in columns.names], axis=1)
        signals.append(Signal(columns, values, unit, time, begin_s, file, app))
    return signals
