"""The page of one recording, by one estimator or by all its sensors."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jgait.estimators import about_of, stride_flags
from jgait.estimators.about import EstimatedRecording
from jgait.estimators.columns import COLUMNS, QUANTITIES, UNITS
from jgait.estimators.combined import Analysis
from jgait.estimators.totals import distance_of
from jgait.evaluate.scores import score
from jgait.io.combined import analysis_to_dataframes
from jgait.io.totals import CAPTION, Total, totals, totals_by_source
from jgait.report import flags, strides
from jgait.report.figures import pictures
from jgait.report.made import Made
from jgait.report.page import Cell, Content, Report, Section, Table, number, significant
from jgait.types import SIDES, Estimate, Recording, Walk

if TYPE_CHECKING:
    import pandas as pd

CURVES = {
    "hip": "hip angle", "knee": "knee angle", "x": "ankle forward of hip", "y": "ankle above hip",
    "foot": "foot, seen from above", "foot_height": "foot, height",
}  # fmt: skip
"""First part of the name of a root mean square error → the name of the curve."""


NO_STRIDES = "No strides were found in this recording."

BOUTS = (
    "start_s", "duration_s", "n_strides", "n_regular", "distance_m", "stride_length_m", "walking_speed_mps",
    "cadence_spm",
)  # fmt: skip
"""Columns of the table of bouts that the page shows, as many as fit on paper."""


def of_analysis(
    analysis: Analysis, recording: Recording, *, reference: Estimate | None = None, made: Made | None = None,
    more: Sequence[Section] = (),
) -> Report:  # fmt: skip
    """The page of one recording by all its sensors, from `analyse`: as `of_estimate`, with what each source says, and
    walking bouts. Contradictions between the sources are among the warnings.
    """
    tables = analysis_to_dataframes(analysis)
    rows = []
    for comparison in analysis.comparisons:
        column, counted = QUANTITIES[comparison.quantity], comparison.strides and comparison.quantity != "strides"
        value, spread = (number(value, column.digits) for value in (comparison.value, comparison.stddev))
        cells = (column.words, comparison.source, value, spread, str(comparison.strides) if counted else "–")
        rows.append([*map(Cell, cells), Cell(column.shown)])
    used = ", ".join(f"{source.name} by {source.estimator}" for source in analysis.sources)
    caption = (
        f"Sources: {used}. Medians over whole strides, ± one standard deviation of the error of a stride or of the "
        "distance; the combined value is from sources that are not in doubt, weighted by their variances if they agree."
    )
    table = Table(caption, ("", "source", "value", "± SD", "strides", "unit"), rows)
    more = [*more, Section("What each sensor says", "", [table])]
    if len(tables["bouts"]):
        shown = [COLUMNS[name] for name in BOUTS]
        rows = [
            [Cell(str(bout["wb_id"] + 1)), *(Cell(number(bout[column.name], column.digits)) for column in shown)]
            for bout in tables["bouts"].to_dict("records")
        ]
        caption = (
            "Walking between pauses; stride length, speed and cadence are medians over the regular strides of the bout."
        )
        bouts = Table(caption, ("no.", *(column.heading for column in shown)), rows)
        more.append(Section("Bouts of walking", "", [bouts]))
    return of_estimate(
        analysis.estimate, recording, reference=reference, made=made, more=more, means=tables["summary"],
        measured=totals_by_source(analysis),
    )  # fmt: skip


def of_estimate(
    estimate: Estimate, recording: Recording, *, reference: Estimate | None = None, made: Made | None = None,
    more: Sequence[Section] = (), means: "pd.DataFrame | None" = None, measured: Sequence[Total] | None = None,
) -> Report:  # fmt: skip
    """The page of one recording: numbers, trust, figures with bands, means by side, all strides, settings.

    Args:
        estimate: of one recording, the result of an estimator's `estimate`.
        recording: the signals.
        reference: an independent measurement, drawn dashed and compared, or None.
        made: settings of the computation; None leaves this out.
        more: further sections, after the means of the strides.
        means: the summary of the strides, see `io.summary.summary`; None: of those of the estimate.
        measured: the numbers above the page; None: `io.totals.totals` of the estimate.

    Raises:
        ValueError: if the estimate is not of one recording.
        ImportError: without the extra `cli`.
    """
    if np.ndim(estimate.time) != 1:
        raise ValueError(f"a report is of one recording, time of shape (T,); got shape {np.shape(estimate.time)}")
    made = Made() if made is None else made
    of = strides.strides_of(estimate)
    rows = strides.means(of) if means is None else means
    raised = flags.of_result(estimate, (*estimate.diagnostics.get("notes", recording.notes), *made.notes), of)
    about = about_of(made.estimator)
    params = made.params if made.params is not None else made.default
    settings = {"options": about.paper if made.pipeline else about.default}
    sources = None if params is None else EstimatedRecording(recording, estimate, params, settings)
    none = "No stride is regular, so that there are no means." if len(of.table) else NO_STRIDES
    glance = [table for table in [strides.mean_table(rows)] if table.rows]
    against = [] if reference is None else [_against(estimate, recording, reference)]
    each = [strides.stride_table(of)] if len(of.table) else []
    sections = [
        Section("Figures", "", pictures(estimate, reference, about.figures, sources)), *against,
        Section("Gait at a glance", "" if glance else none, glance), *more, Section("Stride by stride", "", each),
        _details(estimate, recording, made),
    ]  # fmt: skip
    who = "" if recording.subject in ("", "subject", recording.name) else f", {recording.subject}"
    seconds, rate = float(estimate.time[-1] - estimate.time[0]), significant(recording.sampling_rate_hz, 4)
    worn = ", ".join(map(_place, recording.sensors))
    lead = f"{about.title}{who}; {number(seconds, 1)} s at {rate} Hz, by sensors at: {worn}."
    measured = totals(estimate, stride_flags.STRIDE_FLAGS) if measured is None else measured
    distance, deviation = distance_of(estimate) or (None, None)
    name = Path(recording.name).name
    numbers = {
        "kind": "recording", "recording": name, "subject": recording.subject, "duration_s": seconds,
        "sampling_rate_hz": float(recording.sampling_rate_hz), "sensors": list(recording.sensors),
        "distance_m": distance, "distance_std_m": deviation, "strides": len(of.table),
        "strides_regular": int(of.regular.sum()),
        "means": rows.astype(object).where(rows.notna(), None).to_dict("records"),
        "flags": [flag._asdict() for flag in raised], "stride_table": of.table.to_dict("records"),
        "made": made.numbers(),
    }  # fmt: skip
    return Report(Content(
        name, "Gait report", lead, _facts(measured, of, rows), flags.verdict(raised), raised, CAPTION,
        [section for section in sections if section.text or section.parts], made.settings(), made.command, numbers,
    ))  # fmt: skip


def _facts(measured: Sequence[Total], of: strides.ReportStrides, rows: "pd.DataFrame") -> list[tuple[str, str, str]]:
    """Numbers above the page, each with its sensors: those of the terminal, and means of cycles of leg angles."""
    sides = strides.sides(of)
    labels = {**{side: side for side in SIDES}, "": stride_flags.SIDE_UNKNOWN.label}
    by_side = ", ".join(f"{np.sum(sides == side)} {label}" for side, label in labels.items() if (sides == side).any())
    facts = [] if measured and measured[0].words == "strides" else [("Strides", str(len(of.table)), by_side)]
    for total in measured:
        source = by_side if total.words == "strides" else total.source
        facts.append((total.words[:1].upper() + total.words[1:], total.text, source))
    for row in rows.to_dict("records") if of.cycles else ():
        if row["measure"] in ("stride_length", "stride_duration", "cadence", "walking_speed"):
            measure, many = QUANTITIES[row["measure"]], f"mean ± SD of {row['n_strides']} cycles"
            facts.append((measure.words.capitalize(), f"{strides.mean_text(row, measure)} {measure.shown}", many))
    return facts


def _against(estimate: Estimate, recording: Recording, reference: Estimate) -> Section:
    """The numbers of the whole recording beside those of the reference."""
    rows = []
    for name, (value, known) in score(estimate, Walk(recording, reference, {})).quantities.items():
        if np.isfinite([value, known]).all():
            words, unit = readable(name)
            numbers = (None, None, value) if "_rmse_" in name else (value, known, value - known)
            rows.append([Cell(words), *(Cell(significant(number)) for number in numbers), Cell(unit)])
    caption = (
        "This recording against an independent measurement; of whole curves, their root mean square difference, "
        "offsets while standing included."
    )
    table = Table(caption, ("", "estimate", "reference", "difference", "unit"), rows, words=1)
    return Section("Against the reference", "" if rows else "The two have nothing in common.", [table] if rows else ())


def readable(name: str) -> tuple[str, str]:
    """A quantity's name in words, and its unit."""
    parts = name.split("_")
    side = parts.pop() if parts[-1] in SIDES else ""
    unit = UNITS.get(parts[-1], "")
    parts = parts[:-1] if unit else parts
    if "rmse" in parts:
        parts = [CURVES.get("_".join(parts[:-1]), " ".join(parts[:-1]))]
    words = " ".join(parts).replace("2sd", "2 SD")
    return f"{words}, {side}" if side else words, unit


def _details(estimate: Estimate, recording: Recording, made: Made) -> Section:
    rows = []
    for name, imu in recording.sensors.items():
        mask = np.asarray(imu.mask, bool)
        kinds = "gyroscope" + ("" if imu.acc is None else ", accelerometer")
        lost = f"{100.0 * float(np.mean(~mask)):.1f} %" if mask.size else "–"
        rows.append([Cell(_place(name)), Cell(str(mask.size)), Cell(lost), Cell(kinds)])
    parts = [Table("Sensors of the recording", ("place", "samples", "lost", "what"), rows, words=1)]
    of_params = made.table()
    parts += [] if of_params is None else [of_params]
    fits = {n: float(v) for n, v in estimate.diagnostics.items() if n.startswith("nis") and np.ndim(v) == 0}
    text = ""
    if fits:
        each = ", ".join(f"{significant(v)} ({n.removeprefix('nis').strip('_') or 'all'})" for n, v in fits.items())
        text = (
            f"Fit of the model, as mean normalised innovation squared: {each}. About 1 where the stated noise is "
            "right, below 1 where it is too large, above 1 where the measurements differ more from the model."
        )
    return Section("Sensors and parameters", text, parts)


def _place(name: str) -> str:
    part, _, side = name.rpartition("_")
    return f"{side} {part}" if side in SIDES else name.replace("_", " ")
