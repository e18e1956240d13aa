"""Ruler-measured footprints: parsing by files written here, axes and turns by the real ones."""

import numpy as np
import pandas as pd
import pytest
from made.notes import texts
from made.sets import loaded, refused
from scipy.io import savemat

from jgait import datasets

SAMPLES = np.array([400, 600, 850, 1000])
PLAN = np.array([[0, 0], [0, -0.7], [0, -1.9], [1.0, -1.9]])  # seen from below: the last stride turns right from above
NAME = "SensorConnectData_77"


@pytest.fixture
def folder(data_dir):
    """One recording that the registry does not know, its sensor hanging z down and turning about z."""
    folder = data_dir / "footprints" / "data"
    (folder / "own").mkdir(parents=True)
    (folder / "LLIO_training_data").mkdir()
    write(folder)
    return folder


def write(folder, name=NAME, **changes):
    time = 3.0 + np.arange(1200) * 0.005
    imu = np.tile([1.0, 2.0, -9.5, 0.1, 0.2, 0.3], (1200, 1))
    variables = {"timestamps": time, "imu_data": imu} | changes
    kept = {key: value for key, value in variables.items() if value is not None}
    savemat(folder / "LLIO_training_data" / f"{name}_LLIO.mat", kept)
    table = {"strideIndex": SAMPLES, "timestamp": time[SAMPLES], "gcpX": PLAN[:, 0], "gcpY": PLAN[:, 1]}
    pd.DataFrame(table).to_csv(csv(folder, name), index=False)
    ruler(folder, name, correct=1)


def csv(folder, name=NAME):
    return folder / "LLIO_training_data" / f"{name}_strideIndex_timestamp_gcpX_gcpY.csv"


def ruler(folder, name, correct):
    savemat(folder / "own" / f"{name}.mat", {"GCP_exist_and_correct": correct})


def test_axes_footprints_and_distance(folder):
    assert datasets.names("footprints") == (NAME,)
    (walk,) = loaded("footprints")
    imu = walk.recording.sensors["foot_right"]
    np.testing.assert_allclose(imu.acc[5], [1, -2, 9.5])
    np.testing.assert_allclose(imu.gyr[5], [0.1, -0.2, -0.3])
    assert imu.time[0] == 0 and walk.recording.sampling_rate_hz == pytest.approx(200)
    assert any("which foot" in note for note in texts(walk.recording.notes))
    prints = walk.info["footprints"]
    assert prints["samples"].tolist() == SAMPLES.tolist()
    np.testing.assert_allclose(prints["time"], SAMPLES * 0.005)
    np.testing.assert_allclose(prints["position"], [[0, 0], [0, 0.7], [0, 1.9], [1.0, 1.9]])
    assert walk.info["verified"] is False
    along = walk.reference.distance[[0, 400, 500, 600, 850, 1000, 1199]]
    np.testing.assert_allclose(along, [0, 0, 0.35, 0.7, 1.9, 2.9, 2.9])
    assert walk.reference.valid[1000] and not walk.reference.valid[1001]
    strides = walk.reference.strides
    np.testing.assert_allclose(strides.length, [0.7, 1.2, 1.0])
    np.testing.assert_allclose(strides.standing, (SAMPLES * 0.005)[:-1])
    np.testing.assert_allclose(strides.standing_end, (SAMPLES * 0.005)[1:])
    assert strides.start is strides.end is strides.final_contact is None and np.isnan(strides.width).all()
    assert (strides.side == 0).all() and strides.valid.all()
    assert walk.info["speed"] == pytest.approx(2.9 / 3.0)


def test_missing_files_are_reported(folder):
    (folder / "own" / f"{NAME}.mat").unlink()
    write(folder, "SensorConnectData_78")
    csv(folder, "SensorConnectData_78").unlink()
    walks = {walk.recording.name: walk for walk in datasets.load("footprints")}
    one = walks[NAME]
    assert one.info["footprints"] is not None
    assert any("own/SensorConnectData_77.mat" in note for note in texts(one.recording.notes))
    ruler(folder, NAME, correct=0)
    wrong = datasets.load("footprints", [NAME])[0]
    assert wrong.reference is None and "not measured, or not correctly" in wrong.info["no_reference"]
    other = walks["SensorConnectData_78"]
    assert other.reference is None and other.info["footprints"] is None and other.info["speed"] is None
    assert "SensorConnectData_78_strideIndex" in other.info["no_reference"]


@pytest.mark.parametrize(
    "change, said",
    [
        ({"strideIndex": [400, 600, 600, 1000]}, "strideIndex must rise"),
        ({"strideIndex": [400, 600, 850, 1200]}, "to less than 1200"),
        ({"gcpX": [0, 1, np.nan, 3]}, "all of them numbers"),
        ({"gcpX": None}, "has no column gcpX"),
    ],
)
def test_bad_footprints_are_named(folder, change, said):
    table = pd.read_csv(csv(folder)).assign(**change)
    table.drop(columns=[name for name, value in change.items() if value is None]).to_csv(csv(folder), index=False)
    refused("footprints", [], {NAME: said})
