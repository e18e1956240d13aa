"""x-io's CSV: the four kinds of it, folders of devices, repeated rows, a real file."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made import files as made_files
from made.notes import texts

from jgait import datasets, io
from jgait.types import RecordingError


@pytest.mark.parametrize("first, scale", [("Timestamp (us)", 1e6), ("Time (s)", 1.0), ("time (ms)", 1e3)])
def test_a_written_file_is_the_known_walk(tmp_path, first, scale):
    recording = io.read(made_files.xio(tmp_path / "a.csv", first=first, scale=scale), placement="foot_right")
    assert made_files.check(recording).all()
    assert recording.sampling_rate_hz == pytest.approx(100.0)


def test_packet_numbers_tell_no_time(tmp_path):
    path = made_files.xio(tmp_path / "walk_CalInertialAndMag.csv", first="Packet number")
    with pytest.raises(RecordingError, match="neither time stamps nor a sampling rate; give sampling_rate_hz"):
        io.read(path, placement="foot_right")
    made_files.check(io.read(path, placement="foot_right", sampling_rate_hz=100.0))


def test_folders_of_devices(tmp_path):
    for device, file in (("Right Foot", "Inertial.csv"), ("Left Foot", "sensors.csv")):
        (tmp_path / device).mkdir()
        made_files.xio(tmp_path / device / file)
        (tmp_path / device / "Quaternion.csv").write_text("Timestamp (us),W,X,Y,Z\n1,1,0,0,0\n")
    recording = io.read(tmp_path)
    assert sorted(recording.sensors) == ["foot_left", "foot_right"]
    made_files.check(recording)
    made_files.check(io.read(tmp_path / "Left Foot"), "foot_left")


def test_a_row_that_repeats_the_row_before_is_left_out(tmp_path):
    recording = io.read(made_files.xio(tmp_path / "a.csv", repeat=30), placement="foot_right")
    made_files.check(recording)
    assert "a.csv: rows that repeat the row before left out: 1" in texts(recording.notes)


@pytest.mark.parametrize("right, wrong, message", [
    ("(deg/s)", "(lsb)", r"Gyroscope X … is in lsb; expected one of .* export calibrated data"),
    ("(g)", "(m/s^2)", "it seems to be in g|gravity alone is 9.807"),
])  # fmt: skip
def test_raw_numbers_and_a_unit_that_the_signals_contradict_are_refused(tmp_path, right, wrong, message):
    names = [name.replace(right, wrong) for name in made_files.XIO]
    with pytest.raises(RecordingError, match=message):
        io.read(made_files.xio(tmp_path / "a.csv", names=names), placement="foot_right")


def test_a_real_walk(data):
    data("xio_gait", "short_walk")
    file = Path(datasets.path("xio_gait")) / "short_walk.csv"
    recording = io.read(file, placement="foot_right")
    imu = recording.sensors["foot_right"]
    raw = pd.read_csv(file).drop_duplicates().to_numpy()
    kept = np.asarray(imu.mask)
    assert kept.sum() == len(raw)
    np.testing.assert_allclose(imu.time[kept], raw[:, 0] - raw[0, 0], atol=1e-12)
    np.testing.assert_allclose(imu.gyr[kept], np.deg2rad(raw[:, 1:4]), atol=1e-12)
    np.testing.assert_allclose(imu.acc[kept], raw[:, 4:] * 9.80665, atol=1e-12)
    assert "short_walk.csv: rows that repeat the row before left out: 205" in texts(recording.notes)
