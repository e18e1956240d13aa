"""The tables, figures and numbers that `jgait estimate` writes, as the estimator's `about` defines them."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxtyping import PyTree

from jgait.estimators.about import About, EstimatedRecording, EstimateTable
from jgait.estimators.stride_flags import marks, regular
from jgait.types import Estimate

if TYPE_CHECKING:
    import pandas as pd


def planned(about: About, name: str, ending: str = "csv") -> list[str]:
    """The names of the files that `written` may write."""
    return [f"{name}_{table.name}.{ending}" for table in about.tables] + [
        f"{name}_{figure.file}.png" for figure in about.figures
    ]


def written(made: EstimatedRecording, about: About, out: Path, name: str, ending: str = "csv") -> list[Path]:
    """Write tables and figures of one recording into a folder; their names begin with `name`. Returns their paths."""
    from jgait import io, plot

    files = []
    for table in about.tables:
        if table.when(made.estimate):
            files.append(io.write_table(rows_of(table, made.estimate, about), out / f"{name}_{table.name}.{ending}"))
    for figure in about.figures:
        if figure.when(made.estimate):
            arguments, words = figure.arguments(made)
            drawn = getattr(plot, figure.plot)(*arguments, title=name, **words)
            files.append(plot.save(drawn, out / f"{name}_{figure.file}.png"))
    return files


def rows_of(table: EstimateTable, estimate: Estimate, about: About) -> "pd.DataFrame":
    """The rows of one of the estimator's tables."""
    import pandas as pd

    from jgait import io

    if table.rows == "samples":
        return io.to_dataframe(estimate)
    if table.rows == "strides":
        strides = io.strides_to_dataframe(estimate)
        words = ["; ".join(words) for words in special(estimate, about)]
        return strides.assign(special=words, regular=regular(estimate, about.flags))
    return pd.DataFrame(table.rows(estimate))


def special(estimate: Estimate, about: About) -> list[list[str]]:
    """The flags of each stride in words, in the order of the table of strides."""
    from jgait import io

    flagged = marks(estimate, about.flags)
    words = {flag.name: flag.word for flag in about.flags}
    rows = range(len(io.strides_to_dataframe(estimate)))
    return [[words[name] for name, values in flagged.items() if values[row]] for row in rows]


def numbers(estimate: Estimate, about: About, files: list[Path]) -> dict[str, Any]:
    """The JSON numbers of one recording."""
    distance = None if estimate.distance is None else float(estimate.distance[-1])
    of_all = {
        "duration_s": float(estimate.time[-1] - estimate.time[0]),
        "distance_m": distance,
        "notes": [note.to_dict() for note in estimate.diagnostics["notes"]],
        "files": [str(path) for path in files],
    }
    tables = {table.json: _records(table, estimate, about) for table in about.tables if table.json}
    return {**of_all, **about.numbers(estimate), **tables}


def _records(table: EstimateTable, estimate: Estimate, about: About) -> list[dict[str, PyTree]]:
    frame = rows_of(table, estimate, about)
    if table.rows == "strides":
        frame = frame.assign(special=special(estimate, about))
    records: list[dict[str, PyTree]] = json.loads(frame.to_json(orient="records", double_precision=6))
    return records
