"""The warnings of a cohort: counts, the gravest kinds first, and nothing for a cohort without any."""

import jax
import pandas as pd
import pytest
from made.command import run

from experiments.common import protocols
from jgait import io
from jgait.commands import warnings
from jgait.commands.warnings import say_warnings
from jgait.estimators.leg_ekf.notes import STANDING_MOVES
from jgait.evaluate.clocks import REFERENCE_OTHER
from jgait.notes import ORIGIN, WRONG_PLACE, Kind, to_json

UPSIDE_DOWN = Kind("upside_down", "check", "{placement} is upside down", WRONG_PLACE)
NO_LEGS = Kind("no_legs", "stop", "no legs move", WRONG_PLACE)
ORIGINS = Kind("origin", "info", "made today", ORIGIN)


@pytest.fixture
def said(capsys):
    def say(rows):
        say_warnings([(name, to_json(notes)) for name, notes in rows.items()], "in the table")
        return capsys.readouterr().err.strip().splitlines()

    return say


def test_no_warnings_are_no_lines(said):
    assert said({"a.csv": [], "b.csv": [ORIGINS()]}) == []


def test_grave_kinds_come_before_common_ones(said):
    moves = STANDING_MOVES(side="right", rate=0.3)
    down = [UPSIDE_DOWN(placement=f"shank_{side}") for side in ("right", "left")]
    rows = {"a.csv": [moves, ORIGINS()], "b.csv": [moves, *down], "c.csv": [moves, down[1], NO_LEGS()], "d.csv": []}
    assert said(rows) == [
        "3 of 4 recordings have warnings; the results of 1 should not be used:",
        "  do not use the result, 1 recording, such as c.csv: no legs move",
        "  check, 2 recordings, such as b.csv: shank_right is upside down; shank_left is upside down",
        f"  check, 3 recordings, such as a.csv: {moves}",
        "all sentences: in the table",
    ]


def test_few_kinds_and_no_long_sentence_are_printed(said):
    kinds = [Kind(f"kind_{number}", "check", f"{number} {'x' * 400}", WRONG_PLACE) for number in range(7)]
    lines = said({"a.csv": [kind() for kind in kinds]})
    assert lines[0] == "1 of 1 recording has warnings:"
    assert len(lines) == 2 + warnings.MOST_KINDS
    assert all(len(line) < 260 for line in lines[1:-1])
    assert lines[-1].startswith("2 more kinds, and all sentences: ")


def test_a_wrong_reference_of_one_recording_is_among_the_kinds_that_are_printed(said):
    kinds = [Kind(f"kind_{number}", "check", f"{number}", WRONG_PLACE)() for number in range(warnings.MOST_KINDS)]
    other = REFERENCE_OTHER(what="contacts", seconds=5.0)
    lines = said({"a.csv": kinds, "b.csv": [*kinds, other], "c.csv": [NO_LEGS()]})
    assert lines[1].endswith("no legs move")
    assert lines[2] == f"  check, 1 recording, such as b.csv: {other}"


def test_a_damaged_walk_of_a_cohort_is_named(tmp_path):
    for number, one in enumerate(protocols.bennett(jax.random.key(7), 2)):
        walk = io.recording_to_dataframe(one.recording)
        if number:
            walk[[name for name in walk if name.startswith("thigh_right_gyr")]] *= 2.0
        walk.to_csv(tmp_path / f"walk{number}.csv")
    pd.DataFrame({"file": ["walk0.csv", "walk1.csv"]}).to_csv(tmp_path / "cohort.csv", index=False)
    code, printed = run("evaluate", tmp_path / "cohort.csv", "--paper", "--out", tmp_path / "out")
    assert code == 0, printed
    assert "of 2 recordings have warnings" in printed
    assert "check, 1 recording, such as walk1.csv: thigh_right turns" in printed
    assert "walk0.csv: thigh_right turns" not in printed
    assert printed.index("walk1.csv: thigh_right turns") < printed.index("samples are missing")
    assert f"jgait report {tmp_path / 'out'}" in printed
