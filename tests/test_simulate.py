"""The simulated walk is what it says: closed, planted, smooth, exactly differentiated, and like a person."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait import simulate
from jgait.sensors import DEGREE, GRAVITY, IDEAL, IDG300, SensorNoise
from jgait.simulate import Person
from jgait.walker import SEGMENTS, body_pose, forward_kinematics, moment, motion, step_clock

DEFAULT = Person()
PLANTED = Person(roll_over=0.0)
moving = jax.jit(motion)
walking = jax.jit(simulate.walk)


RATE = 400.0
TIME = jnp.asarray(np.arange(4000) / RATE)
"""10 s, longer than the default walk; one grid for all tests, so that the walk compiles once."""


def clock(person):
    return np.asarray(step_clock(person, TIME))


@pytest.fixture(scope="module")
def exact():
    """The default person with perfect sensors."""
    return walking(jax.random.key(0), DEFAULT, TIME, IDEAL)


def test_integrating_the_gyroscope_gives_the_angle_and_the_error_falls_with_the_square_of_the_step(exact):
    signals, truth = exact
    angle = np.asarray(truth.legs.left.hip_angle - truth.legs.left.knee_angle)
    gyr = np.asarray(signals.shank_left.gyr)[:, 2]
    errors = []
    for stride in (4, 2, 1):
        rate, true = gyr[::stride], angle[::stride]
        integral = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) * stride / (2.0 * RATE))])
        errors.append(np.abs(integral - true + true[0]).max())
    assert errors[0] < 2e-3
    for coarse, fine in itertools.pairwise(errors):
        assert 3.5 < coarse / fine < 4.5


def test_two_links_close_and_the_feet_are_where_the_hip_and_the_leg_put_them(exact):
    _, truth = exact
    for side in ("right", "left"):
        leg = getattr(truth.legs, side)
        x, y = forward_kinematics(DEFAULT, leg.hip_angle, leg.knee_angle)
        np.testing.assert_allclose(x, leg.x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(y, leg.y, rtol=0, atol=1e-9)
        foot = truth.distance + leg.x - leg.x[0]
        np.testing.assert_allclose(foot, truth.diagnostics[f"foot_displacement_{side}"], rtol=0, atol=1e-12)


@pytest.mark.parametrize("steps", [1.0, 2.0, 5.0, 6.0])
@pytest.mark.parametrize("right_first", [0.0, 1.0])
def test_hip_and_both_feet_end_parallel_after_the_distance_asked_for(steps, right_first):
    person = Person(steps=steps, right_first=right_first)
    simulate.check_person(person)
    _, truth = walking(jax.random.key(0), person, TIME, IDEAL)
    asked = steps * person.step_length
    assert float(truth.distance[-1]) == pytest.approx(asked, abs=1e-12)
    for side in ("right", "left"):
        assert float(truth.diagnostics[f"foot_displacement_{side}"][-1]) == pytest.approx(asked, abs=1e-12)
    first = "right" if right_first else "left"
    other = "left" if right_first else "right"
    halfway = int((person.quiet_before + person.step_time) * RATE)
    assert truth.diagnostics[f"foot_displacement_{first}"][halfway] > 0.1
    assert truth.diagnostics[f"foot_displacement_{other}"][halfway] < 0.05


def test_without_roll_over_the_ankle_that_bears_stands_still():
    _, truth = walking(jax.random.key(0), PLANTED, TIME, IDEAL)
    u = clock(PLANTED)
    margin = 0.5 * PLANTED.double_support + 1e-6
    for j in range(1, 7):  # the right foot leads: odd feet are right
        side = "right" if j % 2 else "left"
        bears = (u > j + margin) & (u < j + 1.0 - margin)
        assert bears.sum() > 50
        x = np.asarray(truth.diagnostics[f"foot_displacement_{side}"])[bears]
        y = np.asarray(truth.diagnostics["hip_height"] + getattr(truth.legs, side).y)[bears]
        assert np.ptp(x) < 1e-9
        assert np.abs(y).max() < 1e-9
        assert x[0] == pytest.approx(j * PLANTED.step_length, abs=1e-9)
        planted = (u > j - 0.5 * PLANTED.double_support) & (u < j + 1.0 + 0.5 * PLANTED.double_support)
        assert np.ptp(np.asarray(truth.diagnostics[f"foot_displacement_{side}"])[planted]) < 1e-9


def test_roll_over_carries_the_bearing_ankle_forward_and_up(exact):
    _, truth = exact
    u = clock(DEFAULT)
    x = np.asarray(truth.diagnostics["foot_displacement_right"])
    y = np.asarray(truth.diagnostics["hip_height"] + truth.legs.right.y)
    flat = (u > 3.25) & (u < 3.55)
    assert np.ptp(x[flat]) < 1e-9
    assert np.abs(y[flat]).max() < 1e-9
    assert x[flat][0] == pytest.approx(3.0 * DEFAULT.step_length, abs=1e-9)
    landing, leaving = np.argmin(np.abs(u - 2.9)), np.argmin(np.abs(u - 4.0))
    on_heel, on_ball = x[landing] - x[flat][0], x[leaving] - x[flat][0]
    assert on_heel == pytest.approx(-DEFAULT.ankle_height * np.sin(DEFAULT.toe_up), rel=0.2)
    assert 0.01 < on_ball < 0.06
    assert 0.01 < y[leaving] < 0.08


def test_no_foot_cuts_into_the_ground(exact):
    _, truth = exact
    for leg in (truth.legs.right, truth.legs.left):
        assert float(jnp.min(truth.diagnostics["hip_height"] + leg.y)) > -2e-3


def test_standing_reads_gravity_along_the_leg_and_no_rate():
    person = Person(standing_hip=0.0, standing_knee=1e-2, steps=3.0)
    signals, truth = walking(jax.random.key(0), person, TIME, IDEAL)
    time = np.asarray(TIME)
    still = np.asarray((time < person.quiet_before - 0.01) | (time > simulate.duration(person) - person.quiet_after))
    assert still.sum() > 400
    for imu in signals:
        assert np.abs(np.asarray(imu.gyr)[still]).max() < 1e-12
        np.testing.assert_allclose(np.linalg.norm(np.asarray(imu.acc)[still], axis=1), GRAVITY, atol=1e-9)
    np.testing.assert_allclose(
        np.asarray(signals.thigh_right.acc)[still], [[0.0, GRAVITY, 0.0]] * still.sum(), atol=1e-9
    )
    assert np.ptp(np.asarray(truth.distance)[time < person.quiet_before]) == 0.0


def test_accelerometers_agree_with_differences_of_the_sensors_position():
    dt = 1e-3
    value, _, acceleration = moving(DEFAULT, 3.0 + dt * jnp.arange(4000, dtype=float))
    for ours, theirs in ((value.sensor_x, acceleration.sensor_x), (value.sensor_y, acceleration.sensor_y)):
        numeric = (ours[2:] - 2.0 * ours[1:-1] + ours[:-2]) / dt**2
        scale = float(jnp.abs(theirs).max())
        np.testing.assert_allclose(numeric, theirs[1:-1], rtol=0, atol=2e-3 * scale)
    leg = DEFAULT.thigh_length + DEFAULT.shank_sensor * DEFAULT.shank_length
    position = np.hypot(value.sensor_x[:, 1] - value.hip_x, value.sensor_y[:, 1] - value.hip_y)
    assert position.max() < leg


def test_every_angle_is_twice_continuously_differentiable():
    """Across a seam the acceleration moves no more than it does just beside it; a jump would stand out."""
    step = 1e-6
    seams = np.concatenate([np.arange(-20, 160) * 0.05, np.arange(0, 8) - 0.34])  # where the pieces meet
    at = DEFAULT.quiet_before + (seams[:, None] + 0.5) * DEFAULT.step_time + step * np.array([[-3.0, -1.0, 1.0, 3.0]])
    near = [moving(DEFAULT, jnp.asarray(np.resize(column, 4000))) for column in at.T]
    for first, second, third, fourth in zip(*(jax.tree.leaves(moments) for moments in near), strict=True):
        beside = np.abs(second - first) + np.abs(fourth - third)
        assert np.all(np.abs(third - second) <= 1.5 * beside + 1e-6 * np.abs(second).max() + 1e-9)
        assert np.all(np.isfinite(second))


def test_gradients_with_respect_to_the_person_equal_finite_differences():
    fields = ("thigh_length", "step_length", "step_time", "knee_swing", "heel_up", "standing_hip", "hip_ahead")

    def total(value, rate, acceleration):
        parts = (rate.angle[:, 1], 0.1 * acceleration.sensor_x[:, 2], value.legs.hip[:, 0], value.hip_y)
        return jnp.mean(jnp.sin(jnp.stack(parts)))

    def of(values):
        person = DEFAULT._replace(**{field: values[i] for i, field in enumerate(fields)})
        return total(*motion(person, TIME))

    gradient = jax.jit(jax.jacfwd(of))(jnp.asarray([getattr(DEFAULT, field) for field in fields]))
    h = 2e-6
    for field, slope in zip(fields, gradient, strict=True):
        moved = [DEFAULT._replace(**{field: getattr(DEFAULT, field) + k * h}) for k in (-2, -1, 1, 2)]
        low2, low, high, high2 = (total(*moving(person, TIME)) for person in moved)
        assert abs(slope) > 1e-4
        np.testing.assert_allclose(slope, (8.0 * (high - low) - (high2 - low2)) / (12.0 * h), rtol=1e-5)


def test_reverse_mode_is_finite_and_equals_forward_mode():
    at = jnp.asarray(np.linspace(0.0, 9.0, 64))

    def total(who):
        now = jax.vmap(lambda t: moment(who, t))(at)
        return jnp.sum(jnp.sin(now.angle)) + jnp.sum(now.hip_x) + jnp.sum(now.sensor_y)

    person = jax.tree.map(jnp.asarray, DEFAULT)
    reverse = jax.jit(jax.grad(total))(person)
    forward = jax.jit(jax.jacfwd(total))(person)
    for a, b in zip(reverse, forward, strict=True):
        assert np.isfinite(a)
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-11)


def test_the_default_person_moves_like_published_ones(exact):
    """Winter's normal gait at about 1.2 m/s: thigh about −20…+30°, knee 0…60–65°, shank −5…+8 rad/s."""
    _, truth = exact
    steady = (clock(DEFAULT) > 2.0) & (clock(DEFAULT) < 4.0)
    assert DEFAULT.step_length / DEFAULT.step_time == pytest.approx(1.2, abs=0.05)
    for side in ("right", "left"):
        leg = getattr(truth.legs, side)
        hip, knee = (np.asarray(a)[steady] / DEGREE for a in (leg.hip_angle, leg.knee_angle))
        assert -22.0 < hip.min() < -12.0
        assert 22.0 < hip.max() < 34.0
        assert 2.0 < knee.min() < 8.0
        assert 52.0 < knee.max() < 66.0
        shank = np.asarray(truth.diagnostics[f"shank_{side}_rate"])[steady]
        thigh = np.asarray(truth.diagnostics[f"thigh_{side}_rate"])[steady]
        assert 5.0 < shank.max() < 8.0
        assert -5.5 < shank.min() < -2.5
        assert 2.0 < thigh.max() < 5.0
        assert -4.0 < thigh.min() < -1.5
    assert 0.02 < np.ptp(np.asarray(truth.diagnostics["hip_height"])[steady]) < 0.06


def test_equal_keys_give_equal_walks_and_other_keys_other_errors_over_the_same_truth():
    a, b, c = (simulate.leg_recording(jax.random.key(seed)) for seed in (3, 3, 4))
    assert all(np.array_equal(x, y) for x, y in zip(jax.tree.leaves(a[1]), jax.tree.leaves(b[1]), strict=True))
    for place in SEGMENTS:
        assert np.array_equal(a[0].sensors[place].gyr, b[0].sensors[place].gyr)
        assert not np.array_equal(a[0].sensors[place].gyr, c[0].sensors[place].gyr)
    assert np.array_equal(a[1].distance, c[1].distance)


def test_mapping_over_people_equals_a_loop():
    key = jax.random.key(1)
    who, errors = jax.random.split(key)
    people, keys = simulate.population(who, 6), jax.random.split(errors, 6)
    # rounding to the converter's steps would turn a difference in the last bit into one of a whole step
    smooth = IDG300._replace(gyr_resolution=0.0, acc_resolution=0.0)
    mapped = simulate.cohort(key, 6, smooth)
    longest = int(np.argmax([truth.time.size for _, truth in mapped]))  # for whom as many numbers are drawn in both
    person = Person(*(float(leaf[longest]) for leaf in people))
    recording, truth = simulate.leg_recording(keys[longest], person, smooth)
    assert truth.time.size == mapped[longest][1].time.size
    for a, b in zip(jax.tree.leaves(mapped[longest][1]), jax.tree.leaves(truth), strict=True):
        np.testing.assert_allclose(np.asarray(a, float), np.asarray(b, float), rtol=0, atol=1e-10)
    for place in SEGMENTS:
        ours, theirs = mapped[longest][0].sensors[place], recording.sensors[place]
        np.testing.assert_allclose(ours.gyr, theirs.gyr, rtol=0, atol=1e-10)
        np.testing.assert_allclose(ours.acc, theirs.acc, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(ours.mask, theirs.mask)


def test_a_recording_is_in_the_librarys_own_types():
    recording, truth = simulate.leg_recording(jax.random.key(0), name="walk", subject="someone")
    assert set(recording.sensors) == set(SEGMENTS)
    assert recording.sampling_rate_hz == 50.0
    assert (recording.name, recording.subject) == ("walk", "someone")
    samples = truth.time.shape[0]
    assert samples == int(float(simulate.duration(DEFAULT)) * 50.0) + 1
    for imu in recording.sensors.values():
        assert imu.time.shape == imu.mask.shape == (samples,)
        assert imu.gyr.shape == imu.acc.shape == (samples, 3)
        assert imu.mask.dtype == np.bool_
        assert imu.gyr.dtype == np.float64
        assert np.isfinite(imu.gyr).all()
        assert np.isfinite(imu.acc).all()
        assert np.all(imu.gyr[~imu.mask] == 0.0)
        assert np.allclose(np.diff(imu.time), 0.02)
    assert truth.valid.all()
    assert truth.stddev is None
    assert truth.diagnostics["thigh_length"] == pytest.approx(DEFAULT.thigh_length)
    assert truth.distance[-1] == pytest.approx(6 * 0.62)


def test_a_cohort_differs_in_everything_that_people_differ_in():
    walks = simulate.cohort(jax.random.key(1), 6)
    distances = np.array([truth.distance[-1] for _, truth in walks])
    assert np.all((distances > 3.0) & (distances < 4.0))
    lengths = np.array([truth.diagnostics["thigh_length"] for _, truth in walks])
    assert len(set(lengths.round(6))) == 6
    assert np.all((lengths > 0.33) & (lengths < 0.52))
    for recording, truth in walks:
        rate = np.diff(truth.legs.right.hip_angle - truth.legs.right.knee_angle) * 50.0
        assert 5.0 < rate.max() < 9.5
        assert recording.sensors["thigh_left"].gyr.shape[0] == truth.time.shape[0]
        assert truth.valid.all()
        assert truth.legs.right.knee_angle.max() < 75.0 * DEGREE
    assert len({recording.subject for recording, _ in walks}) == 6
    again = simulate.cohort(jax.random.key(1), 6)
    assert np.array_equal(again[4][0].sensors["shank_left"].gyr, walks[4][0].sensors["shank_left"].gyr)


def test_everyone_that_the_population_draws_can_walk():
    people = simulate.population(jax.random.key(7), 300)
    for values in zip(*(np.asarray(leaf) for leaf in people), strict=True):
        simulate.check_person(Person(*map(float, values)))


def test_sensor_noise_has_the_density_bias_and_steps_that_it_states():
    person = DEFAULT._replace(quiet_before=1000.0)  # standing throughout
    n = 3 * TIME.size

    def read(noise):
        return walking(jax.random.key(2), person, TIME, noise)[0]

    white = SensorNoise(gyr_noise=0.01, acc_noise=0.02)
    signals = read(white)
    bandwidth = np.sqrt(RATE / 2.0)
    assert float(jnp.std(signals.thigh_right.gyr)) == pytest.approx(0.01 * bandwidth, rel=6.0 / np.sqrt(2 * n))
    lateral = float(jnp.std(signals.thigh_right.acc[:, 2]))
    assert lateral == pytest.approx(0.02 * bandwidth, rel=6.0 / np.sqrt(2 * TIME.size))
    stepped = read(white._replace(gyr_resolution=0.004))
    ratio = np.asarray(stepped.shank_left.gyr) / 0.004
    np.testing.assert_allclose(ratio, np.round(ratio), atol=1e-9)
    assert np.abs(stepped.shank_left.gyr - signals.shank_left.gyr).max() <= 0.002 + 1e-12
    lost = 1.0 - np.mean([np.mean(imu.mask) for imu in read(SensorNoise(packet_loss=0.1))])
    assert lost == pytest.approx(0.1, abs=6.0 * np.sqrt(0.09 / (4 * TIME.size)))
    drifting = np.asarray(read(SensorNoise(gyr_drift=0.01, gyr_bias=0.1)).thigh_right.gyr)
    assert np.diff(drifting, axis=0).std() == pytest.approx(0.01 / np.sqrt(RATE), rel=6.0 / np.sqrt(2 * n))
    assert 0.0 < np.abs(drifting[0]).max() < 0.6


def test_saturation_mounting_and_flipping(exact):
    clean, _ = exact
    clipped, _ = walking(jax.random.key(0), DEFAULT, TIME, SensorNoise(gyr_range=3.0))
    np.testing.assert_array_equal(clipped.shank_right.gyr, np.clip(clean.shank_right.gyr, -3.0, 3.0))
    turned, _ = walking(jax.random.key(0), DEFAULT, TIME, SensorNoise(mounting=0.2))
    for ours, theirs in zip(turned, clean, strict=True):
        assert not np.allclose(ours.gyr, theirs.gyr, atol=1e-3)
        for a, b in ((ours.gyr, theirs.gyr), (ours.acc, theirs.acc)):
            np.testing.assert_allclose(np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1), atol=1e-9)
    flipped, _ = walking(jax.random.key(0), DEFAULT, TIME, SensorNoise(left_flipped=1.0))
    sign = np.array([[-1.0, 1.0, -1.0]])
    np.testing.assert_allclose(flipped.thigh_left.acc, sign * np.asarray(clean.thigh_left.acc), atol=1e-12)
    np.testing.assert_allclose(flipped.shank_left.gyr, sign * np.asarray(clean.shank_left.gyr), atol=1e-12)
    np.testing.assert_array_equal(flipped.thigh_right.gyr, clean.thigh_right.gyr)


def test_single_precision_stays_close_to_double(exact):
    _, double = exact
    _, single = walking(jax.random.key(0), DEFAULT, TIME.astype(jnp.float32), IDEAL)
    assert single.distance.dtype == jnp.float32
    np.testing.assert_allclose(single.legs.left.knee_angle, double.legs.left.knee_angle, atol=2e-4)
    np.testing.assert_allclose(single.diagnostics["shank_left_rate"], double.diagnostics["shank_left_rate"], atol=1e-2)


def test_samples_past_the_end_are_not_valid(exact):
    _, truth = exact
    assert int(truth.valid.sum()) == int(float(simulate.duration(DEFAULT)) * RATE + 1e-9) + 1
    assert not bool(truth.valid[-1])


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"step_length": 1.4}, ValueError, r"too short for steps of 1\.400 m.*at most 0\.95.*shorten step_length"),
        ({"thigh_length": -0.4}, ValueError, r"Person\.thigh_length must lie in \[0\.1, 0\.8\]; got -0\.4"),
        ({"thigh_length": 43.0}, ValueError, r"Person\.thigh_length must lie in \[0\.1, 0\.8\]; got 43"),
        ({"steps": 2.5}, ValueError, r"Person\.steps must be a whole number; got 2\.5"),
        ({"step_time": float("nan")}, ValueError, r"Person\.step_time must lie in .*; got nan"),
        (
            {"knee_swing": 0.0, "knee_loading": 1.0},
            ValueError,
            r"\d\.\d cm below where it stands; raise knee_swing or lower",
        ),
        ({"shank_length": "long"}, TypeError, r"Person\.shank_length must be one number; got 'long'"),
        ({"step_length": np.ones(2)}, TypeError, r"Person\.step_length must be one number"),
    ],
)
def test_impossible_people_are_refused_by_the_limit_they_break(change, error, message):
    with pytest.raises(error, match=message):
        simulate.leg_recording(jax.random.key(0), DEFAULT._replace(**change))


def test_bad_rates_and_empty_cohorts_are_refused():
    with pytest.raises(ValueError, match="rate must be a positive number"):
        simulate.leg_recording(jax.random.key(0), rate=0.0)
    with pytest.raises(ValueError, match="rate must be a positive number"):
        simulate.cohort(jax.random.key(0), 2, rate=float("inf"))
    with pytest.raises(ValueError, match="at least one person; got n=0"):
        simulate.cohort(jax.random.key(0), 0)


def test_one_moment_can_be_read_without_sensors():
    now = moment(DEFAULT, jnp.asarray(1.0))
    _, height, legs = body_pose(DEFAULT, step_clock(DEFAULT, jnp.asarray(1.0)))
    np.testing.assert_allclose(legs.knee, DEFAULT.standing_knee, rtol=0, atol=1e-12)
    np.testing.assert_allclose(legs.hip, DEFAULT.standing_hip, rtol=0, atol=1e-12)
    np.testing.assert_allclose(now.angle, DEGREE * np.array([2.0, -2.0, 2.0, -2.0]), rtol=0, atol=1e-12)
    assert float(height) == pytest.approx(-float(legs.y[0]), abs=1e-12)
