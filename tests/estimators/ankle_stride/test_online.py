"""The ankle's estimator a sample at a time, on walks that are known."""

import numpy as np
import pytest
from made.shank import REST, shank

from experiments.silva2017.online import table, walk
from jgait.estimators.ankle_stride import AnkleParams
from jgait.estimators.ankle_stride import online as ankle_online
from jgait.types import Imu, Recording, RecordingError

P = AnkleParams()
SAMPLES = 700
MILLIMETRE = 1e-3
MOUNT = np.array([[0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.8, 0.0, 0.6]])


def walked(made, worn, measured=None):
    """A made walk as a device saw it, standing on behind its end so that one program serves all."""
    imu = made.recording.sensors["shank_right"]
    index = np.minimum(np.arange(SAMPLES), len(imu.time) - 1)
    measured = np.ones(SAMPLES, bool) if measured is None else measured
    return walk(P, worn, imu.gyr[index], imu.acc[index], measured)


@pytest.fixture(scope="module")
def calibrated():
    """Another walk of the same leg: how the sensor is worn."""
    made = shank(strides=3, length=1.0, mount=MOUNT, bias=(0.01, -0.02, 0.01))
    return ankle_online.worn(P, made.recording, "right")


@pytest.fixture(scope="module")
def straight(calibrated):
    made = shank(strides=4, seed=1, mount=MOUNT, bias=(0.01, -0.02, 0.01))
    return made, walked(made, calibrated)


def test_every_stride_is_known_soon_and_is_as_long_as_it_was(straight):
    made, now = straight
    strides, stddev, flags = table(now)
    np.testing.assert_allclose(strides.length, made.length, atol=8 * MILLIMETRE)
    np.testing.assert_allclose(strides.height, 0.0, atol=25 * MILLIMETRE)
    np.testing.assert_allclose(strides.turn, 0.0, atol=0.01)
    np.testing.assert_allclose(strides.end, made.contact, atol=0.05)
    np.testing.assert_allclose(strides.final_contact, made.lift_off, atol=0.05)
    assert np.all((stddev.length > 0.01) & (stddev.length < 0.04))
    # within a stance: the valley in its middle, as long as it has to last, and the filter's lag
    assert np.all((flags["known"] / 100.0 - made.contact > 0.2) & (flags["known"] / 100.0 - made.contact < 0.9))
    assert flags["half"].tolist() == [True, False, False, False]
    assert not flags["turning"].any()
    assert not flags["stairs"].any()
    assert np.all(strides.side == 0)
    assert now.stands[int(0.8 * REST * 100)]
    assert not now.stands[300]


def test_turns_and_stairs(calibrated):
    for route, flag in (({"turns": 0.5}, "turning"), ({"rises": [0.17, 0.17, -0.17, -0.17]}, "stairs")):
        made = shank(strides=4, mount=MOUNT, bias=(0.01, -0.02, 0.01), **route)
        strides, _, flags = table(walked(made, calibrated))
        np.testing.assert_allclose(strides.length, made.length, atol=10 * MILLIMETRE)
        np.testing.assert_allclose(strides.height, made.rise, atol=20 * MILLIMETRE)
        np.testing.assert_allclose(strides.turn, made.turn, atol=0.01)
        for name in ("turning", "stairs"):
            assert flags[name].all() == (name == flag)


def test_lost_samples_are_not_looked_at_and_cost_certainty(calibrated, straight):
    made, now = straight
    imu = made.recording.sensors["shank_right"]
    measured = np.ones(SAMPLES, bool)
    measured[270:274] = False
    garbled = [np.where(measured[: len(imu.time), None], values, 99.0) for values in (imu.gyr, imu.acc)]
    worse = made._replace(recording=Recording({"shank_right": imu._replace(gyr=garbled[0], acc=garbled[1])}, 100.0))
    strides, stddev, _ = table(walked(worse, calibrated, measured))
    _, plain, _ = table(now)
    np.testing.assert_allclose(strides.length, made.length, atol=0.2)
    assert stddev.length[1] > 1.05 * plain.length[1]
    at = round(float(made.lift_off[1]) * 100.0)
    measured[at + 5 : at + 35] = False  # most of the second swing
    assert len(table(walked(worse, calibrated, measured))[0].length) == len(made.length) - 1


def test_who_stands_makes_no_strides(calibrated):
    imu = shank(strides=1).recording.sensors["shank_right"]
    gyr, acc = np.tile([0.01, -0.02, 0.01], (SAMPLES, 1)), np.tile(np.array([0.0, 0.0, 9.81]) @ MOUNT, (SAMPLES, 1))
    still = shank(strides=1)._replace(recording=Recording({"shank_right": Imu(imu.time, gyr, acc, imu.mask)}, 100.0))
    now = walked(still, calibrated)
    assert not now.stride.any()
    assert now.stands[-1]


def test_a_recording_without_a_walk_of_that_leg_is_refused():
    made = shank(strides=2)
    with pytest.raises(RecordingError, match="left sensor is worn; this one has no sensor there"):
        ankle_online.worn(P, made.recording, "left")
    imu = made.recording.sensors["shank_right"]
    still = Recording({"shank_right": imu._replace(gyr=0.0 * imu.gyr)}, 100.0)
    with pytest.raises(RecordingError, match="right sensor is worn; this one does not walk there"):
        ankle_online.worn(P, still, "right")
