"""What losses, ends of a recording, and turns hide of a walk: it is in the distance, and in its deviation."""

import jax
import numpy as np
import pytest
from made.estimators import changed, without
from made.notes import of_code
from made.shank import shank
from made.trunk import cut
from made.trunk import walk as trunk_walk

import jgait
from jgait import simulate
from jgait.estimators.combined.sources import SIDES_UNLIKE, SourceEstimate, alike, with_sides_unlike
from jgait.simulate.sensors import MPU6000, OPAL
from jgait.types import Estimate, Legs, Strides

LENGTH, STRIDES = 1.2, 16


def over_losses(found):
    return [note.values for note in of_code(found.notes, "distance_added") if "losses" in str(note)]


@pytest.mark.parametrize(("begin", "seconds"), [(6.0, 1.5), (6.5, 4.0)])
def test_a_loss_in_walking_is_walked_through(begin, seconds):
    made = shank(strides=STRIDES)
    found = jgait.analyse(without(made.recording, begin, seconds))
    distance, deviation = found.estimate.distance[-1], found.estimate.diagnostics["distance_stddev"][-1]
    assert abs(distance - STRIDES * LENGTH) < deviation < 0.15 * STRIDES * LENGTH
    (values,) = over_losses(found)
    missing = STRIDES - len(found.strides.first)
    assert values["metres"] == pytest.approx(missing * LENGTH, rel=0.1)
    assert deviation > 0.25 * values["metres"]
    assert np.all(np.diff(found.estimate.distance) > -1e-9)


@pytest.mark.parametrize("seconds", [0.2, 0.45])
def test_a_short_loss_at_any_phase_of_a_stride_takes_nothing_away(seconds):
    """A stance that is lost, or that is cut off between push-off and swing, begins and ends no stride."""
    made = shank(strides=STRIDES)
    for begin in np.arange(6.0, 7.3, 0.26):
        found = jgait.analyse(without(made.recording, begin, seconds)).estimate
        distance, deviation = found.distance[-1], found.diagnostics["distance_stddev"][-1]
        assert abs(distance - STRIDES * LENGTH) < 3.0 * deviation < 0.3 * STRIDES * LENGTH, begin


@pytest.mark.parametrize("seconds", [0.4, 1.5])
def test_losses_count_once_in_the_distance_of_the_trunk(seconds):
    """Its distance goes on over losses in which its strides are left out."""
    recording = trunk_walk(steps=40).recording
    whole = jgait.analyse(recording).estimate
    for begin in (7.0, 9.0, 13.0):
        recording = without(recording, begin, seconds)
    found = jgait.analyse(recording)
    assert len(found.strides.first) < len(whole.strides.side) - 6
    deviation = found.estimate.diagnostics["distance_stddev"][-1]
    assert abs(found.estimate.distance[-1] - whole.distance[-1]) < min(0.05 * whole.distance[-1], deviation)


def test_a_loss_after_the_last_stride_counts_in_the_deviation_alone():
    made = shank(strides=STRIDES)
    whole = jgait.analyse(made.recording).estimate
    found = jgait.analyse(without(made.recording, made.contact[-1] + 0.4, 0.6))
    assert not over_losses(found)
    assert found.estimate.distance[-1] == pytest.approx(whole.distance[-1], abs=0.05)
    assert found.estimate.diagnostics["distance_stddev"][-1] > whole.diagnostics["distance_stddev"][-1] + 0.3


PERIOD_S = 1.1


def cuts(notes):
    """Seconds that are cut off before and after."""
    found = {note.values["does"]: note.values["seconds"] for note in of_code(notes, "walking_cut")}
    return [found.get(does, 0.0) for does in ("begins", "ends")]


@pytest.mark.parametrize("at", [0.0, 0.25, 0.75])
def test_what_is_cut_off_counts_in_the_distance(at):
    """The walk is the same in each period, so five periods are five strides, wherever they begin."""
    first = 2.5 + at
    found = jgait.analyse(cut(shank(strides=8).recording, first, first + 5 * PERIOD_S - 0.01))
    distance, deviation = found.estimate.distance[-1], found.estimate.diagnostics["distance_stddev"][-1]
    assert abs(distance - 5 * LENGTH) < 2.0 * deviation < 1.0
    before, after = cuts(found.notes)
    whole = len(found.strides.first) * PERIOD_S
    assert before + after == pytest.approx(5 * PERIOD_S - whole, abs=0.2)
    assert of_code(found.notes, "distance_added")
    assert found.estimate.distance[0] == pytest.approx(0.0, abs=1e-9)
    assert np.all(np.diff(found.estimate.distance) > -1e-9)


def test_a_circle_is_as_long_as_it_is():
    placements = ("foot_right", "foot_left", "shank_right", "shank_left")
    recording, truth = simulate.recording(
        jax.random.key(1), along=simulate.circle(1.2, 3), errors=OPAL, placements=placements
    )
    true = float(truth.estimate.distance[-1])
    found = {one.source: one for one in jgait.analyse(recording).comparisons if one.quantity == "distance"}
    for name in ("feet", "shanks", "combined"):
        assert found[name].value == pytest.approx(true, abs=2.5 * found[name].stddev), name
    assert found["feet"].value == pytest.approx(true, rel=0.05)


def test_strides_of_a_limping_leg_and_the_distance_err_as_stated():
    """The stance of a limping leg is short."""
    gait = simulate.gait(stride_length=0.9, cadence=80.0, stature=1.75)
    gait = gait._replace(length_asymmetry=0.2, time_asymmetry=0.15, length_variability=0.04, time_variability=0.03)
    key, along = jax.random.key(3), simulate.u_turn(10.0)
    walker = simulate.covering(key, simulate.Person(gait=gait), along)
    recording, truth = simulate.recording(key, walker, along, MPU6000, placements=("shank_right", "shank_left"))
    found = jgait.analyse(recording, {"height": 1.75})
    strides, deviations = found.strides.strides, found.strides.stddev
    valid = np.asarray(truth.strides.valid, bool)
    for side in (0, 1):
        true = np.asarray(truth.strides.length)[valid & (np.asarray(truth.strides.side) == side)]
        rows = np.asarray(strides.side) == side
        assert abs(np.median(strides.length[rows]) - np.median(true)) < 3.0 * np.median(deviations.length[rows])
    off = found.estimate.distance[-1] - truth.estimate.distance[-1]
    assert abs(off) < 2.0 * found.estimate.diagnostics["distance_stddev"][-1] < 0.4 * truth.estimate.distance[-1]


def test_sides_whose_strides_differ_in_length_are_named_and_the_deviations_contain_it():
    """With a smaller difference, or where another note explains it, nothing is named."""
    side, start = np.arange(24) % 2, 0.5 * np.arange(24)
    length = np.where(side == 0, 0.64, 0.74)
    strides = Strides(side=side, start=start, final_contact=start + 0.6, end=start + 1.0, length=length,
                      width=0.0 * length, height=0.0 * length, valid=np.ones(24, bool), turn=0.0 * length)  # fmt: skip
    estimate = Estimate(
        np.arange(14.0), Legs(None, None), None, np.linspace(0.0, 8.3, 14), np.ones(14, bool),
        {"notes": (), "distance_stddev": np.full(14, 0.1)}, strides,
        strides_stddev=strides._replace(length=np.full(24, 0.02)),
    )  # fmt: skip
    source = SourceEstimate("shanks", "ankle_stride", ("shank_right", "shank_left"), estimate, None)
    (found,), (note,) = with_sides_unlike([source], frozenset())
    assert note.text == SIDES_UNLIKE(source="shanks", right=0.64, left=0.74, strides=12).text
    assert np.hypot(0.02, 0.06) > found.estimate.strides_stddev.length.min() > 0.04
    assert found.estimate.diagnostics["distance_stddev"][-1] > 0.5
    near = source._replace(estimate=estimate._replace(strides=strides._replace(length=np.where(side == 0, 0.7, 0.74))))
    assert with_sides_unlike([near], frozenset())[1] == with_sides_unlike([source], frozenset(["shank_left"]))[1] == []
    assert not alike([source], frozenset(source.placements))
    same = near._replace(estimate=estimate._replace(strides=strides._replace(length=np.full(24, 0.7))))
    assert alike([same], frozenset(source.placements))


def test_a_bout_that_only_one_side_saw_has_its_whole_length():
    """The left shoe's sensor stops between two bouts: the distance is by the right one, and so is each bout."""
    person = simulate.person_of(simulate.population(jax.random.key(3), 1, recorded=False), 0)
    recording, truth = simulate.with_breaks(
        jax.random.key(4), person, [simulate.straight(12.0), simulate.straight(9.0)], [6.0], OPAL,
        placements=("foot_right", "foot_left"),
    )  # fmt: skip
    ends = np.sort(truth.strides.end[np.asarray(truth.strides.valid)])
    pause = ends[np.argmax(np.diff(ends))] + 3.0
    left = recording.sensors["foot_left"]
    stopped = left._replace(mask=left.time < pause)
    found = jgait.analyse(changed(recording, foot_left=stopped))
    assert len(of_code(found.notes, "distance_of_one_side")) == 1
    at = [np.interp(pause, each.time, each.distance) for each in (found.estimate, truth.estimate)]
    assert at[0] == pytest.approx(at[1], rel=0.02)
    assert found.estimate.distance[-1] == pytest.approx(truth.estimate.distance[-1], rel=0.02)


QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def test_where_one_leg_alone_has_strides_the_distance_is_its_own():
    """The other sensor lies still, or is turned about its long axis."""
    person = simulate.person_of(simulate.population(jax.random.key(3), 1, recorded=False), 0)
    recording, truth = simulate.with_breaks(
        jax.random.key(4), person, [simulate.straight(12.0)] * 2, [3.0], OPAL, placements=("shank_right", "shank_left")
    )
    assert not of_code(jgait.analyse(recording).notes, "distance_of_one_side")
    worn = recording.sensors["shank_left"]
    later = (worn.time > 0.5 * worn.time[-1])[:, None]
    for gyr, acc in ((0.003, [3.0, 4.0, 8.44]), (worn.gyr @ QUARTER, worn.acc @ QUARTER)):
        moved = worn._replace(gyr=np.where(later, gyr, worn.gyr), acc=np.where(later, acc, worn.acc))
        found = jgait.analyse(changed(recording, shank_left=moved))
        assert [one.values["side"] for one in of_code(found.notes, "distance_of_one_side")] == ["right"]
        assert found.estimate.distance[-1] == pytest.approx(truth.estimate.distance[-1], rel=0.03)
        assert found.estimate.diagnostics["distance_stddev"][-1] < 0.12 * truth.estimate.distance[-1]


VARIES = {"length_variability": 0.02, "time_variability": 0.02}
CREEPING = simulate.gait(speed=0.15, stride_length=0.25, length_variability=0.05, time_variability=0.05)


@pytest.mark.parametrize(
    ("number", "gait", "along", "near"),
    [
        (2, CREEPING, simulate.straight(4.0), "shanks"),
        (1, simulate.gait(speed=1.1, stature=1.75, **VARIES), simulate.faster(5.0, 1.0, 0.1), "legs"),
    ],
)
def test_what_shanks_miss_is_in_the_deviation_and_legs_that_count_every_movement_do_not_win(number, gait, along, near):
    """In creeping, legs may add up too much; in a slow part they see steps that shanks miss."""
    key = jax.random.key(number)
    walker = simulate.covering(key, simulate.Person(gait=gait), along)
    recording, truth = simulate.recording(key, walker, along, MPU6000, placements=simulate.FOUR)
    found = jgait.analyse(recording, {"height": 1.75})
    assert of_code(found.notes, "swings_too_small")
    told = {one.source: one for one in found.comparisons if one.quantity == "distance"}
    true = float(truth.estimate.distance[-1])
    assert abs(told["combined"].value - true) < 2.0 * told["combined"].stddev
    assert abs(told["combined"].value - told[near].value) < 0.02 * true
    assert abs(told["shanks"].value - true) < 3.0 * told["shanks"].stddev
