"""`jgait estimate`: joint angles, foot paths, strides and widths of a user's own recordings."""

import csv
import json
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer
from jaxtyping import PyTree

from jgait import io
from jgait.commands import console, jobs, machines, options, recordings
from jgait.commands.cohort_table import CohortFiles, Source, is_cohort, of_table
from jgait.commands.console import count, say, stop
from jgait.commands.folder import ResultsFolder, results_folder
from jgait.commands.jobs import EstimateJob
from jgait.commands.recordings import Item
from jgait.estimators import programs
from jgait.estimators.dask import DIED, on_dask
from jgait.io.atomic import write_text
from jgait.io.flags import DOUBTS, GRADES, Flag, verdict
from jgait.notes import of_recordings
from jgait.types import Recording, reason_of

if TYPE_CHECKING:
    import pandas as pd
    from distributed import Client

STYLES = {"stop": "bold red", "check": "yellow", "corrected": "", "info": ""}
"""Grade of a flag → its style in the terminal."""

type Read = Callable[[Item], tuple[Recording, Mapping[str, PyTree]]]
"""Reads a recording and the measures of its person."""


class Outcome(NamedTuple):
    """What became of a recording, as JSON values."""

    subject: str
    reason: str = ""  #: why it could not be used; empty if it could.
    flags: Sequence[Flag] = ()
    rows: Sequence[Sequence[str]] = ()  #: of the printed table, without the recording.
    numbers: Mapping[str, Any] = MappingProxyType({})  #: for the JSON file.
    tables: Mapping[str, str] = MappingProxyType({})  #: table of which there is one of all recordings → its file.
    files: Sequence[str] = ()  #: names of the files that were written.
    command: Sequence[str] = ()  #: words of the command that parts share.

    def row(self, item: Item) -> tuple[str, ...]:
        """Its row in the table of recordings."""
        doubts = [flag for flag in self.flags if flag.grade in DOUBTS]  # the gravest first
        result = "failed" if self.reason else GRADES[doubts[0].grade].lower() if doubts else "good"
        lines = (line for flag in doubts for line in flag.text.splitlines())
        return item.recording, self.subject, item.key, result, self.reason or "; ".join(lines)

    def write(self, place: Path) -> Path:
        """Write this into the folder of the recording's files, and return the folder."""
        write_text(place / "outcome.json", json.dumps(console.plain(self._asdict()), default=str))
        return place

    @classmethod
    def read(cls, place: Path) -> "Outcome":
        """What `write` wrote."""
        outcome = cls(**json.loads((place / "outcome.json").read_text(encoding="utf-8")))
        return outcome._replace(flags=[Flag(*flag) for flag in outcome.flags])


def estimate(
    context: typer.Context,
    files: Annotated[
        list[Path],
        typer.Argument(
            help="One recording each: CSV, Parquet, or as a measuring system writes it, also a folder; or a table of "
            "recordings with a column file, as of jgait evaluate."
        ),
    ],
    estimator: options.OneEstimator = None,
    rate: recordings.Rate = None,
    gyr_unit: recordings.GyrUnit = None,
    acc_unit: recordings.AccUnit = None,
    range_unit: recordings.RangeUnit = "m",
    format: recordings.Format = None,
    place: recordings.Place = None,
    trial: recordings.Trial = None,
    params: options.Params = None,
    paper: options.Paper = False,
    person: options.PersonFile = None,
    height: options.Height = None,
    thigh: options.Thigh = None,
    shank: options.Shank = None,
    option: options.Options = None,
    table_format: Annotated[str, typer.Option(help="Of the tables: csv, parquet or json.")] = "csv",
    out: Annotated[
        Path, typer.Option(help="Folder for tables and figures; earlier ones of the same recording are replaced.")
    ] = Path("jgait-results"),
    dask: machines.Dask = None,
    part: machines.PartText = None,
    json_file: console.Json = None,
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
    if table_format not in ("csv", "parquet", "json"):
        stop(f"--table-format is csv, parquet, json; got '{table_format}'")
    for name, asked in (("--params", params is not None), ("--paper", paper)):
        if asked and estimator is None:
            stop(f"{name} is of one estimator; give --estimator as well")
    job = jobs.job_of(estimator, paper, params, person, options.given(option, height, thigh, shank))
    how = recordings.how(rate, gyr_unit, acc_unit, range_unit, format, place)
    with console.refused("", csv.Error):
        tables = {file: of_table(file, gyr_unit, acc_unit, ()) for file in files if is_cohort(file)}
    for line in (line for table in tables.values() for line in table.notes):
        console.note(line)

    def read(item: Item) -> tuple[Recording, Mapping[str, PyTree]]:
        rows = tables[item.table].read if item.table else None
        if isinstance(rows, CohortFiles):
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
    words = machines.shared_words(context.obj)
    if (of := machines.part_of(part)) is not None:
        with of.folder(out, "estimate", context, {item.name: item.key for item in items}, inputs) as folder:
            made = _outcomes(of.share(items), read, job, folder, table_format, dask, words, kept=True)
        of.end(out, len(made), sum(bool(outcome.reason) for _, outcome in made))
        return
    unread = [failure for table in tables.values() for failure in table.failures]
    console.say_failures(unread)
    joined: Sequence[Path] = ()
    with results_folder(out, "estimate", None, planned=planned, inputs=inputs, json_file=json_file) as folder:
        made = [(Item(Path(row), row), Outcome("", reason)) for row, reason in unread]
        made += _outcomes(items, read, job, folder, table_format, dask, words)
        if several:
            every = _together(made, job.joined, out).items()
            whole = [io.write_table(rows, folder.stage / f"{name}.{table_format}") for name, rows in every]
            joined = folder.publish(whole)
        shutil.rmtree(folder.run, ignore_errors=True)
    _show(job, made, notes)
    if written := [*(out / name for _, outcome in made for name in outcome.files), *joined]:
        console.wrote(written)
    failures = {item.key: outcome.reason for item, outcome in made if outcome.reason}
    numbers = {
        item.key: {**outcome.numbers, "files": [str(out / name) for name in outcome.files]}
        for item, outcome in made if not outcome.reason
    }  # fmt: skip
    console.write_json(json_file, {"estimator": job.name, "recordings": numbers, "failures": failures})
    if failures:
        console.errors.print(f"{of_recordings(len(failures), len(made))} could not be used", highlight=False)
        raise typer.Exit(1 if numbers else 2)


def _items(files: list[Path], tables: Mapping[Path, Source], format: str | None, trial: str | None) -> list[Item]:
    """The recordings in files, and in those that tables list, each with the first part of the names of its results."""
    listed = [(file.parent / cell, file, cell) if file in tables else (file, None, "")
              for file in files for cell in (tables[file].items if file in tables else ("",))]  # fmt: skip
    called = _called([file for file, _, _ in listed])
    items = []
    for file, table, cell in listed:
        subject = tables[table].subjects.get(cell, cell) if table else ""
        every = recordings.trials_of(file, "_".join(called[file]), format, trial)
        folder = "/".join(called[file][:-1])
        items += [item._replace(folder=folder, table=table, cell=cell, subject=subject) for item in every]
    return items


def _called(files: list[Path]) -> dict[Path, list[str]]:
    """File → its stem, after as many of its folders as tell it from the others; exits with code 2 if none do."""
    places: dict[Path, Path] = {}
    for number, file in enumerate(files):
        if (first := places.setdefault(file.resolve(), file)) is not file or file in files[:number]:
            stop(f"{file} is given twice{'' if first == file else f': as {first}, too'}; give each recording once")
    whole = {file: [*file.resolve().parent.parts[1:], file.stem] for file in files}
    called = {file: parts[-1:] for file, parts in whole.items()}
    for depth in range(2, max(map(len, whole.values()), default=0) + 1):
        many = Counter("_".join(parts).casefold() for parts in called.values())
        alike = {file for file, parts in called.items() if many["_".join(parts).casefold()] > 1}
        called |= {file: whole[file][-depth:] for file in alike}
    many = Counter("_".join(parts).casefold() for parts in called.values())
    if shared := [str(file) for file in files if many["_".join(called[file]).casefold()] > 1]:
        shown = ", ".join(shared)
        stop(f"the results of these files would have the same names: {shown}; estimate each into another --out")
    return called


def _outcomes(
    items: Sequence[Item], read: Read, job: EstimateJob, folder: ResultsFolder, ending: str, dask: str | None,
    words: list[str], kept: bool = False,
) -> list[tuple[Item, Outcome]]:  # fmt: skip
    """Estimate recordings, but for those that parts have done by the words of this command, and move their files into
    the folder; with `kept`, as in a part, into one among the intermediate results.
    """
    work = partial(_estimated, read, job, folder.stage.resolve(), ending, words)
    there = {item: folder.run / item.name for item in items if (folder.run / item.name).is_dir()}
    ready = {item: place for item, place in there.items() if Outcome.read(place).command == words}
    made: dict[Item, Outcome] = {}
    with machines.client_of(dask) as client:
        for item, place in chain(ready.items(), _places(work, [i for i in items if i not in ready], client)):
            if place is None:
                died = Outcome(item.subject or item.file.stem, DIED, command=words)
                place = died.write(Path(tempfile.mkdtemp(dir=folder.stage)))
            outcome = Outcome.read(place)
            console.say_failures([(item.key, outcome.reason)] if outcome.reason else [])
            if kept and place.parent != folder.run:
                folder.run.mkdir(exist_ok=True)
                place.rename(folder.run / item.name)
            elif not kept and not outcome.reason:
                folder.publish([place / name for name in outcome.files])
            made[item] = outcome
    return [(item, made[item]) for item in items]


def _places(
    work: Callable[[tuple[Item, ...]], Path], items: Sequence[Item], client: "Client | None"
) -> Iterator[tuple[Item, Path | None]]:
    """Each recording with the folder of its files; None if it kills every worker that takes it."""
    with console.progress() as bars:
        bar = console.Bar(bars)
        if client is None:
            for item in items:
                bar(f"{item.label}: reading and computing", 0, None)
                programs.before_compiling(partial(bar, f"{item.label}: compiling (first time only)", 0, None))
                yield item, work((item,))
            return

        there = {item._replace(file=item.file.resolve()): item for item in items}  # workers run in other folders
        for done, ((item,), place) in enumerate(on_dask(work, there, client)):
            bar("reading and computing", done, len(items))
            yield there[item], place


def _estimated(
    read: Read, job: EstimateJob, stage: Path, ending: str, words: list[str], items: tuple[Item, ...]
) -> Path:
    """Estimate a recording; returns a new folder in `stage` with its tables and figures, and its `Outcome`."""
    (item,), place = items, Path(tempfile.mkdtemp(dir=stage))
    subject = item.subject or item.file.stem
    try:
        recording, known = read(item)
        subject = recording.subject
        made = job.compute(recording, known)
    except Exception as error:  # whatever a damaged file leads to must not stop the others
        outcome = Outcome(subject, reason_of(error))
    else:
        tables = {name: f"{item.name}_{name}.{ending}" for name in made.tables}
        files = [io.write_table(made.tables[name], place / file) for name, file in tables.items()]
        files += made.drawn(place, item.name, job.about.figures)
        numbers = {**made.numbers, "flags": [flag._asdict() for flag in made.flags]}
        joined = {name: file for name, file in tables.items() if name in job.joined and len(made.tables[name])}
        outcome = Outcome(subject, "", made.flags, made.rows, numbers, joined, [file.name for file in files])
    return outcome._replace(command=words).write(place)


def _together(made: Sequence[tuple[Item, Outcome]], names: Iterable[str], out: Path) -> dict[str, "pd.DataFrame"]:
    """The tables of all recordings: `recordings`, a row each, and those of each one below the other."""
    import pandas as pd

    columns = ["recording", "subject", "file", "result", "reason"]
    tables = {"recordings": pd.DataFrame([outcome.row(item) for item, outcome in made], columns=columns)}
    for name in names:
        parts = {
            (item.recording, outcome.subject): io.read_table(out / outcome.tables[name])
            for item, outcome in made if name in outcome.tables
        }  # fmt: skip
        if parts:
            whole = pd.concat(parts, names=["recording", "subject"])
            tables[name] = whole.reset_index(level=[0, 1]).reset_index(drop=True)
    return tables


def _show(job: EstimateJob, made: Sequence[tuple[Item, Outcome]], notes: bool) -> None:
    """Print the numbers of all recordings, and how far to trust each; then its flags, or how many there are."""
    rows = [("" if number else item.name, *row) for item, outcome in made for number, row in enumerate(outcome.rows)]
    if rows:
        headings = ("recording", "measure", "value", "from")[: max(map(len, rows))]
        title = "all sensors together" if job.name == "all" else f"{job.name}{', the paper’s pipeline' * job.paper}"
        console.show(*headings, rows=rows, left=4, title=title)
    for item, outcome in made:
        if outcome.reason:
            continue
        grade = next((flag.grade for flag in outcome.flags if flag.grade in DOUBTS), "info")
        say(f"{item.label}: {verdict(outcome.flags)}", STYLES[grade] or "bold")
        for flag in outcome.flags if notes else ():
            for line in flag.text.splitlines():
                say(f"  {GRADES[flag.grade]}: {line}", STYLES[flag.grade])
            say(f"    {flag.meaning}")
        if lines := 0 if notes else sum(len(flag.text.splitlines()) for flag in outcome.flags):
            say(f"  {count(lines, 'remark', 'remarks')}: --notes prints them", "dim")
    if notes and rows:
        console.console.print(job.caption, style="dim")
