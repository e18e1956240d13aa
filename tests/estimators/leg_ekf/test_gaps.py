"""After a gap in a sensor's samples the leg finds its angles again; too few samples a second are refused."""

import jax
import numpy as np
import pytest
from made.estimators import hidden, part, without

from jgait import simulate
from jgait.estimators import leg_ekf
from jgait.simulate.sensors import OPAL
from jgait.types import RecordingError

BEGIN = 700


@pytest.fixture(scope="module")
def walk():
    recording, _ = simulate.cohort(
        jax.random.key(2), 1, simulate.straight(12.0), OPAL, 100.0, ("thigh_right", "shank_right"), recorded=False
    )[0]
    return recording


def gapped(recording, placement, samples):
    return without(recording, BEGIN / 100.0, samples / 100.0, placement)


def estimate(recording):
    return leg_ekf.estimate(leg_ekf.LegParams(), recording)


@pytest.fixture(scope="module")
def whole(walk):
    return estimate(walk)


@pytest.mark.parametrize(("placement", "samples"), [("thigh_right", 50), ("shank_right", 300)])
def test_angles_after_a_gap_are_those_without_it(walk, whole, placement, samples):
    gap = estimate(gapped(walk, placement, samples))
    np.testing.assert_array_equal(np.flatnonzero(~gap.valid), np.arange(BEGIN, BEGIN + samples))
    for angle in ("hip_angle", "knee_angle"):
        before, after = (np.rad2deg(getattr(one.legs.right, angle)) for one in (whole, gap))
        apart = np.abs(after - before)[gap.valid]
        assert np.sqrt(np.mean(apart**2)) < 10.0  # 20 to 90 if the leg goes on with its last rate
        assert apart.max() < 30.0
    # the foot stays on the leg
    assert np.abs(gap.legs.right.x[gap.valid]).max() < 1.0


@pytest.mark.parametrize("begin", [7.0, 7.3, 7.6, 7.9])
def test_a_swing_that_is_lost_costs_a_second_and_deviations_say_so(walk, whole, begin):
    known, after = whole, estimate(without(walk, begin, 0.25))
    time = np.asarray(walk.sensors["shank_right"].time)
    for first, last in ((0.3, 1.0), (1.0, 2.0), (2.0, 4.0)):
        rows = (time > begin + first) & (time < begin + last)
        apart, stated = ((getattr(after, part).right.knee_angle)[rows] for part in ("legs", "stddev"))
        apart = np.abs(apart - known.legs.right.knee_angle[rows])
        assert np.mean(apart < 3.0 * stated) > 0.95, (first, np.rad2deg(apart.mean()), np.rad2deg(stated.mean()))
    assert np.rad2deg(apart.mean()) < 4.0


def test_nobody_stands_in_samples_that_are_lost_at_the_start(walk, whole):
    gap = estimate(without(walk, 0.0, 6.0))
    rows = np.asarray(walk.sensors["shank_right"].time) > 7.0
    for angle in ("hip_angle", "knee_angle"):
        apart = np.rad2deg(getattr(gap.legs.right, angle) - getattr(whole.legs.right, angle))[rows]
        assert np.sqrt(np.mean(apart**2)) < 6.0


def test_a_rate_that_is_too_low_is_refused(walk):
    with pytest.raises(RecordingError, match="needs 40 Hz or more; the recording has 25 Hz"):
        estimate(part(walk, slice(None, None, 4))._replace(sampling_rate_hz=25.0))


def test_half_the_rate_and_single_lost_samples_bend_no_knee(walk, whole):
    half = lost = part(walk, slice(None, None, 2))._replace(sampling_rate_hz=50.0)
    knee = np.rad2deg(whole.legs.right.knee_angle)[::2]
    for number, placement in enumerate(walk.sensors):
        lost = hidden(lost, np.random.default_rng(number).random(knee.size) <= 0.01, placement)
    for recording, least in ((half, 1.0), (lost, 1.5)):
        slow = estimate(recording)
        assert np.sqrt(np.mean((np.rad2deg(slow.legs.right.knee_angle) - knee) ** 2)) < least
