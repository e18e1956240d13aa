"""The Xsens and Vicon trial: parsing by fixtures written here, alignment and geometry by the real files."""

import numpy as np
import pandas as pd
import pytest
from made.notes import texts
from made.sets import loaded
from scipy.io import savemat

from jgait import datasets
from jgait.datasets import neura_sparse
from jgait.types import leg_of

RATE = 100.0


@pytest.fixture(scope="module")
def walk(data):
    return data("neura_sparse")[0]


# --- a trial written here: straight along -x, both legs swinging ---

NAME = "S09-Trial-Fast-2"
FRAMES = 1200
THIGH, SHANK = 0.4, 0.38


def angles(frame):
    """Hip and knee [rad] of the right leg at a frame; standing until 400 and from 900."""
    time = np.clip(frame - 400, 0, 500) / RATE
    return 0.4 * np.sin(2 * np.pi * time), 0.3 * (1 - np.cos(2 * np.pi * time))


def markers():
    frame = np.arange(FRAMES)
    forward = np.clip(frame - 400, 0, 500) / RATE * 1.1
    pelvis = np.stack([-forward, np.full(FRAMES, 0.3), np.full(FRAMES, 0.9)], axis=1)
    hip_angle, knee_angle = angles(frame)
    content = {}
    for side, sign in (("R", 1.0), ("L", -1.0)):
        # Facing -x, the right is +y.
        lateral = np.array([0.0, 0.12 * sign, 0.0])
        content[f"{side}ASI"] = pelvis + lateral + [-0.1, 0, 0]
        content[f"{side}PSI"] = pelvis + lateral / 2 + [0.1, 0, 0]
        hip, shank_angle = sign * hip_angle, sign * hip_angle - knee_angle
        content[f"{side}HJC"] = pelvis + lateral
        zero = np.zeros(FRAMES)
        content[f"{side}KJC"] = content[f"{side}HJC"] + THIGH * np.stack([-np.sin(hip), zero, -np.cos(hip)], axis=1)
        content[f"{side}AJC"] = content[f"{side}KJC"] + SHANK * np.stack(
            [-np.sin(shank_angle), zero, -np.cos(shank_angle)], axis=1
        )
    return {key: values * 1000 for key, values in content.items()}


def write_sensor(folder, serial, drop=(), first=65000):
    """A sensor whose gyroscope's x counts IMU samples, so that alignment can be read off it."""
    frame = np.arange(FRAMES)
    table = pd.DataFrame({"PacketCounter": (first + frame) % 65536, "SampleTimeFine": np.nan})
    for name, values in (("Acc_X", 9.81 + 0 * frame), ("Acc_Y", 0 * frame), ("Acc_Z", 0 * frame)):
        table[name] = values
    moving = (frame >= 402) & (frame < 902)
    table["Gyr_X"] = np.where(moving, frame / 100.0, 0.0)
    table["Gyr_Y"] = 0.01
    table["Gyr_Z"] = 0.0
    path = folder / f"{NAME}-000_{serial}.txt"
    with path.open("w", newline="") as stream:
        stream.write("// Start Time: Unknown\n// Update Rate: 100.0Hz\n")
        table.drop(index=list(drop)).to_csv(stream, index=False)
    return path


@pytest.fixture
def written(data_dir):
    sample = data_dir / "neura_sparse" / "data" / "sample"
    for folder in ("rawimu", "vicon", "rawstep-detect"):
        (sample / folder).mkdir(parents=True)
    (sample / "data-list.csv").write_text(
        "subj,act,startFrame,endFrame\nS09,Trial-Fast-2,401,900\nS09,Trial-Gone,1,2\n"
    )
    write_sensor(sample / "rawimu", "00B40C3C", drop=(500, 501, 700))
    write_sensor(sample / "rawimu", "00B40C35")
    write_sensor(sample / "rawimu", "00B40B91")
    savemat(sample / "vicon" / f"{NAME}.mat", markers())
    contact = pd.DataFrame({"stepL": 1, "stepR": 1}, index=range(FRAMES))
    contact.loc[450:549, "stepR"] = 0
    contact.to_csv(sample / "rawstep-detect" / f"{NAME}-revStepDetect.csv", index=False)
    return sample


def test_a_trial_that_this_version_does_not_know(written):
    with pytest.raises(ValueError, match=f"neura_sparse has no recording 'S1'; there are {NAME}"):
        loaded("neura_sparse", "S1")
    with pytest.raises(TypeError, match=r"only must be a list of names of recordings, such as \['S1'\]; got a text"):
        datasets.load("neura_sparse", "S1")
    assert datasets.names("neura_sparse") == (NAME,)
    (walk,) = loaded("neura_sparse")
    assert walk.info["verified"] is False
    assert walk.recording.name == NAME and walk.recording.subject == "S09"
    assert list(walk.recording.sensors) == ["pelvis", "thigh_right", "shank_right"]
    assert any("no file for thigh_left, shank_left" in note for note in texts(walk.recording.notes))


def test_the_lag_is_taken_off_and_lost_packets_are_masked(written):
    recording = datasets.load("neura_sparse")[0].recording
    thigh, shank = recording.sensors["thigh_right"], recording.sensors["shank_right"]
    assert len(thigh.time) == len(shank.time) == FRAMES - 2
    np.testing.assert_allclose(shank.gyr[400:900, 0], np.arange(402, 902) / 100.0)
    np.testing.assert_allclose(shank.acc, np.tile([9.81, 0, 0], (FRAMES - 2, 1)))
    assert np.flatnonzero(~thigh.mask).tolist() == [498, 499, 698]
    np.testing.assert_array_equal(thigh.gyr[~thigh.mask], 0.0)
    np.testing.assert_array_equal(thigh.gyr[thigh.mask], shank.gyr[thigh.mask])
    assert shank.mask.all()
    assert "thigh_right: samples masked: 3 of 1198" in texts(recording.notes)


def test_angles_position_distance_and_windows(written):
    walk = datasets.load("neura_sparse")[0]
    hip, knee = angles(np.arange(FRAMES - 2))
    right, left = walk.reference.legs
    np.testing.assert_allclose(right.hip_angle, hip, atol=1e-9)
    np.testing.assert_allclose(right.knee_angle, knee, atol=1e-9)
    np.testing.assert_allclose(left.hip_angle, -hip, atol=1e-9)
    np.testing.assert_allclose(right.x, THIGH * np.sin(hip) + SHANK * np.sin(hip - knee), atol=1e-9)
    np.testing.assert_allclose(right.y, -THIGH * np.cos(hip) - SHANK * np.cos(hip - knee), atol=1e-9)
    np.testing.assert_allclose(walk.info["lengths"]["right"], (THIGH, SHANK), atol=1e-9)
    np.testing.assert_allclose(walk.info["heading"], np.pi, atol=1e-9)
    assert walk.reference.distance[-1] == pytest.approx(5.5, abs=1e-6)
    windows = walk.info["windows"]
    assert windows["whole"] == (400, 900)
    assert windows["straight_1"] == (400, 900)
    assert windows["standing"][0] == 0 and 330 <= windows["standing"][1] <= 400
    assert 900 <= windows["end_standing"][0] <= 970 and windows["end_standing"][1] == FRAMES - 2
    contact = walk.info["contact"]["right"]
    assert np.flatnonzero(~contact).tolist() == list(range(450, 550))


# --- the real trial ---


def test_what_a_walk_holds(walk):
    assert walk.info["verified"] is True
    assert list(walk.recording.sensors) == list(neura_sparse.SERIALS)
    assert walk.recording.subject == "S02" and walk.info["windows"]["whole"] == (1119, 2074)
    for imu in walk.recording.sensors.values():
        assert imu.mask.all() and len(imu.time) == len(walk.reference.time) == 2501
        assert np.linalg.norm(imu.acc[200:1000].mean(axis=0)) == pytest.approx(9.81, rel=0.015)
    for side, lengths in (("right", (0.395, 0.409)), ("left", (0.416, 0.391))):
        np.testing.assert_allclose(walk.info["lengths"][side], lengths, atol=0.0015)


@pytest.mark.parametrize(
    "side, axis", [("right", [0.018, 0.983, 0.182]), ("left", [0.0, 0.872, -0.489])], ids=["right", "left"]
)
def test_the_shank_gyroscope_is_the_shank_angles_rate_and_not_a_sample_off(walk, side, axis):
    start, end = walk.info["windows"]["whole"]
    leg = leg_of(walk.reference.legs, side)
    rate = np.gradient(leg.hip_angle - leg.knee_angle) * RATE
    gyr = walk.recording.sensors[f"shank_{side}"].gyr @ np.array(axis)
    agreement = {lag: np.corrcoef(gyr[start + lag : end + lag], rate[start:end])[0, 1] for lag in range(-3, 4)}
    assert agreement[0] > 0.99
    assert max(agreement, key=lambda lag: agreement[lag]) == 0


def test_distance_is_the_path_of_the_pelvis(walk):
    distance, windows = walk.reference.distance, walk.info["windows"]
    gained = {name: distance[end - 1] - distance[start] for name, (start, end) in windows.items()}
    for name in ("straight_1", "straight_2"):
        start, end = windows[name]
        hips = sum(walk.info["joint_centres"][side]["hip"][:, :2] for side in ("right", "left")) / 2
        assert gained[name] == pytest.approx(np.linalg.norm(hips[end - 1] - hips[start]), rel=0.012)
    strides = [walk.info["ankle_strides"][side][:, 2].sum() for side in ("right", "left")]
    assert gained["whole"] == pytest.approx(np.mean(strides), rel=0.01)
