"""The state of a fit on disk. A file is written completely or not at all; only the same fit can continue from it."""

import dataclasses
import functools
import hashlib
import inspect
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from types import CellType, FunctionType, MethodType

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from jgait import __version__

UNKNOWN = " at an address"
"""Stands in `described` for the address of an object of which nothing but the type is known."""


def described(value: object, within: tuple[object, ...] = ()) -> str:
    """A text of a value that is the same in every process: arrays by content, functions by name, source, and the values
    of other functions that they keep. `within` are the functions to which the value belongs.
    """

    def each(values: Mapping[str, object]) -> str:
        return ", ".join(f"{name}={described(part, within)}" for name, part in values.items())

    if isinstance(value, jax.Array) and jnp.issubdtype(value.dtype, jax.dtypes.prng_key):
        value = jax.random.key_data(value)
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        array = np.ascontiguousarray(value)
        if not np.ndim(value):
            return repr(array.item())
        return f"{array.dtype}{list(array.shape)} {hashlib.sha256(array.tobytes()).hexdigest()[:16]}"
    if isinstance(value, functools.partial):
        return f"partial{described((value.func, value.args, value.keywords), within)}"
    if isinstance(value, MethodType):
        return f"{described(value.__func__, within)} of {described(vars(value.__self__), within)}"
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return f"{type(value).__qualname__}({each(fields)})"
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return f"{type(value).__qualname__}({each(value._asdict())})"
    if isinstance(value, set | frozenset):
        return f"{{{', '.join(sorted(described(part, within) for part in value))}}}"
    if isinstance(value, tuple | list):
        return f"({', '.join(described(part, within) for part in value)})"
    if isinstance(value, dict):
        return f"{{{each(value)}}}"
    if callable(value) and hasattr(value, "__qualname__"):
        name, function = f"{value.__module__}.{value.__qualname__}", inspect.unwrap(value)
        if not isinstance(function, FunctionType) or any(function is other for other in within):
            return name
        try:
            source = inspect.getsource(function)
        except (OSError, TypeError):  # there is none, as in an interactive session
            source = ""
        cells = [_kept(cell) for cell in function.__closure__ or ()]
        text = described((cells, function.__defaults__, function.__kwdefaults__), (*within, function))
        return f"{name} {_digest(source + text)}{UNKNOWN if UNKNOWN in text else ''}"
    return re.sub(r" at 0x[0-9a-fA-F]+", UNKNOWN, repr(value))


def _kept(cell: CellType) -> object:
    """A value that a function keeps; of one that may change in place, such as a counter's list, the type alone."""
    try:
        value = cell.cell_contents
    except ValueError:  # it has none yet
        return None
    return f"{type(value).__name__}{UNKNOWN}" if isinstance(value, dict | list | set) else value


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def fingerprint(**parts: object) -> dict[str, str]:
    """A digest of the description of each argument of a fit, and of the version of jgait."""
    texts = {name: described((str(jax.tree.structure(part)), jax.tree.leaves(part))) for name, part in parts.items()}
    texts["version of jgait"] = __version__
    return {name: _digest(text) for name, text in texts.items()}


def save(path: Path, mark: dict[str, str], state: PyTree) -> None:
    """Write a pytree of arrays with the fingerprint of its fit; an existing file stays intact until then."""
    path.parent.mkdir(parents=True, exist_ok=True)
    leaves: dict[str, PyTree] = {f"leaf{i}": np.asarray(leaf) for i, leaf in enumerate(jax.tree.leaves(state))}
    meta = json.dumps({"mark": mark, "leaves": len(leaves)})
    new = path.with_name(f"{path.name}.part")  # one name: what a killed process left is overwritten
    try:
        with new.open("wb") as file:
            np.savez(file, meta=np.asarray(meta), **leaves)
            file.flush()
            os.fsync(file.fileno())
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)


class OtherFitError(ValueError):
    """A file holds a fit with other data or settings."""


def load(path: Path, mark: dict[str, str], like: PyTree) -> PyTree:
    """Read a pytree that `save` wrote, in the structure of `like`, as NumPy arrays; None if there is no file.

    Raises ValueError if it is no checkpoint, and OtherFitError, naming the differences, if it is of another fit.
    """
    if not path.exists():
        return None
    try:
        with np.load(path, allow_pickle=False) as file:
            meta = json.loads(str(file["meta"]))
            leaves = [file[f"leaf{i}"] for i in range(meta["leaves"])]
    except Exception as error:
        raise ValueError(f"{path} is no checkpoint of a fit ({type(error).__name__}: {error})") from error
    other = sorted(name for name in mark.keys() | meta["mark"].keys() if mark.get(name) != meta["mark"].get(name))
    structure: PyTree = jax.tree.structure(like)
    if other or structure.num_leaves != len(leaves):
        what = ", ".join(other) or "optimizer"
        raise OtherFitError(f"{path} belongs to another fit: {what} differ; delete it, or name another file")
    return jax.tree.unflatten(structure, leaves)
