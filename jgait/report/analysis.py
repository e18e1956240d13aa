"""The page of one recording by all its sensors together."""

from typing import TYPE_CHECKING

from jgait import io
from jgait.estimators.columns import COLUMNS, QUANTITIES
from jgait.estimators.combined import Analysis
from jgait.report.made import Made
from jgait.report.page import Cell, Report, Section, Table, number
from jgait.report.recording import of_estimate
from jgait.types import Estimate, Recording

if TYPE_CHECKING:
    import pandas as pd

BOUTS = (
    "start_s", "duration_s", "n_strides", "n_regular", "distance_m", "stride_length_m", "walking_speed_mps",
    "cadence_spm",
)  # fmt: skip
"""Columns of the table of bouts that the page shows, as many as fit on paper."""


def of_analysis(
    analysis: Analysis, recording: Recording, *, reference: Estimate | None = None, made: Made | None = None
) -> Report:
    """The page of one recording by all its sensors, from `analyse`: as `of_estimate`, with what each source says, and
    walking bouts. Contradictions between the sources are among the warnings.
    """
    tables = io.analysis_to_dataframes(analysis)
    more = [_sources(analysis), *_bouts(tables["bouts"])]
    return of_estimate(analysis.estimate, recording, reference=reference, made=made, more=more, means=tables["summary"])


def _sources(analysis: Analysis) -> Section:
    rows = []
    for comparison in analysis.comparisons:
        column = QUANTITIES[comparison.quantity]
        words, unit, digits = column.words, column.shown, column.digits
        spread = "–" if comparison.stddev is None else number(comparison.stddev, digits)
        many = str(comparison.strides) if comparison.strides and comparison.quantity != "strides" else "–"
        rows.append([
            Cell(words), Cell(comparison.source), Cell(number(comparison.value, digits)), Cell(spread), Cell(many),
            Cell(unit),
        ])  # fmt: skip
    used = ", ".join(f"{source.name} by {source.estimator}" for source in analysis.sources)
    caption = (
        f"Sources: {used}. Medians over whole strides, ± one standard deviation of one stride or of the distance, as "
        "stated; the combined value is from sources that are not in doubt, weighted by their variances if they agree."
    )
    columns = ("", "source", "value", "± SD", "strides", "unit")
    return Section("What each sensor says", "", [Table(caption, columns, rows)])


def _bouts(table: "pd.DataFrame") -> list[Section]:
    """The bouts of walking; none without strides."""
    if not len(table):
        return []
    shown = [COLUMNS[name] for name in BOUTS]
    rows = [
        [Cell(str(bout["wb_id"] + 1)), *(Cell(number(bout[column.name], column.digits)) for column in shown)]
        for bout in table.to_dict("records")
    ]
    caption = (
        "Walking between pauses; stride length, speed and cadence are medians over the regular strides of the bout."
    )
    headings = ("no.", *(column.heading for column in shown))
    return [Section("Bouts of walking", "", [Table(caption, headings, rows)])]
