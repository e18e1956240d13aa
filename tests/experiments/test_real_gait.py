"""Figures of gait: those of a leg made up here are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.release

RATE, PERIOD, STRIDES = 200.0, 1.2, 8
AMPLITUDE = {"swing": 6.0, "strike": -3.0, "push": -3.5}
SPEED, RISE, HIP, KNEE, STRIKE = 1.25, 0.04, 0.7, 1.05, 31.0


@pytest.fixture(scope="module")
def gait(load_experiment):
    return load_experiment("simulator.gait")


def bump(time, middle, width):
    """A unit Gaussian in every stride."""
    phase = (time - middle + PERIOD / 2) % PERIOD - PERIOD / 2
    return np.exp(-0.5 * (phase / width) ** 2)


def leg(turn=None):
    """Shank, thigh, foot and pelvis; mid-swing at 0, heel strike 0.22 s, toe-off 0.96 s of each stride of 1.2 s."""
    time = np.arange(round(STRIDES * PERIOD * RATE)) / RATE
    shank = sum(AMPLITUDE[key] * bump(time, middle, 0.05) for key, middle in
                (("swing", 0.0), ("strike", 0.22), ("push", 0.96)))  # fmt: skip
    thigh = 3.0 * bump(time, PERIOD - 0.16, 0.09) - 2.0 * bump(time, 0.3, 0.15)
    foot = 5.0 * bump(time, 0.05, 0.08) - 9.0 * bump(time, 0.94, 0.06)
    axis = np.array([0.2, 0.95, -0.24]) / np.linalg.norm([0.2, 0.95, -0.24])
    other = np.cross(axis, [1.0, 0, 0])
    acc = np.tile([0.0, 0.0, 9.81], (len(time), 1))
    struck = acc + np.outer((STRIKE - 9.81) * bump(time, 0.2, 0.012), [0, 0, 1.0])
    rocking = 0.3 * np.sin(2 * np.pi * time)
    signals = {
        segment: (np.outer(rate, axis) + np.outer(rocking, other), struck)
        for segment, rate in (("shank", shank), ("thigh", thigh), ("foot", foot))
    }
    signals["pelvis"] = (0 * acc, acc + np.outer(2.5 * np.cos(4 * np.pi * time / PERIOD), [0, 0, 1.0]))
    if turn is not None:
        signals = {key: (gyr @ turn.T, acc @ turn.T) for key, (gyr, acc) in signals.items()}
    phase = time % PERIOD
    truth = {
        "distance": SPEED * time,
        "contact": (phase >= 0.22) & (phase < 0.96),
        "hip": HIP / 2 * np.cos(2 * np.pi * time / PERIOD),
        "knee": KNEE / 2 * (1 - np.cos(2 * np.pi * time / PERIOD)),
        "height": 0.9 + RISE / 2 * np.cos(4 * np.pi * time / PERIOD),
    }
    return signals, truth, [(0, len(time))]


def check(found, gait):
    expected = {
        "speed": SPEED, "stride_time": PERIOD, "stride_length": SPEED * PERIOD, "stance": 0.74 / 1.2,
        "stance_gyr": 0.74 / 1.2, "shank_swing": 6.0, "shank_back": -3.5, "thigh_forward": 3.0, "thigh_back": -2.0,
        "foot_push_off": -9.0, "foot_swing": 5.0, "pelvis_acc_range": 5.0,
        "pelvis_rise": RISE, "hip_range": HIP, "knee_range": KNEE,
    }  # fmt: skip
    for name, value in expected.items():
        values = getattr(found, name)
        assert len(values) == STRIDES - 2, name
        # The low-pass takes some per cent off peaks this narrow; what it does not touch is exact but for a sample.
        tolerance = 0.06 if name.split("_")[0] in ("shank", "thigh", "foot") else 0.02
        np.testing.assert_allclose(values, value, rtol=tolerance, err_msg=name)
    for name in gait.STRIKES:
        np.testing.assert_allclose(getattr(found, name), STRIKE, rtol=0.01)
    assert len(found.stride_width) == 0


@pytest.mark.parametrize("turn", [None, Rotation.from_rotvec([0.25, -0.26, 1.28]).as_matrix()])
def test_a_leg_with_known_figures_however_its_sensors_sit(gait, turn):
    signals, truth, windows = leg(turn)
    check(gait.figures(signals, RATE, windows, gait.Truth(**truth)), gait)
