"""Docstrings of jgait as Markdown: Google's sections stay, the others and numbered lists are put as headings and text.

jgait's docstrings have sections that Google's style does not know (Sensors, Outputs, Deviations from the paper), whose
bodies are indented. Markdown would take them for the rest of a paragraph.
"""

import ast
import inspect
import re
import textwrap
from pathlib import Path
from typing import Any

import griffe

GOOGLE = ("Args", "Attributes", "Raises", "Yields", "Examples", "Example")
"""Sections that griffe renders as they are."""

INDENT = "    "


def cleaned(path: Path) -> str:
    """The docstring of a module, read and not imported."""
    return ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""


def blocks(text: str) -> list[tuple[list[str], list[str]]]:
    """Paragraphs, each with the indented lines that follow it without an empty line; alone, where there are none."""
    found: list[tuple[list[str], list[str]]] = []
    fenced = False
    fresh = True
    for line in text.splitlines():
        fenced ^= line.startswith("```")
        if not line.strip():
            if found and found[-1][1]:
                found[-1][1].append("")  # within a section, unless what follows is not indented
            fresh = True
        elif line.startswith(INDENT) and not fenced and found and (found[-1][1] or not fresh):
            found[-1][1].append(line)
            fresh = False
        else:
            if fresh or (found and found[-1][1]):
                found.append(([], []))
            found[-1][0].append(line)
            fresh = False
    return found


def numbered(lines: list[str]) -> str:
    """An indented body as Markdown: dedented, each numbered point a paragraph that keeps its number."""
    body = inspect.cleandoc("\n".join(lines))
    points = re.compile(r"^(\d+)\. ", re.MULTILINE)
    if points.match(body):
        body = re.sub(r"^ +", "", points.sub(r"\n**\1.** ", body), flags=re.MULTILINE).strip()
    return body


def sections(text: str) -> tuple[str, dict[str, str]]:
    """What a module's docstring says before its sections, and the sections: title up to a comma → Markdown."""
    intro: list[str] = []
    named: dict[str, str] = {}
    for head, body in blocks(text):
        title = re.match(r"([A-Z][\w ]*)", head[0])
        told = "\n".join(head)
        if body and title and told.endswith(":"):
            rest = told[title.end() :]
            about = rest.strip(" ,;:")
            lead = f"{about[:1].upper()}{about[1:]}:\n\n" if about and rest[0] in ",;" else ""
            named[title[1].strip()] = lead + numbered(body)
        elif alone := re.match(r"(Source|Cost|Sensors|Parameters without a gradient): ", told):
            rest = told[alone.end() :]
            named[alone[1]] = rest[:1].upper() + rest[1:]
        elif not named:
            intro.append("\n".join(head + body))
        else:
            last = list(named)[-1]
            named[last] += "\n\n" + "\n".join(head + body)
    return "\n\n".join(intro), named


def rendered(text: str) -> str:
    """A whole docstring as griffe and Markdown understand it."""
    parts = []
    for head, body in blocks(text):
        told = "\n".join(head)
        if not body or not told.endswith(":") or told[:-1] in GOOGLE:
            while body and not body[-1]:
                body.pop()
            parts.append("\n".join(head + body))
            continue
        title = told if len(told) > 60 or "\n" in told else f"**{told[:-1]}**"
        parts.append(f"{title}\n\n{numbered(body)}")
    return "\n\n".join(parts)


def with_defaults(text: str, defaults: dict[str, str]) -> str:
    """A record's docstring that says the default of each attribute which has one."""
    lines, inside, name = [], False, ""
    for line in [*text.splitlines(), ""]:
        new = re.match(rf"^{INDENT}(\w+): ", line) if inside else None
        if name and (new or not line.strip()):
            lines[-1] += f" Default: `{defaults[name]}`."
            name = ""
        if new and new[1] in defaults:
            name = new[1]
        inside = line == "Attributes:" or (inside and (not line.strip() or line.startswith(INDENT)))
        lines.append(line)
    return "\n".join(lines[:-1])


def declarations(source: str) -> dict[str, tuple[str, str]]:
    """Of a class of parameters: field → its type, and what `jgait.params.Parameter` declares of it as a line."""
    found = {}
    for field in ast.parse(textwrap.dedent(source)).body[0].body:
        hint = getattr(field, "annotation", None)
        if not (isinstance(hint, ast.Subscript) and ast.unparse(hint.value) == "Annotated"):
            continue
        kind, declared = hint.slice.elts
        if isinstance(declared, ast.Call) and ast.unparse(declared.func) == "Parameter":
            span, unit, meaning = declared.args[:3]
            told = f"{meaning.value} [{unit.value}]; {ast.unparse(span)}." if unit.value else f"{meaning.value}."
            found[field.target.id] = (ast.unparse(kind), told)
        elif isinstance(declared, ast.Subscript):
            found[field.target.id] = (ast.unparse(kind), "as of the filters' own parameters.")
    return found


class Sections(griffe.Extension):
    """Rewrites every docstring that griffe loads."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Called once for each object; aliases have the docstring of what they stand for."""
        del kwargs
        if obj.docstring and not obj.is_class:
            obj.docstring.value = rendered(obj.docstring.value)

    def on_class(self, *, cls: griffe.Class, **kwargs: Any) -> None:
        """Called once for each class, its members known: defaults of a record are those of its attributes."""
        del kwargs
        declared = declarations(cls.source) if "Annotated[" in cls.source else {}
        for name, (kind, _) in declared.items():
            cls.attributes[name].annotation = kind
        if cls.docstring and declared:
            listed = "\n".join(f"{INDENT}{name}: {told}" for name, (_, told) in declared.items())
            cls.docstring.value += f"\n\nAttributes:\n{listed}"
        if cls.docstring:
            values = {name: one.value for name, one in cls.attributes.items() if one.value is not None}
            defaults = {name: str(value) for name, value in values.items() if len(str(value)) < 40}
            cls.docstring.value = rendered(with_defaults(cls.docstring.value, defaults))
