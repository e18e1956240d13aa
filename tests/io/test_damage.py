"""Damaged signals are masked, corrected or flagged when they are read; undamaged ones are left as they are."""

import re

import jax
import numpy as np
import pandas as pd
import pytest
from made.notes import of_code

from experiments.damage import harm
from jgait import io, simulate
from jgait.io.damage import agreement, damage_notes, delays, paces, samples, splices, tilts, turns
from jgait.io.names import unit_in_name
from jgait.simulate.sensors import MPU6000, OPAL
from jgait.types import Imu, RecordingError

NEW = {kind.code for module in (agreement, delays, paces, samples, splices, tilts, turns)
       for kind in vars(module).values() if type(kind).__name__ == "Kind"}  # fmt: skip
"""Codes of the notes about damage."""


@pytest.fixture(scope="module")
def walk():
    return simulate.cohort(jax.random.key(5), 1, simulate.straight(20.0), OPAL, recorded=False)[0][0]


@pytest.fixture(scope="module")
def rows(walk):
    return harm.rows_of(walk, tuple(walk.sensors))


def damaged(rows, name, placement):
    return harm.read(harm.DAMAGES[name].change(rows, placement, np.random.default_rng(1)), "walk")


def found(recording, code=None):
    """Texts of the notes about damage, all or those of one kind."""
    return [note.text for note in recording.notes if note.code in (NEW if code is None else {code})]


def test_an_undamaged_walk_is_read_as_it_was_written(walk, rows):
    recording = harm.read(rows, "walk")
    assert not found(recording)
    for placement, imu in walk.sensors.items():
        np.testing.assert_array_equal(recording.sensors[placement].mask, imu.mask)
        np.testing.assert_allclose(recording.sensors[placement].gyr[imu.mask], imu.gyr[imu.mask], atol=1e-12)
        np.testing.assert_array_equal(recording.sensors[placement].acc[imu.mask], imu.acc[imu.mask])


@pytest.mark.parametrize(
    ("name", "placement", "code"),
    [
        ("one cell of 1e6, gyr", "shank_right", "samples_impossible"),
        ("one cell of 1e6, acc", "thigh_left", "samples_impossible"),
        ("one cell of -999, gyr", "foot_left", "samples_placeholder"),
        ("ten rows of -999", "pelvis", "samples_placeholder"),
        ("30 rows of zeros", "foot_right", "samples_placeholder"),
        ("20 spikes of 1900 deg/s", "shank_left", "samples_spike"),
        ("frozen for 0.5 s", "shank_right", "samples_frozen"),
        ("gyroscope frozen for 1 s", "thigh_left", "samples_frozen"),
        ("an axis of the gyroscope stuck for 1 s", "thigh_left", "axis_stuck"),
    ],
)
def test_what_no_sensor_measures_is_masked(walk, rows, name, placement, code):
    recording = damaged(rows, name, placement)
    assert placement in "; ".join(found(recording, code))
    left = recording.sensors[placement].mask
    assert not (left & ~walk.sensors[placement].mask).any()
    assert 1 <= (walk.sensors[placement].mask & ~left).sum() <= 110
    for kind in ("gyr", "acc"):  # what is left was measured
        now, before = (getattr(one.sensors[placement], kind)[left] for one in (recording, walk))
        np.testing.assert_allclose(now, before, atol=1e-9)


def test_most_spikes_of_an_accelerometer_are_told_from_impacts(walk, rows):
    recording = damaged(rows, "20 spikes of 150 m/s²", "thigh_right")
    assert "thigh_right" in found(recording, "samples_spike")[0]
    sensor, imu = recording.sensors["thigh_right"], walk.sensors["thigh_right"]
    assert (~sensor.mask).sum() >= 14
    left = np.abs(sensor.acc - imu.acc).max(axis=1) > 50.0
    assert left.sum() <= 6


def test_a_sensor_that_repeats_one_reading_to_the_end_has_stopped_although_it_stood(walk):
    imu = walk.sensors["foot_right"]
    rates = np.convolve(np.linalg.norm(imu.gyr, axis=1), np.ones(5), "same")
    at = 500 + int(np.argmin(rates[500:700]))  # in a stance: no jump into the stretch
    signals = {"gyr": imu.gyr.copy(), "acc": imu.acc.copy()}
    for values in signals.values():
        values[~imu.mask] = np.nan
        values[at:] = values[at - 1]
    left, notes = samples.without_damage("foot_right", signals, {"gyr": 1.0, "acc": 1.0}, 100.0)
    assert np.isnan(left["gyr"][at + 1 :]).all() and np.isnan(left["acc"][at + 1 :]).all()
    assert any(note.code == "samples_frozen" for note in notes)


def test_a_clipped_gyroscope_that_jumps_between_its_limits_does_not_wrap():
    limit, draw = np.deg2rad(250.0), np.random.default_rng(0)
    rates = np.zeros((400, 3))
    rates[:, 0] = 3.0 * limit * np.sign(np.sin(np.arange(400) / 9.0)) + draw.standard_normal(400)
    near = rates.clip(-limit, limit)
    after = np.flatnonzero(np.diff(np.sign(near[:, 0]))) + 1
    near[after, 0] *= 0.98  # jumps are not from one limit exactly to the other
    wrapped = (rates + limit) % (2.0 * limit) - limit
    for signal, count in ((near, 0), (wrapped, 1)):
        _, notes = samples.without_damage("foot_right", {"gyr": signal}, {"gyr": 1.0}, 100.0)
        assert sum(note.code == "channel_wrapped" for note in notes) == count


def test_a_coarse_accelerometer_is_named_and_neither_masked_nor_clipped_for_it():
    step = 0.1 * 9.80665
    time = np.arange(1000) / 100.0
    rng = np.random.default_rng(0)
    swing = np.where((time > 2.0) & (time < 7.0), np.sin(2.0 * np.pi * (time - 2.0)), 0.0)[:, None]
    gyr = 200.0 * swing * [0.0, 0.1, 1.0] + rng.normal(scale=0.5, size=(1000, 3))
    fine = [0.3, 9.7, 0.3] + 12.0 * swing * [1.0, 0.5, 0.2] + rng.normal(scale=0.02, size=(1000, 3))

    def codes(acc):
        return [note.code for note in io.recording_from_arrays({"shank_right": {"gyr": gyr, "acc": acc}},
                                                               sampling_rate_hz=100.0).notes]  # fmt: skip

    damage = {"samples_frozen", "channel_clipped", "accelerometer_coarse"}
    coarse = step * np.round(fine / step)
    assert (np.diff(coarse[-200:], axis=0) == 0.0).all()
    assert damage & set(codes(coarse)) == {"accelerometer_coarse"}
    assert damage & set(codes(0.02 * step * np.round(fine / (0.02 * step)))) == set()
    assert damage & set(codes(np.clip(coarse + 12.0 * step * np.round(4.0 * swing), -20.0 * step, 20.0 * step))) == {
        "accelerometer_coarse", "channel_clipped",
    }  # fmt: skip
    stuck = fine.copy()
    stuck[-200:] = stuck[-200]
    assert damage & set(codes(stuck)) == {"samples_frozen"}
    for axis, expected in ((0, {"axis_stuck"}), (2, set())):  # the leg turns about z, which leaves z's reading as it is
        held, on = fine.copy(), (time > 2.0) & (time < 7.0) & (time % 1.0 < 0.5)
        held[on, axis] = np.where(np.floor(time[on]) % 2.0 == 0.0, 1.5, -1.2)
        assert {"axis_stuck"} & set(codes(held)) == expected


@pytest.mark.parametrize("every", [2, 4])
def test_an_accelerometer_that_is_slower_than_its_rows_is_not_held(every):
    """As after tables of two rates were merged: lines between new readings at 50 Hz, losses at 25 Hz."""
    time = np.arange(600) / 100.0
    gyr = 3.0 * np.sin(2.0 * np.pi * time)[:, None] * [0.1, 0.2, 1.0]
    acc = [0.0, 9.8, 0.0] + 4.0 * np.sin(4.0 * np.pi * time)[:, None] * [1.0, 0.5, 0.2]
    held = acc[np.arange(600) // every * every]
    new, notes = samples.without_damage("shank_right", {"gyr": gyr, "acc": held}, {"gyr": 1.0, "acc": 1.0}, 100.0)
    (note,) = of_code(notes, "samples_repeated")
    assert note.values["signal"] == "accelerometer"
    assert note.values["percent"] == pytest.approx(100.0 - 100.0 / every, abs=2.0)
    lost = ~np.isfinite(new["acc"]).all(axis=1)
    if every == 2:
        assert not lost.any() and np.abs(new["acc"][:-1] - acc[:-1]).max() < 0.1 * np.abs(held - acc).max()
    else:
        assert lost.mean() == pytest.approx(0.75, abs=0.01) and np.array_equal(new["acc"][~lost], acc[~lost])


def test_readings_of_one_sensor_that_are_missing_are_no_missing_rows():
    """Every fourth reading of one sensor, or row of both, is left out, as when tables of two rates are merged."""
    time = np.arange(4000) / 128.0
    turns = 2.0 * np.pi * (1.0 + 0.02 * np.sin(0.3 * time)) * time

    def sensor(phase, rows):
        swings = np.maximum(np.sin(turns + phase), 0.0) ** 4  # one rests while the other swings
        gyr = (swings[:, None] * np.stack([np.sin(9.0 * time), np.cos(9.0 * time), 0.0 * time], axis=1))[rows]
        return Imu(time[: len(gyr)], gyr, None, np.ones(len(gyr), bool))

    fewer = np.flatnonzero(np.arange(4000) % 4 != 3)
    both = {f"foot_{side}": sensor(phase, fewer) for side, phase in (("right", 0.0), ("left", np.pi))}
    one = {**both, "foot_left": sensor(np.pi, np.arange(len(fewer)))}
    assert [note.code for note in splices.splice_notes(both, 100.0)] == ["rows_lost"]
    assert splices.splice_notes(one, 100.0) == ()


@pytest.mark.parametrize(("slow", "code"), [(100.0, "samples_repeated"), (128.0, None)])
def test_tables_of_two_rates_that_were_merged_lack_no_rows(walk, slow, code):
    """The left foot's table has 128 or 100 rows a second, and the other one's times: `merge_asof` with the last one."""
    fast = {100.0: 128.0, 128.0: 100.0}[slow]

    def at(imu, rate):
        time = np.arange(0.0, float(imu.time[-1]), 1.0 / rate)
        columns = np.hstack([imu.gyr, imu.acc]).T
        return time, np.stack([np.interp(time, imu.time, column) for column in columns], axis=1)

    right, left = (walk.sensors[f"foot_{side}"] for side in ("right", "left"))
    (time, one), (theirs, other) = at(right, fast), at(left, slow)
    held = other[np.searchsorted(theirs, time + 1e-9, side="right") - 1]
    sensors = {name: {"gyr": values[:, :3], "acc": values[:, 3:]}
               for name, values in (("foot_right", one), ("foot_left", held))}  # fmt: skip
    recording = io.recording_from_arrays(sensors, time=time, gyr_unit="rad/s")
    notes = [note for note in recording.notes if note.code in NEW]
    assert {(note.code, note.values["placement"]) for note in notes} == ({(code, "foot_left")} if code else set())


@pytest.mark.parametrize(
    ("name", "placement", "code", "words"),
    [
        ("gyroscope wraps at 250 deg/s", "shank_right", "channel_wrapped", r"shank_right gyr_y .*4\.363 rad/s"),
        ("gyroscope's sign", "foot_right", "gyroscope_disagrees", ""),
        ("gyroscope's y turned round", "shank_left", "gyroscope_disagrees", ""),
        ("gyroscope's y turned round", "foot_right", "gyroscope_disagrees", "its y axis may be turned round"),
        ("gyroscope by 2", "foot_right", "gyroscope_disagrees", "2 times too large"),
        ("left-handed axes", "shank_right", "gyroscope_disagrees", ""),
        ("accelerometer by 0.85", "pelvis", "gyroscope_disagrees", ""),
        ("gyroscope by 0.5", "thigh_right", "sides_differ", ""),
        ("gyroscope in rad/s", "shank_right", "gyroscope_slow", ""),
        ("rate of 50 Hz stated for 100", "foot_right", "gyroscope_disagrees", ""),
        ("accelerometer 50 ms late", "foot_right", "accelerometer_late", ""),
        ("gyroscope 100 ms late", "shank_right", "accelerometer_late", ""),
        ("sensor 0.1 s late", "shank_right", "sensor_late", ""),
        ("sensor's clock 1 % fast", "thigh_left", "clocks_drift", ""),
        ("20 % of rows missing, without stamps", "", "rows_lost", ""),
        ("5 % of rows missing, without stamps", "", "rows_lost", ""),
        ("rows of 0.5 s missing, without stamps", "", "rows_lost", ""),
        ("2 % of rows written twice, without stamps", "", "rows_twice", ""),
        ("left-handed axes", "shank_right", "tilts_apart", ""),
        ("sensor 0.3 s late", "foot_left", "sides_out_of_step", ""),
        ("every second row repeated", "shank_right", "samples_repeated", ""),
        ("all gyroscopes by 0.5", "", "pace_unusual", "all sensors of the legs.*read half of what they should"),
        ("rate of 200 Hz stated for 100", "", "pace_unusual", "time passes twice as fast"),
    ],
)
def test_sensors_that_contradict_themselves_or_others_are_named(rows, name, placement, code, words):
    texts = found(damaged(rows, name, placement), code)
    assert any(placement in text for text in texts)
    if words:
        assert len(texts) == 1 and re.search(words, texts[0])


@pytest.fixture(scope="module")
def turning():
    walk = simulate.cohort(jax.random.key(6), 1, simulate.u_turn(6.0), OPAL, recorded=False)[0][0]
    return harm.rows_of(walk, tuple(walk.sensors))


@pytest.mark.parametrize(
    ("name", "placement"),
    [
        ("gyroscope's sign", "thigh_left"),
        ("gyroscope's z turned round", "pelvis"),
        ("gyroscope by 0.5", "pelvis"),
        ("gyroscope by 2", "shank_left"),
        ("gyroscope in rad/s", "pelvis"),
        ("accelerometer's sign", "foot_right"),
    ],
)
def test_sensors_that_do_not_turn_with_the_person_are_named(turning, name, placement):
    assert not found(harm.read(turning, "walk"), "turns_apart")
    (text,) = found(damaged(turning, name, placement), "turns_apart")
    assert text.startswith(f"{placement}: in a turn by ")


@pytest.mark.parametrize("name", ["gyroscope's y turned round", "left-handed axes", "gyroscope's sign"])
def test_a_wrong_tilt_is_noticed_although_the_mean_acceleration_has_the_size_of_gravity(name):
    """A leg that swings like a pendulum: turned the wrong way, its mean acceleration is as large as before."""
    rate_hz, walking = 100.0, np.arange(1000) >= 200
    time = np.arange(1000) / rate_hz
    bend = np.where(walking, np.deg2rad(12.0 + 20.0 * np.sin(2.0 * np.pi * (time - 2.0))), 0.0)
    bend = np.convolve(np.concatenate([np.zeros(10), bend, np.full(10, bend[-1])]), np.ones(21) / 21.0, "valid")
    gyr, acc = 0.002 * np.random.default_rng(0).normal(size=(2, 1000, 3))
    gyr[:, 1] += np.gradient(bend, 1.0 / rate_hz)
    acc += 9.80665 * np.stack([-np.sin(bend), np.zeros(1000), np.cos(bend)], axis=1)
    one = harm.Rows({"thigh_left": {"gyr": np.rad2deg(gyr), "acc": acc}}, time, None, None, time)
    assert not found(harm.read(one, "walk"), "tilts_apart")
    (text,) = found(damaged(one, name, "thigh_left"), "tilts_apart")
    assert text.startswith("thigh_left: between standing and walking")


def test_rows_missing_from_the_file_of_one_sensor_are_noticed(rows):
    foot = rows._replace(sensors={"foot_right": rows.sensors["foot_right"]})
    assert not found(harm.read(foot, "walk"))
    assert found(damaged(foot, "20 % of rows missing, without stamps", "foot_right"), "rows_lost")


def test_a_sensor_that_holds_its_reading_where_one_is_lost_has_no_rows_twice(rows):
    draw = np.random.default_rng(2)
    at = np.flatnonzero(draw.random(len(rows.time)) < 0.02)[1:]
    held = {}
    for placement, signals in rows.sensors.items():
        held[placement] = {kind: values.copy() for kind, values in signals.items()}
        for values in held[placement].values():
            values[at] = values[at - 1]
    recording = harm.read(rows._replace(sensors=held), "walk")
    assert not found(recording, "rows_twice")


def test_of_two_sensors_that_turn_apart_the_wrong_one_is_named(turning):
    feet = turning._replace(sensors={p: s for p, s in turning.sensors.items() if p.startswith("foot")})
    assert not found(harm.read(feet, "walk"), "turns_apart")
    (text,) = found(damaged(feet, "gyroscope's sign", "foot_left"), "turns_apart")
    assert text.startswith("foot_left: in a turn by ")
    alone = feet._replace(sensors={"foot_left": feet.sensors["foot_left"]})
    assert not found(damaged(alone, "gyroscope's sign", "foot_left"), "turns_apart")


@pytest.mark.parametrize("turns", [False, True])
def test_a_sensor_that_is_taken_off_and_lies_still_is_not_wrong(walk, turning, turns):
    """From the middle of a walk on it does not turn with the person, nor as fast as that of the other leg."""
    made = harm.read(turning, "walk") if turns else walk
    two = made._replace(sensors={p: s for p, s in made.sensors.items() if p.startswith("foot")})
    imu = two.sensors["foot_left"]
    foot = np.sum(np.asarray(two.sensors["foot_right"].gyr) ** 2, axis=1)
    at = int(np.searchsorted(np.cumsum(foot), 0.3 * foot.sum()))
    noise = np.random.default_rng(0).normal(size=(2, len(imu.time) - at, 3))
    gyr, acc = np.array(imu.gyr), np.array(imu.acc)
    gyr[at:], acc[at:] = 0.003 * noise[0], [0.1, 0.2, 9.8] + 0.03 * noise[1]
    off = two._replace(sensors={**two.sensors, "foot_left": imu._replace(gyr=gyr, acc=acc)}, notes=())
    assert not {note.code for note in damage_notes(off)} & {"one_turns_apart", "turns_apart", "sides_differ"}


def test_a_runner_is_not_refused_for_the_mean_of_the_force(rows):
    """Where a foot is calm it measures gravity, whatever the median."""
    hard = {p: {**s, "acc": s["acc"] + 12.0 * (np.abs(s["gyr"]).max(axis=1, keepdims=True) > 40.0)} for p, s in
            rows.sensors.items() if p.startswith("foot")}  # fmt: skip
    size = np.linalg.norm(hard["foot_right"]["acc"], axis=1)
    assert np.nanmedian(size[np.abs(hard["foot_right"]["gyr"]).max(axis=1) > 40.0]) > 15.0
    io.recording_from_arrays(hard, time=rows.time)


def test_a_person_who_stands_and_a_slow_clock_are_not_judged(walk):
    draw = np.random.default_rng(3)
    still, slow = {}, {}
    for placement, imu in walk.sensors.items():
        down = np.tile([0.0, 0.0, 9.81], (len(imu.time), 1))
        still[placement] = imu._replace(gyr=1e-3 * draw.normal(size=down.shape), acc=down)
        slow[placement] = imu._replace(time=imu.time * 1e3)
    assert damage_notes(walk._replace(sensors=still)) == ()
    assert damage_notes(walk._replace(sensors=slow, sampling_rate_hz=1e-3 * walk.sampling_rate_hz)) == ()


def test_recordings_without_accelerometer_or_of_a_second_are_not_judged(walk):
    short = {p: imu._replace(**{n: getattr(imu, n)[:90] for n in ("time", "gyr", "acc", "mask")}) for p, imu in
             walk.sensors.items()}  # fmt: skip
    assert damage_notes(walk._replace(sensors=short)) == ()
    assert damage_notes(walk._replace(sensors={p: imu._replace(acc=None) for p, imu in walk.sensors.items()})) == ()


def test_a_thigh_that_comes_to_rest_slowly_agrees_with_its_accelerometer():
    time = np.arange(1600) / 100.0
    walks = np.where(time < 10.0, 0.4 * np.sin(2.0 * np.pi * time / 1.25), 0.0)
    pitch = walks + np.interp(time, [10.0, 10.6], [0.06, 0.0])
    rate, zero = np.gradient(pitch, time), 0.0 * time
    acc = 9.81 * np.stack([-np.sin(pitch), zero, np.cos(pitch)], axis=1)
    imu = Imu(time, np.stack([zero, rate, zero], axis=1), acc, np.ones(1600, bool))
    (angle,) = tilts.tilts(imu, 100.0, tilts.MOVING[""])
    assert angle < 0.5 * tilts.FARTHEST_DEG["thigh"]


@pytest.mark.parametrize("gait", ["slow", "stiff_leg"])
def test_an_unusual_gait_is_no_damage(gait):
    """Of these people the thigh comes to rest slowly, and the foot is shaken twice in a step."""
    who, how = jax.random.split(jax.random.key(5))
    along, key = simulate.straight(20.0), jax.random.fold_in(how, 0)
    person = simulate.walking(simulate.person_of(simulate.population(who, 6, recorded=False), 0), gait)
    recording, _ = simulate.recording(key, simulate.covering(key, person, along), along, MPU6000)
    told = {note.code for note in damage_notes(recording)}
    assert not told & {"accelerometer_late", "sensor_late", "tilts_apart"}


@pytest.mark.parametrize(("name", "walk"), [("walking5m", "Elderly/20180403_9"), ("neura_sparse", "S02-Trial-Walk-1")])
def test_of_every_second_sample_delays_are_as_usual_and_a_late_sensor_is_named(data, name, walk):
    (one,) = (found for found in data(name) if found.recording.name == walk)
    half = {name: jax.tree.map(lambda values: np.asarray(values)[::2], imu)
            for name, imu in one.recording.sensors.items() if imu.acc is not None}  # fmt: skip
    assert not delays.delay_notes(half, 50.0)
    shank = half["shank_left"]
    late = shank._replace(gyr=np.roll(shank.gyr, 8, axis=0), acc=np.roll(shank.acc, 8, axis=0))
    told = [note.code for note in delays.delay_notes({**half, "shank_left": late}, 50.0)]
    assert "sensor_late" in told


def test_strides_of_short_bouts_are_no_longer_than_they_are():
    """Three bouts of four strides: few samples have a counterpart three strides later, and these are more alike."""
    person = simulate.person_of(simulate.population(jax.random.key(50), 3, recorded=True), 0)
    key, bouts = jax.random.fold_in(jax.random.key(51), 0), [simulate.straight(5.0)] * 3
    recording, _ = simulate.with_breaks(key, person, bouts, (2.0, 8.0), MPU6000, placements=("foot_right", "foot_left"))
    pace = paces.pace_of(recording.sensors["foot_right"], 100.0, "foot")
    assert pace.seconds == pytest.approx(float(person.gait.stride_time), rel=0.05)
    assert not {note.code for note in damage_notes(recording)} & {"pace_unusual", "sides_out_of_step"}


def test_a_foot_whose_clock_is_late_by_a_ninth_of_a_stride_is_named(walk):
    late = walk.sensors["foot_left"]
    moved = late._replace(**{name: np.roll(getattr(late, name), 12, axis=0) for name in ("gyr", "acc")})
    codes = {note.code for note in damage_notes(walk._replace(sensors={**walk.sensors, "foot_left": moved}))}
    assert "sides_out_of_step" in codes


@pytest.mark.parametrize(
    ("name", "stated"),
    [("Time (ms)", "ms"), ("time_ms", "ms"), ("time [msec]", "ms"), ("TimeMs", "ms"), ("timems", "ms"),
     ("Items", None), ("Time (us)", "us"), ("time [µs]", "us"), ("TimeUs", "us"), ("Time (s)", None), ("times", None),
     ("Status", None)],
)  # fmt: skip
def test_a_time_column_states_its_unit(name, stated):
    assert unit_in_name(name) == stated


def table_of(rows, name, step):
    """The right foot's rows with a column of time."""
    signals = {f"foot_right_{kind}_{axis}": values for kind in ("gyr", "acc")
               for axis, values in zip("xyz", rows.sensors["foot_right"][kind].T, strict=True)}  # fmt: skip
    return pd.DataFrame({name: step * np.arange(len(rows.time)), **signals})


def test_a_fast_recording_whose_header_states_ms_is_not_taken_for_a_slow_one(rows):
    """At 2500 Hz the steps are 0.4 ms, which would also be steps of 0.4 s."""
    table = table_of(rows, "Time (ms)", 0.4)
    assert io.recording_from_dataframe(table).sampling_rate_hz == pytest.approx(2500.0)
    with pytest.raises(RecordingError, match="the time's steps are 0.4, .* 2.5 Hz in s, 2500 Hz in ms"):
        io.recording_from_dataframe(table.rename(columns={"Time (ms)": "time"}))


@pytest.mark.parametrize("read", [io.read_csv, lambda path: io.read(path, placement="foot_right")])
def test_a_header_in_microseconds_is_taken_at_its_word(rows, tmp_path, read):
    table = table_of(rows, "Time (us)", 1e4)
    path = tmp_path / "walk.csv"
    table.to_csv(path, index=False)
    assert read(path).sampling_rate_hz == pytest.approx(100.0)
    table.rename(columns={"Time (us)": "time"}).to_csv(path, index=False)
    assert any("taken to be in us" in note.text for note in read(path).notes)
    table.assign(**{"Time (us)": 0.01 * np.arange(len(rows.time))}).to_csv(path, index=False)
    with pytest.raises(RecordingError, match="with time in us, samples are 1e-08 s apart.*seems to be in s: correct"):
        read(path)


@pytest.mark.parametrize("fault", ["none", "steps", "held", "stuck", "constant"])
def test_a_range_that_repeats_its_reading_while_the_feet_move_is_masked(fault):
    """A range in steps of 1 cm is not; of one that is held until the next passing, the first readings are left."""
    count = 23 * 55 + 8  # ends with a passing
    time = np.arange(count) / 100.0
    signals = {
        "gyr": 200.0 * np.sin(6.0 * time)[:, None] * [0.0, 1.0, 0.2],
        "acc": np.tile([0.0, 0.0, 9.81], (count, 1)),
    }
    passes = np.arange(count) % 55 < 8
    reading = np.random.default_rng(0).uniform(0.1, 0.2, count)
    read = np.where(passes, reading, np.nan)
    made = {
        "none": read, "steps": np.round(read, 2), "held": pd.Series(read).ffill().to_numpy(),
        "stuck": np.where(passes & (time > 6.0), 0.15, read), "constant": np.full(count, 0.15),
    }[fault]  # fmt: skip
    sensors = {f"foot_{side}": signals for side in ("right", "left")}
    recording = io.recording_from_arrays(sensors, time=time, feet_range=made)
    left = {"stuck": passes & (time <= 6.0), "constant": passes & False}.get(fault, passes)
    assert np.array_equal(recording.feet_range.mask, left)
    assert len(found(recording, "range_stuck")) == (fault not in ("none", "steps"))


@pytest.mark.parametrize(("stands_s", "leaves_s", "alarm"), [(0.9, 0.9, False), (3.0, 0.0, False), (3.0, None, True)])
def test_a_standing_in_which_the_weight_shifts_accuses_no_axes(stands_s, leaves_s, alarm):
    """A thigh that turns slowly all the time that is recorded before the first step; and one with a reversed axis."""
    time = np.arange(1000) / 100.0 - stands_s
    walks = np.where(time > 0.0, 0.35 * np.sin(2.0 * np.pi * time / 1.2), 0.0)
    pitch = walks + 0.2 * np.clip(time / 0.3, 0.0, 1.0) + (0.08 * np.clip(time, -leaves_s, 0.0) if leaves_s else 0.0)
    rate, zero = np.gradient(pitch, time), 0.0 * time
    acc = 9.81 * np.stack([-np.sin(pitch), zero, np.cos(pitch)], axis=1)
    gyr = np.stack([zero, rate if leaves_s is not None else -rate, zero], axis=1)
    noise = 0.002 * np.random.default_rng(0).normal(size=(2, 1000, 3))
    imu = Imu(time, gyr + noise[0], acc + noise[1], np.ones(1000, bool))
    notes = tilts.tilt_notes({"thigh_right": imu}, 100.0)
    assert bool(notes) == alarm
