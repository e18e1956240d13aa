"""What ablation calls a rule without effect."""

import sys
import types

import numpy as np

from experiments.ablation.lines import lines_of
from experiments.ablation.rules import Outcome, branches, codes, constants, moved, scaled, tried

SOURCE = """
LIMIT, SIZES, COUNT = 2.0, (1.0, 3.0), 4


def halved(value):
    if value > LIMIT:
        value = value / 2.0
    if value < 0.0:
        raise ValueError("negative")
    return value if value else 1.0
"""


def test_branches_are_left_out_and_constants_moved_one_at_a_time_and_put_back(tmp_path, monkeypatch):
    path = tmp_path / "jgait_toy.py"
    path.write_text(SOURCE)
    toy = types.ModuleType("jgait_toy")
    toy.__file__ = str(path)
    exec(compile(SOURCE, str(path), "exec"), vars(toy))
    monkeypatch.setitem(sys.modules, "jgait_toy", toy)
    left_out = {change.what: change for change in branches(path)}
    assert set(left_out) == {"never: value > LIMIT", "never: value"}  # what refuses stays
    with tried(left_out["never: value > LIMIT"], 1.0):
        assert toy.halved(8.0) == 8.0
    with tried(left_out["never: value"], 1.0):
        assert toy.halved(1.0) == 1.0 and toy.halved(8.0) == 1.0
    moves = {change.name: change for change in constants(path)}
    assert set(moves) == {"LIMIT", "SIZES", "COUNT"}
    assert moves["LIMIT"].lines == {6}
    with tried(moves["LIMIT"], 10.0) as possible:
        assert possible and toy.halved(8.0) == 8.0
    assert toy.halved(8.0) == 4.0 and toy.LIMIT == 2.0
    assert scaled((1.0, 3.0), 2.0) == (2.0, 6.0) and scaled(4, 1.3) == 5 and scaled("no", 2.0) is None
    assert lines_of(path) == {6, 7, 8, 9, 10}
    assert [name for name, _ in codes(compile(SOURCE, "x", "exec"))] == ["halved"]


def test_a_change_of_a_number_counts_before_one_of_notes():
    before = Outcome({".x": np.array([1.0, np.nan])}, ("a",))
    assert moved(before, before._replace(numbers={".x": np.array([1.0 + 1e-9, np.nan])})) == ""
    assert moved(before, before._replace(notes=())) == "notes"
    assert moved(before, Outcome({".x": np.array([1.1, np.nan])}, ())) == "numbers"
    assert moved(before, Outcome({}, ("a",))) == "numbers"
