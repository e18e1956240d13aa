"""Strides of a foot sensor: exact motions, drift, false stances; and Vicon."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jgait.datasets import foot_reference
from jgait.datasets.foot_reference import foot_path
from jgait.types import Imu

RATE = 100.0
GRAVITY = 9.81
TRAPEZOID = 3e-3  # relative error of the trapezoid rule on half-second swings at 100 Hz


def foot(strides, mount=None, swing=0.6, stance=0.5, lift=0.1, pitch=0.8, delay=0.0):
    """A foot that takes strides of given lengths [m] along y, its sensor turned by `mount`; exact by derivatives.

    In a swing, τ from 0 to 1, it moves by L (10τ³-15τ⁴+6τ⁵), is lifted by 64 lift τ³(1-τ)³, and pitches by
    pitch sin(2πτ) sin²(πτ), all at rest at both ends. A stride of length 0 is standing.
    """
    mount = Rotation.identity() if mount is None else mount
    period = stance + swing
    time = np.arange(int((len(strides) * period + 2 * stance) * RATE) + 1) / RATE
    acc, angle, turn = np.zeros((len(time), 3)), np.zeros(len(time)), np.zeros(len(time))
    for number, length in enumerate(strides):
        tau = (time - number * period - stance - delay) / swing
        inside = (tau >= 0) & (tau <= 1) & (length > 0)
        t = tau[inside]
        acc[inside, 1] = length * (60 * t - 180 * t**2 + 120 * t**3) / swing**2
        acc[inside, 2] = lift * 64 * (6 * t - 36 * t**2 + 60 * t**3 - 30 * t**4) / swing**2
        angle[inside] = pitch * np.sin(2 * np.pi * t) * np.sin(np.pi * t) ** 2
        growth = 2 * np.pi * np.cos(2 * np.pi * t) * np.sin(np.pi * t) ** 2 + np.pi * np.sin(2 * np.pi * t) ** 2
        turn[inside] = pitch * growth / swing
    attitude = Rotation.from_rotvec(angle[:, None] * [1.0, 0.0, 0.0]) * mount
    force = attitude.inv().apply(acc + [0.0, 0.0, GRAVITY])
    gyr = attitude.inv().apply(turn[:, None] * [1.0, 0.0, 0.0])
    return Imu(time, gyr, force, np.ones(len(time), bool))


@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_lengths_do_not_depend_on_how_the_sensor_is_mounted(seed):
    mount = None if seed is None else Rotation.random(rng=np.random.default_rng(seed))
    lengths = [0.6, 1.2, 1.3, 0.7]
    path = foot_path(foot(lengths, mount), RATE)
    np.testing.assert_allclose(path.length, lengths, rtol=TRAPEZOID)
    np.testing.assert_allclose(path.rise, 0.0, atol=2e-3)
    assert path.distance[-1] == pytest.approx(sum(lengths), rel=TRAPEZOID)
    assert path.distance[0] == 0.0
    standing = path.distance[125:145]  # the middle of the second stance, 1.1 to 1.6 s
    assert np.ptp(standing) < 1e-3


def test_bias_and_slow_drift_are_removed():
    imu = foot([1.2, 1.3, 1.2])
    drift = np.linspace(0.0, 0.01, len(imu.time))[:, None] * [1.0, -1.0, 0.5]
    spoilt = imu._replace(gyr=imu.gyr + [0.05, -0.08, 0.1] + drift, acc=imu.acc * 1.02)
    np.testing.assert_allclose(foot_path(spoilt, RATE).length, [1.2, 1.3, 1.2], rtol=0.03)


def test_a_quiet_moment_in_a_slow_swing_is_no_stance():
    """The foot stops for 0.2 s half way through its swing, pitched by 0.4 rad: neither stance nor end of the stride."""
    whole = foot([1.2], swing=0.8, pitch=0.0, lift=0.0)
    time = whole.time
    swing = (time >= 0.5) & (time <= 1.3)
    tau = np.clip((time - 0.5) / 0.8, 0, 1)
    angle = np.where(swing, 0.4 * np.clip(np.minimum(tau, 1 - tau) / 0.35, 0, 1), 0.0)
    attitude = Rotation.from_rotvec(angle[:, None] * [1.0, 0.0, 0.0])
    rate = np.gradient(angle, time)
    calm = np.abs(tau - 0.5) < 0.15
    force = attitude.inv().apply(whole.acc)
    imu = Imu(time, rate[:, None] * [1.0, 0.0, 0.0], force, whole.mask)
    assert np.linalg.norm(imu.gyr[calm], axis=1).max() < 1.0
    assert len(foot_reference.stances(imu, RATE)) == 3, "the quiet moment looks like a stance"
    path = foot_path(imu, RATE)
    assert len(path.length) == 1
    assert path.length[0] == pytest.approx(1.2, abs=0.03)


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda imu: imu._replace(acc=None), "the foot has no accelerometer"),
        (lambda imu: imu._replace(gyr=imu.gyr + 5.0), "the foot stands 0 times; a stride needs two stances"),
        (lambda imu: imu._replace(gyr=imu.gyr * 0, acc=imu.acc * 0 + 5), "the foot stands 1 times"),
    ],
)
def test_a_walk_without_strides_is_reported_with_the_reason(change, message):
    with pytest.raises(ValueError, match=message):
        foot_path(change(foot([1.0])), RATE)


def test_steps_on_the_spot_after_a_walk_are_left_out():
    """Both feet walk 3 m, stand for 1 s, and turn on the spot with two short steps each."""
    right = foot([0.6, 1.2, 1.2, 0.0, 0.2, 0.2], stance=0.6, swing=0.5)
    left = foot([1.2, 1.2, 0.6, 0.0, 0.2, 0.2], stance=0.6, swing=0.5, delay=0.55)
    feet = {"right": foot_path(right, RATE), "left": foot_path(left, RATE)}
    assert [len(path.length) for path in feet.values()] == [5, 5]
    kept = foot_reference.walking_strides(feet, RATE)
    np.testing.assert_allclose(kept["right"].length, [0.6, 1.2, 1.2], rtol=TRAPEZOID)
    assert kept["right"].distance[-1] == pytest.approx(3.0, rel=TRAPEZOID)
    assert kept["left"].distance[-1] == pytest.approx(3.0, rel=TRAPEZOID)


def test_strides_agree_with_vicon(data):
    """Against the middle of heel and toe markers at the same instants; strides in the U-turn pivot and are left out."""
    walk = data("neura_sparse")[0]
    errors, travelled, measured = [], 0.0, 0.0
    for side in ("right", "left"):
        path = foot_path(walk.recording.sensors[f"foot_{side}"], RATE)
        centres = walk.info["joint_centres"][side]
        middle = (centres["heel"] + centres["toe"])[:, :2] / 2
        vicon = np.linalg.norm(middle[path.end] - middle[path.start], axis=1)
        heading = walk.info["heading"]
        straight = np.abs(heading[path.end] - heading[path.start]) < np.deg2rad(30)
        errors += list((path.length - vicon)[straight])
        travelled += path.length.sum()
        measured += vicon.sum()
    assert len(errors) >= 8
    assert np.abs(errors).mean() < 0.015
    assert travelled == pytest.approx(measured, rel=0.02)
