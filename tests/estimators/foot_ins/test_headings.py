"""Headings of two feet that must not drift apart."""

import numpy as np
import pytest
from made.estimators import part

from jgait import datasets
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import FootParams, readout
from jgait.types import Recording

STRIDES, HZ = 24, 50.0


def walked(drifts, angle=0.0, noise=0.0):
    """Times, ways and footholds of feet that go out and back; a foot's heading drifts by `drifts` [rad/s]."""
    time = np.arange(int(HZ * 1.1 * (STRIDES + 1))) / HZ
    rng, turn_at = np.random.default_rng(3), STRIDES // 2
    ways, steps = [], []
    for side, drift in enumerate(drifts):
        at = ((np.arange(STRIDES) + 0.5 * side) * 1.1 * HZ).astype(int)
        along = np.where(np.arange(STRIDES) < turn_at, np.arange(STRIDES), 2 * turn_at - np.arange(STRIDES))
        outward = np.where(np.arange(STRIDES) < turn_at, 1.0, -1.0)
        place = np.stack([1.3 * (along + 0.5 * side * outward), 0.075 * (2 * side - 1) * outward], axis=1)
        place += noise * rng.standard_normal(place.shape)
        way = np.interp(time, time[at], place @ [1.0, 1.0j])
        ways.append(readout.turned_way(way, drift * (time - time[at[0]]) + angle * side))
        steps.append(at)
    return time, ways, steps


@pytest.mark.parametrize("angle", [0.0, 2.5])
def test_the_difference_of_the_rates_is_found_and_divided_by_the_variances(angle):
    time, ways, steps = walked((-3e-3, 2e-3), angle, noise=0.02)
    found = readout.heading_rates(time, ways, steps, (4e-3, 2e-3))
    assert found.right - found.left == pytest.approx(-5e-3, abs=5e-4)
    assert found.right == pytest.approx(0.8 * (found.right - found.left))
    assert found.remaining < 0.2


@pytest.mark.parametrize(("drift", "spread", "most"), [(0.0, 2e-3, 3e-4), (4e-3, 3e-3, 4e-4)])
def test_feet_that_go_together_stay_as_they_are_and_a_common_drift_is_not_seen(drift, spread, most):
    time, ways, steps = walked((drift, drift))
    found = readout.heading_rates(time, ways, steps, (spread, spread))
    assert abs(found.right - found.left) < most


@pytest.fixture(scope="module")
def real():
    if not datasets.available("gaitmap_example"):
        pytest.skip(datasets.unavailable_reason("gaitmap_example"))
    recording = part(datasets.load("gaitmap_example", ["imu_sample"])[0].recording, slice(-3832))
    alone = {
        side: foot_ins.estimate(
            FootParams(), Recording({f"foot_{side}": recording.sensors[f"foot_{side}"]}, recording.sampling_rate_hz)
        )
        for side in ("right", "left")
    }
    return foot_ins.estimate(FootParams(), recording), alone


def test_of_a_real_walk_headings_and_turns_change_and_lengths_do_not(real):
    both, alone = real
    for side, number in (("right", 0), ("left", 1)):
        rows, own = both.strides.side == number, alone[side]
        np.testing.assert_allclose(both.strides.length[rows], own.strides.length, atol=1e-9)
        before, after = (getattr(e.feet, side).position for e in (own, both))
        np.testing.assert_allclose(after[:, 2], before[:, 2], atol=1e-9)
        lengths = [np.linalg.norm(np.diff(way, axis=0), axis=1) for way in (before, after)]
        np.testing.assert_allclose(*lengths, atol=1e-9)
        turned = both.strides.turn[rows] - own.strides.turn
        duration = own.strides.standing_end - own.strides.standing
        np.testing.assert_allclose(turned / duration, turned[0] / duration[0], atol=1e-9)
        assert 5e-4 < abs(turned[0] / duration[0]) < 5e-3
        known, unknown = (getattr(e.feet_stddev, side).orientation[-1, 2] for e in (both, own))
        assert 0.5 * unknown < known < 0.9 * unknown
