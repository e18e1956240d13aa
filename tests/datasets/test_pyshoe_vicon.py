"""The shoe under Vicon: parsing by files written here, axes, turns and stances by the real ones."""

import numpy as np
import pytest
from made.notes import texts
from made.sets import loaded
from scipy.io import savemat

from jgait.datasets import pyshoe_vicon

SAMPLES, RATE = 2000, 200.0
TIME = np.arange(SAMPLES) / RATE
NAME = "2030-01-01-00-00-00"
STRIDES, LENGTH = 5, 1.2


def foot(time=TIME):
    """Five strides along −y from 1.5 s on, half of each second a swing that rises; standing trembles by 0.1 mm."""
    phase = np.clip(time - 1.0, 0.0, STRIDES)
    swing = np.clip(2 * (phase % 1.0) - 1, 0, 1)
    trembling = 1e-4 * np.sin(50 * time)
    return np.stack([trembling, -LENGTH * (phase // 1 + swing), 0.12 + 0.1 * np.sin(np.pi * swing)], axis=1)


@pytest.fixture
def folder(data_dir):
    folder = data_dir / "pyshoe_vicon" / "data" / "vicon" / "processed"
    folder.mkdir(parents=True)
    return folder


def write(folder, name=NAME, **changes):
    imu = np.tile([1.0, 2.0, -9.5, 0.1, 0.2, 0.3], (SAMPLES, 1))
    flags = {f"zv_{one}_opt": np.full(SAMPLES, k % 2) for k, one in enumerate(pyshoe_vicon.DETECTORS)}
    variables = {"ts": 7.0 + TIME, "imu": imu, "gt": foot(), **flags} | changes
    savemat(folder / f"{name}.mat", {key: value for key, value in variables.items() if value is not None})


def test_axes_stances_and_distance(folder):
    write(folder)
    (walk,) = loaded("pyshoe_vicon")
    assert walk.recording.name == NAME and walk.info["verified"] is False
    imu = walk.recording.sensors["foot_right"]
    np.testing.assert_allclose(imu.acc[5], [1, -2, 9.5])
    np.testing.assert_allclose(imu.gyr[5], [0.1, -0.2, -0.3])
    np.testing.assert_allclose(imu.time, TIME, atol=1e-9)
    right = walk.reference.feet.right
    np.testing.assert_allclose(right.position, foot() * [1, -1, 1])
    assert right.velocity is None and right.orientation is None and walk.reference.feet.left is None
    assert walk.reference.valid.all()
    prints = walk.info["footprints"]
    assert len(prints["samples"]) == STRIDES + 1
    np.testing.assert_allclose(prints["position"][:, 1], LENGTH * np.arange(STRIDES + 1), atol=1e-9)
    np.testing.assert_allclose(prints["time"][1:-1], np.arange(1, STRIDES) + 1.25, atol=0.03)
    assert np.all(prints["start"] <= prints["samples"]) and np.all(prints["samples"] < prints["end"])
    middle = prints["samples"][1]
    strides = walk.reference.strides
    np.testing.assert_allclose(strides.length, LENGTH, atol=2e-3)
    assert strides.valid.all() and strides.valid.size == STRIDES and strides.start is None
    middles = walk.info["footprints"]["time"]
    assert (strides.standing >= middles[:-1]).all() and (strides.standing_end <= middles[1:]).all()
    assert (strides.standing_end - strides.standing < 1.2).all()  # however long the foot stood before
    assert walk.reference.distance[0] == 0 and walk.reference.distance[-1] == pytest.approx(STRIDES * LENGTH, abs=1e-3)
    assert walk.reference.distance[middle] == walk.reference.distance[middle + 10] == pytest.approx(LENGTH, abs=1e-3)
    assert [of.all() for of in walk.info["zero_velocity"].values()] == [False, True, False, True, False]
    assert walk.info["speed"] == pytest.approx(STRIDES * LENGTH / 4.5, rel=0.03)


def test_what_vicon_lost_is_masked(folder):
    position = foot()
    position[700] += [0, 0.2, 0]  # in a stance: there and back
    position[910:930] = position[910]  # held, then far away
    position[100] = position[101]  # one value twice is no loss
    position[1990, 1] = np.nan
    write(folder, gt=position)
    (walk,) = loaded("pyshoe_vicon")
    lost = [699, 700, 701, *range(910, 931), 1990]
    assert np.flatnonzero(~walk.reference.valid).tolist() == lost
    assert np.isfinite(walk.reference.feet.right.position).all()
    assert f"samples of Vicon masked: {len(lost)}" in texts(walk.recording.notes)
    np.testing.assert_allclose(walk.info["footprints"]["position"][:, 1], LENGTH * np.arange(STRIDES + 1), atol=1e-9)
    assert walk.reference.valid[walk.info["footprints"]["samples"]].all()


def test_footprints_are_where_the_publisher_finds_no_velocity_and_below_the_swings(data):
    """All but one of a trial, at most, hold a sample that the publisher's Vicon detector calls still."""
    for name in ("2017-11-22-11-22-03", "2017-11-27-11-13-10"):
        walk = data("pyshoe_vicon", name)[0]
        prints, still = walk.info["footprints"], walk.info["zero_velocity"]["vicon"]
        found = [still[start:end].any() for start, end in zip(prints["start"], prints["end"], strict=True)]
        assert sum(found) >= len(found) - 1
        height = walk.reference.feet.right.position[walk.reference.valid, 2]
        assert np.ptp(prints["position"][:, 2]) < 0.065 and height.max() > prints["position"][:, 2].max() + 0.08
