"""Rows of a table that seem to be one person, one day or one recording."""

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


def test_copies_are_noted_by_their_names(tmp_path):
    files = {"a": b"0,1\n", "b": b"0,2\n", "c": b"0,1\n", "d": b"0,1\n"}
    for name, content in files.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "thigh.csv").write_bytes(content)
        (tmp_path / name / "shank.csv").write_bytes(b"0,3\n")
    paths = {name: tmp_path / name for name in files} | {f"{name}.csv": tmp_path / name / "thigh.csv" for name in files}
    found = [note.text for note in copies_among(paths | {"gone": tmp_path / "nowhere.csv"})]
    assert found == [f"{name}{end} and a{end} hold the same recording" for end in ("", ".csv") for name in "cd"]
