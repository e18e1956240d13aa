"""Files as users have them, end to end: other systems' formats, and what is said of files that cannot be used."""

import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made.command import run

from jgait import io
from jgait.io import atomic


def of_table(change):
    """What makes a table of a file another one."""
    return lambda path: change(pd.read_csv(path)).to_csv(path, index=False)


def of_text(change):
    return lambda path: path.write_text(change(path.read_text()))


def scaled(kind, factor):
    return of_table(lambda table: table.assign(**{n: table[n] * factor for n in table.columns if kind in n}))


SPOILT = {
    "in g": (scaled("_acc_", 1.0 / 9.81), "it seems to be in g; pass --acc-unit g"),
    "no shank": (of_text(lambda text: text.replace("shank_right", "wrist_right")), "no estimator has its sensors"),
    "binary": (lambda path: path.write_bytes(bytes(range(256)) * 8), "it is in no format that jgait reads"),
}


@pytest.mark.parametrize(("spoil", "words"), SPOILT.values(), ids=SPOILT)
def test_a_bad_file_is_refused_in_words_and_leaves_nothing(walk, tmp_path, spoil, words):
    spoil(walk)
    code, said = run("estimate", walk, "--out", tmp_path / "results")
    assert code == 2
    assert words in said
    assert "walk.csv" in said
    assert not (tmp_path / "results").exists()


def test_columns_of_unknown_names_are_listed_or_placed(walk, tmp_path, without_estimates):
    walk.write_text(walk.read_text().replace("shank_right", "Wade_re").replace("thigh_right", "Bein_re"))
    code, said = run("estimate", walk, "--out", tmp_path / "results")
    assert code == 2
    assert "found 'time', 'Bein_re_gyr_x'" in said
    assert "columns are named <placement>_gyr_x to <placement>_acc_z, such as foot_left_gyr_x" in said
    assert "place sensors by --place 'Bein_re=PLACE'" in said
    code, said = run("estimate", walk, "--place", "Wade_re=shank_right", "--out", tmp_path / "results", "--notes")
    assert code == 0 and "The sensor 'Wade_re' was stated to sit at shank_right" in said


def test_a_file_that_may_not_be_read_is_named(walk, tmp_path):
    """Root may read everything, so there the command runs as nobody, who cannot load modules that root installed."""
    run("estimate", tmp_path / "absent.csv", "--out", tmp_path / "results")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(shutil.copy(walk, folder))
        io.read(file)  # what reads it is loaded
        os.chmod(folder, 0o755)
        file.chmod(0)
        user = os.geteuid()
        if user == 0:
            os.seteuid(65534)
        try:
            code, said = run("estimate", file, "--out", tmp_path / "results")
        finally:
            os.seteuid(user)
    assert code == 2
    assert "Permission denied" in said


@pytest.mark.parametrize("command", ["estimate", "report"])
def test_a_full_disk_leaves_nothing_half_written(walk, tmp_path, command, monkeypatch):
    out = tmp_path / "results" if command == "estimate" else tmp_path / "report.html"
    limits, begin = resource.getrlimit(resource.RLIMIT_FSIZE), atomic.secrets.token_hex

    def begin_on_a_full_disk(*arguments, **options):  # from the first file that a command begins to write
        resource.setrlimit(resource.RLIMIT_FSIZE, (2_000, limits[1]))
        return begin(*arguments, **options)

    monkeypatch.setattr(atomic.secrets, "token_hex", begin_on_a_full_disk)
    try:
        code, said = run(command, walk, "--out", out)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert code == 2, said
    assert "File too large" in said
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["walk.csv"]


def test_bare_names_need_a_place_and_the_option_gives_it(recording, tmp_path):
    imu = recording.sensors["shank_right"]
    table = io.recording_to_dataframe(recording._replace(sensors={"shank_right": imu}))
    bare = tmp_path / "sensor.csv"
    table.rename(columns=lambda name: name.replace("shank_right_", "")).to_csv(bare, index=False)
    code, said = run("estimate", bare, "--estimator", "ankle_stride", "--out", tmp_path / "results")
    assert code == 2
    assert "for one sensor with bare names give its place, such as --place" in said
    words = ("--estimator", "foot_ins", "--place", "shank_right", "--out", tmp_path / "results")
    code, said = run("estimate", bare, *words)
    assert "needs" in said and "shank_right" in said


def test_the_shell_completes_commands():
    asked = {"_JGAIT_COMPLETE": "complete_bash", "COMP_WORDS": "jgait est", "COMP_CWORD": "1"}
    jgait = Path(sys.executable).with_name("jgait")
    done = subprocess.run([jgait], env={**os.environ, **asked}, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["estimate"]


def test_inspect_shows_what_is_understood_and_draws_the_signals(recording, tmp_path):
    lost = recording_with_a_loss(recording)
    io.recording_to_dataframe(lost).to_csv(tmp_path / "walk.csv", index=False)
    code, said = run("inspect", tmp_path / "walk.csv", tmp_path / "none.csv", "--out", tmp_path)
    assert code == 1 and "none.csv: there is no such file" in said and said.count("none.csv") == 1
    assert (tmp_path / "walk_signals.png").stat().st_size > 10_000
    row = re.search(r"│ shank_right │ ([\d.]+) │ ([\d.]+) │ ([\d.]+) │ ([\d.]+) │ ([\d.]+) │", said)
    gyr, mask = lost.sensors["shank_right"].gyr, lost.sensors["shank_right"].mask
    rate = np.rad2deg(np.linalg.norm(gyr[mask], axis=1).max())
    assert row and float(row[2]) == pytest.approx(9.8, abs=0.5)
    assert float(row[3]) == pytest.approx(rate, rel=0.01)
    assert float(row[5]) == pytest.approx(30 / recording.sampling_rate_hz)
    assert run("inspect", tmp_path / "none.csv", "--out", tmp_path)[0] == 2


def recording_with_a_loss(recording):
    mask = np.ones(len(recording.sensors["shank_right"].mask), bool)
    mask[200:230] = False
    imu = recording.sensors["shank_right"]
    return recording._replace(sensors={**recording.sensors, "shank_right": imu._replace(mask=mask)})


def test_a_json_file_that_cannot_be_written_is_said(walk, tmp_path):
    (tmp_path / "numbers").write_text("a file")
    code, said = run("estimate", walk, "--out", tmp_path / "results", "--json", tmp_path / "numbers" / "x.json")
    assert code == 2
    assert "could not be written" in said
