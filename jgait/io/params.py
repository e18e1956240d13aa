"""Parameters in a file: their values with units, and how they were computed."""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path

import jax
from jaxtyping import PyTree

from jgait.io.atomic import write_text
from jgait.io.files import reading
from jgait.params import units
from jgait.types import RecordingError
from jgait.version import __version__

FORMAT = 1


def write_params(
    path: str | os.PathLike[str],
    params: PyTree,
    *,
    estimator: str,
    stderr: Mapping[str, float] | None = None,
    made: Mapping[str, PyTree] | None = None,
) -> Path:
    """Write parameters as JSON, each with its unit, and return the path.

    Args:
        path: of the file.
        params: NamedTuple of single numbers, natural units.
        estimator: name of the estimator.
        stderr: name of a parameter (see `units`) → its standard error, where known.
        made: how the parameters were computed; any JSON value.
    """
    rows: dict[str, dict[str, PyTree]] = {}
    unit_of = units(params)
    for where, value in jax.tree_util.tree_flatten_with_path(params)[0]:
        name = jax.tree_util.keystr(where).lstrip(".")
        rows[name] = {"value": float(value), "unit": unit_of[name]}
        spread = (stderr or {}).get(name)
        if spread is not None and math.isfinite(spread):
            rows[name]["stderr"] = float(spread)
    whole = {
        "format": FORMAT, "jgait": __version__, "estimator": estimator, "parameters": rows,
        "made": dict(made or {}),
    }  # fmt: skip
    return write_text(path, json.dumps(whole, indent=1, ensure_ascii=False) + "\n")


def read_params[P](path: str | os.PathLike[str], params: P, *, estimator: str) -> tuple[P, dict[str, PyTree]]:
    """Parameters from a file that `write_params` wrote.

    Args:
        path: of the file.
        params: NamedTuple of single numbers; a parameter that is not in the file keeps its value.
        estimator: name of the expected estimator.

    Returns:
        The parameters, and how they were computed.

    Raises:
        FileNotFoundError: if there is no such file.
        RecordingError: if the file has no parameters, is of another estimator, or has an unknown parameter.
    """
    file = Path(path)
    with reading(file, "a file of parameters"):
        whole = json.loads(file.read_text(encoding="utf-8"))
        rows = {name: float(row["value"]) for name, row in whole["parameters"].items()}
        of, version, made = str(whole["estimator"]), whole["format"], dict(whole.get("made", {}))
    if version != FORMAT:
        raise RecordingError(f"{file} has format {version}; this version of jgait reads {FORMAT}")
    if of != estimator:
        raise RecordingError(f"{file} holds parameters of {of}; {estimator} is wanted")
    flat, structure = jax.tree_util.tree_flatten_with_path(params)
    names = [jax.tree_util.keystr(where).lstrip(".") for where, _ in flat]
    unknown = [name for name in rows if name not in names]
    if unknown:
        raise RecordingError(f"{file} names a parameter {unknown[0]!r} that {estimator} does not have")
    values = [rows.get(name, value) for name, (_, value) in zip(names, flat, strict=True)]
    return jax.tree.unflatten(structure, values), made
