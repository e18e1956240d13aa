"""What `jgait estimate` prints about recordings whose numbers are in doubt: the flags of the page, in words."""

from collections.abc import Sequence

from jgait.commands.console import console, visible
from jgait.report.flags import verdict
from jgait.report.page import GRADES, Flag

STYLES = {"stop": "bold red", "check": "yellow"}
"""Grade of a flag → its style in the terminal."""


def doubt_row(flags: Sequence[Flag]) -> list[list[str]]:
    """The row of the printed table about the flags that put a recording in doubt; none without such flags."""
    if not flags:
        return []
    stop = sum(flag.grade == "stop" for flag in flags)
    return [["doubts", f"{len(flags)}, see below" if not stop else "not usable, see below"]]


def say_doubts(label: str, flags: Sequence[Flag]) -> None:
    """Print the verdict about a recording, and each flag with its meaning."""
    console.print(visible(f"\n{label}: {verdict(flags)}"), style="bold", highlight=False, soft_wrap=True)
    for flag in flags:
        for line in flag.text.splitlines():
            console.print(visible(f"  {GRADES[flag.grade]}: {line}"), style=STYLES[flag.grade], highlight=False,
                          soft_wrap=True)  # fmt: skip
        console.print(visible(f"    {flag.meaning}"), highlight=False, soft_wrap=True)
