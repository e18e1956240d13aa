import numpy as np
import pytest

from jgait.estimators import foot_ins
from jgait.estimators.foot_ins.readout import level_ground

LEVEL, STAIRS_UP, STAIRS_DOWN, RAMP = 0.0, 0.34, -0.34, 0.12
ROUTES = {
    "level": [(LEVEL, 30)],
    "stairs": [(LEVEL, 10), (STAIRS_UP, 4), (LEVEL, 3), (STAIRS_DOWN, 4), (LEVEL, 10)],
    "ramp": [(LEVEL, 10), (RAMP, 8), (LEVEL, 10)],
}


def route(name):
    """Rise of the ground and measured rise of strides [m], whose feet roll and differ by 1.5 cm."""
    true = np.repeat(*zip(*ROUTES[name], strict=True))
    return true, true + 0.01 + 0.015 * np.random.default_rng(0).normal(size=len(true))


@pytest.mark.parametrize("name", ROUTES)
def test_level_ground_is_where_the_route_is_level_whatever_a_few_bad_rises_say(name):
    true, rise = route(name)
    every = np.ones(rise.shape, bool)
    rise[np.flatnonzero(true == 0.0)[[2, 5, -3]]] += [0.18, -0.12, 0.15]
    np.testing.assert_array_equal(level_ground(rise, every), true == 0.0)
    np.testing.assert_array_equal(level_ground(-rise[::-1], every)[::-1], true == 0.0)


@pytest.mark.parametrize(("name", "rise"), [("up", 4.5), ("down", -4.1)])
def test_real_stairs_are_not_level(data, name, rise):
    (walk,) = data("gaitmap_example", f"imu_sample_healthy_stair_{name}")
    z = foot_ins.estimate(foot_ins.FootParams(), walk.recording).feet.right.position[:, 2]
    assert z[-1] - z[0] == pytest.approx(rise, abs=0.2)
