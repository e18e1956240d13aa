"""The whole body walks: feet that rest, legs that close, signals that are the motion's own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import strapdown
from strapdown import stacked

from jgait import simulate
from jgait.geometry.segments import Frame, in_world
from jgait.geometry.vectors import GRAVITY, Vector
from jgait.simulate import RECORDED, Gait, Person
from jgait.simulate.feet import LINGER
from jgait.simulate.footsteps import FIRST
from jgait.simulate.recorded import limits
from jgait.simulate.sensors import IDEAL
from jgait.simulate.shapes import shape_of
from jgait.simulate.walker import moved, plan, separated, ticks
from jgait.types import SIDES

RATE = 100.0
VARIED = {"length_variability": 0.03, "time_variability": 0.03, "width_variability": 0.01, "length_asymmetry": 0.03}


def person(base=Gait(), **changes):  # noqa: B008
    # Ten seconds: at RATE just less than 1024 samples, after which arrays are twice as long.
    return Person(gait=base._replace(steps=8.0, quiet_before=2.8)._replace(**changes))


STYLED = RECORDED._replace(style_1=1.0, style_2=-1.0, style_3=0.5, style_4=1.0)
BOTH = pytest.mark.parametrize("base", [Gait(), RECORDED, STYLED], ids=["rules", "recorded", "styled"])


STRAIGHT = simulate.route({"length": 2.0}, {"length": 2.0}, {"length": 8.0})


def simulated(seed, who, along=STRAIGHT, errors=IDEAL, rate=RATE):
    """All walks of this file are one program: seven sensors, a route of three pieces."""
    return simulate.recording(jax.random.key(seed), who, along, errors, rate)


RUNNING = simulate.walking(Person(), "running").gait


@pytest.fixture(
    scope="module", params=[Gait(), RECORDED, STYLED, RUNNING], ids=["rules", "recorded", "styled", "running"]
)
def walked(request):
    who = person(request.param, **VARIED)
    return who, *simulated(1, who, simulate.corner(3.0, np.pi / 2, 4.0))


def test_legs_close_with_the_lengths_they_have(walked):
    who, _, truth = walked
    segments = truth.motion.pose
    for side in ("right", "left"):
        thigh, shank, foot = (getattr(segments, f"{part}_{side}") for part in ("thigh", "shank", "foot"))
        for upper, lower, length in (
            (thigh, shank, who.body.thigh_length),
            (shank, foot, who.body.shank_length),
        ):
            distance = np.linalg.norm(stacked(upper.origin) - stacked(lower.origin), axis=1)
            np.testing.assert_allclose(distance, length, rtol=0, atol=1e-12)
        hip = np.linalg.norm(stacked(thigh.origin) - stacked(segments.pelvis.origin), axis=1)
        np.testing.assert_allclose(hip, 0.5 * who.body.hip_width, atol=1e-12)
        for frame in (thigh, shank, foot, segments.pelvis):
            axes = np.stack([stacked(frame.x), stacked(frame.y), stacked(frame.z)], axis=2)
            np.testing.assert_allclose(
                np.swapaxes(axes, 1, 2) @ axes, np.eye(3) + np.zeros((len(axes), 3, 3)), atol=1e-12
            )


def contact_points(who, truth, side):
    """Heel, ball and whole foot of one side in the world, (T, 3) each."""
    frame = getattr(truth.motion.pose, f"foot_{side}")
    down = -who.body.ankle_height
    return [stacked(in_world(frame, Vector(x, 0.0, down))) for x in (-who.body.heel_length, who.body.ball_length)]


def test_feet_that_stand_are_at_rest(walked):
    """Flat: heel and ball; before that the heel about which it lands, after it the ball over which it rolls off."""
    who, recording, truth = walked
    gait = who.gait
    entry, moving = ticks(truth.plan, jnp.asarray(truth.estimate.time))
    entry, r = np.asarray(entry), np.asarray(moving.pose)
    flat_from, off = 2.0 * gait.foot_flat, 2.0 * gait.heel_off
    rolls = 2.0 * gait.stance_fraction - LINGER - float(shape_of(who).when.toes_rise)
    least = 1 if gait.stance_fraction < 0.5 else 5 if gait.recorded == 0.0 else 3  # samples of a phase
    checked = 0
    for landed in range(1, 8):  # footholds that are landed on and left again
        side = "left" if truth.plan.side[landed + FIRST] > 0 else "right"
        since = entry - FIRST + r - landed
        heel, ball = contact_points(who, truth, side)
        flat = (since >= flat_from) & (since <= off)
        for point, when in (
            (heel, flat),
            (ball, flat),
            (heel, (since >= 0.0) & (since <= flat_from)),
            (ball, (since >= off) & (since <= rolls)),
        ):
            assert when.sum() > least
            assert np.ptp(point[when], axis=0).max() < 1e-12
            checked += 1
        imu = recording.sensors[f"foot_{side}"]
        np.testing.assert_allclose(np.linalg.norm(imu.acc[flat], axis=1), GRAVITY, atol=1e-9)
        assert np.abs(imu.gyr[flat]).max() < 1e-9
    assert checked == 28


def test_who_turns_on_the_spot_steps_round_without_getting_ahead():
    who = simulate.covering(jax.random.key(2), person(recorded=1.0), simulate.about_turn(2.0, steps=2.0))
    _, truth = simulated(2, who, simulate.about_turn(2.0, steps=2.0))
    heading = np.asarray(truth.estimate.diagnostics["heading"])
    assert heading[-1] == pytest.approx(np.pi, abs=1e-9) and float(truth.estimate.distance[-1]) == pytest.approx(4.0)
    pelvis = stacked(truth.motion.pose.pelvis.origin)[:, :2]
    turning = (heading > 0.3) & (heading < np.pi - 0.3)
    assert turning.sum() > 100 and np.ptp(pelvis[turning], axis=0).max() < 0.4
    assert np.linalg.norm(pelvis[-1] - pelvis[0]) < 0.2
    for side in SIDES:  # each foot stands still while the body turns
        moves = [np.abs(np.gradient(point, axis=0)).max(axis=1) for point in contact_points(who, truth, side)]
        still = turning & (np.max(moves, axis=0) < 1e-11)
        assert still.sum() > 20


def test_standing_sensors_feel_gravity_alone(walked):
    who, recording, truth = walked
    time = np.asarray(truth.estimate.time)
    still = (time < who.gait.quiet_before) | (time > time[-1] - who.gait.quiet_after + 0.02)
    assert still.sum() > 400
    for imu in recording.sensors.values():
        assert np.abs(imu.gyr[still]).max() < 1e-9
        np.testing.assert_allclose(np.linalg.norm(imu.acc[still], axis=1), GRAVITY, rtol=0, atol=1e-9)
    first = time < who.gait.quiet_before
    np.testing.assert_allclose(recording.sensors["pelvis"].acc[first], [[0.0, 0.0, GRAVITY]] * first.sum(), atol=1e-9)


@BOTH
def test_a_closing_step_ends_on_the_ball_of_a_foot_whose_heel_comes_down(base):
    """As in recorded people (`experiments.people.shoes`): a flat foot that slides looks like one at rest."""
    who = person(base)
    _, truth = simulated(1, who)
    last = "right" if truth.strides.side[np.asarray(truth.strides.valid)][-1] == 0 else "left"
    foot = getattr(truth.motion.pose, f"foot_{last}")
    far = np.flatnonzero(np.linalg.norm(stacked(foot.origin)[:, :2] - stacked(foot.origin)[-1, :2], axis=1) > 0.05)[-1]
    assert -12.0 < np.degrees(np.arcsin(np.asarray(foot.x.z)[far])) < -3.0
    assert abs(np.asarray(foot.x.z)[-1]) < 1e-9


@BOTH
def test_integrating_a_sensor_returns_the_truth(base):
    # So short that at both rates the arrays are as long as those of the other walks: no further program.
    who = person(base, **VARIED | {"steps": 3.0, "quiet_before": 0.2, "quiet_after": 0.2})
    errors = []
    for rate in (160.0, 280.0):
        recording, truth = simulated(1, who, simulate.corner(1.0, np.pi / 2, 4.0), rate=rate)
        for placement, imu in recording.sensors.items():
            frame: Frame = getattr(truth.motion.pose, simulate.segment_of(placement))
            path, place, axes = strapdown.followed(imu, frame, simulate.mount(who.body, placement), rate)
            errors.append(np.linalg.norm(np.asarray(path.position) - place, axis=1).max())
            assert np.abs(np.asarray(path.axes)[-1] - axes[-1]).max() < (1e-6 if base.recorded == 0.0 else 1e-5)
        for side in SIDES:
            frame = getattr(truth.motion.pose, f"foot_{side}")
            place = stacked(in_world(frame, simulate.mount(who.body, f"foot_{side}")))
            np.testing.assert_allclose(getattr(truth.estimate.feet, side).position, place, atol=1e-9)
    coarse, fine = np.array(errors).reshape(2, -1)
    # A knee that is nearly straight at landing turns fast.
    assert coarse.max() < (5e-5 if base.recorded == 0.0 else 1e-3)
    # The largest error of micrometres depends on where samples are in a landing.
    assert np.median(fine) < np.median(coarse) / 4.0


def test_the_truth_is_the_walk_that_was_asked_for(walked):
    who, recording, truth = walked
    assert truth.estimate.distance[-1] == pytest.approx(8 * 0.5 * who.gait.stride_length, rel=0.05)
    rows = truth.strides
    valid = np.asarray(rows.valid)
    assert valid.sum() == 9
    assert np.all(np.asarray(rows.start)[valid] < np.asarray(rows.end)[valid])
    assert np.all(np.diff(np.asarray(rows.end)[valid]) > 0.3)
    steady = np.flatnonzero(valid)[2:-2]
    foot = (np.asarray(rows.end) - np.asarray(rows.start))[steady]
    np.testing.assert_allclose(foot, who.gait.stride_time, rtol=0.15)
    swing = np.asarray(rows.end - rows.final_contact)[steady] / foot
    np.testing.assert_allclose(1.0 - swing, who.gait.stance_fraction, atol=0.04)
    assert recording.sensors["pelvis"].time.shape == truth.estimate.time.shape
    assert truth.estimate.valid.all()


@BOTH
def test_without_variability_everything_is_as_asked(base):
    who = person(base)
    _, truth = simulated(0, who)
    rows = truth.strides
    steady = np.flatnonzero(np.asarray(rows.valid))[2:-2]
    np.testing.assert_allclose(np.asarray(rows.length)[steady], who.gait.stride_length, atol=1e-12)
    np.testing.assert_allclose(np.asarray(rows.width)[steady], who.gait.step_width, atol=1e-12)
    assert truth.estimate.distance[-1] == pytest.approx(4 * who.gait.stride_length, abs=1e-9)
    leg = truth.estimate.legs.right
    assert float(leg.knee_angle[0]) == pytest.approx(who.gait.standing_knee, abs=1e-4)  # seen from the side
    time = truth.estimate.time
    walking = (time > rows.end[steady[0]]) & (time < rows.end[steady[-1]])
    knee, hip = (np.rad2deg(angle)[walking] for angle in (leg.knee_angle, leg.hip_angle))
    assert 55.0 < knee.max() < 75.0
    assert 22.0 < hip.max() < 36.0
    assert -24.0 < hip.min() < -10.0
    high = truth.estimate.diagnostics["hip_height"]
    assert np.ptp(high[walking]) == pytest.approx(who.gait.pelvis_rise, rel=0.2)


FREE = tuple(
    name for name in Gait._fields
    if not name.startswith("quiet_")
    and name not in ("pelvis_lag", "style_2", "style_3", "soft_tissue", "stiff", "steps", "right_first")
)  # fmt: skip
"""Fields of a gait whose gradient is compared; of the others the loss does not depend on, or decisions."""


@pytest.mark.release
def test_gradients_of_a_signal_loss_equal_finite_differences():
    time = jnp.asarray(np.arange(3.0, 7.0, 0.08))
    base = person(
        **VARIED, time_asymmetry=0.01, recorded=0.5, style_1=0.5, persistence=0.3
    )  # between rules and recorded people

    def loss(values):
        who = base._replace(gait=base.gait._replace(**{name: values[i] for i, name in enumerate(FREE)}))
        read, _ = simulate.walk(
            jax.random.key(0), who, simulate.straight(20.0), time, capacity=8, placements=("shank_right", "pelvis")
        )
        return sum(jnp.mean(jnp.sin(imu.gyr)) + 0.1 * jnp.mean(jnp.sin(imu.acc)) for imu in read.values())

    start = np.asarray([float(getattr(base.gait, name)) for name in FREE])
    # One program gives the value and its slope in a direction.
    sloped = jax.jit(lambda values, along: jax.jvp(loss, (values,), (along,)))
    gradient = [sloped(start, along)[1] for along in np.eye(len(FREE))]
    h = 3e-7
    scale = float(np.abs(np.asarray(gradient)).max())
    for i, name in enumerate(FREE):
        ahead, behind = (float(sloped(start + k * h * np.eye(len(FREE))[i], 0.0 * start)[0]) for k in (1, -1))
        numeric = (ahead - behind) / (2.0 * h)
        assert abs(float(gradient[i])) > 1e-9, name
        np.testing.assert_allclose(gradient[i], numeric, rtol=1e-5, atol=1e-6 * scale, err_msg=name)


@pytest.mark.release
def test_a_walk_in_single_precision_and_mapped_over_people_is_close_to_that_of_one_in_double():
    people = [person(stride_length=length, **VARIED) for length in (1.1, 1.3)]
    time = np.arange(2.0, 6.0, 0.05)

    def of(who, t):
        laid = plan(jax.random.key(3), who, simulate.straight(20.0), 8)
        return separated(moved(who, laid, *ticks(laid, t)).pose).shank_right.origin

    each = [jax.jit(of)(who, time) for who in people]
    together = jax.jit(jax.vmap(of, in_axes=(0, None)))(jax.tree.map(lambda *v: np.stack(v), *people), time)
    for i, one in enumerate(each):
        np.testing.assert_allclose([part[i] for part in together], one, rtol=0, atol=1e-10)
    steady = person()
    narrow = jax.jit(of)(jax.tree.map(lambda v: np.asarray(v, np.float32), steady), time.astype(np.float32))
    assert narrow.x.dtype == jnp.float32
    np.testing.assert_allclose(narrow, jax.jit(of)(steady, time), atol=2e-4)


@pytest.mark.parametrize(
    ("along", "changes", "rise"),
    [
        (simulate.route({"length": 2.0}, {"length": 6.0, "slope": 0.08}, {"length": 2.0}), {}, 0.05),
        (simulate.route({"length": 2.0}, {"length": 4.0, "riser": 0.15, "speed": 0.5}, {"length": 3.0}), {}, 0.29),
        (simulate.route({"length": 2.0}, {"length": 4.0, "riser": -0.15, "speed": 0.5}, {"length": 3.0}), {}, 0.29),
        (simulate.corner(1.0, 2.0 * np.pi, 1.0, 1.5), {"stride_length": 1.1}, 0.0),
        (simulate.u_turn(3.0), {"stride_length": 1.1}, 0.0),
        (simulate.about_turn(2.0), {"stride_length": 1.1}, 0.0),
    ],
)
def test_legs_close_on_slopes_stairs_and_turns(along, changes, rise):
    who = jax.tree.map(float, person(steps=10.0, **changes))
    laid, _, left = limits(jax.random.key(0), who, along)
    assert left.stretched > 0.0
    assert left.aside < 0.6
    rows = simulate.strides(laid)
    climbed = np.abs(np.asarray(rows.height)[np.asarray(rows.valid)])
    assert climbed.max() == pytest.approx(0.0, abs=1e-12) if rise == 0.0 else climbed.max() > rise


@pytest.mark.parametrize("base", [Gait(), RECORDED], ids=["rules", "recorded"])
def test_people_climb_stairs_with_a_leg_that_gets_straight(base):
    along = simulate.route({"length": 2.0}, {"length": 2.4, "riser": 0.17, "speed": 0.25}, {"length": 2.0})
    who = simulate.covering(jax.random.key(0), Person(gait=base), along)
    _, truth = simulate.recording(jax.random.key(0), who, along)
    height = np.stack([stacked(getattr(truth.motion.pose, f"foot_{side}").origin)[:, 2] for side in SIDES])
    speed = np.linalg.norm([stacked(getattr(truth.motion.rate, f"foot_{side}").origin) for side in SIDES], axis=2)
    knee = np.degrees([getattr(truth.estimate.legs, side).knee_angle for side in SIDES])
    stands = (speed < 0.02) & (height > height.min() + 0.1) & (height < height.max() - 0.1)
    assert knee.max() < 110.0 and knee[stands].min() < 25.0


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (
            {"stride_length": 2.6},
            ValueError,
            r"too short for strides of 2\.600 m.*at most 0\.75.*shorten stride_length",
        ),
        (
            {"stance_fraction": 1.2},
            ValueError,
            r"Gait\.stance_fraction must be finite and in \[0\.25, 0\.8\]; got 1\.2",
        ),
        ({"steps": 2.5}, ValueError, r"Gait\.steps must be a whole number; got 2\.5"),
        ({"stride_time": float("nan")}, ValueError, r"Gait\.stride_time must be finite and in .*; got nan"),
        ({"heel_off": 0.1, "foot_flat": 0.15}, ValueError, r"Gait\.foot_flat < heel_off < stance_fraction"),
        ({"stride_length": "long"}, TypeError, r"Gait\.stride_length must be a number; got 'long'"),
        ({"stride_length": np.ones(2)}, TypeError, r"Gait\.stride_length must be one number"),
    ],
)
def test_impossible_gaits_are_refused_by_the_limit_they_break(change, error, message):
    with pytest.raises(error, match=message):
        simulate.recording(jax.random.key(0), person(**change))


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("given", "kind", "message"),
    [
        ({"person": Person(body=Person().body._replace(thigh_length=-0.4))}, ValueError,
         r"Body\.thigh_length must be finite and in \[0\.1, 0\.8\]; got -0\.4"),
        ({"rate": 0.0}, ValueError, "rate must be a positive number"),
        ({"placements": ("wrist_left",)}, ValueError, "can wear sensors on .*; got 'wrist_left'"),
        ({"placements": ("foot_right",), "places": {"shank_left": (0.0, 0.0, 0.0)}}, ValueError,
         "places has 'shank_left', which is not among the placements foot_right"),
        ({"placements": ("foot_right",), "places": {"foot_right": (4, 0, 0)}}, ValueError,
         r"places\['foot_right'\] must be three numbers in m, .* got \(4, 0, 0\)"),
        ({"person": Gait()}, TypeError, r"a person is Person\(body=Body"),
        ({"along": simulate.route({"length": 1.0}, {"length": 4.0, "riser": 0.9}, {"length": 1.0})}, ValueError,
         "a leg of 0.859 m would be overstretched by .* mm on this route; raise knee"),
    ],
)  # fmt: skip
def test_impossible_bodies_sensors_and_rates_are_refused(given, kind, message):
    with pytest.raises(kind, match=message):
        simulate.recording(jax.random.key(0), **{"person": person()} | given)


def test_soft_tissue_moves_sensors_over_bones_that_stay_as_they_are():
    """Sensors on legs and feet move by millimetres; what they read is exactly this motion, and it ends in rest."""
    short = {"steps": 3.0, "quiet_before": 0.2, "quiet_after": 0.2}
    rate = 280.0
    (rigid, bones), (soft, same) = (
        simulated(1, person(RECORDED, **short, soft_tissue=size), simulate.corner(1.0, np.pi / 2, 4.0), rate=rate)
        for size in (0.0, 1.0)
    )
    np.testing.assert_allclose(soft.sensors["pelvis"].gyr, rigid.sensors["pelvis"].gyr, atol=1e-12)
    for name in ("foot_right", "foot_left"):
        flat, time = np.abs(rigid.sensors[name].gyr).max(axis=1) < 1e-12, soft.sensors[name].time
        still = np.abs(soft.sensors[name].gyr[flat]).max(axis=1)
        walks = (time[flat] > 0.4) & (time[flat] < np.sort(same.strides.end)[-2])
        assert walks.sum() > 0.2 * rate and still[walks].max() < 1e-12
        # Feet that stand at the start and at the end hardly move.
        assert still.max() < 1e-2
        assert np.abs((soft.sensors[name].gyr - rigid.sensors[name].gyr)[~flat]).max() > 0.3
    for a, b in zip(jax.tree.leaves(same.motion), jax.tree.leaves(bones.motion), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)
    for name in ("thigh_right", "thigh_left", "shank_right", "shank_left", "foot_right", "foot_left"):
        frame: Frame = getattr(same.motion.pose, name)
        path, place, axes = strapdown.followed(soft.sensors[name], frame, simulate.mount(Person().body, name), rate)
        apart = np.linalg.norm(np.asarray(path.position) - place, axis=1)
        assert 1e-3 < apart.max() < 0.06
        assert apart[-1] < 1e-4
        assert np.abs(np.asarray(path.axes)[-1] - axes[-1]).max() < 1e-5


def test_recorded_people_land_with_a_knee_nearly_straight():
    """Rules bend it by some 20°; people by 0 to 10° (Winter), the mean of those recorded by more."""
    landing = []
    for base in (Gait(), RECORDED):
        who = person(base)
        truth = simulated(0, who)[1]
        rows = truth.strides
        lands = np.asarray(rows.end)[np.asarray(rows.valid) & (np.asarray(rows.side) == 0)][1:-1]
        knee = np.rad2deg(truth.estimate.legs.right.knee_angle)
        landing.append(np.interp(lands, truth.estimate.time, knee).mean())
    assert 3.0 < landing[1] < landing[0] - 3.0


def test_steps_resemble_the_ones_before_and_feet_pitch_differently_from_stride_to_stride():
    """The first draws are the same; lengths of 400 steps correlate as asked, and their spread stays what it was."""
    long = {"steps": 400.0, "length_variability": 0.03, "time_variability": 0.03}
    for persistence in (0.0, 0.4):
        who = person(**long, persistence=persistence, pitch_variability=0.05)
        laid = jax.jit(plan, static_argnums=3)(jax.random.key(0), who, simulate.straight(400.0), 400)
        length, time = np.diff(np.asarray(laid.x)[2:-3]), np.diff(np.asarray(laid.contact)[3:-3])
        for steps, mean in ((length, 0.5 * who.gait.stride_length), (time, 0.5 * who.gait.stride_time)):
            assert np.corrcoef(steps[:-1], steps[1:])[0, 1] == pytest.approx(persistence, abs=0.12)
            assert steps.std() == pytest.approx(0.03 * mean, rel=0.15)
        for pitch, usual in ((laid.toe_up, who.gait.toe_up), (laid.heel_up, who.gait.heel_up)):
            taken = np.asarray(pitch)[3:-6]
            assert taken.std() == pytest.approx(0.05 * usual, rel=0.15)
            assert taken.mean() == pytest.approx(usual, rel=0.02)
