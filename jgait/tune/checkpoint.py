"""The state of a fit on disk. A file is written completely or not at all; only the same fit can continue from it."""

import dataclasses
import functools
import hashlib
import inspect
import json
import os
import re
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from jgait.version import __version__


def described(value: object) -> str:
    """A text of a value that is the same in every process: arrays by content, functions by name and source."""
    if isinstance(value, functools.partial):
        return f"partial{described((value.func, value.args, value.keywords))}"
    if isinstance(value, jax.Array) and jnp.issubdtype(value.dtype, jax.dtypes.prng_key):
        value = jax.random.key_data(value)
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        array = np.ascontiguousarray(value)
        if not np.ndim(value):
            return repr(array.item())
        return f"{array.dtype}{list(array.shape)} {hashlib.sha256(array.tobytes()).hexdigest()[:16]}"
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return f"{type(value).__qualname__}({_pairs(fields)})"
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return f"{type(value).__qualname__}({_pairs(dict(zip(value._fields, value, strict=True)))})"
    if isinstance(value, tuple | list):
        return f"({', '.join(map(described, value))})"
    if isinstance(value, dict):
        return f"{{{_pairs(value)}}}"
    if callable(value) and hasattr(value, "__qualname__"):
        return f"{value.__module__}.{value.__qualname__}{_source(value)}"
    return re.sub(r" at 0x[0-9a-fA-F]+", "", repr(value))


def _source(function: Callable[..., PyTree]) -> str:
    """The digest of a function's source; "" where there is none, as of a function typed into an interpreter."""
    try:
        return f" {hashlib.sha256(inspect.getsource(inspect.unwrap(function)).encode()).hexdigest()[:16]}"
    except (OSError, TypeError):
        return ""


def _pairs(values: dict[str, PyTree]) -> str:
    return ", ".join(f"{name}={described(value)}" for name, value in values.items())


def fingerprint(**parts: object) -> dict[str, str]:
    """A digest of the description of each argument of a fit, and of the version of jgait."""
    texts = {name: described((str(jax.tree.structure(part)), jax.tree.leaves(part))) for name, part in parts.items()}
    texts["version of jgait"] = __version__
    return {name: hashlib.sha256(text.encode()).hexdigest()[:32] for name, text in texts.items()}


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

    Raises:
        ValueError: if the file is not a checkpoint.
        OtherFitError: if the checkpoint is of another fit than `mark`; the message states the differences.
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
