"""A whole cohort on the command line: bad rows, runs that go on, and parameters from one command to another."""

import importlib
import json
import re

import jax
import numpy as np
import pandas as pd
import pytest
from made.command import run
from made.notes import note

from experiments.common import protocols
from jgait import io
from jgait.commands import references, tune_run
from jgait.commands.rows import CONTENT, COPIED
from jgait.estimators import leg_ekf

RIGHT = ("thigh_right", "shank_right")
"""One leg: its programs are half as large."""


@pytest.fixture(scope="module")
def walks(tmp_path_factory):
    """A folder of four simulated walks of two people as a user's files, and the rows of their table."""
    folder = tmp_path_factory.mktemp("cohort")
    rows = []
    for number, one in enumerate(protocols.bennett(jax.random.key(7), 4, placements=RIGHT)):
        name = f"walk{number}.csv"
        io.recording_to_dataframe(one.recording).to_csv(folder / name)
        io.write_csv(one.truth.estimate, folder / f"samples{number}.csv")
        io.write_csv(io.strides_to_dataframe(one.truth.estimate), folder / f"strides{number}.csv")
        known = one.truth.estimate.diagnostics
        rows.append({
            "file": name, "subject": f"p{number // 2}", "thigh_length_m": float(known["thigh_length"]),
            "shank_length_m": float(known["shank_length"]), "distance_m": one.extra["distance"],
        })  # fmt: skip
    return folder, rows


@pytest.fixture
def table(walks):
    folder, rows = walks

    def write(change=None, name="cohort.csv", sep=","):
        frame = pd.DataFrame(rows)
        (frame if change is None else change(frame)).to_csv(folder / name, index=False, sep=sep)
        return folder / name

    return write


def with_bad_rows(frame):
    more = pd.DataFrame([
        {"file": "nowhere.csv", "subject": "p8"}, {"file": "walk0.csv", "subject": "p8"}, {"file": "", "subject": "p8"},
        {"file": "empty.csv", "subject": "p8"}, {"file": "copy.csv", "subject": "p9", "thigh_length_m": "40 cm"},
    ])  # fmt: skip
    return pd.concat([frame.astype(object), more.astype(object)])


@pytest.fixture(scope="module")
def evaluated(walks, tmp_path_factory):
    """One evaluation of the good and the bad rows: exit code, output, folder, table."""
    folder, rows = walks
    (folder / "empty.csv").write_text("")
    (folder / "copy.csv").write_bytes((folder / "walk0.csv").read_bytes())
    table = folder / "bad.csv"
    with_bad_rows(pd.DataFrame(rows)).to_csv(table, index=False, sep=";")
    out = tmp_path_factory.mktemp("evaluated") / "out"
    code, said = run("evaluate", table, "--paper", "--out", out, "--json", out.parent / "numbers.json")
    return code, said, out, table


def test_bad_rows_are_named_and_the_others_evaluated(evaluated):
    code, said, out, _ = evaluated
    assert code == 1, said
    for words in (
        "nowhere.csv: there is no such file", "line 7: walk0.csv is listed twice", "line 8: it names no file",
        "empty.csv is empty", "thigh_length_m must be between 0.2 and 0.7 m", "5 of 9 recordings could not be used",
        "4 recordings of 2 people",
    ):  # fmt: skip
        assert words in said, said
    failures = pd.read_csv(out / "failures.csv").set_index("recording")["subject"]
    assert len(failures) == 5 and failures["empty.csv"] == failures["nowhere.csv"] == "p8"
    assert sorted(pd.read_csv(out / "recordings.csv")["subject"]) == ["p0", "p0", "p1", "p1"]
    notes = json.loads((out / "notes.json").read_text())
    for name, text in pd.read_csv(out / "recordings.csv").set_index("recording")["notes"].items():
        assert [one for one in notes if one["recording"] == name] == [
            {"recording": name, **n} for n in json.loads(text)
        ]
    assert any(one["recording"] == "walk0.csv" for one in notes)
    assert (out / "distance_agreement.png").exists() and (out / "distance_per_subject.png").exists()


def test_a_person_has_one_name_however_the_table_writes_it(table):
    from jgait.commands import cohort

    written = table(lambda frame: frame.assign(subject=["Anna", "anna ", "1", " ANNA"]), "names.csv")
    found = cohort.source(written, None, None, 0, None, None, ())
    assert list(found.subjects.values()) == ["Anna", "Anna", "1", "Anna"]
    assert found.read("walk1.csv").recording.subject == "Anna"


def test_the_agreement_is_that_of_the_estimator(evaluated, walks):
    _, _, out, _ = evaluated
    folder, rows = walks
    written = pd.read_csv(out / "quantities.csv").set_index(["quantity", "recording"]).loc["distance_m"]
    for row in rows:
        p = leg_ekf.with_body(
            leg_ekf.LegParams(), {"thigh_length": row["thigh_length_m"], "shank_length": row["shank_length_m"]}
        )
        alone = leg_ekf.estimate(p, io.read_csv(folder / row["file"]), leg_ekf.PAPER)
        way = np.asarray(alone.distance)
        assert written.loc[row["file"], "estimate"] == pytest.approx(way[-1] - way[0], rel=1e-9)
        assert written.loc[row["file"], "reference"] == pytest.approx(row["distance_m"], rel=1e-12)
    numbers = json.loads((out.parent / "numbers.json").read_text())["agreement"]["distance_m"]
    errors = written["estimate"] - written["reference"]
    assert numbers["bias"] == pytest.approx(errors.mean(), rel=1e-9)
    assert numbers["n"] == 4 and numbers["n_subjects"] == 2


def test_references_in_files_are_compared(table, walks, tmp_path):
    with_files = table(lambda frame: frame.drop(columns="distance_m").assign(
        reference_samples=["samples0.csv", "samples1.csv", "samples2.csv", "nowhere.csv"],
        reference_strides=["strides0.csv", "", "strides2.csv", ""],
    ), "references.csv")  # fmt: skip
    code, said = run("evaluate", with_files, "--out", tmp_path / "out")
    assert code == 1 and "there is no such file" in said, said
    found = pd.read_csv(tmp_path / "out" / "quantities.csv").set_index(["quantity", "recording"])["estimate"]
    assert set(found["knee_rmse_deg_right"].index) == {"walk0.csv", "walk1.csv", "walk2.csv"}
    assert (found["knee_rmse_deg_right"] < 8.0).all()
    assert set(pd.read_csv(tmp_path / "out" / "strides.csv")["recording"]) == {"walk0.csv", "walk2.csv"}
    numbers = found["knee_rmse_deg_right"].loc["walk0.csv"]
    late = pd.read_csv(walks[0] / "walk0.csv")  # a file whose times do not begin with 0, and its reference with ;
    late["time"] += 6.0
    late.to_csv(walks[0] / "late.csv", index=False)
    truth = pd.read_csv(walks[0] / "samples0.csv").drop(columns="distance_m")
    truth.assign(time_s=truth["time_s"] + 6.0).to_csv(walks[0] / "late_samples.csv", index=False, sep=";")
    again = table(
        lambda frame: frame.iloc[:1].assign(file="late.csv", reference_samples="late_samples.csv"), "late0.csv"
    )
    code, said = run("evaluate", again, "--out", tmp_path / "late")
    assert code == 0 and "distance_m of the table is not used" in said, said
    shifted = pd.read_csv(tmp_path / "late" / "quantities.csv").set_index("quantity")["estimate"]
    assert shifted["knee_rmse_deg_right"] == pytest.approx(numbers, rel=1e-2)  # six seconds off: twice as large
    samples = io.reference_from_tables(np.arange(0.0, 3.0, 0.01), pd.read_csv(walks[0] / "samples0.csv"))
    assert samples.legs.right is not None


def test_a_distance_that_contradicts_the_samples_is_noted(walks):
    folder, rows = walks
    recording, way, file = io.read_csv(folder / "walk0.csv"), rows[0]["distance_m"], folder / "samples0.csv"

    def codes(stated, file=file):
        walk = references.with_reference(recording, stated, [file, None], {})
        assert np.nanmax(walk.reference.distance) == pytest.approx(way, rel=0.05)  # that of the file, in any case
        return [note.text for note in walk.recording.notes if note.code == "reference_distance_contradicted"]

    assert codes(way) == codes(1.05 * way) == codes(None) == []
    (text,) = codes(10.0 * way)
    assert text.startswith(f"distance_m of the table, {10 * way:.4g} m, is not used: samples0.csv has ")
    assert len(codes(0.1 * way)) == 1
    half = pd.read_csv(file)
    half.assign(distance_m=half["distance_m"].where(half.index != len(half) // 2, 1.05 * way)).to_csv(
        folder / "sways.csv", index=False
    )
    (text,) = codes(10.0 * way, folder / "sways.csv")
    assert text.endswith(f" has {half['distance_m'].iloc[-1] - half['distance_m'].iloc[0]:.4g} m")
    half.iloc[len(half) // 2 :].to_csv(folder / "half.csv", index=False)
    assert codes(way, folder / "half.csv") == [] and len(codes(0.1 * way, folder / "half.csv")) == 1


def test_tuning_names_references_that_evaluate_names(table, walks, tmp_path):
    truth = pd.read_csv(walks[0] / "samples0.csv")
    truth.assign(time_s=truth["time_s"] - 0.5).to_csv(walks[0] / "early.csv", index=False)
    early = table(lambda frame: frame.head(2).assign(reference_samples=["early.csv", "samples1.csv"]), "early0.csv")
    warned = "check, 1 recording, such as walk0.csv: the knee's angles of the reference agree with the estimate if "
    words = ("--free", "distance_scale", "--steps", 1, "--no-cross-validation")
    for command, more in (("evaluate", ()), ("tune", words)):
        code, said = run(command, early, "--paper", *more, "--out", tmp_path / command)
        assert code == 0 and f"{warned}the reference is 0.50 s later" in said, said
    assert said.index(warned) < said.index("learning from all people")


def test_losses_are_empty_where_a_reference_cannot_answer_them(table, tmp_path, monkeypatch):
    with_files = table(lambda frame: frame.drop(columns="distance_m").assign(
        reference_samples=["samples0.csv", "samples1.csv", "", "samples3.csv"],
        reference_strides=["strides0.csv", "", "strides2.csv", "strides3.csv"],
    ), "partial.csv")  # fmt: skip
    out, prepared = tmp_path / "out", []
    module = importlib.import_module("jgait.estimators.leg_ekf.estimator")
    prepare = module.prepare

    def prepare_noted(recording, *a, **k):
        prepared.append(recording.name)
        made = prepare(recording, *a, **k)
        grave = (note("nobody walks", "stop"),) if recording.name == "walk3.csv" else ()
        return made._replace(notes=(*made.notes, *grave))

    monkeypatch.setattr(module, "prepare", prepare_noted)
    code, said = run(
        "evaluate", with_files, "--paper", "--loss", "stride_length,joint_angles,calibration", "--out", out
    )
    assert code == 0, said
    assert sorted(prepared) == sorted(2 * ["walk0.csv", "walk1.csv", "walk2.csv", "walk3.csv"])  # once for all losses
    losses = pd.read_csv(out / "losses.csv").set_index("recording")
    empty = losses.isna()
    assert list(empty.index[empty["stride_length"]]) == ["walk1.csv"]
    assert list(empty.index[empty["joint_angles"]]) == ["walk2.csv"]
    assert "1 of 4 recordings is in none of these errors" in said  # walk3.csv, whose losses are written all the same
    assert losses["stride_length"].count() == 3 and re.search(r"stride_length │ [^│]* │ 2 │", said)
    assert "walk1.csv: stride_length needs a reference with strides with length" in said
    strides = pd.read_csv(out / "strides.csv").dropna().set_index("recording")["error"]
    assert losses.loc["walk0.csv", "stride_length"] == pytest.approx(
        100.0 * np.sqrt((strides.loc["walk0.csv"] ** 2).mean()), rel=0.05
    )
    assert "strides of the reference are not compared; the body's way" in said
    code, said = run("evaluate", table(), "--paper", "--loss", "joint_angles,distance", "--out", tmp_path / "some")
    assert "joint_angles needs a reference with legs; no reference of cohort.csv has that" in said
    assert list(pd.read_csv(tmp_path / "some" / "losses.csv")) == ["recording", "subject", "distance"]
    strides = table(lambda frame: frame.head(2).drop(columns="distance_m").assign(
        reference_strides=["strides0.csv", "strides1.csv"]), "strides.csv")  # fmt: skip
    code, said = run("evaluate", strides, "--paper", "--loss", "calibration", "--out", tmp_path / "none")
    assert code == 0 and "--loss: nothing of the reference has a deviation that the estimate states" in said


def test_a_run_goes_on_and_refuses_changed_rows(evaluated):
    _, first, out, table = evaluated
    before = (out / "quantities.csv").read_bytes()
    code, said = run("evaluate", table, "--paper", "--out", out)
    assert code == 1
    assert "continuing an earlier run" in said and "continuing" not in first
    assert (out / "quantities.csv").read_bytes() == before
    changed = table.with_name("changed.csv")
    changed.write_text(table.read_text().replace("p1", "p2"))
    code, said = run("evaluate", changed, "--paper", "--out", out)
    assert code == 2
    assert "walk2.csv was" in said and "--fresh" in said
    code, said = run("evaluate", table, "--out", out)
    assert code == 2
    assert "another evaluation, which differs in the estimator's options;" in said and "--fresh" in said
    code, said = run("evaluate", table, "--paper", "--out", out, "--acc-unit", "g")
    assert code == 2
    assert "accelerations in the unit of the file; now " in said and "continuing" not in said


def test_a_cohort_in_which_nothing_can_be_used_leaves_nothing(table, tmp_path):
    cohort = table(lambda f: f.assign(file=[f"no{i}.csv" for i in range(4)]), "none.csv")
    for unit in ((), ("--acc-unit", "g")):
        code, said = run("evaluate", cohort, "--out", tmp_path / "out", *unit)
        assert code == 2
        assert "none of the 4 recordings" in said and "continuing" not in said
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((), "give one of: a table COHORT.csv, --dataset NAME, --simulated N; got none"),
        (("--simulated", 2, "--dataset", "walking5m"), "got --dataset and --simulated"),
        (("nowhere.csv",), "there is no such file: nowhere.csv"),
        (("--dataset", "mine"), "there is no data set 'mine'"),
        (("--simulated", 1, "--estimator", "mine"), "estimator must be one of leg_ekf"),
        (("--simulated", 1, "--params", "nowhere.json"), "--params: "),
        (("--simulated", 1, "--estimator", "stride_width_ekf"), "run jgait simulate --placements foot_right,foot_left"),
    ],
    ids=["nothing", "two", "no file", "no set", "no estimator", "no params", "no shoes"],
)
def test_bad_usage(words, expected, tmp_path):
    code, said = run("evaluate", *words, "--out", tmp_path / "out")
    assert code == 2
    assert expected in said
    assert not (tmp_path / "out").exists()


def test_tables_that_are_none(table, tmp_path):
    def said_of(change):
        code, said = run("evaluate", table(change, "odd.csv"), "--out", tmp_path)
        assert code == 2
        return said

    assert "did you mean 'files'?" in said_of(lambda f: f.rename(columns={"file": "files"}))
    assert "must have a header and a row for each recording" in said_of(lambda f: f.iloc[:0])


def test_what_may_not_have_been_meant_is_noted(table, tmp_path):
    def change(frame):
        return frame.rename(columns={"thigh_length_m": "thigh_lenght_m"}).drop(columns=["subject", "distance_m"])

    code, said = run("evaluate", table(change, "loose.csv"), "--paper", "--out", tmp_path / "out")
    assert code == 0, said
    for words in (
        "did you mean 'thigh_length_m'?", "every recording counts as another person",
        "4 of 4 recordings have no thigh_length_m", "4 of 4 recordings have no reference",
    ):  # fmt: skip
        assert words in said


def test_the_height_of_a_person_gives_lengths_that_were_not_measured(table, tmp_path):
    def by_height(frame):
        return frame.assign(height_m=1.8, shank_length_m=[0.4, *[""] * 3]).drop(columns="thigh_length_m")

    def by_length(frame):
        return frame.assign(thigh_length_m=0.245 * 1.8, shank_length_m=[0.4, *[0.246 * 1.8] * 3])

    ways = []
    for change in (by_height, by_length):
        code, said = run(
            "evaluate", table(change, f"{change.__name__}.csv"), "--paper", "--out", tmp_path / change.__name__
        )
        assert code == 0, said
        assert "left out" not in said and "have no" not in said
        ways.append(pd.read_csv(tmp_path / change.__name__ / "quantities.csv")["estimate"])
    pd.testing.assert_series_equal(*ways)


@pytest.fixture(scope="module")
def tuned(evaluated, tmp_path_factory):
    """A tuning on the same rows: exit code, output, folder, the words of the command."""
    out = tmp_path_factory.mktemp("tuned") / "out"
    words = ("tune", evaluated[3], "--free", "distance_scale", "--paper", "--steps", 60)
    words = (*words, "--out", out, "--json", out.parent / "numbers.json")
    code, said = run(*words)
    return code, said, out, words


def test_tuning_judges_people_that_it_never_saw(tuned, walks):
    code, said, out, _ = tuned
    assert code == 1, said
    for words in (
        "of people left out of the tuning", "p0", "p1", "2 better, 0 worse", "learned from all people",
        "5 of 9 recordings could not be used",
    ):  # fmt: skip
        assert words in said, said
    assert said.index("judging the people") < said.index("the data determine")
    names = {path.name for path in out.glob("[!.]*")}
    assert names == {"tuned.json", "training.png", "held_out.csv", "before_after.png", "fits"}
    held = pd.read_csv(out / "held_out.csv")
    assert sorted(held["recording"]) == [row["file"] for row in walks[1]]
    assert (held["error_after"] < held["error_before"]).all()
    told = json.loads((out / "tuned.json").read_text())["made"]["held_out"]
    people = held.groupby("subject")[["error_before", "error_after"]].mean().median()
    assert (told["n"], told["before"], told["after"]) == (2, *map(pytest.approx, people))
    (value,) = json.loads((out.parent / "numbers.json").read_text())["values"].values()
    assert value["stderr"] > 0.0 and value["low"] < value["after"] < value["high"]


def test_the_tuned_scale_is_the_one_of_least_squares(tuned, evaluated):
    rows = pd.read_csv(evaluated[2] / "quantities.csv").query("quantity == 'distance_m'")
    ratio = rows["estimate"] / rows["reference"]
    best = ratio.sum() / (ratio**2).sum()  # of Σ (scale · ratio − 1)²
    written = json.loads((tuned[2] / "tuned.json").read_text())
    assert written["parameters"]["distance_scale"]["value"] == pytest.approx(best, rel=1e-3)
    assert written["made"]["people"] == 2 and written["made"]["free"] == ["distance_scale"]
    assert written["parameters"]["angle_noise"] == {"value": 10.0, "unit": "rad²/s³"}


def test_tuned_parameters_name_the_data_by_their_hashes(tuned, walks):
    data = json.loads((tuned[2] / "tuned.json").read_text())["made"]["data"]
    assert sorted(data) == [row["file"] for row in walks[1]]
    assert len(set(data.values())) == len(data) and all(CONTENT.fullmatch(content) for content in data.values())


def test_a_tuning_that_was_finished_is_not_run_again(tuned):
    _, _, out, words = tuned
    before = (out / "tuned.json").read_bytes()
    code, said = run(*words)
    assert code == 1
    assert "continuing an earlier run" in said and "continuing" not in tuned[1]
    assert (out / "tuned.json").read_bytes() == before


def test_tuned_parameters_are_taken_by_the_other_commands(tuned, evaluated, walks, tmp_path):
    file = tuned[2] / "tuned.json"
    scale = json.loads(file.read_text())["parameters"]["distance_scale"]["value"]
    code, said = run(
        "evaluate", evaluated[3], "--paper", "--params", file, "--loss", "distance", "--out", tmp_path / "out"
    )
    assert code == 1, said
    assert said.count("of 6 recordings, 5 used there, so that errors on them are not held out") == 1
    rows = pd.read_csv(tmp_path / "out" / "quantities.csv").query("quantity == 'distance_m'").set_index("recording")
    errors = pd.read_csv(tmp_path / "out" / "losses.csv").set_index("recording")["distance"]
    percent = 100.0 * (rows["estimate"] / rows["reference"] - 1.0).abs()
    np.testing.assert_allclose(errors, percent[errors.index], rtol=1e-6)
    before, after = (
        pd.read_csv(folder / "quantities.csv").query("quantity == 'distance_m'")["estimate"].to_numpy()
        for folder in (evaluated[2], tmp_path / "out")
    )
    np.testing.assert_allclose(after, scale * before, rtol=1e-9)
    code, said = run("report", tmp_path / "out", "--out", tmp_path / "out.html", "--json", tmp_path / "page.json")
    assert code == 1, said
    flag = next(f for f in json.loads((tmp_path / "page.json").read_text())["flags"] if "not held out" in f["text"])
    assert flag["grade"] == "check" and "left out in turn, the median |error of the distance| was" in flag["text"]
    assert (tmp_path / "out.html").read_text().count("in tuned.json were tuned on bad.csv") >= 2
    walk = walks[0] / walks[1][0]["file"]
    ways = []
    for more in ((), ("--params", file), ("--params", file, "--option", "scale=1.0")):
        code, said = run("estimate", walk, "--estimator", "leg_ekf", "--paper", "--out", tmp_path / "one", *more)
        assert code == 0, said
        ways.append(pd.read_csv(tmp_path / "one" / f"{walk.stem}_legs.csv")["distance_m"].iloc[-1])
    assert ways[1] == pytest.approx(scale * ways[0], rel=1e-8)  # as written
    assert ways[2] == ways[0]


def hashes(table):
    """File → its content, of the recordings of a table."""
    from jgait.commands import cohort

    found = cohort.source(table, None, None, 0, None, None, ())
    return found.versions(found.marks)


def test_recordings_of_the_tuning_are_known_by_their_content_and_people_by_their_names(tuned, table, walks):
    from jgait.commands import cohort

    for number in (0, 3):
        frame = pd.read_csv(walks[0] / f"walk{number}.csv")
        frame.iloc[:-1].to_csv(walks[0] / f"other{number}.csv", index=False)
        frame.round(9 - 2 * number).to_csv(walks[0] / f"again{number}.csv", index=False)
    for files, people, expected in (
        (["again0.csv", "again3.csv"], ["p7", "p8"],
         "of 2 recordings, 2 used there, so that errors on them are not held out;"),
        (["walk0.csv", "other0.csv", "other3.csv"], ["p0", "p8", "P1"],
         "of 3 recordings, 1 used there and 1 of people with names used there, so that errors on them are not"),
        (["other0.csv", "other3.csv", "gone.csv"], ["p8", "p9", "p0"],
         "of 2 recordings, none is of that tuning;"),
    ):  # fmt: skip
        mine = table(lambda f, files=files, people=people: f.head(len(files)).assign(
            file=files, subject=people, reference_strides="strides0.csv"), "mine.csv")  # fmt: skip
        *_, note = cohort.source(mine, None, None, 0, None, None, (), tuned[2] / "tuned.json").notes
        assert f"the parameters in tuned.json were tuned on bad.csv: {expected}" in str(note)
        assert note.severity == ("info" if "none" in expected else "check")
    # Parameters that began with those of another tuning were tuned on its recordings, too.
    whole = json.loads((tuned[2] / "tuned.json").read_text())
    own = whole["made"]["data"]
    for data, held_out in (({"other3.csv": next(iter(hashes(mine).values()))}, True), (own, False)):
        whole["made"]["before"] = [{"cohort": "first.csv", "subjects": ["q0"], "data": data}]
        (walks[0] / "twice.json").write_text(json.dumps(whole))
        *_, note = cohort.source(mine, None, None, 0, None, None, (), walks[0] / "twice.json").notes
        assert "were tuned on bad.csv and first.csv: " in str(note)
        assert ("1 used there, so that errors on them are not held out" in str(note)) == held_out
        assert ("left out in turn" in str(note)) == held_out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--free", "scale"), "there is no parameter 'scale'; there are thigh_length.right"),
        (("--free", ","), "--free names nothing to learn"),
        (("--free", "distance_scale", "--loss", "speed"), "--loss: a loss is one of distance, trajectory"),
        (
            ("--free", "distance_scale", "--loss", "trajectory"),
            "trajectory needs a reference with legs; no reference of cohort.csv has that",
        ),
        (("--free", "distance_scale", "--loss", "position"), "leg_ekf cannot answer 'position'; it answers distance"),
        (("--free", "distance_scale", "--loss", "distance=-1"), "the weight of 'distance' must be a positive number"),
        (("--free", "distance_scale", "--folds", 3), "--folds must be between 2 and the 2 people; got 3"),
    ],
    ids=["unknown", "empty", "loss", "no angles", "not answered", "weight", "folds"],
)
def test_bad_tunings(table, words, expected, tmp_path):
    code, said = run("tune", table(), "--paper", *words, "--steps", 1, "--out", tmp_path / "out")
    assert code == 2
    assert expected in said and "compiling" not in said
    assert not (tmp_path / "out" / "tuned.json").exists()


def test_tuning_refuses_a_copy_before_it_compiles(table, walks, tmp_path):
    rounded = pd.read_csv(walks[0] / "walk0.csv").round(4)
    rounded.to_csv(walks[0] / "rounded.csv", index=False)
    twice = table(lambda f: pd.concat([f, f.head(1).assign(file="rounded.csv", subject="p9")]), "twice.csv")
    code, said = run("tune", twice, "--paper", "--free", "distance_scale", "--out", tmp_path / "out")
    copied = "rounded.csv and walk0.csv hold the same recording, with numbers rounded or written otherwise"
    assert code == 2 and f"{copied}. {COPIED.meaning}" in said and "compiling" not in said, said
    code, said = run("evaluate", twice, "--paper", "--out", tmp_path / "all")
    assert code == 0 and copied in said
    assert any(note["code"] == COPIED.code for note in json.loads((tmp_path / "all" / "notes.json").read_text()))


def test_tuning_refuses_references_that_contradict_all_estimates(table, tmp_path):
    feet = table(lambda frame: frame.assign(distance_m=frame["distance_m"].astype(float) * 100.0), "cm.csv")
    code, said = run("tune", feet, "--paper", "--free", "distance_scale", "--steps", 1, "--out", tmp_path / "out")
    assert code == 2 and "the references of all 4 recordings contradict the estimates, such as walk0.csv: the" in said
    assert "another unit" in said and "learning" not in said
    assert not (tmp_path / "out" / "tuned.json").exists()


def test_references_that_no_loss_compares_may_contradict_the_estimates(table, tmp_path, monkeypatch):
    def learned(*_):
        raise ValueError("it learns")

    monkeypatch.setattr(tune_run, "learned", learned)
    wrong = table(lambda frame: frame.assign(
        distance_m=frame["distance_m"].astype(float) * 100.0,
        reference_strides=[f"strides{i}.csv" for i in range(len(frame))]), "long.csv")  # fmt: skip
    words = ("tune", wrong, "--paper", "--free", "distance_scale", "--steps", 1, "--out", tmp_path / "out")
    for loss, expected in (("stride_length", "it learns"), ("stride_length,distance", "contradict the estimates")):
        code, said = run(*words, "--loss", loss, "--fresh")
        assert code == 2 and expected in said, said
        assert ("check, 4 recordings, such as walk0.csv: the reference says" in said) == (loss == "stride_length")


def test_tuning_says_that_no_recording_could_be_used(table, tmp_path):
    absent = table(lambda frame: frame.assign(file="nowhere.csv"), "absent.csv")
    code, said = run("tune", absent, "--paper", "--free", "distance_scale", "--out", tmp_path / "out")
    assert code == 2 and "can answer all" not in said, said


def test_losses_that_no_recording_answers_together_are_named(table, tmp_path):
    either = table(lambda frame: frame.head(3).assign(
        distance_m=["", 5.0, ""], reference_strides=["strides0.csv", "", ""]), "either.csv")  # fmt: skip
    words = ("--free", "distance_scale", "--loss", "stride_length,distance", "--out", tmp_path / "out")
    code, said = run("tune", either, "--paper", *words)
    assert code == 2 and "no recording of either.csv can answer all of stride_length, distance;" in said, said
    assert "stride_length needs a reference with strides with length: 2 have none;" in said
    assert "distance needs a reference with distance: 2 have none;" in said


def test_likelihood_needs_no_reference_and_one_person_no_cross_validation(table, tmp_path):
    lonely = table(lambda f: f.drop(columns="distance_m").assign(subject="me", day=["1", "", "2", ""]), "lonely.csv")
    words = ("tune", lonely, "--paper", "--free", "gyro_noise", "--loss", "likelihood", "--steps", 3)
    code, said = run(*words, "--out", tmp_path / "out")
    assert code == 0, said
    assert "it needs two people, or one person on two days that are known, and there is only a single person" in said
    assert "because the day of these recordings is not known: walk1.csv, walk3.csv" in said
    assert "1 number was learned from 1 person" in said
    assert "negative log-likelihood [nat] of the recordings learned from, median: " in said and " before, " in said
    assert "not determined" not in said
    assert not (tmp_path / "out" / "held_out.csv").exists()
    assert json.loads((tmp_path / "out" / "tuned.json").read_text())["parameters"]["gyro_noise"]["value"] != 1.0


def test_a_parameter_is_named_as_not_learned_or_as_not_determined(table, tmp_path, monkeypatch):
    lonely = table(lambda f: f.drop(columns="distance_m").assign(
        subject="me", reference_samples=[f"samples{i}.csv" for i in range(len(f))]).head(1), "flat.csv")  # fmt: skip
    words = ("tune", lonely, "--paper", "--free", "standing_knee,angle_noise", "--loss", "joint_angles", "--steps", 3)
    monkeypatch.setattr(tune_run, "HARDLY", 1e9)  # the loss hardly changes with anything
    code, said = run(*words, "--out", tmp_path / "out")
    assert code == 0, said
    assert "not learned: standing_knee.right, standing_knee.left;" in said and "not determined: angle_noise;" in said
    assert "RMS error of hip and knee angles [°] of the recordings" in said
    made = json.loads((tmp_path / "out" / "tuned.json").read_text())["made"]
    assert made["not_learned"] == ["standing_knee.right", "standing_knee.left"]
    assert made["not_determined"] == ["angle_noise"]


def test_days_of_one_person_are_left_out_in_turn(table, tmp_path):
    days = table(lambda f: f.assign(subject="me", day=[f"day {number % 2}" for number in range(len(f))]), "days.csv")
    words = ("tune", days, "--paper", "--free", "distance_scale", "--steps", 3, "--out", tmp_path / "out")
    code, said = run(*words)
    assert code == 0, said
    assert "of days left out of the tuning" in said
    held_out = pd.read_csv(tmp_path / "out" / "held_out.csv")
    assert set(held_out["day"]) == {"day 0", "day 1"} and set(held_out["subject"]) == {"me"}
    assert json.loads((tmp_path / "out" / "tuned.json").read_text())["made"]["left_out"] == "days"


def test_parameters_in_a_file(tmp_path):
    p = leg_ekf.LegParams(angle_noise=3.0, thigh_length=leg_ekf.BySide(0.4, 0.41))
    file = io.write_params(tmp_path / "p.json", p, estimator="leg_ekf", stderr={"angle_noise": 0.5}, made={"by": "me"})
    assert io.read_params(file, leg_ekf.LegParams(), estimator="leg_ekf") == (p, {"by": "me"})
    with pytest.raises(ValueError, match="holds parameters of leg_ekf; other is wanted"):
        io.read_params(file, leg_ekf.LegParams(), estimator="other")
    file.write_text(file.read_text().replace('"unit": "m"', '"unit": "cm"', 1))
    with pytest.raises(ValueError, match="thigh_length.right in 'cm'; 'm' is wanted"):
        io.read_params(file, leg_ekf.LegParams(), estimator="leg_ekf")
    io.write_params(file, p, estimator="leg_ekf")
    file.write_text(file.read_text().replace("angle_noise", "angel_noise"))
    with pytest.raises(ValueError, match="names a parameter 'angel_noise' that leg_ekf does not have"):
        io.read_params(file, leg_ekf.LegParams(), estimator="leg_ekf")
    file.write_text("[1, 2]")
    with pytest.raises(ValueError, match="expected a file of parameters"):
        io.read_params(file, leg_ekf.LegParams(), estimator="leg_ekf")


def test_every_parameter_has_a_unit():
    assert all(io.units(leg_ekf.LegParams()).values())
