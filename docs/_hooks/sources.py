"""Pieces of the checkout that pages show without copying them: sections of the README, tables, what programs print."""

import json
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]

_PRINT = """
import json, typer
from jgait import cli, estimators
from jgait.io.formats import registry

def told(command, name, parent=None):
    context = command.make_context(name, [], parent=parent, resilient_parsing=True)
    context.terminal_width = context.max_content_width = 80
    found = [(context.command_path, command.get_help(context))]
    for one in command.list_commands(context) if hasattr(command, "list_commands") else ():
        found += told(command.get_command(context, one), one, context)
    return found

formats = [(one.title, one.files, one.states, one.module) for one in registry.FORMATS.values()]
others = list(getattr(registry, "OTHERS", {}).items())
methods = []
for name in estimators.names():
    one = estimators.get(name)
    methods.append((name, one.run.__module__.split(".")[2], one.about.title, one.about.needs, one.about.source))
print(json.dumps([told(typer.main.get_command(cli.app), "jgait"), formats, others, methods]))
"""


def local_links_as_text(markdown: str) -> str:
    """Links to files of the checkout, which the site does not have, as their words alone."""
    return re.sub(r"\[([^\]]+)\]\((?!https?:|#)[^)]*\)", r"\1", markdown)


def readme(heading: str) -> str:
    """What stands under a heading of the README.

    Raises:
        ValueError: if it has no such heading.
    """
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    found = re.search(rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", text, re.DOTALL | re.MULTILINE)
    if found is None:
        raise ValueError(f"README.md has no heading {heading!r}, which a page of the documentation shows")
    return local_links_as_text(found[1].strip("\n"))


def rows() -> tuple[list[str], list[list[str]]]:
    """The table of all experiments: its two head lines, and the cells of every row."""
    text = (ROOT / "experiments" / "README.md").read_text(encoding="utf-8")
    found = re.search(r"^(\|[^\n]*\| experiment \|)\n(\|[ |:-]+\|)\n((?:\|.*\n)+)", text, re.MULTILINE)
    if found is None:
        raise ValueError("experiments/README.md has no table whose last column is 'experiment'")
    return [found[1], found[2]], [line.split("|")[1:-1] for line in found[3].splitlines()]


def accuracy(experiment: str, wanted: str = "") -> str:
    """The rows of the table that an experiment makes, and its name; with `wanted`, a pattern of their first cell.

    Raises:
        ValueError: if there is none.
    """
    head, every = rows()
    own = [row for row in every if f"`{experiment}`" in row[-1] and re.search(wanted, row[0])]
    if not own:
        raise ValueError(f"the table of experiments/README.md has no row of {experiment} with {wanted!r}")
    cells = [line.split("|")[1:-1] for line in head] + own
    table = "\n".join("|" + "|".join(row[:-1]) + "|" for row in cells)
    return f"{table}\n\nMeasured by the experiment `{experiment}`."


def experiments() -> str:
    """The table of all experiments and its introduction, without the title."""
    text = (ROOT / "experiments" / "README.md").read_text(encoding="utf-8").split("\n", 1)[1]
    return local_links_as_text(text.strip())


@cache
def _printed() -> list[list[list[str]]]:
    """What the library prints: the help of each command, formats, other files and their readers, and estimators."""
    done = subprocess.run([sys.executable, "-c", _PRINT], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"commands, formats and estimators cannot be read from the library:\n{done.stderr}")
    printed: list[list[list[str]]] = json.loads(done.stdout)
    return printed


def pages_of_methods() -> list[str]:
    """A page for each package of `jgait.estimators`, in the order of its estimators."""
    return list(dict.fromkeys(f"methods/{package}.md" for _, package, *_ in _printed()[3]))


def methods() -> str:
    """A table of the estimators: what each gives, the columns of a recording that it needs, and its source."""
    lines = ["| estimator | gives | needs | after |", "|---|---|---|---|"]
    for name, package, *cells in _printed()[3]:
        lines.append(f"| [{name}]({package}.md) | {' | '.join(cells)} |")
    return "\n".join(lines)


def command_line() -> str:
    """What `--help` of every command says."""
    return "\n\n".join(f"## `{path}`\n\n```text\n{text.rstrip()}\n```" for path, text in _printed()[0])


def formats() -> str:
    """A table of the formats that are read, and of files that other functions read."""
    _, every, others, _ = _printed()
    lines = ["| format | files | what file or format states | reader |", "|---|---|---|---|"]
    for title, files, states, module in every:
        files = re.sub(r"[\w*]*\.\w+", r"`\g<0>`", files)
        lines.append(f"| {title} | {files} | {states} | [`{module}`][jgait.io.formats.{module}] |")
    if others:
        lines += ["", "Other files have functions of their own:", ""]
        lines += [f"- `*{ending}`: {told}" for ending, told in others]
    return "\n".join(lines)
