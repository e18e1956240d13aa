"""Doubt about strides and recordings, on simulated feet that stand as the model says and on feet that do not."""

import numpy as np
import pytest
from made.estimators import masked
from made.foot import foot
from made.notes import codes, of_code
from made.shank import shank
from made.trunk import imu_of, worn

from jgait import estimators
from jgait.estimators import ankle_stride, foot_ins
from jgait.estimators.foot_ins import FootParams
from jgait.estimators.stride_flags import DOUBTFUL
from jgait.quality import model, trust


@pytest.fixture(scope="module")
def walk():
    return foot(strides=4, roll=0.03, seed=1).recording


def test_a_foot_that_stands_is_trusted(walk):
    found = trust(foot_ins.estimate(FootParams(), walk))
    assert found.recording and found.strides is not None and found.strides.all()


def test_a_foot_that_slides_in_stance_is_in_doubt(walk):
    imu = walk.sensors["foot_right"]
    # the ground moves to and fro by some centimetres, twice a second
    shaken = np.array(imu.acc) + 3.0 * np.sin(4.0 * np.pi * np.asarray(imu.time))[:, None] * np.array([1.0, 0.0, 0.0])
    estimate = foot_ins.estimate(FootParams(), worn(walk, acc=shaken))
    found = trust(estimate)
    assert not found.recording and found.strides is not None and not found.strides.all()
    assert of_code(estimate.diagnostics["notes"], "strides_doubtful")
    np.testing.assert_array_equal(DOUBTFUL.read(estimate), ~found.strides)


@pytest.mark.parametrize("slides", [False, True])
def test_a_gap_puts_no_stances_in_doubt_but_sliding_does(slides):
    made = foot(strides=8, roll=0.03, seed=1)
    imu = made.recording.sensors["foot_right"]
    time = np.asarray(imu.time)
    lost = (time >= 4.9) & (time < 5.5)
    shaken = 6.0 * slides * np.sin(4.0 * np.pi * time)[:, None] * np.array([1.0, 0.0, 0.0])
    walk = worn(made.recording, **masked(imu._replace(acc=imu.acc + shaken), ~lost)._asdict())
    estimate = foot_ins.estimate(FootParams(), walk)
    assert (estimate.diagnostics["nis_right"] > 0.15) == slides
    assert bool(of_code(estimate.diagnostics["notes"], "strides_doubtful")) == slides == (not trust(estimate).recording)
    assert any("60 samples of foot_right are lost, at most 0.60 s in a row" in str(note)
               for note in estimate.diagnostics["notes"])  # fmt: skip


@pytest.mark.parametrize("make", [foot, shank])
@pytest.mark.parametrize(("begin", "seconds"), [(5.65, 0.2), (5.0, 0.4), (5.26, 0.9), (5.52, 1.2)])
def test_strides_about_a_gap_err_as_stated_or_are_left_out(make, begin, seconds):
    """Whether it takes a stance, a swing or both; strides far from it are as certain as without it."""
    recording = make(strides=8, seed=1).recording
    time = imu_of(recording).time
    walk = worn(recording, mask=(time < begin) | (time >= begin + seconds))
    estimator = estimators.get("foot_ins" if make is foot else "ankle_stride")
    strides, deviations = (
        getattr(estimator.estimate(estimator.params, walk), part) for part in ("strides", "strides_stddev")
    )
    assert len(strides.length) >= 5
    assert np.all(np.abs(strides.length - 1.2) < 3.0 * deviations.length)
    away = (strides.end < begin) | (strides.start > begin + seconds + 1.0)
    assert away.sum() >= 4
    assert np.all(deviations.length[away] < 0.04)


@pytest.mark.parametrize(
    ("make", "module", "factor"), [(foot, foot_ins, 0.9), (shank, ankle_stride, 1.1)], ids=["foot", "shank"]
)
def test_an_accelerometer_far_off_at_rest_makes_lengths_less_certain(make, module, factor):
    made = make(strides=5)
    off = worn(made.recording, acc=factor * imu_of(made.recording).acc)
    plain, found = (module.estimator().estimate(module.estimator().params, one) for one in (made.recording, off))
    noted, usual = (codes(one.diagnostics["notes"]) for one in (found, plain))
    assert "accelerometer_off" in noted and "accelerometer_scale" not in noted and "accelerometer_off" not in usual
    assert any(f"differs from gravity by {100.0 * (factor - 1.0):+.1f} %" in str(n) for n in found.diagnostics["notes"])
    error = np.abs(found.strides.length - made.length)
    assert np.all(error < 2.0 * found.strides_stddev.length) and error.mean() > 2.0 * plain.strides_stddev.length.mean()
    total = np.abs(found.distance[-1] - np.sum(made.length))
    assert total < 2.0 * found.diagnostics["distance_stddev"][-1]


def test_strides_of_a_shank_that_is_sampled_slowly_err_as_stated():
    made = shank(strides=6, hz=30.0)
    found = ankle_stride.estimate(ankle_stride.AnkleParams(), made.recording)
    assert of_code(found.diagnostics["notes"], "sampled_slowly")
    assert np.all(np.abs(found.strides.length - made.length) < 3.0 * found.strides_stddev.length)


@pytest.mark.parametrize(("uncertain", "unusable"), [(1, False), (2, False), (3, True), (10, True)])
def test_a_sensor_is_useless_only_if_more_than_a_few_of_its_strides_are(uncertain, unusable):
    notes = model.doubts_of("foot_right", uncertain, 0, 10)
    assert codes(notes) == ["stances_rare"] * unusable
    assert all(f"{uncertain} of 10 strides are uncertain by more than 0.25 m" in note.text for note in notes)
