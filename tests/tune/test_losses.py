"""Losses are what their formulas say, ignore what is masked, and have finite gradients."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.geometry.matching import matched
from jgait.tune import losses
from jgait.tune.losses import TrajectoryWeights
from jgait.types import Estimate, Feet, FootTrajectory, Legs, LegTrajectory, Strides

DEGREE = np.pi / 180.0
T = 6


# A program for each combination of fields that are there.
trajectory, position, calibration = map(jax.jit, (losses.trajectory, losses.position, losses.calibration))
stride, contact_times = jax.jit(losses.stride, static_argnums=2), jax.jit(losses.contact_times)


def leg(seed, offset=0.0):
    values = np.random.default_rng(seed).normal(size=(4, T)) * 0.3 + offset
    return LegTrajectory(*values)


def estimate(right: Any = None, left: Any = None, distance: Any = None, valid: Any = None):
    ok = np.ones(T, bool) if valid is None else np.asarray(valid)
    return Estimate(np.arange(T) / 50.0, Legs(right, left), None, distance, ok, {})


def test_what_is_masked_may_even_be_infinite_and_nothing_valid_is_a_loss_of_zero_without_gradient():
    a, b = jnp.asarray([1.0, 2.0, jnp.inf]), jnp.asarray([0.0, 4.0, jnp.nan])
    for valid, loss, gradient in (([1, 1, 0], 2.5, [1.0, -2.0, 0.0]), ([0, 0, 0], 0.0, [0.0, 0.0, 0.0])):
        value, slope = jax.value_and_grad(losses.mean_squared)(a, b, jnp.asarray(valid, bool))
        assert float(value) == loss
        np.testing.assert_array_equal(slope, gradient)


def test_one_degree_and_one_centimetre_count_as_one_each():
    reference = leg(0)
    for field, unit in (("hip_angle", DEGREE), ("knee_angle", DEGREE), ("x", 0.01), ("y", 0.01)):
        moved = reference._replace(**{field: getattr(reference, field) + 2.0 * unit})
        loss = trajectory(estimate(moved), estimate(reference))
        assert float(loss) == pytest.approx(4.0, rel=1e-9)


def test_trajectory_equals_a_loop_over_fields_sides_and_samples():
    ours, theirs = (leg(1), leg(2)), (leg(3), leg(4))
    weights = TrajectoryWeights(2.0, 0.0, 3.0, 0.5)
    window = np.array([1, 1, 0, 1, 1, 1], bool)
    a = estimate(*ours, valid=[True] * 5 + [False])
    b = estimate(*theirs, valid=[False] + [True] * 5)
    use = [1, 3, 4]
    expected = 0.0
    for one, other in zip(ours, theirs, strict=True):
        for weight, x, y in zip(weights, one, other, strict=True):
            expected += weight * np.mean([(float(x[i]) - float(y[i])) ** 2 for i in use]) / 2.0
    assert float(losses.trajectory(a, b, weights, window=window)) == pytest.approx(expected, rel=1e-12)
    alone = losses.trajectory(a._replace(legs=Legs(None, ours[1])), b, weights, window=window)
    assert float(alone) != pytest.approx(expected)


def test_relative_to_standing_a_constant_offset_costs_nothing():
    reference = leg(5)
    moved = LegTrajectory(*(field + 0.3 for field in reference))
    still = np.array([1, 1, 0, 0, 0, 0], bool)
    assert float(losses.trajectory(estimate(moved), estimate(reference), relative_to=still)) < 1e-20
    assert float(losses.trajectory(estimate(moved), estimate(reference))) > 1.0
    bent = moved._replace(x=moved.x + 0.06 * (np.arange(T) == 4))
    relative = losses.trajectory(estimate(bent), estimate(reference), relative_to=still, window=~still)
    assert float(relative) == pytest.approx(36.0 / 4.0, rel=1e-9)


def test_misuse_is_refused_by_name():
    a = estimate(leg(0), None)
    with pytest.raises(ValueError, match="share no leg"):
        losses.trajectory(a, estimate(None, leg(1)))
    with pytest.raises(ValueError, match=r"same shape; got \(6,\) and \(5,\)"):
        losses.mean_squared(jnp.ones(6), jnp.ones(5))


def rows(start, end, length, valid):
    n = len(start)
    nothing = np.zeros(n)
    leaves = 0.5 * (np.array(start) + np.array(end))
    return Strides(np.zeros(n, int), np.array(start), leaves, np.array(end), np.array(length), nothing, nothing, valid)


def test_stride_lengths_are_read_off_the_distance_between_the_strides_ends():
    walked = estimate(distance=0.1 * np.arange(T))  # 5 m/s
    true = estimate()._replace(
        strides=rows([0.0, 0.03, 9.0], [0.05, 0.09, 9.9], [0.22, 0.31, 5.0], np.array([True, True, False]))
    )
    assert float(stride(walked, true, "length")) == pytest.approx((0.03**2 + 0.01**2) / 2)
    slope = jax.jit(jax.grad(lambda k: losses.stride(walked._replace(distance=k * walked.distance), true, "length")))(
        1.0
    )
    assert float(slope) == pytest.approx(0.03 * 0.25 - 0.01 * 0.30)
    with pytest.raises(ValueError, match="the reference has no strides"):
        losses.stride(walked, walked, "length")


def several(shift=0.0, **fields):
    """Four strides of both feet in turns; the third is no stride."""
    start = np.arange(4) * 0.6
    nothing = np.full(4, np.nan)
    table = Strides(
        np.arange(4) % 2, start + shift, start + 0.4 + shift, start + 1.1 + shift, np.array([1.2, 1.3, 9.0, 1.4]),
        np.array([0.1, 0.12, 9.0, np.nan]), nothing, np.array([True, True, False, True]),
    )  # fmt: skip
    return estimate()._replace(strides=table._replace(**fields))


def test_strides_are_matched_by_foot_and_time_as_when_they_are_judged():
    true, order = several(), np.array([3, 1, 0])
    ours = several(0.03)
    ours = ours._replace(strides=Strides(*(None if c is None else c[order] for c in ours.strides)))
    row, found = matched(ours.strides, true.strides)
    assert found.tolist() == [True, True, False, True] and row[found].tolist() == [2, 1, 0]
    longer = ours._replace(strides=ours.strides._replace(length=ours.strides.length + np.array([0.02, 0.0, 0.0])))
    assert float(stride(longer, true, "length")) == pytest.approx(0.02**2 / 3)
    wider = ours._replace(strides=ours.strides._replace(width=ours.strides.width + 0.03))
    assert float(stride(wider, true, "width")) == pytest.approx(0.03**2)  # over the two with a width
    assert float(stride(ours, true, "duration")) == pytest.approx(0.0, abs=1e-20)
    assert float(contact_times(ours, true)) == pytest.approx(0.03**2)
    other = ours._replace(strides=ours.strides._replace(side=1 - ours.strides.side))
    assert float(stride(other, true, "width")) == 0.0
    with pytest.raises(ValueError, match="the strides of the estimate have no turn"):
        stride(ours, true, "turn")
    with pytest.raises(ValueError, match="the estimate has no contacts"):
        contact_times(ours._replace(strides=ours.strides._replace(end=None)), true)


def walked(position, valid=None):
    ok = np.ones(len(position), bool) if valid is None else valid
    feet = Feet(FootTrajectory(position, None, None), None)
    return estimate()._replace(time=np.arange(len(position)) / 50.0, valid=ok, feet=feet)


def test_the_position_loss_removes_the_best_yaw_and_shift_and_nothing_else():
    path = np.random.default_rng(0).normal(size=(40, 3)) * [3.0, 2.0, 0.2]
    c, s = np.cos(2.3), np.sin(2.3)
    turned = path @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [5.0, -7.0, 1.0]
    assert float(position(walked(path), walked(turned))) < 1e-20
    noisy = turned + np.random.default_rng(1).normal(size=(40, 3)) * 0.1
    valid = np.arange(40) % 5 > 0
    noisy[~valid] = np.nan
    found = float(position(walked(path), walked(noisy, valid)))

    def error(yaw):
        c, s = np.cos(yaw), np.sin(yaw)
        a = (path @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))[valid]
        d = a - a.mean(axis=0) - noisy[valid] + noisy[valid].mean(axis=0)
        return np.mean(np.sum(d**2, axis=1))

    assert found == pytest.approx(min(error(yaw) for yaw in np.linspace(2.2, 2.4, 20001)), rel=1e-7)
    # the minimum's derivative is that at a fixed yaw: the gradient along a rotation of the path is 0
    gradient = jax.jit(jax.grad(lambda p: losses.position(walked(p), walked(noisy, valid))))
    slope = np.asarray(gradient(path))
    assert np.isfinite(slope).all() and not slope[~valid].any()
    spin = np.stack([-path[:, 1], path[:, 0], np.zeros(40)], axis=1)
    assert abs(np.sum(slope * spin)) < 1e-10
    assert np.isfinite(gradient(np.zeros((40, 3)))).all()
    with pytest.raises(ValueError, match="share no path of a foot"):
        losses.position(walked(path), walked(path)._replace(feet=None))


def test_calibration_is_least_where_the_stated_deviation_is_the_error():
    true = several()
    ours = several(length=true.strides.length + 0.03)

    def loss(stddev):
        spread = ours.strides._replace(length=jnp.full(4, stddev))
        return losses.calibration(ours._replace(strides_stddev=spread), true)

    value, slope = jax.jit(jax.value_and_grad(loss))(0.03)
    assert float(value) == pytest.approx(0.5 + np.log(3.0))
    assert float(slope) == pytest.approx(0.0, abs=1e-9)
    leg_true = leg(0)
    angles = estimate(leg_true._replace(hip_angle=leg_true.hip_angle + 2.0 * DEGREE))
    spread = LegTrajectory(*(np.full(T, 2.0 * DEGREE),) * 4)
    stated = angles._replace(stddev=Legs(spread, None))
    assert float(calibration(stated, estimate(leg_true))) == pytest.approx((0.5 + 2 * np.log(2.0)) / 2)
    with pytest.raises(ValueError, match="nothing of the reference has a deviation"):
        losses.calibration(angles, estimate(leg_true))
