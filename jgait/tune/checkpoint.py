"""The state of a fit on disk. A file is written completely or not at all; only the same fit can continue from it."""

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from jgait.tune.identity import described, printed
from jgait.version import __version__


def fingerprint(**parts: object) -> dict[str, str]:
    """A digest of each part of a fit: of the bytes of numbers, of the text of everything else; and of the version."""
    return {name: _digest(part) for name, part in {**parts, "version of jgait": __version__}.items()}


def _digest(part: object) -> str:
    digest = hashlib.sha256()
    leaves, structure = jax.tree.flatten(part)
    digest.update(printed(structure).encode())
    for leaf in leaves:
        if hasattr(leaf, "dtype") and jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
            leaf = jax.random.key_data(leaf)
        if hasattr(leaf, "dtype") or isinstance(leaf, int | float | bool):
            array = np.ascontiguousarray(leaf)
            digest.update(f"{array.dtype}{array.shape}".encode() + array.tobytes())
        else:
            digest.update(described(leaf).encode())
    return digest.hexdigest()[:32]


def save(path: Path, mark: dict[str, str], state: PyTree) -> None:
    """Write a pytree of arrays with the fingerprint of its fit; an existing file stays intact until then."""
    path.parent.mkdir(parents=True, exist_ok=True)
    leaves: dict[str, Any] = {f"leaf{i}": np.asarray(leaf) for i, leaf in enumerate(jax.tree.leaves(state))}
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
