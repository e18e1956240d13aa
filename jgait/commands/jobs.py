"""What `jgait estimate` writes and prints of each recording, by one estimator or by all that the sensors allow."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from jaxtyping import PyTree

from jgait import io, plot
from jgait.commands import options
from jgait.estimators.about import About, EstimatedRecording, EstimateFigure, EstimateTable
from jgait.estimators.combined import Analysis, analyse
from jgait.estimators.totals import FOOT_PATH, JOINT_ANGLES, LEG_STRIDES, WAY, distance_of, has_legs, has_strides
from jgait.io.flags import Flag, marked, of_result
from jgait.io.results import CAPTION, Results
from jgait.notes import Note, without_repeats
from jgait.types import Recording

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
    flags: list[Flag]  #: what a reader should know before using the numbers, as on a page.

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
    name: str = "all"  #: of the estimator.
    paper: bool = False  #: whether it is the paper's pipeline.
    caption: str = CAPTION  #: text below the table that is printed.

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
    choice = options.chosen(estimator, paper, params, given)
    stated, about = options.person_in(person), choice.estimator.about

    def compute(recording: Recording, known: Mapping[str, PyTree]) -> RecordingResults:
        p, lacking = choice.personal({**known, **stated})
        estimate = choice.estimate(p, recording)
        notes = (*without_repeats((*recording.notes, *estimate.diagnostics["notes"])), *lacking)
        estimate = estimate._replace(diagnostics={**estimate.diagnostics, "notes": notes})
        return of_estimate(EstimatedRecording(recording, estimate, p, choice.settings), about)

    caption = about.caption.format(**choice.settings)
    return EstimateJob(about, compute, estimator, paper, "; ".join(filter(None, (caption, CAPTION))))


def all_sensors(person: Mapping[str, PyTree]) -> EstimateJob:
    """Every estimator that has its sensors."""

    def compute(recording: Recording, known: Mapping[str, PyTree]) -> RecordingResults:
        return of_analysis(analyse(recording, {**known, **person}))

    return EstimateJob(ALL, compute)


def of_estimate(made: EstimatedRecording, about: About) -> RecordingResults:
    """The results of one estimator, whose `about` states the tables and numbers."""
    import pandas as pd

    estimate, results, tables = made.estimate, Results(made.estimate), {}
    for table in (table for table in about.tables if table.when(estimate)):
        if table.rows == "samples":
            tables[table.name] = io.to_dataframe(estimate)
        elif table.rows == "strides":
            tables[table.name] = results.base.assign(special=results.special, regular=results.regular)
        else:
            tables[table.name] = pd.DataFrame(table.rows(estimate))
    listed = {table.json: tables[table.name] for table in about.tables if table.json and table.name in tables}
    notes = tuple(estimate.diagnostics.get("notes", ()))
    flags = of_result(results, notes)
    totals = marked(results.totals, flags)
    rows = [*([total.words, total.text] for total in totals), *map(list, about.facts(estimate))]
    return _of(made, notes, results, tables, rows, listed, about.numbers(estimate), flags)


def of_analysis(made: Analysis) -> RecordingResults:
    """The results of all sensors: a row for each quantity, combined with its standard deviation, and of each source."""
    results = Results(made)
    tables = io.analysis_to_dataframes(made)
    kept = {name: table for name, table in tables.items() if len(table) or name == "summary"}  # many are joined
    listed = {name: table for name, table in tables.items() if name != "samples" and len(table)}
    flags = of_result(results, made.notes)
    rows = [[total.words, total.text, total.source] for total in marked(results.totals, flags)]
    return _of(made, made.notes, results, kept, rows, listed, {"person": made.person}, flags)


def _of(
    made: PyTree, notes: tuple[Note, ...], results: Results, tables: "Mapping[str, pd.DataFrame]",
    rows: list[list[str]], listed: "Mapping[str, pd.DataFrame]", more: Mapping[str, Any], flags: list[Flag],
) -> RecordingResults:  # fmt: skip
    estimate = results.estimate
    distance, deviation = distance_of(estimate) or (None, None)
    numbers = {
        "duration_s": float(estimate.time[-1] - estimate.time[0]), "notes": [note.to_dict() for note in notes],
        "distance_m": distance, "distance_std_m": deviation, **more,
        **{name: json.loads(table.to_json(orient="records", double_precision=6)) for name, table in listed.items()},
    }  # fmt: skip
    return RecordingResults(made, notes, tables, rows, numbers, flags)
