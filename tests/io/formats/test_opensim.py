"""OpenSim's motions, written by this test as OpenSim writes them, of a walk whose angles are known."""

import numpy as np
import pytest
from made.notes import texts

from jgait import RecordingError, io

T = np.linspace(0.0, 2.0, 201)
HIP = {"r": 0.1 + 0.4 * np.sin(np.pi * T), "l": 0.1 - 0.4 * np.sin(np.pi * T)}
KNEE = {"r": 0.5 - 0.45 * np.cos(2.0 * np.pi * T), "l": 0.5 + 0.45 * np.cos(2.0 * np.pi * T)}
TILT = -0.08 + 0.02 * np.sin(4.0 * np.pi * T)
HEIGHT = 0.93 + 0.02 * np.cos(4.0 * np.pi * T)


def columns(sign=1, path=False):
    """Name → values [rad], [m]; hip_flexion counts from the pelvis."""
    found = {"pelvis_tilt": TILT, "pelvis_ty": HEIGHT, "ground_force_vy": 700.0 + 0.0 * T}
    for side in "rl":
        found |= {f"hip_flexion_{side}": HIP[side] - TILT, f"knee_angle_{side}": sign * KNEE[side]}
    if path:
        found = {f"/jointset/some/{name}/value": values for name, values in found.items()}
        found["/jointset/some/knee_angle_r/speed"] = np.full_like(T, 9.0)
    return found


def write(path, found, *, degrees="yes", header=("version=1", "nRows=201", "nColumns={n}"), rows=None, gap="\t"):
    lines = ["Coordinates", *header, *([f"inDegrees={degrees}"] if degrees else []), "", "Units are S.I. units", ""]
    lines = [line.format(n=1 + len(found)) for line in lines]
    lines += ["endheader", gap.join(["time", *found])]
    factor = dict.fromkeys(found, 180.0 / np.pi if degrees != "no" else 1.0)
    factor |= {name: 1.0 for name in found if "_ty" in name or "force" in name}
    values = np.stack([T, *(factor[name] * each for name, each in found.items())], axis=1)[:rows]
    lines += [gap.join(f"{cell:.12g}" for cell in row) for row in values]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("degrees", ["yes", "no"])
def test_angles_come_back_with_jgaits_signs(tmp_path, sign, degrees):
    motion = io.read_opensim(write(tmp_path / "walk.mot", columns(sign), degrees=degrees))
    np.testing.assert_allclose(motion.columns["knee_angle_r"], sign * KNEE["r"], atol=1e-10)
    np.testing.assert_allclose(motion.columns["pelvis_ty"], HEIGHT, atol=1e-10)
    assert (motion.columns["ground_force_vy"] == 700.0).all()
    assert set(motion.angles) == {
        "pelvis_tilt",
        *(f"{joint}_{s}" for joint in ("hip_flexion", "knee_angle") for s in "rl"),
    }
    estimate = io.opensim_reference(motion, thigh_length=0.42, shank_length=0.4)
    for leg, side in zip(estimate.legs, "rl", strict=True):
        np.testing.assert_allclose(leg.hip_angle, HIP[side], atol=1e-10)
        np.testing.assert_allclose(leg.knee_angle, KNEE[side], atol=1e-10)
        shank = HIP[side] - KNEE[side]
        np.testing.assert_allclose(leg.x, 0.42 * np.sin(HIP[side]) + 0.4 * np.sin(shank), atol=1e-10)
        np.testing.assert_allclose(leg.y, -0.42 * np.cos(HIP[side]) - 0.4 * np.cos(shank), atol=1e-10)
    word = "positive" if sign > 0 else "negative"
    assert estimate.diagnostics["source"] == f"OpenSim: walk; knee_angle is {word} in flexion, deduced from its range"
    np.testing.assert_allclose(estimate.time, T, atol=1e-10)
    assert estimate.valid.all()


def test_a_file_that_does_not_say_degrees_is_asked(tmp_path):
    header = ("name walk", "datacolumns {n}", "datarows 201")
    motion = io.read_opensim(write(tmp_path / "old.mot", columns(), degrees="", header=header))
    np.testing.assert_allclose(motion.columns["knee_angle_l"], KNEE["l"], atol=1e-10)
    assert any("degrees, for the largest angle of the legs is 54.43" in note for note in texts(motion.notes))
    still = {"hip_flexion_r": 0.001 * T, "knee_angle_r": 0.001 * T}
    path = write(tmp_path / "still.mot", still, degrees="")
    with pytest.raises(RecordingError, match="does not state inDegrees, and the largest angle .*give degrees"):
        io.read_opensim(path)
    np.testing.assert_allclose(io.read_opensim(path, degrees=True).columns["knee_angle_r"], 0.001 * T, atol=1e-10)


def test_a_sign_that_cannot_be_told_is_asked_for(tmp_path):
    bent = columns() | {"knee_angle_r": KNEE["r"] - 0.5, "knee_angle_l": KNEE["l"] - 0.5}
    motion = io.read_opensim(write(tmp_path / "both.mot", bent))
    with pytest.raises(RecordingError, match="knee_angle goes from -26 to 26°.*give knee_flexion"):
        io.opensim_reference(motion)
    leg = io.opensim_reference(motion, knee_flexion=-1).legs.right
    np.testing.assert_allclose(leg.knee_angle, 0.5 - KNEE["r"], atol=1e-10)
    with pytest.raises(ValueError, match="knee_flexion must be 1, -1 or None; got 2"):
        io.opensim_reference(motion, knee_flexion=2)
    with pytest.raises(ValueError, match="given together"):
        io.opensim_reference(motion, thigh_length=0.4)


def test_one_leg_lost_samples_and_a_pelvis_that_is_not_there(tmp_path):
    found = {name: values.copy() for name, values in columns().items() if name.endswith("_r")}
    found["knee_angle_r"][7] = np.nan
    motion = io.read_opensim(write(tmp_path / "one.mot", found))
    with pytest.raises(RecordingError, match="no pelvis_tilt, from which hip_flexion counts"):
        io.opensim_reference(motion)
    estimate = io.opensim_reference(motion, upright_pelvis=True)
    assert estimate.legs.left is None and list(np.flatnonzero(~estimate.valid)) == [7]
    np.testing.assert_allclose(estimate.legs.right.hip_angle, HIP["r"] - TILT, atol=1e-10)
    forces = io.read_opensim(write(tmp_path / "grf.mot", {"ground_force_vy": 700.0 + T}))
    with pytest.raises(
        RecordingError, match="grf has no leg: expected hip_flexion_r and knee_angle_r.*ground_force_vy"
    ):
        io.opensim_reference(forces)


def test_orientations_are_recognised_and_refused(tmp_path):
    said = tmp_path / "imu_orientations.sto"
    rows = "".join(f"{t:g}\t1.0,0.0,0.0,0.0\t0.7,0.7,0.0,0.0\n" for t in T[:20])
    said.write_text(f"DataRate=100\nDataType=Quaternion\nversion=3\nendheader\ntime\tpelvis_imu\tfemur_r_imu\n{rows}")
    silent = tmp_path / "silent.sto"
    silent.write_text(said.read_text().replace("DataType=Quaternion\n", ""))
    for path in (said, silent):
        with pytest.raises(RecordingError, match="holds orientations of sensors .*OpenSense's inverse kinematics"):
            io.read_opensim(path)
    other = tmp_path / "vectors.sto"
    other.write_text(said.read_text().replace("Quaternion", "Vec3"))
    with pytest.raises(RecordingError, match="vectors.sto holds cells of type vec3, expected one number a cell"):
        io.read_opensim(other)
