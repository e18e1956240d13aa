"""Text files that are no files of their format: what is said of each."""

import re

import pytest
from made import files as made_files
from made.notes import texts

from jgait import io
from jgait.types import RecordingError

FORMATS = {
    "mtw": ("MT_0120_00B40C48.txt", made_files.mtw, "Gyr_Z"),
    "dot": ("dot.csv", made_files.dot, "Gyr_Z"),
    "shimmer": ("session.csv", made_files.shimmer, "Shimmer_8665_Gyro_Z_CAL"),
    "xio": ("Inertial.csv", made_files.xio, "Gyroscope Z (deg/s)"),
    "physilog": ("RF.csv", made_files.physilog, "Gyro Z"),
    "csv": ("walk.csv", made_files.named, "foot_right_gyr_z"),
}


def written(format, folder):
    """Name of a format, a good file of it, and the name of one of its columns."""
    name, write, column = FORMATS[format]
    return format, write(folder / name), column


@pytest.fixture(params=FORMATS)
def one(request, tmp_path):
    return written(request.param, tmp_path)


@pytest.fixture(params=[name for name in FORMATS if name != "csv"])
def vendors(request, tmp_path):
    """A measuring system's: in a user's own table any header may be, and a cell without a number is a lost sample."""
    return written(request.param, tmp_path)


def refuse(one, match, **more):
    with pytest.raises(RecordingError, match=match) as told:
        io.read(one[1], format=one[0], placement="foot_right", **more)
    assert one[1].name in str(told.value) or one[1].stem in str(told.value)


def test_the_format_of_a_good_file_is_told_by_its_head(one):
    placement = {} if one[0] == "csv" else {"placement": "foot_right"}
    recording = io.read(one[1], **placement)
    made_files.check(recording)
    assert f"read as {io.FORMATS[one[0]].title}" in texts(recording.notes)


def test_what_is_cut_off_empty_or_binary_is_named(one):
    text, header = one[1].read_text(), re.escape(one[2].removesuffix(" (deg/s)"))
    lines = text.splitlines()
    first = next(k for k, line in enumerate(lines) if one[2] in line)
    one[1].write_text(text[: len(text) - len(lines[-1]) // 2])
    recording = io.read(one[1], placement=None if one[0] == "csv" else "foot_right")
    made_files.check(recording, rows=slice(-1))
    (note,) = (note for note in recording.notes if "ends within a row" in note.text)
    assert note.values["line"] == len(lines)
    middle = lines[-3][: len(lines[-3]) // 2]
    one[1].write_text("\n".join([*lines[:-3], middle, *lines[-2:]]))
    if one[0] != "csv":  # in a user's own table these cells are lost samples
        refuse(one, rf"line {len(lines) - 2}: the row is cut off: expected \d+ values, found \d+")
    one[1].write_text(text.replace(one[2], "something"))
    refuse(one, f"lacks (the column )?'?{header}")
    one[1].write_text("\n".join(lines[: first + 1]))
    refuse(one, "has a header and no rows")
    one[1].write_bytes(b"")
    refuse(one, "is empty; expected")
    one[1].write_bytes(b"\x89PNG\r\n\xff\xfe\x00\x01" * 50)
    refuse(one, "is no text file")
    if one[1].suffix == ".csv":
        with pytest.raises(RecordingError, match="is in no format that jgait reads"):
            io.read(one[1])


def test_a_cell_that_holds_no_number(vendors):
    one = vendors
    lines = one[1].read_text().splitlines()
    separator = max(",\t", key=lines[-3].count)
    cells = lines[-3].split(separator)
    header = next(line for line in lines if one[2] in line).split(separator)
    cells[header.index(one[2])] = "abc"
    lines[-3] = separator.join(cells)
    one[1].write_text("\n".join(lines))
    refuse(one, rf"line {len(lines) - 2}: column .* must hold numbers; found 'abc'")


def test_another_format_has_no_such_header(vendors, tmp_path):
    other = made_files.put(tmp_path / "other.csv", ["a,b,c", "1,2,3"])
    refuse((vendors[0], other), "has no such header: expected .* it begins with 'a,b,c'")


@pytest.mark.parametrize(("write", "acc_unit"), [(made_files.physilog, "; g,"), (made_files.shimmer, "m/s^2")])
def test_without_a_row_of_units_they_are_told_from_the_signals(tmp_path, write, acc_unit):
    recording = io.read(write(tmp_path / "a.csv", units=False), placement="foot_right")
    made_files.check(recording)
    told = [note for note in texts(recording.notes) if "the file states no unit" in note]
    assert len(told) == 2 and "deg/s" in told[0] and acc_unit in told[1]


@pytest.mark.parametrize(
    ("write", "unit", "wrong", "message"),
    [
        (made_files.physilog, "[s]", "[h]", "a.csv: Time is in 'h'; expected one of s, ms, us"),
        (made_files.shimmer, "deg/s", "rpm", "a.csv: Shimmer_8665_Gyro_X_CAL … is in rpm; expected one of deg/s"),
        (made_files.shimmer, "ms\t", "ticks\t", "Timestamp_Unix_CAL is in 'ticks'; expected one of s, ms, us"),
        (made_files.xio, "Timestamp (us)", "Time (h)", "Time is in 'h'; expected one of s, ms, us"),
    ],
)
def test_unknown_units_are_refused(tmp_path, write, unit, wrong, message):
    path = write(tmp_path / "a.csv")
    path.write_text(path.read_text().replace(unit, wrong))
    with pytest.raises(RecordingError, match=message):
        io.read(path, placement="foot_right")


def test_no_file_and_a_folder_of_nothing(tmp_path):
    with pytest.raises(FileNotFoundError):
        io.read(tmp_path / "none.csv")
    with pytest.raises(RecordingError, match="is a folder, and none of a format that jgait reads"):
        io.read(tmp_path)
    with pytest.raises(ValueError, match="format must be one of mobilised"):
        io.read(tmp_path, format="excel")
