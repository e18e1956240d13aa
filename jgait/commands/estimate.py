"""`jgait estimate`: joint angles, foot paths, strides and widths of a user's own recordings."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from jgait.commands import cohort as cohorts
from jgait.commands import jobs, recordings
from jgait.commands.console import Bar, console, errors, note, progress, stop, visible, write_json, wrote
from jgait.commands.folder import ResultsFolder, results_folder
from jgait.commands.jobs import EstimateJob
from jgait.commands.own_options import remarks, with_own_options
from jgait.commands.person import PersonFile, person_in, person_of
from jgait.commands.pipeline import chosen
from jgait.estimators import programs
from jgait.notes import grouped
from jgait.report.flags import DOUBTS, verdict
from jgait.report.page import GRADES, Flag
from jgait.types import Recording, reason_of

STYLES = {"stop": "bold red", "check": "yellow"}
"""Grade of a flag → its style in the terminal."""


@with_own_options
def estimate(
    files: Annotated[
        list[Path],
        typer.Argument(help="One recording each: CSV, Parquet, or as a measuring system writes it, also a folder."),
    ],
    estimator: cohorts.OneEstimator = None,
    rate: recordings.Rate = None,
    gyr_unit: recordings.GyrUnit = None,
    acc_unit: recordings.AccUnit = None,
    range_unit: recordings.RangeUnit = "m",
    format: recordings.Format = None,
    place: recordings.Place = None,
    trial: recordings.Trial = None,
    params: cohorts.Params = None,
    paper: cohorts.Paper = False,
    person: PersonFile = None,
    table_format: Annotated[str, typer.Option(help="Of the tables: csv, parquet or json.")] = "csv",
    out: Annotated[
        Path,
        typer.Option(
            help="Folder for tables and figures; earlier ones of the same recording are replaced.",
        ),
    ] = Path("jgait-results"),
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the numbers here.")] = None,
    **own: Any,
) -> None:
    """Estimate gait from recordings in files, and write tables and figures.

    Every estimator that has its sensors runs; strides that several of them measure are combined by their variances, and
    sensors that contradict each other are named. --height of the person is enough for all of them. With --estimator,
    one method runs alone. The person should stand still for a second or more somewhere in the recording. Exit code 0:
    all recordings have results, also without any stride, which is printed as "do not use"; 1: some could not be used,
    such as without walking where leg_ekf or duty_cycled_gyro runs alone; 2: none.

    {estimators}
    """
    if table_format not in jobs.ENDINGS:
        stop(f"--table-format is {', '.join(jobs.ENDINGS)}; got '{table_format}'")
    job = _job(estimator, paper, params, person, table_format, own)
    placement, placements = recordings.places_of(place)
    read = partial(
        recordings.recording_of, rate=rate, gyr_unit=gyr_unit, acc_unit=acc_unit, range_unit=range_unit, format=format,
        placement=placement, placements=placements,
    )  # fmt: skip
    names = _names(files)
    above = _folders(files, lambda file: file.name)
    items = [
        item._replace(folder="/".join(above[file]))
        for file, name in names.items() for item in recordings.trials_of(file, name, format, trial)
    ]  # fmt: skip
    planned = {
        output: item._replace(file=item.file.resolve()).key for item in items for output in job.planned(item.name)
    }
    if len(planned) < len(items) * len(job.planned("")):
        stop("two of these files have results of the same names; give them different --out")
    inputs = [*files, params, person]
    doubts: dict[str, list[Flag]] = {}
    with results_folder(out, "estimate", None, planned=planned, inputs=inputs, json_file=json_file) as folder:
        numbers, failures = _each(items, read, job, folder, doubts)
    if job.table.rows:
        console.print(job.table)
        console.print(job.caption, style="dim")
    for label, flags in doubts.items():
        _say_doubts(label, flags)
    write_json(json_file, {"estimator": job.name, "recordings": numbers, "failures": failures})
    if failures:
        errors.print(f"{len(failures)} of {len(items)} recordings could not be used", highlight=False)
        raise typer.Exit(1 if len(failures) < len(items) else 2)


def _job(
    estimator: str | None, paper: bool, params: Path | None, person: Path | None, ending: str, own: dict[str, Any]
) -> EstimateJob:
    """The work that the options ask for; exits with code 2 for options that do not go together."""
    if estimator is None:
        for option, given in (("--params", params is not None), ("--paper", paper)):
            if given:
                stop(f"{option} is of one estimator; give --estimator as well")
        return jobs.all_sensors(person_of(person, own), ending)
    choice = chosen(estimator, paper, params, own)
    p, lacking = choice.personal(person_in(person))
    for line in (*remarks(estimator, own), *(one for one in lacking if one.severity not in DOUBTS)):
        note(line)
    return jobs.one_estimator(choice, p, estimator + (", the paper's pipeline" if paper else ""), ending, lacking)


def _names(files: list[Path]) -> dict[Path, str]:
    """File → the first part of the names of its results: its stem, after the folders that tell it from other files."""
    names = {file: "_".join([*above, file.stem]) for file, above in _folders(files, lambda file: file.stem).items()}
    if len({name.casefold() for name in names.values()}) < len(files):
        stems = [file.stem.casefold() for file in files]
        shared = ", ".join(str(file) for file, stem in zip(files, stems, strict=True) if stems.count(stem) > 1)
        stop(f"the results of these files would have the same names: {shared}; estimate each into another --out")
    return names


def _folders(files: list[Path], called: Callable[[Path], str]) -> dict[Path, tuple[str, ...]]:
    """File → as many folders above it as tell all files apart that are called the same; none where one is enough."""
    groups: dict[str, list[tuple[Path, tuple[str, ...]]]] = {}
    for file in files:
        groups.setdefault(called(file).casefold(), []).append((file, file.resolve().parent.parts[1:]))
    found: dict[Path, tuple[str, ...]] = {}
    for group in groups.values():
        for levels in range(max(len(above) for _, above in group) + 1):
            named = {file: above[max(len(above) - levels, 0) :] for file, above in group}
            if len({tuple(map(str.casefold, above)) for above in named.values()}) == len(group):
                break
        found |= named
    return found


def _each(
    items: list[recordings.Item], read: Callable[..., Recording], job: EstimateJob, folder: ResultsFolder,
    doubts: dict[str, list[Flag]],
) -> tuple[dict[str, Any], dict[str, str]]:  # fmt: skip
    """Estimate, write and print every recording: its file → numbers, or the reason why it could not be used.

    What puts a recording in doubt is added to `doubts`, by its label; other notes are printed.
    """
    numbers: dict[str, Any] = {}
    failures: dict[str, str] = {}
    for item in items:
        try:
            with progress() as bars:
                bar = Bar(bars)
                bar(f"{item.label}: reading and computing", 0, None)
                programs.before_compiling(partial(bar, f"{item.label}: compiling (first time only)", 0, None))
                made = job.compute(read(item.file, trial=item.trial))
        except Exception as error:  # whatever a damaged file leads to must not stop the others
            reason = reason_of(error)
            if cohorts.is_cohort(item.file):
                reason = (
                    "this is a table of recordings, with a column 'file', and no recording; "
                    f"jgait evaluate {item.file} and jgait report {item.file} take it"
                )
            errors.print(f"[bold red]{visible(item.key)}:[/] {visible(reason)}", highlight=False, soft_wrap=True)
            failures[item.key] = reason
            continue
        written = folder.publish(job.write(made, folder.stage, item.name))
        for line in grouped(one for one in job.notes(made) if one.severity not in DOUBTS):
            note(f"{item.label}: {str(line).removeprefix(f'{item.file.name}: ')}")
        flags = job.flags(made)
        doubtful = [flag for flag in flags if flag.grade in DOUBTS]
        if doubtful:
            doubts[item.label] = doubtful
        for number, row in enumerate([*_doubt_row(doubtful), *job.rows(made)]):
            job.table.add_row("" if number else visible(item.name), *row)
        numbers[item.key] = {**job.numbers(made, written), "flags": [flag._asdict() for flag in flags]}
        wrote(written)
    return numbers, failures


def _doubt_row(flags: Sequence[Flag]) -> list[list[str]]:
    """The row of the printed table about the flags that put a recording in doubt; none without such flags."""
    if not flags:
        return []
    stop, lines = any(flag.grade == "stop" for flag in flags), sum(len(flag.text.splitlines()) for flag in flags)
    return [["doubts", f"{'not usable' if stop else lines}, see below"]]


def _say_doubts(label: str, flags: Sequence[Flag]) -> None:
    """Print the verdict about a recording, and each flag with its meaning."""
    console.print(visible(f"\n{label}: {verdict(flags)}"), style="bold", highlight=False, soft_wrap=True)
    for flag in flags:
        for line in flag.text.splitlines():
            console.print(visible(f"  {GRADES[flag.grade]}: {line}"), style=STYLES[flag.grade], highlight=False,
                          soft_wrap=True)  # fmt: skip
        console.print(visible(f"    {flag.meaning}"), highlight=False, soft_wrap=True)
