"""Clocks that jump while they record: the readings show whether samples are missing, or rows of two times alternate."""

import jax
import numpy as np
import pandas as pd
import pytest

from experiments.damage import harm
from jgait import io, simulate
from jgait.io.jumps import AS_SMOOTH, JUMP_S, jumps
from jgait.simulate.sensors import OPAL
from jgait.types import RecordingError

WORN = ("shank_right", "shank_left", "foot_right", "foot_left")
RATE_HZ = 100.0


@pytest.fixture(scope="module")
def walk():
    """A table of 20 m of walking, whose sensors stand at both ends."""
    walk = simulate.cohort(jax.random.key(5), 1, simulate.straight(20.0), OPAL, recorded=False)[0][0]
    rows = harm.rows_of(walk, WORN)
    table = {"time": rows.time}
    for placement, signals in rows.sensors.items():
        for kind, values in signals.items():
            table |= {f"{placement}_{kind}_{axis}": values[:, i] for i, axis in enumerate("xyz")}
    return pd.DataFrame(table)


def moved(table, row, seconds):
    """The table whose clock jumps before a row."""
    return table.assign(time=table.time + np.where(np.arange(len(table)) >= row, seconds, 0.0))


def middle(table):
    return len(table) // 2 + 20


def read(table):
    return io.recording_from_dataframe(table)


@pytest.mark.parametrize("seconds", [2.5, 3600.0, -0.1, -3600.0])
def test_a_jump_of_the_clock_over_which_readings_go_on_is_taken_out(walk, seconds):
    row, whole = middle(walk), read(walk)
    found = read(moved(walk, row, seconds))
    np.testing.assert_allclose(found.sensors["foot_left"].time, whole.sensors["foot_left"].time, atol=1e-6)
    np.testing.assert_array_equal(found.sensors["foot_left"].gyr, whole.sensors["foot_left"].gyr)
    (note,) = (note for note in found.notes if note not in whole.notes)
    assert (note.code, note.values["row"], note.values["jumps"]) == ("clock_jumps", row, 1)
    assert note.values["seconds"] == pytest.approx(seconds, abs=1e-6)


def test_of_two_jumps_both_are_taken_out_also_in_milliseconds(walk):
    row = middle(walk)
    table = moved(moved(walk, row, 3.0), row + 301, -1.5)
    found = read(table.assign(time=1e3 * table.time))
    (note,) = (note for note in found.notes if note.code == "clock_jumps")
    assert (note.values["jumps"], note.values["seconds"]) == (2, pytest.approx(3.0, abs=1e-6))
    assert len(found.sensors["foot_left"].time) == len(walk)


def test_a_file_whose_sensors_are_placed_by_an_option_is_read_the_same_way(walk, tmp_path):
    moved(walk, middle(walk), -2.5).to_csv(tmp_path / "walk.csv", index=False)
    found = io.read(tmp_path / "walk.csv")
    assert [note.code for note in found.notes].count("clock_jumps") == 1
    assert len(found.sensors["foot_left"].time) == len(walk)


@pytest.mark.parametrize("seconds", [JUMP_S, 1.3, 5.0])
def test_missing_samples_are_no_jump(walk, seconds):
    lost, readings, shares = round(seconds * RATE_HZ), walk.drop(columns="time").to_numpy(), []
    for row in range(300, len(walk) - lost - 300, 40):
        kept = np.delete(np.arange(len(walk)), slice(row, row + lost))
        shares += jumps(walk.time.to_numpy()[kept], readings[kept], 1.0 / RATE_HZ, 1.0 / RATE_HZ).values()
    assert len(shares) > 10
    assert np.mean(np.array(shares) <= AS_SMOOTH) < 0.05


def test_where_it_is_not_clear_a_jump_is_noted_as_possible(walk, monkeypatch):
    monkeypatch.setattr("jgait.io.clock.AS_SMOOTH", -1.0)
    found = read(moved(walk, middle(walk), 2.5))
    notes = {note.code: note for note in found.notes}
    assert "gaps_filled" in notes
    assert notes["clock_may_jump"].values["seconds"] == pytest.approx(2.5, abs=1e-6)


def test_samples_that_arrive_late_are_no_jump(walk):
    row, late = middle(walk), np.zeros(len(walk))
    late[row : row + 200] = 0.9 * (np.linspace(1.0, 0.0, 200))
    found = read(walk.assign(time=walk.time + late))
    assert not {"clock_jumps", "clock_may_jump"} & {note.code for note in found.notes}


@pytest.mark.parametrize("seconds", [0.1, 0.3, 2.0])
@pytest.mark.parametrize("samples", [0.0, 0.5])
@pytest.mark.parametrize("kind", ["stable", "quicksort"])
def test_rows_of_two_times_that_were_sorted_are_refused(walk, seconds, samples, kind):
    back = (round(seconds * RATE_HZ) + samples) / RATE_HZ
    with pytest.raises(RecordingError, match="rows of two times alternate, as after sorting rows whose clock stepped"):
        read(moved(walk, middle(walk), -back).sort_values("time", kind=kind))


def test_a_clock_that_steps_back_where_readings_do_not_go_on_is_refused_with_the_right_advice(walk):
    row = middle(walk)
    joined = pd.concat([walk.iloc[:row], walk.iloc[row - 250 :]])
    with pytest.raises(RecordingError, match="another recording begins: split the recording there, and do not sort"):
        read(joined)
    shuffled = walk.iloc[np.random.default_rng(0).permutation(len(walk))]
    halves = pd.concat([walk.iloc[row:], walk.iloc[:row]])
    for table in (shuffled, halves):
        with pytest.raises(RecordingError, match="the rows are in disorder: sort them by time"):
            read(table)
