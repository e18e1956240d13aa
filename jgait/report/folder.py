"""Read the results of `jgait evaluate` from a folder."""

import json
from pathlib import Path

import jax

from jgait import estimators
from jgait.evaluate.store import Cohort, read_table
from jgait.notes import from_json
from jgait.report.made import Made


def read(folder: Path) -> tuple[Cohort, Made]:
    """The tables of an evaluation that `jgait evaluate` wrote, and its settings.

    Raises:
        FileNotFoundError: if a table or the settings are missing.
        ValueError: if a table lacks a column, or has text instead of numbers, or the settings state no estimator.
    """
    cohort = Cohort(*(read_table(folder / f"{name}.csv", name) for name in Cohort._fields))
    for text in cohort.recordings["notes"]:
        from_json(text)
    about = json.loads((folder / "run" / "cohort.json").read_text(encoding="utf-8"))
    if not isinstance(about, dict) or "estimator" not in about:
        raise ValueError("run/cohort.json does not state how the evaluation was made")
    name = str(about["estimator"])
    default = estimators.get(name).params if name in estimators.names() else None
    stored = json.loads(about["params"])
    values = (
        {name: value for name, value in stored.items() if isinstance(value, float)} if isinstance(stored, dict) else {}
    )
    params = jax.tree_util.tree_map_with_path(
        lambda where, old: values.get(jax.tree_util.keystr(where).lstrip("."), old), default
    )
    stated = folder / "notes.json"
    every = json.loads(stated.read_text(encoding="utf-8")) if stated.is_file() else []
    notes = from_json(json.dumps([one for one in every if one.get("recording") is None]))  # the others are in the table
    version = str(about.get("jgait", ""))
    return cohort, Made(name, params, default, file=folder.resolve().name, notes=notes, version=version)
