"""Progress bars: the time left; lines where there is no terminal."""

import io

from rich.console import Console

from jgait.commands import console


def test_without_a_terminal_a_line_states_the_progress_from_time_to_time(monkeypatch):
    text, clock = io.StringIO(), [0.0]
    monkeypatch.setattr(console, "errors", Console(file=text, force_terminal=False, width=120))
    made = console.progress()
    made.get_time = lambda: clock[0]
    bar = console.Bar(made)
    for seconds, done in ((1.0, 1), (21.0, 2), (30.0, 3), (45.0, 4)):
        clock[0] = seconds
        bar("step [loss 3]", done, 50)
    clock[0] = 90.0
    bar("compiling", 0, None)
    bar.begin("judging")
    assert text.getvalue().splitlines() == ["step [loss 3]: 2 of 50", "step [loss 3]: 4 of 50", "compiling", "judging"]


def test_names_in_a_narrow_table_are_whole(monkeypatch):
    text = io.StringIO()
    monkeypatch.setattr(console, "console", Console(file=text, width=30))
    console.show("recording", "value", rows=[(f"data_TimeMeasure1_Test5_Trial{number}", "1.0 m") for number in (1, 2)])
    whole = "".join(line.split("│")[1].strip() for line in text.getvalue().splitlines() if "│" in line)
    assert whole == "data_TimeMeasure1_Test5_Trial1data_TimeMeasure1_Test5_Trial2"


def test_a_reason_is_printed_once_for_all_recordings_that_have_it(monkeypatch):
    text = io.StringIO()
    monkeypatch.setattr(console, "errors", Console(file=text, force_terminal=False, width=120))
    reasons = ["needs 'foot_right'", "[empty]", "needs 'foot_right'", "needs 'foot_right'", "[empty]", "a", "b"]
    console.say_failures([(f"{i}.csv", reason) for i, reason in enumerate(reasons)], most=3)
    assert text.getvalue().splitlines() == [
        "0.csv and 2 others: needs 'foot_right'", "1.csv and 1 other: [empty]", "5.csv: a", "… and 1 more reason"
    ]  # fmt: skip
