"""Branches left out and constants moved, one at a time: which change no result of the panel.

A branch is left out by a test that is never true, a constant is moved by 30 % both ways. What is left as it is by all
of up to `RECORDINGS` recordings that run it pays for nobody there. Code that JAX traces once is left out: a change
would not be seen.
"""

import ast
import inspect
import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import jgait
from experiments.ablation.lines import FOLDERS, entered, files
from experiments.ablation.panel import Made, panel
from experiments.common.row import Row, show
from jgait.types import RecordingError

RECORDINGS = 14
"""Largest number of recordings that a change is tried on."""

TOLERANCE = 1e-4
"""[1] Change of a number, as a share of the largest of its array, that counts."""

MOVED = 1.3, 0.7
"""[1] Factors on a constant."""


class Outcome(NamedTuple):
    """What an analysis says."""

    numbers: dict[str, np.ndarray]
    notes: tuple[str, ...]  #: codes, or the error's text.


class Change(NamedTuple):
    """One change of the code."""

    path: Path
    line: int
    what: str  #: as it is printed.
    lines: frozenset[int]  #: lines of the file that run if the change is to matter.
    name: str = ""  #: of a constant.
    source: ast.Module | None = None  #: of the changed file, for a branch.


def outcome(made: Made) -> Outcome:
    """The numbers and notes of an analysis."""
    try:
        analysis = jgait.analyse(made(), {"height": 1.75})
    except RecordingError as error:
        return Outcome({}, (str(error),))
    return Outcome(dict(arrays(analysis.estimate)), tuple(sorted({note.code for note in analysis.notes})))


def arrays(record: Any, path: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Path → numbers in nested records and dictionaries."""
    fields = record if isinstance(record, dict) else record._asdict() if hasattr(record, "_asdict") else None
    if fields is not None:
        for name, value in fields.items():
            yield from arrays(value, f"{path}.{name}")
    elif record is not None and (values := np.asarray(record)).dtype.kind in "biuf":
        yield path, values.astype(float)


def moved(before: Outcome, after: Outcome) -> str:
    """ "numbers", "notes" or "" for what differs."""
    if before.numbers.keys() != after.numbers.keys():
        return "numbers"
    for path, values in before.numbers.items():
        other = after.numbers[path]
        if values.shape != other.shape:
            return "numbers"
        size = float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))
        if not np.allclose(values, other, rtol=0.0, atol=TOLERANCE * size, equal_nan=True):
            return "numbers"
    return "" if before.notes == after.notes else "notes"


class _Never(ast.NodeTransformer):
    """Makes the test of the branch at a line and column never true."""

    def __init__(self, line: int, column: int):
        self.at = line, column

    def visit_If(self, node: ast.If) -> ast.AST:
        self.generic_visit(node)
        if (node.lineno, node.col_offset) == self.at:
            node.test = ast.copy_location(ast.Constant(False), node.test)
        return node

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        self.generic_visit(node)
        return node.orelse if (node.lineno, node.col_offset) == self.at else node


def branches(path: Path) -> Iterator[Change]:
    """Each branch of a file left out, but for those that refuse."""
    text = path.read_text()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.If):
            if any(isinstance(one, ast.Raise) for one in ast.walk(ast.Module(node.body, []))):
                continue
            lines = frozenset({node.body[0].lineno})
        elif isinstance(node, ast.IfExp):
            lines = frozenset({node.lineno})
        else:
            continue
        tree = ast.fix_missing_locations(_Never(node.lineno, node.col_offset).visit(ast.parse(text)))
        yield Change(path, node.lineno, "never: " + ast.unparse(node.test)[:90], lines, source=tree)


def constants(path: Path) -> Iterator[Change]:
    """Each numeric constant of a module."""
    tree = ast.parse(path.read_text())
    for node in tree.body:
        if isinstance(node, ast.Assign):
            names = [one.id for target in node.targets for one in ast.walk(target) if isinstance(one, ast.Name)]
            for name in names:
                uses = frozenset(
                    one.lineno for one in ast.walk(tree)
                    if isinstance(one, ast.Name) and one.id == name and one.lineno != node.lineno
                )  # fmt: skip
                yield Change(path, node.lineno, name, uses, name)


def scaled(value: Any, factor: float) -> Any:
    """A constant times a factor; None if it is no number."""
    if isinstance(value, bool):
        return None
    if isinstance(value, int):
        return max(1, round(value * factor)) if value > 1 else None
    if isinstance(value, float):
        return value * factor
    if isinstance(value, tuple) and value and all(isinstance(one, float) for one in value):
        return tuple(one * factor for one in value)
    return value * factor if isinstance(value, np.ndarray) and value.dtype.kind == "f" else None


def module_of(path: Path) -> types.ModuleType:
    """The module of a file."""
    return next(m for m in list(sys.modules.values()) if getattr(m, "__file__", None) == str(path))


def codes(code: types.CodeType) -> Iterator[tuple[str, types.CodeType]]:
    """Qualified name → code of every function within code."""
    for one in code.co_consts:
        if isinstance(one, types.CodeType):
            if one.co_flags & inspect.CO_OPTIMIZED:
                yield one.co_qualname, one
            yield from codes(one)


def functions(module: types.ModuleType) -> Iterator[Any]:
    """The functions of a module and of its classes."""
    for value in [*vars(module).values(), *(one for c in vars(module).values() if isinstance(c, type)
                                            for one in vars(c).values())]:  # fmt: skip
        value = getattr(value, "fget", value)
        value = inspect.unwrap(value) if callable(value) else value
        if isinstance(value, types.FunctionType) and value.__code__.co_filename == module.__file__:
            yield value


@contextmanager
def tried(change: Change, factor: float) -> Iterator[bool]:
    """Makes a change, yields whether it could be made, and undoes it."""
    module = module_of(change.path)
    if change.source is not None:
        new = dict(codes(compile(change.source, str(change.path), "exec")))
        held = [
            (function, function.__code__) for function in functions(module)
            if function.__qualname__ in new and new[function.__qualname__].co_freevars == function.__code__.co_freevars
        ]  # fmt: skip
        for function, _ in held:
            function.__code__ = new[function.__qualname__]
        try:
            yield bool(held)
        finally:
            for function, code in held:
                function.__code__ = code
        return
    value = vars(module).get(change.name)
    new_value = scaled(value, factor)
    places = [m for m in list(sys.modules.values()) if getattr(m, "__name__", "").startswith("jgait")
              and new_value is not None and vars(m).get(change.name) is value]  # fmt: skip
    for place in places:
        setattr(place, change.name, new_value)
    try:
        yield bool(places)
    finally:
        for place in places:
            setattr(place, change.name, value)


def effect(change: Change, runs: list[tuple[Made, Outcome]]) -> str:
    """What a change moves: "numbers", "notes", "" for nothing, or "-" if it cannot be made."""
    effects = set()
    for factor in MOVED if change.name else MOVED[:1]:
        with tried(change, factor) as possible:
            for made, before in runs if possible else []:
                try:
                    effects.add(moved(before, outcome(made)))
                except Exception:  # the code does not run without the branch
                    effects.add("numbers")
                if "numbers" in effects:
                    return "numbers"
    return max(effects, default="-")


def rows(quick: bool, folders: tuple[str, ...] = FOLDERS) -> list[Row]:
    """Try each change, and print those that move no number; of one file if `quick`."""
    folders = ("events/foot.py",) if quick else folders
    runs: list[tuple[Made, Outcome, set[tuple[str, int]]]] = []
    home = Path(jgait.__file__).parent
    for _, made in panel(quick, every=1 if quick else 3):
        outcome(made)
        with entered(home) as found:
            sys.monitoring.restart_events()
            runs.append((made, outcome(made), set(found)))
    print(f"{len(runs)} recordings", flush=True)
    counted: dict[str, list[str]] = {"branches": [], "constants": []}
    order = np.random.default_rng(0).permutation(len(runs))
    there = {getattr(module, "__file__", None) for module in list(sys.modules.values())}
    for path in (path for path in files(folders) if str(path) in there):
        for kind, changes in (("branches", branches(path)), ("constants", constants(path))):
            for change in changes:
                where = {(str(path), line) for line in change.lines}
                wanted = [(runs[k][0], runs[k][1]) for k in order if where & runs[k][2]][:RECORDINGS]
                if not wanted:
                    continue
                what = effect(change, wanted)
                if what == "-":
                    continue
                counted[kind].append(what)
                if what != "numbers":
                    text = what or "nothing"
                    print(
                        f"{path.relative_to(home)}:{change.line}: {kind}: {text}: {change.what} [{len(wanted)}]",
                        flush=True,
                    )
    found_rows = []
    for kind, made_of in counted.items():
        free = 100.0 * sum(one == "" for one in made_of) / max(len(made_of), 1)
        found_rows.append(Row(f"{kind}_without_effect_pct", free, "%", n=len(made_of), of=kind))
    show("rules that move nothing", ["kind", "%", "n"], [[r.metric, r.value, r.n] for r in found_rows])
    return found_rows
