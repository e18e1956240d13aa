"""Folders of results: no input and no file of a user is overwritten, one writer, results of one set of arguments."""

import contextlib
import fcntl
import json
import os
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from jgait import io
from jgait.cli import app
from jgait.commands.estimate import _called
from jgait.commands.folder import STAGE, results_folder, unfinished
from jgait.io.atomic import write_text


def put(out, arguments, *names, content="a", fresh=False, command="make", **more):
    with results_folder(out, command, arguments, fresh=fresh, **more) as folder:
        return folder.publish([write_text(folder.stage / name, content) for name in names])


@contextlib.contextmanager
def refused(capsys, *words):
    with pytest.raises(typer.Exit) as left:
        yield
    assert left.value.exit_code == 2
    said = " ".join(capsys.readouterr().err.split())
    for word in words:
        assert word in said


def names_in(out):
    return sorted(path.name for path in out.iterdir())


def test_results_of_other_arguments_are_refused_and_with_fresh_deleted(tmp_path, capsys):
    assert put(tmp_path, {"seed": 0}, "a.csv", "b.csv") == [tmp_path / "a.csv", tmp_path / "b.csv"]
    with refused(capsys, "seed was “0”, now “1”", "--fresh"):
        put(tmp_path, {"seed": 1}, "a.csv")
    assert names_in(tmp_path) == [".jgait-make.json", "a.csv", "b.csv"]
    put(tmp_path, {"seed": 1}, "a.csv", fresh=True)
    assert names_in(tmp_path) == [".jgait-make.json", "a.csv"]


def test_no_file_of_other_arguments_outlives_a_killed_run(tmp_path):
    put(tmp_path, {"seed": 0}, "a.csv", "b.csv")
    with contextlib.suppress(KeyboardInterrupt), results_folder(tmp_path, "make", {"seed": 1}, fresh=True) as folder:
        write_text(folder.stage / "a.csv", "half")
        raise KeyboardInterrupt
    assert names_in(tmp_path) == [".jgait-make.json"]
    assert unfinished(tmp_path, "make")
    put(tmp_path, {"seed": 1}, "a.csv", fresh=True)
    assert not unfinished(tmp_path, "make")


def test_an_interrupted_command_says_that_it_continues_if_it_does(tmp_path, capsys):
    for begun in (False, True):
        with contextlib.suppress(KeyboardInterrupt), results_folder(tmp_path, "make", {"seed": 1}) as folder:
            if begun:
                folder.run.mkdir()
            raise KeyboardInterrupt
        assert capsys.readouterr().err == "the same command continues where it stopped\n" * begun


def test_what_was_not_written_again_goes_and_what_is_equal_stays(tmp_path):
    put(tmp_path, {}, "a.csv", "b.csv")
    before = (tmp_path / "a.csv").stat().st_mtime_ns
    put(tmp_path, {}, "a.csv")
    assert names_in(tmp_path) == [".jgait-make.json", "a.csv"]
    assert (tmp_path / "a.csv").stat().st_mtime_ns == before
    put(tmp_path, {}, "a.csv", content="other")
    assert (tmp_path / "a.csv").read_text() == "other"


def test_what_another_command_wrote_for_the_same_recording_goes(tmp_path, capsys):
    one, two = "/a/one.csv", "/a/two.csv"
    put(tmp_path, None, "one_angles.csv", "one_strides.csv", planned={"one_angles.csv": one, "one_strides.csv": one})
    put(tmp_path, None, "two_strides.csv", planned={"two_strides.csv": two})
    assert capsys.readouterr().err == ""
    put(tmp_path, None, "one_strides.csv", planned={"one_strides.csv": one})
    assert names_in(tmp_path) == [".jgait-make.json", "one_strides.csv", "two_strides.csv"]
    said = " ".join(capsys.readouterr().err.split())
    assert "removed 1 file that an earlier command wrote for this recording: one_angles.csv" in said


def test_files_of_the_user_and_of_other_commands_are_kept(tmp_path, capsys):
    (tmp_path / "a.csv").write_text("mine")
    with refused(capsys, "a.csv is there", "did not write it"):
        put(tmp_path, {}, "a.csv")
    with refused(capsys, "a.csv is there"):  # before anything is computed
        put(tmp_path, {}, planned=["a.csv"])
    with refused(capsys, "is read by this command"):
        put(tmp_path, {}, planned=["a.csv"], inputs=[tmp_path / "a.csv"])
    put(tmp_path, {}, "b.csv")
    with refused(capsys, "b.csv is there"):
        put(tmp_path, {}, "b.csv", command="other")
    assert (tmp_path / "a.csv").read_text() == "mine"
    put(tmp_path, {"seed": 1}, "c.csv", fresh=True)
    assert names_in(tmp_path) == [".jgait-make.json", ".jgait-other.json", "a.csv", "c.csv"]


def test_results_of_two_recordings_of_one_name(tmp_path, capsys):
    put(tmp_path, None, "walk.csv", planned={"walk.csv": "/a/walk.csv"})
    put(tmp_path, None, "walk.csv", planned={"walk.csv": "/a/walk.csv"})
    with refused(capsys, "is of /a/walk.csv", "another --out for /b/walk.csv"):
        put(tmp_path, None, "walk.csv", planned={"walk.csv": "/b/walk.csv"})


def test_a_second_writer_is_refused(tmp_path, capsys):
    descriptor = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    with refused(capsys, "another jgait command is writing to"):
        put(tmp_path, {}, "a.csv")
    os.close(descriptor)
    put(tmp_path, {}, "a.csv")


def test_an_unusable_folder_and_a_damaged_manifest(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file", tmp_path / "file" / "in" / "it"):
        with refused(capsys, f"--out needs a folder; {tmp_path / 'file'} is a file"):
            put(out, {}, "a.csv")
    for text in ("{", "[3]", "3", '{"files": 3}', '{"files": {"../b": ""}}'):
        (tmp_path / ".jgait-make.json").write_text(text)
        with refused(capsys, "cannot be used"):
            put(tmp_path, {}, "a.csv", planned=["a.csv"])
        assert not (tmp_path / STAGE).exists()


def test_as_many_folders_are_named_as_tell_files_apart(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "report.html").write_text("a\nb\n")
    for name in ("S1/T1", "S2/T1", "S1/T2"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "walk.csv").write_text("nothing\n1\n")
    files = ["S1/T1/walk.csv", "S2/T1/walk.csv", "S1/T2/walk.csv", "report.html"]
    result = CliRunner(env={"COLUMNS": "300"}).invoke(app, ["estimate", *files, "--out", "o", "--json", "n.json"])
    assert set(json.loads((tmp_path / "n.json").read_text())["failures"]) == set(files), result.output
    called = _called([Path(file) for file in files])
    assert ["_".join(parts) for parts in called.values()] == ["S1_T1_walk", "S2_T1_walk", "T2_walk", "report"]


NASTY = "a$_{$[bold]\x1b[2J\udcff"  # the last is a byte that is no text


def test_names_with_markup_formulas_and_control_characters(recording, tmp_path, monkeypatch):
    """A file and its columns are called so that a terminal, a figure or a page could take them for orders."""
    monkeypatch.chdir(tmp_path)
    io.recording_to_dataframe(recording).assign(**{f"<script>{NASTY[:-1]}": 1.0}).to_csv(f"{NASTY}.csv", index=False)
    for words in (["estimate", f"{NASTY}.csv"], ["report", f"{NASTY}.csv"]):
        words += ["--json", "numbers.json"]
        result = CliRunner(env={"COLUMNS": "200"}).invoke(app, words)
        assert result.exit_code == 0, result.output
        assert "\x1b[2J" not in result.output and r"\x1b[2J" in result.output and "[bold]" in result.output
    page = (tmp_path / "report.html").read_text()
    assert f"<script>{NASTY[:3]}" not in page and "&lt;script&gt;a$" in page and "\x1b" not in page


def test_fresh_deletes_the_intermediate_results_of_its_own_command(tmp_path):
    for command in ("evaluate", "tune"):
        with results_folder(tmp_path, command, {"seed": 0}) as folder:
            folder.run.mkdir()
            (folder.run / "part").write_text("")
            folder.publish([])
    put(tmp_path, {"seed": 1}, command="tune", fresh=True)
    assert not (tmp_path / "fits").exists() and (tmp_path / "run" / "part").exists()
    (tmp_path / "other" / "run").mkdir(parents=True)  # of the user
    put(tmp_path / "other", {"seed": 1}, command="evaluate", fresh=True)
    assert (tmp_path / "other" / "run").exists()


def test_what_a_killed_writer_left_is_removed(tmp_path):
    (tmp_path / ".page.12345678.part.html").write_text("half")
    (tmp_path / ".other.12345678.part.html").write_text("of another file")
    write_text(tmp_path / "page.html", "whole")
    assert names_in(tmp_path) == [".other.12345678.part.html", "page.html"]
