"""Xsens MTw text: units, lost packets, sensors that count together, real files."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made import files as made_files
from made.notes import texts

from jgait import datasets, io
from jgait.types import RecordingError


@pytest.mark.parametrize("separator", ["\t", ",", ";", " "])
def test_a_written_file_is_the_known_walk(tmp_path, separator):
    path = made_files.mtw(tmp_path / "MT_01200312-000_00B40C48.txt", separator=separator)
    recording = io.read(path, placements={"00B40C48": "foot_right"})
    assert made_files.check(recording).all()
    assert recording.sampling_rate_hz == 100.0 and recording.name == path.stem
    assert "foot_right: the sensor's +z points up (1.00 of gravity); axes as printed on the sensor's case" in texts(
        recording.notes
    )


def test_lost_packets_are_masked_and_the_counter_wraps(tmp_path):
    n = len(made_files.walk()[0])
    packets = (65500 + np.arange(n)) % 65536
    keep = np.flatnonzero(~np.isin(np.arange(n), [20, 21, 22, 150]))
    path = made_files.mtw(tmp_path / "MT_1_00B40C48.txt", packets=packets, keep=keep)
    recording = io.read(path, placement="foot_right")
    kept = made_files.check(recording)
    assert list(np.flatnonzero(~kept)) == [20, 21, 22, 150]
    assert "foot_right: packets lost and masked: 4" in texts(recording.notes)


def test_sensors_of_a_receiver_share_packet_numbers_also_over_a_wrap(tmp_path):
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
    by_file = {place: tmp_path / f"MT_1_{serial}.txt" for serial, place in placements.items()}
    again = io.read(by_file)
    for place, imu in recording.sensors.items():
        np.testing.assert_array_equal(again.sensors[place].gyr, imu.gyr)


def test_rates_too_large_for_rad_per_s_are_questioned(tmp_path):
    path = made_files.mtw(tmp_path / "MT_1.txt", scale=180.0 / np.pi)
    recording = io.read(path, placement="foot_right")
    made_files.check(recording)
    assert "MT_1: rates are too large for rad/s, Xsens' unit by its manual" in texts(recording.notes)
    assert any(
        note.startswith("foot_right: the file states no unit of angular rate; deg/s") for note in texts(recording.notes)
    )
    between = made_files.mtw(tmp_path / "MT_2.txt", scale=4.0)
    with pytest.raises(RecordingError, match="the size of foot_right does not decide"):
        io.read(between, placement="foot_right")
    made_files.check(io.read(path, placement="foot_right", gyr_unit="deg/s"))


def test_where_one_sensor_s_unit_is_in_doubt_all_are(tmp_path):
    made_files.mtw(tmp_path / "MT_1_00B40C48.txt", scale=180.0 / np.pi)
    made_files.mtw(tmp_path / "MT_1_00B40C44.txt", scale=0.02 * 180.0 / np.pi)
    recording = io.read(tmp_path, placements={"00B40C48": "foot_right", "00B40C44": "lower_back"})
    made_files.check(recording)
    np.testing.assert_allclose(recording.sensors["lower_back"].gyr, 0.02 * made_files.walk()[1], atol=1e-9)


def test_what_is_not_stated_must_be_said(tmp_path):
    path = made_files.mtw(tmp_path / "MT_1.txt", rate="unknown")
    with pytest.raises(RecordingError, match="neither time stamps nor a sampling rate"):
        io.read(path, placement="foot_right")
    made_files.check(io.read(path, placement="foot_right", sampling_rate_hz=100.0))
    with pytest.raises(RecordingError, match=r"does not state where its sensors sat: pass placements=\{'MT_1'"):
        io.read(path, sampling_rate_hz=100.0)


def test_a_packet_number_that_occurs_twice_is_masked(tmp_path):
    """As in `ipol_gait` 11-1: here row 30 repeats number 29, and number 30 is missing."""
    n = len(made_files.walk()[0])
    packets = np.arange(n)
    packets[30] = 29
    recording = io.read(made_files.mtw(tmp_path / "MT_1.txt", packets=packets), placement="foot_right")
    assert list(np.flatnonzero(~made_files.check(recording))) == [29, 30]
    assert "foot_right: packet numbers that occur twice are masked: 29" in texts(recording.notes)
    assert "foot_right: packets lost and masked: 1" in texts(recording.notes)


def test_packets_that_run_backwards_repeat_often_or_are_long_lost(tmp_path):
    n = len(made_files.walk()[0])
    packets = np.arange(n)
    packets[30] = 28
    with pytest.raises(RecordingError, match="packet numbers of foot_right must increase; 28 follows 29 in row 30"):
        io.read(made_files.mtw(tmp_path / "MT_1.txt", packets=packets), placement="foot_right")
    every_second = np.arange(n) // 2
    with pytest.raises(RecordingError, match="packet numbers of foot_right must increase; 0 follows 0 in row 1"):
        io.read(made_files.mtw(tmp_path / "MT_3.txt", packets=every_second), placement="foot_right")
    late = np.arange(n) + np.where(np.arange(n) < 100, 0, 1500)
    with pytest.raises(RecordingError, match="1500 packets of foot_right are missing in a row, more than 10 s"):
        io.read(made_files.mtw(tmp_path / "MT_2.txt", packets=late), placement="foot_right")


def test_acceleration_without_gravity_is_refused(tmp_path):
    path = made_files.mtw(tmp_path / "MT_1.txt")
    path.write_text("\n".join(line.replace("\tAcc_", "\tOther_") for line in path.read_text().splitlines()))
    with pytest.raises(RecordingError, match="gravity was taken off .FreeAcc_E, FreeAcc_N, FreeAcc_U.; expected Acc_X"):
        io.read(path, placement="foot_right")


def _real(name, pattern):
    if not datasets.available(name):
        pytest.skip(datasets.unavailable_reason(name))
    files = sorted(Path(datasets.path(name)).glob(pattern))
    if not files:
        pytest.skip(f"{name} has no {pattern} here")
    return files


def test_real_files_of_a_walk_with_eleven_sensors():
    files = _real("neura_sparse", "data/sample/rawimu/*.txt")
    recording = io.read(files[0].parent, placements={"00B40C44": "foot_right", "00B40C48": "foot_left"})
    for serial, where in (("00B40C44", "foot_right"), ("00B40C48", "foot_left")):
        own = next(file for file in files if serial in file.name)
        table = pd.read_csv(own, comment="/")
        imu = recording.sensors[where]
        rows = table["PacketCounter"].to_numpy() - table["PacketCounter"][0]
        first = np.flatnonzero(np.asarray(imu.mask))[0]
        assert np.asarray(imu.mask)[rows - rows[0] + first].all()
        for kind, values in (("Gyr", imu.gyr), ("Acc", imu.acc)):
            raw = table[[f"{kind}_{axis}" for axis in "XYZ"]].to_numpy()
            np.testing.assert_array_equal(np.asarray(values)[rows + first], raw)
    assert recording.sampling_rate_hz == 100.0


def test_real_files_with_another_head():
    """Rows become the samples of their packet numbers: 1-1 and others lost many packets, 12-1 and others none."""
    whole = 0
    for file in _real("ipol_gait", "GaitData/*_lb.txt"):
        recording = io.read(file, placement="lower_back")
        table = pd.read_csv(file, sep="\t", skiprows=1).drop_duplicates("PacketCounter", keep=False)
        packets = table["PacketCounter"].to_numpy(int)
        imu = recording.sensors["lower_back"]
        rows = packets - packets[0]
        assert len(imu.gyr) == rows[-1] + 1
        np.testing.assert_array_equal(np.asarray(imu.gyr)[rows], table[["Gyr_X", "Gyr_Y", "Gyr_Z"]])
        np.testing.assert_array_equal(np.flatnonzero(imu.mask), rows)
        assert recording.sampling_rate_hz == 100.0
        whole += bool(np.all(imu.mask))
    assert whole > 0, "no recording without a lost packet"
