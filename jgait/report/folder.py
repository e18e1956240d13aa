"""Read the results of `jgait evaluate` from a folder."""

import ast
import json
from pathlib import Path
from typing import TYPE_CHECKING

import jax
import numpy as np

from jgait.evaluate.store import COLUMNS, Cohort, frame
from jgait.notes import from_json
from jgait.report.made import Made

if TYPE_CHECKING:
    import pandas as pd

TEXT = ("recording", "subject", "quantity", "side", "notes", "reason")


def read(folder: Path) -> tuple[Cohort, list[tuple[str, str]]]:
    """The tables of an evaluation that `jgait evaluate` wrote, and (recording, reason) of those that could not be used.

    Raises:
        FileNotFoundError: if recordings.csv, quantities.csv, strides.csv or failures.csv is missing.
        ValueError: if a table lacks a column, or has text instead of numbers.
    """
    tables = {name: _table(folder / f"{name}.csv", name) for name in ("recordings", "quantities", "strides")}
    for text in tables["recordings"]["notes"]:
        from_json(text)
    failed = _strings(folder / "failures.csv", COLUMNS["failures"])
    failures = list(zip(failed["recording"], failed["reason"], strict=True))
    return Cohort(**tables, failures=frame("failures", failed)), failures


def _strings(path: Path, columns: tuple[str, ...]) -> dict[str, np.ndarray]:
    import pandas as pd

    # as text: NA can be the name of a subject
    text = pd.read_csv(path, dtype=str, keep_default_na=False, encoding="utf-8")
    lacking = [name for name in columns if name not in text]
    if lacking:
        raise ValueError(f"{path.name} has no column {lacking[0]!r}")
    return {name: text[name].to_numpy(dtype=object) for name in columns}


def _table(path: Path, name: str) -> "pd.DataFrame":
    columns = _strings(path, COLUMNS[name])
    return frame(name, {
        column: values if column in TEXT else [float(value) if value else float("nan") for value in values]
        for column, values in columns.items()
    })  # fmt: skip


def made(folder: Path) -> Made:
    """The settings of an evaluation, read from the folder that `jgait evaluate` wrote.

    Raises:
        OSError: if the folder cannot be read.
        ValueError: if the folder does not contain the settings.
    """
    from jgait import estimators

    about = json.loads((folder / "run" / "cohort.json").read_text(encoding="utf-8"))
    if not isinstance(about, dict) or "estimator" not in about:
        raise ValueError("run/cohort.json does not state how the evaluation was made")
    name = str(about["estimator"])
    default = estimators.get(name).params if name in estimators.names() else None
    values = values_of(str(about.get("params", "")))
    params = jax.tree_util.tree_map_with_path(
        lambda where, old: values.get(jax.tree_util.keystr(where).lstrip("."), old), default
    )
    stated = folder / "notes.json"
    notes = from_json(stated.read_text(encoding="utf-8")) if stated.is_file() else ()
    return Made(name, params, default, file=folder.resolve().name, notes=notes, version=str(about.get("jgait", "")))


def values_of(text: str) -> dict[str, float]:
    """Name → number of a NamedTuple as `jgait.evaluate` prints it; other values are left out."""
    values: dict[str, float] = {}

    def walk(node: ast.expr, prefix: str) -> None:
        if isinstance(node, ast.Call):
            for word in node.keywords:
                walk(word.value, f"{prefix}.{word.arg}".lstrip("."))
            return
        try:
            value = ast.literal_eval(node)
        except ValueError:
            return
        if isinstance(value, int | float):
            values[prefix] = float(value)

    try:
        walk(ast.parse(text, mode="eval").body, "")
    except SyntaxError:
        return {}
    return values
