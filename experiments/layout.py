"""The shape of the code: names, imports, lengths of files, and how many places a new part touches.

Everything is counted from the source, without running it. A length is a number of lines of a file. An import counts
wherever it stands: at the top of a file, inside a function, or for type checkers only. `Any` counts once for every
annotation or alias that names it. `places_*` counts, for a toy of each kind in `tests/extending.py`, the new files or
folders and the changed files; the test beside it runs the whole chain with them.
"""

import ast
import statistics
import sys
from pathlib import Path

from experiments.common.row import Row, show

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

import layering  # noqa: E402


def lines(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def any_annotations() -> int:
    """Places of the library that name `Any`: annotations, aliases and casts; imports of the name do not count."""
    return sum(
        isinstance(node, ast.Name) and node.id == "Any"
        for path in layering.modules(ROOT).values()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    )


def places() -> dict[str, int]:
    """Kind of part → files that a toy of it adds or changes; empty before the toys exist."""
    try:
        from extending import TOYS
    except ImportError:
        return {}
    return {toy.kind: len(toy.places) for toy in TOYS}


def rows(quick: bool) -> list[Row]:
    """Count; nothing is left out with `quick`."""
    of = {path: lines(path) for path in layering.modules(ROOT).values()}
    edges = layering.imports(ROOT)
    circles, upward = layering.circles(edges), layering.upward(edges)
    repeated = layering.repeated_classes(ROOT)
    top = [path.name for path in (ROOT / "jgait").iterdir() if path.name != "__pycache__"]
    longest = sorted(of, key=lambda path: -of[path])[:10]
    show("longest files", ["file", "lines"], [[str(path.relative_to(ROOT)), of[path]] for path in longest])
    if circles or upward or repeated:
        broken = [["circle", ", ".join(ring)] for ring in circles]
        broken += [["upward", f"{edge.importer}:{edge.line} imports {edge.imported}"] for edge in upward]
        broken += [["repeated", f"{name}: {', '.join(where)}"] for name, where in repeated.items()]
        show("what breaks the rules", ["rule", "where"], broken)
    counted = [
        ("top_names", len(top), "names"),
        ("import_circles", len(circles), "circles"),
        ("upward_imports", len(upward), "imports"),
        ("longest_file", max(of.values()), "lines"),
        ("median_file", statistics.median(of.values()), "lines"),
        ("any_annotations", any_annotations(), "annotations"),
        ("repeated_class_names", len(repeated), "names"),
        ("readme_lines", lines(ROOT / "README.md"), "lines"),
        ("jgait_lines", sum(of.values()), "lines"),
        ("tests_lines", sum(lines(path) for path in (ROOT / "tests").rglob("*.py")), "lines"),
        *((f"places_{kind}", number, "places") for kind, number in places().items()),
    ]
    return [Row(metric, float(value), unit, n=len(of), split="the source") for metric, value, unit in counted]
