"""Error tables: right numbers, right units, right times, and refusals that say what is wrong."""

import numpy as np
import pandas as pd
import pytest

from jgait import evaluate
from jgait.types import Estimate, Feet, FootTrajectory, Legs, LegTrajectory

DEGREE = np.pi / 180.0


def walk(time, hip=0.0, knee=0.0, x=0.0, y=0.0, *, sides=("right", "left"), distance=None, valid=None):
    """Smooth signals with offsets [rad, m] of each field."""
    leg = LegTrajectory(np.sin(time) + hip, np.cos(time) + knee, 0.1 * time + x, -0.2 * time + y)
    legs = Legs(*(leg if side in sides else None for side in ("right", "left")))
    ok = np.ones(time.shape, bool) if valid is None else valid
    return Estimate(time, legs, None, distance, ok, {})


TIME = np.arange(0.0, 4.0, 0.01)


def test_a_constant_offset_is_its_own_error_in_the_units_of_the_column():
    table = evaluate.trajectory_errors(walk(TIME, 2.0 * DEGREE, -3.0 * DEGREE, 0.04, -0.05), walk(TIME))
    assert list(table.columns) == ["hip_deg", "knee_deg", "x_cm", "y_cm"]
    assert list(table.index) == ["right", "left"]
    np.testing.assert_allclose(table.to_numpy(), [[2.0, 3.0, 4.0, 5.0]] * 2, rtol=1e-10)


def test_relative_to_standing_the_offset_is_gone_and_the_rest_stays():
    estimate = walk(TIME, hip=2.0 * DEGREE, x=0.3)
    extra = np.where(TIME >= 2.0, 0.03, 0.0)
    estimate = estimate._replace(legs=Legs(estimate.legs.right._replace(x=estimate.legs.right.x + extra), None))
    table = evaluate.trajectory_errors(estimate, walk(TIME), window=(2.0, 3.5), relative_to=(0.0, 1.0))
    assert list(table.index) == ["right"]
    np.testing.assert_allclose(table.loc["right"], [0.0, 0.0, 3.0, 0.0], atol=1e-9)
    mask = (TIME >= 2.0) & (TIME <= 3.5)
    same = evaluate.trajectory_errors(estimate, walk(TIME), window=mask, relative_to=TIME <= 1.0)
    pd.testing.assert_frame_equal(table, same)


def test_root_mean_square_by_hand():
    time = np.array([0.0, 1.0, 2.0, 3.0])
    estimate, reference = walk(time), walk(time)
    moved = reference.legs.right._replace(y=reference.legs.right.y + np.array([0.01, -0.03, 0.05, 9.0]))
    valid = np.array([True, True, True, False])
    table = evaluate.trajectory_errors(estimate, reference._replace(legs=Legs(moved, None), valid=valid))
    assert table.loc["right", "y_cm"] == pytest.approx(np.sqrt((1.0 + 9.0 + 25.0) / 3.0))


def test_other_sampling_times_are_interpolated_but_not_across_invalid_samples_of_the_estimate():
    table = evaluate.trajectory_errors(walk(np.arange(-0.5, 5.0, 0.02) + 0.003, x=0.01), walk(TIME))
    assert table["hip_deg"].max() < 0.01
    np.testing.assert_allclose(table["x_cm"], 1.0, rtol=1e-9)
    valid = (TIME < 1.0) | (TIME > 2.0)
    estimate = walk(TIME, valid=valid)
    broken = estimate.legs.right._replace(x=np.where(valid, estimate.legs.right.x, 1e6))
    table = evaluate.trajectory_errors(estimate._replace(legs=Legs(broken, None)), walk(np.arange(0.0, 3.9, 0.013)))
    assert table.loc["right", "x_cm"] < 1e-6


def test_distance_error_is_estimate_minus_reference_over_the_common_time():
    reference = walk(TIME, distance=1.0 * TIME)
    later = np.arange(1.0, 6.0, 0.02)
    error = evaluate.distance_error(walk(later, distance=5.0 + 0.9 * (later - 1.0)), reference)
    assert error.reference == pytest.approx(2.99)
    assert error.estimate == pytest.approx(0.9 * 2.99)
    assert error.error == pytest.approx(-0.299)
    assert error.abs_error == pytest.approx(0.299)
    assert error.rel_error == pytest.approx(-0.1)
    ramp = 0.1 * np.arange(300) * 0.01
    assert error.rmse == pytest.approx(np.sqrt(np.mean(ramp**2)), rel=1e-9)


@pytest.mark.parametrize(
    ("estimate", "reference", "more", "message"),
    [
        (walk(TIME + 100.0), walk(TIME), {}, r"no valid time in common; the estimate spans 100 to 103\.99 s"),
        (walk(TIME, sides=("right",)), walk(TIME, sides=("left",)), {}, "share no leg"),
        (walk(TIME), walk(TIME), {"relative_to": (50.0, 60.0)}, "relative_to holds no sample"),
        (walk(TIME), walk(TIME), {"window": (3.0, 1.0)}, r"window must start before it ends; got \(3, 1\) s"),
        (walk(TIME), walk(TIME), {"window": np.arange(5)}, r"window must be \(start, end\) in seconds or a bool mask"),
        (walk(TIME[::-1]), walk(TIME), {}, r"the estimate's time must be .* must not run backwards"),
    ],
)
def test_refusals_state_what_was_wrong(estimate, reference, more, message):
    with pytest.raises(ValueError, match=message):
        evaluate.trajectory_errors(estimate, reference, **more)


def test_distances_that_cannot_be_compared_are_refused():
    with pytest.raises(ValueError, match="the estimate has no distance"):
        evaluate.distance_error(walk(TIME), walk(TIME, distance=TIME))
    with pytest.raises(ValueError, match="reference distance is 0 m"):
        evaluate.distance_error(walk(TIME, distance=TIME), walk(TIME, distance=0.0 * TIME))


def feet(time, *places):
    both = [None if place is None else FootTrajectory(place, None, None) for place in places]
    return Estimate(time, Legs(None, None), None, None, np.ones(time.size, bool), {}, feet=Feet(*both))


def test_a_foot_in_a_world_turned_about_the_vertical_has_no_error():
    place = np.stack([TIME, np.sin(TIME), 0.1 * np.cos(3.0 * TIME)], axis=1)
    c, s = np.cos(2.0), np.sin(2.0)
    turned = place @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T + np.array([5.0, -3.0, 0.7])
    exact = evaluate.foot_position_error(feet(TIME, turned, None), feet(TIME, place, place), "right")
    np.testing.assert_allclose(exact, 0.0, atol=1e-12)
    assert evaluate.foot_position_error(feet(TIME, turned, None), feet(TIME, place, place), "left") is None
    assert evaluate.foot_position_error(walk(TIME), feet(TIME, place, place), "left") is None
    # one tilted, or seen from below, cannot be turned away
    tilted = turned + np.array([0.0, 0.0, 1.0]) * (0.04 * (-1.0) ** np.arange(TIME.size))[:, None]
    off = evaluate.foot_position_error(feet(TIME, tilted, None), feet(TIME, place, None), "right")
    assert off.plan < 1e-12 and off.height == pytest.approx(0.04, rel=1e-3)
    below = evaluate.foot_position_error(feet(TIME, turned * [1.0, -1.0, 1.0], None), feet(TIME, place, None), "right")
    assert below.plan > 0.3


def test_a_foot_known_at_moments_is_judged_at_them():
    place = np.stack([TIME, np.round(TIME), 0.0 * TIME], axis=1)
    few = feet(TIME[::50], place[::50], None)
    for pair in ((few, feet(TIME, place, None)), (feet(TIME, place, None), few)):
        np.testing.assert_allclose(evaluate.foot_position_error(*pair, "right"), 0.0, atol=1e-9)
    twice = np.repeat(np.arange(0, TIME.size, 50), 2)  # both feet have something to tell at one moment
    moments = feet(TIME[twice], place[twice], None)
    np.testing.assert_allclose(evaluate.foot_position_error(moments, feet(TIME, place, None), "right"), 0.0, atol=1e-9)
