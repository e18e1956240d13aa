"""Figures of gait: a leg made up here whose figures are known, and what people do in the public recordings."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jgait import datasets

pytestmark = pytest.mark.release

RATE, PERIOD, STRIDES = 200.0, 1.2, 8
AMPLITUDE = {"swing": 6.0, "strike": -3.0, "push": -3.5}
SPEED, RISE, HIP, KNEE, STRIKE = 1.25, 0.04, 0.7, 1.05, 31.0


@pytest.fixture(scope="module")
def gait(load_experiment):
    return SimpleNamespace(**vars(load_experiment("simulator.gait")), **{
        name: getattr(load_experiment("simulator.real"), name) for name in ("Spread", "real", "spread", "spread_of")
    })  # fmt: skip


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


def test_a_leg_with_known_figures(gait):
    signals, truth, windows = leg()
    check(gait.figures(signals, RATE, windows, gait.Truth(**truth)), gait)


@pytest.mark.parametrize("seed", [0])
def test_how_the_sensors_sit_does_not_matter(gait, seed):
    turn = Rotation.from_rotvec(np.random.default_rng(seed).normal(size=3) * 2).as_matrix()
    signals, truth, windows = leg(turn)
    check(gait.figures(signals, RATE, windows, gait.Truth(**truth)), gait)


# --- people ---

BOUNDS = {
    "speed": (0.8, 1.6), "stride_time": (0.85, 1.55), "stride_length": (0.9, 1.7), "stride_width": (0.0, 0.25),
    "stance": (0.57, 0.72), "stance_gyr": (0.5, 0.66), "shank_swing": (4, 9), "shank_back": (-6, -2),
    "thigh_forward": (2, 5), "thigh_back": (-4, -1), "foot_push_off": (-14, -5), "foot_swing": (4, 9),
    "shank_strike": (15, 80), "foot_strike": (15, 250), "pelvis_acc_range": (4, 18), "pelvis_rise": (0.02, 0.1),
    "hip_range": (0.5, 1.1), "knee_range": (0.8, 1.3),
}  # fmt: skip
LACKING = {
    "neura_sparse": set(),
    "gaitmap_example": {name for name in BOUNDS if name.split("_")[0] in ("shank", "thigh", "pelvis", "hip", "knee")},
    "tripod": {"thigh_forward", "thigh_back", "pelvis_rise", "hip_range", "knee_range"},
    "walking5m": {"stride_width", "pelvis_acc_range", "pelvis_rise", "hip_range", "knee_range"},
}


@pytest.mark.parametrize(
    "name, condition",
    [("neura_sparse", None), ("gaitmap_example", None), ("tripod", "PWS"), ("tripod", "PWS+20"),
     ("walking5m", "Young"), ("walking5m", "Elderly")],
)  # fmt: skip
def test_people_walk_as_people_do(gait, name, condition):
    if not datasets.available(name):
        pytest.skip(datasets.unavailable_reason(name))
    found = gait.spread(name, condition)
    if not found:
        pytest.skip(f"no recording of {name} is of {condition}")
    assert set(BOUNDS) - set(found) == LACKING[name]
    for figure, (low, high) in BOUNDS.items():
        if figure in found:
            assert low < found[figure].low <= found[figure].median <= found[figure].high < high, figure
