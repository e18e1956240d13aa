"""Contacts, strides and distance of simulated waists of which they are known, and what every estimator owes."""

import re

import jax
import numpy as np
import pytest
from made.notes import codes, of_code, texts
from made.trunk import about_vertical, cut, imu_of, joined, rotation, turned, walk, worn

from jgait import simulate
from jgait.estimators import waist
from jgait.estimators.stride_flags import UNSURE, in_order, regular
from jgait.estimators.waist import FLAGS, WaistOptions, WaistParams
from jgait.estimators.waist.about import ABOUT
from jgait.simulate import sensors

KNOWN = WaistParams(
    pendulum_constant=1.112, pendulum_constant_sd=0.02, start_gain=1.08, pendulum_length_sd=0.01
)  # fmt: skip
"""The simulated trunk's own constant and gain of the start: real ones have 1.18 and 0.92."""

EDGE = 0.7
"""[s] The simulated pelvis is shifted before the first step and shaken after the last, which counts as a contact."""


def estimated(recording, p=KNOWN, options=waist.DEFAULT):
    return waist.estimate(p, recording, options)


def notes(estimate):
    return " | ".join(texts(estimate.diagnostics["notes"]))


@pytest.fixture(scope="module")
def straight():
    made = walk()
    return made, estimated(made.recording)


@pytest.fixture(scope="module")
def bent():
    made = walk(np.pi)
    return made, estimated(made.recording)


def contacts_agree(made, estimate):
    """Every contact but the last, that of a foot which closes up, is found in time and with its side."""
    found, side = (np.asarray(estimate.diagnostics[f"initial_contact{name}"]) for name in ("", "_side"))
    near = np.argmin(np.abs(found[None, :] - made.contact[:-1, None]), axis=1)
    np.testing.assert_allclose(found[near], made.contact[:-1], atol=0.06)
    np.testing.assert_array_equal(side[near], made.side[:-1])
    other = np.delete(found, near)
    at_an_edge = (np.abs(other - made.contact[0]) < EDGE) | (np.abs(other - made.contact[-1]) < EDGE)
    assert at_an_edge.all() and len(other) <= 3


def test_a_straight_walk(straight):
    made, estimate = straight
    contacts_agree(made, estimate)
    # of the distance 5 % are at both ends, where the pelvis is shifted before a foot moves
    np.testing.assert_allclose(estimate.distance[-1], made.distance, rtol=0.06)
    assert abs(estimate.distance[-1] - made.distance) < 2.0 * estimate.diagnostics["distance_stddev"][-1]
    strides = estimate.strides
    np.testing.assert_allclose(strides.length[4:12], 1.32, rtol=0.01)
    np.testing.assert_allclose(strides.speed, strides.length / (strides.end - strides.start), rtol=1e-12)
    np.testing.assert_allclose((strides.end - strides.start)[4:12], 1.06, atol=0.02)
    np.testing.assert_allclose(strides.step_length[4:12], 0.66, rtol=0.04)
    np.testing.assert_allclose(strides.turn, 0.0, atol=0.02)
    np.testing.assert_array_equal(np.diff(strides.side) != 0, True)
    assert np.min(np.diff(estimate.distance)) > -1e-9  # nobody walks backwards
    # the shake after the walk, which counts as a contact, has no known side
    assert not any(estimate.diagnostics[name][:-1].any() for name in FLAGS)
    stated = estimate.strides_stddev.length  # setting off and stopping tell less
    assert np.all((stated > 0.01) & (stated < 0.3)) and np.all(stated[2:-2] < 0.15)
    step, of_step = strides.step_length, estimate.strides_stddev.step_length
    assert np.all(((of_step >= 0.5 * stated) & (of_step <= stated))[2:-2])  # errors of two steps are partly the same
    assert np.all(np.abs(step - 0.66)[4:12] <= 2.0 * of_step[4:12])
    assert 0.3 < estimate.diagnostics["nis"] < 2.0  # steps at both ends are trusted less than they deserve here
    assert "its z axis looks up and its x forward" in notes(estimate)
    assert estimate.valid.all()


MOUNTS = {
    "upside down": (np.diag([1.0, -1.0, -1.0]), "its −z axis looks up and its x forward"),
    "turned": (about_vertical(np.deg2rad(40.0)), "x forward, leaning 0° and turned 39°"),
    "at the side": (about_vertical(0.5 * np.pi), "its z axis looks up and its −y forward"),
    "any": (rotation(), "axis looks up"),
}  # fmt: skip


@pytest.mark.parametrize("name", MOUNTS)
def test_mounting_changes_nothing_and_is_noted(straight, name):
    made, plain = straight
    mount, says = MOUNTS[name]
    told = estimated(turned(made.recording, mount))
    for field in ("length", "end", "turn", "side"):
        np.testing.assert_allclose(getattr(told.strides, field), getattr(plain.strides, field), atol=1e-6)
    np.testing.assert_allclose(told.distance, plain.distance, atol=1e-6)
    assert says in notes(told)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_left_handed_triad_is_noticed(straight, axis):
    made, plain = straight
    flip = np.ones(3)
    flip[axis] = -1.0
    imu = imu_of(made.recording)
    told = estimated(worn(made.recording, gyr=imu.gyr * flip, acc=imu.acc * flip))
    assert "its gyroscope turns the other way than gravity" in notes(told)
    assert "gyroscope" not in notes(plain)
    np.testing.assert_allclose(told.distance, plain.distance, atol=1e-6)


def test_a_sensor_that_lies_on_the_floor_is_noted(straight):
    """It falls off in the walk; what it cannot measure from then on is named, and no reversed gyroscope."""
    made, plain = straight
    imu, time = imu_of(made.recording), np.asarray(plain.time)
    fallen = (time > 6.0)[:, None]
    acc, gyr = np.where(fallen, [0.0, 9.8, 0.3], imu.acc), np.where(fallen, 0.0, imu.gyr)
    told = notes(estimated(worn(made.recording, gyr=gyr, acc=acc)))
    lies = rf"for {time[-1] - 6.0:.0f}\.\d s, first at 6\.\d s, the sensor is turned by up to \d+°"
    assert re.search(lies, told), told
    assert "gyroscope" not in told
    assert "is turned by" not in notes(plain)


@pytest.mark.parametrize("hurry", [1.0, 0.75])
def test_a_pelvis_that_hardly_leans_is_no_reversed_gyroscope(hurry):
    """Its likelihood grows with the sign reversed, the more the larger the accelerations; sides would be exchanged."""
    person = simulate.person_of(simulate.population(jax.random.key(960), 24, recorded=True), 6)
    person = person._replace(gait=person.gait._replace(stride_time=hurry * person.gait.stride_time))
    key = jax.random.fold_in(jax.random.key(961), 6)
    along = simulate.straight(16.0)
    recording, truth = simulate.recording(key, simulate.covering(key, person, along), along, placements=("waist",))
    estimate = estimated(recording)
    assert "gyroscope" not in notes(estimate)
    rows = np.flatnonzero(truth.strides.valid)
    near = np.abs(np.asarray(truth.strides.end)[rows][None] - np.asarray(estimate.strides.end)[:, None]).argmin(axis=1)
    np.testing.assert_array_equal(estimate.strides.side[:-1], np.asarray(truth.strides.side)[rows][near][:-1])


SLOPING = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])  # as on a lower back


@pytest.mark.parametrize("damage", ["order", "one axis"])
def test_a_gyroscope_that_contradicts_the_accelerometer_loses_no_part_of_the_walk(bent, damage):
    made, right = bent
    worn_so = turned(made.recording, SLOPING)
    imu = imu_of(worn_so)
    gyr = np.asarray(imu.gyr)
    wrong = gyr[:, [1, 2, 0]] if damage == "order" else gyr * [-1.0, 1.0, 1.0]
    estimate = estimated(worn(worn_so, gyr=wrong))
    assert [code for code in codes(estimate.diagnostics["notes"]) if "gyro" in code] == ["gyroscope_contradicts"]
    assert "gyroscope_contradicts" not in codes(right.diagnostics["notes"])
    np.testing.assert_allclose(estimate.distance[-1], right.distance[-1], rtol=0.05)
    found = estimate.diagnostics["initial_contact"]
    assert all(np.abs(found - at).min() < 0.06 for at in made.contact[:-2])
    # the size of the turn is known, sides are not
    flags = estimate.diagnostics
    assert flags["turning"].any() and not flags["turning"][:2].any()
    assert flags["side_unknown"].all() and not right.diagnostics["side_unknown"].all()


def test_a_turn_is_flagged_and_makes_integration_less_certain(bent):
    made, estimate = bent
    contacts_agree(made, estimate)
    np.testing.assert_allclose(estimate.distance[-1], made.distance, rtol=0.05)
    flags, strides = estimate.diagnostics, estimate.strides
    # every stride in the bend turns, and those around it not at all
    assert flags["turning"].any() and not flags["turning"][[0, 1, 2, -3, -2, -1]].any()
    first = int(np.argmax(flags["unsure"]))
    assert 5 < first < 10 and flags["unsure"][first:].all()
    assert UNSURE.read(estimate) is None  # lengths hold all the same, as stated
    np.testing.assert_allclose(np.sum(strides.turn[::2]), np.pi, atol=0.1)
    # a person can also turn on the spot
    assert np.all(estimate.strides_stddev.length[flags["turning"]] > 0.35 * estimate.strides.length[flags["turning"]])


def test_a_walk_that_does_not_begin_from_standing_is_noted(straight):
    made, whole = straight
    told = estimated(cut(made.recording, 5.0))
    assert "1 stretch of walking, first at 5.3 s, does not begin from standing" in notes(told)
    assert "not begin from" not in notes(whole)
    assert told.diagnostics["unsure"].all() and told.time[0] == 5.0
    per_metre = [e.diagnostics["distance_stddev"][-1] / e.distance[-1] for e in (told, whole)]
    assert per_metre[0] > 1.02 * per_metre[1]
    np.testing.assert_allclose(told.strides.length[2:8], 1.32, rtol=0.02)


def test_many_bouts_are_as_long_as_one(straight):
    recording = straight[0].recording
    one, many = (waist.estimate(waist.WaistParams(), joined(*[recording] * times)) for times in (1, 3))
    np.testing.assert_allclose(np.median(many.strides.length), np.median(one.strides.length), rtol=2e-3)
    np.testing.assert_allclose(many.distance[-1], 3.0 * one.distance[-1], rtol=5e-3)
    wide = [e.diagnostics["distance_stddev"][-1] / e.distance[-1] for e in (one, many)]
    assert wide[0] >= wide[1] > 0.04  # the error of the person's constant is that of all bouts


def test_walking_that_the_recording_cuts_off_is_noted(straight):
    made = straight[0]
    parts = (0.0, np.inf, []), (made.contact[3] + 0.1, np.inf, ["begins"]), (0.0, made.contact[-4] + 0.3, ["ends"])
    for first, last, noted in parts:
        notes = waist.estimate(waist.WaistParams(), cut(made.recording, first, last)).diagnostics["notes"]
        assert [note.values["does"] for note in of_code(notes, "walking_cut")] == noted


@pytest.mark.parametrize("name", ["2-2", "8-1", "17-1"])
def test_who_stands_after_the_last_contact_does_not_walk_there(data, name):
    """These recordings of `ipol_gait` end within a second after the last contact, too early for a rest."""
    (walk,) = data("ipol_gait", name)
    back = walk.recording._replace(sensors={"lower_back": walk.recording.sensors["lower_back"]})
    assert waist.prepared(back).quality["lower_back"].walks_after == 0.0


def test_each_bout_is_one_of_its_own():
    made = walk(steps=6, quiet=5.5)
    one, two = (estimated(r) for r in (cut(made.recording, 2.5), joined(*[cut(made.recording, 2.5)] * 2)))
    assert "not begin from" not in notes(two)
    assert not two.diagnostics["unsure"].any()
    # one's constant of the pendulum is not quite that of two
    np.testing.assert_allclose(two.distance[-1], 2.0 * one.distance[-1], rtol=0.05)
    pause = (two.time > 9.0) & (two.time < 11.0)
    assert np.ptp(two.distance[pause]) < 0.01
    late = two.strides.start[np.flatnonzero(two.strides.start > 9.0)]
    early = two.strides.end[np.flatnonzero(two.strides.start < 9.0)]
    assert len(late) >= 5 and len(early) >= 5 and early.max() < 9.0


def test_nobody_walks_backwards(data):
    """In two movements of this recording between rests the trunk swayed back."""
    (walk,) = data("mobgap_lab", "HA/001/Test11/Trial1")
    estimate = waist.estimate(WaistParams(), walk.recording)
    assert np.min(estimate.strides.length) > 0.0 and np.min(np.diff(estimate.distance)) > -1e-9


@pytest.mark.parametrize("stop", [0.7, 1.5])
def test_in_a_short_stop_nobody_gets_ahead(stop):
    """Distances with such stops were 11 to 24 % longer than without."""
    key, way = jax.random.key(51), simulate.straight(6.0)
    person = simulate.person_of(simulate.population(jax.random.key(50), 1, recorded=True), 0)
    walked, truth = simulate.with_breaks(
        key, simulate.covering(key, person, way), [way] * 3, [stop] * 2, placements=("lower_back",)
    )
    estimate = waist.estimate(WaistParams(), walked)
    straight = simulate.straight(18.0)
    plain, whole = simulate.recording(
        key, simulate.covering(key, person, straight), straight, placements=("lower_back",)
    )
    ratio = waist.estimate(WaistParams(), plain).distance[-1] / whole.estimate.distance[-1]
    true = np.asarray(truth.estimate.distance)
    np.testing.assert_allclose(estimate.distance[-1] / true[-1], ratio, rtol=WaistParams().start_noise)
    share = estimate.strides_stddev.length / estimate.strides.length
    assert np.median(share) < 0.1 and estimate.diagnostics["distance_stddev"][-1] < 0.1 * true[-1]


def test_in_a_bout_of_few_steps_forward_is_where_the_person_went_or_the_distance_is_unsure():
    """By the phase of the steps alone forward was up to 160° off, and distances up to 44 % too short."""
    people, way, right = simulate.population(jax.random.key(50), 6, recorded=True), simulate.straight(3.0), 0
    for number in range(6):
        key = jax.random.fold_in(jax.random.key(51), number)
        person = simulate.covering(key, simulate.person_of(people, number), way)
        recording, truth = simulate.recording(key, person, way, placements=("lower_back",))
        estimate = waist.estimate(WaistParams(), recording)
        found, true = estimate.diagnostics["notes"], float(truth.estimate.distance[-1])
        (axes,) = of_code(found, "axes_corrected")
        assert axes.severity == "info"  # no mounting is an error
        if axes.values["forward"] == "x" and axes.values["turned_deg"] < 15.0:
            assert "forward_unsure" not in codes(found)
            right += 1
            np.testing.assert_allclose(estimate.distance[-1], true, rtol=0.12)
        else:
            assert abs(estimate.distance[-1] - true) < 2.5 * estimate.diagnostics["distance_stddev"][-1]
    assert right >= 5


@pytest.mark.parametrize("riser, slope", [(0.17, 0.0), (-0.17, 0.0), (0.0, 0.08)])
def test_stairs_are_noted_and_uncertain_and_slopes_are_not(riser, slope):
    short = {"stride_length": 0.62, "stride_time": 1.2} if riser else {}
    along = simulate.route({"length": 3.0}, {"length": 4.0, "riser": riser, "slope": slope}, {"length": 3.0})
    key = jax.random.key(4)
    person = simulate.covering(key, simulate.Person(gait=simulate.Gait(knee_stance=0.2, **short)), along)
    recording, truth = simulate.recording(key, person, along, placements=("lower_back",))
    estimate = estimated(recording)
    found = of_code(estimate.diagnostics["notes"], "strides_not_learned")
    assert len(found) == bool(riser)
    if riser:
        assert found[0].values["rise_m"] == pytest.approx(0.34, abs=0.08)
        share = estimate.strides_stddev.length / estimate.strides.length
        assert np.sum(share > 0.6) == found[0].values["strides"] > 8
        assert 3.0 * estimate.diagnostics["distance_stddev"][-1] > estimate.distance[-1] - truth.estimate.distance[-1]


def test_who_does_not_walk_has_an_empty_table():
    rng = np.random.default_rng(0)
    imu = imu_of(walk().recording)
    still = worn(walk().recording, gyr=0.01 * rng.normal(size=imu.gyr.shape),
                 acc=[0.0, 0.0, 9.81] + 0.05 * rng.normal(size=imu.acc.shape))  # fmt: skip
    estimate = estimated(still)
    assert estimate.strides.length.size == estimate.strides_stddev.length.size == 0
    assert estimate.diagnostics["initial_contact"].size == 0
    np.testing.assert_array_equal(estimate.distance, 0.0)
    assert "waist does not walk" in notes(estimate)


def test_running_is_noted():
    runner = simulate.walking(simulate.Person(gait=simulate.Gait(steps=16.0)), "running")
    for who, noted in ((runner, True), (simulate.Person(gait=simulate.Gait(steps=16.0)), False)):
        recording, _ = simulate.recording(jax.random.key(0), who, placements=("lower_back",))
        assert ("running, or faster than the walks" in notes(estimated(recording))) == noted


@pytest.mark.parametrize(("number", "way", "stop"), [(7, 2.0, 2.0), (1, 6.0, 0.5), (6, 6.0, 0.5)])
def test_strides_beside_a_stop_are_as_uncertain_as_they_are_wrong(number, way, stop):
    """Regular strides of these people were off by 3 to 7 deviations, or nobody took them, and closing ones too long."""
    person = simulate.person_of(simulate.population(jax.random.key(21), 10, recorded=True), number)
    walked, truth = simulate.with_breaks(
        jax.random.key(number),
        person,
        [simulate.straight(way)] * 4,
        [stop] * 3,
        errors=sensors.MPU6000,
        placements=("lower_back",),
    )
    estimate = waist.estimate(waist.with_body(WaistParams(), {"sensor_height": person.body.sensor_height}), walked)
    true = truth.strides
    there = np.flatnonzero(true.valid)
    apart = np.abs(np.subtract.outer(estimate.strides.end, true.end[there]))
    nearest, taken = there[apart.argmin(axis=1)], apart.min(axis=1) < 0.3
    error, spread = estimate.strides.length - true.length[nearest], estimate.strides_stddev.length
    counts = regular(estimate, ABOUT.flags)[np.argsort(in_order(estimate))]
    assert np.all(np.abs(error)[counts & taken] < 2.5 * spread[counts & taken])
    assert np.all(spread[counts & ~taken] > 0.3 * estimate.strides.length[counts & ~taken])
    half = estimate.diagnostics["half"]
    assert half.sum() >= 2 and not np.any(half & counts)
    assert np.abs(np.median(error[half])) < 0.1


UNLIKE = {
    "slow": (
        [{"speed": 0.5}],
        "are shorter or slower than those from which step lengths were learned, 1.05 m and more",
    ),
    "some slow strides": ([{}, {"speed": 0.45, "steps": 10}], "strides, of 0.86 m at 0.49 m/s"),
}


@pytest.mark.parametrize("name", UNLIKE)
def test_strides_slower_than_those_learned_from_are_noted_and_uncertain(name):
    parts, words = UNLIKE[name]
    estimate = estimated(joined(*[walk(**part).recording for part in parts]))
    assert words in notes(estimate)
    strides = estimate.strides
    slow = strides.speed < 0.6
    slow[-1] = False  # it ends beside standing, and is integrated
    share = estimate.strides_stddev.length / strides.length
    assert slow.sum() > 4 and np.all(share[slow] > 0.35)
    assert name == "slow" or np.all(share[2:12] < 0.1)
    measured = np.sum(strides.length[slow]) / np.sum(strides.length)
    assert estimate.diagnostics["distance_stddev"][-1] > 0.35 * measured * estimate.distance[-1]


def test_options_parameters_and_measures_that_are_none_are_refused(straight):
    recording = straight[0].recording
    with pytest.raises(ValueError, match="distance must be one of fused, update; got 'far'"):
        estimated(recording, options=WaistOptions(distance="far"))
    with pytest.raises(ValueError, match="detector must be one of soft.*; got 'eye'"):
        estimated(recording, options=WaistOptions(detector="eye"))
    with pytest.raises(ValueError, match="sensor_height must be finite and positive; got nan: leave out what is unkn"):
        waist.with_body(WaistParams(), {"sensor_height": float("nan")})
    with pytest.raises(ValueError, match=r"height must be between 0.8 and 2.4 m; got 175 \(in cm\? then 1.75\)"):
        waist.with_body(WaistParams(), {"height": 175.0})
    assert waist.with_body(WaistParams(), {"height": 1.8}).pendulum_length == pytest.approx(1.08)
    assert waist.with_body(WaistParams(), {"height": 1.8, "sensor_height": 1.0}).pendulum_length == 1.0


@pytest.mark.parametrize("name", ["3-3", "18-2"])
def test_sides_of_people_whose_pelvis_turns_the_other_way(data, name):
    """By the yaw rate alone at most an eighth of the sides of these recordings of `ipol_gait` was right."""
    walk = next((walk for walk in data("ipol_gait") if walk.recording.name == name), None)
    if walk is None:
        pytest.skip(f"{name} is not here")
    back = walk.recording._replace(sensors={"lower_back": walk.recording.sensors["lower_back"]})
    found = waist.estimate(WaistParams(), cut(back, 0.0, 40.9)).diagnostics  # the longest trial ends after 30 s
    walked = walk.info["initial_contacts"] <= walk.info["trial"][1]
    contacts, sides = walk.info["initial_contacts"][walked], walk.info["initial_contact_sides"][walked]
    apart = np.abs(np.asarray(found["initial_contact"])[:, None] - contacts)
    near = apart.min(axis=0) < 0.2
    assert near.mean() > 0.9
    right = np.asarray(found["initial_contact_side"])[apart.argmin(axis=0)] == sides
    assert right[near].mean() > 0.95


def test_both_steps_of_who_limps_are_found():
    key, way = jax.random.key(0), simulate.straight(12.0)
    people = simulate.population(jax.random.key(5), 1, recorded=True)
    person = simulate.covering(key, simulate.walking(simulate.person_of(people, 0), "limping"), way)
    recording, truth = simulate.recording(key, person, way, placements=("waist",))
    strides, true = estimated(recording).strides, truth.strides
    lasts, usual = (np.median((each.end - each.start)[np.asarray(each.valid)]) for each in (strides, true))
    assert lasts == pytest.approx(usual, rel=0.05)


@pytest.mark.parametrize("steps_min", [165.0, 180.0])
def test_all_steps_of_a_quick_child_are_found_with_their_sides(steps_min):
    key, way, size = jax.random.key(3), simulate.straight(12.0), 1.2 / 1.75
    gait = simulate.gait(stride_length=1.0, cadence=steps_min, stature=1.2)
    sizes = {f"pelvis_{name}": size * getattr(gait, f"pelvis_{name}") for name in ("rise", "surge", "sway")}
    body = simulate.Body(*(size * length for length in simulate.Body()))
    gait = gait._replace(step_width=size * gait.step_width, **sizes)
    child = simulate.covering(key, simulate.Person(body, gait), way)
    recording, truth = simulate.recording(key, child, way, placements=("waist",))
    estimate = waist.estimate(WaistParams(), recording)
    found, side = (np.asarray(estimate.diagnostics[f"initial_contact{name}"]) for name in ("", "_side"))
    rows = np.flatnonzero(truth.strides.valid)[2:-2]
    at = np.asarray(truth.strides.end)[rows]
    near = np.argmin(np.abs(found[None, :] - at[:, None]), axis=1)
    np.testing.assert_allclose(found[near], at, atol=0.06)
    np.testing.assert_array_equal(side[near], np.asarray(truth.strides.side)[rows])
    np.testing.assert_allclose(np.diff(found)[3:-3], 60.0 / steps_min, rtol=0.15)
    assert not estimate.diagnostics["side_unknown"][:-1].any()
