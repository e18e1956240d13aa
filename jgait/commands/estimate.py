"""`jgait estimate`: joint angles, foot paths, strides and widths of a user's own recordings."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from jaxtyping import PyTree
from rich.table import Table

from jgait.commands import cohort as cohorts
from jgait.commands import recordings, results
from jgait.commands.console import Bar, console, errors, note, progress, stop, visible, write_json, wrote
from jgait.commands.folder import ResultsFolder, results_folder
from jgait.commands.own_options import remarks, with_own_options
from jgait.commands.pipeline import Choice, chosen
from jgait.estimators import programs
from jgait.estimators.about import EstimatedRecording
from jgait.types import Estimate, Recording, reason_of


@with_own_options
def estimate(
    files: Annotated[
        list[Path],
        typer.Argument(help="One recording each: CSV, Parquet, or as a measuring system writes it, also a folder."),
    ],
    estimator: cohorts.EstimatorName = "leg_ekf",
    rate: recordings.Rate = None,
    gyr_unit: recordings.GyrUnit = None,
    acc_unit: recordings.AccUnit = None,
    range_unit: recordings.RangeUnit = "m",
    format: recordings.Format = None,
    place: recordings.Place = None,
    trial: recordings.Trial = None,
    params: cohorts.Params = None,
    paper: cohorts.Paper = False,
    out: Annotated[Path, typer.Option(help="Folder for tables and figures.")] = Path("jgait-results"),
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the numbers here.")] = None,
    **own: Any,
) -> None:
    """Estimate gait from recordings in files, and write tables and figures.

    Tables have a column time [s] and the columns of the estimator. The person should stand still for a second or more
    somewhere in the recording.

    {estimators}
    """
    choice = chosen(estimator, paper, params, own)
    p, lacking = choice.personal({})
    for line in (*remarks(estimator, own), *lacking):
        note(line)
    placement, placements = recordings.places_of(place)
    read = partial(
        recordings.recording_of, rate=rate, gyr_unit=gyr_unit, acc_unit=acc_unit, range_unit=range_unit, format=format,
        placement=placement, placements=placements, trial=trial,
    )  # fmt: skip
    about = choice.estimator.about
    table = results.printed_table(estimator + (", the paper's pipeline" if paper else ""), about)
    names = _names(files)
    planned = {output: str(file.resolve()) for file, name in names.items() for output in results.planned(about, name)}
    if len(planned) < len(names) * len(results.planned(about, "")):
        stop("two of these files have results of the same names; give them different --out")
    with results_folder(out, "estimate", None, planned=planned, inputs=[*files, params], json_file=json_file) as folder:
        numbers, failures = _each(names, read, choice, p, table, folder)
    if table.rows:
        console.print(table)
        console.print(about.caption.format(**choice.settings), style="dim")
    write_json(json_file, {"estimator": estimator, "recordings": numbers, "failures": failures})
    if failures:
        errors.print(f"{len(failures)} of {len(files)} recordings could not be used", highlight=False)
        raise typer.Exit(1 if len(failures) < len(files) else 2)


def _names(files: list[Path]) -> dict[Path, str]:
    """File → the first part of the names of its results: its stem, after its folder's name where others share it."""
    stems = [file.stem.casefold() for file in files]
    names = {
        file: file.stem if stems.count(stem) == 1 else f"{file.resolve().parent.name}_{file.stem}"
        for file, stem in zip(files, stems, strict=True)
    }
    if len({name.casefold() for name in names.values()}) < len(files):
        shared = ", ".join(str(file) for file, stem in zip(files, stems, strict=True) if stems.count(stem) > 1)
        stop(f"the results of these files would have the same names: {shared}; estimate each into another --out")
    return names


def _each(
    names: dict[Path, str], read: Callable[[Path], Recording], choice: Choice, p: PyTree, table: Table,
    folder: ResultsFolder,
) -> tuple[dict[str, PyTree], dict[str, str]]:  # fmt: skip
    """Estimate, write and print every file: file → numbers, and file → the reason why it could not be used."""
    about = choice.estimator.about
    numbers: dict[str, Any] = {}
    failures: dict[str, str] = {}
    for file, name in names.items():
        try:
            with progress() as bars:
                bar = Bar(bars)
                bar(f"{file.name}: reading and computing", 0, None)
                programs.before_compiling(partial(bar, f"{file.name}: compiling (first time only)", 0, None))
                recording = read(file)
                result = choice.estimate(p, recording)
            result = _with_notes(result, recording)
        except Exception as error:  # whatever a damaged file leads to must not stop the others
            reason = reason_of(error)
            errors.print(f"[bold red]{visible(file)}:[/] {visible(reason)}", highlight=False, soft_wrap=True)
            failures[str(file)] = reason
            continue
        try:
            made = EstimatedRecording(recording, result, p, choice.settings)
            written = folder.publish(results.written(made, about, folder.stage, name))
        except OSError as error:
            stop(f"nothing more could be written to {folder.path}: {error}")
        for line in result.diagnostics["notes"]:
            note(f"{file.name}: {line}")
        for row in results.printed_rows(result, about, name):
            table.add_row(*row)
        numbers[str(file)] = results.numbers(result, about, written)
        wrote(written)
    return numbers, failures


def _with_notes(result: Estimate, recording: Recording) -> Estimate:
    """The notes of the reader first, each note once."""
    notes = tuple(dict.fromkeys((*recording.notes, *result.diagnostics["notes"])))
    return result._replace(diagnostics={**result.diagnostics, "notes": notes})
