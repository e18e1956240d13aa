"""Libraries in environments of their own: how experiments reach them, and what gaitmap and mobgap give back."""

import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
RATE_HZ = 100.0
LENGTH, STRIDES = 1.2, 4  # [m]
TILT = 1.2  # [rad]; with much less gaitmap takes the middle of the swing, where the pitch turns back, for standing
BIAS = (0.02, -0.015, 0.01)  # [rad/s]


@pytest.fixture
def peers(load_experiment):
    if os.name != "posix":
        pytest.skip("the environments are made by a shell script")
    return load_experiment("common.peers")


@pytest.fixture
def made_up(peers, tmp_path, monkeypatch):
    """A checkout whose peer `fake` is this Python; write its script to the folder that this gives."""
    monkeypatch.setattr(peers, "ROOT", tmp_path)
    environment, scripts = tmp_path / ".venv-fake", tmp_path / "experiments" / "common" / "peers"
    (environment / "bin").mkdir(parents=True)
    scripts.mkdir(parents=True)
    shutil.copy(ROOT / "experiments" / "common" / "peers" / "protocol.py", scripts)
    (environment / "bin" / "python").write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    (environment / "bin" / "python").chmod(0o755)
    (environment / "ready").write_text(f"{tmp_path}\n")
    return scripts


def write(folder, body):
    lines = ["from protocol import main", "def answer(numbers, factor=2):", f"    {body}", "main(answer)", ""]
    (folder / "fake_product.py").write_text("\n".join(lines))


# --- the way there and back ---


def test_every_job_is_answered_with_its_own_arrays(peers, made_up):
    write(made_up, "return {'product': numbers * factor, 'large': numbers > 1}")
    jobs = {"walk 1/right": {"numbers": np.arange(3)}, "left": {"numbers": np.array([[0.5]]), "factor": 10.0}}
    found = peers.run("fake_product", jobs)
    assert sorted(found) == ["left", "walk 1/right"]
    np.testing.assert_array_equal(found["walk 1/right"]["product"], [0, 2, 4])
    np.testing.assert_array_equal(found["walk 1/right"]["large"], [False, False, True])
    np.testing.assert_array_equal(found["left"]["product"], [[5.0]])


def test_an_error_in_a_peer_s_environment_is_reported(peers, made_up):
    write(made_up, "raise ValueError('no numbers of this kind')")
    with pytest.raises(RuntimeError, match="fake_product failed in .venv-fake:(.|\n)*no numbers of this kind"):
        peers.run("fake_product", {"a": {"numbers": np.zeros(1)}})


def test_a_peer_that_is_absent_or_half_made_is_named_with_what_makes_it(peers, made_up):
    assert peers.available("fake")
    assert not peers.available("other")
    (made_up.parents[2] / ".venv-fake" / "ready").unlink()
    assert not peers.available("fake")
    with pytest.raises(peers.PeerUnavailable, match="fake is absent: `make peers` installs it in .venv-fake"):
        peers.run("fake_product", {})


# --- making the environments ---


def test_every_peer_states_which_python_it_needs_and_is_pinned():
    files = sorted((ROOT / "experiments" / "common" / "peers").glob("*.txt"))
    assert files
    for file in files:
        first, *rest = file.read_text().splitlines()
        assert first.startswith("# Python 3.")
        pins = [line for line in rest if not line.startswith("#")]
        assert any(line.startswith(f"{file.stem}==") for line in pins)
        assert all(line.count("==") == 1 for line in pins)


# --- gaitmap ---


def walk():
    """A level sensor that strides along x, with its pitch, and rests in between: gyr, acc, strides, pitch."""
    swing, rest = int(0.6 * RATE_HZ), int(0.4 * RATE_HZ)
    phase = (np.arange(swing) + 1) / swing
    still = np.zeros(rest)

    def strides(profile):
        return np.concatenate([still, *[np.concatenate([profile, still])] * STRIDES])

    def turn(profile):
        return 2 * np.pi / swing * RATE_HZ * profile

    # Position LENGTH (s - sin(2πs)/2π), pitch TILT (1 - cos(2πs))/2: both begin and end at rest.
    forward = strides(LENGTH * (2 * np.pi) * np.sin(2 * np.pi * phase) * (RATE_HZ / swing) ** 2)
    pitch, rate = (
        strides(TILT * (1 - np.cos(2 * np.pi * phase)) / 2),
        strides(turn(TILT * np.sin(2 * np.pi * phase) / 2)),
    )
    zero = np.zeros_like(pitch)
    acc = [np.cos(pitch) * forward - np.sin(pitch) * 9.81, zero, np.sin(pitch) * forward + np.cos(pitch) * 9.81]
    middles = rest // 2 + (swing + rest) * np.arange(STRIDES + 1)
    return np.stack([zero, rate, zero], 1), np.stack(acc, 1), np.stack([middles[:-1], middles[1:]], 1), pitch


def test_gaitmap_finds_the_strides_of_a_made_walk(peers):
    if not peers.available("gaitmap"):
        pytest.skip(peers.unavailable_reason("gaitmap"))
    gyr, acc, strides, pitch = walk()
    clean = {"gyr": gyr, "acc": acc, "sampling_rate_hz": RATE_HZ, "strides": strides}
    biased = {**clean, "gyr": gyr + np.array(BIAS)}
    found = peers.run("gaitmap_rts", {"clean": clean, "removed": {**biased, "bias": BIAS}, "left in": biased})
    one = found["clean"]
    assert one["position"].shape == (len(gyr), 3) and one["orientation"].shape == (len(gyr), 4)
    assert one["seconds"].shape == (1,) and one["seconds"][0] > 0
    way = one["position"][strides[:, 1]] - one["position"][strides[:, 0]]
    # gaitmap takes a sample's rates for those of the interval before it: half a sample late, 1 % at 100 Hz.
    for found_way in (way, one["stride_displacement_gyro"], one["stride_displacement_madgwick"]):
        np.testing.assert_allclose(found_way, [[LENGTH, 0, 0]] * STRIDES, atol=0.03)
    # w first; pitch is about y.
    np.testing.assert_allclose(one["orientation"][:, 0], np.cos(pitch / 2), atol=0.02)
    np.testing.assert_allclose(one["orientation"][:, 2], np.sin(pitch / 2), atol=0.02)
    assert one["zupts"][strides[:, 0]].all() and not one["zupts"][strides[:, 0] + int(0.5 * RATE_HZ)].any()
    np.testing.assert_allclose(found["removed"]["position"], one["position"], atol=1e-6)
    assert np.abs(found["left in"]["position"] - one["position"]).max() > 0.02


# --- mobgap ---

STEP = 0.5  # [s]
HEIGHT = 0.95  # [m] of the sensor
RISE = 0.025  # [m] of the trunk with each step


def trunk_walk(seconds=12.0):
    """A trunk that rises and falls with each step, brakes with it, and turns to and fro with each stride."""
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    phase = 2 * np.pi * time / STEP
    vertical = 9.81 + RISE / 2 * (2 * np.pi / STEP) ** 2 * np.cos(phase)
    forward = -1.5 * np.sin(phase) - 0.7 * np.sin(2 * phase)
    zero = np.zeros_like(time)
    yaw = 0.5 * np.cos(phase / 2)  # most to the left, 0, at even contacts, to the right at odd ones
    return np.stack([vertical, zero, forward], 1), np.stack([yaw, zero, zero], 1)


@pytest.fixture(scope="module")
def mobgap_found(load_experiment):
    """What mobgap says of the walk, seen whole and in two bouts."""
    peers = load_experiment("common.peers")
    if not peers.available("mobgap"):
        pytest.skip(peers.unavailable_reason("mobgap"))
    acc, gyr = trunk_walk()
    job = {"acc": acc, "gyr": gyr, "sampling_rate_hz": RATE_HZ, "sensor_height": HEIGHT}
    contacts = np.arange(100, 1101, round(STEP * RATE_HZ))
    return peers.run(
        "mobgap_trunk",
        {
            "whole": {**job, "bouts": [[50, 1150]], "contacts": contacts},
            "two": {**job, "bouts": [[50, 450], [650, 1150]]},
        },
    )


def test_mobgap_finds_a_contact_for_every_step_of_a_made_walk(mobgap_found):
    found = mobgap_found["whole"]
    for detector in ("ionescu", "shin", "hklee"):
        contacts = found[f"{detector}_contacts"]
        assert 18 <= len(contacts) <= 22, detector
        np.testing.assert_allclose(np.diff(contacts)[1:-1], STEP * RATE_HZ, atol=3)
        assert found[f"{detector}_cadences"] == pytest.approx(1 / STEP, rel=0.03)
    assert not any(name.startswith("given") for name in mobgap_found["two"])
