"""The command line end to end: a user's CSV, and what it says of bad ones."""

import functools
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pandas as pd
import pytest
import typer
from made.command import run

from experiments.common import protocols
from jgait import cli, estimators, io
from jgait.commands import evaluate, options, tune


@pytest.fixture(scope="module")
def table():
    """A simulated walk as a user's table: seconds, deg/s, m/s²."""
    (walked,) = protocols.bennett(jax.random.key(4))
    return io.recording_to_dataframe(walked.recording).reset_index()


@pytest.fixture
def csv(table, tmp_path):
    table.to_csv(tmp_path / "walk.csv", index=False)
    return tmp_path / "walk.csv"


def test_estimate_writes_tables_and_figures_and_options_win_over_the_file_of_a_person(csv, tmp_path):
    out, person, numbers = tmp_path / "results", tmp_path / "person.json", tmp_path / "numbers.json"
    person.write_text('{"height_m": 1.6, "thigh_length_m": [0.41, 0.4]}')
    words = ("--person", person, "--height", 1.8, "--out", out, "--json", numbers)
    code, said = run("estimate", csv, *words, "--notes")
    assert code == 0, said
    assert "wrote" in said and "From the height of 1.80 m, by usual proportions: shank length 0.44" in said
    names = {path.name for path in out.glob("[!.]*")}
    tables = {f"walk_{name}.csv" for name in ("strides", "summary", "bouts", "contacts", "sources", "samples")}
    assert names == tables | {f"walk_{name}.png" for name in ("strides", "angles", "foot_path", "distance")}
    for name in tables:
        assert np.isfinite(pd.read_csv(out / name).select_dtypes("number").to_numpy()).any()
    (told,) = json.loads(numbers.read_text())["recordings"].values()
    assert told["person"] == {"height": 1.8, "thigh_length": [0.41, 0.4]}
    for sources in (pd.read_csv(out / "walk_sources.csv")["source"], [row["source"] for row in told["sources"]]):
        assert set(sources) == {"shanks", "legs", "combined"}


def test_one_method_alone_writes_its_own_table(csv, tmp_path):
    words = ("--estimator", "leg_ekf", "--height", 1.8, "--table-format", "parquet", "--out", tmp_path / "results")
    code, said = run("estimate", csv, *words, "--notes")
    assert code == 0, said
    assert "thigh length 0.44" in said
    names = {path.name for path in (tmp_path / "results").glob("[!.]*")}
    assert names == {"walk_legs.parquet", "walk_angles.png", "walk_foot_path.png", "walk_distance.png"}


def test_options_of_other_estimators_are_refused_by_name(capsys):
    """Every option that only some have, with each of the others, and without --estimator where it is no measure."""
    measures = {measure.option for name in estimators.names() for measure in estimators.about_of(name).measures}
    every = {option for name in estimators.names() for option in options.options_of(name)}
    for option in every:
        known = options.owners(option)
        owners = f"{options.named(option)} is an option of {' and '.join(known)}; "
        others = [name for name in estimators.names() if name not in known]
        calls = [(functools.partial(options.given_of, name), f"got --estimator {name}") for name in others]
        calls += (
            [] if option in measures else [(functools.partial(options.person_of, None), "give --estimator as well")]
        )
        for call, end in calls:
            with pytest.raises(typer.Exit):
                call({option: "1"})
            assert owners + end in " ".join(capsys.readouterr().err.split())
    assert options.owners("--pivot") == ["foot_ins", "stride_width_ekf"]


def test_a_table_of_recordings_gives_one_table_of_all(table, csv, tmp_path):
    for folder in ("a/walks", "b/walks"):
        (tmp_path / folder).mkdir(parents=True)
        table.to_csv(tmp_path / folder / "walk.csv", index=False)
    table.filter(regex="^time|left").to_csv(tmp_path / "b" / "walks" / "walk.csv", index=False)
    places = {
        "walk.csv": f"{tmp_path.name}_walk",
        "a/walks/walk.csv": "a_walks_walk",
        "b/walks/walk.csv": "b_walks_walk",
    }
    rows = [f"{cell},{cell[0]},{1.8 if cell[0] == 'w' else 1.6}" for cell in places]
    rows += ["none.csv,cleo,", "walk.csv,dan,", "a/x.csv,cleo,tall"]
    (tmp_path / "cohort.csv").write_text("\n".join(["file,subject,height_m", *rows]))
    out = tmp_path / "out"
    code, said = run("estimate", tmp_path / "cohort.csv", "--table-format", "parquet", "--out", out)
    assert code == 1 and "3 of 6 recordings could not be used" in said, said
    recordings = pd.read_parquet(out / "recordings.parquet").set_index("recording")
    assert (recordings["result"] == "failed").sum() == 3 and recordings.loc["walk.csv", "result"] == "check"
    assert recordings.loc["none.csv", "subject"] == "cleo"
    assert recordings.loc["none.csv", "reason"].startswith("there is no such file")
    assert recordings.loc["line 6", "reason"] == "walk.csv is listed twice"
    for name in ("strides", "summary", "bouts", "contacts", "sources"):
        whole = pd.read_parquet(out / f"{name}.parquet")
        assert list(whole.columns[:2]) == ["recording", "subject"]
        for cell, begin in places.items():
            mine, alone = whole[whole["recording"] == cell], pd.read_parquet(out / f"{begin}_{name}.parquet")
            assert set(mine["subject"]) == {cell[0]} and len(mine) == len(alone)
            numbers = alone.select_dtypes("number")
            np.testing.assert_array_equal(mine[numbers.columns].to_numpy(float), numbers.to_numpy(float))
    assert not (out / "samples.parquet").exists()
    lengths = pd.read_parquet(out / "sources.parquet").query("quantity == 'distance' and source == 'legs'")["value"]
    assert lengths.iloc[0] == pytest.approx(lengths.iloc[1] * 1.8 / 1.6, rel=0.01)


def test_several_files_give_one_table_of_all_and_the_next_ones_replace_it(csv, tmp_path):
    again = csv.with_name("again.csv")
    again.write_bytes(csv.read_bytes())
    for files in ((csv, again), (again, csv)):
        assert run("estimate", *files, "--estimator", "ankle_stride", "--out", tmp_path / "out")[0] == 0
        strides = pd.read_csv(tmp_path / "out" / "strides.csv")
        assert list(strides["recording"].unique()) == [file.stem for file in files]


def test_data_sets_are_listed():
    code, said = run("datasets", "list")
    assert code == 0
    for name in ("neura_sparse", "walking5m", "footprints", "pyshoe_vicon"):
        assert name in said


@pytest.fixture
def called(monkeypatch):
    """Commands that are called instead of computed, with their options."""
    found = []

    def put(module, name):
        command = getattr(module, name)
        monkeypatch.setattr(module, name, functools.wraps(command)(lambda **how: found.append((name, how))))

    put(tune, "tune")
    put(evaluate, "evaluate")
    return found


def test_the_demo_prints_the_commands_that_it_calls(tmp_path, called):
    code, said = run("demo", "--dataset", "simulated", "--subjects", 2, "--steps", 3, "--out", tmp_path)
    assert code == 0 and len(called) == 3, said
    commands = typer.main.get_command(cli.app)
    for line, (name, how) in zip(said.split("$ jgait ")[1:], called, strict=True):
        first, *words = line.split()
        assert first == name
        given = commands.get_command(None, name).make_context(name, words).params
        # which a user does not need in a new folder
        assert how.pop("fresh") and not given.pop("fresh")
        del how["context"]
        assert how == given


@pytest.mark.release
@pytest.mark.usefixtures("called")
def test_the_demo_begins_with_a_real_walk_beside_its_reference(data, tmp_path):
    true = float(data("neura_sparse")[0].reference.distance[-1])
    numbers = tmp_path / "demo.json"
    code, said = run("demo", "--out", tmp_path / "out", "--json", numbers)
    assert code == 0, said
    assert "What each sensor says" in said and "Against the reference" in said
    readme = (Path(__file__).parents[2] / "README.md").read_text()
    angles = re.search(r"right hip (.+?); left hip (.+?); right knee (.+?); left knee (.+?) \|", readme)
    shown = said[said.index("without the offset at standing") :]
    assert all(f"{float(angle):.3g} │" in shown for angle in angles.groups()), shown
    assert (tmp_path / "out" / "real_walk.html").stat().st_size > 10_000
    assert json.loads(numbers.read_text())["distance_m"] == pytest.approx(true, rel=0.02)


def test_the_cache_of_programs_is_shown_and_removed(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kept = tmp_path / "jgait" / "compiled"
    assert "0 programs, 0.0 MB" in run("cache")[1]
    kept.mkdir(parents=True)
    (kept / "one.program").write_bytes(bytes(2_000_000))
    assert f"1 program, 2.0 MB, in {kept}" in run("cache")[1]
    assert "removed 1 program" in run("cache", "--clear")[1]
    assert not kept.exists()
    assert run("cache", "--clear")[0] == 0


def test_a_command_computes_in_float64_and_keeps_the_programs_of_jax(tmp_path):
    called = """
import jgait.cli
def app():
    import jax
    print(jax.config.jax_enable_x64, jax.config.jax_platforms, jax.config.jax_compilation_cache_dir)
jgait.cli.app = app
jgait.cli.main()
"""
    bare = {name: value for name, value in os.environ.items() if not name.startswith(("JAX", "XLA"))}
    said = subprocess.run(
        [sys.executable, "-c", called], env=bare | {"XDG_CACHE_HOME": str(tmp_path)}, capture_output=True, text=True
    )
    assert said.stdout.split() == ["True", "cpu", str(tmp_path / "jgait" / "compiled")], said.stderr
