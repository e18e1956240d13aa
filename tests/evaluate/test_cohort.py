"""A cohort: everyone's numbers are their own, whatever happens to others, to the run, or to the order."""

import gc
import json
import weakref

import jax
import numpy as np
import pandas as pd
import pytest
from made.cohort import FAKE, TRACED, Params, read, run, walk
from made.notes import note, texts

from jgait import evaluate
from jgait.evaluate import buckets, scores, store
from jgait.evaluate.store import Folder
from jgait.notes import Kind, from_json
from jgait.types import Estimate, Feet, FootTrajectory, Legs, Strides, Walk

ERRORS = ["error", "abs_error", "rel_error"]


def same(one, two):
    for name in one._fields:
        pd.testing.assert_frame_equal(getattr(one, name), getattr(two, name), check_exact=True)


ALONE = jax.jit(run, static_argnums=2)


def alone(item: Walk, params=None) -> Estimate:
    made = FAKE.prepare(item.recording)
    return jax.tree.map(np.asarray, ALONE(params or Params(), made.inputs, made.options))


@pytest.fixture(scope="module")
def twenty():
    return evaluate.cohort(FAKE, [walk(i) for i in range(20)], batch=4)


def test_a_distance_that_cannot_be_right_is_noted():
    typed = walk(2)  # with ten times its distance in the reference, as by a typing error
    typed = typed._replace(reference=typed.reference._replace(distance=10.0 * typed.reference.distance))
    rows = evaluate.cohort(FAKE, [walk(1), typed]).recordings["notes"]
    said = [[note.text for note in from_json(row) if note.code == "reference_distance_off"] for row in rows]
    way = typed.reference.distance[-1] - typed.reference.distance[0]
    assert said == [[], [f"the reference says {way:.2f} m, the estimate {0.11 * way:.2f} m"]]


def test_everyone_s_numbers_are_those_of_a_run_alone(twenty):
    assert list(twenty.recordings["recording"]) == [f"walk_{i:03d}" for i in range(20)]
    assert twenty.failures.empty
    for i in (0, 1, 7, 19):
        item = walk(i)
        row = twenty.recordings.iloc[i]
        assert (row["subject"], row["n_samples"], row["valid"]) == (f"00{i % 4}", item.reference.time.size, 1.0)
        assert row["seconds"] == pytest.approx(item.reference.time[-1])
        came, prepared, *_ = texts(from_json(row["notes"]))
        assert (came, prepared) == ("as it came", "prepared")
        estimate = alone(item)
        table = twenty.quantities[twenty.quantities["recording"] == row["recording"]].set_index("quantity")
        error = evaluate.distance_error(estimate, item.reference)
        np.testing.assert_allclose(table.loc["distance_m", ["estimate", "reference", *ERRORS]].astype(float),
                                   error[:5], rtol=1e-12)  # fmt: skip
        rms = evaluate.trajectory_errors(estimate, item.reference).loc["right"]
        names = ["hip_rmse_deg_right", "knee_rmse_deg_right", "x_rmse_cm_right", "y_rmse_cm_right"]
        np.testing.assert_allclose(table.loc[names, "estimate"], rms, rtol=1e-12)
        assert list(table.index) == ["distance_m", *names, "nis_right"]
        assert np.isnan(table.loc["nis_right", "reference"])


def test_a_row_for_each_stride_of_the_reference(twenty):
    item = walk(3)
    rows = twenty.strides[twenty.strides["recording"] == "walk_003"]
    valid = np.flatnonzero(item.reference.strides.valid)
    assert list(rows["s_id"]) == list(range(valid.size))
    assert list(rows["side"]) == ["left" if i % 2 else "right" for i in valid]
    np.testing.assert_allclose(rows["start"], item.reference.strides.start[valid])
    distance = alone(item).distance
    gained = [np.interp([s, s + 1.0], item.reference.time, distance) for s in rows["start"]]
    np.testing.assert_allclose(rows["estimate"], np.diff(gained, axis=1)[:, 0], rtol=1e-12)
    np.testing.assert_allclose(rows["rel_error"], rows["estimate"] - 1.0, rtol=1e-12)
    assert set(rows["quantity"]) == {"stride_length_m"}


def test_strides_of_an_estimate_go_with_those_of_the_same_foot_and_time():
    def strides(start, side, length):
        start, zero = np.asarray(start, float), np.zeros(len(start))
        return Strides(np.asarray(side, int), start, start + 0.6, start + 1.0, np.asarray(length, float), zero, zero,
                       np.ones(len(start), bool))  # fmt: skip

    time = np.arange(0.0, 6.0, 0.01)
    reference = Estimate(time, Legs(None, None), None, None, time >= 0.0, {},
                         strides([3.0, 0.0, 0.5, 1.0, 2.0], [0, 0, 1, 0, 0], [4, 1, 2, 3, 5]))  # fmt: skip
    # Late by a tenth; a left one too many, a right one is missing.
    ours = strides([0.1, 0.52, 1.02, 2.6, 2.95], [0, 1, 0, 1, 0], [1.5, 2.5, 3.5, 9, 4.5])
    rows = pd.DataFrame(scores.stride_rows(reference._replace(strides=ours), reference))
    length = rows[rows["quantity"] == "stride_length_m"]
    np.testing.assert_allclose(length["estimate"], [1.5, 2.5, 3.5, np.nan, 4.5])
    np.testing.assert_allclose(length["reference"], [1, 2, 3, 5, 4])
    assert set(rows["quantity"]) == {"stride_length_m", "stride_duration_s", "stride_width_m", "stride_height_m"}
    none = scores.stride_rows(reference._replace(strides=strides([], [], [])), reference)
    assert np.isnan(none["estimate"]).all() and len(none["estimate"]) == 5


def foot_strides(count, **more):
    """Strides of the right foot, a second each; the first contact half a second before the first standing."""
    at = np.arange(float(count))
    nothing = np.full(count, np.nan)
    return Strides(np.zeros(count, int), at, at + 0.6, at + 1.0, 1.0 + 0.01 * at, nothing, nothing,
                   np.ones(count, bool), standing=at + 0.4, standing_end=at + 1.4, **more)  # fmt: skip


def test_only_values_of_a_stride_that_both_have_are_compared():
    time = np.arange(0.0, 9.0, 0.01)
    bare = Estimate(time, Legs(None, None), None, None, time >= 0.0, {})
    spread = np.array([0.02, 0.02, 0.02, 0.0, 0.02])
    ours = foot_strides(5, speed=np.full(5, 1.5), contact_angle=np.full(5, 0.3), step_length=np.full(5, np.nan))
    stated = ours._replace(start=None, final_contact=None, end=None, length=spread, speed=np.full(5, 0.1))
    errors = np.array([0.0, 0.039, -0.041, 0.0, 0.1])
    # a source of footprints: when the foot stood, and no contacts; the third is no stride
    theirs = foot_strides(5, speed=np.full(5, 1.2), push_off_angle=np.full(5, -1.0), step_length=np.full(5, 0.6))
    theirs = theirs._replace(start=None, final_contact=None, end=None, length=ours.length - errors)
    theirs = theirs._replace(valid=np.array([True, True, True, True, False]))
    known = bare._replace(strides=theirs)
    estimate = bare._replace(strides=ours, strides_stddev=stated)
    rows = pd.DataFrame(scores.stride_rows(estimate, known))
    assert list(rows["quantity"].unique()) == ["stride_length_m", "walking_speed_mps"]
    length = rows[rows["quantity"] == "stride_length_m"]
    np.testing.assert_allclose(length["estimate"] - length["reference"], errors[:4], atol=1e-12)
    np.testing.assert_allclose(length["start"], theirs.standing[:4])
    told = scores.score(estimate, Walk(walk(1).recording, known, {})).quantities
    # of those that state one: 0 and 0.039 are within 2 × 0.02, −0.041 is not
    assert told["stride_length_within_2sd_percent"] == pytest.approx((200.0 / 3.0, 95.45), abs=1e-3)
    assert told["walking_speed_within_2sd_percent"][0] == 0.0
    doubtful = estimate._replace(diagnostics={"doubtful": np.arange(5) == 1})
    kept = pd.DataFrame(scores.stride_rows(doubtful, known)).groupby("s_id")["regular"].all()
    assert list(kept) == [True, False, True, True]


def test_feet_are_scored_where_both_have_them():
    time = np.arange(0.0, 4.0, 0.01)
    place = np.stack([time, np.sin(time), 0.0 * time], axis=1)
    foot = FootTrajectory(place, None, None)
    bare = Estimate(time, Legs(None, None), None, time, time >= 0.0, {})
    estimate = bare._replace(feet=Feet(foot, FootTrajectory(place + 0.03 * np.sign(time - 2.0)[:, None], None, None)))
    told = scores.score(estimate, Walk(walk(1).recording, bare._replace(feet=Feet(foot, foot)), {})).quantities
    assert told["foot_rmse_cm_right"] == pytest.approx((0.0, 0.0), abs=1e-9)
    assert told["foot_height_rmse_cm_left"][0] == pytest.approx(3.0, rel=1e-2)
    assert 0.1 < told["foot_rmse_cm_left"][0] < 4.3
    told = scores.score(estimate, Walk(walk(1).recording, bare._replace(feet=Feet(None, foot)), {})).quantities
    assert "foot_rmse_cm_right" not in told and "foot_rmse_cm_left" in told


def test_no_length_of_a_stride_whose_way_is_not_as_long():
    # A hip goes less far than the foot in the first stride, and farther in the last, which closes up.
    zero, ones = np.zeros(4), np.ones(4, bool)
    starts = np.array([0.5, 1.0, 2.0, 3.0])
    known = Strides(np.array([0, 0, 1, 0]), starts, starts + 0.5, starts + 1.0, np.array([2.0, 1.05, 0.98, 0.6]), zero,
                    zero, ones)  # fmt: skip
    time = np.arange(0.0, 6.0, 0.01)
    reference = Estimate(time, Legs(None, None), None, 1.0 * time, time >= 0.0, {}, known)
    estimate = reference._replace(strides=None, distance=1.3 * time)
    rows = scores.stride_rows(estimate, reference)
    np.testing.assert_allclose(rows["estimate"], [np.nan, 1.3, 1.3, np.nan], rtol=1e-12)
    # Where nothing is known of the way, strides that are short or come from standing are left out.
    unknown = reference._replace(distance=None)
    np.testing.assert_allclose(scores.stride_rows(estimate, unknown)["estimate"], [1.3, 1.3, 1.3, np.nan], rtol=1e-12)
    from_standing = unknown._replace(strides=known._replace(final_contact=np.where(np.arange(4) == 0, starts, np.inf)))
    assert np.isnan(scores.stride_rows(estimate, from_standing)["estimate"][[0, 3]]).all()


@pytest.fixture
def short(monkeypatch):
    """Padded lengths so short that the walks have several."""
    monkeypatch.setattr(buckets, "padded_length", lambda samples: -(-samples // 256) * 256)


def test_one_program_a_bucket(short):
    TRACED.clear()
    buckets.program.cache_clear()
    evaluate.cohort(FAKE, [walk(i) for i in range(40)], batch=4)
    wanted = {(buckets.padded_length(walk(i).reference.time.size), i % 7 == 0) for i in range(40)}
    assert len(wanted) > 4
    assert sorted(TRACED) == sorted(wanted)
    evaluate.cohort(FAKE, [walk(i) for i in range(40, 60)], batch=4)
    assert len(TRACED) == len(set(TRACED))


def test_what_fails_is_named_and_costs_nobody_else():
    def score(estimate, item):
        if item.info["number"] == 5:
            raise KeyError("thigh")
        return scores.score(estimate, item)

    bad = {2: "nan", 3: "blind", 4: "misplaced"}
    mixed = evaluate.cohort(FAKE, range(15), read=lambda i: walk(i, bad[i]) if i in bad else read(i), score=score,
                            batch=4)  # fmt: skip
    reasons = mixed.failures.set_index("recording")["reason"]
    assert sorted(reasons.index) == ["13", "2", "3", "4", "5"]
    assert reasons["13"] == "no such file: 13"
    assert reasons["2"].startswith("distance of the estimate is not finite at ")
    assert reasons["3"] == "the estimate is valid at no sample"
    assert reasons["4"] == "needs 'foot_right'; the recording has ['waist']"
    assert reasons["5"] == "score: KeyError: 'thigh'"
    assert dict(zip(mixed.failures["recording"], mixed.failures["subject"], strict=True))["3"] == "003"
    well = evaluate.cohort(FAKE, [i for i in range(15) if i not in (2, 3, 4, 5, 13)], read=read, batch=4)
    for name in ("recordings", "quantities", "strides"):
        one, two = getattr(mixed, name), getattr(well, name)
        pd.testing.assert_frame_equal(one, two, rtol=1e-12)
    only = evaluate.cohort(FAKE, [13], read=read)
    assert len(only.failures) == 1 and only.recordings.empty and only.strides.empty


def test_people_have_their_own_parameters():
    items = [walk(i) for i in range(6)]
    each = evaluate.cohort(FAKE, items, lambda item: Params(1.0 + 0.1 * item.info["number"], 0.0), batch=4)
    measured = evaluate.cohort(FAKE, items, body=lambda item: {"offset": item.reference.diagnostics["offset"]}, batch=4)
    for i in range(6):
        distance = each.quantities.query(f"recording == 'walk_{i:03d}' and quantity == 'distance_m'")
        assert distance["rel_error"].iloc[0] == pytest.approx(0.1 * i, abs=1e-9)
        hip = measured.quantities.query(f"recording == 'walk_{i:03d}' and quantity == 'hip_rmse_deg_right'")
        assert hip["estimate"].iloc[0] == pytest.approx(np.degrees(1.0 if i == 0 else 0.5))
    wrong = evaluate.cohort(FAKE, items, lambda item: Params(float(item.info["number"])), batch=4)
    assert list(wrong.failures["recording"]) == ["walk_000"]
    assert "'scale' must lie in (0, inf)" in wrong.failures["reason"][0]


def test_a_missing_package_is_not_the_recordings_fault_and_only_a_few_batches_are_held():
    def needs(item):
        raise ModuleNotFoundError("no module named ezc3d")

    with pytest.raises(ModuleNotFoundError, match="ezc3d"):
        evaluate.cohort(FAKE, [1, 2], read=needs)
    held: list[weakref.ref] = []
    peak = 0

    def load(number):
        nonlocal peak
        made = walk(number)
        gc.collect(0)
        held.append(weakref.ref(made.reference.distance))
        peak = max(peak, sum(ref() is not None for ref in held))
        return made

    assert len(evaluate.cohort(FAKE, range(200), read=load, batch=8).recordings) == 200
    assert peak <= (3 + 4) * 8  # waiting for their buckets, in the queue, computing, and being scored


class Killed(BaseException):
    """As a signal: no handler for exceptions of a recording catches it."""


@pytest.mark.parametrize("where", ["read", "score", "append"])
def test_a_killed_run_goes_on_and_ends_the_same(tmp_path, monkeypatch, where):
    whole = evaluate.cohort(FAKE, range(30), read=read, batch=4)
    rng = np.random.default_rng(len(where))
    state, kills = {"fuse": 0, "reads": 0}, 0  # a list or a dictionary that a function keeps is no setting

    def burn(place):
        state["fuse"] -= place == where
        if place == where and state["fuse"] == 0:
            raise Killed

    def load(item):
        state["reads"] += 1
        burn("read")
        return read(item)

    def judge(estimate, item):
        burn("score")
        return scores.score(estimate, item)

    write = store._write

    def written(path, text):
        if path.suffix == ".csv":
            burn("append")
            path.write_text(text[: len(text) // 2])
        write(path, text)

    def run():
        return evaluate.cohort(FAKE, range(30), read=load, score=judge, out=tmp_path / "run", batch=4)

    monkeypatch.setattr("jgait.evaluate.store._write", written)
    result = None
    while result is None:
        # A run killed before a batch is finished gets nowhere.
        state["fuse"] = int(rng.integers(12, 20) if where == "read" else rng.integers(2, 14))
        try:
            result = run()
        except Killed:
            kills += 1
    assert 2 <= kills < 100
    same(result, whole)
    state |= {"fuse": 0, "reads": 0}
    same(run(), whole)
    assert state["reads"] == 0


def test_results_on_disk_are_those_in_memory(tmp_path, twenty):
    seen = []
    items = [walk(i) for i in range(20)]
    stored = evaluate.cohort(FAKE, items, out=tmp_path, batch=4, progress=lambda *n: seen.append(n))
    same(stored, twenty)
    assert seen[-1] == (20, 0) and len(seen) >= 5
    # More of the same cohort, in other batches: only the new ones are run.
    more = evaluate.cohort(FAKE, [*items, walk(20)], out=tmp_path, batch=2, progress=lambda *n: seen.append(n))
    assert seen[-1] == (1, 0)
    assert list(more.recordings["recording"])[:-1] == list(twenty.recordings["recording"])


def test_names_that_look_like_something_else_survive(tmp_path):
    item = walk(0)
    names = ["NA", "", "007", 'a,"b"\nc', "1e5"]
    items = [item._replace(recording=item.recording._replace(name=n, subject=n, notes=(note(n),))) for n in names]
    stored = evaluate.cohort(FAKE, items, out=tmp_path)
    same(stored, evaluate.cohort(FAKE, items))
    assert sorted(stored.recordings["subject"]) == sorted(names)


def test_a_folder_of_something_else_is_refused(tmp_path):
    evaluate.cohort(FAKE, [walk(0)], out=tmp_path / "a")
    assert json.loads((tmp_path / "a" / "cohort.json").read_text())["estimator"] == "fake"
    with pytest.raises(ValueError, match=r'differs in the parameters .*"scale": 1.1.*"scale": 2.0'):
        evaluate.cohort(FAKE, [walk(0)], Params(2.0), out=tmp_path / "a")
    with pytest.raises(ValueError, match=r"differs in the comparison with the reference"):
        evaluate.cohort(FAKE, [walk(0)], score=lambda e, w: scores.score(e, w), out=tmp_path / "a")
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "data.csv").write_text("mine")
    with pytest.raises(ValueError, match=r"out must be empty or hold a cohort; .*b holds data.csv"):
        evaluate.cohort(FAKE, [walk(0)], out=tmp_path / "b")
    (tmp_path / "a" / ".0-part-0-000009").mkdir()
    Folder(tmp_path / "a", json.loads((tmp_path / "a" / "cohort.json").read_text()))
    assert not (tmp_path / "a" / ".0-part-0-000009").exists()


def test_strides_of_a_reference_in_another_unit_or_that_are_steps_are_named():
    time = np.arange(0.0, 12.0, 0.01)
    bare = Estimate(time, Legs(None, None), None, None, time >= 0.0, {})
    strides = foot_strides(8)
    true = np.asarray(strides.length)

    def found(ours, theirs, estimate=bare, way=None):
        walked = Walk(walk(1).recording, bare._replace(strides=strides._replace(length=theirs), distance=way), {})
        estimate = estimate._replace(strides=None if ours is None else strides._replace(length=ours))
        made = scores.score(estimate, walked)
        return [note.code for note in made.notes], [quantity for quantity, _ in made.contradicts]

    off = ["reference_strides_off"]
    assert found(1.05 * true, 0.5 * true) == (off, []) and found(true, 2.6 * true) == (off, ["stride_length_m"])
    assert found(true, true) == found(1.6 * true, true) == ([], [])
    way = bare._replace(distance=time)
    assert found(None, np.full(8, 0.5), way) == (off, []) and found(None, np.ones(8), way) == ([], [])
    assert found(None, np.full(8, 0.5), way, time) == (off, [])  # no stride is as long as the distance


def test_the_agreement_has_regular_strides_beside_all(twenty):
    rows = twenty.strides.assign(regular=twenty.strides["s_id"] > 1)
    found = twenty._replace(strides=rows).agreement(resamples=20)
    kept = rows[rows["regular"]]
    both = found.loc[["stride_length_m", "regular_stride_length_m"]]
    assert list(both["n"]) == [rows["estimate"].count(), kept["estimate"].count()] and both["n"].is_monotonic_decreasing
    assert list(both["bias"]) == pytest.approx([rows["error"].mean(), kept["error"].mean()])
    assert list(found.index).index("regular_stride_length_m") == list(found.index).index("stride_length_m") + 1
    for regular in (False, True):  # the rows would be empty, or say the same
        one = twenty._replace(strides=rows.assign(regular=regular)).agreement(resamples=20)
        assert "regular_stride_length_m" not in one.index and one.loc["stride_length_m", "n"] == len(rows)
    assert list(twenty._replace(strides=rows.head(0)).agreement(resamples=20).index) == [
        "distance_m", "hip_rmse_deg_right", "knee_rmse_deg_right", "x_rmse_cm_right", "y_rmse_cm_right"
    ]  # fmt: skip


def test_tables_over_subjects_and_agreement(twenty):
    table = twenty.by_subject()
    mine = twenty.quantities.query("subject == '001' and quantity == 'distance_m'")
    row = table.query("subject == '001' and quantity == 'distance_m'").iloc[0]
    assert row["n"] == len(mine) == 5
    np.testing.assert_allclose(row[ERRORS].astype(float), mine[ERRORS].mean(), rtol=1e-12)
    found = twenty.agreement(resamples=50)
    assert found.loc["distance_m", "n"] == 20 and found.loc["stride_length_m", "n"] == len(twenty.strides)
    hips = twenty.quantities.query("quantity == 'hip_rmse_deg_right'")["estimate"]
    assert found.loc["hip_rmse_deg_right", "bias"] == pytest.approx(hips.mean())
    named = [walk(i)._replace(reference=None) for i in (1, 2, 3)]
    named = [one._replace(recording=one.recording._replace(subject=name))
             for one, name in zip(named, ("Anna", "anna ", "Ben"), strict=True)]  # fmt: skip
    bare = evaluate.cohort(FAKE, named)
    assert list(bare.recordings["subject"]) == ["Anna", "Anna", "Ben"]
    assert bare.quantities["error"].isna().all() and bare.strides.empty and bare.by_subject().empty


@pytest.mark.usefixtures("unchecked")
def test_refusals_state_what_was_wrong():
    with pytest.raises(ValueError, match="item 2 is a second 'walk_001'"):
        evaluate.cohort(FAKE, [walk(1), walk(2), walk(1)])
    with pytest.raises(TypeError, match="items must be walks, .* or come with read=; item 0 is str"):
        evaluate.cohort(FAKE, ["a.csv"])
    with pytest.raises(ValueError, match="batch must be at least 1"):
        evaluate.cohort(FAKE, [], batch=0)
    with pytest.raises(ValueError, match=r"'scale' must lie in \(0, inf\); got -1"):
        evaluate.cohort(FAKE, [], Params(-1.0))
    with pytest.raises(ValueError, match="one axis"):
        buckets.checked_mesh(jax.make_mesh((1, 1), ("a", "b"), axis_types=(jax.sharding.AxisType.Auto,) * 2))
    assert evaluate.cohort(FAKE, []).recordings.empty
    broken = FAKE._replace(run=lambda p, inputs, options: run(p, inputs.missing, options))
    with pytest.raises(AttributeError, match="missing") as caught:
        evaluate.cohort(broken, [walk(1)])
    assert "in a batch of 1 recordings from 'walk_001'" in caught.value.__notes__


def test_an_estimate_may_be_finished_on_other_samples_and_with_further_notes():
    told = Kind("told", "check", "the distance is told", "About this test.")

    def finish(result, made):
        assert result.time.dtype == np.float64
        size, notes = result.time.size, (*result.diagnostics["notes"], told())
        twice = jax.tree.map(
            lambda leaf: np.repeat(leaf, 2, axis=0) if np.shape(leaf)[:1] == (size,) else leaf,
            result._replace(diagnostics={}),
        )
        time = np.linspace(result.time[0], result.time[-1], 2 * size)
        return twice._replace(
            time=time, distance=2.0 * twice.distance, diagnostics=result.diagnostics | {"notes": notes}
        )

    plain, finished = (evaluate.cohort(one, [walk(2)]) for one in (FAKE, FAKE._replace(finish=finish)))
    once, twice = (one.quantities.set_index("quantity")["estimate"]["distance_m"] for one in (plain, finished))
    assert twice == pytest.approx(2.0 * once, rel=1e-3)
    assert "told" in [note.code for note in from_json(finished.recordings["notes"][0])]
