"""Checks of whole kinds: a damage has its note and no other, an undamaged recording has none."""

import re

import jax
import numpy as np
import pandas as pd
import pytest

from experiments.damage import harm
from jgait import io, simulate
from jgait.estimators.combined import crosscheck
from jgait.io.checks import contradictions, readings, walking
from jgait.quality import SOUND
from jgait.simulate.sensors import MPU6000, OPAL
from jgait.types import SIDES, Imu

LEGS = tuple(f"{segment}_{side}" for segment in ("thigh", "shank") for side in SIDES)
FEET = ("foot_right", "foot_left")
CONTRADICTIONS = {"sensor_contradicts", "clocks_apart", "rows_wrong", "pace_unusual"}


@pytest.fixture(scope="module")
def walk():
    return simulate.cohort(jax.random.key(5), 1, simulate.straight(20.0), OPAL, recorded=False)[0][0]


@pytest.fixture(scope="module")
def rows(walk):
    return harm.rows_of(walk, tuple(walk.sensors))


@pytest.fixture(scope="module")
def turning():
    walk = simulate.cohort(jax.random.key(6), 1, simulate.u_turn(6.0), OPAL, recorded=False)[0][0]
    return harm.rows_of(walk, tuple(walk.sensors))


def worn(rows, *placements):
    return rows._replace(sensors={placement: rows.sensors[placement] for placement in placements})


def damaged(rows, name, placement):
    return harm.read(harm.MISUSE[name].change(rows, placement, np.random.default_rng(1)), "walk")


def checks(recording):
    """Notes that are no mere facts; the feet of the person who turns clip, some samples are lost."""
    return [n for n in recording.notes
            if n.severity != "info" and n.code != "channel_clipped" and "samples missing" not in n.text]  # fmt: skip


def codes(notes):
    return {note.code for note in notes}


def test_what_is_undamaged_is_read_as_it_was_written(walk, rows, turning):
    recording = harm.read(rows, "walk")
    assert checks(recording) == checks(harm.read(turning, "walk")) == []
    for placement, imu in walk.sensors.items():
        np.testing.assert_array_equal(recording.sensors[placement].mask, imu.mask)
        np.testing.assert_allclose(recording.sensors[placement].gyr[imu.mask], imu.gyr[imu.mask], atol=1e-12)
        np.testing.assert_array_equal(recording.sensors[placement].acc[imu.mask], imu.acc[imu.mask])


MASKED = {
    "one cell of 1e6, gyr": ("shank_right", "no sensor reads"),
    "one cell of 1e6, acc": ("thigh_left", "no sensor reads"),
    "one cell of -999, gyr": ("foot_left", "hold -999"),
    "ten rows of -999": ("pelvis", "hold -999"),
    "30 rows of zeros": ("foot_right", "hold 0"),
    "20 spikes of 1900 deg/s": ("shank_left", "jump from their neighbours"),
    "frozen for 0.5 s": ("shank_right", "is repeated for 0.5"),
    "gyroscope frozen for 1 s": ("thigh_left", "one reading of the gyroscope is repeated"),
    "an axis of the gyroscope stuck for 1 s": ("thigh_left", "one reading of gyr_"),
    "an axis of the gyroscope stuck for 2 s": ("pelvis", "one reading of gyr_y is repeated for 2.0"),
    "gap of 1 s": ("shank_left", "1.00 s missing"),
    "rows of 2 s missing, with stamps": ("", "gap"),
    "5 % of rows missing, with stamps": ("", "gap"),
}
"""Damage → the sensor, and words of its only note."""


@pytest.mark.parametrize("name", MASKED)
def test_what_no_sensor_measures_is_masked_and_noted_once(walk, rows, name):
    placement, words = MASKED[name]
    recording = damaged(rows, name, placement)
    noted = checks(recording)
    assert noted and all(placement in note.text and words in note.text for note in noted)
    if placement and name != "gap of 1 s":
        left, imu = recording.sensors[placement].mask, walk.sensors[placement]
        assert not (left & ~imu.mask).any() and 1 <= (imu.mask & ~left).sum() <= (210 if "for 2 s" in name else 110)
        for kind in ("gyr", "acc"):  # what is left was measured
            now, before = (getattr(one, kind)[left] for one in (recording.sensors[placement], imu))
            np.testing.assert_allclose(now, before, atol=1e-9)


@pytest.mark.parametrize("placement", ["pelvis", "thigh_right", "shank_left", "foot_right"])
@pytest.mark.parametrize("channel", ["gyr_x", "gyr_z", "acc_y", "acc_z"])
def test_an_axis_that_is_stuck_for_2_s_of_walking_is_masked(walk, placement, channel):
    table = io.recording_to_dataframe(walk)
    stuck = slice(800, 1000)
    table.loc[800:999, f"{placement}_{channel}"] = table[f"{placement}_{channel}"][800]
    recording = io.recording_from_dataframe(table)
    assert not recording.sensors[placement].mask[stuck][1:].any() and recording.sensors[placement].mask.mean() > 0.8
    assert any(f"{placement}: one reading of {channel} is repeated" in note.text for note in recording.notes)


CONTRADICTED = {
    "gyroscope wraps at 250 deg/s": ("shank_right", "channel_unwrapped", r"shank_right gyr_y .*4\.363 rad/s"),
    "gyroscope's sign": ("foot_right", "sensor_contradicts", "gyroscope and accelerometer do not agree"),
    "gyroscope's y turned round": ("foot_right", "sensor_contradicts", "its y axis may be turned round"),
    "gyroscope by 2": ("foot_right", "sensor_contradicts", "2 times too large"),
    "left-handed axes": ("shank_right", "sensor_contradicts", "tilt by up to"),
    "accelerometer by 0.85": ("pelvis", "sensor_contradicts", "gyroscope and accelerometer do not agree"),
    "gyroscope by 0.5": ("thigh_right", "sensor_contradicts", "times as fast as thigh_right"),
    "gyroscope in rad/s": ("shank_right", "sensor_contradicts", "the gyroscope reaches only"),
    "rate of 50 Hz stated for 100": ("foot_right", "sensor_contradicts", "do not agree"),
    "rate of 200 Hz stated for 100": ("", "pace_unusual", "time passes twice as fast"),
    "all gyroscopes by 0.5": ("", "pace_unusual", "all sensors of the legs.*read half of what they should"),
    "accelerometer 50 ms late": ("foot_right", "clocks_apart", "the accelerometer is .* behind the gyroscope"),
    "gyroscope 100 ms late": ("shank_right", "clocks_apart", "the accelerometer is .* ahead of the gyroscope"),
    "sensor 0.1 s late": ("shank_right", "clocks_apart", "behind thigh_right"),
    "sensor 0.3 s late": ("foot_left", "clocks_apart", "of a stride in place of a half"),
    "sensor's clock 1 % fast": ("thigh_left", "clocks_apart", "behind thigh_left|ahead of thigh_left"),
    "20 % of rows missing, without stamps": ("", "rows_wrong", "all sensors jump"),
    "5 % of rows missing, without stamps": ("", "rows_wrong", "all sensors jump"),
    "rows of 0.5 s missing, without stamps": ("", "rows_wrong", "all sensors jump"),
    "2 % of rows written twice, without stamps": ("", "rows_wrong", "repeat the one before in all sensors"),
    "every second row repeated": ("shank_right", "samples_masked", "% of the readings of the .* repeat the one before"),
    "20 spikes of 150 m/s²": ("thigh_right", "samples_masked", "jump from their neighbours"),
}  # fmt: skip
"""Damage of a straight walk → the sensor, and code and words of a note about it."""

TURNED = {
    "gyroscope's sign": "thigh_left", "gyroscope's z turned round": "pelvis", "gyroscope by 0.5": "pelvis",
    "gyroscope by 2": "shank_left", "gyroscope in rad/s": "pelvis", "accelerometer's sign": "foot_right",
}  # fmt: skip
"""Damage of a walk with a turn → the sensor that does not turn with the person."""


@pytest.mark.parametrize("name", CONTRADICTED)
def test_sensors_that_contradict_themselves_or_others_are_named(rows, name):
    placement, code, words = CONTRADICTED[name]
    recording = damaged(rows, name, placement)
    texts = [note.text for note in recording.notes if note.code == code and re.search(words, note.text)]
    assert any(placement in text for text in texts)
    if "late" in name:
        assert "places_exchanged" not in codes(recording.notes)


@pytest.mark.parametrize("name", TURNED)
def test_sensors_that_do_not_turn_with_the_person_are_named(turning, name):
    notes = [note for note in damaged(turning, name, TURNED[name]).notes if "in a turn by" in note.text]
    assert [note.values["placement"] for note in notes] == [TURNED[name]]


@pytest.mark.parametrize("name", ["gyroscope's sign", "gyroscope's z turned round", "gyroscope's y turned round"])
@pytest.mark.parametrize("placement", FEET)
def test_of_two_feet_the_intact_one_is_not_accused(turning, name, placement):
    found = checks(damaged(worn(turning, *FEET), name, placement))
    assert any(placement in (note.values["placement"], note.values.get("other")) for note in found)
    assert {note.values["placement"] for note in found if "one turns" not in note.text} <= {placement}


@pytest.mark.parametrize("segment", ["thigh", "shank", "foot"])
def test_exchanged_sensors_are_named_and_no_clock_is(rows, segment):
    def exchanged(rows):
        right, left = (f"{segment}_{side}" for side in SIDES)
        return rows._replace(sensors={**rows.sensors, right: rows.sensors[left], left: rows.sensors[right]})

    wrong = harm.read(exchanged(rows), "walk")
    pair = {f"{segment}_{side}" for side in SIDES}
    (note,) = checks(wrong)
    assert note.code == "places_exchanged" and set(note.values["placements"].split(" and ")) == pair
    assert crosscheck(wrong).notes == (note,) and crosscheck(wrong).replaced == pair


def test_a_real_walk_shows_exchanged_shanks_and_late_sensors_at_any_rate(data):
    """Three whole strides are few to compare phases; impacts pass through one leg."""
    (one,) = data("walking5m", "Young/20180621_9")
    legs = harm.rows_of(one.recording, LEGS)
    swap = {"shank_right": legs.sensors["shank_left"], "shank_left": legs.sensors["shank_right"]}
    assert checks(harm.read(legs, "walk")) == []
    wrong = harm.read(legs._replace(sensors=legs.sensors | swap), "walk")
    assert codes(checks(wrong)) == {"places_exchanged"} and crosscheck(wrong).replaced == set(swap)
    for every in (1, 2, 4):
        rarer = harm._kept(legs, np.arange(0, len(legs.time), every), stamps=True)
        assert not codes(checks(harm.read(rarer, "walk"))) & CONTRADICTIONS
        if every < 4:
            assert "clocks_apart" in codes(damaged(rarer, "sensor 0.3 s late", "shank_left").notes)


@pytest.mark.parametrize("name", ["gyroscope's y turned round", "left-handed axes", "gyroscope's sign", None])
@pytest.mark.parametrize("leaves_s", [0.0, 0.9])
def test_a_wrong_tilt_is_noticed_although_the_mean_acceleration_has_the_size_of_gravity(name, leaves_s):
    """A thigh that swings like a pendulum, about a bend; a weight that shifts before the first step accuses nothing."""
    time = np.arange(1000) / 100.0 - 3.0
    bend = np.where(time > 0.0, np.deg2rad(12.0 + 20.0 * np.sin(2.0 * np.pi * time)), 0.0)
    bend = np.convolve(np.pad(bend, 10, mode="edge"), np.ones(21) / 21.0, "valid") + 0.05 * np.clip(
        time, -leaves_s, 0.0
    )
    gyr, acc = 0.002 * np.random.default_rng(0).normal(size=(2, 1000, 3))
    gyr[:, 1] += np.gradient(bend, 0.01)
    acc += 9.80665 * np.stack([-np.sin(bend), np.zeros(1000), np.cos(bend)], axis=1)
    one = harm.Rows({"thigh_left": {"gyr": np.rad2deg(gyr), "acc": acc}}, time, None, None, time)
    recording = damaged(one, name, "thigh_left") if name else harm.read(one, "walk")
    assert any("tilt by up to" in note.text for note in recording.notes) == (name is not None)


UNUSUAL = {
    "slow": lambda key, who: simulate.walking(who, "slow"),
    "stiff leg": lambda key, who: simulate.walking(who, "stiff_leg"),
    "quick": lambda key, who: who._replace(gait=who.gait._replace(stride_time=120.0 / 170.0)),
}  # fmt: skip


@pytest.mark.parametrize("gait", UNUSUAL)
def test_an_unusual_gait_is_no_damage(gait):
    """The thigh comes to rest slowly, the foot is shaken twice in a step, and lands quickly."""
    who, key = jax.random.split(jax.random.key(5))
    person = UNUSUAL[gait](key, simulate.person_of(simulate.population(who, 6, recorded=False), 0))
    along = simulate.straight(20.0)
    recording, _ = simulate.recording(key, simulate.covering(key, person, along), along, MPU6000)
    notes = contradictions(recording)[1]
    assert "clocks_apart" not in codes(notes) and not any("tilt by up to" in note.text for note in notes)


def test_a_sensor_that_is_taken_off_and_lies_still_is_not_wrong(turning):
    """From a third of the walk on it does not turn with the person, nor as fast as that of the other leg."""
    two = harm.read(worn(turning, *FEET), "walk")
    imu, foot = two.sensors["foot_left"], np.sum(np.asarray(two.sensors["foot_right"].gyr) ** 2, axis=1)
    at = int(np.searchsorted(np.cumsum(foot), 0.3 * foot.sum()))
    noise = np.random.default_rng(0).normal(size=(2, len(imu.time) - at, 3))
    gyr, acc = np.array(imu.gyr), np.array(imu.acc)
    gyr[at:], acc[at:] = 0.003 * noise[0], [0.1, 0.2, 9.8] + 0.03 * noise[1]
    off = two._replace(sensors={**two.sensors, "foot_left": imu._replace(gyr=gyr, acc=acc)})
    assert not codes(contradictions(off)[1]) & {"one_turns_apart", "sensor_contradicts"}


def test_rows_are_lost_of_all_sensors_or_of_none(rows):
    """Every fourth reading of one sensor, or row of both, is left out, as when tables of two rates are merged; readings
    that are held where one is lost are no rows written twice.
    """
    foot = worn(rows, "foot_right")
    assert "rows_wrong" in codes(damaged(foot, "20 % of rows missing, without stamps", "foot_right").notes)
    time = np.arange(4000) / 128.0
    turns = 2.0 * np.pi * (1.0 + 0.02 * np.sin(0.3 * time)) * time

    def sensor(phase, kept):
        swings = np.maximum(np.sin(turns + phase), 0.0) ** 4  # one rests while the other swings
        gyr = (swings[:, None] * np.stack([np.sin(9.0 * time), np.cos(9.0 * time), 0.0 * time], axis=1))[kept]
        return Imu(time[: len(gyr)], gyr, None, np.ones(len(gyr), bool))

    fewer = np.flatnonzero(np.arange(4000) % 4 != 3)
    both = {"foot_right": sensor(0.0, fewer), "foot_left": sensor(np.pi, fewer)}
    assert codes(walking.rows_wrong(both, 100.0)[1]) == {"rows_wrong"}
    assert walking.rows_wrong({**both, "foot_left": sensor(np.pi, np.arange(len(fewer)))}, 100.0) == (SOUND, [])
    at = np.flatnonzero(np.random.default_rng(2).random(len(rows.time)) < 0.02)[1:]
    held = {p: {kind: v.copy() for kind, v in each.items()} for p, each in rows.sensors.items()}
    for values in (values for each in held.values() for values in each.values()):
        values[at] = values[at - 1]
    assert "rows_wrong" not in codes(harm.read(rows._replace(sensors=held), "walk").notes)


@pytest.mark.parametrize("every", [2, 4])
def test_an_accelerometer_that_is_slower_than_its_rows_is_not_held(every):
    """As after tables of two rates were merged: lines between new readings at 50 Hz, losses at 25 Hz."""
    time = np.arange(600) / 100.0
    gyr = 3.0 * np.sin(2.0 * np.pi * time)[:, None] * [0.1, 0.2, 1.0]
    acc = [0.0, 9.8, 0.0] + 4.0 * np.sin(4.0 * np.pi * time)[:, None] * [1.0, 0.5, 0.2]
    held = acc[np.arange(600) // every * every]
    new, notes = readings.without_damage("shank_right", {"gyr": gyr, "acc": held}, {"gyr": 1.0, "acc": 1.0}, 100.0)
    (note,) = (note for note in notes if note.code == "samples_masked")
    assert float(note.text.split()[1]) == pytest.approx(100.0 - 100.0 / every, abs=2.0)
    lost = ~np.isfinite(new["acc"]).all(axis=1)
    assert lost.mean() == pytest.approx(0.0 if every == 2 else 0.75, abs=0.01)
    assert np.abs(new["acc"] - acc)[:-1][~lost[:-1]].max() < 0.1 * np.abs(held - acc).max()


def test_a_channel_that_wraps_in_its_peaks_alone_is_continued():
    limit, swing = np.deg2rad(250.0), np.sin(2.0 * np.pi * np.arange(600) / 109.7)
    rates = 1.3 * limit * np.maximum(swing, -0.4)[:, None] * [0.1, 0.2, 1.0]
    rates[300:303] = np.nan
    wrapped = (rates + limit) % (2.0 * limit) - limit
    read, notes = readings.without_damage("foot_right", {"gyr": wrapped}, {"gyr": 1.0}, 100.0)
    assert "channel_unwrapped" in codes(notes)
    np.testing.assert_allclose(read["gyr"], rates, atol=1e-9)


def test_a_coarse_accelerometer_is_named_and_neither_masked_nor_clipped_for_it():
    step, time, rng = 0.1 * 9.80665, np.arange(1000) / 100.0, np.random.default_rng(0)
    swing = np.where((time > 2.0) & (time < 7.0), np.sin(2.0 * np.pi * (time - 2.0)), 0.0)[:, None]
    gyr = 200.0 * swing * [0.0, 0.1, 1.0] + rng.normal(scale=0.5, size=(1000, 3))
    fine = [0.3, 9.7, 0.3] + 12.0 * swing * [1.0, 0.5, 0.2] + rng.normal(scale=0.02, size=(1000, 3))
    coarse = step * np.round(fine / step)
    clipped = np.clip(coarse + 12.0 * step * np.round(4.0 * swing), -20.0 * step, 20.0 * step)
    damage = {"samples_masked", "channel_clipped", "accelerometer_coarse"}
    for acc, expected in ((fine, set()), (coarse, {"accelerometer_coarse"}),
                          (clipped, {"accelerometer_coarse", "channel_clipped"})):  # fmt: skip
        one = {"shank_right": {"gyr": gyr, "acc": acc}}
        assert damage & codes(io.recording_from_arrays(one, sampling_rate_hz=100.0).notes) == expected


@pytest.mark.parametrize("fault", ["none", "steps", "held", "stuck", "constant"])
def test_a_range_that_repeats_its_reading_while_the_feet_move_is_masked(fault):
    """A range in steps of 1 cm is not; of one that is held until the next passing, the first readings are left."""
    count = 23 * 55 + 8  # ends with a passing
    time, passes = np.arange(count) / 100.0, np.arange(count) % 55 < 8
    swings = 200.0 * np.sin(6.0 * time)[:, None] * [0.0, 1.0, 0.2]
    read = np.where(passes, np.random.default_rng(0).uniform(0.1, 0.2, count), np.nan)
    made = {
        "none": read, "steps": np.round(read, 2), "held": pd.Series(read).ffill().to_numpy(),
        "stuck": np.where(passes & (time > 6.0), 0.15, read), "constant": np.full(count, 0.15),
    }[fault]  # fmt: skip
    sensors = {foot: {"gyr": swings, "acc": np.tile([0.0, 0.0, 9.81], (count, 1))} for foot in FEET}
    recording = io.recording_from_arrays(sensors, time=time, feet_range=made)
    left = {"stuck": passes & (time <= 6.0), "constant": passes & False}.get(fault, passes)
    assert np.array_equal(recording.feet_range.mask, left)
    assert ("range_lost" in codes(recording.notes)) == (fault not in ("none", "steps"))
