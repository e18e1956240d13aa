"""Files of worn devices: Axivity's CWA, and those that are refused, for they have no gyroscope."""

import struct
import zipfile

import numpy as np
import pytest
from made import files as made_files
from made.notes import texts

from jgait import io
from jgait.types import RecordingError

ROWS = 40
"""Samples of six axes in a block of a CWA file."""


def cwa(path, gyroscope=True):
    """Open Movement's file of an AX6: a header, and blocks of 40 samples whose stamp is a whole second."""
    time, gyr, acc = made_files.walk()
    raw = np.column_stack([np.rad2deg(gyr) * 32768 / 2000, acc / made_files.G * 2048]).round().astype("<i2")
    header = bytearray(1024)
    header[:5] = struct.pack("<2sHB", b"MD", 1020, 0x64 if gyroscope else 0x17)
    header[35:37], header[41] = bytes([2 if gyroscope else 0, 0x0A]), 50
    blocks = [bytes(header)]
    for k in range(len(time) // ROWS):
        rows = raw[k * ROWS : (k + 1) * ROWS]
        begin = k * ROWS / made_files.RATE
        second = int(np.ceil(begin))
        stamp = 24 << 26 | 7 << 22 | 1 << 17 | 12 << 12 | second // 60 << 6 | second % 60
        offset = round((second - begin) * made_files.RATE)
        light, axes = (0x6800, 0x62) if gyroscope else (0x6000, 0x32)
        words = struct.pack(
            "<2sHHIIIHHBBBBhH", b"AX", 508, 0, 7, k, stamp, light, 300, 0, 200, 0x0A, axes, offset, ROWS
        )
        data = (words + (rows if gyroscope else rows[:, 3:]).tobytes()).ljust(510, b"\0")
        blocks.append(data + struct.pack("<H", -sum(struct.unpack("<255H", data)) & 0xFFFF))
    path.write_bytes(b"".join(blocks))
    return path, len(blocks[1:]) * ROWS


def test_axivitys_cwa(tmp_path):
    pytest.importorskip("cwa_reader_rs", reason="the extra devices is not installed")
    path, count = cwa(tmp_path / "walk.cwa")
    recording = io.read(path, placement="foot_right")
    imu, (_, gyr, acc) = recording.sensors["foot_right"], made_files.walk()
    assert len(imu.time) == count and recording.sampling_rate_hz == pytest.approx(100.0, rel=1e-6)
    np.testing.assert_allclose(imu.gyr, gyr[:count], atol=np.deg2rad(0.04))
    np.testing.assert_allclose(imu.acc, acc[:count], atol=0.003)
    assert "times count from 2024-07-01 12:00:00.000, the date of the first sample" in texts(recording.notes)
    path.write_bytes(path.read_bytes()[:1024])
    with pytest.raises(RecordingError, match="walk.cwa"):
        io.read(path, placement="foot_right")
    with pytest.raises(RecordingError, match="this AX3 recorded no gyroscope, which every method needs"):
        io.read(cwa(tmp_path / "ax3.cwa", gyroscope=False)[0], placement="waist")


ACTIGRAPH = "------------ Data File Created By ActiGraph {} ActiLife v6.13.3 Firmware v1.7.2 at 100 Hz -----------"


@pytest.mark.parametrize("header", [True, False])
def test_files_without_a_gyroscope_are_refused_for_that(tmp_path, header):
    _, gyr, acc = made_files.walk()
    head = [ACTIGRAPH.format("GT3X+"), "Serial Number: TAS1H00000000", "Start Time 18:40:00", "-" * 50]
    names = ["Accelerometer X,Accelerometer Y,Accelerometer Z"] * header
    path = made_files.put(tmp_path / "raw.csv", [*head, *names, *made_files.lines_of(",", *(acc / made_files.G).T)])
    for options in ({}, {"placement": "waist", "sampling_rate_hz": 100.0}):
        with pytest.raises(
            RecordingError, match="raw.csv is of an ActiGraph's accelerometer alone: every method needs a"
        ):
            io.read(path, **options)
    with pytest.raises(RecordingError, match="raw.csv is of an ActiGraph's accelerometer alone"):
        io.read_csv(path, placement="waist", sampling_rate_hz=100.0)
    made_files.put(path, [*names, *made_files.lines_of(",", *acc.T)] if header else ["a,b", "1,2"])
    with pytest.raises(
        RecordingError, match="holds no gyroscope, which every" if header else "no column that is recogn"
    ):
        io.read(path, placement="waist", sampling_rate_hz=100.0)
    imu = ",".join(["Timestamp", *(f"{name} {axis}" for name in ("Accelerometer", "Gyroscope") for axis in "XYZ")])
    stamps = [f"2024-05-03T10:00:{t:09.6f}" for t in made_files.walk()[0]]
    rows = made_files.lines_of(",", *(acc / made_files.G).T, *np.rad2deg(gyr).T)
    rows = [f"{stamp},{row}" for stamp, row in zip(stamps, rows, strict=True)]
    made_files.check(io.read(made_files.put(path, [*head, imu, *rows]), placement="foot_right"))


def test_an_accelerometer_is_not_dropped_where_its_columns_are_called_as_no_known_device_does(tmp_path):
    """A Physilog has "gyro X" and "time" too, and calls its accelerometer "Accel X"."""
    time, gyr, acc = made_files.walk()
    names = ["time", *(f"{kind} {axis}" for kind in ("acc", "gyro") for axis in "XYZ")]
    rows = made_files.lines_of(",", time, *acc.T, *np.rad2deg(gyr).T)
    path = made_files.put(tmp_path / "walk.csv", ["Subject,Mario", "Frequency,100 Hz", "", ",".join(names), *rows])
    recording = io.read(path, placement="foot_right")
    np.testing.assert_allclose(recording.sensors["foot_right"].acc, acc, atol=1e-4)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("walk.gt3x", b"PK", "is of an ActiGraph, .*read by pygt3x.* every method needs a gyroscope"),
        ("walk.bin", b"Device Identity\r\nDevice Unique Serial Code:012345\r\n", "GENEActiv, which has no gyroscope"),
        ("walk.csv", b"Device Type,GENEActiv\r\n\r\n2024-05-03 10:00:00:000,0.1,0.1,1.0,5,0,20\r\n", "GENEActiv, wh"),
        ("walk.mtb", b"\xfa\xff", "export inertial data as text from MT Manager"),
        ("walk.zip", b"PK", "is an archive: unpack it"),
    ],
)  # fmt: skip
def test_what_makes_a_file_readable_is_named(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    if content == b"PK":
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            archive.writestr("info.txt", "Serial Number: NEO1\n")
    with pytest.raises(RecordingError, match=message) as caught:
        io.read(tmp_path / name, placement="waist")
    assert len(str(caught.value)) < RecordingError.LONGEST
