"""What `jgait estimate` does with each recording: one estimator, or all that the sensors allow."""

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import PyTree
from rich.table import Table

from jgait.commands import results
from jgait.commands.console import visible
from jgait.commands.pipeline import Choice
from jgait.estimators.about import EstimatedRecording
from jgait.estimators.notes import without_repeats
from jgait.estimators.totals import joint_ranges, median
from jgait.notes import Note
from jgait.types import Recording, as_float

ENDINGS = ("csv", "parquet", "json")
"""Formats of tables."""

TABLES = ("strides", "bouts", "contacts", "sources", "samples")
FIGURES = ("strides", "angles", "foot_path", "distance")


class EstimateJob(NamedTuple):
    """The work on one recording after another.

    Attributes:
        name: name of the estimator, or "all".
        table: table that is printed, without rows.
        caption: text below the table.
        planned: first part of the names of files → the files that may be written.
        compute: recording → result.
        notes: result → notes.
        write: (result, folder, first part of the names) → files written.
        rows: (result, name) → rows of the printed table.
        numbers: (result, files) → numbers for the JSON file.
    """

    name: str
    table: Table
    caption: str
    planned: Callable[[str], list[str]]
    compute: Callable[[Recording], PyTree]
    notes: Callable[[PyTree], tuple[Note, ...]]
    write: Callable[[PyTree, Path, str], list[Path]]
    rows: Callable[[PyTree, str], list[list[str]]]
    numbers: Callable[[PyTree, list[Path]], dict[str, PyTree]]


def one_estimator(choice: Choice, p: PyTree, title: str, ending: str) -> EstimateJob:
    """The estimator that the options select."""
    about = choice.estimator.about

    def compute(recording: Recording) -> EstimatedRecording:
        result = choice.estimate(p, recording)
        notes = without_repeats((*recording.notes, *result.diagnostics["notes"]))
        result = result._replace(diagnostics={**result.diagnostics, "notes": notes})
        return EstimatedRecording(recording, result, p, choice.settings)

    return EstimateJob(
        choice.estimator.name, results.printed_table(title, about), about.caption.format(**choice.settings),
        lambda name: results.planned(about, name, ending), compute, lambda made: made.estimate.diagnostics["notes"],
        lambda made, out, name: results.written(made, about, out, name, ending),
        lambda made, name: results.printed_rows(made.estimate, about, name),
        lambda made, files: results.numbers(made.estimate, about, files),
    )  # fmt: skip


def all_sensors(person: Mapping[str, PyTree], ending: str) -> EstimateJob:
    """Every estimator that has its sensors."""
    from jgait.estimators.combined import analyse

    table = Table(title="all sensors together", title_justify="left")
    for heading in ("recording", "quantity", "combined", "each alone"):
        table.add_column(heading, justify="left")
    return EstimateJob(
        "all", table,
        "± one standard deviation, of one stride or of the distance; length, speed, cadence and stance: medians over "
        "regular strides (no turns, stairs, half-steps, clipped or doubtful ones), stance of those that a foot's "
        "sensor saw; angles: smallest … largest flexion; whole tables in the files",
        _planned_of(ending), partial(analyse, person=person), lambda made: made.notes,
        partial(_written, ending=ending), _rows, _numbers,
    )  # fmt: skip


def _planned_of(ending: str) -> Callable[[str], list[str]]:
    def planned(name: str) -> list[str]:
        return [f"{name}_{table}.{ending}" for table in TABLES] + [f"{name}_{figure}.png" for figure in FIGURES]

    return planned


def _written(made: PyTree, out: Path, name: str, *, ending: str) -> list[Path]:
    """Write the tables and figures of an analysis."""
    from jgait import io, plot
    from jgait.estimators.totals import has_legs, has_strides

    estimate = made.estimate
    files = [
        io.write_table(table, out / f"{name}_{key}.{ending}") for key, table in io.analysis_to_dataframes(made).items()
    ]
    figures = {
        "strides": (plot.leg_strides, has_strides(estimate)),
        "angles": (plot.joint_angles, has_legs(estimate)),
        "foot_path": (plot.foot_path, has_legs(estimate)),
        "distance": (plot.distance, estimate.distance is not None and has_strides(estimate)),
    }
    for key, (draw, there) in figures.items():
        if there:
            files.append(plot.save(draw(estimate, title=name), out / f"{name}_{key}.png"))
    return files


def _rows(made: PyTree, name: str) -> list[list[str]]:
    """A row for each quantity: the combined value with its standard deviation, and the value of each source."""
    from jgait.estimators.combined.compare import regular
    from jgait.report.analysis import QUANTITIES

    usual = np.zeros(0, bool) if made.strides is None else regular(made.strides)
    rows = []
    for quantity, (words, unit, digits) in QUANTITIES.items():
        told = [c for c in made.comparisons if c.quantity == quantity]
        alone = ", ".join(f"{c.source} {c.value:.{digits}f}" for c in told if c.source != "combined")
        for c in told:
            if c.source == "combined":
                deviation = "" if c.stddev is None else f" ± {c.stddev:.{digits}f}"
                many = f", {usual.sum()} regular" if quantity == "strides" else ""
                rows.append([words, f"{c.value:.{digits}f}{deviation} {unit}".rstrip() + many, alone])
        if not told and usual.size and quantity != "distance":
            rows.append([words, "–", ""])
    if usual.size:
        cadence, stance = _timing(made, usual)
        rows.append(["cadence", "–" if cadence is None else f"{cadence:.0f} steps/min", ""])
        rows.append(["stance", "–" if stance is None else f"{100.0 * stance:.0f} % of the stride", ""])
    for joint, pair in joint_ranges(made.estimate).items():
        if pair is not None:
            segment, side = joint.split("_")[:2]
            usable = made.estimate.diagnostics[f"angles_valid_{side}"]
            words = f"{pair[0]:z.0f} … {pair[1]:z.0f} °{'' if usable else ', not usable'}"
            rows.append([f"{segment} {side}", words, "legs"])
    return [[visible(name) if i == 0 else "", *row] for i, row in enumerate(rows)]


def _timing(made: PyTree, usual: np.ndarray) -> tuple[float | None, float | None]:
    """Steps a minute, and share of the stance in the stride; medians over strides (n,) bool, None if not known.

    The stance is of strides that a foot's sensor saw: a shank's shows the final contact too late.
    """
    strides = made.estimate.strides
    lasts = as_float(strides.end) - as_float(strides.start)
    duration = median(lasts, usual)
    seen = usual & (np.array(made.strides.first) == "feet")
    toe_off = np.full(lasts.size, np.nan) if strides.final_contact is None else as_float(strides.final_contact)
    return None if duration is None else 120.0 / duration, median((toe_off - as_float(strides.start)) / lasts, seen)


def _numbers(made: PyTree, files: list[Path]) -> dict[str, PyTree]:
    """The JSON numbers of an analysis: its tables but for the samples, notes, and the person."""
    from jgait import io

    tables = io.analysis_to_dataframes(made)
    rows = {
        name: json.loads(table.to_json(orient="records", double_precision=6))
        for name, table in tables.items() if name != "samples"
    }  # fmt: skip
    told = {c.quantity: c for c in made.comparisons if c.source == "combined"}
    distance = told.get("distance")
    return {
        "duration_s": float(made.estimate.time[-1] - made.estimate.time[0]),
        "distance_m": None if distance is None else distance.value,
        "distance_std_m": None if distance is None else distance.stddev,
        "person": made.person,
        "notes": [note.to_dict() for note in made.notes],
        "files": [str(path) for path in files],
        **rows,
    }
