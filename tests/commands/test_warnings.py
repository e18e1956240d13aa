"""Doubts about recordings of a cohort: counts, the gravest kinds first, and nothing for a cohort without any."""

import pandas as pd
import pytest

from jgait.commands.console import say_flags
from jgait.evaluate.clocks import REFERENCE_OTHER
from jgait.mounting.leg import STANDING_MOVES
from jgait.notes import AS_READ, WRONG_PLACE, Kind, to_json
from jgait.report.cohort import of_notes

UPSIDE_DOWN = Kind("upside_down", "check", "{placement} is upside down", WRONG_PLACE)
NO_LEGS = Kind("no_legs", "stop", "no legs move", "Nobody walks.")
ORIGINS = Kind("origin", "info", "made today", AS_READ.meaning)


@pytest.fixture
def said(capsys):
    def say(rows):
        names, notes = rows.keys(), map(to_json, rows.values())
        say_flags(of_notes(pd.DataFrame({"recording": names, "notes": list(notes)})), "in the table")
        return capsys.readouterr().err.strip().splitlines()

    return say


def test_grave_kinds_come_before_common_ones_and_those_that_all_errors_depend_on_first(said):
    assert said({"a.csv": [], "b.csv": [ORIGINS()]}) == []
    moves, other = STANDING_MOVES(side="right", rate=0.3), REFERENCE_OTHER(what="contacts", seconds=5.0)
    down = [UPSIDE_DOWN(placement=f"shank_{side}") for side in ("right", "left")]
    rows = {"a.csv": [moves, ORIGINS()], "b.csv": [moves, *down], "c.csv": [moves, down[1], NO_LEGS()], "d.csv": []}
    lines = [
        "Check: 1 of 4 recordings, whose result should not be used, such as c.csv: No legs move",
        "Check: 2 of 4 recordings, such as b.csv: shank_right is upside down; shank_left is upside down",
        f"Check: 3 of 4 recordings, such as a.csv: {str(moves)[:1].upper()}{str(moves)[1:]}",
        "all sentences: in the table",
    ]
    assert said(rows) == lines
    assert said({**rows, "d.csv": [other]})[1] == "Check: 1 of 4 recordings, such as d.csv: Contacts" + str(other)[8:]
