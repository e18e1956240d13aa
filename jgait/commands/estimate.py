"""`jgait estimate`: joint angles, foot paths, strides and widths of a user's own recordings."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer
from jaxtyping import PyTree

from jgait import io
from jgait.commands import cohort as cohorts
from jgait.commands import jobs, options, recordings
from jgait.commands.console import Bar, console, count, errors, progress, say_failures, stop, visible, write_json, wrote
from jgait.commands.folder import ResultsFolder, results_folder
from jgait.commands.jobs import EstimateJob
from jgait.commands.recordings import Item
from jgait.estimators import programs
from jgait.notes import of_recordings
from jgait.report.flags import DOUBTS, verdict
from jgait.report.page import GRADES, Flag
from jgait.types import Recording, reason_of

if TYPE_CHECKING:
    import pandas as pd

ENDINGS = ("csv", "parquet", "json")
"""Formats of tables."""

EPILOG = options.epilog()

STYLES = {"stop": "bold red", "check": "yellow", "corrected": "", "info": ""}
"""Grade of a flag → its style in the terminal."""


class Outcome(NamedTuple):
    """What became of a recording."""

    item: Item
    subject: str
    reason: str = ""  #: why it could not be used; empty if it could.
    flags: Sequence[Flag] = ()
    tables: "Mapping[str, pd.DataFrame]" = MappingProxyType({})  #: its tables of which there is one of all recordings.
    numbers: Mapping[str, Any] = MappingProxyType({})  #: for the JSON file.
    files: Sequence[Path] = ()  #: that were written.

    def doubts(self) -> list[Flag]:
        """The flags that put it in doubt, the gravest first."""
        return [flag for flag in self.flags if flag.grade in DOUBTS]

    def row(self) -> tuple[str, ...]:
        """Its row in the table of recordings."""
        doubts = self.doubts()
        result = "failed" if self.reason else GRADES[doubts[0].grade].lower() if doubts else "good"
        lines = (line for flag in doubts for line in flag.text.splitlines())
        return self.item.recording, self.subject, self.item.key, result, self.reason or "; ".join(lines)


def estimate(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="One recording each: CSV, Parquet, or as a measuring system writes it, also a folder; or a table of "
            "recordings with a column file, as of jgait evaluate."
        ),
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
    person: options.PersonFile = None,
    height: options.Height = None,
    thigh: options.Thigh = None,
    shank: options.Shank = None,
    option: options.Options = None,
    table_format: Annotated[str, typer.Option(help="Of the tables: csv, parquet or json.")] = "csv",
    out: Annotated[
        Path,
        typer.Option(
            help="Folder for tables and figures; earlier ones of the same recording are replaced.",
        ),
    ] = Path("jgait-results"),
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the numbers here.")] = None,
    notes: Annotated[bool, typer.Option("--notes", help="Print all remarks, each with its meaning.")] = False,
) -> None:
    """Estimate gait from recordings in files, and write tables and figures.

    Every estimator that has its sensors runs; strides that several of them measure are combined by their variances, and
    sensors that contradict each other are named. --height of the person is enough for all of them. With --estimator,
    one method runs alone. Of several recordings, one table each of all strides, bouts and so on is written, too, and
    recordings.csv, which lists all, also those that failed. The person should stand still for a second or more
    somewhere in the recording. Exit code 0: all recordings have results, also without any stride, which is printed as
    "do not use"; 1: some could not be used, such as without walking where leg_ekf or duty_cycled_gyro runs alone; 2:
    none.
    """
    if table_format not in ENDINGS:
        stop(f"--table-format is {', '.join(ENDINGS)}; got '{table_format}'")
    for name, asked in (("--params", params is not None), ("--paper", paper)):
        if asked and estimator is None:
            stop(f"{name} is of one estimator; give --estimator as well")
    job = jobs.job_of(estimator, paper, params, person, options.given(option, height, thigh, shank))
    placement, placements = recordings.places_of(place)
    tables = {
        file: cohorts.source(file, None, None, 0, gyr_unit, acc_unit, ())
        for file in files if cohorts.is_cohort(file)
    }  # fmt: skip
    how: dict[str, Any] = {
        "rate": rate, "gyr_unit": gyr_unit, "acc_unit": acc_unit, "range_unit": range_unit, "format": format,
        "placement": placement, "placements": placements,
    }  # fmt: skip

    def read(item: Item) -> tuple[Recording, Mapping[str, PyTree]]:
        rows = tables[item.table].read if item.table else None
        if isinstance(rows, cohorts.CohortFiles):
            return rows.recording(item.cell, trial=item.trial, **how)
        return recordings.recording_of(item.file, trial=item.trial, **how), {}

    items = _items(files, tables, format, trial)
    planned = {
        output: item._replace(file=item.file.resolve()).key
        for item in items
        for output in job.planned(item.name, table_format)
    }
    if len(planned) < len(items) * len(job.planned("", "")):
        stop("two of these files have results of the same names; give them different --out")
    several = len(items) > 1 or bool(tables)
    if several:
        planned |= {f"{name}.{table_format}": "all recordings" for name in ("recordings", *job.joined)}
    inputs = [*files, params, person, *(file for table in tables.values() for file in table.files)]
    unread = [failure for table in tables.values() for failure in table.failures]
    say_failures(unread)
    made = [Outcome(Item(Path(row), row), "", reason) for row, reason in unread]
    joined: Sequence[Path] = ()
    with results_folder(out, "estimate", None, planned=planned, inputs=inputs, json_file=json_file) as folder:
        made += [_one(item, read, job, folder, table_format) for item in items]
        if several:
            every = _together(made, job.joined).items()
            files = [io.write_table(rows, folder.stage / f"{name}.{table_format}") for name, rows in every]
            joined = folder.publish(files)
    if job.table.rows:
        console.print(job.table)
    for outcome in made:
        if not outcome.reason:
            _say_trust(outcome.item.label, outcome.flags, notes)
    if notes and job.table.rows:
        console.print(job.caption, style="dim")
    if written := [*(path for outcome in made for path in outcome.files), *joined]:
        wrote(written)
    failures = {outcome.item.key: outcome.reason for outcome in made if outcome.reason}
    numbers = {outcome.item.key: outcome.numbers for outcome in made if not outcome.reason}
    write_json(json_file, {"estimator": job.name, "recordings": numbers, "failures": failures})
    if failures:
        errors.print(f"{of_recordings(len(failures), len(made))} could not be used", highlight=False)
        raise typer.Exit(1 if numbers else 2)


def _items(
    files: list[Path], tables: Mapping[Path, cohorts.Source], format: str | None, trial: str | None
) -> list[Item]:
    """The recordings in files, and in the files that tables list; their results begin with the file's stem, after the
    names of as many of its folders as others share it.
    """
    listed: list[tuple[Path, Path | None, str]] = []
    for file in files:
        if file in tables:
            listed += [(file.parent / cell, file, cell) for cell in tables[file].items]
        else:
            listed.append((file, None, ""))
    paths = [file for file, _, _ in listed]
    called = _called(paths)
    items = []
    for file, table, cell in listed:
        subject = tables[table].subjects.get(cell, cell) if table else ""
        every = recordings.trials_of(file, "_".join(called[file]), format, trial)
        folder = "/".join(called[file][:-1])
        items += [item._replace(folder=folder, table=table, cell=cell, subject=subject) for item in every]
    return items


def _called(files: list[Path]) -> dict[Path, list[str]]:
    """File → its stem, after as many of its folders as tell it from the others: joined, the first part of the names of
    its results; exits with code 2 if that of two files would be the same.
    """

    def first(parts: list[str]) -> str:
        return "_".join(parts).casefold()

    whole = {file: [*file.resolve().parent.parts[1:], file.stem] for file in files}
    called = {file: parts[-1:] for file, parts in whole.items()}
    for depth in range(2, max(map(len, whole.values()), default=0) + 1):
        many = Counter(map(first, called.values()))
        called = {file: whole[file][-depth:] if many[first(parts)] > 1 else parts for file, parts in called.items()}
    if len(set(map(first, called.values()))) < len(files):
        many = Counter(first(called[file]) for file in files)
        shared = ", ".join(str(file) for file in files if many[first(called[file])] > 1)
        stop(f"the results of these files would have the same names: {shared}; estimate each into another --out")
    return called


def _one(
    item: Item,
    read: Callable[[Item], tuple[Recording, Mapping[str, PyTree]]],
    job: EstimateJob,
    folder: ResultsFolder,
    ending: str,
) -> Outcome:
    """Estimate and write one recording."""
    subject = item.subject or item.file.stem
    try:
        with progress() as bars:
            bar = Bar(bars)
            bar(f"{item.label}: reading and computing", 0, None)
            programs.before_compiling(partial(bar, f"{item.label}: compiling (first time only)", 0, None))
            recording, known = read(item)
            subject = recording.subject
            made = job.compute(recording, known)
            flags = made.flags()
    except Exception as error:  # whatever a damaged file leads to must not stop the others
        reason = reason_of(error)
        errors.print(f"[bold red]{visible(item.key)}:[/] {visible(reason)}", highlight=False, soft_wrap=True)
        return Outcome(item, subject, reason)
    files = [io.write_table(rows, folder.stage / f"{item.name}_{name}.{ending}") for name, rows in made.tables.items()]
    written = folder.publish(files + made.drawn(folder.stage, item.name, job.about.figures))
    for number, row in enumerate(made.rows):
        job.table.add_row("" if number else visible(item.name), *row)
    tables = {name: rows for name, rows in made.tables.items() if name in job.joined}
    listed = {"files": list(map(str, written)), "flags": [flag._asdict() for flag in flags]}
    return Outcome(item, subject, "", flags, tables, {**made.numbers, **listed}, written)


def _together(made: Sequence[Outcome], names: Iterable[str]) -> dict[str, "pd.DataFrame"]:
    """The tables of all recordings: `recordings`, a row each, and those of each one below the other."""
    import pandas as pd

    columns = ["recording", "subject", "file", "result", "reason"]
    tables = {"recordings": pd.DataFrame([outcome.row() for outcome in made], columns=columns)}
    for name in names:
        parts = {
            (outcome.item.recording, outcome.subject): outcome.tables[name]
            for outcome in made
            if len(outcome.tables.get(name, ()))
        }
        if parts:
            whole = pd.concat(parts, names=["recording", "subject"])
            tables[name] = whole.reset_index(level=[0, 1]).reset_index(drop=True)
    return tables


def _say_trust(label: str, flags: Sequence[Flag], every: bool) -> None:
    """Print how far to trust a recording; then each flag with its meaning, or how many there are."""
    grade = next((flag.grade for flag in flags if flag.grade in DOUBTS), "info")
    console.print(visible(f"{label}: {verdict(flags)}"), style=STYLES[grade] or "bold", highlight=False, soft_wrap=True)
    for flag in flags if every else ():
        for line in flag.text.splitlines():
            console.print(visible(f"  {GRADES[flag.grade]}: {line}"), style=STYLES[flag.grade], highlight=False,
                          soft_wrap=True)  # fmt: skip
        console.print(visible(f"    {flag.meaning}"), highlight=False, soft_wrap=True)
    if flags and not every:
        lines = sum(len(flag.text.splitlines()) for flag in flags)
        console.print(f"  {count(lines, 'remark', 'remarks')}: --notes prints them", style="dim", highlight=False)
