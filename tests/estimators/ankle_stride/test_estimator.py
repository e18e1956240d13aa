"""Strides of made shanks whose way is known, and what every estimator owes."""

import jax
import numpy as np
import pytest
from made.estimators import masked, without
from made.notes import of_code, texts
from made.shank import shank
from made.trunk import cut, imu_of, rotation, worn

from jgait import simulate
from jgait.estimators import ankle_stride, programs
from jgait.estimators.ankle_stride import AnkleOptions, AnkleParams
from jgait.estimators.ankle_stride import length as stride_length
from jgait.estimators.ankle_stride.length import StrideLengthParams
from jgait.estimators.interface import pad

MILLIMETRE = 1e-3
P = AnkleParams()
RUN = programs.compiled(ankle_stride.run)


def estimated(made, p=P, options=ankle_stride.DEFAULT):
    return ankle_stride.estimate(p, made.recording, options)


def ready(made, options=ankle_stride.DEFAULT):
    return pad(ankle_stride.prepared(made.recording, options).inputs, programs.BUCKET)


@pytest.fixture(scope="module")
def straight():
    made = shank()
    return made, estimated(made)


def test_a_straight_walk(straight):
    made, estimate = straight
    strides = estimate.strides
    np.testing.assert_allclose(strides.length, made.length, atol=MILLIMETRE)
    np.testing.assert_allclose(strides.height, 0.0, atol=8 * MILLIMETRE)
    np.testing.assert_allclose(strides.turn, 0.0, atol=1e-3)
    np.testing.assert_allclose(strides.end, made.contact, atol=0.05)
    np.testing.assert_allclose(strides.final_contact, made.lift_off, atol=0.05)
    np.testing.assert_allclose(strides.speed[1:], strides.length[1:] / np.diff(strides.end), rtol=1e-12)
    np.testing.assert_allclose(estimate.distance[-1], 4.8, atol=3 * MILLIMETRE)
    assert np.all(np.diff(estimate.distance) >= -1e-12)
    np.testing.assert_allclose(estimate.diagnostics["lever_right"], [0.0, 0.0, 0.18], atol=2 * MILLIMETRE)
    assert estimate.diagnostics["half"].tolist() == [True, False, False, True]
    assert not any(estimate.diagnostics[name].any() for name in ("turning", "stairs", "clipped"))
    assert np.all((estimate.strides_stddev.length > 0.01) & (estimate.strides_stddev.length < 0.04))
    assert estimate.strides.length.dtype == np.float64


@pytest.mark.parametrize(
    ("walk", "flag"),
    [
        ({"turns": 0.5}, "turning"),
        ({"rises": [0.17, 0.17, -0.17, -0.17]}, "stairs"),
        ({"bias": (0.02, -0.01, 0.03)}, None),
        ({"length": [0.4, 0.8, 1.2, 1.5]}, None),
        ({"seed": 1}, None),
    ],
    ids=["turning", "stairs", "bias", "lengths", "noise"],
)
def test_other_walks(walk, flag):
    made = shank(**walk)
    estimate = estimated(made)
    tolerance = 12 * MILLIMETRE if "seed" in walk else 7 * MILLIMETRE
    np.testing.assert_allclose(estimate.strides.length, made.length, atol=tolerance)
    np.testing.assert_allclose(estimate.strides.height, made.rise, atol=2 * tolerance)
    np.testing.assert_allclose(estimate.strides.turn, made.turn, atol=0.01)
    for name in ("turning", "stairs", "clipped"):
        assert estimate.diagnostics[name].all() == (name == flag)


def test_a_lever_that_is_not_as_believed_is_looked_for_within_its_spread():
    made = shank(lever=(0.0, 0.0, 0.12))
    sure = estimated(made, AnkleParams(lever_along_sd=1e-4))
    free = estimated(made, AnkleParams(lever_along_sd=0.1))
    off = [np.abs(e.strides.length - made.length).mean() for e in (sure, free)]
    assert off[1] < 0.5 * off[0]
    assert abs(free.diagnostics["lever_right"][2] - 0.12) < 0.03


def test_a_sensor_at_the_ankle_has_a_lever_of_its_own():
    made = shank(lever=(0.0, 0.0, 0.03), placement="ankle_left")
    inputs = ready(made)._replace(right=ready(made).left, left=None)
    strides = RUN(AnkleParams(), inputs, options=ankle_stride.DEFAULT).strides
    np.testing.assert_allclose(strides.length[:4], made.length, atol=MILLIMETRE)


def test_a_bias_that_was_not_measured_at_rest_is_estimated():
    made = shank(bias=(0.02, 0.02, 0.0), strides=4)
    unread = ready(made, options=AnkleOptions(standing=False))
    assert unread.right.still_time == 0.0
    strides = RUN(AnkleParams(), unread, options=ankle_stride.DEFAULT).strides
    np.testing.assert_allclose(strides.length[:4], made.length, rtol=0.01)


def test_mounting_changes_nothing(straight):
    _, plain = straight
    for mount in (rotation(), np.diag([1.0, -1.0, -1.0])):
        turned = estimated(shank(mount=mount))
        for name in ("length", "height", "turn", "end"):
            np.testing.assert_allclose(getattr(turned.strides, name), getattr(plain.strides, name), atol=1e-6)


@pytest.mark.parametrize("at", [0.0, 0.3, 0.6, 0.9])
def test_a_recording_that_begins_and_ends_in_walking_and_a_sensor_that_stops_in_it(at):
    recording = shank(strides=8).recording
    whole = ankle_stride.estimate(P, cut(recording, 1.9 + at, 1.9 + at + 5.49))
    assert whole.diagnostics["nis_right"] < 0.2
    imu = imu_of(recording)
    stops = ankle_stride.estimate(P, worn(recording, **masked(imu, imu.time < 5.5 + at)._asdict()))
    for estimate in (whole, stops):
        assert 4 <= len(estimate.strides.length) <= 5
        np.testing.assert_array_less(abs(estimate.strides.length - 1.2), 3.0 * estimate.strides_stddev.length)


def test_swings_too_small_to_be_strides_are_noted():
    made = shank(strides=6)
    imu = imu_of(made.recording)
    slow = worn(made.recording, gyr=imu.gyr * np.where(imu.time > made.lift_off[3] - 0.1, 0.25, 1.0)[:, None])
    for recording, noted in ((made.recording, []), (slow, [(3, 3)])):
        notes = of_code(ankle_stride.prepared(recording).notes, "swings_too_small")
        assert [(note.values["swings"], note.values["strides"]) for note in notes] == noted


def test_scattered_losses_are_bridged():
    made = shank(strides=5)
    imu = imu_of(made.recording)
    mask = np.random.default_rng(2).random(len(imu.time)) > 0.2  # more than 0.25 s of some strides, in single samples
    estimate = ankle_stride.estimate(P, worn(made.recording, **masked(imu, mask)._asdict()))
    np.testing.assert_allclose(estimate.strides.length, made.length, atol=0.1)


def test_standing_alone_is_an_empty_table():
    walk = shank(strides=2).recording
    still = worn(walk, gyr=0.0 * imu_of(walk).gyr, acc=np.tile([0.0, 0.0, 9.81], (len(imu_of(walk).time), 1)))
    estimate = ankle_stride.estimate(P, still)
    assert estimate.strides.length.size == estimate.strides_stddev.length.size == 0
    assert not estimate.valid.any()
    np.testing.assert_array_equal(estimate.distance, 0.0)
    assert "shank_right does not walk" in texts(estimate.diagnostics["notes"])


def test_lost_samples_and_clipped_swings_are_noted():
    made = shank(seed=2)
    lost, plain = ankle_stride.estimate(P, without(made.recording, 2.5, 0.05)), estimated(made)
    assert len(lost.strides.length) == 4
    assert lost.strides_stddev.length[1] > 1.05 * plain.strides_stddev.length[1]
    assert any("5 samples of shank_right are lost" in note for note in texts(lost.diagnostics["notes"]))
    gyr = imu_of(made.recording).gyr.copy()
    gyr[:, 1] = np.maximum(2.0 * gyr[:, 1], -4.2)  # twice as fast, and a range that this passes
    inputs = ankle_stride.prepared(worn(made.recording, gyr=gyr))
    assert inputs.inputs.right.clips[: int(inputs.inputs.right.count)].all()
    assert any("shank_right: the gyroscope clips" in note for note in texts(inputs.notes))


METHODS = {"3d": 0.02, "sl1": 0.7, "sl2": 0.7}


@pytest.mark.release
@pytest.mark.parametrize("method", METHODS)
def test_the_papers_methods_measure_and_state_no_deviations(method):
    made = shank()
    told = RUN(AnkleParams(), ready(made), options=AnkleOptions(length=method))
    np.testing.assert_allclose(told.strides.length[:4], made.length, atol=METHODS[method])
    assert told.strides_stddev is None


@pytest.mark.parametrize("detector", ["machine", "paper"])
def test_other_detectors_find_the_strides_of_a_clean_walk(detector):
    made = shank(strides=5)
    inputs = ankle_stride.prepared(made.recording, AnkleOptions(detector=detector)).inputs.right
    assert int(inputs.count) == 5
    assert np.all(inputs.end[: int(inputs.count)] > inputs.begin[: int(inputs.count)])


def test_options_parameters_and_measures_that_are_none_are_refused():
    made = shank(strides=2)
    with pytest.raises(ValueError, match="length must be one of filter, 3d, sl1, sl2; got 'long'"):
        estimated(made, options=AnkleOptions(length="long"))
    with pytest.raises(ValueError, match="detector must be one of swings.*; got 'eye'"):
        estimated(made, options=AnkleOptions(detector="eye"))
    assert ankle_stride.with_body(AnkleParams(), {"leg_length": (0.8, 0.9)}).leg_length == pytest.approx(0.85)


@pytest.mark.parametrize("row", [2, 3])
def test_slow_half_steps_end_after_the_foot_lies_flat(row):
    """At 0.5 m/s the shank turns least before the foot lies flat: walks of three steps were too short."""
    people = simulate.population(jax.random.key(11), 12, recorded=True)
    person = simulate.person_of(people, row)
    usual = person.gait.stride_length / person.gait.stride_time
    person = simulate.paced(person, float(np.sqrt(0.5 / usual)))
    person = person._replace(gait=person.gait._replace(steps=3.0))
    legs = ("shank_right", "shank_left")
    recording, truth = simulate.recording(jax.random.key(100 + row), person, None, rate=100.0, placements=legs)
    found = ankle_stride.estimate(AnkleParams(lever_shank=0.18), recording)
    assert float(found.distance[-1]) == pytest.approx(float(truth.estimate.distance[-1]), rel=0.055)


RATE = 200.0


def swing(angle, samples):
    """A sagittal rate that turns by an angle, forwards, in so many samples, its ends at zero."""
    lobe = np.sin(np.pi * np.arange(samples + 1) / samples)
    return -angle * lobe / (lobe.sum() / RATE)


def test_pendulum_knows_the_angle_of_each_swing():
    rate = np.concatenate([np.zeros(10), swing(1.0, 60), np.zeros(30), swing(1.2, 80), np.zeros(5)])
    gyr = np.stack([0.3 + 0 * rate, rate, 0 * rate], axis=1)
    p = StrideLengthParams(leg_length=0.9, angle_gain=0.88, time_gain=0.1)
    told = stride_length.pendulum(p, gyr, np.array([10, 101]), np.array([70, 181]), 1.0 / RATE)
    np.testing.assert_allclose(told.angle, [1.0, 1.2], rtol=1e-10)
    np.testing.assert_allclose(told.duration, [0.3, 0.4], rtol=1e-10)
    np.testing.assert_allclose(told.chord, 1.8 * np.sin([0.5, 0.6]), rtol=1e-10)
    np.testing.assert_allclose(told.arc, 0.9 * np.array([0.88 + 0.1 / 0.3, 1.2 * (0.88 + 0.1 / 0.4)]), rtol=1e-10)
