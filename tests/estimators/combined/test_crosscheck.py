"""Mistakes in wearing, labels, units and clocks are found and named; correct walks raise nothing."""

import itertools

import jax
import numpy as np
import pytest
from made.estimators import changed, exchanged, only
from made.notes import codes, of_code

from jgait import simulate
from jgait.estimators.checks import fast_rate
from jgait.estimators.combined import crosscheck
from jgait.simulate.sensors import OPAL
from jgait.types import Imu

LEGS = tuple(f"{kind}_{side}" for kind in ("thigh", "shank", "foot") for side in ("right", "left"))
PLACEMENTS = ("pelvis", *LEGS)
HALF_TURN = np.array([-1.0, 1.0, -1.0])


@pytest.fixture(scope="module")
def recording():
    ((walked, _),) = simulate.cohort(
        jax.random.key(3), 1, simulate.straight(12.0), OPAL, 100.0, PLACEMENTS, recorded=False
    )
    return walked


def late(imu, samples=50):
    def moved(values):
        return np.concatenate([np.repeat(values[:1], samples, axis=0), values[:-samples]])

    return imu._replace(gyr=moved(np.asarray(imu.gyr)), acc=moved(np.asarray(imu.acc)))


def test_a_correct_walk_raises_nothing(recording):
    found = crosscheck(recording)
    assert found.notes == ()
    assert not found.unusable and not found.doubtful


def test_short_bouts_whose_strides_mostly_end_in_standing_raise_nothing():
    person = simulate.Person(gait=simulate.gait(speed=1.1, stature=1.75))
    ways, breaks = [simulate.straight(2.4)] * 5, [3.0] * 4
    walked, _ = simulate.with_breaks(jax.random.key(0), person, ways, breaks, OPAL, placements=LEGS)
    assert crosscheck(walked).notes == ()
    (note,) = crosscheck(exchanged(walked, "shank_right", "shank_left")).notes
    assert note.code == "places_exchanged"


def test_nothing_is_said_of_places_units_and_clocks_of_a_person_who_stands(recording):
    stands = np.asarray(recording.sensors["pelvis"].time) < 2.8
    rng, sensors = np.random.default_rng(1), {}
    for number, (name, imu) in enumerate(recording.sensors.items()):
        sway = (0.002 * 3.0 ** (number % 3)) * rng.normal(size=(stands.sum(), 3))  # some sensors move more than others
        gyr = np.asarray(imu.gyr)[stands] * 3.0 ** -(number % 2) + sway
        sensors[name] = Imu(imu.time[stands], gyr, imu.acc[stands], imu.mask[stands])
    standing = recording._replace(sensors=sensors)
    for one in (standing, exchanged(standing, "thigh_left", "shank_left")):
        assert crosscheck(one).notes == ()


def other_leg(name):
    return name.replace("right", "*").replace("left", "right").replace("*", "left")


EXCHANGES = [
    *(dict([pair, pair[::-1]]) for pair in itertools.combinations(LEGS, 2)),
    {name: other_leg(name) for name in LEGS},
    {"foot_left": "shank_left", "shank_left": "thigh_left", "thigh_left": "foot_left"},
]


@pytest.mark.parametrize("order", EXCHANGES, ids=lambda order: "-".join(order))
def test_exchanged_sensors_are_named_and_taken_the_other_way_round(recording, order):
    """Two sensors of a leg or of two legs, all of both legs, and three of a leg of which none is in its place."""
    for kept in (PLACEMENTS, LEGS[:4]) if set(order) <= set(LEGS[:4]) else (PLACEMENTS,):
        worn = only(recording, *kept)
        wrong = worn._replace(sensors={name: worn.sensors[order.get(name, name)] for name in kept})
        found = crosscheck(wrong)
        assert codes(found.notes) == ["places_exchanged"]
        assert found.replaced == set(order) and not found.doubtful
        assert all(found.sensors[name] is imu for name, imu in worn.sensors.items())


@pytest.mark.parametrize("name", ["foot_left", "pelvis"])
@pytest.mark.parametrize("factor", [np.pi / 180.0, 180.0 / np.pi])
def test_a_gyroscope_in_another_unit_is_left_out(recording, name, factor):
    imu = recording.sensors[name]
    found = crosscheck(changed(recording, **{name: imu._replace(gyr=np.asarray(imu.gyr) * factor)}))
    assert [(note.code, note.values["placement"]) for note in found.notes] == [("sensor_unit", name)]
    assert found.unusable == {name}


@pytest.mark.parametrize("wrong", [("thigh_right", "thigh_left"), ("shank_right", "thigh_left"), ("shank_right",)])
def test_half_of_the_gyroscopes_in_another_unit_do_not_accuse_the_others(recording, wrong):
    slow = {name: imu._replace(gyr=np.deg2rad(imu.gyr)) for name, imu in only(recording, *wrong).sensors.items()}
    found = crosscheck(changed(only(recording, *simulate.FOUR), **slow))
    assert found.unusable == set(wrong)
    assert {note.values["placement"] for note in of_code(found.notes, "sensor_unit")} == set(wrong)


def test_an_accelerometer_in_g_is_left_out(recording):
    imu = recording.sensors["shank_left"]
    found = crosscheck(changed(recording, shank_left=imu._replace(acc=np.asarray(imu.acc) / 9.81)))
    assert ["seems to be in g:" in str(note) for note in found.notes] == [True]
    assert found.unusable == {"shank_left"}


@pytest.mark.parametrize("name", ["thigh_left", "shank_right", "pelvis"])
def test_a_sensor_upside_down_is_used_as_any_other(recording, name):
    imu = recording.sensors[name]
    turned = imu._replace(gyr=np.asarray(imu.gyr) * HALF_TURN, acc=np.asarray(imu.acc) * HALF_TURN)
    found = crosscheck(changed(recording, **{name: turned}))
    assert not found.notes and not found.unusable and not found.doubtful


@pytest.mark.parametrize("name", PLACEMENTS)
def test_a_late_clock_is_named(recording, name):
    found = crosscheck(changed(recording, **{name: late(recording.sensors[name])}))
    (note,) = found.notes
    assert str(note).startswith(f"the clock of {name} seems to be about 0.")
    assert note.values["direction"] in ("late", "late or early")
    assert abs(note.values["seconds"] - 0.5) < 0.15
    assert found.doubtful == {name}


def test_exchanged_feet_of_a_person_who_limps_are_not_feet_on_shanks():
    who = simulate.walking(simulate.Person(), "limping")
    key, along = jax.random.key(0), simulate.straight(12.0)
    limps, _ = simulate.recording(key, simulate.covering(key, who, along), along, OPAL, placements=LEGS)
    found = crosscheck(exchanged(limps, "foot_right", "foot_left"))
    assert {"foot_right", "foot_left"} in (found.replaced, found.doubtful)


@pytest.mark.parametrize("gait", ["limping", "hemiparetic"])
def test_the_foot_and_the_other_shank_of_a_person_who_limps_have_not_changed_places(gait):
    """The shank of the sound leg rests more than the foot of the other, but leans otherwise each time."""
    along = simulate.u_turn(8.0)
    person = simulate.person_of(simulate.population(jax.random.key(50), 4, recorded=True), 3)
    walker = simulate.covering(jax.random.key(52), simulate.walking(person, gait), along)
    walked, _ = simulate.recording(jax.random.key(52), walker, along, placements=LEGS)
    for foot, shank in (("foot_right", "shank_left"), ("foot_left", "shank_right"), ("foot_right", "shank_right")):
        pair = only(walked, foot, shank)
        assert not crosscheck(pair).replaced
        wrong = crosscheck(exchanged(pair, foot, shank))
        assert gait != "limping" or wrong.replaced == {foot, shank} or wrong.notes


def test_a_stiff_leg_whose_foot_turns_less_than_its_thigh_is_not_accused():
    who = simulate.walking(simulate.Person(), "stiff_leg")
    key, along = jax.random.key(0), simulate.straight(12.0)
    stiff, _ = simulate.recording(key, simulate.covering(key, who, along), along, OPAL, placements=LEGS)
    assert fast_rate(stiff.sensors["thigh_right"]) > 1.25 * fast_rate(stiff.sensors["foot_right"])
    found = crosscheck(stiff)
    assert not found.crossed | found.replaced


def test_two_feet_that_swing_together_contradict_each_other(recording):
    feet = only(recording, "foot_right", "foot_left")
    (note,) = crosscheck(changed(feet, foot_left=late(feet.sensors["foot_left"]))).notes
    assert note.code == "clock_off"


def test_real_walks_with_two_exchanged_sensors(data):
    walks = data("walking5m")
    named = {walk.recording.name: codes(crosscheck(walk.recording).notes) for walk in walks}
    wrong = {name for name, found in named.items() if found}
    assert {name.rpartition("/")[2] for name in wrong} == {"20180417_2", "20180417_4"}
    assert all(found in ([], ["places_exchanged"]) for found in named.values())
