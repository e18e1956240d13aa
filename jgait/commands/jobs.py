"""What `jgait estimate` writes and prints of each recording, by one estimator or by all that the sensors allow."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from jaxtyping import PyTree

from jgait import io, plot
from jgait import report as reports
from jgait.commands import options
from jgait.commands.pipeline import chosen
from jgait.estimators.about import About, EstimatedRecording, EstimateFigure, EstimateTable
from jgait.estimators.combined import Analysis, analyse
from jgait.estimators.stride_flags import regular
from jgait.estimators.totals import FOOT_PATH, JOINT_ANGLES, LEG_STRIDES, WAY, distance_of, has_legs, has_strides
from jgait.io.strides import special
from jgait.io.totals import CAPTION, totals, totals_by_source
from jgait.notes import Note, without_repeats
from jgait.report.flags import of_result
from jgait.report.page import Flag
from jgait.types import Estimate, Recording

if TYPE_CHECKING:
    import pandas as pd

ALL = About(
    caption=CAPTION,
    tables=(
        *(EstimateTable(name, lambda _: ()) for name in ("strides", "summary", "bouts", "contacts", "sources")),
        EstimateTable("samples", "samples"),
    ),
    figures=(
        LEG_STRIDES, JOINT_ANGLES._replace(when=has_legs), FOOT_PATH._replace(when=has_legs),
        WAY._replace(when=lambda estimate: estimate.distance is not None and has_strides(estimate)),
    ),
)  # fmt: skip
"""Tables, of `io.analysis_to_dataframes`, and figures of all sensors together."""


class RecordingResults(NamedTuple):
    """The results of one recording."""

    made: PyTree  #: an `Analysis` or an `EstimatedRecording`, from which figures are drawn.
    notes: tuple[Note, ...]
    tables: "Mapping[str, pd.DataFrame]"  #: table that is written, by the end of its name.
    rows: list[list[str]]  #: of the printed table, without the recording.
    numbers: Mapping[str, PyTree]  #: for the JSON file.

    def flags(self) -> list[Flag]:
        """What a reader should know before using the numbers, as on a page."""
        return of_result(self.made.estimate, self.notes)

    def drawn(self, out: Path, name: str, figures: tuple[EstimateFigure, ...]) -> list[Path]:
        """Draw the figures that there are into a folder; returns their paths."""
        files = []
        for figure in figures:
            if figure.when(self.made.estimate):
                arguments, words = figure.arguments(self.made)
                whole = getattr(plot, figure.plot)(*arguments, title=name, **words)
                files.append(plot.save(whole, out / f"{name}_{figure.file}.png"))
        return files


class EstimateJob(NamedTuple):
    """The work on one recording after another."""

    about: About  #: states tables and figures.
    compute: Callable[[Recording, Mapping[str, PyTree]], RecordingResults]  #: (recording, measures of a person) → all.
    made: reports.Made  #: how the results are made, for a page.
    caption: str = CAPTION  #: text below the table that is printed.

    @property
    def name(self) -> str:
        """Name of the estimator, or "all"."""
        return self.made.estimator if self.made.default is not None else "all"

    @property
    def title(self) -> str:
        """Of the table that is printed."""
        return f"{self.made.estimator}, the paper's pipeline" if self.made.pipeline else self.made.estimator

    @property
    def joined(self) -> list[str]:
        """The tables of which there is one of all recordings; those of samples are left out."""
        return [table.name for table in self.about.tables if table.rows != "samples"]

    def planned(self, name: str, ending: str) -> list[str]:
        """The names of the files of a recording that may be written, by their first part."""
        tables = [f"{name}_{table.name}.{ending}" for table in self.about.tables]
        return tables + [f"{name}_{figure.file}.png" for figure in self.about.figures]


def job_of(
    estimator: str | None, paper: bool, params: Path | None, person: Path | None, given: dict[str, str]
) -> EstimateJob:
    """The work that the options ask for, by one estimator or by all; exits with code 2 if they do not go together."""
    if estimator is None:
        return all_sensors(options.person_of(person, given))
    choice = chosen(estimator, paper, params, given)
    stated, about = options.person_in(person), choice.estimator.about

    def compute(recording: Recording, known: Mapping[str, PyTree]) -> RecordingResults:
        p, lacking = choice.personal({**known, **stated})
        estimate = choice.estimate(p, recording)
        notes = (*without_repeats((*recording.notes, *estimate.diagnostics["notes"])), *lacking)
        estimate = estimate._replace(diagnostics={**estimate.diagnostics, "notes": notes})
        return of_estimate(EstimatedRecording(recording, estimate, p, choice.settings), about)

    made = reports.Made(estimator, None, choice.estimator.params, "the paper's" if paper else "")
    return EstimateJob(
        about, compute, made, "; ".join(filter(None, (about.caption.format(**choice.settings), CAPTION)))
    )


def all_sensors(person: Mapping[str, PyTree]) -> EstimateJob:
    """Every estimator that has its sensors."""

    def compute(recording: Recording, known: Mapping[str, PyTree]) -> RecordingResults:
        return of_analysis(analyse(recording, {**known, **person}))

    return EstimateJob(ALL, compute, reports.Made("all sensors together"))


def of_estimate(made: EstimatedRecording, about: About) -> RecordingResults:
    """The results of one estimator, whose `about` states the tables and numbers."""
    import pandas as pd

    estimate, notes = made.estimate, tuple(made.estimate.diagnostics.get("notes", ()))

    def rows_of(table: EstimateTable) -> "pd.DataFrame":
        if table.rows == "samples":
            return io.to_dataframe(estimate)
        if table.rows == "strides":
            flagged = {"special": special(estimate, about.flags), "regular": regular(estimate, about.flags)}
            return io.strides_to_dataframe(estimate).assign(**flagged)
        return pd.DataFrame(table.rows(estimate))

    tables = {table.name: rows_of(table) for table in about.tables if table.when(estimate)}
    words = [[total.words, total.text] for total in totals(estimate, about.flags)]
    listed = {table.json: _records(tables[table.name]) for table in about.tables if table.json and table.name in tables}
    numbers = {**_numbers(estimate, notes), **about.numbers(estimate), **listed}
    return RecordingResults(made, notes, tables, [*words, *map(list, about.facts(estimate))], numbers)


def of_analysis(made: Analysis) -> RecordingResults:
    """The results of all sensors: a row for each quantity, combined with its standard deviation, and of each source."""
    rows = [[total.words, total.text, total.source] for total in totals_by_source(made)]
    tables = io.analysis_to_dataframes(made)
    listed = {name: _records(table) for name, table in tables.items() if name != "samples" and len(table)}
    kept = {name: table for name, table in tables.items() if len(table) or name == "summary"}  # many are joined
    numbers = {**_numbers(made.estimate, made.notes), "person": made.person, **listed}
    return RecordingResults(made, made.notes, kept, rows, numbers)


def _numbers(estimate: Estimate, notes: tuple[Note, ...]) -> dict[str, Any]:
    distance, deviation = distance_of(estimate) or (None, None)
    return {
        "duration_s": float(estimate.time[-1] - estimate.time[0]), "notes": [note.to_dict() for note in notes],
        "distance_m": distance, "distance_std_m": deviation,
    }  # fmt: skip


def _records(table: "pd.DataFrame") -> list[dict[str, Any]]:
    """The rows of a table as JSON values."""
    rows: list[dict[str, Any]] = json.loads(table.to_json(orient="records", double_precision=6))
    return rows
