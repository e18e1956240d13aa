"""Recordings made by hand in other units or with arrays of other lengths are refused in words."""

import numpy as np
import pytest
from made.foot import foot

from jgait import RecordingError, Walk, analyse, datasets, evaluate
from jgait.estimators import checks, foot_ins

CASES = {
    "deg/s": (lambda imu: imu._replace(gyr=np.rad2deg(imu.gyr)), "gyr of 'foot_right' must be in rad/s; it reaches"),
    "g": (lambda imu: imu._replace(acc=imu.acc / 9.80665), "is it in g?"),
    "mask": (lambda imu: imu._replace(mask=imu.mask[:-5]), "mask of 'foot_right' must have shape"),
    "axes": (lambda imu: imu._replace(gyr=imu.gyr[:, :2]), "gyr of 'foot_right' must have shape"),
}


def changed(change):
    recording = foot(strides=4).recording
    return recording._replace(sensors={"foot_right": change(recording.sensors["foot_right"])})


def test_a_cohort_lists_them_with_the_reason():
    walks = [Walk(changed(change)._replace(name=name), None, {}) for name, (change, _) in CASES.items()]
    reasons = evaluate.cohort(foot_ins.estimator(), walks).failures.set_index("recording")["reason"]
    assert set(reasons.index) == set(CASES)
    for name, (_, words) in CASES.items():
        assert words in reasons[name]


@pytest.mark.parametrize("name", [name for name in CASES if name != "g"])
def test_an_analysis_refuses_them(name):
    change, words = CASES[name]
    with pytest.raises(RecordingError) as error:
        analyse(changed(change))
    assert words in str(error.value)


@pytest.mark.parametrize("name", datasets.list_datasets())
def test_no_public_recording_is_near_another_unit(data, name):
    for walk in data(name):
        for imu in walk.recording.sensors.values():
            assert checks.fast_rate(imu) < 0.5 * checks.FASTEST
            assert checks.force_unit(imu)[1] == ""
