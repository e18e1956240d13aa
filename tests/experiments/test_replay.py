"""Replayed motion capture: analytic motions come back, gaps are masked, and a real walk feels like its sensors."""

import numpy as np
import pytest

from experiments.common import replay
from experiments.common.replay import JointCentres, LegCentres
from jgait.geometry.vectors import GRAVITY
from jgait.types import SIDES

THIGH, SHANK = 0.42, 0.40
W = 2.0 * np.pi * 0.9  # strides per second
TIME = np.arange(601) / 100.0


# --- a walk in closed form, turning: every angle and place is a sum of sines ---


def facing(t):
    return 0.7 + 0.5 * np.sin(0.8 * t)


def angles(t, side):
    """Thigh, shank and foot from standing [rad], the lower end forward positive."""
    s = 1.0 if side == "right" else -1.0
    thigh = 0.1 + 0.4 * s * np.sin(W * t)
    shank = thigh - 0.5 - 0.3 * s * np.cos(W * t)
    return thigh, shank, 0.2 * s * np.cos(W * t + 0.3)


def angle_rates(t, side):
    s = 1.0 if side == "right" else -1.0
    thigh = 0.4 * s * W * np.cos(W * t)
    return thigh, thigh + 0.3 * s * W * np.sin(W * t), -0.2 * s * W * np.sin(W * t + 0.3)


def axes(t, angle):
    """(3, T, 3): a segment's x, y, z in the world, tilted in the sagittal plane, then turned with the body."""
    s, c, zero, one = np.sin(angle), np.cos(angle), np.zeros_like(t), np.ones_like(t)
    x, y, z = ([c, zero, s], [zero, one, zero], [-s, zero, c])
    sp, cp = np.sin(facing(t)), np.cos(facing(t))
    return np.stack([np.stack([cp * a - sp * b, sp * a + cp * b, c], axis=1) for a, b, c in (x, y, z)])


def inside(t, angle, x, y, z):
    return np.einsum("atk,a->tk", axes(t, angle), [x, y, z])


def places(t):
    """Name → (T, 3): joints, and `sensor_…` at the default places."""
    root = np.stack([1.1 * t + 0.02 * np.sin(2 * W * t), 0.03 * np.sin(W * t), 0.9 + 0.02 * np.cos(2 * W * t)], axis=1)
    out = {"sensor_pelvis": root + inside(t, 0.0 * t, -0.1, 0.0, 0.0)}
    for side, sign in (("right", -1.0), ("left", 1.0)):
        thigh, shank, foot = angles(t, side)
        hip = root + inside(t, 0.0 * t, 0.0, 0.09 * sign, 0.0)
        knee = hip + inside(t, thigh, 0.0, 0.0, -THIGH)
        ankle = knee + inside(t, shank, 0.0, 0.0, -SHANK)
        out |= {f"hip_{side}": hip, f"knee_{side}": knee, f"ankle_{side}": ankle}
        out[f"heel_{side}"] = ankle + inside(t, foot, -0.05, 0.0, -0.06)
        out[f"toe_{side}"] = ankle + inside(t, foot, 0.15, 0.0, -0.06)
        out[f"sensor_thigh_{side}"] = hip + inside(t, thigh, 0.0, 0.0, -0.5 * THIGH)
        out[f"sensor_shank_{side}"] = knee + inside(t, shank, 0.0, 0.0, -0.5 * SHANK)
        out[f"sensor_ankle_{side}"] = knee + inside(t, shank, 0.0, 0.0, -0.9 * SHANK)
        out[f"sensor_foot_{side}"] = ankle + inside(t, foot, 0.05, 0.0, -0.01)
    return out


def centres(t, change=lambda name, values: values):
    at = places(t)
    legs = {
        side: LegCentres(*(change(f"{j}_{side}", at[f"{j}_{side}"].copy()) for j in LegCentres._fields))
        for side in SIDES
    }
    return JointCentres(t, **legs)


def tilt(placement, t, function=angles):
    part, _, side = placement.partition("_")
    if part == "pelvis":
        return 0.0 * t
    return function(t, side)[{"thigh": 0, "shank": 1, "ankle": 1, "foot": 2}[part]]


def felt(placement, t):
    """Exact angular rate; specific force by a difference formula of fourth order of the place in closed form."""
    angle, h = tilt(placement, t), 2e-3
    turn = 0.4 * np.cos(0.8 * t)
    gyr = np.stack([turn * np.sin(angle), -tilt(placement, t, angle_rates), turn * np.cos(angle)], axis=1)
    p = [places(t + k * h)[f"sensor_{placement}"] for k in range(-2, 3)]
    force = (-p[0] + 16 * p[1] - 30 * p[2] + 16 * p[3] - p[4]) / (12 * h * h) + [0.0, 0.0, GRAVITY]
    return gyr, np.einsum("atk,tk->ta", axes(t, angle), force)


def worst(recording, end=6.0):
    """Largest difference from the exact signals away from the ends: rad/s, m/s²."""
    gyr, acc = 0.0, 0.0
    for placement, imu in recording.sensors.items():
        true = felt(placement, imu.time)
        keep = (imu.time > 0.6) & (imu.time < end - 0.6) & imu.mask
        gyr = max(gyr, np.abs(imu.gyr - true[0])[keep].max())
        acc = max(acc, np.abs(imu.acc - true[1])[keep].max())
    return gyr, acc


@pytest.fixture(scope="module")
def walked():
    return replay.replay(centres(TIME), 100.0)


# --- the signals are the exact ones ---


def test_signals_are_those_of_the_motion_in_closed_form(walked):
    recording, _ = walked
    assert set(recording.sensors) == {
        "pelvis",
        *(f"{p}_{s}" for p in ("thigh", "shank", "ankle", "foot") for s in SIDES),
    }
    gyr, acc = worst(recording)
    # A cut-off of 10 Hz takes (1.8 / 10)⁶ = 3e-5 of the fastest sine in the motion.
    assert gyr < 1e-4
    assert acc < 1e-3


# --- gaps ---


def test_a_short_gap_is_bridged_and_a_long_one_masked(walked):
    def hidden(name, values):
        if name == "knee_right":
            values[100:108] = np.nan
        if name == "knee_left":
            values[300:360] = np.nan
        if name == "hip_left":
            values[-30:, 2] = np.nan
        return values

    recording, truth = replay.replay(centres(TIME, hidden), 100.0)
    sensors = recording.sensors
    lost = np.zeros(601, bool)
    lost[-30:] = True
    for placement in ("pelvis", "thigh_right"):  # all that hangs on the line of the hips
        np.testing.assert_array_equal(sensors[placement].mask, ~lost)
    np.testing.assert_array_equal(sensors["shank_right"].mask, True)
    np.testing.assert_array_equal(sensors["foot_left"].mask, True)
    lost[300:360] = True
    np.testing.assert_array_equal(sensors["thigh_left"].mask, ~lost)
    np.testing.assert_array_equal(truth.valid, ~lost)
    assert not sensors["thigh_left"].acc[~sensors["thigh_left"].mask].any()
    for placement, imu in sensors.items():
        assert np.isfinite(imu.gyr).all() and np.isfinite(imu.acc).all()
        away = imu.mask.copy()  # of the gaps' edges, where the spline knows one side only
        away[250:410] = away[:60] = away[-90:] = False
        np.testing.assert_allclose(imu.gyr[away], walked[0].sensors[placement].gyr[away], atol=0.02)
        np.testing.assert_allclose(imu.acc[away], walked[0].sensors[placement].acc[away], atol=0.5)


# --- a real walk ---


@pytest.fixture(scope="module")
def real(data):
    walk = data("neura_sparse")[0]
    return walk, *replay.replay(replay.from_walk(walk), 100.0)


def pairs(real, placement, window="straight"):
    """Replayed and worn gyroscope and accelerometer on the straight parts."""
    walk, recording, _ = real
    keep = np.zeros(len(recording.sensors[placement].time), bool)
    for name, (start, end) in walk.info["windows"].items():
        if name.startswith(window):
            keep[start:end] = True
    worn, ideal = walk.recording.sensors[placement], recording.sensors[placement]
    keep &= worn.mask & ideal.mask
    return ideal.gyr[keep], worn.gyr[keep], ideal.acc[keep], worn.acc[keep]


@pytest.mark.release
@pytest.mark.parametrize(
    "part, least", [("thigh", 0.93), ("shank", 0.99), ("ankle", 0.99), ("foot", 0.98)]
)  # measured: 0.941, 0.994, 0.995, 0.990
def test_sagittal_rates_are_those_of_the_worn_gyroscopes(real, part, least):
    for side in SIDES:
        ideal, worn, _, _ = pairs(real, f"{part}_{side}")
        # How the sensor was put on is unknown: the direction in it that is the leg's axis is fitted.
        axis, *_ = np.linalg.lstsq(worn, ideal[:, 1], rcond=None)
        assert np.corrcoef(ideal[:, 1], worn @ axis)[0, 1] > least
        assert np.linalg.norm(axis) == pytest.approx(1.0, abs=0.12)
