"""A whole cohort on the command line: bad rows, runs that go on, and parameters from one command to another."""

import json

import jax
import numpy as np
import pandas as pd
import pytest
from made.command import run

from experiments.common import protocols
from jgait import io
from jgait.commands import cohort
from jgait.commands.cohort_table import COPIED
from jgait.commands.options import chosen
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
        {"file": "./walk0.csv", "subject": "p8"},
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
        "line 9: ./walk0.csv and walk0.csv are the same file", "4 recordings of 2 people",
        "Limits and ICC need 5 people",
        "empty.csv: it is empty",
        "thigh_length_m must be between 0.2 and 0.7 m", "6 of 10 recordings could not be used",
    ):  # fmt: skip
        assert words in said, said
    failures = pd.read_csv(out / "failures.csv").set_index("recording")["subject"]
    assert len(failures) == 6 and failures["empty.csv"] == failures["nowhere.csv"] == "p8"
    assert sorted(pd.read_csv(out / "recordings.csv")["subject"]) == ["p0", "p0", "p1", "p1"]
    notes = json.loads((out / "notes.json").read_text())
    for name, text in pd.read_csv(out / "recordings.csv").set_index("recording")["notes"].items():
        assert [one for one in notes if one["recording"] == name] == [
            {"recording": name, **n} for n in json.loads(text)
        ]
    assert any(one["recording"] == "walk0.csv" for one in notes)
    assert (out / "distance_agreement.png").exists() and (out / "distance_per_subject.png").exists()


def opened(table):
    return cohort.source(table, None, None, 0, None, None, ("thigh_length", "shank_length"))


def test_rows_of_a_table_give_people_measures_and_references(table, walks):
    late = pd.read_csv(walks[0] / "walk0.csv")  # a file whose times do not begin with 0, and its reference with ;
    late.assign(time=late["time"] + 6.0).to_csv(walks[0] / "late.csv", index=False)
    truth = pd.read_csv(walks[0] / "samples0.csv").drop(columns="distance_m")
    truth.assign(time_s=truth["time_s"] + 6.0).to_csv(walks[0] / "late_samples.csv", index=False, sep=";")
    found = opened(table(lambda frame: frame.drop(columns="thigh_length_m").assign(
        file=["late.csv", *frame["file"][1:]], subject=["Anna", "anna ", "1", " ANNA"], height_m=1.8,
        shank_length_m=[0.4, "", "", ""], reference_samples=["late_samples.csv", "samples1.csv", "", "nowhere.csv"],
        reference_strides=["", "strides1.csv", "", ""]), "rows.csv"))  # fmt: skip
    assert list(found.subjects.values()) == ["Anna", "Anna", "1", "Anna"] and found.notes == []
    first, second, third = map(found.read, ("late.csv", "walk1.csv", "walk2.csv"))
    assert [note.code for note in first.recording.notes][-1] == "reference_distance_not_used"
    knee = truth["knee_angle_right_deg"].to_numpy()  # of the moments of the recording, in both clocks
    np.testing.assert_allclose(np.rad2deg(first.reference.legs.right.knee_angle), knee, atol=0.1)
    assert second.reference.strides is not None and third.reference.legs.right is None
    with pytest.raises(FileNotFoundError, match="there is no such file"):
        found.read("walk3.csv")
    bodies = [cohort.body(walk, ("thigh_length", "shank_length")) for walk in (first, second)]
    assert [one["shank_length"] for one in bodies] == pytest.approx([0.4, 0.246 * 1.8])
    assert bodies[0]["thigh_length"] == pytest.approx(0.245 * 1.8)


def test_a_row_states_the_place_the_rate_and_the_units_of_its_recording(table, walks):
    walk = pd.read_csv(walks[0] / "walk0.csv")
    foot = walk[[c for c in walk if c.startswith("shank_right")]].rename(
        columns=lambda c: c.removeprefix("shank_right_")
    )
    foot = foot.assign(**{c: foot[c] / (9.80665 if "acc" in c else 180.0 / np.pi) for c in foot})
    foot.to_csv(walks[0] / "bare.csv", index=False)
    stated = {"file": "bare.csv", "rate_hz": 100, "placement": "shank_left", "gyr_unit": "rad/s", "acc_unit": "g"}
    for column, value, message in (
        ("placement", "shin_left", "there is no placement 'shin_left'"),
        ("gyr_unit", "deg", "column gyr_unit must be one of"),
        ("rate_hz", 0, "rate_hz must be between"),
    ):
        rows = pd.DataFrame([stated | {column: value}])
        with pytest.raises(ValueError, match=message):
            opened(table(lambda frame, rows=rows: pd.concat([frame, rows]), f"{column}.csv")).read("bare.csv")
    found = opened(table(lambda frame: pd.concat([frame, pd.DataFrame([stated])]), "stated.csv"))
    assert not any("column" in str(note) for note in found.notes if note.code != "measure_of_some")
    recording, whole = found.read("bare.csv").recording, found.read("walk0.csv").recording
    np.testing.assert_allclose(recording.sensors["shank_left"].gyr, whole.sensors["shank_right"].gyr, atol=1e-6)
    np.testing.assert_allclose(recording.sensors["shank_left"].acc, whole.sensors["shank_right"].acc, atol=1e-5)
    own = walk.filter(regex="^(time|thigh|shank)")
    own = own.rename(columns=lambda c: c.replace("shank_right", "Wade_re").replace("thigh_right", "Bein_re"))
    own.to_csv(walks[0] / "named.csv", index=False)
    with pytest.raises(ValueError, match="by column placement 'Bein_re=PLACE'"):
        opened(table(lambda frame: pd.concat([frame, pd.DataFrame([{"file": "named.csv"}])]))).read("named.csv")
    placed = {"file": "named.csv", "placement": "Wade_re=shank_right; Bein_re=thigh_right"}
    named = opened(table(lambda frame: pd.concat([frame, pd.DataFrame([placed])]))).read("named.csv").recording
    assert set(named.sensors) == set(RIGHT)


def test_what_may_not_have_been_meant_is_noted(table):
    loose = table(lambda frame: frame.rename(columns={"thigh_length_m": "thigh_lenght_m"}).drop(
        columns=["subject", "distance_m"]), "loose.csv")  # fmt: skip
    told = " ".join(map(str, opened(loose).notes))
    for words in ("did you mean 'thigh_length_m'?", "every recording counts as another person",
                  "4 of 4 recordings have no thigh_length_m"):  # fmt: skip
        assert words in told


def test_losses_that_a_reference_cannot_answer_are_empty_or_named(table, tmp_path):
    with_files = table(lambda frame: frame.drop(columns="distance_m").assign(
        reference_samples=["samples0.csv", "samples1.csv", "", "samples3.csv"],
        reference_strides=["strides0.csv", "", "strides2.csv", "strides3.csv"],
    ), "partial.csv")  # fmt: skip
    code, said = run("evaluate", with_files, "--paper", "--loss", "stride_length,joint_angles", "--out", tmp_path)
    assert code == 0, said
    losses = pd.read_csv(tmp_path / "losses.csv").set_index("recording")
    assert list(losses.index[losses["stride_length"].isna()]) == ["walk1.csv"]
    assert list(losses.index[losses["joint_angles"].isna()]) == ["walk2.csv"]
    assert "walk1.csv: stride_length needs a reference with strides with length" in said
    strides = pd.read_csv(tmp_path / "strides.csv").dropna().set_index("recording")["error"]
    assert losses.loc["walk0.csv", "stride_length"] == pytest.approx(
        100.0 * np.sqrt((strides.loc["walk0.csv"] ** 2).mean()), rel=0.05
    )
    assert "strides of the reference are not compared; the body's way" in said


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
        "6 of 10 recordings could not be used",
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


def test_a_tuning_that_was_finished_is_not_run_again(tuned):
    _, _, out, words = tuned
    before = (out / "tuned.json").read_bytes()
    code, said = run(*words)
    assert code == 1
    assert "continuing an earlier run" in said and "continuing" not in tuned[1]
    assert (out / "tuned.json").read_bytes() == before


def test_tuned_parameters_are_taken_by_the_other_commands(tuned, evaluated, walks, tmp_path):
    file = tuned[2] / "tuned.json"
    made = json.loads(file.read_text())
    assert sorted(made["made"]["data"]) == [row["file"] for row in walks[1]]
    assert all(len(content) == 64 for content in made["made"]["data"].values())
    code, said = run("evaluate", evaluated[3], "--paper", "--params", file, "--out", tmp_path / "out")
    assert code == 1, said
    assert said.count("of 6 recordings, 5 used there, so that errors on them are not held out") == 1
    before, after = (
        pd.read_csv(folder / "quantities.csv").query("quantity == 'distance_m'")["estimate"].to_numpy()
        for folder in (evaluated[2], tmp_path / "out")
    )
    np.testing.assert_allclose(after, made["parameters"]["distance_scale"]["value"] * before, rtol=1e-9)
    code, said = run("report", tmp_path / "out", "--out", tmp_path / "out.html", "--json", tmp_path / "page.json")
    assert code == 1, said
    page = json.loads((tmp_path / "page.json").read_text())
    flag = next(f for f in page["flags"] if "not held out" in f["text"])
    assert flag["grade"] == "check" and "left out in turn, the median |error of the distance| was" in flag["text"]
    assert page["made"]["changed"] == ["distance_scale"]
    choice = chosen("leg_ekf", True, file, {"--scale": "1.0"})
    assert choice.params.distance_scale != 1.0 and choice.personal({})[0].distance_scale == 1.0


def test_recordings_of_the_tuning_are_known_by_their_content_and_people_by_their_names(tuned, table, walks):
    for number in (0, 3):
        frame = pd.read_csv(walks[0] / f"walk{number}.csv")
        frame.iloc[:-1].to_csv(walks[0] / f"other{number}.csv", index=False)
        (walks[0] / f"again{number}.csv").write_bytes((walks[0] / f"walk{number}.csv").read_bytes())

    def judged(files, people, file=tuned[2] / "tuned.json"):
        mine = table(lambda f: f.head(len(files)).assign(file=files, subject=people), "mine.csv")
        return cohort.source(mine, None, None, 0, None, None, (), file)

    for files, people, expected in (
        (["again0.csv", "again3.csv"], ["p7", "p8"], "of 2 recordings, 2 used there, so that errors on them are not"),
        (["walk0.csv", "other0.csv", "other3.csv"], ["p0", "p8", "P1"],
         "of 3 recordings, 1 used there and 1 of people with names used there, so that errors on them are not"),
        (["other0.csv", "other3.csv", "gone.csv"], ["p8", "p9", "p0"], "of 2 recordings, none is of that tuning;"),
    ):  # fmt: skip
        found = judged(files, people)
        assert f"the parameters in tuned.json were tuned on bad.csv: {expected}" in str(found.notes[-1])
        assert found.notes[-1].severity == ("info" if "none" in expected else "check")
    # Parameters that began with those of another tuning were tuned on its recordings, too.
    whole = json.loads((tuned[2] / "tuned.json").read_text())
    first = {"other3.csv": found.versions(["other3.csv"])["other3.csv"]}
    for data, held_out in ((first, True), (whole["made"]["data"], False)):
        whole["made"]["before"] = [{"cohort": "first.csv", "subjects": ["q0"], "data": data}]
        (walks[0] / "twice.json").write_text(json.dumps(whole))
        text = str(judged(files, people, walks[0] / "twice.json").notes[-1])
        assert "were tuned on bad.csv and first.csv: " in text and ("left out in turn" in text) == held_out
        assert ("1 used there, so that errors on them are not held out" in text) == held_out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--free", "scale"), "there is no parameter 'scale'; there are thigh_length.right"),
        (("--free", "angle_noise,distance_scal"), "did you mean 'distance_scale'?"),
        (("--free", "distance_scale", "--loss", "speed"), "--loss: a loss is one of distance, trajectory"),
        (
            ("--free", "distance_scale", "--loss", "trajectory"),
            "can answer all of trajectory: trajectory needs a reference with legs (walk0.csv and 3 others)",
        ),
        (("--free", "distance_scale", "--loss", "position"), "leg_ekf cannot answer 'position'; it answers distance"),
        (("--free", "distance_scale", "--folds", 3), "--folds must be between 2 and the 2 people; got 3"),
    ],
)
def test_bad_tunings(table, words, expected, tmp_path):
    code, said = run("tune", table(), "--paper", *words, "--steps", 1, "--out", tmp_path / "out")
    assert code == 2
    assert expected in said and "compiling" not in said
    assert not (tmp_path / "out" / "tuned.json").exists()


def test_tuning_refuses_a_copy_before_it_compiles(table, walks, tmp_path):
    (walks[0] / "again.csv").write_bytes((walks[0] / "walk0.csv").read_bytes())
    twice = table(lambda f: pd.concat([f, f.head(1).assign(file="again.csv", subject="p9")]), "twice.csv")
    code, said = run("tune", twice, "--paper", "--free", "distance_scale", "--out", tmp_path / "out")
    copied = "again.csv and walk0.csv hold the same recording"
    assert code == 2 and f"{copied}. {COPIED.meaning}" in said and "compiling" not in said, said
    code, said = run("evaluate", twice, "--paper", "--out", tmp_path / "all")
    assert code == 0 and copied in said
    assert any(note["code"] == COPIED.code for note in json.loads((tmp_path / "all" / "notes.json").read_text()))


def test_parameters_in_a_file(tmp_path):
    p = leg_ekf.LegParams(angle_noise=3.0, thigh_length=leg_ekf.BySide(0.4, 0.41))
    file = io.write_params(tmp_path / "p.json", p, estimator="leg_ekf", stderr={"angle_noise": 0.5}, made={"by": "me"})
    assert io.read_params(file, leg_ekf.LegParams(), estimator="leg_ekf") == (p, {"by": "me"})
    whole = file.read_text()
    for text, message in (
        (whole.replace('"leg_ekf"', '"other"'), "holds parameters of other; leg_ekf is wanted"),
        (whole.replace('"unit": "m"', '"unit": "cm"', 1), "thigh_length.right in 'cm'; 'm' is wanted"),
        (whole.replace("angle_noise", "angel_noise"), "names a parameter 'angel_noise' that leg_ekf does not have"),
        ("[1, 2]", "expected a file of parameters"),
    ):
        file.write_text(text)
        with pytest.raises(ValueError, match=message):
            io.read_params(file, leg_ekf.LegParams(), estimator="leg_ekf")
