"""Walking is a hypothesis: other movements are taken for standing, and walks of all kinds stay as they are."""

import itertools

import jax
import numpy as np
import pytest
from made.estimators import only
from made.notes import codes
from scipy.spatial.transform import Rotation

from experiments.unseen2.bodies import CHOSEN, JUDGED, readings
from experiments.unseen2.movements import Case, of_person, variants
from jgait import simulate
from jgait.estimators import ankle_stride, foot_ins, waist
from jgait.estimators.walking import walking_alone
from jgait.events.movement import movement
from jgait.simulate.sensors import MPU6000, OPAL
from jgait.types import Imu, Recording, as_float

EVERY = {**CHOSEN, **JUDGED}


@pytest.fixture(scope="module")
def walks():
    return of_person(0)


def case(walks, kind: str, place: str, sensors: str) -> Case:
    made = variants(kind, EVERY[kind], place, *walks, seed=7)
    return next(each for each in made if each.sensors == sensors)


@pytest.mark.parametrize(("kind", "place"), [*zip(EVERY, itertools.cycle(["before", "between", "after"]))])
def test_other_movements_are_taken_for_standing_and_the_walks_are_kept(walks, kind, place):
    made = case(walks, kind, place, "seven")
    found = walking_alone(made.recording)
    begin, end = made.span
    assert found.spans and codes(found.notes) == ["not_walking"] * len(found.notes)
    assert all(begin - 1.0 < a < b < end + 2.0 for a, b in found.spans)
    assert sum(b - a for a, b in found.spans) > 0.5 * (end - begin)
    for name, imu in made.recording.sensors.items():
        time, ours = as_float(imu.time), found.recording.sensors[name]
        beside = (time < begin - 1.0) | (time > end + 2.0)
        np.testing.assert_array_equal(as_float(ours.acc)[beside], as_float(imu.acc)[beside])
        assert as_float(ours.mask).all()
    again = walking_alone(found.recording)
    assert again.spans == found.spans and again.recording is found.recording and not again.notes


@pytest.mark.parametrize("gait", ["usual", *simulate.GAITS])
def test_walks_of_every_gait_stay_as_they_are(gait):
    person = simulate.Person() if gait == "usual" else simulate.walking(simulate.Person(), gait)
    whole, _ = simulate.recording(jax.random.key(3), person)
    for sensors in (simulate.SEVEN, ("pelvis",), ("shank_right", "shank_left"), ("foot_right",)):
        recording = only(whole, *sensors)
        found = walking_alone(recording)
        assert found.spans == () and not found.notes
        assert all(found.recording.sensors[name] is imu for name, imu in recording.sensors.items())


def test_a_shank_that_turns_round_calmly_at_the_end_of_stance_does_not_stand_there():
    """The foot then pushes off, and the shank's velocity is not that about a foot that stands."""
    placements = ("thigh_right", "shank_right")
    ((recording, _),) = simulate.cohort(jax.random.key(2), 1, simulate.straight(12.0), OPAL, 100.0, placements)
    assert walking_alone(recording).spans == ()


@pytest.mark.parametrize("sensors", [("shank_right", "shank_left"), ("foot_right", "foot_left")])
@pytest.mark.parametrize("slower", [0.15, 0.2, 0.3])
def test_a_slow_part_of_a_walk_is_walking(sensors, slower):
    """Alone it could be taken for another movement; the person would have had to change to it without a rest."""
    key, along = jax.random.key(1), simulate.faster(5.0, 1.0, slower)
    walker = simulate.covering(key, simulate.Person(gait=simulate.gait(speed=1.1, stature=1.75)), along)
    assert walking_alone(simulate.recording(key, walker, along, MPU6000, placements=sensors)[0]).spans == ()


def test_how_sensors_are_mounted_changes_nothing(walks):
    recording = case(walks, "stepping in place", "before", "seven").recording
    rng, turned = np.random.default_rng(0), {}
    for name, imu in recording.sensors.items():
        turn = Rotation.from_rotvec(rng.normal(size=3) * 2.0)
        turned[name] = imu._replace(gyr=turn.apply(imu.gyr), acc=turn.apply(imu.acc))
    plain, other = (movement(recording._replace(sensors=sensors)) for sensors in (recording.sensors, turned))
    np.testing.assert_array_equal(plain.quiet, other.quiet)
    for kind, chance in plain.probability.items():
        np.testing.assert_allclose(other.probability[kind], chance, atol=1e-9)


@pytest.mark.parametrize(
    ("kind", "sensors", "estimator"),
    [
        ("stepping in place", "waist", waist),
        ("stepping in place", "shanks", ankle_stride),
        ("leg swings", "feet", foot_ins),
    ],
)
def test_strides_of_a_walk_do_not_depend_on_what_was_done_before(walks, kind, sensors, estimator):
    made = case(walks, kind, "before", sensors)
    method = estimator.estimator()
    ours, alone = (method.estimate(method.params, one) for one in (made.recording, made.alone))
    assert len(ours.strides.length) == len(alone.strides.length)
    assert as_float(ours.strides.start).min() > made.span[1]
    assert as_float(ours.distance)[-1] == pytest.approx(as_float(alone.distance)[-1], rel=0.02)
    if method.through:  # its path goes on: the foot swings, and comes back to where it stood
        path = np.linalg.norm(as_float(ours.feet.right.position)[as_float(ours.time) < made.span[1] + 1.0], axis=1)
        assert ours.valid.all() and 0.1 < path.max() < 1.2 and path[-1] < 0.2
        return
    time, moved = as_float(ours.time), movement(made.recording)
    moves = np.interp(time, moved.time, moved.quiet) == 0.0  # they stand between movements of both legs
    assert not np.asarray(ours.valid)[moves & (time > made.span[0] + 2.5) & (time < made.span[1] - 1.5)].any()


def test_a_movement_without_any_walk_gives_no_strides(walks):
    time_of = {}
    for name, (gyr, acc) in readings(CHOSEN["stepping in place"](np.random.default_rng(1))).items():
        time = np.arange(len(gyr)) / 100.0
        time_of[name] = Imu(time, gyr, acc, np.ones(len(time), bool))
    shanks = Recording({name: time_of[name] for name in ("shank_right", "shank_left")}, 100.0)
    result = ankle_stride.estimate(ankle_stride.AnkleParams(), shanks)
    assert len(result.strides.length) == 0 and "not_walking" in codes(result.diagnostics["notes"])


def test_gyroscopes_that_sleep_most_of_the_time_are_no_evidence(walks):
    recording = case(walks, "stepping in place", "before", "shanks").alone
    sensors = {}
    for name, imu in recording.sensors.items():
        mask = np.arange(len(imu.time)) % 100 < 30
        sensors[name] = imu._replace(gyr=np.where(mask[:, None], imu.gyr, 0.0), mask=mask)
    assert walking_alone(recording._replace(sensors=sensors)).spans == ()


def test_the_path_of_a_foot_that_steps_in_place_is_that_of_its_marker(data):
    """It drifted by 480 m while its movement was replaced by lost samples."""
    (walk,) = data("pyshoe_vicon", "2018-02-09-11-16-53")
    ours, marker = foot_ins.estimate(foot_ins.FootParams(), walk.recording), walk.reference.feet.right
    assert not len(ours.strides.length) and ours.valid.all()
    rise = [np.ptp(as_float(position)[:, 2]) for position in (ours.feet.right.position, marker.position)]
    assert rise[0] == pytest.approx(rise[1], abs=0.05) and np.ptp(as_float(ours.feet.right.position)[:, :2]) < 0.3
