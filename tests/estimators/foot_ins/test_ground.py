import jax
import numpy as np
import pytest

from jgait.estimators import foot_ins
from jgait.estimators.foot_ins.readout import level_ground

LEVEL, STAIRS_UP, STAIRS_DOWN, RAMP = (0.0, 1.3), (0.6, 0.56), (-0.6, 0.56), (0.09, 1.3)
ROUTES = {
    "level": [(LEVEL, 30)],
    "stairs": [(LEVEL, 10), (STAIRS_UP, 4), (LEVEL, 3), (STAIRS_DOWN, 4), (LEVEL, 10)],
    "ramp": [(LEVEL, 10), (RAMP, 8), (LEVEL, 10)],
}


def route(parts, seed=0):
    """Rise by the ground, measured rise and length of strides [m], whose feet roll and differ by 1.5 cm."""
    rows = np.concatenate([[part] * count for part, count in parts])
    noise = 0.01 + 0.015 * np.random.default_rng(seed).normal(size=len(rows))
    return rows[:, 0] * rows[:, 1], rows[:, 0] * rows[:, 1] + noise, rows[:, 1]


def level(rise, length, valid=True):
    return level_ground(rise, length, np.full_like(rise, 0.02), np.broadcast_to(valid, rise.shape))


@pytest.mark.parametrize("parts", ROUTES.values(), ids=list(ROUTES))
def test_level_ground_is_where_the_route_is_level_whatever_a_few_bad_rises_say(parts):
    true, rise, length = route(parts)
    np.testing.assert_array_equal(level(rise, length), true == 0.0)
    bad = np.flatnonzero(true == 0.0)[[2, 5, -3]]
    rise[bad] += [0.18, -0.12, 0.15]
    np.testing.assert_array_equal(level(rise, length), true == 0.0)


def test_the_direction_of_the_walk_and_the_sign_of_the_rise_do_not_matter():
    true, rise, length = route(ROUTES["ramp"])
    rise = rise + np.where(true == 0.0, 0.0, -0.03)  # near the border between level ground and a slope
    np.testing.assert_array_equal(level(rise[::-1], length[::-1])[::-1], level(rise, length))
    np.testing.assert_array_equal(level(-rise, length), level(rise, length))


def test_strides_that_do_not_count_do_not_decide_in_numpy_and_in_jax():
    _, rise, length = route(ROUTES["stairs"])
    valid = np.ones(rise.shape, bool)
    valid[[3, 4, 20]] = False
    more = np.where(valid, rise, 5.0)
    host, traced = level(more, length, valid), jax.jit(level_ground)(more, length, np.full_like(rise, 0.02), valid)
    np.testing.assert_array_equal(host, traced)
    np.testing.assert_array_equal(host[valid], level(rise[valid], length[valid]))
    assert host[~valid].all()


@pytest.mark.parametrize(("name", "rise"), [("up", 0.30), ("down", -0.28)])
def test_real_stairs_are_not_level(data, name, rise):
    (walk,) = data("gaitmap_example", f"imu_sample_healthy_stair_{name}")
    estimate = foot_ins.estimate(foot_ins.FootParams(), walk.recording)
    strides = estimate.strides
    climbed = np.sum(np.where(np.abs(strides.height - rise) < 0.06, strides.height, 0.0)[strides.side == 0])
    z = estimate.feet.right.position[:, 2]
    assert abs(climbed) > 3.0
    np.testing.assert_allclose(z[-1] - z[0], climbed, atol=0.6)
