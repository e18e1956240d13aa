"""Pages that are made, one for each module of jgait and each notebook, and `{{ name … }}` in pages that are written."""

import ast
import importlib
import inspect
import re
import shlex
from base64 import b64decode
from functools import cache
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import nbformat
from docstrings import markdown, summary
from docutils import nodes
from docutils.utils import new_document
from myst_parser.parsers.sphinx_ import MystParser
from sources import PARTS, ROOT
from sphinx.addnodes import desc_annotation
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.docutils import SphinxDirective
from sphinx.util.inspect import stringify_signature
from sphinx.util.typing import stringify_annotation

from jgait import types

# --- the API ---


@cache
def modules() -> dict[str, Path]:
    """Every public module by its dotted name, in the order of the alphabet."""
    found = {}
    for path in (ROOT / "jgait").rglob("*.py"):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        if "._" not in name:
            found[name] = path
    return dict(sorted(found.items()))


def place(name: str) -> str:
    """The page of a module."""
    folder = name.replace(".", "/").removeprefix("jgait/")
    return f"api/{folder}/index" if "." in name and modules()[name].name == "__init__.py" else f"api/{folder}"


@cache
def imported(name: str) -> dict[str, str]:
    """Names that a module takes from other modules of jgait → full names there."""
    taken = [one for one in ast.walk(ast.parse(modules()[name].read_text("utf-8"))) if isinstance(one, ast.ImportFrom)]
    own = [one for one in taken if f"{one.module}.".startswith("jgait.")]
    return {name.asname or name.name: f"{one.module}.{name.name}" for one in own for name in one.names}


def origin(full: str) -> str:
    """Where a name is defined that a module may only pass on."""
    module, _, name = full.rpartition(".")
    return origin(imported(module)[name]) if module in modules() and name in imported(module) else full


def about(full: str) -> str | None:
    """The first paragraph of what is said of a name; None where nothing is."""
    module, _, name = full.rpartition(".")
    value = importlib.import_module(full) if full in modules() else getattr(importlib.import_module(module), name)
    if inspect.ismodule(value) or inspect.isroutine(value) or inspect.isclass(value):
        return summary(value.__doc__)
    said = ModuleAnalyzer.for_module(module).find_attr_docs().get(("", name))
    return summary("\n".join(said)) if said else None


def table(title: str, names: dict[str, str]) -> list[str]:
    """A section that lists names, by their full names, with what is said of them."""
    lines = [f"## {title}", "", "| name | what |", "|---|---|"] if names else []
    for name, full in names.items():
        said, target = about(full), f"/{place(full)}.md" if full in modules() else f"#{full}"
        lines.append(f"| `{name}` | |" if said is None else f"| [`{name}`]({target}) | {said} |")
    return [*lines, ""]


def tree(names: list[str]) -> list[str]:
    """A part of the navigation."""
    return ["```{toctree}", ":hidden:", "", *(f"{one.rpartition('.')[2]} </{place(one)}>" for one in names), "```", ""]


def page(name: str) -> str:
    """The page of a module: its docstring and its own names, the names that it passes on, and its modules."""
    public = getattr(importlib.import_module(name), "__all__", ())
    listed = {alias: origin(f"{name}.{alias}") for alias in public}
    children = [other for other in modules() if other.rpartition(".")[0] == name and name != "jgait"]
    inner = {other.rpartition(".")[2]: other for other in children}
    lines = [f"# {name}", "", "```{eval-rst}", f".. automodule:: {name}", "```", ""]
    return "\n".join([*lines, *table("Public names", listed), *table("Modules", inner), *tree(children)])


def index() -> str:
    """The first page of the API."""
    top = [name for name in modules() if name.count(".") <= 1]
    lines = ["# API", "", "Every public name, from its docstring.", ""]
    return "\n".join([*lines, *table("Modules", {name: name for name in top}), *tree(top)])


def bare(name: str) -> None:
    """Put plain functions in the place of those that JAX has wrapped: autodoc knows these alone."""
    module = importlib.import_module(name)
    for key, value in list(vars(module).items()):
        if hasattr(value, "__wrapped__") and not inspect.isfunction(value):
            setattr(module, key, inspect.unwrap(value))


class Markdown(SphinxDirective):
    """What autodoc hands on of a docstring."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """The docstring's paragraphs."""
        document = new_document("docstring", self.state.document.settings)
        MystParser().parse("\n".join(self.content), document)
        return document.children


def docstring(app: Sphinx, what: str, name: str, value: object, options: object, lines: list[str]) -> None:
    """Hand a docstring on as Markdown; fields of a tuple that are described where they stand follow as a list."""
    own = getattr(value, "_fields", ())
    described = ModuleAnalyzer.for_module(value.__module__).find_attr_docs() if what == "class" and own else {}
    fields = [
        f"    {field}: {' '.join(text).strip()}" for (of, field), text in described.items() if of == value.__name__
    ]
    lines += ["Attributes:", *fields, ""] if fields else []
    if any(lines):
        lines[:] = [".. markdown::", "", *(f"   {line}" for line in markdown("\n".join(lines)).splitlines()), ""]


def skipped(app: Sphinx, what: str, name: str, value: Any, skip: bool, options: object) -> bool | None:
    """Leave out fields of tuples, which their class lists, and commands, which have a page of their own."""
    field = type(value).__name__ == "_tuplegetter"
    return field or getattr(value, "__module__", None) == f"jgait.commands.{name}" or None


def signature(
    app: Sphinx, what: str, name: str, value: Any, options: object, arguments: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Types of arrays as `jgait.types` names them; fields without their declarations, which the text repeats."""
    if arguments and "Annotated[" in arguments:
        given = inspect.signature(value)
        kinds = [(one, one.annotation) for one in given.parameters.values()]
        fields = [one.replace(annotation=get_args(k)[0]) if get_origin(k) is Annotated else one for one, k in kinds]
        given = given.replace(parameters=fields, return_annotation=inspect.Signature.empty)
        arguments = stringify_signature(given, unqualified_typehints=True)

    def short(text: str | None) -> str | None:
        for alias in ("Values", "Flags", "Counts", "Scalar", "Integer"):
            text = text and text.replace(stringify_annotation(getattr(types, alias), "smart"), f"~jgait.types.{alias}")
        return text and re.sub(r"(~jaxtyping\.\w+\[)Array(, '[^']*'\]) \| \1ndarray\2", r"\1AnyArray\2", text)

    return short(arguments), short(returned)


def tidy(app: Sphinx, doctree: nodes.document) -> None:
    """Leave out values that say nothing: long ones, and those with functions in them."""
    for node in [node for node in doctree.findall(desc_annotation) if re.search("<|.{200}", node.astext())]:
        node.parent.remove(node)


# --- the gallery ---

GALLERY = """# Gallery

Notebooks of `notebooks/`, each run by the tests. Open one with Jupyter, or read it here.

```{toctree}
:hidden:
:glob:

*
```

::::{container} cards"""


NOT_RUN = "*This page has no outputs: the notebook was not run here, or its recordings are not on this computer.*"


def newest(path: Path, executed: Path) -> nbformat.NotebookNode:
    """A notebook with outputs if there is an executed copy with the same cells, else as it is, with a remark."""
    own = nbformat.read(path, as_version=4)
    other = nbformat.read(executed / path.name, as_version=4) if (executed / path.name).exists() else own
    newer = other if [cell.source for cell in other.cells] == [cell.source for cell in own.cells] else own
    if not any(cell.get("outputs") for cell in newer.cells):
        newer.cells.insert(1, nbformat.v4.new_markdown_cell(NOT_RUN))
    return newer


def card(name: str, notebook: nbformat.NotebookNode) -> tuple[str, bytes]:
    """The entry of a notebook in the gallery: title, first paragraph and first picture, and this picture."""
    title, first = notebook.cells[0].source.removeprefix("# ").split("\n\n")[:2]
    outputs = [one.get("data", {}) for cell in notebook.cells for one in cell.get("outputs", ())]
    picture = next((b64decode(data["image/png"]) for data in outputs if "image/png" in data), b"")
    shown = f"[![{title}]({name}.png)]({name}.ipynb)\n\n" if picture else ""
    return f":::{{container}} card\n**[{title}]({name}.ipynb)**\n\n{shown}{first}\n:::\n", picture


# --- what Sphinx calls ---


def written(folder: Path, pages: dict[str, bytes]) -> None:
    """Write the pages of a folder that have changed, and remove those that are no longer made."""
    for path in [path for path in folder.rglob("*") if path.is_file() and str(path.relative_to(folder)) not in pages]:
        path.unlink()
    for name, content in pages.items():
        path = folder / name
        if not path.exists() or path.read_bytes() != content:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)


def make(app: Sphinx) -> None:
    """Write the pages of modules and notebooks into the folder of the sources."""
    for name in modules():
        bare(name)
    pages = {"index.md": index(), **{f"{place(name).removeprefix('api/')}.md": page(name) for name in modules()}}
    written(Path(app.srcdir) / "api", {name: text.encode() for name, text in pages.items()})
    gallery, cards = {}, []
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        notebook = newest(path, ROOT / "build" / "notebooks")
        text, picture = card(path.stem, notebook)
        gallery[path.name] = nbformat.writes(notebook).encode()
        cards.append(text)
        if picture:
            gallery[f"{path.stem}.png"] = picture
    gallery["index.md"] = "\n".join([GALLERY, *cards, "::::"]).encode()
    written(Path(app.srcdir) / "gallery", gallery)


def filled(app: Sphinx, name: str, source: list[str]) -> None:
    """Put in what a page asks for."""

    def one(found: re.Match[str]) -> str:
        part, *arguments = shlex.split(found[1])
        return PARTS[part](*arguments)

    source[0] = re.sub(r"^\{\{ (.+?) \}\}$", one, source[0], flags=re.MULTILINE)


def outdated(app: Sphinx, env: BuildEnvironment, *changed: set[str]) -> list[str]:
    """Pages that ask for something are read again in every build."""
    return [name for name in env.found_docs if "\n{{ " in env.doc2path(name).read_text(encoding="utf-8")]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register what is made."""
    app.add_directive("markdown", Markdown)
    app.connect("builder-inited", make)
    app.connect("doctree-read", tidy)
    app.connect("env-get-outdated", outdated)
    app.connect("source-read", filled)
    app.connect("autodoc-process-docstring", docstring)
    app.connect("autodoc-process-signature", signature)
    app.connect("autodoc-skip-member", skipped)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
