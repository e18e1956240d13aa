"""Docstrings of jgait are Markdown with sections: a line that ends with a colon, and what is indented under it."""

import importlib
import inspect
import re
import textwrap

SECTION = re.compile(r"^(\S[^\n]*):\n( {4}[^\n]*\n(?: {4}[^\n]*\n|\n(?= {4}))*)", re.MULTILINE)
FIELD = re.compile(r"^([^\s:][^:\n]*): ", re.MULTILINE)


def markdown(docstring: str) -> str:
    """A docstring with titles for its sections; sections of fields, such as arguments, become lists."""

    def titled(found: re.Match[str]) -> str:
        body = textwrap.dedent(found[2])
        if all(line[:1] in ("", " ") or FIELD.match(line) for line in body.splitlines()):
            body = FIELD.sub(lambda name: f"- `{name[1].replace('`', '')}`: ", body)
        return f"**{found[1]}**\n\n{body}\n"

    return SECTION.sub(titled, f"{docstring}\n")


def part(module: str, title: str = "") -> str:
    """What a module's docstring says before its sections, or in the section of a title.

    Raises:
        ValueError: if there is no such section.
    """
    text = inspect.getdoc(importlib.import_module(module)) or ""
    if not title:
        return re.split(r"\n\n(?=Source: |[A-Z][\w ]*:\n)", text)[0]
    for name, body in SECTION.findall(f"{text}\n") + re.findall(r"^([A-Z][\w ]*): ((?:.+\n)+)", f"{text}\n", re.M):
        if name == title:
            return textwrap.dedent(body[:1].upper() + body[1:])
    raise ValueError(f"the docstring of {module} has no section {title!r}")


def summary(docstring: str | None) -> str:
    """The first paragraph, for a cell of a table."""
    return " ".join((docstring or "").split("\n\n")[0].split()).replace("|", "\\|")
