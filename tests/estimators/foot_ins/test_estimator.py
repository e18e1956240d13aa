import jax
import numpy as np
import pytest
from made.estimators import hidden, without
from made.foot import foot
from made.notes import texts
from made.trunk import rotation, worn
from scipy.spatial.transform import Rotation

from jgait import simulate
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import FootOptions, FootParams
from jgait.estimators.foot_ins import windows as foot_windows
from jgait.estimators.stride_flags import marks
from jgait.geometry.vectors import Vector
from jgait.types import Imu, Recording, RecordingError

STILL = FootParams(pivot_height=0.0, stride_noise=1e-4)
"""For feet that are made to stand quite still, and of which the model knows everything."""

MILLIMETRE = 1e-3


def estimated(made, p=STILL, options=foot_ins.DEFAULT):
    return foot_ins.estimate(p, made.recording, options)


@pytest.fixture(scope="module")
def straight():
    made = foot(strides=6)
    return made, estimated(made)


def test_lengths_heights_and_lift_of_a_straight_walk(straight):
    made, estimate = straight
    strides = estimate.strides
    np.testing.assert_allclose(strides.length, made.length, atol=MILLIMETRE)
    np.testing.assert_allclose(strides.height, 0.0, atol=MILLIMETRE)
    np.testing.assert_allclose(strides.lift, 0.12, atol=2 * MILLIMETRE)
    np.testing.assert_allclose(strides.turn, 0.0, atol=1e-3)
    np.testing.assert_allclose(estimate.distance[-1], 7.2, atol=6 * MILLIMETRE)
    np.testing.assert_allclose(estimate.feet.right.position[-1], [7.2, 0.0, 0.0], atol=6 * MILLIMETRE)
    assert np.all(strides.start < strides.end)
    assert np.all(np.diff(strides.end) > 0)
    assert np.all(strides.push_off_angle < -0.2)
    assert np.all(strides.contact_angle > 0.05)
    assert np.all(estimate.strides_stddev.length > 0.0005)


def test_the_path_may_be_that_of_another_point_and_strides_stay(straight):
    made, plain = straight
    point = np.array([0.02, -0.01, 0.05])
    moved = estimated(made, STILL._replace(tracked_point=Vector(*point)))
    w, x, y, z = plain.feet.right.orientation.T
    away = Rotation.from_quat(np.stack([x, y, z, w], axis=1)).apply(point)
    expected = plain.feet.right.position + away - away[moved.diagnostics["footholds_right"][0]]
    np.testing.assert_allclose(moved.feet.right.position, expected, atol=1e-9)
    np.testing.assert_array_equal(moved.strides.length, plain.strides.length)
    assert np.ptp(moved.feet.right.position - plain.feet.right.position, axis=0)[0] > 0.03


@pytest.mark.parametrize(
    "walk",
    [
        {"turns": [0.4] * 6},
        {"rises": [0.17, 0.17, 0.17, -0.17, -0.17, -0.17]},
        {"bias": (0.02, -0.03, 0.01)},
        {"length": [0.3, 0.6, 1.2, 1.6, 1.2, 0.6]},
        {"swing": 0.4, "stance": 0.25},
        {"seed": 1},
    ],
    ids=["turning", "stairs", "bias", "lengths", "fast", "noise"],
)
def test_other_walks(walk):
    made = foot(strides=6, **walk)
    estimate = estimated(made)
    strides = estimate.strides
    tolerance = 8 * MILLIMETRE if "seed" in walk else 2 * MILLIMETRE
    np.testing.assert_allclose(strides.length, made.length, atol=tolerance)
    np.testing.assert_allclose(strides.height, made.rise, atol=tolerance)
    np.testing.assert_allclose(strides.turn, made.turn, atol=8e-3)
    flagged = marks(estimate, foot_ins.estimator().about.flags)
    np.testing.assert_array_equal(flagged["stairs"], np.abs(made.rise) > 0.1)


@pytest.mark.parametrize("mount", [rotation(), np.diag([1.0, -1.0, -1.0])], ids=["any", "upside down"])
def test_mounting_changes_nothing(straight, mount):
    _, plain = straight
    turned = estimated(foot(strides=6, mount=mount))
    for name in ("length", "height", "turn", "lift", "contact_angle", "push_off_angle"):
        np.testing.assert_allclose(getattr(turned.strides, name), getattr(plain.strides, name), atol=2e-5)
    np.testing.assert_allclose(turned.feet.right.position, plain.feet.right.position, atol=1e-4)


def test_a_foot_that_rolls_over_the_ground_needs_the_pivot():
    """A sensor 8 cm over the point about which the standing foot turns goes forward while it stands."""
    made = foot(strides=6, roll=0.08, stance=0.5)
    imu = made.recording.sensors["foot_right"]
    # the sensor is 8 cm up the foot's own z axis from what was made
    point = np.array([0.0, 0.0, 0.08])
    spin = np.gradient(imu.gyr, 0.01, axis=0)
    acc = imu.acc + np.cross(spin, point) + np.cross(imu.gyr, np.cross(imu.gyr, point))
    high = made._replace(recording=worn(made.recording, acc=acc))
    errors = {
        height: np.abs(estimated(high, FootParams(pivot_height=height)).strides.length - made.length).mean()
        for height in (0.0, 0.08)
    }
    assert errors[0.08] < 0.5 * errors[0.0]


@pytest.mark.release
def test_the_filter_can_take_the_ground_as_level():
    made = foot(strides=6, seed=2)
    strides = estimated(made, options=FootOptions(level=True)).strides
    np.testing.assert_allclose(strides.height, 0.0, atol=1e-4)
    np.testing.assert_allclose(strides.length, made.length, atol=8 * MILLIMETRE)


def test_heights_that_errors_can_explain_are_flattened_in_the_trajectory_alone():
    made = foot(strides=6, seed=2)
    auto, raw = (estimated(made, options=FootOptions(level=level)) for level in ("auto", False))
    steps = auto.diagnostics["footholds_right"]
    np.testing.assert_allclose(auto.feet.right.position[steps, 2], 0.0, atol=1e-9)
    assert np.abs(raw.feet.right.position[steps, 2]).max() > 1e-4
    np.testing.assert_array_equal(auto.strides.height, raw.strides.height)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"level": "flat"}, "level must be True, False or 'auto'; got 'flat'"),
        ({"noise": "cubic"}, "one of constant, log_linear, network; got 'cubic'"),
    ],
)
def test_options_that_are_none_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        foot_ins.estimator(FootOptions(**options))


def test_a_stride_of_which_too_much_is_lost_is_left_out(straight):
    made, plain = straight
    lost = int(100 * (made.lift_off[2] + 0.05))
    estimate = foot_ins.estimate(STILL, without(made.recording, lost / 100.0 - 0.005, 0.4))
    assert "1 stride of foot_right is left out" in " ".join(texts(estimate.diagnostics["notes"]))
    assert len(estimate.strides.length) == 5
    np.testing.assert_allclose(estimate.strides.length, 1.2, atol=5 * MILLIMETRE)
    assert not estimate.valid[lost + 20]
    assert estimate.valid[lost - 80]
    assert estimate.distance[-1] == pytest.approx(plain.distance[-1] - 1.2, abs=0.02)


def test_both_feet_share_a_program_and_an_estimate(straight):
    made, plain = straight
    left = foot(strides=6, side="left").recording.sensors
    both = foot_ins.estimate(STILL, made.recording._replace(sensors={**made.recording.sensors, **left}))
    assert len(both.strides.length) == 12
    for side in (0, 1):
        np.testing.assert_allclose(both.strides.length[both.strides.side == side], plain.strides.length, atol=1e-9)
    np.testing.assert_allclose(both.distance, plain.distance, atol=1e-9)


def changed(**fields):
    return worn(foot(strides=2).recording, **fields)


def spun():
    time = np.arange(1000) / 100.0
    gyr = np.stack([4.0 + np.sin(9.0 * time), np.cos(7.0 * time), 0 * time], axis=1)
    return Recording({"foot_right": Imu(time, gyr, np.tile([0.0, 0.0, 9.81], (1000, 1)), np.ones(1000, bool))}, 100.0)


IMU = foot(strides=2).recording.sensors["foot_right"]


@pytest.mark.parametrize(
    ("recording", "message"),
    [
        (Recording({"thigh_right": IMU}, 100.0), r"needs 'foot_right' or 'foot_left'; .* has \['thigh_right'\]"),
        (changed(time=4.0 * IMU.time), "45 Hz or more; the recording has 25.0 Hz"),
        (changed(acc=4.0 * IMU.acc), "must read 9.81 m/s² at rest; it reads 39"),
        (spun(), "never stands"),
        (
            Recording({"foot_right": IMU, "foot_left": IMU._replace(time=IMU.time + 0.02)}, 100.0),
            "both feet on one clock",
        ),
    ],
    ids=["placement", "slow", "unit", "spinning", "clocks"],
)  # fmt: skip
def test_what_cannot_be_used_is_refused_in_words(recording, message):
    with pytest.raises(RecordingError, match=message):
        foot_ins.estimate(FootParams(), recording)


def test_standing_alone_is_an_empty_table():
    estimate = foot_ins.estimate(STILL, changed(gyr=0.0 * IMU.gyr, acc=np.tile([0.0, 0.0, 9.81], (len(IMU.time), 1))))
    assert estimate.strides.length.size == 0
    np.testing.assert_allclose(estimate.distance, 0.0)


def test_strides_of_a_shuffling_foot_have_turns_and_angles():
    """No stride is long enough to say alone where forward is; they say it together."""
    long, short = (estimated(foot(strides=6, length=length, turns=0.2)).strides for length in (1.2, 0.25))
    np.testing.assert_allclose(short.turn, long.turn, atol=0.02)
    np.testing.assert_allclose(short.contact_angle, long.contact_angle, atol=0.03)
    assert np.all(long.turn > 0.18)
    assert np.all(long.contact_angle > 0.05)


@pytest.mark.release
def test_a_recording_in_windows_is_that_of_one_run(monkeypatch):
    made = foot(strides=26, length=1.1, turns=[0.12] * 26, bias=(0.01, -0.01, 0.02), seed=4, stance=0.45)
    whole = foot_ins.estimate(STILL, made.recording)
    monkeypatch.setattr(foot_windows, "WINDOW", 1024)
    monkeypatch.setattr(foot_windows, "OVERLAP", 500)
    parts = foot_windows.windows(foot_ins.prepared(made.recording).inputs.right, len(whole.time))
    assert len(parts) > 3
    assert [part.first for part in parts[1:]] == [part.last for part in parts[:-1]]
    cut = foot_ins.estimate(STILL, made.recording)
    np.testing.assert_allclose(cut.strides.length, whole.strides.length, atol=3e-3)
    np.testing.assert_allclose(cut.strides.start, whole.strides.start, atol=1e-9)
    np.testing.assert_allclose(cut.strides_stddev.length, whole.strides_stddev.length, rtol=0.05)
    # what is added up: heading over 26 strides, and the way
    np.testing.assert_allclose(cut.feet.right.position, whole.feet.right.position, atol=0.1)
    dots = np.abs(np.sum(cut.feet.right.orientation * whole.feet.right.orientation, axis=1))
    assert dots.min() > np.cos(0.01)
    np.testing.assert_allclose(cut.distance, whole.distance, atol=0.02)
    assert np.all(np.diff(cut.feet_stddev.right.orientation[::300, 2]) > 0.0)


def test_rest_is_found_between_scattered_losses(straight):
    made, plain = straight
    lost = np.random.default_rng(4).random(len(plain.time)) <= 0.2
    found = foot_ins.estimate(STILL, hidden(made.recording, lost))
    assert not any("never rests" in note for note in texts(found.diagnostics["notes"]))
    assert len(found.strides.length) == len(plain.strides.length)


def test_a_foot_that_rests_for_minutes_has_footholds_on_the_way():
    made = foot(strides=3, rest=50.0)
    inputs = foot_ins.prepared(made.recording).inputs.right
    holds = inputs.foothold[: int(inputs.count)]
    assert len(holds) > 4
    assert np.diff(holds).max() <= 4100


@pytest.mark.parametrize("row", [0, 2])
def test_a_very_slow_first_step_is_one_swing(row):
    """A foot that is set down slowly hardly turns just before it lies flat: the first half-step seemed to end there."""
    people = simulate.population(jax.random.key(11), 12, recorded=True)
    person, along = simulate.person_of(people, row), simulate.straight(2.0)
    usual = person.gait.stride_length / person.gait.stride_time
    walker = simulate.covering(jax.random.key(0), simulate.paced(person, float(np.sqrt(0.3 / usual))), along)
    feet = ("foot_left", "foot_right")
    recording, truth = simulate.recording(jax.random.key(100 + row), walker, along, placements=feet)
    found = foot_ins.estimate(foot_ins.FootParams(), recording)
    k = int(np.argmin(np.where(truth.strides.valid, truth.strides.end, np.inf)))
    here = np.flatnonzero(np.asarray(found.strides.valid) & (np.asarray(found.strides.side) == truth.strides.side[k]))
    assert found.strides.length[here[0]] == pytest.approx(float(truth.strides.length[k]), abs=0.06)
