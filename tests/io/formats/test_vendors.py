"""Text files of measuring systems: the known walk comes back, whatever is stated or lost; others are refused."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made import files as made_files
from made.notes import texts

from jgait import datasets, io
from jgait.types import RecordingError

FORMATS = {
    "mtw": ("MT_0120_00B40C48.txt", made_files.mtw, "Gyr_Z"),
    "dot": ("dot.csv", made_files.dot, "Gyr_Z"),
    "shimmer": ("session.csv", made_files.shimmer, "Shimmer_8665_Gyro_Z_CAL"),
    "xio": ("Inertial.csv", made_files.xio, "Gyroscope Z (deg/s)"),
    "physilog": ("RF.csv", made_files.physilog, "Gyro Z"),
    "csv": ("walk.csv", made_files.named, "foot_right_gyr_z"),
}
RATE_NEEDED = "neither time stamps nor a sampling rate; give sampling_rate_hz"


@pytest.fixture(params=FORMATS)
def one(request, tmp_path):
    """Name of a format, a good file of it, and the name of one of its columns."""
    name, write, column = FORMATS[request.param]
    return request.param, write(tmp_path / name), column


def refuse(one, match, **more):
    with pytest.raises(RecordingError, match=match) as told:
        io.read(one[1], format=one[0], placement="foot_right", **more)
    assert one[1].name in str(told.value) or one[1].stem in str(told.value)


def test_the_format_of_a_good_file_is_told_by_its_head(one):
    recording = io.read(one[1], **({} if one[0] == "csv" else {"placement": "foot_right"}))
    assert made_files.check(recording).all() and recording.sampling_rate_hz == pytest.approx(100.0, abs=1e-3)
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
    if one[0] != "csv":  # in a user's own table these cells are lost samples
        one[1].write_text("\n".join([*lines[:-3], lines[-3][: len(lines[-3]) // 2], *lines[-2:]]))
        refuse(one, rf"line {len(lines) - 2}: the row is cut off: it has \d+ values, the header \d+")
        separator = max(",\t", key=lines[-3].count)
        cells = lines[-3].split(separator)
        cells[lines[first].split(separator).index(one[2])] = "abc"
        one[1].write_text("\n".join([*lines[:-3], separator.join(cells), *lines[-2:]]))
        refuse(one, rf"line {len(lines) - 2}: column .* must hold numbers; found 'abc'")
    one[1].write_text(text.replace(one[2], "something"))
    refuse(one, f"lacks (the column )?'?{header}")
    one[1].write_text("\n".join(lines[: first + 1]))
    refuse(one, "has a header and no rows")
    for content, message in ((b"", "is empty; expected"), (b"\x89PNG\r\n\xff\xfe\x00\x01" * 50, "is no text file")):
        one[1].write_bytes(content)
        refuse(one, message)
    one[1].write_text("a,b,c\n1,2,3\n")
    refuse(one, "no column that is recog" if one[0] == "csv" else "has no such header: expected .* begins with 'a,b,c'")


SEPARATED = {made_files.mtw: "\t,; ", made_files.physilog: ",;", made_files.shimmer: "\t,"}


@pytest.mark.parametrize(("write", "mark"), [(write, mark) for write, marks in SEPARATED.items() for mark in marks])
def test_any_mark_separates_cells(tmp_path, write, mark):
    made_files.check(io.read(write(tmp_path / "MT_1.txt", separator=mark), placement="foot_right"))


@pytest.mark.parametrize(("write", "acc_unit"), [(made_files.physilog, "; g,"), (made_files.shimmer, "m/s^2")])
def test_without_a_row_of_units_they_are_told_from_the_signals(tmp_path, write, acc_unit):
    recording = io.read(write(tmp_path / "a.csv", units=False), placement="foot_right")
    made_files.check(recording)
    told = [note for note in texts(recording.notes) if "the file states no unit" in note]
    assert len(told) == 2 and "deg/s" in told[0] and acc_unit in told[1]


WRONG = {
    "physilog, time": (made_files.physilog, "[s]", "[h]", "a.csv: Time is in 'h'; expected one of s, ms, us"),
    "physilog, rate": (
        made_files.physilog, "Gyro [100 hz]", "Gyro [256 hz]", "time stamps run at 100 Hz, but sampling_rate_hz is 256",
    ),
    "shimmer, rate": (made_files.shimmer, "deg/s", "rpm", "Shimmer_8665_Gyro_X_CAL … is in rpm; expected one of deg/s"),
    "shimmer, time": (made_files.shimmer, "ms\t", "ticks\t", "Timestamp_Unix_CAL is in 'ticks'; expected one of s, ms"),
    "shimmer, raw": (made_files.shimmer, "_Gyro_X_CAL", "_Gyro_X_RAW", "lacks the column 'Shimmer_8665_Gyro_X_CAL'"),
    "shimmer, all raw": (
        made_files.shimmer, "_CAL", "_RAW", r"gyroscope of Shimmer_8665 is not calibrated \(found RAW, expected CAL",
    ),
    "xio, time": (made_files.xio, "Timestamp (us)", "Time (h)", "Time is in 'h'; expected one of s, ms, us"),
    "xio, raw": (made_files.xio, "(deg/s)", "(lsb)", r"Gyroscope X … is in lsb; expected one of .* export calibrated"),
    "xio, force": (made_files.xio, "(g)", "(m/s^2)", "it seems to be in g|gravity alone is 9.807"),
    "xio, packets": (made_files.xio, "Timestamp (us)", "Packet number", RATE_NEEDED),
    "mtw, rate": (made_files.mtw, "100.0Hz", "unknown", RATE_NEEDED),
    "mtw, gravity": (made_files.mtw, "\tAcc_", "\tOther_", "gravity was taken off .FreeAcc_E, FreeAcc_N, FreeAcc_U.;"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_units_and_signals_that_are_not_there_are_refused(tmp_path, name):
    write, right, wrong, message = WRONG[name]
    path = write(tmp_path / "a.csv")
    path.write_text(path.read_text().replace(right, wrong))
    with pytest.raises(RecordingError, match=message):
        io.read(path, placement="foot_right")
    if message is RATE_NEEDED:
        made_files.check(io.read(path, placement="foot_right", sampling_rate_hz=100.0))


def test_no_file_and_a_folder_of_nothing(tmp_path):
    with pytest.raises(FileNotFoundError):
        io.read(tmp_path / "none.csv")
    with pytest.raises(RecordingError, match="is a folder, and none of a format that jgait reads"):
        io.read(tmp_path)
    with pytest.raises(ValueError, match="format must be one of mobilised"):
        io.read(tmp_path, format="excel")


# --- MTw ---


def test_sensors_of_a_receiver_share_packet_numbers_over_a_wrap_and_lost_ones_are_masked(tmp_path):
    n = len(made_files.walk()[0])
    # The second starts 5 packets later, just after the counter wrapped.
    made_files.mtw(tmp_path / "MT_1_00B40C48.txt", packets=(65533 + np.arange(n)) % 65536)
    made_files.mtw(tmp_path / "MT_1_00B40C44.txt", packets=np.arange(n) + 2, keep=np.flatnonzero(np.arange(n) != 50))
    placements = {"00B40C48": "foot_right", "00B40C44": "foot_left"}
    recording = io.read(tmp_path, placements=placements)
    made_files.check(recording, "foot_right", slice(5, None))
    left = recording.sensors["foot_left"]
    np.testing.assert_allclose(left.gyr[:50], made_files.walk()[1][:50], atol=1e-12)
    assert list(np.flatnonzero(~np.asarray(left.mask))) == [50]
    (lost,) = (text for text in texts(recording.notes) if "lost" in text or "missing" in text)  # one loss, one note
    assert lost == f"foot_left: samples missing: 1 of {n - 5}"
    again = io.read({place: tmp_path / f"MT_1_{serial}.txt" for serial, place in placements.items()})
    for place, imu in recording.sensors.items():
        np.testing.assert_array_equal(again.sensors[place].gyr, imu.gyr)


def test_rates_too_large_for_rad_per_s_are_questioned_of_all_sensors(tmp_path):
    degrees, serials = 180.0 / np.pi, {"00B40C48": "foot_right", "00B40C44": "lower_back"}
    made_files.mtw(tmp_path / "MT_1_00B40C48.txt", scale=degrees)
    made_files.mtw(tmp_path / "MT_1_00B40C44.txt", scale=0.02 * degrees)
    recording = io.read(tmp_path, placements=serials)
    made_files.check(recording)
    np.testing.assert_allclose(recording.sensors["lower_back"].gyr, 0.02 * made_files.walk()[1], atol=1e-9)
    assert "MT_1_00B40C48: rates are too large for rad/s, Xsens' unit by its manual" in texts(recording.notes)
    with pytest.raises(RecordingError, match="the size of foot_right does not decide"):
        io.read(made_files.mtw(tmp_path / "MT_2.txt", scale=4.0), placement="foot_right")


def test_packet_numbers_that_repeat_or_are_long_lost(tmp_path):
    """As in `ipol_gait` 11-1: here row 30 repeats number 29, and number 30 is missing."""
    n = len(made_files.walk()[0])
    once = np.where(np.arange(n) == 30, 29, np.arange(n))
    recording = io.read(made_files.mtw(tmp_path / "MT_1.txt", packets=once), placement="foot_right")
    assert list(np.flatnonzero(~made_files.check(recording))) == [29, 30]
    assert "foot_right: packet numbers that occur twice are masked: 29" in texts(recording.notes)
    for packets, message in (
        (np.where(np.arange(n) == 30, 28, np.arange(n)), "must increase; 28 follows 29 in row 30"),
        (np.arange(n) // 2, "must increase; 0 follows 0 in row 1"),
        (np.arange(n) + np.where(np.arange(n) < 100, 0, 1500), "1500 packets of foot_right are missing in a row, more"),
    ):
        with pytest.raises(RecordingError, match=message):
            io.read(made_files.mtw(tmp_path / "MT_1.txt", packets=packets), placement="foot_right")


# --- DOT ---


@pytest.mark.parametrize("tear", [(",Acc_X", "\n,Acc_X"), (",Acc_X", ",\nAcc_X"), ("cc_X", "\ncc_X")])
def test_a_header_that_is_torn_in_two_is_joined(tmp_path, tear):
    path = made_files.dot(tmp_path / "a.csv")
    path.write_text(path.read_text().replace(*tear, 1))
    made_files.check(io.read(path))


def test_a_clock_that_wraps_or_is_not_there_and_windows_own_code(tmp_path):
    path = made_files.dot(tmp_path / "a.csv", start=2**32 - 1_000_000)
    recording = io.read(path)
    assert made_files.check(recording).all()
    assert "the sensor 'Right foot' is taken to have sat at foot_right" in texts(recording.notes)
    made_files.check(io.read(made_files.dot(path, stamps=False)))
    lines = made_files.dot(path).read_text().splitlines()
    made_files.put(path, lines[next(k for k, line in enumerate(lines) if line.startswith("PacketCounter")) :])
    placed = io.read(path, placement="foot_right")
    made_files.check(placed)
    assert "was stated to sit at foot_right" in " ".join(texts(placed.notes))
    path.write_bytes(made_files.dot(path).read_text(encoding="utf-8").encode("cp1252"))
    made_files.check(io.read(path))


def test_folders_of_sensors_on_one_clock(tmp_path):
    made_files.dot(tmp_path / "1.csv")
    made_files.dot(tmp_path / "2.csv", tag="Left foot", start=50_000)
    (tmp_path / "notes.csv").write_text("a,b\n1,2\n")
    recording = io.read(tmp_path)
    _, gyr, _ = made_files.walk()  # what begins 50 ms later is behind by five samples
    np.testing.assert_allclose(recording.sensors["foot_right"].gyr, gyr[5:], atol=1e-9)
    np.testing.assert_allclose(recording.sensors["foot_left"].gyr, gyr[:-5], atol=1e-9)
    made_files.dot(tmp_path / "2.csv", tag="Left foot", synced="Unsynced")
    with pytest.raises(RecordingError, match=r"the clock of 2.csv was not synchronised .* 'Unsynced'"):
        io.read(tmp_path)
    for name in ("1.csv", "2.csv"):
        made_files.dot(tmp_path / name, tag="Xsens DOT")
    made_files.check(io.read(tmp_path, placements={"1": "foot_right", "2": "foot_left"}))
    for device, file in (("Right Foot", "Inertial.csv"), ("Left Foot", "sensors.csv")):
        (tmp_path / "xio" / device).mkdir(parents=True)
        made_files.xio(tmp_path / "xio" / device / file)
        (tmp_path / "xio" / device / "Quaternion.csv").write_text("Timestamp (us),W,X,Y,Z\n1,1,0,0,0\n")
    recording = io.read(tmp_path / "xio")
    assert sorted(recording.sensors) == ["foot_left", "foot_right"]
    made_files.check(recording)


def test_increments_are_refused(tmp_path):
    names = "PacketCounter,SampleTimeFine,dq_W,dq_X,dq_Y,dq_Z,dv[1],dv[2],dv[3]"
    path = made_files.put(tmp_path / "a.csv", [names, "1,2,1,0,0,0,0,0,0"])
    with pytest.raises(RecordingError, match="holds increments"):
        io.read(path, placement="foot_right")


# --- Shimmer and x-io ---


def test_shimmers_devices_and_decimal_commas(tmp_path):
    path = made_files.shimmer(tmp_path / "a.csv", devices=("RightFoot", "L_shank", "Spare"), separator=";")
    path.write_text(path.read_text().replace(".", ","))
    recording = io.read(path)
    assert sorted(recording.sensors) == ["foot_right", "shank_left"]
    made_files.check(recording, "shank_left")
    assert "left out: 'Spare' (its place is not known)" in texts(recording.notes)


def test_the_wide_range_accelerometer_where_the_other_is_at_its_limit(tmp_path):
    _, _, acc = made_files.walk()
    recording = io.read(made_files.shimmer(tmp_path / "a.csv", wide=acc), placement="foot_right")
    made_files.check(recording)
    assert any("Accel_WR taken, for Accel_LN is at its limit" in note for note in texts(recording.notes))


def test_times_of_day(tmp_path):
    path = made_files.shimmer(tmp_path / "a.csv")
    lines = path.read_text().replace("Timestamp_Unix", "TimestampSync_FormattedUnix").splitlines()
    days = np.datetime64("2021-06-01T10:11:12.000") + np.round(1e3 * made_files.walk()[0]).astype("timedelta64[ms]")
    stamps = [str(day).replace("T", " ").replace("-", "/") for day in days]
    lines[3:] = [f"{at}\t{line.split(chr(9), 1)[1]}" for at, line in zip(stamps, lines[3:], strict=True)]
    made_files.check(io.read(made_files.put(path, lines), placement="foot_right"))
    lines[10] = "soon\t" + lines[10].split("\t", 1)[1]
    with pytest.raises(RecordingError, match="must hold times of day; found 'soon'"):
        io.read(made_files.put(path, lines), placement="foot_right")


@pytest.mark.parametrize("first, scale", [("Timestamp (us)", 1e6), ("Time (s)", 1.0), ("time (ms)", 1e3)])
def test_xios_clocks_and_a_row_that_repeats_the_row_before(tmp_path, first, scale):
    path = made_files.xio(tmp_path / "a.csv", first=first, scale=scale, repeat=30)
    recording = io.read(path, placement="foot_right")
    made_files.check(recording)
    assert "1 row of a.csv repeats the row before and is left out" in texts(recording.notes)


# --- real files ---


def real(name, pattern):
    if not datasets.available(name):
        pytest.skip(datasets.unavailable_reason(name))
    files = sorted(Path(datasets.path(name)).glob(pattern))
    return files or pytest.skip(f"{name} has no {pattern} here")


def test_real_files_of_a_walk_with_eleven_sensors():
    files = real("neura_sparse", "data/sample/rawimu/*.txt")
    recording = io.read(files[0].parent, placements={"00B40C44": "foot_right", "00B40C48": "foot_left"})
    for serial, where in (("00B40C44", "foot_right"), ("00B40C48", "foot_left")):
        table = pd.read_csv(next(file for file in files if serial in file.name), comment="/")
        imu, first = recording.sensors[where], np.flatnonzero(recording.sensors[where].mask)[0]
        rows = first + table["PacketCounter"].to_numpy() - table["PacketCounter"][0]
        assert np.asarray(imu.mask)[rows].all()
        for kind, values in (("Gyr", imu.gyr), ("Acc", imu.acc)):
            np.testing.assert_array_equal(values[rows], table[[f"{kind}_{axis}" for axis in "XYZ"]])


def test_real_files_with_another_head():
    """Rows become the samples of their packet numbers: 1-1 and others lost many packets, 12-1 and others none."""
    for file in real("ipol_gait", "GaitData/*_lb.txt"):
        imu = io.read(file, placement="lower_back").sensors["lower_back"]
        table = pd.read_csv(file, sep="\t", skiprows=1).drop_duplicates("PacketCounter", keep=False)
        rows = table["PacketCounter"].to_numpy(int) - int(table["PacketCounter"].iloc[0])
        np.testing.assert_array_equal(np.asarray(imu.gyr)[rows], table[["Gyr_X", "Gyr_Y", "Gyr_Z"]])
        np.testing.assert_array_equal(np.flatnonzero(imu.mask), rows)


@pytest.mark.parametrize(
    ("name", "pattern", "placement", "skipped"),
    [("tripod", "example_data/raw/*/*/PWS/IMU/RS.csv", "shank_right", 7),
     ("xio_gait", "short_walk.csv", "foot_right", 1)],
)  # fmt: skip
def test_real_files_in_degrees_and_g(name, pattern, placement, skipped):
    file = real(name, pattern)[0]
    imu = io.read(file, placement=placement).sensors[placement]
    raw = pd.read_csv(file, skiprows=skipped, header=None).iloc[:, :7].drop_duplicates().to_numpy(float)
    kept = np.asarray(imu.mask)
    np.testing.assert_allclose(imu.time[kept], raw[:, 0] - raw[0, 0], atol=1e-4)
    np.testing.assert_allclose(imu.gyr[kept], np.deg2rad(raw[:, 1:4]), atol=1e-12)
    np.testing.assert_allclose(imu.acc[kept], raw[:, 4:] * 9.80665, atol=1e-12)
