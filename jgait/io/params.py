"""Parameters in a file: their values with units, and how they were computed."""

import json
import math
import os
import re
from collections.abc import Mapping
from pathlib import Path

import jax
import numpy as np
from jaxtyping import PyTree

from jgait import __version__
from jgait.io.atomic import write_text
from jgait.io.files import check_regular, reading
from jgait.params import Transform, positive, ranges, units
from jgait.types import RecordingError

FORMAT = 1
"""Version of the files; one that changes what a file of parameters holds gets the next."""

PRESETS = Path(__file__).parent / "presets"  # Folder of the parameters that come with jgait


def users_presets() -> Path:
    """The folder of the presets that a user made."""
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "jgait" / "presets"


def write_preset(name: str, params: PyTree, *, made: Mapping[str, PyTree], **more: PyTree) -> Path:
    """Write parameters as the user's preset `name`, with its version: 1, or the next one of the preset of that name.

    Arguments are as of `write_params`. An earlier version is kept beside the preset.

    Raises:
        ValueError: if the name has other characters than letters, digits, "_" and "-", or is that of a preset of jgait.
    """
    file = preset_file(name)
    version = 1
    if file.exists():
        version = int(_read(file)["made"].get("version", 1)) + 1
        file.replace(file.with_suffix(f".v{version - 1}"))
    file.parent.mkdir(parents=True, exist_ok=True)
    return write_params(file, params, made={**made, "version": version}, **more)


def preset_file(name: str) -> Path:
    """The file of the user's preset `name`; errors as of `write_preset`."""
    if not re.fullmatch(r"[\w-]+", name):
        raise ValueError(f"the name of a preset has letters, digits, '_' and '-'; got {name!r}")
    if (PRESETS / f"{name}.json").exists():
        raise ValueError(f"{name!r} is a preset that comes with jgait: choose another name")
    return users_presets() / f"{name}.json"


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
        params: NamedTuple of numbers, natural units; of a fit with values per subject those of one person, `Fit.of`.
        estimator: name of the estimator.
        stderr: name of a parameter (see `units`) → its standard error, where known.
        made: how the parameters were computed; any JSON value.
    """
    rows: dict[str, dict[str, PyTree]] = {}
    unit_of = units(params)
    for where, value in jax.tree_util.tree_flatten_with_path(params)[0]:
        name = jax.tree_util.keystr(where).lstrip(".")
        rows[name] = {"value": np.asarray(value, np.float64).tolist(), "unit": unit_of[name]}
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

    Raises:
        FileNotFoundError: if there is no such file.
        RecordingError: if the file has no parameters, is of another estimator, has an unknown parameter, or a value
            that is no finite number within the parameter's declared range.
    """
    file = params_file(path)
    whole = _read(file)
    if whole["format"] != FORMAT:
        raise RecordingError(f"{file} has format {whole['format']}; this version of jgait reads {FORMAT}")
    if whole["estimator"] != estimator:
        raise RecordingError(f"{file} holds parameters of {whole['estimator']}; {estimator} is wanted")
    flat, structure = jax.tree_util.tree_flatten_with_path(params)
    values = {jax.tree_util.keystr(where).lstrip("."): value for where, value in flat}
    limits = jax.tree.leaves(ranges(params), is_leaf=lambda leaf: isinstance(leaf, Transform))
    limit_of, unit_of = dict(zip(values, limits, strict=True)), units(params)
    with reading(file, "a file of parameters"):
        for name, row in whole["parameters"].items():
            if name not in values:
                raise RecordingError(f"{file} names a parameter {name!r} that {estimator} does not have")
            stated, unit = str(row.get("unit", unit_of[name])), unit_of[name]
            if stated != unit:
                raise RecordingError(f"{file} states {name} in {stated!r}; {unit!r} is wanted, with the value in it")
            values[name] = _checked(f"{file}: {name}", row["value"], np.shape(values[name]), limit_of[name], unit)
    return jax.tree.unflatten(structure, list(values.values())), whole["made"]


def _checked(what: str, value: PyTree, shape: tuple[int, ...], limit: Transform, unit: str) -> np.ndarray:
    """A finite number, or lists of them, of a parameter in a file. Raises RecordingError for anything else."""
    leaves = jax.tree.leaves(value, is_leaf=lambda leaf: leaf is None)
    if not leaves or not all(type(leaf) in (int, float) and math.isfinite(leaf) for leaf in leaves):
        raise RecordingError(f"{what} must be a finite number; it is {value!r}")
    number: np.ndarray = np.asarray(value, np.float64)[()]
    if np.shape(number) != shape:
        per_subject = "of a fit with values per subject, write those of one person, fit.of(subject)"
        raise RecordingError(f"{what} of shape {np.shape(number)}; {shape} is wanted; {per_subject}")
    outside = not np.all((number >= limit.low) & (number <= limit.high))
    if outside or (limit.name.startswith(positive.name) and np.any(number == 0.0)):
        raise RecordingError(f"{what} must be {limit.low:g} to {limit.high:g} {unit}; it is {number}")
    return number


def preset_names() -> tuple[str, ...]:
    """Names of the presets that come with jgait, and of those that the user made."""
    return tuple(sorted({path.stem for folder in (PRESETS, users_presets()) for path in folder.glob("*.json")}))


def params_file(path: str | os.PathLike[str]) -> Path:
    """The file of a path, or of a preset "preset:NAME". Raises ValueError if there is no such preset."""
    kind, _, name = str(path).partition(":")
    if kind != "preset":
        return Path(path)
    if name not in preset_names():
        raise ValueError(f"there is no preset {name!r}; there are {', '.join(preset_names()) or 'none'}")
    shipped = PRESETS / f"{name}.json"
    return shipped if shipped.exists() else users_presets() / f"{name}.json"


def made_of(path: str | os.PathLike[str]) -> tuple[str, dict[str, PyTree]]:
    """The estimator of a file of parameters, and how the parameters were made; errors as of `read_params`."""
    whole = _read(params_file(path))
    return whole["estimator"], whole["made"]


def _read(file: Path) -> dict[str, PyTree]:
    """The content of a file of parameters, with `estimator` a string and `made` a dictionary."""
    check_regular(file, "a file of parameters")
    if not file.is_file():
        raise FileNotFoundError(f"{file}: there is no such file of parameters")
    with reading(file, "a file of parameters"):
        whole = json.loads(file.read_text(encoding="utf-8"))
        for name in ("format", "estimator", "parameters"):
            if not isinstance(whole, dict) or name not in whole:
                written = "expected a file of parameters, as `jgait tune` writes it"
                raise RecordingError(f"{file}: {written}; it has no {name!r}")
        return {**whole, "estimator": str(whole["estimator"]), "made": dict(whole.get("made", {}))}
