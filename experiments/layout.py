"""The shape of the code: names, imports, lengths of files, and how many places a new part touches.

What follows from the text is counted from the source. A length is a number of lines of a file; `jgait_code_lines` are
those without blanks, docstrings and comments. `names_not_allowed` counts each name of `NOT_ALLOWED` once for each file
of the library that gives it to something. An import counts wherever it stands: at the top of a file, inside a
function, or for type checkers only. `any_annotations` counts every annotation or alias that names `Any`; an annotation
is loose if it names `Any`, `PyTree`, or an alias that stands for one of them. `places_*` counts, for a toy of each kind
in `tests/extending.py`, the new files or folders and the changed files; the test beside it runs the whole chain with
them.

What depends on tracing is traced. `scan_in_jaxpr` is 1 if the filter, the smoother and the smoother's gradient for a
batch contain `scan`, with the model of each estimator, and all of their primitives are JAX's. `frames_to_transition`
and `files_entered_one_shoe` are of the first call of `foot_ins.estimate` in a process, with one shoe. Frames count from
`estimate` to the model's `transition`, both included; a file is entered if one of its functions runs.
`files_entered_seven_sensors` and `functions_entered_seven_sensors` are of `jgait estimate` on a simulated walk, in a
new process that finds its compiled programs kept. `constants_with_provenance_pct` is the share of the constants with a
text below them.
"""

import ast
import contextlib
import importlib
import inspect
import io
import itertools
import json
import re
import statistics
import subprocess
import sys
import tempfile
import tokenize
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, get_args

import jax
import jax.numpy as jnp
from jax.extend.core import ClosedJaxpr, Jaxpr, Primitive

from experiments.common.process import answers, environment, started
from experiments.common.row import Row, show
from jgait import filtering

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

import layering  # noqa: E402

LOOSE = frozenset({"Any", "PyTree"})
INTERPRETER = ("staged", "operations")
"""Files of `estimators` that replayed primitives of JAX in NumPy."""
NOT_PUBLIC = ("_src", "interpreters", "extend")
"""Parts of JAX that are not its public API, or not a stable one."""
INTERNAL = re.compile(rf"jax\.({'|'.join(NOT_PUBLIC)})(?=\.|$)")
JACOBIAN = re.compile(r"error_(transition|observation|shift)|(turn|move)_error$|jacobian")
"""Names of functions and model fields that give a Jacobian, or move an error."""

NOT_ALLOWED = frozenset(
    ("told", "found", "own", "one", "seen", "said", "felt", "heard", "LEAST", "SHORTEST", "FEWEST", "ALIKE", "REACH")
)
"""Names that do not say what they stand for."""

ESTIMATION = ("estimators", "events", "mounting", "quality")
"""Folders of the library that estimate."""
CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*")

SHOWS_NOTES = ("notes.py", "report/", "io/flags.py", "evaluate/store.py", "commands/estimate.py", "commands/inspect.py")
"""Files and folders of the library that write notes for people or show them."""
READS_NOTE = re.compile(r"note\w*(\[[^]]*\])?\.(code|kind|values|severity)$|\b[A-Z][A-Z_]+\.code$")
"""What reads a note, or the code of a kind."""


def lines(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def parsed(paths: list[Path]) -> Iterator[ast.AST]:
    """The nodes of files."""
    for path in paths:
        yield from ast.walk(ast.parse(path.read_text(encoding="utf-8")))


def files_in(*parts: str, root: Path = ROOT) -> list[Path]:
    return sorted(root.joinpath("jgait", *parts).rglob("*.py"))


# --- from the source ---


def any_annotations() -> int:
    """Places of the library that name `Any`: annotations, aliases and casts; imports of the name do not count."""
    return sum(isinstance(node, ast.Name) and node.id == "Any" for node in parsed(files_in()))


def names_not_allowed(root: Path = ROOT) -> list[str]:
    """Variables, arguments, fields, functions and classes with a name of `NOT_ALLOWED`; once in each file."""
    names = {(path, _defined(node)) for path in files_in(root=root) for node in parsed([path])}
    return sorted(f"{path.relative_to(root)}: {name}" for path, name in names if name in NOT_ALLOWED)


def _defined(node: ast.AST) -> str | None:
    """The name that a node gives to something."""
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        return node.id
    if isinstance(node, ast.arg):
        return node.arg
    return node.name if isinstance(node, ast.FunctionDef | ast.ClassDef) else None


def code_lines(path: Path) -> int:
    """Lines of a file without blanks, docstrings and comments; a text that is a statement counts as a docstring."""
    text = path.read_text(encoding="utf-8")
    none = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    used = {line for token in tokens if token.type not in none for line in range(token.start[0], token.end[0] + 1)}
    texts = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Expr) and _is_text(node.value)]
    return len(used.difference(*(range(node.lineno, (node.end_lineno or 0) + 1) for node in texts)))


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def note_readers(root: Path = ROOT) -> list[str]:
    """Lines that read what a note states, or the code of a kind, outside the files that write and show notes."""
    home, lines = root / "jgait", set[str]()
    for path in files_in(root=root):
        name = path.relative_to(home).as_posix()
        for node in parsed([] if name.startswith(SHOWS_NOTES) else [path]):
            if isinstance(node, ast.Attribute) and READS_NOTE.search(ast.unparse(node)):
                lines.add(f"{name}:{node.lineno}")
    return sorted(lines)


def hand_jacobians(root: Path = ROOT) -> list[str]:
    """Functions of the estimators and fields of `Model` whose names say that they give a Jacobian."""
    functions = [node.name for node in parsed(files_in("estimators", root=root)) if isinstance(node, ast.FunctionDef)]
    models = [node for node in parsed(files_in("filtering", root=root)) if isinstance(node, ast.ClassDef)]
    fields = [ast.unparse(part.target) for model in models if model.name == "Model"
              for part in model.body if isinstance(part, ast.AnnAssign)]  # fmt: skip
    return [name for name in functions + fields if JACOBIAN.search(name)]


def jax_internal_imports(root: Path = ROOT) -> list[str]:
    """Imports and uses of what is not JAX's public API, by file and line; the fast folder may use `jax.extend`."""
    found: set[str] = set()
    for name, path in layering.modules(root).items():
        allowed = "jax.extend" if f"{name}.".startswith("jgait.filtering.fast.") else ""
        for node in parsed([path]):
            matches = filter(None, map(INTERNAL.match, _used(node)))
            found.update(f"{name}:{node.lineno} {match[0]}" for match in matches if match[0] != allowed)
    return sorted(found)


def note_kinds(root: Path = ROOT) -> int:
    """Kinds of notes that the library declares."""
    return sum(isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Kind" and len(node.args) > 3
               for node in parsed(files_in(root=root)))  # fmt: skip


def constants(root: Path = ROOT) -> list[tuple[str, bool]]:
    """Names in capitals that modules give to what holds a number, each with whether a text below says more of it."""
    found = []
    for path in files_in(root=root):
        body = ast.parse(path.read_text(encoding="utf-8")).body
        for node, after in zip(body, [*body[1:], None], strict=True):
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            value = getattr(node, "value", None)
            names = [name.id for target in targets if target for name in ast.walk(target) if isinstance(name, ast.Name)]
            if value is None or not any(map(CONSTANT.fullmatch, names)) or not any(map(_is_number, ast.walk(value))):
                continue
            stated = isinstance(after, ast.Expr) and _is_text(after.value)
            found += [(f"{path.relative_to(root)}: {name}", stated) for name in names]
    return found


def _is_number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool)


def source_runs() -> int:
    """Places at which an analysis of all sensors runs its estimators."""
    nodes = parsed(files_in("estimators", "combined"))
    return sum(isinstance(node, ast.Call) and getattr(node.func, "id", "") == "sources" for node in nodes)


def _used(node: ast.AST) -> list[str]:
    """The dotted names that an import or an attribute names."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom) and not node.level:
        return [f"{node.module}.{alias.name}" for alias in node.names]
    return [ast.unparse(node)] if isinstance(node, ast.Attribute) and node.attr in NOT_PUBLIC else []


def loose_annotations(root: Path = ROOT) -> tuple[int, int]:
    """Annotations of `filtering` that are loose, and all of them: of parameters, results and assignments."""
    files = files_in("filtering", root=root)
    aliases = [alias for alias in map(_alias, parsed([root / "jgait" / "types.py", *files])) if alias]
    loose = set(LOOSE)
    while more := {name for name, value in aliases if value in loose} - loose:
        loose |= more
    every = [annotation for node in parsed(files) if (annotation := _annotation(node)) is not None]
    return sum(not loose.isdisjoint(_names(annotation)) for annotation in every), len(every)


def _alias(node: ast.AST) -> tuple[str, str] | None:
    """A name, and the name it stands for."""
    if isinstance(node, ast.TypeAlias):
        return node.name.id, ast.unparse(node.value)
    if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
        return node.targets[0].id, ast.unparse(node.value)
    return None


def _annotation(node: ast.AST) -> ast.expr | None:
    if isinstance(node, ast.FunctionDef):
        return node.returns
    return node.annotation if isinstance(node, ast.arg | ast.AnnAssign) else None


def _names(annotation: ast.expr) -> set[str]:
    """The names in an annotation, also in one that is quoted as a whole."""
    if isinstance(annotation, ast.Constant) and isinstance(annotation.value, str):
        annotation = ast.parse(annotation.value, mode="eval").body
    names = {node.id for node in ast.walk(annotation) if isinstance(node, ast.Name)}
    return names | {node.attr for node in ast.walk(annotation) if isinstance(node, ast.Attribute)}


def places() -> dict[str, int]:
    """Kind of part → files that a toy of it adds or changes; empty before the toys exist."""
    try:
        from extending import TOYS
    except ImportError:
        return {}
    return {toy.kind: len(toy.places) for toy in TOYS}


# --- by tracing ---


def models() -> dict[filtering.Model, str]:
    """The state-space models of the estimators, and the module that names each first."""
    found: dict[filtering.Model, str] = {}
    for name in layering.modules(ROOT):
        if name.startswith("jgait.estimators."):
            for value in vars(importlib.import_module(name)).values():
                if isinstance(value, filtering.Model):
                    found.setdefault(value, name)
    return found


def ones(kind: Any, *axes: int) -> Any:
    """A tuple of the annotated type whose entries are 1; `axes` are in front of the shapes of its fields."""
    if hasattr(kind, "_fields"):
        kind = getattr(kind, "__origin__", kind)  # of a field with a declared parameter
        return kind(*(ones(kind.__annotations__[name], *axes) for name in kind._fields))
    return jnp.ones((*axes, *shape(kind)))


def shape(kind: Any) -> tuple[int, ...]:
    """The lengths that an annotation states, of a union those of its first part."""
    kind = getattr(kind, "__value__", kind)
    if parts := get_args(kind):
        return shape(parts[0])
    return tuple(int(axis) for axis in getattr(kind, "dim_str", "").split() if axis.isdigit())


def jaxprs(model: filtering.Model) -> Iterator[ClosedJaxpr]:
    """The filter, the smoother, and the smoother's gradient for a batch of two, of eight samples by the core."""
    params, _, control, _ = (one.annotation for one in inspect.signature(model.transition).parameters.values())
    observation = inspect.signature(model.observation).return_annotation

    def run(function: Callable[..., Any], params: Any, observed: Any, controls: Any) -> Any:
        return function(model, params, observed, controls=controls, dt=0.01, execution="core")

    def loss(*batch: Any) -> Any:
        found = jax.vmap(lambda *one: run(filtering.kalman_smoother, *one))(*batch)
        return sum(jnp.sum(v) for v in jax.tree.leaves(found) if jnp.issubdtype(v.dtype, jnp.floating))

    arguments = ones(params), ones(observation, 8), ones(control, 8)
    for function in (filtering.kalman_filter, filtering.kalman_smoother):
        yield jax.make_jaxpr(lambda *one, f=function: run(f, *one))(*arguments)
    yield jax.make_jaxpr(jax.grad(loss))(*jax.tree.map(lambda v: jnp.stack([v, v]), arguments))


def primitives(tree: Any) -> Iterator[Primitive]:
    """The primitives of all jaxprs in a tree, and of those inside them."""
    for leaf in jax.tree.leaves(tree):
        jaxpr = leaf.jaxpr if isinstance(leaf, ClosedJaxpr) else leaf
        if isinstance(jaxpr, Jaxpr):
            for equation in jaxpr.eqns:
                yield equation.primitive
                yield from primitives(equation.params)


def missing(jaxpr: ClosedJaxpr) -> list[str]:
    """What a jaxpr has that it should not have: no `scan`, or primitives that no module of JAX has."""
    modules = [module for name, module in list(sys.modules.items()) if name.partition(".")[0] == "jax"]
    known = {id(value) for module in modules for value in vars(module).values() if isinstance(value, Primitive)}
    every = list(primitives(jaxpr))
    found = {f"a primitive {one.name}" for one in every if id(one) not in known}
    return [*sorted(found), *([] if any(one.name == "scan" for one in every) else ["no scan"])]


def entered(call: Callable[[], Any], inner: CodeType | None, home: Path) -> tuple[int, int, int]:
    """Numbers of the files and of the functions of a folder that a call enters, and between them the most frames of
    these functions at a start of `inner`.

    The frame of `inner` counts too; bodies of modules, lambdas and comprehensions do not count.
    """
    watch, functions, deepest, inside = sys.monitoring, set(), 0, f"{home}/"

    def start(code: CodeType, _: int) -> Any:
        nonlocal deepest
        if code.co_filename.startswith(inside) and not code.co_name.startswith("<"):
            functions.add((code.co_filename, code.co_qualname))
        if code is not inner:
            return watch.DISABLE
        frame: FrameType | None = sys._getframe(1)
        deep = 0
        while frame is not None:
            deep += frame.f_code.co_filename.startswith(inside)
            frame = frame.f_back
        deepest = max(deepest, deep)
        return None

    watch.use_tool_id(watch.PROFILER_ID, "layout")
    try:
        watch.register_callback(watch.PROFILER_ID, watch.events.PY_START, start)
        watch.set_events(watch.PROFILER_ID, watch.events.PY_START)
        watch.restart_events()
        call()
    finally:
        watch.set_events(watch.PROFILER_ID, 0)
        watch.free_tool_id(watch.PROFILER_ID)
    return len({file for file, _ in functions}), deepest, len(functions)


def one_shoe() -> tuple[int, int, int]:
    """`entered` of `foot_ins.estimate` and its `transition`; in a process that did not call it yet."""
    from made.foot import foot

    from jgait.estimators import foot_ins
    from jgait.estimators.foot_ins.model import MODEL

    recording = foot().recording
    transition = inspect.unwrap(MODEL.transition).__code__
    return entered(lambda: foot_ins.estimate(foot_ins.FootParams(), recording), transition, ROOT / "jgait")


def seven_sensors(*words: str) -> tuple[int, int, int]:
    """Files and functions entered by a command, as `entered`."""
    from jgait import cli

    def called() -> None:
        with contextlib.redirect_stdout(sys.stderr), contextlib.suppress(SystemExit):
            cli.main()

    sys.argv[:] = ["jgait", *words]
    return entered(called, None, ROOT / "jgait")


def of_seven_sensors() -> tuple[int, int, int]:
    """`seven_sensors` of the second of two processes that estimate a simulated walk, with a cache of their own."""
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        for words in (
            ("simulate", "--out", home),
            *2 * [("estimate", home / "subject_0001.csv", "--out", home / "out")],
        ):
            run = subprocess.run(
                [sys.executable, "-m", "experiments.layout", *map(str, words)], capture_output=True, text=True,
                check=True, cwd=ROOT, env=environment() | {"XDG_CACHE_HOME": name},
            )  # fmt: skip
    return tuple(json.loads(run.stdout.splitlines()[-1]))


# --- together ---


def rows(quick: bool) -> list[Row]:
    """Count; with `quick`, what takes a command is left out."""
    shoe = started("experiments.layout", [])
    of = {path: lines(path) for path in layering.modules(ROOT).values()}
    edges = layering.imports(ROOT)
    circles, upward = layering.circles(edges), layering.upward(edges)
    repeated = layering.repeated_classes(ROOT)
    top = [path.name for path in (ROOT / "jgait").iterdir() if path.name != "__pycache__"]
    longest = sorted(of, key=lambda path: -of[path])[:10]
    show("longest files", ["file", "lines"], [[str(path.relative_to(ROOT)), of[path]] for path in longest])
    by_hand, internal, (loose, annotated) = hand_jacobians(), jax_internal_imports(), loose_annotations()
    unlike = {(name, why) for model, name in models().items() for jaxpr in jaxprs(model) for why in missing(jaxpr)}
    broken = [["circle", ", ".join(ring)] for ring in circles]
    broken += [["upward", f"{edge.importer}:{edge.line} imports {edge.imported}"] for edge in upward]
    broken += [["repeated", f"{name}: {', '.join(where)}"] for name, where in repeated.items()]
    broken += [["Jacobian by hand", name] for name in by_hand]
    broken += [["reads a note", where] for where in note_readers()]
    broken += [["not JAX's public API", where] for where in internal]
    broken += [["not a scan of JAX's primitives", f"{name}: {why}"] for name, why in sorted(unlike)]
    if broken:
        show("what breaks the rules", ["rule", "where"], broken)
    files, frames, _ = answers(shoe)[0]
    known = constants()
    interpreter = [path for path in files_in("estimators") if path.stem in INTERPRETER]
    counted = [
        ("top_names", len(top), "names"),
        ("import_circles", len(circles), "circles"),
        ("upward_imports", len(upward), "imports"),
        ("longest_file", max(of.values()), "lines"),
        ("median_file", statistics.median(of.values()), "lines"),
        ("any_annotations", any_annotations(), "annotations"),
        ("repeated_class_names", len(repeated), "names"),
        ("names_not_allowed", len(names_not_allowed()), "identifiers"),
        ("readme_lines", lines(ROOT / "README.md"), "lines"),
        ("changelog_lines", lines(ROOT / "CHANGELOG.md"), "lines"),
        ("jgait_lines", sum(of.values()), "lines"),
        ("jgait_code_lines", sum(map(code_lines, of)), "lines"),
        ("tests_lines", sum(lines(path) for path in (ROOT / "tests").rglob("*.py")), "lines"),
        ("filtering_lines", sum(map(lines, files_in("filtering"))), "lines"),
        ("fast_lines", sum(map(lines, files_in("filtering", "fast"))), "lines"),
        ("interpreter_lines", sum(map(lines, interpreter)), "lines"),
        ("hand_jacobians", len(by_hand), "functions"),
        ("note_readers", len(note_readers()), "lines"),
        ("jax_internal_imports", len(internal), "imports"),
        ("loose_annotations_filtering_pct", 100.0 * loose / annotated, "%"),
        ("source_runs", source_runs(), "runs"),
        ("note_kinds", note_kinds(), "kinds"),
        ("constants", len(known), "constants"),
        ("constants_with_provenance_pct", 100.0 * sum(stated for _, stated in known) / len(known), "%"),
        ("estimation_lines", sum(map(lines, itertools.chain.from_iterable(map(files_in, ESTIMATION)))), "lines"),
        *((f"places_{kind}", number, "places") for kind, number in places().items()),
    ]
    traced = [
        ("scan_in_jaxpr", not unlike, "1"),
        ("frames_to_transition", frames, "frames"),
        ("files_entered_one_shoe", files, "files"),
    ]
    if not quick:
        files, _, functions = of_seven_sensors()
        traced += [
            ("files_entered_seven_sensors", files, "files"),
            ("functions_entered_seven_sensors", functions, "functions"),
        ]
    found = [Row(metric, float(value), unit, n=len(of), split="the source") for metric, value, unit in counted]
    return found + [Row(metric, float(value), unit, split="traced") for metric, value, unit in traced]


if __name__ == "__main__":
    print(json.dumps(seven_sensors(*sys.argv[1:]) if sys.argv[1:] else one_shoe()))
