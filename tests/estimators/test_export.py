"""The step of an estimator online as a program: equal to jgait's, and run by a process that has no jgait."""

import json
import pickle
import re
import subprocess
import sys

import jax
import numpy as np
import pytest

import jgait
from jgait import simulate
from jgait.simulate.sensors import OPAL

RUN = """
import pickle, runpy, sys
sys.modules["jgait"] = None  # to import it is an error
example, samples, out = sys.argv = sys.argv[1:]
made = runpy.run_path(example)
pickle.dump(made["jax"].device_get(made["results"]), open(out, "wb"))
"""


@pytest.fixture(scope="module")
def walked():
    placements = ("foot_right", "foot_left", "ankle_right", "thigh_right", "shank_right")
    ((recording, _),) = simulate.cohort(
        jax.random.key(11), 1, simulate.straight(5.0), OPAL, 100.0, placements, recorded=False
    )
    return recording


def samples_of(recording, placements):
    sensors = [recording.sensors[name] for name in placements]
    time = np.asarray(sensors[0].time)
    there = np.ones((len(time), len(sensors)), bool)
    there[120:125, 0] = False  # a loss
    return {
        "dt": np.diff(time, prepend=time[0]), "gyr": np.stack([imu.gyr for imu in sensors], axis=1) * there[:, :, None],
        "acc": np.stack([imu.acc for imu in sensors], axis=1) * there[:, :, None], "gyr_measured": there,
        "acc_measured": there,
    }  # fmt: skip


def rows_of(samples):
    n = len(samples["dt"])
    each = (samples["gyr"], samples["acc"], samples["gyr_measured"][..., None], samples["acc_measured"][..., None])
    return np.concatenate([samples["dt"][:, None], np.concatenate(each, axis=2).reshape(n, -1)], axis=1)


def assert_same(mine, theirs):
    """A record, and the dictionary of its fields that are not None."""
    parts = mine._asdict() if hasattr(mine, "_asdict") else mine
    if not isinstance(parts, dict):
        np.testing.assert_allclose(theirs, parts, rtol=1e-12, atol=1e-12)
        return
    assert {name for name, part in parts.items() if part is not None} == theirs.keys()
    for name, part in theirs.items():
        assert_same(parts[name], part)


RARE = [pytest.param(name, marks=pytest.mark.release) for name in ("duty_cycled_gyro", "ankle_stride")]


@pytest.mark.parametrize("estimator", ["leg_ekf", "foot_ins", *RARE])
def test_the_example_gives_the_numbers_of_jgait_in_a_process_without_jgait(walked, tmp_path, estimator):
    live = jgait.online(walked, {"height": 1.75}, estimator)
    (source, step), *_ = live.export().items()
    samples, out = tmp_path / "samples.npz", tmp_path / "results"
    made = samples_of(walked, step.device.placements)
    np.savez(samples, **made)
    files = step.save(tmp_path)
    command = [sys.executable, "-c", RUN, tmp_path / f"{source}_example.py", samples, out]
    subprocess.run(command, check=True, capture_output=True, cwd=tmp_path)
    theirs = jax.tree.map(lambda *v: np.stack(v), *pickle.loads(out.read_bytes()))
    ours = live._runs[0].runner.push(rows_of(made))
    if "stride" in theirs:  # the rest has a meaning only where a stride has become known
        known = ours.stride
        assert known.sum() > 3
        for name in ("stride", "stands", "instant"):
            np.testing.assert_array_equal(theirs[name], getattr(ours, name))
        ours, theirs = (jax.tree.map(lambda leaf: leaf[known], tree) for tree in (ours, theirs))
    assert_same(ours, theirs)
    assert live.state_bytes == step.state_bytes
    about = json.loads((tmp_path / f"{source}.json").read_text())
    assert about["state_bytes"] == step.state_bytes < 1e4
    assert about["sample"]["gyr"] == ["float64", [len(about["sensors"]), 3]]
    assert 1e4 < about["operations_a_sample"] == step.operations < 1e6
    text = (tmp_path / f"{source}_step.mlir").read_text()
    assert not re.search(r"custom_call @(?!Sharding)", text)  # nothing but standard operations
    assert {file.name for file in files} == {path.name for path in tmp_path.glob(f"{source}*")}


def test_single_precision_halves_the_state(walked):
    double = jgait.online(walked, None, "leg_ekf").export()["legs"]
    with jax.enable_x64(False):
        single = jgait.online(walked, None, "leg_ekf").export()["legs"]
    assert 0.45 < single.state_bytes / double.state_bytes < 0.55
    assert {leaf.dtype for leaf in single.constants} <= {np.dtype("float32"), np.dtype("int32")}
    assert "f64" not in single.files()["legs_step.mlir"]
    assert 'jax_enable_x64", False' in single.files()["legs_example.py"]
