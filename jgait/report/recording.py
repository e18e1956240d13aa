"""The page of one recording, by one estimator or by all its sensors."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jgait.estimators import about_of
from jgait.estimators.about import EstimatedRecording
from jgait.estimators.columns import COLUMNS, QUANTITIES, UNITS, Column
from jgait.estimators.combined import Analysis
from jgait.estimators.stride_flags import SIDE_UNKNOWN, STRIDE_FLAGS
from jgait.estimators.totals import distance_of
from jgait.evaluate.scores import score
from jgait.io import flags
from jgait.io.flags import Flag, without_folders
from jgait.io.results import CAPTION, Results, Total
from jgait.report.figures import pictures
from jgait.report.made import Made
from jgait.report.page import Cell, Report, Section, Table, cell, number, significant
from jgait.types import SIDES, Estimate, Recording, Walk

if TYPE_CHECKING:
    import pandas as pd

CURVES = {
    "hip": "hip angle", "knee": "knee angle", "x": "ankle forward of hip", "y": "ankle above hip",
    "foot": "foot, seen from above", "foot_height": "foot, height",
}  # fmt: skip
"""First part of the name of a root mean square error → the name of the curve."""

BOUTS = (
    "start_s", "duration_s", "n_strides", "n_regular", "distance_m", "stride_length_m", "walking_speed_mps",
    "cadence_spm",
)  # fmt: skip
"""Columns of the table of bouts that the page shows, as many as fit on paper."""


def of_analysis(
    analysis: Analysis, recording: Recording, *, reference: Estimate | None = None, made: Made | None = None,
    more: Sequence[Section] = (),
) -> Report:  # fmt: skip
    """The page of one recording by all its sensors: as `of_estimate`, with what each source says, and walking bouts."""
    results, rows = Results(analysis), []
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
    if not results.cycles:
        shown = [COLUMNS[name] for name in BOUTS]
        rows = [
            [Cell(str(bout["wb_id"] + 1)), *(Cell(number(bout[column.name], column.digits)) for column in shown)]
            for bout in results.bouts.to_dict("records")
        ]
        caption = (
            "Walking between pauses; stride length, speed and cadence are medians over the regular strides of the bout."
        )
        bouts = Table(caption, ("no.", *(column.heading for column in shown)), rows)
        more.append(Section("Bouts of walking", "", [bouts]))
    return _page(results, recording, reference, made or Made(), more)


def of_estimate(
    estimate: Estimate, recording: Recording, *, reference: Estimate | None = None, made: Made | None = None,
    more: Sequence[Section] = (),
) -> Report:  # fmt: skip
    """The page of one recording: numbers, trust, figures with bands, means by side, all strides, settings.

    The reference, an independent measurement, is drawn dashed and compared. `made` states how the estimate was
    computed; `more` are sections after the means of the strides.

    Raises:
        ValueError: if the estimate is not of one recording.
        ImportError: without the extra `cli`.
    """
    if np.ndim(estimate.time) != 1:
        raise ValueError(f"a report is of one recording, time of shape (T,); got shape {np.shape(estimate.time)}")
    return _page(Results(estimate), recording, reference, made or Made(), more)


def _page(
    results: Results, recording: Recording, reference: Estimate | None, made: Made, more: Sequence[Section]
) -> Report:
    estimate, summary, strides = results.estimate, results.summary, shown_strides(results)
    raised = flags.of_result(results, (*estimate.diagnostics.get("notes", recording.notes), *made.notes))
    about = about_of(made.estimator)
    params = made.params if made.params is not None else made.default
    settings = {"options": about.paper if made.pipeline else about.default}
    sources = None if params is None else EstimatedRecording(recording, estimate, params, settings)
    none = "No stride is regular, so that there are no means." if len(strides) else (
        "No strides were found in this recording."
    )  # fmt: skip
    glance = [table for table in [mean_table(summary, int(np.sum(results.sides == "")))] if table.rows]
    sections = [
        Section("Figures", "", pictures(estimate, reference, about.figures, sources)),
        *([] if reference is None else [_against(estimate, recording, reference)]),
        Section("Gait at a glance", "" if glance else none, glance), *more,
        Section("Stride by stride", "", [_stride_table(results, strides)] if len(strides) else []),
        _details(estimate, recording, made),
    ]  # fmt: skip
    who = "" if recording.subject in ("", "subject", recording.name) else f", {recording.subject}"
    seconds, rate = float(estimate.time[-1] - estimate.time[0]), significant(recording.sampling_rate_hz, 4)
    worn = ", ".join(map(_place, recording.sensors))
    distance, deviation = distance_of(estimate) or (None, None)
    name = without_folders(recording.name)
    numbers = {
        "kind": "recording", "recording": name, "subject": recording.subject, "duration_s": seconds,
        "sampling_rate_hz": float(recording.sampling_rate_hz), "sensors": list(recording.sensors),
        "distance_m": distance, "distance_std_m": deviation, "strides": len(strides),
        "strides_regular": int(results.regular.sum()),
        "means": summary.astype(object).where(summary.notna(), None).to_dict("records"),
        "flags": [flag._asdict() for flag in raised], "stride_table": strides.to_dict("records"),
        "made": made.numbers(),
    }  # fmt: skip
    return Report(
        name, "Gait report", f"{about.title}{who}; {number(seconds, 1)} s at {rate} Hz, by sensors at: {worn}.",
        _facts(results, raised), flags.verdict(raised), raised, CAPTION,
        [section for section in sections if section.text or section.parts], made.settings(), made.command, numbers,
    )  # fmt: skip


def _facts(results: Results, raised: Sequence[Flag]) -> list[tuple[str, str, str]]:
    """Numbers above the page, each with its sensors: those of the terminal, and means of cycles of leg angles."""
    labels = {**{side: side for side in SIDES}, "": SIDE_UNKNOWN.label}
    many = {label: np.sum(results.sides == side) for side, label in labels.items()}
    by_side = ", ".join(f"{count} {label}" for label, count in many.items() if count)
    facts = [Total("strides", str(len(results.base)))] if results.cycles else []
    facts += results.totals
    for row in results.summary.to_dict("records") if results.cycles else ():
        if row["measure"] in ("stride_length", "stride_duration", "cadence", "walking_speed"):
            measure, detail = QUANTITIES[row["measure"]], f"mean ± SD of {row['n_strides']} cycles"
            facts.append(Total(measure.words, f"{_mean_text(row, measure)} {measure.shown}", source=detail))
    sources = {"strides": by_side}
    return [
        (total.words[:1].upper() + total.words[1:], total.text, sources.get(total.words, total.source))
        for total in flags.marked(facts, raised)
    ]


def shown_strides(results: Results) -> "pd.DataFrame":
    """The strides as the page has them, with `cadence_spm` and without angles that are not usable."""
    table = results.every
    if "stride_duration_s" in table:
        duration = table["stride_duration_s"].where(~results.marks.get("half", np.zeros(len(table), bool)))
        table = table.assign(cadence_spm=120.0 / duration)
    if "angles_valid" in table:
        angles = [name for name in table if "_flexion_" in name]
        table = table.assign(**table[angles].where(table["angles_valid"]))
    return table


def _stride_table(results: Results, strides: "pd.DataFrame") -> Table:
    """All strides, a row each, with standard deviations and remarks."""
    listed = [m for m in COLUMNS.values() if m.listed and m.name != "cadence_spm" and m.name in strides]
    known, rows = [m for m in listed if strides[m.name].notna().any()], list[list[Cell]]()
    for k, stride in enumerate(strides.to_dict("records")):
        start = stride.get("start_s", stride.get("standing_s"))
        cells = [Cell(str(k + 1), k + 1.0), Cell(results.sides[k] or "–"), cell(start, 2)]
        for measure in known:
            spread = measure.scale * stride.get(measure.deviation, np.nan)
            cells.append(cell(measure.scale * stride[measure.name], measure.digits, spread))
        marks = results.marks
        words = [flag.label for flag in STRIDE_FLAGS if flag.name in marks and marks[flag.name][k]]
        rows.append([*cells, Cell(", ".join(words))])
    caption = (
        "Cycles of each leg, from the largest bend of the swinging knee to the next; the length is how far the "
        "distance grows meanwhile." if results.cycles else "Strides, from one contact of a foot to its next."
    )  # fmt: skip
    stated = any("_std_" in name for name in strides)
    caption += " ± is one standard deviation of the error, by the estimator." if stated else ""
    caption += " A click on a heading sorts."
    return Table(caption, ("no.", "leg", "start [s]", *(m.heading for m in known), "remarks"), rows, True, 1)


def _mean_text(row: Mapping[Any, Any], measure: Column) -> str:
    """The mean of a row of a summary with its standard deviation between strides."""
    spread = f" ± {number(measure.scale * row['std'], max(measure.digits, 1))}" if np.isfinite(row["std"]) else ""
    return number(measure.scale * row["mean"], measure.digits) + spread


def mean_table(summary: "pd.DataFrame", unsided: int = 0) -> Table:
    """Means of strides and of each side, and differences between the sides; without rows if no stride counts. `unsided`
    is the number of strides whose side is not known.
    """
    both, varies = (bool(summary[name].notna().any()) for name in ("asymmetry_pct", "std"))
    rows = []
    for row in summary.to_dict("records"):
        measure = QUANTITIES[row["measure"]]
        if not measure.listed:  # the distance and ranges of motion: the page shows them, or their two ends, elsewhere
            continue
        cells = [Cell(measure.heading), cell(measure.scale * row["median"], measure.digits)]
        cells.append(Cell(_mean_text(row, measure)))
        cells += [cell(measure.scale * row[side], measure.digits) for side in SIDES]
        cells.append(cell(measure.scale * row["error_std"], max(measure.digits, 1)))
        cells += [cell(row["asymmetry_pct"], 1, row["asymmetry_std_pct"])] if both else []
        rows.append([*cells, Cell(str(row["n_strides"]))])
    columns = ["", "median", "mean ± SD" if varies else "mean", *(f"{side} leg" for side in SIDES), "error of a stride",
               *(["asymmetry [%]"] if both else []), "strides"]  # fmt: skip
    steady = summary.loc[summary["measure"] != "distance", "steady"].all()
    caption = "Medians: of all regular strides, as above. " + (
        "Means: of steady strides, regular ones between regular ones, the mean of both sides." if steady
        else "Means: of the same strides, as there are too few steady ones for variability and asymmetry."
    ) + " Error of a stride: its standard deviation by the estimator."  # fmt: skip
    if varies:
        caption += (
            " SD: from stride to stride within a side. The SD contains the error of a stride; an SD that is not "
            "clearly larger says little about the person."
        )
    if unsided:
        many = "1 stride is" if unsided == 1 else f"{unsided} strides are"
        caption += f" {many} of a side that is not known: such strides count in the mean, but for neither leg."
    if both:
        caption += " Asymmetry: (right − left) / mean, ± one SD; within two of them it may be the sensors' error."
    return Table(caption, columns, rows)


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
    """The sensors, the parameters, and how well the model fits."""
    rows = []
    for name, imu in recording.sensors.items():
        mask = np.asarray(imu.mask, bool)
        kinds = "gyroscope" + ("" if imu.acc is None else ", accelerometer")
        lost = f"{100.0 * float(np.mean(~mask)):.1f} %"
        rows.append([*map(Cell, (_place(name), str(mask.size), lost, kinds))])
    parts = [Table("Sensors of the recording", ("place", "samples", "lost", "what"), rows, words=1)]
    parts += [table for table in [made.table()] if table is not None]
    fits = {n: float(v) for n, v in estimate.diagnostics.items() if n.startswith("nis") and np.ndim(v) == 0}
    each = ", ".join(f"{significant(v)} ({n.removeprefix('nis').strip('_') or 'all'})" for n, v in fits.items())
    text = (
        f"Fit of the model, as mean normalised innovation squared: {each}. About 1 where the stated noise is "
        "right, below 1 where it is too large, above 1 where the measurements differ more from the model."
    )
    return Section("Sensors and parameters", text if fits else "", parts)


def _place(name: str) -> str:
    part, _, side = name.rpartition("_")
    return f"{side} {part}" if side in SIDES else name.replace("_", " ")
