"""Set-ups of a study: degraded recordings, and the errors that they give."""

import math

import jax
import numpy as np
import pytest

from jgait import simulate
from jgait.evaluate import study
from jgait.evaluate.study import Setup
from jgait.simulate import sensors
from jgait.types import Imu, Recording, RecordingError


def recording(rate, signal, seconds=10.0):
    time = np.arange(round(seconds * rate)) / rate
    values = signal(time)[:, None] * np.array([1.0, 0.5, 0.0])
    return Recording({"waist": Imu(time, values, 10.0 * values, np.ones(time.size, bool))}, rate)


def test_a_lower_rate_is_the_mean_over_its_interval():
    rate, low = 200.0, 50.0
    made = study.degraded(recording(rate, lambda t: np.sin(2.0 * np.pi * t)), Setup(("waist",), low))
    imu = made.sensors["waist"]
    np.testing.assert_allclose(np.diff(imu.time), 1.0 / low, rtol=1e-9)
    assert made.sampling_rate_hz == low
    loss = np.sinc(1.0 / low)  # the mean of a sine over an interval
    np.testing.assert_allclose(imu.gyr[:, 0], loss * np.sin(2.0 * np.pi * imu.time), atol=3e-4)
    fast = study.degraded(recording(rate, lambda t: np.sin(2.0 * np.pi * low * t)), Setup(("waist",), low))
    assert np.abs(fast.sensors["waist"].gyr).max() < 0.2  # a frequency that the rate cannot show


def test_the_same_rate_changes_no_sample_and_ranges_clip_it():
    whole = recording(100.0, lambda t: np.sin(2.0 * np.pi * t))
    np.testing.assert_array_equal(study.degraded(whole, Setup(("waist",), 100.0)).sensors["waist"].gyr,
                                  whole.sensors["waist"].gyr)  # fmt: skip
    made = study.degraded(whole, Setup(("waist",), 100.0, acc_range=4.0, gyr_range=0.3, seconds=2.0)).sensors["waist"]
    assert np.abs(made.acc).max() == 4.0
    assert np.abs(made.gyr).max() == 0.3
    assert made.time[-1] <= 2.0


def test_what_a_recording_lacks_is_named():
    whole = recording(50.0, np.sin)
    with pytest.raises(RecordingError, match="needs 'foot_left'"):
        study.degraded(whole, Setup(("foot_left",), 50.0))
    with pytest.raises(RecordingError, match="50 Hz, less than 100 Hz"):
        study.degraded(whole, Setup(("waist",), 100.0))
    with pytest.raises(ValueError, match="measure must be one of stride_length"):
        study.plan([], [Setup(("waist",))])


def test_set_ups_have_the_errors_of_their_estimates():
    walks = study.people(jax.random.key(0), 3, metres=12.0, placements=("waist",), rate_hz=100.0)
    choices = study.setups(placements=[("waist",)], rate_hz=[50.0, 100.0, 200.0])
    table = study.plan(walks, choices, people=4)
    assert list(table["walks"]) == [3, 3, 0]
    assert "less than 200 Hz" in table["reason"][2]
    for row in table.to_dict("records")[:2]:
        assert row["expected"] == pytest.approx(math.sqrt(row["bias"] ** 2 + row["sd"] ** 2 / 4.0))
        assert 0.0 < row["expected"] < row["stride_rmse"] < 0.3


def test_a_recording_at_full_quality_differs_from_its_own_truth_by_nothing_but_what_it_states():
    sensor = sensors.MPU6000._replace(packet_loss=0.0)
    walk, _ = simulate.recording(jax.random.key(3), None, simulate.straight(15.0), sensor, placements=("waist",))
    known = study.own_truth(walk, Setup(("waist",)))
    same, slow = study.plan([known], study.setups(placements=[("waist",)], rate_hz=[100.0, 50.0])).to_dict("records")
    assert same["bias"] == pytest.approx(0.0, abs=1e-9)
    spread = known.reference.strides_stddev.length
    assert same["stride_rmse"] == pytest.approx(float(np.sqrt(np.mean(np.square(spread)))), rel=1e-6)
    assert slow["stride_rmse"] > same["stride_rmse"]
