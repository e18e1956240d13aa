"""A foot that walks a loop: units, repeated rows and gaps by files written here, the loop by the real one."""

import numpy as np
import pandas as pd
import pytest
from foot_heading import heading
from made import files as made_files
from made.notes import texts
from made.sets import loaded

from jgait.datasets.foot_reference import foot_path


@pytest.fixture
def folder(data_dir):
    folder = data_dir / "xio_gait"
    folder.mkdir()
    return folder


def table(samples=50):
    columns = ("Time (s)", *made_files.XIO)
    values = np.tile([0.0, 90.0, 0.0, -180.0, 0.0, 0.5, 1.0], (samples, 1))
    values[:, 0] = 5.0 + np.arange(samples) * 0.0025
    return pd.DataFrame(values, columns=columns)


def test_units_and_the_file_s_own_clock(folder):
    given = table()
    given = given.drop(index=[10, 11, 12])  # lost
    given = pd.concat([given.iloc[:20], given.iloc[19:]])  # and one row twice
    given.to_csv(folder / "long_walk.csv", index=False)
    walk = loaded("xio_gait")[0]
    imu = walk.recording.sensors["foot_right"]
    assert len(imu.time) == 47 and imu.time[0] == 0
    assert np.diff(imu.time)[9] == pytest.approx(0.01) and np.delete(np.diff(imu.time), 9) == pytest.approx(0.0025)
    assert walk.recording.sampling_rate_hz == pytest.approx(400)
    np.testing.assert_allclose(imu.gyr[3], [np.pi / 2, 0, -np.pi])
    np.testing.assert_allclose(imu.acc[3], [0, 0.5 * 9.80665, 9.80665])
    assert any("1 row that repeats" in note for note in texts(walk.recording.notes))
    assert any("which foot" in note for note in texts(walk.recording.notes))
    assert walk.reference is None and "ends where it began" in walk.info["no_reference"]
    assert (walk.info["closes"], walk.info["publisher_closure"], walk.info["verified"]) == (True, 0.421, False)


# --- the real file ---


@pytest.fixture(scope="module")
def walk(data):
    return data("xio_gait", "short_walk")[0]


def test_numbers_of_the_short_walk(walk):
    imu = walk.recording.sensors["foot_right"]
    assert walk.info["verified"] is True and walk.info["closes"] is True
    assert len(imu.time) == 16539 - 205 and imu.time[-1] == pytest.approx(41.618, abs=1e-3)
    assert walk.recording.sampling_rate_hz == pytest.approx(398.3, abs=0.1)
    assert np.diff(imu.time).max() == pytest.approx(0.01255, abs=1e-4)
    rest = imu.acc[imu.time < 15].mean(axis=0)
    assert np.linalg.norm(rest) == pytest.approx(9.81, abs=0.01) and rest[2] > 8, "gravity's reaction points up"


def test_the_short_walk_is_a_loop(walk):
    """It turns once round, and goes about as far as the publisher says."""
    imu = walk.recording.sensors["foot_right"]
    turned = heading(imu, 15.0)
    assert abs(turned[-1] - turned[0]) == pytest.approx(2 * np.pi, abs=0.4)
    assert foot_path(imu, walk.recording.sampling_rate_hz).distance[-1] == pytest.approx(25, rel=0.15)
