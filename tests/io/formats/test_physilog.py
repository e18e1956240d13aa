"""Gait Up's Physilog CSV: units, ends of rows, folders, a real file."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made import files as made_files

from jgait import datasets, io
from jgait.types import RecordingError


@pytest.mark.parametrize("separator", [",", ";"])
def test_a_written_file_is_the_known_walk(tmp_path, separator):
    recording = io.read(made_files.physilog(tmp_path / "RF.csv", separator=separator), placement="foot_right")
    assert made_files.check(recording).all()
    assert recording.sampling_rate_hz == 100.0


def test_a_folder_of_sensors(tmp_path):
    for name in ("right_foot", "left_foot"):
        made_files.physilog(tmp_path / f"{name}.csv")
    recording = io.read(tmp_path)
    made_files.check(recording, "foot_left")
    made_files.check(recording, "foot_right")


def test_the_rate_contradicts_the_time_stamps(tmp_path):
    path = made_files.physilog(tmp_path / "RF.csv")
    path.write_text(path.read_text().replace("Gyro [100 hz]", "Gyro [256 hz]"))
    with pytest.raises(RecordingError, match="time stamps run at 100 Hz, but sampling_rate_hz is 256"):
        io.read(path, placement="foot_right")


def test_a_real_walk(data):
    data("tripod")
    files = sorted(Path(datasets.path("tripod")).glob("example_data/raw/*/*/PWS/IMU/*S.csv"))
    if not files:
        pytest.skip("tripod has no sensor files here")
    sides = {"LS": "shank_left", "RS": "shank_right"}
    recording = io.read({sides[file.stem]: file for file in files if file.stem in sides})
    for file in files:
        raw = pd.read_csv(file, skiprows=7, header=None).to_numpy()
        imu = recording.sensors[sides[file.stem]]
        np.testing.assert_allclose(imu.gyr, np.deg2rad(raw[:, 1:4].astype(float)), atol=1e-12)
        np.testing.assert_allclose(imu.acc, 9.80665 * raw[:, 4:7].astype(float), atol=1e-12)
    assert recording.sampling_rate_hz == 128.0
