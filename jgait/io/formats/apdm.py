"""APDM Opal's HDF5 files (`*.h5`) of Motion Studio, Mobility Lab and Moveo Explorer, and Mobility Lab's CSV.

*Format*: APDM's user guides, "HDF5 file organization". Two layouts are recognised by their groups, not by the attribute
`FileFormatVersion`, for one number was not always one layout:

- version 5 (Mobility Lab, Moveo): `/Sensors/<case id>/` with the datasets `Accelerometer`, `Gyroscope` (T, 3), `Time`
  (T,) and the group `Configuration`, whose attribute `Label 0` says where the sensor was worn;
- up to version 4 (Motion Studio, older Mobility Lab): `/<case id>/Calibrated/Accelerometers`, `…/Gyroscopes` (T, 3)
  and `/<case id>/Time`, the labels in the file's attributes `CaseIdList` and `MonitorLabelList`, in the same order;
  version 1 calls the groups `Opal_<case id>`.

The CSV begins with `Format=7` (or another number) and has a header of three rows: for each sensor its case id and its
label, then its signals, then their axes; one column `Time`.

*Units*, by the specification: m/s², rad/s, microseconds since 1970 (UTC). *Placements*: the labels, such as "Right
Foot", "Left Lower Leg", "Lumbar". *Axes*: the Opal's, printed on its case; kept. *Clock*: Opals are synchronised, all
share one. Where `Time` stands still or is 0, the attribute `Sample Rate` (`SampleRate`) counts instead, and this is
noted.
"""

from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from jgait.io.files import check_columns, check_file, check_size, library, plain, positive, three_columns
from jgait.io.formats.devices import Rows
from jgait.io.part import Measured, Part, on_one_zero
from jgait.io.text import first_lines, head_of, rows_of, split
from jgait.notes import AS_READ, BY_NAME, Note
from jgait.types import RecordingError

if TYPE_CHECKING:
    import h5py

EXPECTED = "an APDM Opal HDF5 file"


def measured(path: Path) -> Measured:
    """Every sensor of a file. Raises RecordingError if it is truncated, in no layout of APDM's, or a sensor lacks a
    signal.
    """
    check_file(path, EXPECTED)
    with path.open("rb") as stream:
        if stream.read(16).lstrip(b'\xef\xbb\xbf"').startswith(b"Format="):
            return _csv(path)
    h5py = library("h5py", EXPECTED)
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise RecordingError(f"{path.name} is no whole HDF5 file; expected {EXPECTED}: {error}") from error
    notes: list[Note] = []
    with file:
        _check_content(file, h5py, path)
        try:
            parts = _parts(file, h5py, path.name, notes)
        except OSError as error:  # h5py raises it for incomplete data
            raise RecordingError(f"{path.name} cannot be read in full: {error}") from error
    if any(part.time is None for part in parts):
        parts = [part._replace(time=None, begin_s=None) for part in parts]
    return Measured(on_one_zero(parts, path.name), path.stem, notes=tuple(notes))


def _csv(path: Path) -> Measured:
    """Every sensor of a CSV, its columns found by the three rows of the header."""
    lines, encoding = first_lines(path)
    if len(lines) < 4:
        raise RecordingError(f"{path.name} has {len(lines)} lines; expected three of a header, and one a sample")
    names, signals, axes = (split(line, ",") for line in lines[:3])
    check_columns(names, path.name)
    head = head_of(lines, encoding, 2, ",")
    rows = Rows(path, head, *rows_of(path, head, strict=True))
    named = [i for i, name in enumerate(names) if i and name]
    begins, labels = named[::2], [names[i] for i in named[1::2]]
    if not labels or len(begins) != len(labels):
        raise RecordingError(f"{path.name}: expected a case id and a label for each sensor, found {names[:9]}")
    of: dict[str, dict[tuple[str, str], int]] = {}
    for label, begin, end in zip(labels, begins, [*begins[1:], len(axes)], strict=True):
        signal, of[label] = "", {}
        for i in range(begin, end):
            signal = (signals[i] if i < len(signals) else "").lower() or signal
            of[label][signal.rstrip("s"), axes[i].lower()] = i
    first = next((i for i, signal in enumerate(signals) if signal.lower() == "time"), None)
    stamps = None if first is None else rows.numbers(first)
    time = None if stamps is None else (stamps - stamps[0]) * 1e-6
    parts = []
    for label, columns in of.items():
        gyr, acc = (
            np.stack([rows.numbers(columns[kind, axis]) for axis in "xyz"], axis=1)
            if {(kind, axis) for axis in "xyz"} <= set(columns) else None
            for kind in ("gyroscope", "accelerometer")
        )  # fmt: skip
        if gyr is None:
            raise RecordingError(f"{path.name}: the sensor {label!r} has no Gyroscope X, Y, Z")
        begin_s = None if stamps is None else float(stamps[0]) * 1e-6
        parts.append(Part(label, gyr, acc, time, gyr_unit="rad/s", acc_unit="m/s^2", begin_s=begin_s))
    return Measured(parts, path.stem, notes=rows.notes)


def _check_content(file: "h5py.File", h5py: ModuleType, path: Path) -> None:
    """Refuse a file of too many values, or whose content lies in other files: reading it would read any file."""
    datasets: dict[str, Any] = {}
    file.visititems(lambda key, item: datasets.update({key: item}) if isinstance(item, h5py.Dataset) else None)
    check_size(sum(dataset.nbytes for dataset in datasets.values()), path)
    elsewhere = [key for key, dataset in datasets.items() if dataset.external or dataset.is_virtual]
    file.visititems_links(lambda key, kind: elsewhere.append(key) if isinstance(kind, h5py.ExternalLink) else None)
    if elsewhere:
        raise RecordingError(f"{path.name}: {elsewhere[0]} is in another file; expected one that holds its data itself")


def _values(dataset: "h5py.Dataset", where: str) -> np.ndarray:
    """The values of a dataset."""
    if not hasattr(dataset, "nbytes"):
        raise RecordingError(f"{where} must be a dataset; it is a group")
    return np.asarray(dataset[()])


def _parts(file: "h5py.File", h5py: ModuleType, name: str, notes: list[Note]) -> list[Part]:
    """The sensors of a file of any version."""
    if "Sensors" in file:
        group, inner = file["Sensors"], ""
        signals, rate = ("Gyroscope", "Accelerometer"), "Sample Rate"
    else:
        group, inner = file, "Calibrated"
        signals, rate = ("Gyroscopes", "Accelerometers"), "SampleRate"
    sensors = {key: group[key] for key in group if isinstance(group[key], h5py.Group)} if hasattr(group, "keys") else {}
    sensors = {key: sensor for key, sensor in sensors.items() if not inner or inner in sensor}
    if not sensors:
        there = "its group Sensors holds no sensor" if not inner else (
            f"expected the group Sensors, or groups <case id>/Calibrated; it has {', '.join(file) or 'nothing'}"
        )  # fmt: skip
        raise RecordingError(f"{name} is not {EXPECTED}: {there}")
    # attributes of the file, or, in the oldest ones, datasets
    lists = (file.attrs.get(key, _values(file[key], key) if key in file else []) if inner else []
             for key in ("CaseIdList", "MonitorLabelList"))  # fmt: skip
    cases, labels = ([plain(value) for value in np.atleast_1d(values)] for values in lists)
    label_of = dict(zip(cases, labels, strict=True)) if len(cases) == len(labels) else {}
    if inner and not label_of:
        notes.append(
            BY_NAME.note("CaseIdList and MonitorLabelList do not name the sensors; they are named by their case ids")
        )
    parts = []
    for key, sensor in sensors.items():
        about = (
            dict(sensor.attrs) if inner else dict(sensor["Configuration"].attrs) if "Configuration" in sensor else {}
        )
        stated = plain(about.get("MonitorLabel" if inner else "Label 0", ""))
        label = label_of.get(key) or label_of.get(key.removeprefix("Opal_")) or stated or key
        where = f"{name}: {key}/Calibrated" if inner else f"{name}: Sensors/{key}"
        parts.append(_part(sensor[inner] if inner else sensor, signals, label, about.get(rate), sensor, where, notes))
    return parts


def _part(
    group: "h5py.Group", signals: tuple[str, str], label: str, rate: ArrayLike | None, timed: "h5py.Group", where: str,
    notes: list[Note],
) -> Part:  # fmt: skip
    """One sensor, on its clock if that runs, else by its rate."""
    rates, force = signals
    if rates not in group:
        raise RecordingError(f"{where} has no {rates}; it has {', '.join(group) or 'nothing'}")
    gyr = three_columns(_values(group[rates], f"{where}/{rates}"), f"{where}/{rates}")
    acc = None
    if force in group:
        acc = three_columns(_values(group[force], f"{where}/{force}"), f"{where}/{force}", len(gyr))
    part = Part(label, gyr, acc, None, positive(rate), gyr_unit="rad/s", acc_unit="m/s^2")
    stamps = _values(timed["Time"], f"{where}: Time").ravel() if "Time" in timed else np.zeros(len(gyr))
    if stamps.shape != (len(gyr),):
        raise RecordingError(f"{where}: Time must have shape ({len(gyr)},); it has {stamps.shape}")
    if len(stamps) and stamps[-1] > stamps[0]:
        # Microseconds since 1970 are exact as integers; as floats of seconds they are not.
        since = stamps.astype(np.int64) - int(stamps[0])
        return part._replace(time=1e-6 * since, begin_s=1e-6 * float(stamps[0]))
    if part.sampling_rate_hz is None:
        raise RecordingError(f"{where}: the sensor {label!r} has neither Time that runs nor a sample rate")
    notes.append(AS_READ.note(f"{label}: Time does not run; the file's rate of {part.sampling_rate_hz:g} Hz counts"))
    return part
