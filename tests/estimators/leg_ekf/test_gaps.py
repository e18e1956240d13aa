"""After a gap in a sensor's samples the leg finds its angles again; too few samples a second are refused."""

import jax
import numpy as np
import pytest

from jgait import simulate
from jgait.estimators import leg_ekf
from jgait.estimators.leg_ekf.prepare import common_clock, lost_time
from jgait.simulate.sensors import OPAL
from jgait.types import Imu, RecordingError

BEGIN = 700


@pytest.fixture(scope="module")
def walk():
    recording, _ = simulate.cohort(
        jax.random.key(2), 1, simulate.straight(12.0), OPAL, 100.0, ("thigh_right", "shank_right")
    )[0]
    return recording


def without(recording, placement, samples):
    imu = recording.sensors[placement]
    mask = np.array(imu.mask)
    mask[BEGIN : BEGIN + samples] = False
    gone = Imu(imu.time, np.where(mask[:, None], imu.gyr, 0.0), imu.acc, mask)
    return recording._replace(sensors={**recording.sensors, placement: gone})


def estimate(recording):
    return leg_ekf.estimate(leg_ekf.LegParams(), recording)


@pytest.fixture(scope="module")
def whole(walk):
    return estimate(walk)


@pytest.mark.parametrize("placement", ["thigh_right", "shank_right"])
@pytest.mark.parametrize("samples", [50, 100, 300])
def test_angles_after_a_gap_are_those_without_it(walk, whole, placement, samples):
    gap = estimate(without(walk, placement, samples))
    np.testing.assert_array_equal(np.flatnonzero(~gap.valid), np.arange(BEGIN, BEGIN + samples))
    for angle in ("hip_angle", "knee_angle"):
        before, after = (np.rad2deg(getattr(one.legs.right, angle)) for one in (whole, gap))
        apart = np.abs(after - before)[gap.valid]
        assert np.sqrt(np.mean(apart**2)) < 10.0  # 20 to 90 if the leg goes on with its last rate
        assert apart.max() < 30.0
    # the foot stays on the leg
    assert np.abs(gap.legs.right.x[gap.valid]).max() < 1.0


def test_deviations_are_larger_within_a_gap(walk):
    gap = estimate(without(walk, "shank_right", 100)).stddev.right.knee_angle
    assert gap[BEGIN + 50] > 1.2 * gap[BEGIN - 50]


def test_time_since_the_last_measured_sample():
    measured = np.array([False, True, False, False, True, False])
    np.testing.assert_allclose(lost_time(0.1 * np.arange(6), measured), [0.1, 0.0, 0.1, 0.2, 0.0, 0.1])


def test_a_rate_that_is_too_low_is_refused(walk):
    slow = {p: Imu(*(part[::4] for part in imu)) for p, imu in walk.sensors.items()}
    with pytest.raises(RecordingError, match="needs 40 Hz or more; the recording has 25 Hz"):
        estimate(walk._replace(sensors=slow, sampling_rate_hz=25.0))


def test_a_clock_a_little_slower_than_the_least_rate_is_taken(walk):
    sensors = {p: imu._replace(time=np.arange(len(imu.time)) * 0.02505) for p, imu in walk.sensors.items()}
    assert common_clock(walk._replace(sensors=sensors, sampling_rate_hz=39.92), ("right",))[1].size


def test_half_the_rate_and_single_lost_samples_bend_no_knee(walk, whole):
    half = {p: Imu(*(part[::2] for part in imu)) for p, imu in walk.sensors.items()}
    lost = {}
    for number, (placement, imu) in enumerate(half.items()):
        mask = np.asarray(imu.mask) & (np.random.default_rng(number).random(imu.time.size) > 0.01)
        lost[placement] = imu._replace(gyr=np.where(mask[:, None], imu.gyr, 0.0), mask=mask)
    knee = np.rad2deg(whole.legs.right.knee_angle)[::2]
    for sensors, least in ((half, 1.0), (lost, 1.5)):
        slow = estimate(walk._replace(sensors=sensors, sampling_rate_hz=50.0))
        assert np.sqrt(np.mean((np.rad2deg(slow.legs.right.knee_angle) - knee) ** 2)) < least
