"""`jgait presets`: the tuned parameters that come with jgait, and those that `jgait tune --preset` wrote."""

from jgait import io
from jgait.commands.console import console, table_of, visible
from jgait.report.page import significant


def presets() -> None:
    """List the tuned parameters that come with jgait, and those of `jgait tune --preset`; any command takes them by
    `--params preset:NAME`.
    """
    if not io.preset_names():
        console.print(
            "none come with this version: no tuned parameters were better than the defaults on walks left out"
        )
        return
    shown = table_of(
        "preset", "version", "estimator", "loss", "tuned on", "error of data left out", "before", "after", left=6
    )
    for name in io.preset_names():
        estimator, made = io.made_of(f"preset:{name}")
        held = made["held_out"]
        what = f"{held['error']} [{held['unit']}], median of {held['n']} {made.get('left_out', 'people')}"
        cells = (name, str(made.get("version", "")), estimator, made["loss"], made["cohort"], what)
        shown.add_row(*map(visible, cells), significant(held["before"]), significant(held["after"]))
    console.print(shown)
