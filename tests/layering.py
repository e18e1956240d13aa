"""The order in which the parts of the library may import each other, and what breaks it."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ORDER = (
    "notes", "types", "params", "geometry", "signal", "filtering", "events", "mounting", "duty_cycle",
    "quality", "estimators", "simulate", "tune", "evaluate", "io", "datasets", "plot", "report", "commands", "cli",
)  # fmt: skip
"""Files and folders of `jgait`, lowest first: each imports only from those before it."""


class Import(NamedTuple):
    """One import of a module of the library by another."""

    importer: str  #: dotted name of the module that imports.
    line: int  #: number of the line.
    imported: str  #: dotted name of the module, or of the package where the name comes from its `__init__`.


def modules(root: Path) -> dict[str, Path]:
    """Dotted name and file of every module of the library. A package's name is that of its `__init__`."""
    found = {}
    for path in sorted((root / "jgait").rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(root: Path) -> list[Import]:
    """Every import inside the library but that of its version: at the top, in functions, for type checkers only."""
    known = modules(root)
    found = set()
    for name, path in known.items():
        for line, module, attribute in _statements(name, path):
            inner = f"{module}.{attribute}"
            target = inner if inner in known else module
            if target in known and target != name and attribute != "__version__":
                found.add(Import(name, line, target))
    return sorted(found)


def upward(edges: list[Import]) -> list[Import]:
    """The imports that break `ORDER`. `jgait` itself is left out: its `__init__` names the public modules."""
    places = {name: place for place, name in enumerate(ORDER)}
    return [
        edge
        for edge in edges
        if edge.importer != "jgait" and places[_part(edge.importer)] < places.get(_part(edge.imported), len(ORDER))
    ]


def circles(edges: list[Import]) -> list[list[str]]:
    """The circles: for every folder, the groups of its files and folders that import each other in a ring.

    A folder counts as one box seen from outside, so two folders that need each other are a circle even where no two
    files are. A package's `__init__` is a box of its own inside its folder.
    """
    folders: dict[str, dict[str, set[str]]] = {}
    for edge in edges:
        importer, imported = edge.importer.split("."), edge.imported.split(".")
        shared = next((i for i, (a, b) in enumerate(zip(importer, imported, strict=False)) if a != b), None)
        depth = min(len(importer), len(imported)) if shared is None else shared
        folder = ".".join(importer[:depth])
        ends = [".".join([*names[: depth + 1], *(["__init__"] if len(names) == depth else [])])
                for names in (importer, imported)]  # fmt: skip
        folders.setdefault(folder, {}).setdefault(ends[0], set()).add(ends[1])
    folders.get("jgait", {}).pop("jgait.__init__", None)
    return [ring for graph in folders.values() for ring in _rings(graph)]


def repeated_classes(root: Path) -> dict[str, list[str]]:
    """Names that more than one class of the library has, with the modules that define them."""
    places: dict[str, list[str]] = {}
    for name, path in modules(root).items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, []).append(name)
    return {name: where for name, where in places.items() if len(where) > 1}


def _part(module: str) -> str:
    """File or folder of `jgait` that a module lies in; `jgait` itself counts as above all."""
    return module.split(".")[1] if "." in module else "jgait"


def _statements(name: str, path: Path) -> Iterator[tuple[int, str, str]]:
    """Line, module and attribute of each import of a file; a plain `import a.b` has the attribute `""`."""
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*above, *([node.module] if node.module else [])])
            yield from ((node.lineno, module, alias.name) for alias in node.names)


def _rings(graph: dict[str, set[str]]) -> list[list[str]]:
    """Groups of boxes that reach each other: Tarjan's strongly connected components of more than one box."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    rings: list[list[str]] = []

    def visit(box: str) -> None:
        index[box] = low[box] = len(index)
        stack.append(box)
        for target in sorted(graph.get(box, ())):
            if target not in index:
                visit(target)
            if target in stack:
                low[box] = min(low[box], low[target])
        if low[box] == index[box]:
            ring = stack[stack.index(box) :]
            del stack[stack.index(box) :]
            if len(ring) > 1:
                rings.append(sorted(ring))

    for box in sorted(graph):
        if box not in index:
            visit(box)
    return rings
