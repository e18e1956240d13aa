"""Pieces that pages show without copying them: parts of docstrings, tables of accuracy, what the library prints."""

import re
from pathlib import Path
from typing import Any

import docstrings
import typer

from jgait import cli, estimators
from jgait.io.formats import registry

ROOT = Path(__file__).parents[2]


def accuracy(experiment: str, wanted: str = "") -> str:
    """The rows of the table that an experiment makes, and its name; with `wanted`, a pattern of their first cell.

    Raises:
        ValueError: if there is none.
    """
    text = (ROOT / "experiments" / "README.md").read_text(encoding="utf-8")
    rows = [line.rpartition(" | ")[::2] for line in re.findall(r"^(\|.*) \|$", text, re.MULTILINE)]
    own = [row for row, made_by in rows if made_by == f"`{experiment}`" and re.search(wanted, row.split("|")[1])]
    if not own:
        raise ValueError(f"the table of experiments/README.md has no row of {experiment} with {wanted!r}")
    head = [row for row, _ in rows[:2]]
    return "\n".join([*(f"{row} |" for row in [*head, *own]), "", f"Measured by the experiment `{experiment}`."])


def methods() -> str:
    """A table of the estimators: what each gives, the columns of a recording that it needs, and its source."""
    lines = ["| estimator | gives | needs | after |", "|---|---|---|---|"]
    for name in estimators.names():
        one = estimators.get(name)
        page = one.run.__module__.split(".")[2]
        lines.append(f"| [{name}]({page}.md) | {one.about.title} | {one.about.needs} | {one.about.source} |")
    return "\n".join(lines)


def command_line() -> str:
    """What `--help` of every command says."""

    def helps(command: Any, name: str, parent: Any = None) -> list[str]:
        context = command.make_context(name, [], parent=parent, resilient_parsing=True)
        context.terminal_width = context.max_content_width = 80
        found = [f"## `{context.command_path}`\n\n```text\n{command.get_help(context).rstrip()}\n```"]
        for one in command.list_commands(context) if hasattr(command, "list_commands") else ():
            found += helps(command.get_command(context, one), one, context)
        return found

    return "\n\n".join(helps(typer.main.get_command(cli.app), "jgait"))


def formats() -> str:
    """A table of the formats that are read, and of files that other functions read."""
    lines = ["| format | files | what file or format states | reader |", "|---|---|---|---|"]
    for one in registry.FORMATS.values():
        files = re.sub(r"[\w*]*\.\w+", r"`\g<0>`", one.files)
        lines.append(f"| {one.title} | {files} | {one.states} | [`{one.module}`](#jgait.io.formats.{one.module}) |")
    lines += ["", "Other files have functions of their own:", ""]
    return "\n".join([*lines, *(f"- `*{ending}`: {reader}" for ending, reader in registry.OTHERS.items())])


PARTS = {
    "accuracy": accuracy,
    "docstring": docstrings.part,
    "methods": methods,
}
"""What may stand alone on a line of a page: `{{ name argument … }}`."""

WRITTEN = {"command-line.md": command_line, "formats.md": formats}
"""Page → the piece that stands in it between two comments, so that it is there without the site, too."""


def page(name: str) -> str:
    """A page of `WRITTEN` with its piece as it is now."""
    text = (ROOT / "docs" / name).read_text(encoding="utf-8")
    begin, end = "<!-- made by docs/_ext/sources.py -->\n", "<!-- until here -->\n"
    before, _, rest = text.partition(begin)
    return f"{before}{begin}\n{WRITTEN[name]()}\n\n{end}{rest.partition(end)[2]}"


if __name__ == "__main__":
    for name in WRITTEN:
        (ROOT / "docs" / name).write_text(page(name), encoding="utf-8")
