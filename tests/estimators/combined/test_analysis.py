"""All sensors together: what is combined, what is left out, what the tables hold."""

import jax
import numpy as np
import pytest
from made.estimators import changed, exchanged, in_a_row, masked, only
from made.notes import codes, of_code, texts

import jgait
from experiments.damage import harm
from jgait import io, simulate
from jgait.commands.jobs import of_analysis as results_of
from jgait.estimators import stride_flags
from jgait.estimators.combined.distance import distances
from jgait.estimators.combined.sources import MEASURES
from jgait.estimators.combined.strides import combined, regular
from jgait.estimators.stride_flags import STRIDE_FLAGS
from jgait.io.checks import contradictions
from jgait.quality import SensorQuality, trust
from jgait.quality import notes as writer
from jgait.report import of_analysis
from jgait.simulate.sensors import OPAL
from jgait.types import RecordingError, as_float

PLACEMENTS = (*simulate.SEVEN, "ankle_right", "ankle_left")
FEET = ("foot_right", "foot_left")
PERSON = {"height": 1.75, "pendulum_constant": 1.05}  # the constant of simulated people
CONTRADICTIONS = {
    "distances_differ",
    "feet_of_contacts_differ",
    "clock_off",
    "places_exchanged",
    "places_unsure",
}


@pytest.fixture(scope="module")
def walked():
    ((recording, truth),) = simulate.cohort(
        jax.random.key(4), 1, simulate.straight(12.0), OPAL, 100.0, PLACEMENTS, recorded=False
    )
    return recording, truth


@pytest.fixture(scope="module")
def analysis(walked):
    return jgait.analyse(walked[0], PERSON)


def test_a_late_foot_does_not_become_a_limp_without_a_note(walked, analysis):
    rows = harm.rows_of(walked[0], PLACEMENTS)
    damage = harm.DAMAGES["sensor 0.1 s late"].change(rows, "foot_right", np.random.default_rng(1))
    now = jgait.analyse(harm.read(damage, "walk"), PERSON)
    assert of_code(now.notes, "clocks_apart") and not of_code(analysis.notes, "clocks_apart")
    before, after = (
        io.analysis_to_dataframes(one)["summary"].set_index("measure").reindex(["step_duration"])
        for one in (analysis, now)
    )
    sided = ["right", "left", "asymmetry_pct", "asymmetry_std_pct"]
    assert before[sided].notna().all(axis=None) and after[sided].isna().all(axis=None)


def test_sensors_whose_clocks_differ_still_measure_lengths(walked):
    recording, truth = walked
    foot = recording.sensors["foot_right"]
    late = {name: np.roll(getattr(foot, name), 13, axis=0) for name in ("gyr", "acc", "mask")}
    recording = changed(only(recording, "pelvis", *FEET, "shank_right", "shank_left"), foot_right=foot._replace(**late))
    found = jgait.analyse(recording._replace(quality={"foot_right": SensorQuality(late=0.13)}), PERSON)
    right = np.asarray(found.estimate.strides.side) == 0
    assert found.strides.used["feet"][right].sum() > 0.5 * right.sum()
    assert set(np.array(found.strides.first)[right]) == {"waist"}  # whose times do not depend on these clocks
    assert errors(found.estimate.strides, truth).mean() < 0.02


def test_the_same_strides_are_regular_in_every_table_and_others_have_a_reason(data):
    (walk,) = data("walking5m", "Elderly/20180605_4")
    found = jgait.analyse(walk.recording, PERSON)
    table = io.analysis_to_dataframes(found)["strides"]
    np.testing.assert_array_equal(table["regular"], stride_flags.regular(found.estimate, STRIDE_FLAGS))
    assert (table["regular"] | (table["special"] != "")).all()


def test_no_number_depends_on_a_note(walked, analysis):
    rows = harm.rows_of(walked[0], simulate.FOUR)
    damage = harm.DAMAGES["sensor 0.1 s late"].change(rows, "shank_right", np.random.default_rng(1))
    recording = harm.read(damage, "walk")
    assert recording.quality["shank_right"].late == pytest.approx(0.1, abs=0.02)
    assert "clocks_apart" in codes(recording.notes)
    stated, silent = (jgait.analyse(one, PERSON) for one in (recording, recording._replace(notes=())))
    assert set(stated.notes) - set(silent.notes) <= set(recording.notes)
    for name in ("legs", "strides", "strides_stddev", "distance", "valid"):
        jax.tree.map(np.testing.assert_array_equal, *(getattr(one.estimate, name) for one in (stated, silent)))
    assert not silent.estimate.diagnostics["angles_valid_right"] and analysis.estimate.diagnostics["angles_valid_right"]
    assert silent.estimate.diagnostics["sensors"]["shank_right"].late == recording.quality["shank_right"].late


def test_every_estimator_that_has_its_sensors_runs(analysis):
    assert [source.name for source in analysis.sources] == ["feet", "ankles", "shanks", "waist", "legs"]
    assert not of_code(analysis.notes, *CONTRADICTIONS)
    (note,) = of_code(analysis.notes, "measures_from_height")
    assert "thigh length 0.43 ± 0.02 m" in str(note)
    assert "height of the waist's sensor 1.05 ± 0.02 m" in str(note)


def errors(strides, truth, rows=slice(None)):
    known = truth.strides
    valid = np.asarray(known.valid)
    found = []
    for side, end, length in zip(strides.side[rows], strides.end[rows], strides.length[rows], strict=True):
        near = np.flatnonzero(valid & (np.asarray(known.side) == side) & (np.abs(np.asarray(known.end) - end) < 0.2))
        assert near.size == 1
        found.append(length - known.length[near[0]])
    return np.abs(found)


def test_every_stride_is_there_once_and_better_than_a_source_taken_at_random(walked, analysis):
    truth = walked[1]
    assert len(analysis.strides.first) == int(np.sum(truth.strides.valid))
    together = errors(analysis.estimate.strides, truth)
    alone = [
        errors(source.estimate.strides, truth).mean()
        for source in analysis.sources
        if source.name in ("feet", "ankles", "shanks")
    ]
    assert together.mean() < np.mean(alone)  # `experiments/one_call` compares with the best of many walks
    assert np.mean((together / analysis.estimate.strides_stddev.length) ** 2) < 2.0


def test_an_analysis_and_a_recording_are_printed_in_one_line(walked, analysis):
    shown = repr(analysis)
    assert f"{len(analysis.strides.first)} strides; sources {analysis.sources[0].name}" in shown
    assert f"distance {analysis.estimate.distance[-1]:.2f} ± " in shown
    assert shown.endswith(f"; {len(analysis.notes)} notes)")
    assert max(len(shown), len(repr(walked[0]))) < 250


def test_a_path_a_measure_named_as_in_tables_and_the_strides_as_a_table(walked, analysis, tmp_path):
    path = io.write_csv(io.recording_to_dataframe(only(walked[0], "pelvis")), tmp_path / "walk.csv")
    from_file = jgait.analyse(str(path), {"height_m": 1.75, "pendulum_constant": 1.05})
    assert from_file.person == PERSON
    bare = path.rename(tmp_path / "bare.csv")
    bare.write_text(bare.read_text().replace("pelvis_", "", 99))
    moved = jgait.analyse(bare, PERSON, placement="lower_back")
    assert moved.sources[0].placements == ("lower_back",)
    with pytest.raises(TypeError, match="placement: only for the path of a file; this recording is read already"):
        jgait.analyse(walked[0], placement="waist")
    same = jgait.analyse(only(walked[0], "pelvis"), PERSON)
    assert from_file.estimate.distance[-1] == pytest.approx(same.estimate.distance[-1], rel=1e-3)
    strides = analysis.to_dataframe()
    assert strides.equals(io.analysis_to_dataframes(analysis)["strides"]) and len(strides) == len(
        analysis.strides.first
    )
    assert "stride_length" in analysis._repr_html_()
    with pytest.raises(ValueError, match="tables are strides, summary, .*; got 'angles'"):
        analysis.to_dataframe("angles")
    with pytest.raises(ValueError, match="a person has one height; got 'height' and 'height_m'"):
        jgait.analyse(walked[0], {"height": 1.75, "height_m": 1.8})


def test_the_distance_is_combined_too(walked, analysis):
    told = {c.source: c for c in analysis.comparisons if c.quantity == "distance"}
    alone = [c.stddev for name, c in told.items() if name != "combined"]
    assert told["combined"].stddev < min(alone)
    true = float(walked[1].estimate.distance[-1])
    assert abs(told["combined"].value / true - 1.0) < 0.03
    np.testing.assert_allclose(analysis.estimate.distance[-1], told["combined"].value)


def test_a_waist_with_too_short_strides_does_not_pull_what_feet_measure():
    person = simulate.walking(simulate.Person()._replace(gait=simulate.Gait(steps=16.0)), "shuffling")
    recording, truth = simulate.recording(
        jax.random.key(2), person, errors=OPAL, placements=("foot_right", "foot_left", "pelvis")
    )
    made = jgait.analyse(recording, {"height": 1.75})
    strides = made.estimate.strides
    assert {c.source for c in made.comparisons if c.quantity == "stride_length"} == {"feet", "waist", "combined"}
    np.testing.assert_allclose(np.median(strides.length), person.gait.stride_length, rtol=0.05)
    assert np.median(made.estimate.strides_stddev.length) < 0.03
    true = float(truth.estimate.distance[-1])
    np.testing.assert_allclose(made.estimate.distance[-1], true, rtol=0.05)
    waist = jgait.analyse(only(recording, "pelvis"), {"height": 1.75}).estimate
    assert np.median(waist.strides.length) > 1.2 * np.median(strides.length)


def test_a_source_that_knows_its_strides_badly_forbids_nothing_that_others_measure():
    people, way, key = (
        simulate.population(jax.random.key(50), 6, recorded=True),
        simulate.straight(2.0),
        jax.random.key(51),
    )
    person = simulate.covering(jax.random.fold_in(key, 1), simulate.person_of(people, 1), way)
    recording, _ = simulate.recording(jax.random.fold_in(key, 1), person, way, placements=(*FEET, "lower_back"))
    both, one_foot, alone = (
        jgait.analyse(r, {"height": 1.75})
        for r in (recording, only(recording, "foot_right", "lower_back"), only(recording, "lower_back"))
    )
    # with one foot the waist alone measures the strides of the other, a third of all
    for found, lengths, distance in ((both, "check", "check"), (one_foot, "stop", "check"), (alone, "stop", "stop")):
        severities = {note.code: note.severity for note in of_code(found.notes, "stances_rare", "distance_doubtful")}
        assert severities == {"stances_rare": lengths, "distance_doubtful": distance}
    assert [trust(found.estimate).recording for found in (both, alone)] == [True, False]
    assert max(both.estimate.strides_stddev.length) < 0.1 and both.estimate.distance[-1] == pytest.approx(2.0, rel=0.1)


def test_in_running_feet_alone_count():
    way, key = simulate.straight(16.0), jax.random.key(1)
    person = simulate.covering(key, simulate.walking(simulate.Person(), "running"), way)
    recording, truth = simulate.recording(key, person, way, placements=simulate.SEVEN)
    found = jgait.analyse(recording)
    assert {"strides_quick", "strides_not_learned"} <= set(codes(found.notes))
    assert not of_code(found.notes, "places_exchanged", "clock_off")
    true = float(truth.estimate.distance[-1])
    off = {s.name: abs(float(s.estimate.distance[-1]) / true - 1.0) for s in found.sources}
    assert off["shanks"] > 0.04 and off["waist"] > 0.03
    assert float(found.estimate.distance[-1]) == pytest.approx(true, rel=0.02)
    alone = jgait.analyse(only(recording, *simulate.FOUR)).estimate
    deviation = float(alone.diagnostics["distance_stddev"][-1])
    assert abs(float(alone.distance[-1]) - true) < 2.0 * deviation and deviation > 0.09 * true


def test_running_between_walks_is_named_and_turns_nothing_round():
    """In running, two strides look like one slow stride, and the trunk speeds up after it is lifted, not before."""
    person, ways = simulate.Person(), [simulate.straight(20.0), simulate.straight(30.0), simulate.straight(20.0)]
    parts = []
    for number, (way, gait) in enumerate(zip(ways, ("", "running", ""), strict=True)):
        key = jax.random.key(number)
        walks = simulate.covering(key, simulate.walking(person, gait) if gait else person, way)
        parts.append(simulate.recording(key, walks, way, placements=(*FEET, "pelvis")))
    recording = in_a_row(*[part for part, _ in parts])
    found = jgait.analyse(recording)
    assert not of_code((*found.notes, *contradictions(recording)[1]), "pace_unusual", "clocks_apart")
    alone = jgait.analyse(only(recording, "pelvis")).estimate
    (falls,) = [n for n in of_code(alone.diagnostics["notes"], "strides_not_learned") if "share_pct" in n.values]
    assert falls.values["strides"] < 0.8 * falls.values["of"]
    true = sum(float(truth.estimate.distance[-1]) for _, truth in parts)
    assert abs(float(alone.distance[-1]) - true) < 2.0 * float(alone.diagnostics["distance_stddev"][-1])


def test_the_tables_hold_strides_contacts_bouts_sources_and_angles(analysis):
    tables = io.analysis_to_dataframes(analysis)
    assert list(tables) == ["strides", "summary", "bouts", "contacts", "sources", "samples"]
    strides, samples = tables["strides"], tables["samples"]
    assert strides["knee_flexion_max_deg"].between(40, 90).all() and strides["angles_valid"].all()
    one, whole = strides.iloc[5], strides.query("regular")
    within = samples[samples["time_s"].between(one["start_s"], one["end_s"])]
    at = within[f"knee_angle_{one['side']}_deg"].idxmax()
    assert one["knee_flexion_max_std_deg"] == samples[f"knee_angle_{one['side']}_std_deg"][at] > 3.0
    np.testing.assert_allclose(whole["stance_duration_s"] + whole["swing_duration_s"], whole["stride_duration_s"])
    summary = tables["summary"].set_index("measure")
    assert summary.loc["stride_length", "mean"] == pytest.approx(whole["stride_length_m"].median(), rel=0.02)
    assert 0.0 < summary.loc["stride_length", "std"] < 0.1
    metres, error = analysis.estimate.distance[-1], analysis.estimate.diagnostics["distance_stddev"][-1]
    (bout,) = tables["bouts"].to_dict("records")
    assert (bout["distance_m"], bout["distance_std_m"]) == (pytest.approx(metres), pytest.approx(error))
    assert (summary.loc["distance", "mean"], summary.loc["distance", "error_std"]) == (bout["distance_m"], error)
    assert bout["n_strides"] == summary.loc["distance", "n_strides"] == len(strides)
    for joint in ("hip", "knee"):
        low, high, between = (f"{joint}_flexion_{word}" for word in ("min", "max", "range"))
        np.testing.assert_allclose(strides[f"{between}_deg"], strides[f"{high}_deg"] - strides[f"{low}_deg"])
        ends = strides[[f"{low}_std_deg", f"{high}_std_deg"]].to_numpy()
        np.testing.assert_allclose(strides[f"{between}_std_deg"], np.hypot(*ends.T))
    contacts = tables["contacts"]
    initial = contacts[contacts["event"] == "initial"]["side"].to_numpy()
    assert (np.diff(contacts["time_s"]) >= 0.0).all() and (initial[1:] != initial[:-1]).all()
    assert {"feet", "ankles", "shanks", "waist", "legs", "combined"} == set(tables["sources"]["source"])
    assert "not usable" not in str(results_of(analysis).rows)


def test_exchanged_sensors_change_nothing_but_a_note(walked, analysis):
    quality = {"ankle_right": SensorQuality(late=-0.1), "shank_right": SensorQuality(faster=1.7)}
    follow = tuple(writer.contradictions(quality))
    assert codes(follow) == ["clocks_apart", "sensor_contradicts"]
    wrong = exchanged(walked[0], "foot_right", "shank_right")._replace(notes=follow, quality=quality)
    found = jgait.analyse(wrong, PERSON)
    (note,) = set(found.notes) - set(analysis.notes)
    assert note.code == "places_exchanged"
    np.testing.assert_allclose(found.estimate.strides.length, analysis.estimate.strides.length)
    assert found.estimate.distance[-1] == pytest.approx(analysis.estimate.distance[-1])


def test_exchanged_feet_contradict_the_waist(walked):
    notes = jgait.analyse(exchanged(only(walked[0], "pelvis", *FEET), *FEET), PERSON).notes
    (note,) = of_code(notes, "feet_of_contacts_differ")
    assert "waist and feet say the opposite" in str(note)


def test_the_lengths_of_a_shoe_beside_the_waist_are_its_own(walked):
    recording = only(walked[0], "pelvis", "foot_right")
    found = jgait.analyse(recording, {"height": PERSON["height"]})
    length = stride_length_in(found)
    assert length["mean"] == length["right"] and np.isnan(length["left"])
    length = stride_length_in(jgait.analyse(recording, PERSON))  # of a known pendulum, the waist's count as well
    assert length["mean"] == pytest.approx(0.5 * (length["right"] + length["left"]), rel=0.01)


def stride_length_in(found):
    return io.analysis_to_dataframes(found)["summary"].set_index("measure").loc["stride_length"]


def test_legs_that_walk_backwards_are_not_believed_and_the_note_says_why(walked):
    backwards = {
        name: imu._replace(gyr=-imu.gyr[::-1], acc=imu.acc[::-1], mask=imu.mask[::-1])
        for name, imu in only(walked[0], "pelvis", *simulate.FOUR).sensors.items()
    }  # fmt: skip
    found = jgait.analyse(walked[0]._replace(sensors=backwards), PERSON)
    (places,) = of_code(found.notes, "places_unsure")
    assert "walks backwards" in str(places)
    assert of_code(found.notes, "knee_implausible") or of_code(found.notes, "angles_doubtful")


def read_again(recording, placement, change):
    """The recording as a reader gives it after a change of one sensor's rows, gyroscopes in deg/s."""
    sensors = {
        name: {"gyr": np.rad2deg(imu.gyr), "acc": np.array(imu.acc)}
        for name, imu in recording.sensors.items()
        if not name.startswith("ankle")
    }
    change(sensors[placement])
    return io.recording_from_arrays(sensors, time=np.asarray(recording.sensors[placement].time))


def turned(sensor):
    sensor["gyr"] *= -1.0


def of_distance(found):
    return {c.source: c for c in found.comparisons if c.quantity == "distance"}


def test_a_sensor_that_a_reader_accuses_is_left_out_of_the_combined_distance(walked):
    recording, truth = walked
    found = jgait.analyse(read_again(recording, "shank_right", turned), PERSON)
    true, told = float(truth.estimate.distance[-1]), of_distance(found)
    alone = next(source for source in found.sources if source.name == "shanks").estimate
    assert abs(float(alone.distance[-1]) / true - 1.0) > 0.1
    assert abs(told["shanks"].value / true - 1.0) < 0.05  # from the left side
    (note,) = of_code(found.notes, "distance_of_one_side")
    assert note.values == {"source": "shanks", "side": "left"}
    assert abs(told["combined"].value / true - 1.0) < 0.03
    right = np.asarray(found.strides.strides.side) == 0
    assert not found.strides.used["shanks"][right].any()
    assert not found.strides.flags["doubtful"][right & (found.strides.rows["feet"] >= 0)].any()
    (note,) = of_code(found.notes, "angles_doubtful")
    assert note.values == {"sides": "right", "sensors": "shank_right"}
    tables = io.analysis_to_dataframes(found)
    assert not tables["samples"]["angles_valid_right"].any() and tables["samples"]["angles_valid_left"].all()
    np.testing.assert_array_equal(tables["strides"]["angles_valid"], tables["strides"]["side"] == "left")
    printed = {row[0]: row[1] for row in results_of(found).rows}
    assert [name for name, words in printed.items() if words.endswith("°, not usable")] == ["hip right", "knee right"]


def test_angles_of_a_knee_that_nobody_bends_are_not_usable_and_their_distance_does_not_count(walked):
    recording = only(walked[0], *simulate.FOUR)
    imu = recording.sensors["thigh_right"]
    time, rates = np.asarray(imu.time), np.array(imu.gyr)
    stuck = (time > 4.0) & (time < 5.0)
    rates[stuck] = rates[np.argmax(stuck)]
    found = jgait.analyse(changed(recording, thigh_right=imu._replace(gyr=rates)), PERSON)
    assert "stop" in {note.severity for note in of_code(found.notes, "knee_implausible")}
    (note,) = of_code(found.notes, "angles_doubtful")
    assert note.values == {"sides": "right", "sensors": "thigh_right, shank_right"}
    strides = io.analysis_to_dataframes(found)["strides"]
    np.testing.assert_array_equal(strides["angles_valid"], strides["side"] == "left")
    assert strides["regular"].any()  # lengths do not need the thigh
    (legs,) = (source for source in found.sources if source.name == "legs")
    (distance,), _ = distances([legs], recording, frozenset(), frozenset())
    assert distance.doubtful


def test_strides_that_only_a_wrong_sensor_measured_do_not_count_in_means(walked):
    found = jgait.analyse(only(read_again(walked[0], "foot_right", turned), *FEET), PERSON)
    right = np.asarray(found.strides.strides.side) == 0
    assert found.strides.flags["doubtful"][right].all()
    told = next(c for c in found.comparisons if (c.quantity, c.source) == ("stride_length", "combined"))
    left = found.estimate.strides.length[~right & regular(found.strides)]
    assert (told.value, told.strides) == (pytest.approx(np.median(left)), left.size)


def test_a_gap_of_one_leg_takes_no_angles_from_the_other(walked, analysis):
    recording = only(walked[0], *simulate.FOUR)
    shank = recording.sensors["shank_right"]
    time = np.asarray(shank.time)
    begin, step = float(time[len(time) // 2]), float(time[1] - time[0])
    one = jgait.analyse(changed(recording, shank_right=masked(shank, (time < begin) | (time >= begin + 0.4))), PERSON)
    whole, lossy = (as_float(found.estimate.legs.left.knee_angle) for found in (analysis, one))
    np.testing.assert_allclose(lossy, whole, atol=1e-6)
    gap = ~np.isfinite(as_float(one.estimate.legs.right.knee_angle))
    assert gap.sum() == pytest.approx(0.4 / step, abs=1)
    assert [note.values["side"] for note in of_code(one.notes, "not_estimated")] == ["right"]


def test_a_source_without_any_stride_does_not_stop_the_others(walked):
    pelvis = walked[0].sensors["pelvis"]
    shaken = 0.01 * np.random.default_rng(0).normal(size=np.shape(pelvis.acc))
    still = pelvis._replace(acc=np.array([0.0, 0.0, 9.81]) + shaken)
    found = jgait.analyse(changed(only(walked[0], *FEET), pelvis=still), PERSON)
    assert len(found.strides.first) > 10


def standing(recording, seconds=4.0):
    """The same sensors while the person stands: what they read in the first half second, again and again."""
    sensors = {}
    for name, imu in recording.sensors.items():
        rows = np.arange(int(seconds * recording.sampling_rate_hz)) % int(0.5 * recording.sampling_rate_hz)
        sensors[name] = imu._replace(
            time=imu.time[: rows.size], gyr=imu.gyr[rows], acc=imu.acc[rows], mask=imu.mask[: rows.size]
        )
    return recording._replace(sensors=sensors)


def test_a_person_who_only_stands_has_tables_and_a_note_but_no_strides(walked):
    found = jgait.analyse(standing(walked[0]), PERSON)
    assert found.strides is None and found.estimate.strides is None
    assert found.notes[0].code == "no_walking"
    tables = io.analysis_to_dataframes(found)
    assert (
        all(tables[name].empty for name in ("strides", "summary", "bouts")) and "stride_length_m" in tables["strides"]
    )
    shown = tables["strides"].query("regular")[["side", "stride_length_std_m", "special", "knee_flexion_max_deg"]]
    assert shown.empty
    results = results_of(found)
    assert not {"cadence", "stance"} & {row[0] for row in results.rows}
    assert results.numbers["notes"][0]["code"] == "no_walking"
    assert "No strides were found" in of_analysis(found, walked[0]).html


def test_a_missing_height_is_said_only_where_it_matters(walked):
    for sensors, said in ((FEET, False), (("pelvis",), True)):
        absent = of_code(jgait.analyse(only(walked[0], *sensors)).notes, "height_absent")
        assert ["deviations hold for adults alone" in str(note) for note in absent] == [True] * said


def test_a_stiff_leg_turns_less_and_counts_and_a_wrong_unit_does_not():
    usual = simulate.person_of(simulate.population(jax.random.key(0), 1, recorded=False), 0)
    way, key = simulate.straight(16.0), jax.random.key(1)
    person = simulate.covering(key, simulate.walking(usual, "stiff_leg"), way)
    recording, _ = simulate.recording(key, person, way, placements=(*FEET, "shank_right", "shank_left"))
    foot = recording.sensors["foot_right"]
    for factor, counts in ((1.0, True), (0.4, False)):
        wrong = changed(recording, foot_right=foot._replace(gyr=factor * foot.gyr))
        quality = {name: SensorQuality(faster=facts.faster) for name, facts in contradictions(wrong)[0].items()}
        assert len(writer.contradictions(quality)) == 1
        feet = only(wrong, *FEET)
        noted, plain = (jgait.analyse(feet._replace(quality=stated)).estimate for stated in (quality, {}))
        spreads = [float(one.diagnostics["distance_stddev"][-1]) for one in (noted, plain)]
        assert (spreads[0] == spreads[1]) == counts


def test_sensors_that_no_estimator_takes_are_named(walked):
    kept = only(walked[0], "shank_left", "thigh_right", "pelvis")
    notes = jgait.analyse(changed(kept, waist=kept.sensors["pelvis"], wrist_left=kept.sensors["shank_left"])).notes
    assert not of_code(notes, "one_leg_seen")
    alone = jgait.analyse(only(kept, "shank_left")).notes  # of legs, leg_ekf has a note that says it
    assert [note.values["side"] for note in of_code(alone, "one_leg_seen")] == ["left"]
    assert {text.partition(" is not used: ")[::2] for text in texts(notes) if " is not used: " in text} == {
        ("pelvis", "waist serves as well"), ("wrist_left", "no estimator takes a sensor there"),
        ("thigh_right", "it is worn without the shank of that leg"),
    }  # fmt: skip


def test_what_cannot_be_done_is_said(walked):
    with pytest.raises(RecordingError, match=r"no estimator has its sensors.*thigh_right"):
        jgait.analyse(only(walked[0], "thigh_right"))
    with pytest.raises(ValueError, match=r"a person has .*height.*; got 'size'"):
        jgait.analyse(walked[0], {"size": 1.8})
    with pytest.raises(ValueError, match="got 'hight'; did you mean 'height'"):
        jgait.analyse(walked[0], {"hight": 1.8})
    with pytest.raises(ValueError, match="got 'distance_scale', a parameter of leg_ekf, which leg_ekf.estimate"):
        jgait.analyse(walked[0], {"distance_scale": 1.05})


def test_every_measure_that_is_accepted_is_in_the_help():
    assert [name for names in MEASURES.values() for name in names if f'"{name}"' not in jgait.analyse.__doc__] == []


@pytest.mark.parametrize(
    ("person", "said"),
    [
        ({"height": 175.0}, r"^height must be between 0.8 and 2.4 m; got 175 \(in cm\? then 1.75\)$"),
        ({"height": float("nan")}, r"^height must be .* m; got nan: leave out what is unknown$"),
        ({"height": None}, "^height must be a number; got None: leave out what is unknown$"),
        ({"height": "1.75"}, "^height must be a number; got '1.75'$"),
        ({"lever_shank": 0.45}, r"^lever_shank must be between 0 and 0.4 m; got 0.45$"),
        ({"thigh_length": (0.4, 42.0)}, r"^thigh_length must be between 0.2 and 0.7 m; got 42 \(in cm\? then 0.42\)$"),
    ],
)
def test_measures_that_cannot_be_a_person_s_are_refused_by_their_names(walked, person, said):
    for recording in (walked[0], only(walked[0], "pelvis")):
        with pytest.raises(ValueError, match=said):
            jgait.analyse(recording, person)


HALF, PAIR = np.array([[1.0, 0.5], [0.5, 1.0]]), np.array([[1.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]])
COMBINED = {  # values, deviations, correlations → value, deviation, which are kept
    "by their variances": ([1.0, 1.3], [0.1, 0.2], None, [5.3 / 5, np.sqrt(0.04 / 5)], [True, True]),
    "shared errors count once": ([1.0, 1.1], [0.1, 0.1], HALF, [1.05, 0.1 * np.sqrt(0.75)], [True, True]),
    "two that contradict": ([1.0, 2.0], [0.02, 0.1], None, [1.0, np.hypot(0.02, 0.5)], [True, False]),
    "the most certain and those that agree": (
        [1.0, 1.02, 2.0, 2.0], [0.02, 0.02, 0.05, 0.05], None, [1.01, np.sqrt(0.0002 + 0.5**2)],
        [True, True, False, False],
    ),
    "one that two others contradict": (
        [1.0, 1.2, 1.21], [0.01, 0.02, 0.02], None, [1.205, np.sqrt(0.0002)], [False, True, True]
    ),
    "two with shared errors do not outvote a third": (
        [1.2, 1.21, 1.0], [0.02, 0.02, 0.01], PAIR, [1.0, np.hypot(0.01, 0.1)], [False, False, True]
    ),
    "so uncertain that it agrees with all": (
        [1.0, 1.2, 1.1], [0.01, 0.02, 0.3], None, [1.0, np.hypot(0.01, 0.1)], [True, False, True]
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", COMBINED)
def test_measurements_are_combined_unless_they_contradict(name):
    values, deviations, shared, expected, which = COMBINED[name]
    value, sd, kept = combined(np.array(values), np.array(deviations), *([] if shared is None else [shared]))
    np.testing.assert_allclose([value, sd], expected, rtol=1e-2 if name.startswith("so uncertain") else 1e-7)
    assert kept.tolist() == which
