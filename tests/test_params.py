"""Parameters: what the optimiser sees, the way back, gradients, and what is refused."""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait import params
from jgait.estimators import leg_ekf
from jgait.params import check_params, constrain, fixed, interval, positive, real, unconstrain


class Pose(NamedTuple):
    hip: Any
    knee: Any


class Params(NamedTuple):
    length: Any
    share: Any
    offset: Any
    gravity: Any
    pose: Any


TRANSFORMS = Params(positive, interval(-0.5, 2.0), real, fixed, Pose(real, fixed))
PARAMS = Params(0.43, 1.7, -3.0, 9.81, Pose(0.1, 0.2))


@pytest.mark.parametrize(
    "transform, values",
    [
        (real, [-1e6, -1.0, 0.0, 1e-9, 3.0]),
        (positive, [1e-12, 1e-3, 1.0, 1e8]),
        (interval(0.0, 1.0), [1e-6, 0.3, 0.5, 1.0 - 1e-6]),
        (interval(-30.0, -10.0), [-29.999, -20.0, -10.5]),
    ],
)
def test_there_and_back(transform, values):
    for value in values:
        free = transform.to_free(jnp.asarray(value))
        assert math.isfinite(free)
        np.testing.assert_allclose(transform.to_natural(free), value, rtol=1e-10)


@pytest.mark.parametrize("transform", [real, positive, interval(0.0, 1.0), interval(-30.0, -10.0)])
def test_every_free_value_is_within_the_range_and_the_order_is_kept(transform):
    natural = np.asarray(transform.to_natural(jnp.linspace(-20.0, 20.0, 101)))
    assert np.all(natural > transform.low)
    assert np.all(natural < transform.high)
    assert np.all(np.diff(natural) > 0)


def test_what_is_fixed_is_no_leaf_and_comes_back_from_the_parameters():
    free = unconstrain(PARAMS, TRANSFORMS)
    assert isinstance(free, Params) and isinstance(free.pose, Pose)
    assert free.gravity is None and free.pose.knee is None
    assert len(jax.tree.leaves(free)) == 4
    back = constrain(free, TRANSFORMS, PARAMS)
    np.testing.assert_allclose(jax.tree.leaves(back), jax.tree.leaves(PARAMS), rtol=1e-10)
    moved = constrain(jax.tree.map(lambda leaf: leaf + 1.0, free), TRANSFORMS, PARAMS)
    assert (moved.gravity, moved.pose.knee) == (9.81, 0.2)
    assert float(moved.length) != 0.43
    assert constrain(free, TRANSFORMS, PARAMS._replace(gravity=1.62)).gravity == 1.62


def test_arrays_and_integers_are_parameters_too_and_float32_stays_float32():
    params = Pose(jnp.asarray([0.1, 2.0]), 3)
    back = constrain(unconstrain(params, Pose(positive, positive)), Pose(positive, positive), params)
    np.testing.assert_allclose(back.hip, [0.1, 2.0], rtol=1e-10)
    np.testing.assert_allclose(back.knee, 3.0, rtol=1e-10)
    params, transforms = Pose(jnp.float32(0.5), jnp.float32(0.5)), Pose(positive, interval(0.0, 1.0))
    free = unconstrain(params, transforms)
    assert {leaf.dtype for leaf in jax.tree.leaves((free, constrain(free, transforms, params)))} == {jnp.dtype("f4")}


def test_gradients_stay_finite_far_out():
    transforms = Pose(interval(0.0, 1.0), interval(0.0, 1.0))
    params = Pose(0.5, 0.5)

    def total(free):
        return sum(jax.tree.leaves(constrain(free, transforms, params)))

    gradient = jax.grad(total)(Pose(jnp.asarray(800.0), jnp.asarray(-800.0)))
    assert all(math.isfinite(leaf) for leaf in jax.tree.leaves(gradient))


@pytest.mark.parametrize(
    "change, message",
    [
        ({"length": 0.0}, r"parameter 'length' must lie in \(0, inf\); got 0\.0"),
        ({"length": -1.0}, r"parameter 'length' must lie in \(0, inf\); got -1\.0"),
        ({"share": 2.0}, r"parameter 'share' must lie in \(-0\.5, 2\); got 2\.0"),
        ({"offset": math.nan}, r"parameter 'offset' must be finite; got nan"),
        ({"gravity": math.inf}, r"parameter 'gravity' must be finite; got inf"),
        ({"pose": Pose(math.nan, 0.0)}, r"parameter 'pose\.hip' must be finite; got nan"),
        ({"length": np.asarray([0.4, -0.4])}, r"parameter 'length' must lie in \(0, inf\); got \[ 0\.4 -0\.4\]"),
    ],
)
def test_values_out_of_range_are_named(change, message):
    with pytest.raises(ValueError, match=rf"^{message}$"):
        check_params(PARAMS._replace(**change), TRANSFORMS)


def test_values_in_range_pass_and_traced_ones_are_left_alone():
    check_params(PARAMS, TRANSFORMS)

    def length(value):
        check_params(PARAMS._replace(length=value), TRANSFORMS)
        return value

    assert float(jax.jit(length)(-1.0)) == -1.0


def test_structures_that_do_not_match_are_named():
    with pytest.raises(TypeError, match=r"same structure; got Pose and Params"):
        unconstrain(Pose(0.1, 0.2), TRANSFORMS)
    with pytest.raises(TypeError, match=r"must hold a jgait\.params\.Transform for every parameter; got 'positive'"):
        unconstrain(Pose(0.1, 0.2), Pose(positive, "positive"))


@pytest.mark.parametrize("ends", [(1.0, 1.0), (2.0, 1.0), (-math.inf, 0.0), (0.0, math.inf), (0.0, math.nan)])
def test_an_interval_needs_two_ends_in_order(ends):
    with pytest.raises(ValueError, match=r"^interval\(low, high\) needs finite low < high; got low="):
        interval(*ends)


def test_names_that_are_free():
    transforms = leg_ekf.estimator().transforms
    free = params.freed(transforms, "thigh_length", "inclination.gyro_noise", "angle_noise")
    marks = jax.tree.leaves(free, is_leaf=lambda node: isinstance(node, params.Transform))
    moved = [name for name, mark in zip(params.names(free), marks, strict=True) if mark.to_free is not None]
    assert moved == ["thigh_length.right", "thigh_length.left", "angle_noise", "inclination.gyro_noise"]
    with pytest.raises(ValueError, match=r"no parameter 'thigh'; there are thigh_length\.right, "):
        params.freed(transforms, "thigh")
