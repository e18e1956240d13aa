"""The rate of a segment in one call is that of the simulated leg, whatever way its sensor is turned."""

import jax
import numpy as np
import pytest

from jgait import simulate
from jgait.mounting import sagittal_rate
from jgait.simulate.sensors import MPU6000
from jgait.types import RecordingError


@pytest.fixture(scope="module")
def walked():
    key, route = jax.random.key(1), simulate.straight(8.0)
    person = simulate.covering(key, simulate.Person(), route)
    return simulate.recording(key, person, route, errors=MPU6000, placements=("thigh_right", "shank_right"))


@pytest.mark.parametrize("segment", ["thigh", "shank"])
@pytest.mark.parametrize("turned", [False, True])
def test_it_is_the_rate_of_the_leg(walked, segment, turned):
    recording, truth = walked
    place = f"{segment}_right"
    if turned:  # half a turn about the segment: the sensor is worn on the back
        imu, half = recording.sensors[place], np.array([-1.0, -1.0, 1.0])
        imu = imu._replace(gyr=np.asarray(imu.gyr) * half, acc=np.asarray(imu.acc) * half)
        recording = recording._replace(sensors={**recording.sensors, place: imu})
    leg, time = truth.estimate.legs.right, np.asarray(truth.estimate.time)
    angle = np.asarray(leg.hip_angle) - (0.0 if segment == "thigh" else np.asarray(leg.knee_angle))
    found = sagittal_rate(recording, place)
    there = found.mask
    rate, true = found.rate[there], np.interp(found.time, time, np.gradient(angle, time))[there]
    assert np.mean(there) > 0.9 and not np.any(found.rate[~there])
    assert np.corrcoef(rate, true)[0, 1] > 0.98 and np.std(rate - true) < 0.2 * np.std(true)


def test_what_has_no_sagittal_rate_is_refused(walked):
    recording, _ = walked
    with pytest.raises(RecordingError, match="there is no sensor shank_left; the recording has thigh_right"):
        sagittal_rate(recording, "shank_left")
    with pytest.raises(RecordingError, match="that of a thigh, shank or ankle; got 'foot_right'"):
        sagittal_rate(recording, "foot_right")
    alone = recording._replace(sensors={"thigh_right": recording.sensors["thigh_right"]})
    with pytest.raises(RecordingError, match="there is no sensor shank_right"):
        sagittal_rate(alone, "thigh_right")
