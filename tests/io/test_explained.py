"""One damage gives one note: what it explains is not reported as another damage, and no intact sensor is accused."""

import jax
import numpy as np
import pytest

from experiments.damage import harm
from jgait import simulate
from jgait.estimators.combined import crosscheck
from jgait.io.damage import agreement, delays, paces, turns
from jgait.simulate.sensors import OPAL
from jgait.types import SIDES, Imu

LEGS = tuple(f"{segment}_{side}" for segment in ("thigh", "shank") for side in SIDES)


@pytest.fixture(scope="module")
def rows():
    walk = simulate.cohort(jax.random.key(5), 1, simulate.straight(20.0), OPAL, recorded=False)[0][0]
    return harm.rows_of(walk, tuple(walk.sensors))


@pytest.fixture(scope="module")
def turning():
    walk = simulate.cohort(jax.random.key(6), 1, simulate.u_turn(6.0), OPAL, recorded=False)[0][0]
    return harm.rows_of(walk, tuple(walk.sensors))


def worn(rows, *placements):
    return rows._replace(sensors={placement: rows.sensors[placement] for placement in placements})


def exchanged(rows, segment):
    right, left = (f"{segment}_{side}" for side in SIDES)
    return rows._replace(sensors={**rows.sensors, right: rows.sensors[left], left: rows.sensors[right]})


def checks(rows):
    """Notes that are no mere facts; the feet of the person who turns clip."""
    return [n for n in harm.read(rows, "walk").notes if n.severity != "info" and n.code != "channel_clipped"]


def codes(notes):
    return [note.code for note in notes]


def damaged(rows, name, placement):
    return harm.DAMAGES[name].change(rows, placement, np.random.default_rng(1))


# --- exchanged sensors are no late clock ---


@pytest.mark.parametrize("segment", ["thigh", "shank", "foot"])
def test_exchanged_sensors_are_named_and_no_clock_is(rows, segment):
    (note,) = checks(exchanged(rows, segment))
    assert note.code == "sides_exchanged"
    assert note.text.startswith(f"the right and left {segment} sensors seem exchanged")


def test_of_two_pairs_either_is_exchanged(rows):
    legs = worn(rows, *LEGS)
    assert checks(legs) == []
    for segment in ("thigh", "shank"):
        (note,) = checks(exchanged(legs, segment))
        assert note.values["kind"] == "shank or thigh"


def test_five_strides_of_a_real_walk_show_exchanged_shanks(data):
    """Three whole strides are few to compare phases; impacts pass through one leg."""
    (walk,) = data("walking5m", "Young/20180621_9")
    legs = harm.rows_of(walk.recording, LEGS)
    assert checks(legs) == []
    wrong = harm.read(exchanged(legs, "shank"), "walk")
    assert [note.code for note in wrong.notes if note.severity != "info"] == ["sides_exchanged"]
    assert crosscheck(wrong).doubtful == set(LEGS)
    assert codes(crosscheck(wrong._replace(notes=())).notes) == ["sides_exchanged"]


def test_the_cross_check_does_not_repeat_what_the_reader_noted(rows):
    wrong = harm.read(exchanged(rows, "shank"), "walk")
    found = crosscheck(wrong)
    assert found.notes == ()
    assert found.doubtful == {"shank_right", "shank_left"}
    assert codes(crosscheck(wrong._replace(notes=())).notes) == ["sides_exchanged"]


def test_a_late_sensor_is_still_late_and_not_exchanged(rows):
    late = codes(checks(damaged(rows, "sensor 0.1 s late", "shank_right")))
    assert "sensor_late" in late and "sides_exchanged" not in late


# --- short and slow recordings ---


def swinging(seconds, stride, still=6.0, rate=100.0):
    """A sensor that swings for some seconds, every second stride like the one before it."""
    time = np.arange(round((seconds + 2.0 * still) * rate)) / rate
    phase = 2.0 * np.pi * (time - still) / stride
    walks = (time >= still) & (time < still + seconds)
    every = np.where(np.sin(0.5 * phase) > 0.0, 1.0, -0.1)
    gyr = np.where(walks, 3.0 * every * np.sin(phase) ** 3, 0.0)[:, None] * np.array([0.0, 1.0, 0.1])
    acc = np.array([0.0, 0.0, 9.8]) + np.where(walks, 3.0 * np.cos(3.0 * phase), 0.0)[:, None]
    return Imu(time, gyr, acc, np.ones(len(time), bool))


def test_two_strides_are_not_taken_for_one_in_a_short_walk():
    long = paces.pace_of(swinging(12.0, 1.4), 100.0, "shank")
    assert long is not None and long.seconds == pytest.approx(2.8, abs=0.05)
    assert paces.pace_of(swinging(5.6, 1.4), 100.0, "shank") is None


@pytest.mark.parametrize("every", [1, 4])
def test_a_short_or_slow_copy_of_a_real_walk_has_no_wrong_clock(data, every):
    """Two strides after a turn repeat better than each stride does."""
    (walk,) = data("neura_sparse")
    legs = harm.rows_of(walk.recording, LEGS)
    count = len(legs.time) if every > 1 else int(0.5 * len(legs.time))
    assert "pace_unusual" not in codes(checks(harm._kept(legs, np.arange(0, count, every), stamps=True)))


def turned(until, share, rate=100.0):
    """A person who walks straight and begins to turn about the vertical; a sensor that turns by a share of that."""
    time = np.arange(round(until * rate)) / rate
    yaw = np.where(time > 8.0, 1.6, 0.0)
    gyr = np.stack([0.0 * time, np.sin(2.0 * np.pi * time), share * yaw], axis=1)
    return Imu(time, gyr, np.tile([0.0, 0.0, 9.8], (len(time), 1)), np.ones(len(time), bool))


@pytest.mark.parametrize(("share", "until", "named"), [(0.6, 9.2, False), (-1.0, 9.2, True), (0.6, 14.0, True)])
def test_a_turn_that_the_end_of_the_file_cuts_off_shows_a_wrong_sign_alone(share, until, named):
    sensors = {placement: turned(until, 1.0) for placement in ("pelvis", *LEGS)} | {"shank_left": turned(until, share)}
    found = turns.turn_notes(sensors, 100.0)
    assert [note.values["placement"] for note in found] == (["shank_left"] if named else [])


# --- of two feet, the intact one is not accused ---


@pytest.mark.parametrize("name", ["gyroscope's sign", "gyroscope's z turned round", "gyroscope's y turned round"])
@pytest.mark.parametrize("placement", ["foot_left", "foot_right"])
def test_of_two_feet_the_one_that_contradicts_itself_is_named(turning, name, placement):
    feet = worn(turning, "foot_left", "foot_right")
    found = checks(damaged(feet, name, placement))
    assert any(placement in (note.values["placement"], note.values.get("other")) for note in found)
    accused = {note.values["placement"] for note in found if note.code != "one_turns_apart"}
    assert accused <= {placement}


def test_of_two_sensors_of_which_none_contradicts_itself_none_is_named_alone():
    sensors = {"foot_right": turned(14.0, 1.0), "foot_left": turned(14.0, -1.0)}
    (note,) = turns.turn_notes(sensors, 100.0)
    assert note.code == "one_turns_apart"
    assert {note.values["placement"], note.values["other"]} == set(sensors)
    (note,) = turns.turn_notes(sensors, 100.0, {"foot_left"})
    assert (note.code, note.values["placement"], note.values["others"]) == ("turns_apart", "foot_left", "foot_right")
    assert turns.turn_notes({"foot_right": turned(14.0, 1.0), "foot_left": turned(14.0, 0.9)}, 100.0) == ()


# --- lost samples ---


@pytest.mark.parametrize("placement", ["shank_right", "foot_left", "pelvis"])
def test_a_frozen_sensor_has_one_note(turning, placement):
    (note,) = checks(damaged(turning, "frozen for 3 s", placement))
    assert note.code == "samples_frozen"
    assert note.text.startswith(f"{placement}: one reading of the gyroscope")
    assert ("and the accelerometer is repeated for 3.00 s" in note.text) == (placement != "pelvis")


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("one cell of 1e6, gyr", "samples_impossible"),
        ("ten rows of -999", "samples_placeholder"),
        ("zeros for 0.5 s", "samples_placeholder"),
        ("rows of 2 s missing, with stamps", "gaps_filled"),
        ("gap of 1 s", "stretch_missing"),
    ],
)
def test_masked_samples_are_noted_once(rows, name, code):
    assert codes(checks(damaged(rows, name, "shank_left"))) == [code]


def test_short_losses_beside_a_noted_one_are_counted(rows):
    sensors = {**rows.sensors, "shank_left": {kind: v.copy() for kind, v in rows.sensors["shank_left"].items()}}
    sensors["shank_left"]["gyr"][100, 1] = 1e6
    sensors["shank_left"]["gyr"][[300, 400], 1] = np.nan
    texts = [note.text for note in checks(rows._replace(sensors=sensors))]
    assert f"shank_left: 2 of {len(rows.time)} samples are missing" in texts
    assert len(texts) == 2


def test_a_gyroscope_in_another_unit_is_noted_once(turning):
    found = checks(damaged(turning, "gyroscope in rad/s", "shank_right"))
    assert {note.values["placement"] for note in found} == {"shank_right"}
    assert agreement.GYROSCOPE_SLOW.code in codes(found)
    assert not {"sides_differ", "turns_apart"} & set(codes(found))


def test_lost_rows_are_no_delay_within_a_sensor(rows):
    found = checks(damaged(rows, "5 % of rows missing, with stamps", "shank_left"))
    assert delays.ACCELEROMETER_LATE.code not in codes(found)
    assert codes(found) == ["gaps_filled"]


@pytest.mark.parametrize(("samples", "named"), [(2, False), (3, True)])
def test_at_25_hz_a_delay_by_one_sample_is_none(rows, samples, named):
    """Without a shift, the accelerometer is one of these samples early."""
    shank = {kind: values[::4] for kind, values in rows.sensors["shank_right"].items()}
    shank["acc"] = np.roll(shank["acc"], samples, axis=0)
    late = codes(checks(rows._replace(sensors={"shank_right": shank}, time=rows.time[::4])))
    assert (delays.ACCELEROMETER_LATE.code in late) == named


def test_feet_that_land_quickly_are_not_late_in_themselves():
    """In quick steps a delay at an end of the usual ones fits best."""
    key, way = jax.random.key(0), simulate.straight(12.0)
    person = simulate.person_of(simulate.population(jax.random.key(2), 1, recorded=True), 0)
    person = person._replace(gait=person.gait._replace(stride_time=120.0 / 170.0))
    person = simulate.covering(key, person, way)
    recording, _ = simulate.recording(key, person, way, placements=("foot_right", "foot_left"))
    assert not delays.delay_notes(recording.sensors, recording.sampling_rate_hz)
    foot = recording.sensors["foot_right"]
    early = foot._replace(acc=np.roll(foot.acc, -round(0.08 * recording.sampling_rate_hz), axis=0))
    (note,) = delays.delay_notes({"foot_right": early}, recording.sampling_rate_hz)
    assert note.code == delays.ACCELEROMETER_LATE.code
