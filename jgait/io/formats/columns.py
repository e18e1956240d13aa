"""Tables whose columns are named as jgait names them, and gaitmap's and mobgap's, as CSV or Parquet.

*Format*: `<placement>_gyr_x` … `<placement>_acc_z`, perhaps `time` and `feet_range`, as `jgait.io.write_csv` and
`write_table` write a recording; or `gyr_x` … `acc_z` of one sensor, whose file is called by its placement, alone or in
a folder; or gaitmap's two rows of names (`left_sensor`, `acc_x`); or mobgap's body frame (`acc_is`, `acc_ml`,
`acc_pa`).

*Units*: gaitmap's and mobgap's are stated by their documentation (m/s², deg/s), others by the names of columns
(`shank_right_gyr_x [rad/s]`), else they are deduced from the signals. *Clock*: `time` in s, ms or us, as its name
states or its steps suggest, or in min or h by its name; or the sampling rate, which must be given, perhaps with the
numbers of the samples (`PacketCounter`, or a `time` that counts). *Axes*: gaitmap's and mobgap's sensor frame by
their documentation, else not known.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from jgait.io.files import check_file, read_parquet
from jgait.io.formats.dialects import BODY_MOBGAP, gaitmap_parts, mobgap_part
from jgait.io.names import CHANNELS, column_of, lettered, placement_of, sensor_of
from jgait.io.part import Measured, joined
from jgait.io.tables import measured_table
from jgait.io.text import first_lines, header_at, read_table, separator_of, split
from jgait.io.units import stated_unit
from jgait.io.write import PARQUET
from jgait.notes import AS_READ
from jgait.types import PLACEMENTS, RecordingError

if TYPE_CHECKING:
    import pandas as pd

EXPECTED = "a table with columns <placement>_gyr_x, …, <placement>_acc_z, or gyr_x, …, acc_z of one sensor"
ENDINGS = (".csv", ".tsv", ".txt", *PARQUET)


def recognises(path: Path, head: bytes) -> bool:
    """Whether its name ends like that of a table, or it is a folder of such files."""
    if path.is_dir():
        return bool(_files(path))
    text = path.suffix.lower() in ENDINGS and b"\0" not in head
    return text or path.suffix.lower() in PARQUET or head.startswith(b"PAR1")


def _files(folder: Path) -> list[Path]:
    return [file for file in sorted(folder.iterdir())
            if file.suffix.lower() in ENDINGS and file.is_file() and placement_of(file.stem)]  # fmt: skip


def measured(path: Path) -> Measured:
    """All sensors of a table, or of a folder of tables of one sensor each that are called by their placements."""
    if path.is_dir():
        files = _files(path)
        if not files:
            raise RecordingError(f"{path.name} holds no table that is called by a placement, such as foot_left.csv")
        return joined([measured(file) for file in files], path.name)
    check_file(path, EXPECTED)
    table, notes = (read_parquet(path), ()) if path.suffix.lower() in PARQUET else read_table(path)
    if table.columns.nlevels == 2:
        for clock in [column for column in table.columns if column_of(str(column[0])) == "time"][:1]:
            table = table.set_index(clock).rename_axis("time")
        parts = gaitmap_parts({sensor: table[sensor] for sensor in table.columns.unique(0)}, path.name)
        whose = AS_READ.note("gaitmap's two rows of names: m/s² and deg/s, as gaitmap has them")
        return Measured(parts, path.stem, notes=(*notes, whose))
    table = table.set_axis(lettered(list(map(str, table.columns))), axis=1)
    plain = [column.strip().lower() for column in table.columns]
    if set(BODY_MOBGAP) <= set(plain):
        whose = AS_READ.note("mobgap's names of axes: m/s² and deg/s, as mobgap has them")
        return Measured([mobgap_part(table.set_axis(plain, axis=1), path.name)], path.stem, notes=(*notes, whose))
    if set(CHANNELS[:3]) <= {column_of(column) for column in plain}:
        # The table does not state the placement: any placement can be used to get the columns.
        labels, content = {"waist": path.stem}, measured_table(table, placement="waist", name=path.name, placed=True)
    else:
        table, labels = _placed_anywhere(table)
        content = measured_table(table, name=path.name, placed=bool(labels))
    parts = [part._replace(label=labels.get(part.label, part.label)) for part in content.parts]
    return content._replace(parts=parts, name=path.stem, notes=(*notes, *content.notes))


def _placed_anywhere(table: "pd.DataFrame") -> tuple["pd.DataFrame", dict[str, str]]:
    """A table whose columns name sensors and no place, with some placement for each, and their names by placement."""
    names = [str(column) for column in table.columns]
    if any(column_of(name) not in (None, "time") for name in names):
        return table, {}
    sensors = {name: sensor for name in names if (sensor := sensor_of(name))}
    channels: dict[str, list[str]] = {}
    for label, channel in sensors.values():
        channels.setdefault(label, []).append(channel)
    whole = [label for label, has in channels.items() if sorted(has) in (sorted(CHANNELS), sorted(CHANNELS[:3]))]
    where = dict(zip(whole, PLACEMENTS, strict=False))
    units = {name: f" [{unit}]" for name in sensors if (unit := stated_unit(name))}
    renamed = {name: f"{where[label]}_{channel}{units.get(name, '')}" for name, (label, channel) in sensors.items()
               if label in where}  # fmt: skip
    return table.rename(columns=renamed), {placement: label for label, placement in where.items()}


def foreign(path: Path) -> bool:
    """Whether the head of a text table has gaitmap's two rows of names, or mobgap's names of the body's axes."""
    lines, _ = first_lines(path)
    row, levels = header_at(lines)
    return levels == 2 or set(BODY_MOBGAP) <= set(split(lines[row].lower(), separator_of(lines[row])))
