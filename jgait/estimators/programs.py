"""Compiled programs: one for each function, static arguments and shapes, kept between processes in a folder.

`compiled` is `jax.jit` for functions that users call from fresh processes. Once `keep` has named a folder, what JAX
traced is read from there (`jax.export`), and what XLA compiled from JAX's own cache of compilations. A file that is
damaged, or of another version of jgait or JAX, another processor or another precision, is never used: its program is
made anew. Nothing in a file can name code to run: it holds operations on arrays.
"""

import contextlib
import functools
import hashlib
import json
import math
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import PyTree, PyTreeDef

from jgait.filtering.covariance import Covariance, Layout
from jgait.geometry.arrays import backend, compiler_options, host, on_host, processor, reached

ENDING = ".traced"

type Described = list[Any] | int | None
"""A tree as JSON, see `_described`."""

BUCKET = 4096
"""[samples] Recordings are padded to this length times a power of two, so that few programs are compiled: recordings of
up to 41 s at 100 Hz share one."""


def bucket(samples: int, smallest: int = BUCKET) -> int:
    """The padded length of a recording: `smallest` times a power of two."""
    return smallest * 2 ** max(0, math.ceil(math.log2(samples / smallest)))


class _Store:
    """Where programs are kept, and what is called before a program is compiled."""

    folder: Path | None = None
    compiling: Callable[[], None] = lambda: None


def keep(folder: Path | None) -> None:
    """Keep the programs of this process in a folder that exists; None: keep none.

    JAX keeps its compilations there too, unless it has a folder for them.
    """
    _Store.folder = folder
    if folder is not None and jax.config.jax_compilation_cache_dir is None:
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)


def before_compiling(call: Callable[[], None] | None) -> None:
    """Call a function before each program that is made because the folder does not have it."""
    _Store.compiling = call or (lambda: None)


@functools.cache
def compiled(function: Callable[..., PyTree], *, quick: bool = False, over: tuple[int | None, ...] = ()) -> "Program":
    """The function as a compiled program; see `Program`.

    `quick` is for programs that run for milliseconds: without LLVM's optimisations they compile in half the time, and
    run two to three times as long.
    """
    return Program(function, {"xla_backend_optimization_level": 0} if quick else {}, over)


class Program:
    """A function of arrays, given by position, and of static arguments, given by name and hashable.

    It computes as `jax.jit` of the function does, with NumPy's arrays for results; inside another `jit` it is just
    that, unless no result depends on an argument whose values are not known there: then it computes at once. It
    computes on the CPU unless a default device is set (`jgait.geometry.arrays.host`).
    """

    def __init__(
        self, function: Callable[..., PyTree], options: dict[str, str | int] | None = None,
        over: tuple[int | None, ...] = (),
    ) -> None:  # fmt: skip
        """Take the function, compiler options beside those of all programs, and the axes of its arguments over which it
        is mapped, as `jax.vmap` takes them, () for none; nothing is traced yet.
        """
        self.function, self.options, self.over = function, options or {}, over
        self._ready: dict[Hashable, Callable[..., PyTree]] = {}

    def __call__(self, *arrays: PyTree, **static: Hashable) -> PyTree:
        """The result of the function."""
        leaves, structure = jax.tree.flatten(arrays)
        if unknown := [k for k, leaf in enumerate(leaves) if isinstance(leaf, jax.core.Tracer)]:
            inner = _inner(self, tuple(sorted(static.items())))
            operations = inner.trace(*arrays).jaxpr.jaxpr
            if any(reached(operations, {operations.invars[k] for k in unknown})):
                return inner(*arrays)
            for k in unknown:
                leaves[k] = np.zeros(leaves[k].shape, leaves[k].dtype)
            return self(*jax.tree.unflatten(structure, leaves), **static)
        if (cpu := host()) is not None:
            # JAX moves arrays by itself, but for those that were put on a device
            fixed = [isinstance(leaf, jax.Array) and leaf.committed for leaf in leaves]
            moved = [jax.device_put(v, cpu) if stays else v for v, stays in zip(leaves, fixed, strict=True)]
            with jax.default_device(cpu):
                return self(*jax.tree.unflatten(structure, moved), **static)
        shapes, device = tuple(map(_shape, leaves)), str(jax.config.jax_default_device)
        key = (structure, shapes, tuple(sorted(static.items())), bool(jax.config.jax_enable_x64), device)
        program = self._ready.get(key) or self._kept(key, arrays, static)
        if program is None:
            _Store.compiling()
            program = jax.jit(self.of(static), compiler_options=self._options()).lower(*arrays).compile()
        self._ready[key] = program
        return on_host(program(*arrays))

    def of(self, static: dict[str, Hashable]) -> Callable[..., PyTree]:
        """The function of arrays alone."""
        function = functools.partial(self.function, **static)
        return jax.vmap(function, self.over) if self.over else function

    def _options(self) -> dict[str, str | int] | None:
        return compiler_options() | self.options or None

    def _kept(self, key: Hashable, arrays: PyTree, static: dict[str, Hashable]) -> Callable[..., PyTree] | None:
        """The program, traced as the folder has it, or anew and put there; None where none is kept."""
        file = self._file(key)
        if file is None:
            return None
        leaves, structure = jax.tree.flatten(arrays)
        kept = _read(file)
        if kept is None:
            _Store.compiling()
            outputs: list[PyTreeDef] = []

            def flat(*leaves: PyTree) -> list[PyTree]:
                result = self.of(static)(*jax.tree.unflatten(structure, leaves))
                outputs[:] = [jax.tree.structure(result)]
                return jax.tree.leaves(result)

            kept = jax.export.export(jax.jit(flat))(*leaves), outputs[0]
            _write(file, *kept)
        traced, output = kept
        compiled = jax.jit(traced.call, compiler_options=self._options()).lower(*leaves).compile()
        return lambda *given: jax.tree.unflatten(output, compiled(*jax.tree.leaves(given)))

    def _file(self, key: Hashable) -> Path | None:
        """The file of a program; None where none is kept, or where nothing names the function or its arguments."""
        name = f"{self.function.__module__}.{getattr(self.function, '__qualname__', '<none>')}"
        whole = f"{name} {_named(key)!r} {self.options} {self.over}"
        if _Store.folder is None or "<" in name or " at 0x" in whole or backend() != "cpu":
            return None
        digest = hashlib.sha256(f"{whole} {_surroundings()}".encode()).hexdigest()
        return _Store.folder / f"{digest}{ENDING}"


@functools.cache
def _inner(program: Program, static: tuple[tuple[str, Hashable], ...]) -> jax.stages.Wrapped:
    """A program's function as a program inside another one."""
    return jax.jit(program.of(dict(static)))


def _shape(leaf: PyTree) -> Hashable:
    """Shape and type of an array; the type of a Python number."""
    if isinstance(leaf, bool | int | float):
        return type(leaf).__name__
    return leaf.shape, str(leaf.dtype), bool(getattr(leaf, "weak_type", False))


def _named(value: Hashable) -> Hashable:
    """A key with the names of jgait's own functions, of which each version of jgait has one."""
    if isinstance(value, tuple):
        return type(value).__name__, *map(_named, value)
    name = f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', '<none>')}"
    return name if callable(value) and name.startswith("jgait.") and "<" not in name else value


@functools.cache
def _surroundings() -> str:
    """What a program depends on beside its own function: sources, versions, processor, settings."""
    root = Path(__file__).parents[1]
    sources = sorted((str(path.relative_to(root)), path.stat()) for path in root.rglob("*.py"))
    stamps = [(name, stat.st_size, stat.st_mtime_ns) for name, stat in sources]
    settings = jax.config.jax_default_matmul_precision, os.environ.get("XLA_FLAGS")
    return repr((stamps, jax.__version__, platform.python_version(), processor(), jax.device_count(), settings))


def _read(file: Path) -> tuple[jax.export.Exported, PyTreeDef] | None:
    """A program and the structure of its result; None if there is no file, or it is damaged, or of unknown types."""
    try:
        content = file.read_bytes()
        if hashlib.sha256(content[32:]).digest() != content[:32]:
            return None
        described, _, traced = content[32:].partition(b"\n")
        structure = jax.tree.structure(_built(json.loads(described)))
        os.utime(file)
        return jax.export.deserialize(bytearray(traced)), structure
    except Exception:  # whatever another version wrote there
        return None


def _write(file: Path, traced: jax.export.Exported, structure: PyTreeDef) -> None:
    """Put a program into the folder, whole or not at all; nothing happens if that is impossible."""
    # A folder that cannot be written, a type that has no name, no flatbuffers (of `jgait[cli]`).
    with contextlib.suppress(OSError, ValueError, ImportError):
        content = json.dumps(_described(structure)).encode() + b"\n" + traced.serialize()
        with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as part:
            part.write(hashlib.sha256(content).digest() + content)
        os.replace(part.name, file)
        shortened(file.parent, limit=1_000_000_000)


def _described(structure: PyTreeDef) -> Described:
    """A tree as JSON: 0 for a leaf, None for an absent part; else the name of its type, its data and its parts."""
    if structure == jax.tree.structure(None):
        return None
    if (node := structure.node_data()) is None:
        return 0
    kind, data = node
    if kind is Covariance:
        layout, places = data
        data = [_described(layout.structure), layout.shapes, places]
    elif kind is not dict:
        data = None
        if not issubclass(kind, tuple | list):
            raise ValueError(f"no name for {kind}")
    return [f"{kind.__module__}:{kind.__qualname__}", data, *map(_described, structure.children())]


def _built(described: Described) -> PyTree:
    """The tree that `_described` describes; its types are tuples of modules that are loaded."""
    if not isinstance(described, list):
        return described
    name, data, *parts = described
    module, _, inner = name.partition(":")
    kind, values = getattr(sys.modules[module], inner), [_built(part) for part in parts]
    if kind is dict:
        return dict(zip(data, values, strict=True))
    if kind is Covariance:
        tree, shapes, places = data
        layout = Layout(jax.tree.structure(_built(tree)), tuple(map(tuple, shapes)))
        return Covariance(values, layout, None if places is None else tuple(tuple(map(tuple, of)) for of in places))
    if not issubclass(kind, tuple | list):
        raise TypeError(f"{name} is no tuple")
    return kind(*values) if hasattr(kind, "_fields") else kind(values)


def shortened(folder: Path, limit: int) -> None:
    """Remove the files of a folder that were not used for longest, until their sizes are within the limit [bytes]."""
    files = sorted(((path.stat(), path) for path in folder.iterdir() if path.is_file()), key=lambda f: f[0].st_mtime)
    total = sum(stat.st_size for stat, _ in files)
    for stat, path in files:
        if total <= limit:
            break
        path.unlink(missing_ok=True)
        total -= stat.st_size
