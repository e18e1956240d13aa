"""Rows of a table that seem to be one person, one day or one recording."""

import numpy as np
import pandas as pd
import pytest

from jgait.commands.rows import copies_among, label_notes


@pytest.mark.parametrize(
    ("column", "labels", "alike"),
    [
        ("subject", ["01", "1", "1.0", "2"], "'01', '1', '1.0' in the column 'subject' count as different people"),
        ("day", ["1.5.2026", "01.05.2026"], "'1.5.2026', '01.05.2026' in the column 'day' count as different days"),
        ("day", ["2026-05-01", "1.5.2026", ""], "days are written in several ways, such as '2026-05-01', '1.5.2026'"),
    ],
)  # fmt: skip
def test_labels_that_look_alike_are_noted(column, labels, alike):
    assert [note.text for note in label_notes({column: label} for label in labels)] == [alike]


@pytest.mark.parametrize(
    ("column", "labels"),
    [
        ("subject", ["1", "10", "100", "2", "20"]),
        ("subject", ["1.1", "1.10", "1.01"]),
        ("day", ["2026-05-01", "2026-05-02", "2026-12-31"]),
        ("day", ["before", "week 12", "1"]),
    ],
)
def test_labels_that_differ_are_not_noted(column, labels):
    assert label_notes({column: label} for label in labels) == []


def signals(seed, samples=200):
    rng = np.random.default_rng(seed)
    moves = pd.DataFrame(rng.normal(size=(samples, 6)), columns=list("abcdef"))
    return moves.assign(time=np.arange(samples) * 0.01)[["time", *"abcdef"]]


def files(tmp_path, **tables):
    paths = {}
    for name, table in tables.items():
        paths[name] = tmp_path / f"{name}.csv"
        table.to_csv(paths[name], index=False)
    return paths


@pytest.mark.parametrize(
    ("change", "rounded"),
    [
        (lambda table: table, ""),
        (lambda table: table.round(2).rename(columns={"a": "x"}), ", with numbers rounded or written otherwise"),
        (lambda table: 9.81 * table.round(1), ", with numbers rounded or written otherwise"),
    ],
)
def test_copies_are_noted_by_their_names(tmp_path, change, rounded):
    found = copies_among(files(tmp_path, a=signals(0), b=signals(1), c=change(signals(0)), d=change(signals(0))))
    assert [copy.note.text for copy in found] == [f"{name} and a hold the same recording{rounded}" for name in "cd"]


def test_other_recordings_are_no_copies(tmp_path):
    still = signals(0).round(0) * 0.0
    paths = files(tmp_path, a=signals(0), b=signals(1), c=signals(0, 199), d=still, e=still + 0.3)
    assert copies_among(paths | {"g": tmp_path / "nowhere.csv"}) == []
    (tmp_path / "x.bin").write_bytes(bytes(range(256)))
    (tmp_path / "y.bin").write_bytes(bytes(range(255)) + b"\n")
    assert copies_among({name: tmp_path / f"{name}.bin" for name in "xy"}) == []


def test_folders_of_sensors_are_compared_as_wholes(tmp_path):
    for name, seeds in (("a", (0, 1)), ("b", (0, 1)), ("c", (0, 2))):
        (tmp_path / name).mkdir()
        files(tmp_path / name, thigh=signals(seeds[0]), shank=signals(seeds[1]))
    found = copies_among({name: tmp_path / name for name in "abc"})
    assert [copy.note.text for copy in found] == ["b and a hold the same recording"]
