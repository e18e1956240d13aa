"""The file formats that jgait reads, and the one function that reads any of them."""

import importlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from jgait.io.atomic import check_path
from jgait.io.files import check_brand, check_regular, first_bytes, reading
from jgait.io.names import COLUMNS
from jgait.io.part import Measured, joined
from jgait.io.recording import settle
from jgait.io.text import separator_of, split
from jgait.notes import AS_READ
from jgait.types import Recording, RecordingError


class Format(NamedTuple):
    """A file format.

    A module `jgait.io.formats.MODULE` has `measured(path) -> Measured`, which parses and raises `RecordingError` for
    what it cannot read, and, unless `named` or `begins` decide, `recognises(path, head) -> bool`, which looks at the
    name and the first bytes only; or `FORMATS`, name → an object that has both.
    """

    module: str  #: its name in this package.
    title: str  #: name of the format for users.
    files: str  #: what is given to `read`: endings, or words.
    states: str  #: which units, placements and clocks file or specification state.
    named: tuple[str, ...] = ()  #: endings of the names of all its files.
    begins: tuple[bytes, ...] = ()  #: first bytes of its files that are called otherwise.


FORMATS: dict[str, Format] = {
    "mobilised": Format("mobilised", "Mobilise-D MATLAB file", "data.mat", "units, placements, rates", (".mat",),
                        (b"MATLAB 5.0", b"MATLAB 7.3")),
    "apdm": Format("apdm", "APDM Opal HDF5 or CSV", "*.h5, *.csv", "units, placements as labels, one clock",
                   (".h5", ".hdf5"), (b"\x89HDF\r\n\x1a\n", b"Format=")),
    "cwa": Format("cwa", "Axivity CWA (AX6)", "*.cwa", "units, time; no placement", begins=(b"MD\xfc\x03",)),
    "bids": Format("bids", "BIDS motion", "*_motion.tsv with its .json and _channels.tsv", "units, placements, rate",
                   ("_motion.tsv", "_motion.tsv.gz")),
    "mtw": Format("devices", "Xsens MTw text", "MT_*.txt, one file a sensor, or a folder", "rate; no placement"),
    "dot": Format("devices", "Movella DOT CSV", "*.csv, one file a sensor, or a folder", "time; no placement"),
    "shimmer": Format("devices", "Shimmer Consensys CSV", "*.csv, or a folder",
                      "units, time; placement perhaps as the device's name"),
    "apart": Format("apart", "signals apart (Sensor Logger, phyphox, MetaBase, CoreMotion)",
                    "a folder with a *.csv for each signal",
                    "time; units by the header or the app's documentation; no placement"),
    "xio": Format("devices", "x-io CSV (x-IMU3, NGIMU, Fusion)", "*.csv, or a folder", "units, time; no placement"),
    "physilog": Format("devices", "Gait Up Physilog CSV", "*.csv, one file a sensor, or a folder",
                       "units, time; no placement"),
    "csv": Format("columns", "a table with jgait's, gaitmap's or mobgap's columns", "*.csv, *.parquet, or a folder",
                  "placements; gaitmap's and mobgap's units, else they are deduced"),
}  # fmt: skip
"""Name → format, in the order in which files are tried. A format of columns named as here comes last: `csv`."""

SHEETS = (".xlsx", ".xls", ".ods", ".numbers")  # endings of spreadsheets

OTHERS = {
    ".c3d": "is a motion capture without inertial sensors that jgait reads: jgait.io.read_c3d reads markers and analog "
    "signals",
    **dict.fromkeys((".mot", ".sto"), "holds no inertial sensors that jgait reads: jgait.io.read_opensim reads angles"),
    ".trc": "holds markers, and no inertial sensors",
    ".gt3x": "is of an ActiGraph, whose accelerometer alone (read by pygt3x) is not enough: every method needs a "
    "gyroscope; of a GT9X Link, export the IMU as CSV from ActiLife",
    ".mtb": "is Xsens' binary log: export inertial data as text from MT Manager",
    ".mvn": "is Xsens MVN's own file: export the sensors' data as text or CSV",
    ".mvnx": "is Xsens MVN's XML: export the sensors' angular velocity and acceleration as text or CSV",
    ".apdm": "is APDM's raw log: convert it to HDF5 with Motion Studio",
    ".sbem": "is Movesense's binary log: convert it to CSV with its sbem2json or the showcase app",
    ".json": "is JSON: export tables (CSV) from the program that made it",
    ".zip": "is an archive: unpack it, and give the folder",
}
"""Ending of files that are not read → what they are, and what reads or converts them."""


def _module(name: str) -> Any:
    """What has `measured`, and perhaps `recognises`, of a format."""
    module = importlib.import_module(f"jgait.io.formats.{FORMATS[name].module}")
    return getattr(module, "FORMATS", {}).get(name, module)


def format_of(path: str | os.PathLike[str]) -> str | None:
    """The format of a file or folder, recognised by its name and first bytes; None where none fits.

    Raises:
        FileNotFoundError: if there is no such file.
        PermissionError: if it may not be read.
        RecordingError: if it is a device or a pipe.
    """
    check_path(path)
    file = Path(path)
    check_regular(file, "a recording")
    head = b"" if file.is_dir() else first_bytes(file)
    line = head.decode("utf-8-sig", "replace").partition("\n")[0].strip().lower()
    if COLUMNS.intersection(split(line, separator_of(line))) - {"time"}:  # no other format has jgait's own names
        return "csv"
    for name, known in FORMATS.items():
        if file.name.lower().endswith(known.named) or head.lstrip(b'\xef\xbb\xbf"').startswith(known.begins):
            return name
        if not (known.named or known.begins) and _module(name).recognises(file, head):
            return name
    return None


def read(
    path: str | os.PathLike[str] | Mapping[str, str | os.PathLike[str]],
    *,
    format: str | None = None,
    placement: str | None = None,
    placements: Mapping[str, str] | None = None,
    gyr_unit: str | None = None,
    acc_unit: str | None = None,
    sampling_rate_hz: float | None = None,
    name: str | None = None,
    subject: str | None = None,
) -> Recording:
    """A recording from a file of a measuring system, or from several files of one sensor each.

    Units and placements that the file does not state are deduced from the signals and the sensors' names, and noted;
    if they cannot be deduced, the file is refused, and the message names the required argument.

    Args:
        path: the file or folder; or placement → file, for systems that write a file a sensor.
        format: one of `FORMATS`; None: recognised by the file's name and first bytes.
        placement: where the sensor sat, for a file of one sensor.
        placements: the file's name of a sensor → its placement, or "none" for a sensor that is to be left out.
        gyr_unit: 'deg/s', 'rad/s', 'mdeg/s' or 'mrad/s', overrules the file.
        acc_unit: 'm/s^2', 'g' or 'mg', overrules the file.
        sampling_rate_hz: [Hz] for files that do not state it.
        name: name of the recording in tables and figures; None: the file's.
        subject: name of the person; None: the file's, or the name of the recording, so that each is of another person.

    Raises:
        OSError: if the file does not exist, or may not be read.
        ValueError: for an unknown format or unit.
        RecordingError: if the format cannot be told, or the file holds no usable recording.
    """
    if isinstance(path, Mapping):
        if placement is not None or placements is not None:
            raise ValueError("files by placement need no placement or placements")
        if not path:
            raise ValueError("no file was given; expected placement → file")
        content = joined([_one(file, format, where) for where, file in path.items()])
        placements = None
    else:
        content = _one(path, format, placement)
    with reading(Path(content.name), "a recording"):
        return settle(
            content, placements=placements, gyr_unit=gyr_unit, acc_unit=acc_unit, sampling_rate_hz=sampling_rate_hz,
            name=name, subject=subject,
        )  # fmt: skip


def _one(path: str | os.PathLike[str], format: str | None, placement: str | None) -> Measured:
    """The content of one file; with a placement, of its one sensor."""
    check_path(path)
    file = Path(path)
    if format is not None and format not in FORMATS:
        raise RecordingError(f"{{argument}} must be one of {', '.join(FORMATS)}; got {format!r}", argument="format")
    known, ending = format or format_of(file), file.suffix.lower()
    if ending in SHEETS:
        raise RecordingError(f"{file.name} is a spreadsheet; save it as CSV from the program that made it")
    if known is None and ending in OTHERS:
        raise RecordingError(f"{file.name} {OTHERS[ending]}")
    if known is None and file.is_dir():
        files = f"name its files, such as {file / '*.csv'}"
        raise RecordingError(f"{file.name or file} is a folder, and none of a format that jgait reads; {files}")
    if known is None:
        check_brand(file)
        formats = ", ".join(FORMATS)
        raise RecordingError(
            f"{file.name} is in no format that jgait reads ({formats}); state which by {{argument}}", argument="format"
        )
    with reading(file, FORMATS[known].title):
        content: Measured = _module(known).measured(file)
    content = content._replace(notes=(*content.notes, AS_READ.note(f"read as {FORMATS[known].title}")))
    if placement is None:
        return content
    if len(content.parts) != 1:
        labels = [part.label for part in content.parts]
        raise RecordingError(
            f"{file.name} has {len(labels)} sensors, {labels}; place them by {{argument}}", argument="placements"
        )
    return content._replace(parts=(content.parts[0]._replace(placement=placement, stated=True),))
