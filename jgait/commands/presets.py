"""`jgait presets`: the tuned parameters that come with jgait, and those that `jgait tune --preset` wrote."""

from jgait import io
from jgait.commands.console import say, show
from jgait.report.page import significant


def presets() -> None:
    """List the tuned parameters that come with jgait, and those of `jgait tune --preset`; any command takes them by
    `--params preset:NAME`.
    """
    rows = []
    for name in io.preset_names():
        estimator, made = io.made_of(f"preset:{name}")
        held = made["held_out"]
        what = f"{held['error']} [{held['unit']}], median of {held['n']} {made.get('left_out', 'people')}"
        errors = (significant(held["before"]), significant(held["after"]))
        rows.append((name, made.get("version", ""), estimator, made["loss"], made["cohort"], what, *errors))
    if not rows:
        say("none come with this version: no tuned parameters were better than the defaults on walks left out")
        return
    headings = ("preset", "version", "estimator", "loss", "tuned on", "error of data left out", "before", "after")
    show(*headings, rows=rows, left=6)
