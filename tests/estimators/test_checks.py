"""Recordings that cannot be used, as in other units or with arrays of other lengths, are refused in words."""

import numpy as np
import pytest
from made.foot import foot

from jgait import Imu, Recording, RecordingError, analyse, estimators

CASES = {
    "deg/s": (lambda imu: imu._replace(gyr=np.rad2deg(imu.gyr)), "gyr of 'foot_right' must be in rad/s; it reaches"),
    "mask": (lambda imu: imu._replace(mask=imu.mask[:-5]), "mask of 'foot_right' must have shape"),
    "axes": (lambda imu: imu._replace(gyr=imu.gyr[:, :2]), "gyr of 'foot_right' must have shape"),
}


def changed(change):
    recording = foot(strides=4).recording
    return recording._replace(sensors={"foot_right": change(recording.sensors["foot_right"])})


@pytest.mark.parametrize("name", CASES)
def test_an_analysis_refuses_them(name):
    change, words = CASES[name]
    with pytest.raises(RecordingError) as error:
        analyse(changed(change))
    assert words in str(error.value)


NOISE = np.random.default_rng(0).normal(size=(2, 400, 3))
IMU = Imu(np.arange(400) / 50.0, 0.1 * NOISE[0], 0.5 * NOISE[1] + [0.0, 0.0, 9.81], np.ones(400, bool))
PLACES = {"ankle_stride": "shank_right", "waist": "waist"}
REFUSED = {  # sampling rate, changed fields, message with the placement
    "no acceleration": (50.0, {"acc": None}, "needs an accelerometer"),
    "shape": (50.0, {"gyr": IMU.gyr[:-1]}, "gyr of '{}' must have shape"),
    "nan": (50.0, {"acc": np.where(IMU.acc > 9.5, np.nan, IMU.acc)}, "NaN or infinity"),
    "time": (50.0, {"time": IMU.time[::-1]}, "time must increase"),
    "slow": (20.0, {"time": 2.5 * IMU.time}, "25 to 400 Hz.*; the recording has 20 Hz"),
    "fast": (500.0, {"time": 0.1 * IMU.time}, "25 to 400 Hz.*; the recording has 500 Hz"),
    "other rate": (100.0, {}, "a sample every 0.02 s, and is said to have 100 Hz"),
    "masked": (50.0, {"mask": np.zeros(400, bool)}, "every sample of '{}' is masked"),
    "short": (50.0, {name: part[:40] for name, part in IMU._asdict().items()}, "needs a walk, [12] s and 10 samples"),
    "g": (50.0, {"acc": IMU.acc / 9.80665}, "acc of '{}' must be in m/s²; its median is 0.99.*: is it in g"),
}


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("case", REFUSED)
def test_a_sensor_that_an_estimator_cannot_use_is_refused(name, case):
    (hz, fields, message), place, record = REFUSED[case], PLACES[name], estimators.get(name)
    with pytest.raises(RecordingError, match=message.format(place)):
        record.estimate(record.params, Recording({place: IMU._replace(**fields)}, hz))


THIGH, LATE = {"thigh_right": IMU}, {"shank_right": IMU, "shank_left": IMU._replace(time=IMU.time + 0.02)}


@pytest.mark.parametrize(
    ("name", "sensors", "message"),
    [
        ("ankle_stride", THIGH, r"needs 'ankle_right' or .*; the recording has \['thigh_right'\]"),
        ("waist", THIGH, r"needs 'waist' or 'lower_back' or .*; .* has \['thigh_right'\]"),
        ("ankle_stride", LATE, "on one clock"),
        ("waist", {"waist": IMU._replace(acc=4.0 * IMU.acc)}, "feels 39.* m/s² on average, where a walking person"),
    ],
)
def test_sensors_that_do_not_serve_are_refused(name, sensors, message):
    record = estimators.get(name)
    with pytest.raises(RecordingError, match=message):
        record.estimate(record.params, Recording(sensors, 50.0))
