"""What the commands say: which file a message is about, what to do, and each finding once."""

import jax
import numpy as np
import pandas as pd
import pytest
from made.command import run

from jgait import cli, io
from jgait.types import RecordingError, reason_of


def test_files_of_the_same_name_are_told_apart(recording, tmp_path, without_estimates):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    files = [io.write_csv(recording, tmp_path / name) for name in ("a/walk.csv", "b/walk.csv", "b/other.csv")]
    code, said = run("estimate", *files, "--out", tmp_path / "out")
    assert code == 0
    for begin in ("a/walk.csv: Usable", "b/walk.csv: Usable", " other.csv: Usable"):
        assert said.count(begin) == 1
    assert " walk.csv:" not in said


def test_one_file_is_called_by_its_name(walk, tmp_path, without_estimates):
    _, said = run("estimate", walk, "--out", tmp_path / "out", "--notes")
    assert said.startswith("walk.csv: Usable with care: ") and "For information: Sampling rate" in said


@pytest.mark.parametrize(
    "kind, factor, unit", [("acc", 1.0 / 9.80665, "--acc-unit g"), ("gyr", 57.3, "--gyr-unit deg/s")]
)
def test_a_unit_is_advised_if_it_is_right_for_all_sensors_and_one_sensor_is_left_out(
    walk, tmp_path, without_estimates, kind, factor, unit
):
    table = pd.read_csv(walk)
    if kind == "gyr":
        turns = [name for name in table if "_gyr_" in name]
        table[turns] = np.deg2rad(table[turns])
    options = ("--gyr-unit", "rad/s") if kind == "gyr" else ()
    signals = [name for name in table if f"_{kind}_" in name]
    one = [name for name in signals if name.startswith("shank")]
    for columns in (signals, one):
        changed = table.copy()
        changed[columns] *= factor
        changed.to_csv(walk, index=False)
        code, said = run("estimate", walk, *options, "--out", tmp_path / "out", "--notes")
        if columns is signals:
            assert code == 2
            assert f"pass {unit}" in said
            assert "walk.csv: the " in said  # the recording's name is that of the file
        else:
            assert code == 0
            assert "--" not in said
            assert "Usable with care: shank_right is left out: its " in said
            assert "Check: shank_right is left out: its " in said
            meant = unit.split()[1]
            assert f"seems to be in {meant}, but thigh_right is not; convert the columns of this sensor" in said


def test_a_file_without_time_says_what_came(recording, walk, tmp_path, without_estimates):
    pd.read_csv(walk).rename(columns={"time": "clock"}).to_csv(walk, index=False)
    _, said = run("estimate", walk, "--out", tmp_path / "out")
    rows = len(recording.sensors["thigh_right"].time)
    assert f"it has {rows} rows and no column called 'time', so --rate is needed; it was not given" in said
    assert "columns that are not of sensors: clock" in said
    walk.write_text(f"{walk.read_text()}{'0,' * 99}\n0\n")
    assert "walk.csv: line " in run("estimate", walk, "--out", tmp_path / "out")[1]
    with pytest.raises(RecordingError, match=r"walk has 20 samples without time stamps, so sampling_rate_hz is needed"):
        io.recording_from_arrays({"waist": {"gyr": np.ones((20, 3))}}, name="walk")


# --- compiled programs ---

BROKEN = jax.errors.JaxRuntimeError("INTERNAL: Symbols not found: [ fusion.1 ]")


def test_a_compiled_program_that_fails_points_to_the_cache(walk, tmp_path, without_estimates):
    def fail(*_):
        raise BROKEN

    without_estimates(fail)
    code, said = run("estimate", walk, "--out", tmp_path / "out")
    assert code == 2
    assert "Symbols not found" in said and "`jgait cache --clear`" in said
    assert "jgait cache" not in reason_of(jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: out of memory"))


def test_a_command_that_ends_in_a_compiled_program_points_to_the_cache(monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for name in ("JAX_ENABLE_X64", "JAX_COMPILATION_CACHE_DIR", "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"):
        monkeypatch.setenv(name, "1")

    def fail():
        raise BROKEN

    monkeypatch.setattr(cli, "_kept", [])
    monkeypatch.setattr(cli, "app", fail)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert "`jgait cache --clear`" in capsys.readouterr().err
    monkeypatch.setattr(cli, "app", lambda: [][0])
    with pytest.raises(IndexError):
        cli.main()


# --- each finding once ---
