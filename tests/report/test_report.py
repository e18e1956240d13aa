"""Reports: their numbers, what they say of doubts, that they stand alone, and how a browser takes them."""

import html.parser
import json
import re
import shutil
import subprocess

import jax
import numpy as np
import pandas as pd
import pytest
from made import cohort as made_cohort
from made import notes as made_notes
from made.command import run

from jgait import evaluate, io, report
from jgait.commands import evaluate as evaluate_command
from jgait.commands import report as command
from jgait.commands.cohort_table import Source
from jgait.estimators import ankle_stride
from jgait.estimators.notes import NO_FIRST_STANDING, NO_STEPS
from jgait.estimators.stride_flags import FEW_REGULAR
from jgait.evaluate.scores import DISTANCE_OFF
from jgait.io import flags
from jgait.io.flags import without_folders
from jgait.io.results import Total
from jgait.notes import SEVERITIES, Kind, to_json
from jgait.types import Estimate, Feet, FootTrajectory, Imu, Legs, LegTrajectory, Recording, Strides

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
EVIL = '<img src="http://evil.example/x.png" onerror="document.title=1">'


def recording(*places, seconds=20.0, hz=25.0, **more):
    time = np.arange(0.0, seconds, 1.0 / hz)
    imu = Imu(time, np.zeros((time.size, 3)), np.zeros((time.size, 3)), np.arange(time.size) != 7)
    return Recording(dict.fromkeys(places, imu), hz, **{"name": "walk", **more})


def walking_legs(cycle=1.2, speed=1.25, hz=25.0, seconds=20.0, knee=60.0, hip=25.0):
    """Both legs, standing for 2 s, then walking evenly: knees bend to `knee` and hips swing between ±`hip` [°]."""
    time = np.arange(0.0, seconds, 1.0 / hz)
    on = np.clip(time - 2.0, 0.0, None)
    legs = []
    for shift in (0.0, 0.5):
        phase = 2.0 * np.pi * (on / cycle - shift)
        moving = time > 2.0 + 0.5 * cycle
        knees = np.where(moving, np.deg2rad(knee) * np.cos(0.5 * phase) ** 8, 0.0)
        hips = np.where(moving, np.deg2rad(hip) * np.cos(phase), 0.0)
        legs.append(LegTrajectory(hips, knees, 0.3 * np.sin(hips), -0.8 * np.cos(hips)))
    spread = LegTrajectory(*(np.full(time.size, value) for value in (0.05, 0.05, 0.01, 0.01)))
    told = {"notes": (NO_FIRST_STANDING(),), "nis_right": 0.9}
    return Estimate(time, Legs(*legs), Legs(spread, spread), speed * on, time > -1.0, told)


LENGTHS = np.array([0.6, 0.6, 1.2, 1.3, 1.21, 1.31, 1.22, 1.32, 1.0, 1.0, 1.23, 1.33])


def walking_ankles(name="", lengths=LENGTHS, seconds=20.0, hz=25.0):
    """Strides of both legs by turns, a second each: the first two from standing, the ninth and tenth in a turn."""
    count, time = lengths.size, np.arange(0.0, seconds, 1.0 / hz)
    row = np.arange(count)
    start = 2.0 + 0.5 * row
    columns = Strides(
        row % 2, start, start + 0.6, start + 1.0, lengths, np.full(count, np.nan), np.zeros(count), row >= 0,
        speed=lengths / 1.0, turn=np.where((row == 8) | (row == 9), 0.6, 0.0),
    )  # fmt: skip
    nothing = np.full(count, 0.02)
    spread = columns._replace(length=nothing, speed=nothing, turn=nothing, height=nothing, width=nothing)
    none = np.zeros(count, bool)
    told = {
        "turning": (row == 8) | (row == 9),
        "stairs": none,
        "clipped": none,
        "half": row < 2,
        "notes": (made_notes.note(name, "check"),) * bool(name),
    }
    way = np.interp(time, [2.0, 9.0], [0.0, 8.4])
    return Estimate(time, Legs(None, None), None, way, time > -1.0, told, columns, strides_stddev=spread)


def walking_feet(gap=0.2):
    """Two feet that take strides of 1.2 m, the last of the left one to standing; widths of `gap`, one not trusted."""
    of = walking_ankles(lengths=np.array([1.2, 1.2, 1.2, 1.2, 1.2, 0.6]))
    time, feet = of.time, []
    for side in range(2):
        ways = np.stack([1.2 * np.clip(time - 2.0 - 0.5 * side, 0.0, 3.0), 0.0 * time + gap * side, 0.0 * time], axis=1)
        feet.append(FootTrajectory(ways, np.zeros_like(ways), np.tile([1.0, 0.0, 0.0, 0.0], (time.size, 1))))
    standing = np.asarray(of.strides.start) + 0.3
    columns = of.strides._replace(width=np.full(6, gap), standing=standing, standing_end=standing + 1.0)
    told = {"width_valid": np.arange(6) != 1, "notes": ()}
    return of._replace(strides=columns, feet=Feet(*feet), diagnostics=told, strides_stddev=None)


@pytest.fixture(scope="module")
def ankles():
    """A page with everything that a user may bring in that must not become part of the page's code."""
    p = ankle_stride.with_body(ankle_stride.AnkleParams(), {"lever_ankle": 0.04})
    made = report.Made(
        "ankle_stride", p, ankle_stride.AnkleParams(), file="/data/anna/walks/walk.csv",
        command="jgait report walk.csv", notes=(made_notes.note(EVIL),),
    )  # fmt: skip
    of = recording("ankle_right", "ankle_left", name=f"/data/anna/{EVIL}", subject=EVIL)
    return report.of_estimate(walking_ankles(f"3 samples of ankle_left are lost {EVIL}"), of, made=made)


def means_of(page):
    return {f"{row['measure']}_{row['unit']}": row for row in page.numbers["means"]}


def test_means_are_of_regular_strides_by_side(ankles):
    means = means_of(ankles)
    right, left = LENGTHS[[2, 4, 6, 10]], LENGTHS[[3, 5, 7, 11]]
    length = means["stride_length_m"]
    assert length["n_strides"] == right.size + left.size
    assert (length["right"], length["left"]) == pytest.approx((right.mean(), left.mean()), rel=1e-12)
    assert length["mean"] == pytest.approx(0.5 * (right.mean() + left.mean()), rel=1e-12)
    assert not length["steady"] and length["std"] is None and length["asymmetry_pct"] is None  # two on each side are
    assert "too few steady ones" in ankles.html
    assert means["cadence_spm"]["mean"] == pytest.approx(120.0, rel=1e-12)  # two steps in a second
    numbers = ankles.numbers
    assert (numbers["strides"], numbers["strides_regular"]) == (12, 8)
    assert numbers["distance_m"] == pytest.approx(8.4) and numbers["distance_std_m"] is None
    assert numbers["made"]["changed"] == ["lever_ankle"]
    (median,) = [one.text for one in io.Results(walking_ankles()).totals if one.words == "stride length"]
    assert f">{median}<" in ankles.html  # the number of the terminal above the table of means


@pytest.fixture(scope="module")
def legs():
    """A page whose figures are kept as pixels where they are large."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report.page, "LARGEST_SVG", 30_000)
        return report.of_estimate(walking_legs(), recording("thigh_right", "shank_right"))


def test_cycles_of_legs_are_found_and_measured(legs):
    means, page = means_of(legs), legs
    # peaks fall on samples: a cycle is known to one of them, its mean to much less
    assert means["stride_duration_s"]["mean"] == pytest.approx(1.2, abs=0.005)
    assert means["stride_length_m"]["mean"] == pytest.approx(1.5, abs=0.005)
    assert means["walking_speed_mps"]["mean"] == pytest.approx(1.25, rel=1e-9)
    assert means["knee_flexion_max_deg"]["mean"] == pytest.approx(60.0, abs=0.5)
    assert means["hip_flexion_min_deg"]["left"] == pytest.approx(-25.0, abs=0.5)
    assert {"right", "left"} <= {row["side"] for row in page.numbers["stride_table"]}
    assert "from the middle of the walk" in page.html  # a close-up of a long recording
    assert [flag["grade"] for flag in page.numbers["flags"]] == ["check"]


def test_each_swing_of_a_knee_counts_in_one_cycle():
    estimate = walking_legs()
    knee = estimate.legs.right.knee_angle
    less = np.where((np.asarray(estimate.time) // 1.2) % 2 == 0, 1.0, 0.5)  # every other swing bends half as far
    leg = estimate.legs.right._replace(knee_angle=knee * less)
    page = report.of_estimate(
        estimate._replace(legs=Legs(leg, None), stddev=None), recording("thigh_right", "shank_right")
    )
    bends = [row["knee_flexion_max_deg"] for row in page.numbers["stride_table"]]
    assert min(bends) < 35.0 and max(bends) > 55.0
    assert abs(np.mean(np.array(bends) < 45.0) - 0.5) < 0.2


def test_a_recording_in_which_nobody_walks_is_a_page_too():
    still = walking_ankles("", lengths=LENGTHS[:0])
    facts = {**still.diagnostics, "notes": (NO_STEPS(placement="ankle_right"),)}
    page = report.of_estimate(still._replace(distance=None, diagnostics=facts), recording("ankle_right"))
    assert page.numbers["flags"][0]["grade"] == "stop"
    assert "No strides were found" in page.html and '<p class="trust stop">Do not use: ankle_right' in page.html
    standing = walking_legs()
    flat = LegTrajectory(*(np.zeros(standing.time.size),) * 4)
    page = report.of_estimate(standing._replace(legs=Legs(flat, None), distance=None), recording("thigh_right"))
    assert page.numbers["strides"] == 0 and page.numbers["means"] == []


def test_where_no_stride_counts_there_is_a_sentence_and_no_empty_table():
    of = walking_ankles()
    turning = of._replace(diagnostics={**of.diagnostics, "turning": np.ones(LENGTHS.size, bool)})
    page = report.of_estimate(turning, recording("ankle_right", "ankle_left"))
    assert [row["measure"] for row in page.numbers["means"]] == ["distance"]
    assert "No stride is regular" in page.html
    assert not re.search(r"<tbody>\s*</tbody>", page.html)


def test_a_page_of_feet_states_which_widths_and_half_strides_do_not_count():
    page = report.of_estimate(walking_feet(), recording("foot_right", "foot_left"))
    found = io.Results(walking_feet())
    assert list(np.flatnonzero(found.marks["half"])) == [5] and list(np.flatnonzero(found.marks["width"])) == [1]
    means = means_of(page)
    assert (means["stride_width_m"]["mean"], means["stride_width_m"]["n_strides"]) == (pytest.approx(0.2), 4)
    assert means["stride_length_m"]["n_strides"] == 5
    assert "width unsure" in page.html and "Bars are" in page.html


def test_a_reference_is_compared_and_drawn():
    own = walking_legs(seconds=10.0)._replace(stddev=None)
    known = [leg._replace(knee_angle=leg.knee_angle + np.deg2rad(4.0)) for leg in own.legs]
    known = own._replace(legs=Legs(*known), distance=1.1 * own.distance)
    page = report.of_estimate(own, recording("thigh_right"), reference=known)
    (row,) = re.findall(r"<tr>\s*<th[^>]*>knee angle, right.*?</tr>", page.html, re.DOTALL)
    assert ">4<" in row and ">°<" in row
    assert "Dashed: the reference" in page.html


class Parsed(html.parser.HTMLParser):
    """Tags with their attributes, and the text."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.words = [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.words.append(data)


def test_the_page_stands_alone_and_can_be_read_by_everybody(ankles):
    parsed = Parsed(ankles.html)
    addresses = [
        value for _, own in parsed.tags for name, value in own.items() if name in ("src", "href", "srcset", "action")
    ]
    assert addresses and all(address.startswith("data:") for address in addresses)
    outside = re.sub(r'data:[^"]*|http://evil.examp(le)?', "", ankles.html)  # the sentence of trust shortens it
    assert "//evil" not in outside and not re.search(r"https?:|url\(|@import", outside)
    names = [tag for tag, _ in parsed.tags]
    assert names.count("h1") == 1 and names.count("script") == 1 and "link" in names
    assert [own["alt"] for tag, own in parsed.tags if tag == "img"] and all(
        own["alt"] for tag, own in parsed.tags if tag == "img"
    )
    assert ("html", {"lang": "en"}) in parsed.tags
    assert all("scope" in own for tag, own in parsed.tags if tag == "th")
    policy = next(own["content"] for tag, own in parsed.tags if "Content-Security-Policy" in own.get("http-equiv", ""))
    assert policy.startswith("default-src 'none'; img-src data:")
    assert len(ankles.html) < 500_000


def test_what_comes_from_a_file_is_text_and_names_no_folder(ankles):
    said = "".join(Parsed(ankles.html).words)
    assert said.count(EVIL.partition("http")[0]) >= 3  # title, subject and notes, as text
    assert not [own for tag, own in Parsed(ankles.html).tags if "onerror" in own]
    assert "anna" not in ankles.html and "anna" not in json.dumps(ankles.numbers)


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ("there is no such file: /data/anna/walks/a1.csv", "there is no such file: a1.csv"),
        (r"cannot read C:\Users\anna\a1.csv: why", "cannot read a1.csv: why"),
        ("~/walks/a1.csv is empty", "a1.csv is empty"),
        ("'/data/b c.csv' lacks", "'b c.csv' lacks"),
        ("0.02 m/s² and rad/s; 5 / 3", "0.02 m/s² and rad/s; 5 / 3"),
        ("001/Test11/Trial1", "001/Test11/Trial1"),
    ],
)  # fmt: skip
def test_folders_are_left_out(said, expected):
    assert without_folders(said) == expected


def test_notes_are_explained_each_by_its_meaning():
    notes = [
        made_notes.note(f"{severity} {number}", severity) for number in range(2) for severity in reversed(SEVERITIES)
    ]
    file = Kind("file_of_tests", "info", "{file}: time taken to be in s", "Made for tests, info.")(file="walk 1.csv")
    (flag,) = flags.explained(
        [made_notes.note("a fact of /data/anna/walk.csv"), made_notes.note("time_s is new"), file]
    )
    text = "A fact of walk.csv\ntime_s is new\nwalk 1.csv: time taken to be in s"
    assert flag == flags.Flag("info", text, "Made for tests, info.")
    found = flags.explained(notes * 2)
    assert [flag.grade for flag in found] == list(flags.GRADES) == list(SEVERITIES)
    assert all(len(flag.text.splitlines()) == 2 for flag in found)  # each once


@pytest.mark.parametrize(
    "raised, sentence",
    [
        ([], "Good."),
        ([("info", "Shimmer", "")], "Good."),
        ([("check", "Only 3 regular strides", FEW_REGULAR.meaning), ("check", "A slides\nMT_1 is off", "")],
         "Usable with care: a slides; only 3 regular strides; MT_1 is off."),
        ([("check", f"Doubt {number}", "") for number in range(5)],
         "Usable with care: doubt 0; doubt 1; doubt 2; 2 more."),
        ([("check", "A doubt", ""), ("stop", "Nobody walks", "")], "Do not use: nobody walks."),
        ([("check", "Pelvis, thigh_right, shank_right, foot_right: samples missing: 3 of 100", "")],
         "Usable with care: 4 sensors: samples missing: 3 of 100."),
        ([("check", f"1 stride, {'of many, ' * 12}is left out{end}", "") for end in ("", "; the rest")],
         f"Usable with care: 1 stride, {'of many, ' * 12}is left out; 1 stride, {'of many, ' * 12}is left out."),
        ([("stop", "A knee bends", "", "joint angles"), ("check", "A doubt", "")],
         "Do not use the joint angles: a knee bends."),
        ([("stop", "A knee bends", "", "joint angles"), ("stop", "Nobody walks", "")],
         "Do not use: nobody walks; a knee bends."),
    ],
)  # fmt: skip
def test_one_sentence_says_how_far_to_trust_and_gives_up_to_three_reasons(raised, sentence):
    assert flags.verdict([flags.Flag(*each) for each in raised]) == sentence


def test_a_stop_marks_the_numbers_that_it_is_about():
    angles = Total("hip right", "0 … 9 °", "joint angles")
    totals = [Total("strides", "3"), Total("distance", "4 m"), angles, Total("cadence", "–")]

    def texts(measure, totals=totals):
        raised = [flags.Flag("stop", "a", "b", measure), flags.Flag("check", "a", "b", "distance")]
        return [total.text for total in flags.marked(totals, raised)]

    assert texts("") == ["3", "4 m, not usable", "0 … 9 °, not usable", "–"]
    assert texts("joint angles") == ["3", "4 m", "0 … 9 °, not usable", "–"]
    assert texts("joint angles", [angles, angles._replace(usable=False)]) == ["0 … 9 °", "0 … 9 °, not usable"]


def test_a_command_keeps_units_and_trials():
    words = ["report", "/data/a.mat", "--trial", "Test1/Trial1", "--gyr-unit=rad/s", "--out", "b/p.html"]
    assert command.command_of(words) == "jgait report a.mat --trial Test1/Trial1 --gyr-unit=rad/s --out p.html"


def test_strides_of_an_unknown_side_are_of_neither_leg():
    of = walking_ankles()
    unknown = np.arange(LENGTHS.size) < 11
    page = report.of_estimate(
        of._replace(diagnostics={**of.diagnostics, "side_unknown": unknown}), recording("lower_back")
    )
    row = means_of(page)["stride_length_m"]
    assert (row["n_strides"], row["right"], row["asymmetry_pct"]) == (8, None, None)
    assert row["left"] == pytest.approx(LENGTHS[11])
    assert "1 left, 11 side not known" in page.html
    assert "11 strides are of a side that is not known" in page.html
    assert "11 of 12 strides: side not known" in {flag["text"] for flag in page.numbers["flags"]}
    assert "Marks around a stride" in page.html


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory):
    """An evaluation of twelve walks, one of which cannot be read, as `jgait evaluate` leaves it, and in memory."""
    out = tmp_path_factory.mktemp("cohort") / "out"
    found = evaluate.cohort(made_cohort.FAKE, range(5, 17), read=made_cohort.read, body=own, out=out / "run")
    evaluate_command._write(out, Source("walks", [], None, {}, [], []), found, found, found.agreement(), None)
    return out, found


def own(walk):
    return {"offset": 0.25}


@pytest.fixture(scope="module")
def cohort(evaluated):
    return report.of_cohort(evaluated[1], title="walks")


def test_a_cohort_has_agreement_people_and_what_failed(evaluated, cohort):
    (_, found), page = evaluated, cohort
    said = "".join(Parsed(page.html).words)
    assert "11 of 12" in said and "no such file: 13" in said
    for heading in ("Agreement with the reference", "Bland–Altman", "People", "Recordings", "What could not be used"):
        assert heading in said
    row = found.agreement().loc["distance_m"]
    assert page.numbers["agreement"]["distance_m"]["bias"] == row["bias"]
    table = re.search(r"<tr>\s*<th[^>]*>distance \[m\].*?</tr>", page.html, re.DOTALL)
    assert table is not None and f"{row['bias']:.3g}".replace("-", "−") in table[0]
    assert page.numbers["failures"].keys() == {"13"}
    assert page.html.count("<img") >= 2
    assert "Only 4 people compared" in said
    none = evaluate.Cohort(*(rows.iloc[:0] for rows in found))
    with pytest.raises(ValueError, match="has none"):
        report.of_cohort(none)


def test_a_cohort_s_note_names_the_recording_that_it_is_of(evaluated):
    rows = evaluated[1].recordings.assign(notes="[]")
    rows.loc[rows["recording"] == "7", "notes"] = to_json([DISTANCE_OFF(reference=50.0, estimate=4.86)])
    said = "".join(Parsed(report.of_cohort(evaluated[1]._replace(recordings=rows)).html).words)
    assert "1 of 11 recordings, such as 7: The reference says 50.00 m, the estimate 4.86 m" in said


def test_the_folder_of_an_evaluation_gives_the_same_page(evaluated, tmp_path):
    out, found = evaluated
    page, numbers = tmp_path / "page.html", tmp_path / "numbers.json"
    code, said = run("report", out, "--out", page, "--json", numbers)
    assert code == 1, said  # one recording could not be used
    written = json.loads(numbers.read_text(encoding="utf-8"))
    expected = found.agreement().loc["distance_m"]
    for name in ("bias", "loa_low", "icc", "mae_high"):
        assert written["agreement"]["distance_m"][name] == pytest.approx(expected[name], rel=1e-9)
    assert written["made"]["estimator"] == "fake" and written["recordings"] == 11
    assert str(tmp_path) not in page.read_text(encoding="utf-8") + numbers.read_text(encoding="utf-8")


@pytest.fixture
def walk_file(tmp_path, monkeypatch):
    """A file that is read, and an estimate of it that was made before; what the estimator was told is kept."""
    told = {}

    def estimated(choice, p, recording):
        told.update(name=choice.estimator.name, p=p, paper=choice.paper)
        return walking_ankles()

    rng = np.random.default_rng(0)
    time = np.arange(0.0, 20.0, 0.01)
    imu = Imu(
        time, rng.normal(0.0, 1.0, (time.size, 3)), rng.normal(0.0, 1.0, (time.size, 3)) + [0, 0, 9.8], time > -1.0
    )
    file = io.write_csv(Recording({"ankle_right": imu}, 100.0), tmp_path / "walk.csv")
    monkeypatch.setattr("jgait.commands.options.Choice.estimate", estimated)
    return file, told


def test_one_recording_from_the_command_line(walk_file, tmp_path, monkeypatch):
    file, told = walk_file
    page, numbers, opened = tmp_path / "made" / "walk.html", tmp_path / "walk.json", []
    monkeypatch.setattr(command.webbrowser, "open", opened.append)
    words = ("--estimator", "ankle_stride", "--option", "lever=0.05", "--out", page, "--json", numbers, "--open")
    code, said = run("report", file, *words)
    assert code == 0, said
    assert opened == [page.as_uri()]
    assert told["p"].lever_ankle == 0.05 and told["p"].lever_along_sd == 0.01 and not told["paper"]
    written = json.loads(numbers.read_text(encoding="utf-8"))
    assert written["made"]["command"] == (
        "jgait report walk.csv --estimator ankle_stride --option lever=0.05 --out walk.html --json walk.json"
    )
    assert {"lever_ankle", "lever_along_sd"} <= set(written["made"]["changed"])
    text = page.read_text(encoding="utf-8")
    assert str(tmp_path) not in text and "walk.csv" in text


@pytest.fixture
def as_cohort(monkeypatch):
    """A cohort of walks of a few numbers, so that nothing is simulated and little compiled."""

    def put(items, read=made_cohort.read, failures=()):
        source = Source("walks", items, read, dict.fromkeys(items, ""), list(failures), [])
        monkeypatch.setattr(command.cohorts, "pipeline_of", lambda name, paper, params: made_cohort.FAKE)
        monkeypatch.setattr(command.cohorts, "source", lambda *words: source)
        monkeypatch.setattr(command.cohorts, "body", lambda walk, measures: own(walk))

    return put


def test_a_cohort_that_is_computed_now(tmp_path, as_cohort, evaluated):
    as_cohort([str(number) for number in range(5, 17)], failures=[("line 3", "it names no file")])
    page, numbers = tmp_path / "page.html", tmp_path / "numbers.json"
    code, said = run("report", "walks.csv", "--dataset", "any", "--paper", "--out", page, "--json", numbers)
    assert code == 1, said
    written = json.loads(numbers.read_text(encoding="utf-8"))
    assert written["failures"] == {"line 3": "it names no file", "13": "no such file: 13"}
    given = "jgait report walks.csv --dataset any --paper --out page.html --json numbers.json"
    assert written["made"]["command"] == given
    expected = evaluated[1].agreement().loc["distance_m"]
    assert written["agreement"]["distance_m"]["bias"] == pytest.approx(expected["bias"], rel=1e-12)
    assert "the paper&#39;s" in page.read_text(encoding="utf-8")


def test_recordings_whose_result_should_not_be_used_are_in_no_error(tmp_path, as_cohort):
    def read(number):
        item = made_cohort.read(number)
        grave = (made_notes.note("nobody walks", "stop"),) if number in ("7", "9") else ()
        return item._replace(recording=item.recording._replace(notes=(*item.recording.notes, *grave)))

    as_cohort([str(number) for number in range(5, 13)], read)
    out, numbers, page = tmp_path / "out", tmp_path / "numbers.json", tmp_path / "page.html"
    code, said = run("evaluate", "walks.csv", "--out", out, "--json", numbers)
    doubted = "2 of 8 recordings are not compared: the result should not be used"
    assert code == 0 and f"Check: {doubted}" in said, said
    assert "2 of 8 recordings, whose result should not be used, such as 7: Nobody" in said
    written = json.loads(numbers.read_text(encoding="utf-8"))
    assert written["recordings"] == 8 and written["not_to_be_used"] == ["7", "9"]
    rows = pd.read_csv(out / "quantities.csv", dtype={"recording": str}).query("quantity == 'distance_m'")
    bias = rows[~rows["recording"].isin(["7", "9"])]["error"].mean()
    assert len(rows) == 8 and written["agreement"]["distance_m"]["bias"] == pytest.approx(bias, rel=1e-9)
    assert run("report", out, "--out", page, "--json", numbers)[0] == 0
    written = json.loads(numbers.read_text(encoding="utf-8"))
    assert written["agreement"]["distance_m"]["bias"] == pytest.approx(bias, rel=1e-9)
    assert sum(one["n"] for one in written["people_table"] if one["quantity"] == "distance_m") == 6
    assert doubted in "".join(Parsed(page.read_text(encoding="utf-8")).words)
    as_cohort(["7", "9"], read)
    code, said = run("evaluate", "walks.csv", "--out", tmp_path / "none")
    assert code == 0 and "2 of 2 recordings are not compared" in said and "mean |error|" not in said
    assert run("report", tmp_path / "none", "--out", page)[0] == 0


WATCH = """<script>
const seen = {errors: [], violations: []};
addEventListener("error", (e) => seen.errors.push(String(e.message || e.target.tagName)), true);
addEventListener("securitypolicyviolation", (e) => seen.violations.push(e.blockedURI));
addEventListener("load", () => setTimeout(() => {
  seen.images = [...document.images].map((one) => [one.complete, one.naturalWidth, one.naturalHeight]);
  seen.asked = performance.getEntriesByType("resource").map((one) => one.name);
  seen.wide = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  const table = document.querySelector("table.sortable");
  const heading = [...table.tHead.rows[0].cells].findIndex((one) => one.textContent.startsWith("stride length"));
  const column = () => [...table.tBodies[0].rows].map((row) => Number(row.cells[heading].dataset.value));
  const button = table.tHead.rows[0].cells[heading].querySelector("[role=button]");
  button.click(); seen.up = column(); seen.sorted = table.tHead.rows[0].cells[heading].getAttribute("aria-sort");
  button.dispatchEvent(new KeyboardEvent("keydown", {key: "Enter"})); seen.down = column();
  document.body.dataset.seen = JSON.stringify(seen);
}, 100));
</script>"""


def browse(page, folder, *options):
    """The page as a browser has it after loading, and what it says on its error stream."""
    if BROWSER is None:
        pytest.skip("no chromium or google-chrome on PATH: the page is not opened in a browser")
    words = (
        BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--enable-logging=stderr",
        f"--user-data-dir={folder / 'profile'}", "--virtual-time-budget=3000", "--dump-dom", *options, page.as_uri(),
    )  # fmt: skip
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


def test_a_browser_shows_every_picture_sorts_and_asks_nobody(ankles, tmp_path):
    page = ankles.save(tmp_path / "page.html")
    dom, said = browse(page, tmp_path)
    assert said == [] and 'role="button"' in dom  # the page's own script ran under its own policy
    watched = tmp_path / "watched.html"
    policy = re.sub(r"script-src '[^']*'", "script-src 'unsafe-inline'", ankles.html)
    assert policy != ankles.html
    watched.write_text(policy.replace("<style>", WATCH + "<style>", 1), encoding="utf-8")
    dom, said = browse(watched, tmp_path, "--window-size=500,900")
    seen = json.loads(next(own["data-seen"] for tag, own in Parsed(dom).tags if tag == "body"))
    assert said == [] and seen["errors"] == [] and seen["violations"] == []
    assert len(seen["images"]) == 2 and all(done and w > 300 and h > 200 for done, w, h in seen["images"])
    assert [one for one in seen["asked"] if not one.startswith("data:")] == []
    assert seen["wide"] <= 0  # nothing sticks out of a narrow window
    assert seen["sorted"] == "ascending"
    np.testing.assert_allclose(seen["up"], np.sort(LENGTHS))
    np.testing.assert_allclose(seen["down"], np.sort(LENGTHS)[::-1])


def test_several_recordings_at_once_are_refused():
    many = jax.tree.map(lambda values: np.stack([values] * 2), walking_legs()._replace(diagnostics={}))
    with pytest.raises(ValueError, match=r"time of shape \(T,\); got shape \(2, 500\)"):
        report.of_estimate(many, recording("thigh_right"))
