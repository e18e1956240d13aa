"""People drawn from norms, each fitted to a route: everyone can walk, distances are exact, and nobody depends on whom
else is drawn."""

import jax
import numpy as np
import pytest

from experiments.common.people import check_person
from jgait import simulate
from jgait.simulate import Person
from jgait.simulate.recorded import limits


@pytest.fixture(scope="module")
def people():
    return simulate.population(jax.random.key(0), 300, recorded=False)


@pytest.fixture(scope="module")
def cohort():
    return simulate.cohort(
        jax.random.key(1), 3, simulate.straight(5.0), rate=50.0, placements=simulate.FOUR, recorded=False
    )


def test_everyone_drawn_can_walk(people):
    for i in range(300):
        check_person(simulate.person_of(people, i))


def test_everyone_drawn_like_recorded_people_can_walk_in_a_style_of_their_own():
    people = simulate.population(jax.random.key(5), 40, recorded=True)
    for i in range(40):
        check_person(simulate.person_of(people, i))
    styles = np.array([getattr(people.gait, f"style_{i}") for i in range(1, 5)])
    assert np.all(np.abs(styles.mean(axis=1)) < 0.5) and np.all((styles.std(axis=1) > 0.6) & (styles.std(axis=1) < 1.1))
    assert np.all(people.gait.recorded == 1.0) and np.all(people.gait.soft_tissue > 0.5)
    # Who walks, and how fast, is drawn as by the rules.
    plain = simulate.population(jax.random.key(5), 40, recorded=False)
    np.testing.assert_allclose(people.gait.stride_length, plain.gait.stride_length)
    np.testing.assert_allclose(people.body.thigh_length, plain.body.thigh_length)
    fast = simulate.paced(simulate.person_of(people, 0), 1.1)
    grown = float(fast.gait.pelvis_rise / people.gait.pelvis_rise[0])
    assert 1.1 < grown <= 1.1**2.7 + 1e-9


def test_people_have_the_figures_of_the_norms(people):
    body, gait = people
    leg = np.asarray(body.thigh_length + body.shank_length)
    stride, time = np.asarray(gait.stride_length), np.asarray(gait.stride_time)
    speed = stride / time
    assert all(np.asarray(leaf).shape == (300,) for leaf in jax.tree.leaves(people))
    assert 1.28 < speed.mean() < 1.38  # all strata of Bohannon and Andrews together: 1.33 m/s
    assert 115.0 < (120.0 / time).mean() < 125.0  # steps a minute
    assert 0.78 < leg.mean() < 0.88
    assert np.corrcoef(speed, stride)[0, 1] > 0.7
    assert np.corrcoef(leg, stride)[0, 1] > 0.3
    assert np.corrcoef(speed, time)[0, 1] < -0.5
    relative = stride / leg
    for name in ("heel_up", "toe_up", "pelvis_rise", "pelvis_surge"):
        assert np.corrcoef(relative, np.asarray(getattr(gait, name)))[0, 1] > 0.5, name
    assert 0.4 < np.mean(np.asarray(gait.right_first)) < 0.6
    assert np.asarray(gait.length_variability).min() > 0.01


def test_who_comes_first_does_not_depend_on_how_many_are_drawn(people):
    few = simulate.population(jax.random.key(0), 2, recorded=False)
    for a, b in zip(jax.tree.leaves(few), jax.tree.leaves(people), strict=True):
        np.testing.assert_allclose(a, b[:2], rtol=1e-12)
    other = simulate.population(jax.random.key(9), 2, recorded=False)
    assert not np.allclose(other.gait.stride_length, few.gait.stride_length)


def test_a_gait_from_any_two_figures_is_the_same():
    by_length = simulate.gait(speed=1.2, stride_length=1.2)
    for other in (simulate.gait(speed=1.2, cadence=120.0), simulate.gait(stride_length=1.2, cadence=120.0)):
        np.testing.assert_allclose(other, by_length, rtol=1e-12)
    assert by_length.stride_time == pytest.approx(1.0) and by_length.stride_length == pytest.approx(1.2)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"speed": 1.2}, "needs two of .* got speed=1.2"),
        ({"stature": 1.7}, "got none"),
        ({"stride_length": 1.2, "stature": 1.7}, "got stride_length=1.2"),
        ({"speed": 1.5, "stride_length": 1.2, "cadence": 120.0}, "speed=1.5 m/s contradicts .* which make 1.200 m/s"),
        ({"speed": -1.0, "cadence": 100.0}, "speed must be above 0 and at most 13; got -1.0"),
        ({"speed": 1.0, "stature": float("nan")}, "stature must be above 0 and at most 2.8; got nan"),
    ],
)
def test_insufficient_or_contradictory_figures_are_refused(given, words):
    with pytest.raises(ValueError, match=words):
        simulate.gait(**given)


@pytest.mark.parametrize(
    "along",
    [simulate.straight(7.0), simulate.faster(4.0, 1.0, 1.3), simulate.corner(3.0, -1.5, 2.0), simulate.about_turn(1.5)],
)
def test_whole_steps_cover_a_route_exactly(people, along):
    key, person = jax.random.key(5), simulate.person_of(people, 3)
    found = simulate.covering(key, person, along)
    total = float(np.sum(along.length))
    assert found.gait.steps == round(found.gait.steps)
    assert abs(found.gait.stride_length / person.gait.stride_length - 1.0) < 0.15
    assert found.gait.stride_time == person.gait.stride_time
    laid = limits(key, found, along)[0]
    last = int(found.gait.steps) + 1  # entry of the last foothold; the next closes up beside it
    middle = 0.5 * np.array([laid.x[last] + laid.x[last + 1], laid.y[last] + laid.y[last + 1]])
    aside = found.gait.width_variability * 2.5
    end = jax.jit(simulate.routes.at)(simulate.routes.padded(along), np.array([total]))
    assert np.hypot(middle[0] - float(end.x[0]), middle[1] - float(end.y[0])) < aside
    forward = (middle[0] - end.x[0]) * np.cos(end.heading[0]) + (middle[1] - end.y[0]) * np.sin(end.heading[0])
    assert abs(float(forward)) < 1e-9


def test_a_route_shorter_than_half_a_step_is_refused(people):
    with pytest.raises(ValueError, match="a route of 0.2 m is shorter than half a step of"):
        simulate.covering(jax.random.key(0), simulate.person_of(people, 0), simulate.straight(0.2))


def test_a_cohort_walks_the_route_and_its_truth_states_it(cohort):
    assert [recording.name for recording, _ in cohort] == ["subject_0001", "subject_0002", "subject_0003"]
    for recording, truth in cohort:
        time = truth.estimate.time
        assert recording.sampling_rate_hz == 50.0
        np.testing.assert_allclose(np.diff(time), 0.02, atol=1e-12)
        assert tuple(recording.sensors) == simulate.FOUR
        assert recording.sensors["shank_left"].gyr.shape == (time.size, 3)
        assert truth.motion.pose.pelvis.origin.x.shape == time.shape
        assert truth.estimate.distance[-1] == pytest.approx(5.0, abs=1e-9)
        assert bool(truth.estimate.valid.all())
        # Ideal sensors at rest read gravity, in SI units.
        assert np.linalg.norm(recording.sensors["thigh_right"].acc[0]) == pytest.approx(9.80665, abs=1e-6)


def test_who_else_walks_changes_nothing(cohort):
    who, how = jax.random.split(jax.random.key(1))
    drawn, key, along = simulate.population(who, 3, recorded=False), jax.random.fold_in(how, 2), simulate.straight(5.0)
    person = simulate.covering(key, simulate.person_of(drawn, 2), along)
    alone = simulate.walks([key] * 2, [person] * 2, [along] * 2, rate=50.0, placements=simulate.FOUR)
    for one in alone:
        for a, b in zip(jax.tree.leaves(one[1].estimate), jax.tree.leaves(cohort[2][1].estimate), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-9)
        for name, imu in one[0].sensors.items():
            np.testing.assert_allclose(imu.acc, cohort[2][0].sensors[name].acc, atol=1e-6)


def test_a_route_that_overstretches_a_leg_is_refused_by_the_name_of_who_walks():
    keys = [jax.random.key(0)] * 2
    wall = simulate.route({"length": 1.0}, {"length": 4.0, "riser": 0.9}, {"length": 1.0})
    level = simulate.route({"length": 1.0}, {"length": 4.0}, {"length": 1.0})
    assert simulate.covering(keys[0], Person(), wall).gait.knee_stance == Person().gait.knee_stance  # too much to mend
    words = r"a leg of 0\.859 m would be overstretched by .* mm on the route of second; raise knee_stance"
    with pytest.raises(ValueError, match=words):
        simulate.walks(keys, [Person()] * 2, [level, wall], names=["first", "second"])
