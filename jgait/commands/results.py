"""The tables, figures and numbers that `jgait estimate` writes, as the estimator's `about` defines them."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxtyping import PyTree

from jgait import io, plot
from jgait.estimators.about import About, EstimateFigure, EstimateTable
from jgait.estimators.stride_flags import marks, regular
from jgait.notes import Note
from jgait.types import Estimate

if TYPE_CHECKING:
    import pandas as pd


def planned(about: About, name: str, ending: str = "csv") -> list[str]:
    """The names of the files of `tables` and `drawn`, if all are written."""
    return [f"{name}_{table.name}.{ending}" for table in about.tables] + [
        f"{name}_{figure.file}.png" for figure in about.figures
    ]


def tables(estimate: Estimate, about: About) -> "dict[str, pd.DataFrame]":
    """The tables of one recording that are written, by the end of their names."""
    return {table.name: rows_of(table, estimate, about) for table in about.tables if table.when(estimate)}


def drawn(made: PyTree, out: Path, name: str, figures: Sequence[EstimateFigure]) -> list[Path]:
    """Draw the figures that there are into a folder; returns their paths."""
    files = []
    for figure in figures:
        if figure.when(made.estimate):
            arguments, words = figure.arguments(made)
            whole = getattr(plot, figure.plot)(*arguments, title=name, **words)
            files.append(plot.save(whole, out / f"{name}_{figure.file}.png"))
    return files


def rows_of(table: EstimateTable, estimate: Estimate, about: About) -> "pd.DataFrame":
    """The rows of one of the estimator's tables."""
    import pandas as pd

    if table.rows == "samples":
        return io.to_dataframe(estimate)
    if table.rows == "strides":
        strides = io.strides_to_dataframe(estimate)
        words = ["; ".join(words) for words in special(estimate, about)]
        return strides.assign(special=words, regular=regular(estimate, about.flags))
    return pd.DataFrame(table.rows(estimate))


def special(estimate: Estimate, about: About) -> list[list[str]]:
    """The flags of each stride in words, in the order of the table of strides."""
    flagged = marks(estimate, about.flags)
    words = {flag.name: flag.word for flag in about.flags}
    rows = range(len(io.strides_to_dataframe(estimate)))
    return [[words[name] for name, values in flagged.items() if values[row]] for row in rows]


def numbers(estimate: Estimate, about: About, files: list[Path]) -> dict[str, Any]:
    """The JSON numbers of one recording."""
    tables = {}
    for table in (table for table in about.tables if table.json):
        rows = rows_of(table, estimate, about)
        tables[table.json] = records(
            rows.assign(special=special(estimate, about)) if table.rows == "strides" else rows
        )  # fmt: skip
    distance = {"distance_m": None if estimate.distance is None else float(estimate.distance[-1])}
    return {**of_any(estimate, estimate.diagnostics["notes"], files), **distance, **about.numbers(estimate), **tables}


def of_any(estimate: Estimate, notes: Iterable[Note], files: list[Path]) -> dict[str, Any]:
    """The JSON numbers that every result has."""
    return {
        "duration_s": float(estimate.time[-1] - estimate.time[0]),
        "notes": [note.to_dict() for note in notes],
        "files": [str(path) for path in files],
    }


def records(table: "pd.DataFrame") -> list[dict[str, Any]]:
    """The rows of a table as JSON values."""
    rows: list[dict[str, Any]] = json.loads(table.to_json(orient="records", double_precision=6))
    return rows
