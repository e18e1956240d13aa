"""A page for every module of jgait, read and not imported."""

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]


@cache
def modules() -> dict[str, Path]:
    """Every public module by its dotted name, in the order of the alphabet."""
    found = {}
    for path in sorted((ROOT / "jgait").rglob("*.py")):
        parts = list(path.relative_to(ROOT).with_suffix("").parts)
        if parts[-1] == "__init__":
            parts.pop()
        if not any(part.startswith("_") for part in parts):
            found[".".join(parts)] = path
    return dict(sorted(found.items()))


@cache
def tree(name: str) -> ast.Module:
    """The parsed text of a module."""
    return ast.parse(modules()[name].read_text(encoding="utf-8"))


def title(name: str) -> str:
    """The first sentence of a module's docstring, on one line."""
    text = (ast.get_docstring(tree(name)) or "").split("\n\n")[0]
    return " ".join(text.split())


def defined(name: str) -> list[str]:
    """Public names that a module defines, in the order of its text: functions, classes, types, documented values."""
    found = []
    body = tree(name).body
    for node, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names = [node.name]
        elif isinstance(node, ast.Assign | ast.AnnAssign) and _is_text(after):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = [one.id for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)]
        else:
            continue
        found += [one for one in names if not one.startswith("_") and one not in found]
    return found


def _is_text(node: ast.stmt | None) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def elsewhere(name: str) -> dict[str, str]:
    """Public names that a module passes on: name → full name where it is defined, as far as that is in jgait."""
    exported = []
    for node in tree(name).body:
        if isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets):
            exported = ast.literal_eval(node.value)
    found = {}
    for node in tree(name).body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("jgait"):
            for one in node.names:
                if (one.asname or one.name) in exported:
                    found[one.asname or one.name] = _origin(f"{node.module}.{one.name}")
    return found


def _origin(full: str) -> str:
    """Where a name is defined that a module may only pass on itself."""
    module, _, name = full.rpartition(".")
    if full in modules() or module not in modules():
        return full
    return elsewhere(module).get(name, full)


def documented(full: str) -> bool:
    """Whether a name has a place in these pages."""
    module, _, name = full.rpartition(".")
    return full in modules() or (module in modules() and name in defined(module))


def uri(name: str) -> str:
    """The page of a module."""
    children = any(other.startswith(f"{name}.") for other in modules())
    path = name.split(".")[1:]
    return "/".join(["api", *path, "index.md"] if children and path else ["api", *(path or ["jgait"])]).removesuffix(
        ".md"
    ) + ".md"  # fmt: skip


def page(name: str) -> str:
    """The Markdown of a module's page."""
    passed = elsewhere(name)
    own = defined(name)
    lines = ["---", f"title: {name}", "---", "", f"::: {name}", "    options:"]
    lines.append(f"      members: {own if own else 'false'}")
    if passed:
        lines += ["", "## Defined elsewhere, named here too" if own else "## Public names", ""]
        lines += ["| name | what |", "|---|---|"]
        for alias, full in passed.items():
            shown = f"[`{alias}`][{full}]" if documented(full) else f"`{alias}`"
            lines.append(f"| {shown} | {_about(full)} |")
    children = [other for other in modules() if other.rpartition(".")[0] == name and name != "jgait"]
    if children:
        lines += ["", "## Modules", "", "| module | what |", "|---|---|"]
        lines += [f"| [`{other.rpartition('.')[2]}`][{other}] | {title(other)} |" for other in children]
    return "\n".join(lines) + "\n"


def _about(full: str) -> str:
    """The first line of what is said of a name."""
    if full in modules():
        return title(full)
    module, _, name = full.rpartition(".")
    if module not in modules():
        return ""
    body = tree(module).body
    for node, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == name:
            return " ".join((ast.get_docstring(node) or "").split("\n\n")[0].split()).replace("|", "\\|")
        targets = node.targets if isinstance(node, ast.Assign) else []
        if any(isinstance(t, ast.Name) and t.id == name for t in targets) and _is_text(after):
            return " ".join(after.value.value.split("\n\n")[0].split()).replace("|", "\\|")
    return ""


def index() -> str:
    """A table of all packages and modules at the top."""
    lines = ["# API", "", "Every public name, from its docstring.", "", "| module | what |", "|---|---|"]
    for name in modules():
        if name.count(".") <= 1:
            lines.append(f"| [`{name}`][{name}] | {title(name)} |")
    return "\n".join(lines) + "\n"


def navigation() -> list[object]:
    """The API's part of the navigation: packages first, then modules."""
    packages: list[object] = []
    single: list[object] = []
    for name in modules():
        if name.count(".") == 1:
            if uri(name).endswith("/index.md"):
                packages.append({name.removeprefix("jgait."): _package(name)})
            else:
                single.append({name.removeprefix("jgait."): uri(name)})
    return ["api/index.md", {"jgait": uri("jgait")}, *packages, {"modules": single}]


def _package(name: str) -> list[object]:
    entries: list[object] = [uri(name)]
    for other in modules():
        if other.rpartition(".")[0] == name:
            last = other.rpartition(".")[2]
            entries.append({last: _package(other) if uri(other).endswith("/index.md") else uri(other)})
    return entries
