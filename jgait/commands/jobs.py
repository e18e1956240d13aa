"""What `jgait estimate` does with each recording: one estimator, or all that the sensors allow."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import PyTree
from rich.table import Table

from jgait import io
from jgait.commands import results
from jgait.commands.console import table_of
from jgait.commands.pipeline import Choice
from jgait.estimators.about import EstimatedRecording
from jgait.estimators.combined import Analysis, analyse
from jgait.estimators.notes import without_repeats
from jgait.estimators.stride_flags import STRIDE_FLAGS
from jgait.estimators.totals import (
    CAPTION,
    FOOT_PATH,
    JOINT_ANGLES,
    LEG_STRIDES,
    WAY,
    has_legs,
    has_strides,
    totals,
)
from jgait.notes import Note
from jgait.report.analysis import QUANTITIES
from jgait.report.flags import of_result
from jgait.report.page import Flag
from jgait.types import Recording

if TYPE_CHECKING:
    import pandas as pd

ENDINGS = ("csv", "parquet", "json")
"""Formats of tables."""

TABLES = ("strides", "summary", "bouts", "contacts", "sources", "samples")
FIGURES = (
    LEG_STRIDES, JOINT_ANGLES._replace(when=has_legs), FOOT_PATH._replace(when=has_legs),
    WAY._replace(when=lambda estimate: estimate.distance is not None and has_strides(estimate)),
)  # fmt: skip
"""Tables and figures of all sensors together."""


class EstimateJob(NamedTuple):
    """The work on one recording after another."""

    name: str  #: name of the estimator, or "all".
    table: Table  #: table that is printed, without rows.
    caption: str  #: text below the table.
    ending: str  #: format of the tables, of `ENDINGS`.
    planned: Callable[[str], list[str]]  #: first part of the names of files → the files that may be written.
    joined: tuple[str, ...]  #: tables of which there is one of all recordings; those of samples are left out.
    compute: Callable[[Recording, Mapping[str, PyTree]], PyTree]  #: (recording, measures of its person) → result.
    notes: Callable[[PyTree], tuple[Note, ...]]  #: result → notes.
    flags: Callable[[PyTree], list[Flag]]  #: result → what a reader should know before using its numbers, as on a page.
    tables: Callable[[PyTree], "dict[str, pd.DataFrame]"]  #: result → table that is written, by the end of its name.
    draw: Callable[[PyTree, Path, str], list[Path]]  #: (result, folder, first part of the names) → figures written.
    rows: Callable[[PyTree], list[list[str]]]  #: result → rows of the printed table, without the recording.
    numbers: Callable[[PyTree, list[Path]], dict[str, PyTree]]  #: (result, files) → numbers for the JSON file.


def one_estimator(choice: Choice, person: Mapping[str, PyTree], title: str, ending: str) -> EstimateJob:
    """The estimator that the options select."""
    about = choice.estimator.about

    def compute(recording: Recording, known: Mapping[str, PyTree]) -> EstimatedRecording:
        p, lacking = choice.personal({**known, **person})
        result = choice.estimate(p, recording)
        notes = (*without_repeats((*recording.notes, *result.diagnostics["notes"])), *lacking)
        result = result._replace(diagnostics={**result.diagnostics, "notes": notes})
        return EstimatedRecording(recording, result, p, choice.settings)

    def rows(made: EstimatedRecording) -> list[list[str]]:
        found = [(one.words, one.text) for one in totals(made.estimate, about.flags)]
        return [[*row] for row in [*found, *about.facts(made.estimate)]]

    table = table_of("recording", "quantity", "value", left=3, title=title)
    caption = "; ".join(filter(None, (about.caption.format(**choice.settings), CAPTION)))
    return EstimateJob(
        choice.estimator.name, table, caption, ending, lambda name: results.planned(about, name, ending),
        tuple(table.name for table in about.tables if table.rows != "samples"), compute,
        lambda made: made.estimate.diagnostics["notes"],
        lambda made: of_result(made.estimate, made.estimate.diagnostics["notes"]),
        lambda made: results.tables(made.estimate, about),
        lambda made, out, name: results.drawn(made, out, name, about.figures), rows,
        lambda made, files: results.numbers(made.estimate, about, files),
    )  # fmt: skip


def all_sensors(person: Mapping[str, PyTree], ending: str) -> EstimateJob:
    """Every estimator that has its sensors."""

    def planned(name: str) -> list[str]:
        return [f"{name}_{table}.{ending}" for table in TABLES] + [f"{name}_{figure.file}.png" for figure in FIGURES]

    def tables(made: Analysis) -> "dict[str, pd.DataFrame]":
        every = io.analysis_to_dataframes(made).items()
        return {key: rows for key, rows in every if len(rows) or key == "summary"}  # tables of many are joined

    table = table_of("recording", "quantity", "combined", "each alone", left=4, title="all sensors together")
    return EstimateJob(
        "all", table, CAPTION, ending, planned, TABLES[:-1],
        lambda recording, known: analyse(recording, {**known, **person}), lambda made: made.notes,
        lambda made: of_result(made.estimate, made.notes), tables, partial(results.drawn, figures=FIGURES), _rows,
        _numbers,
    )  # fmt: skip


def _rows(made: Analysis) -> list[list[str]]:
    """A row for each quantity: the combined value with its standard deviation, and the value of each source."""
    alone: dict[str, list[str]] = {}
    for one in made.comparisons:
        if one.source != "combined":
            alone.setdefault(one.quantity, []).append(f"{one.source} {one.value:.{QUANTITIES[one.quantity][2]}f}")
    seen = None if made.strides is None else np.array(made.strides.first) == "feet"
    return [
        [one.words, one.text, ", ".join(alone.get(one.quantity, ()))]
        for one in totals(made.estimate, STRIDE_FLAGS, seen)
    ]


def _numbers(made: Analysis, files: list[Path]) -> dict[str, PyTree]:
    """The JSON numbers of an analysis: its tables but for the samples, notes, and the person."""
    distance = next((c for c in made.comparisons if (c.source, c.quantity) == ("combined", "distance")), None)
    tables = io.analysis_to_dataframes(made).items()
    return {
        **results.of_any(made.estimate, made.notes, files),
        "distance_m": None if distance is None else distance.value,
        "distance_std_m": None if distance is None else distance.stddev,
        "person": made.person,
        **{name: results.records(rows) for name, rows in tables if name != "samples" and len(rows)},
    }
