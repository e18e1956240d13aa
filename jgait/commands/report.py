"""`jgait report`: one HTML page about a recording or a cohort."""

import itertools
import shlex
import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from jgait import estimators, evaluate
from jgait import report as reports
from jgait.commands import cohort as cohorts
from jgait.commands import jobs, options, recordings
from jgait.commands.cohort_table import is_cohort
from jgait.commands.console import Json, count, note, refused, say, stop, write, write_json, wrote
from jgait.commands.folder import keep_inputs, unfinished
from jgait.datasets import DatasetUnavailable
from jgait.estimators.combined import MEASURES, Analysis
from jgait.notes import grouped
from jgait.report import Report, moves
from jgait.report.page import Cell, Section, Table, significant
from jgait.tune import explain as explained_by
from jgait.types import Estimate, Walk, reason_of

MOVED = "Against the reference, without the offset at standing"
"""Heading of the errors of angles as README states them."""

COHORTS_BY = "leg_ekf"
"""The estimator of a cohort if none is named."""


def report(
    context: typer.Context,
    what: Annotated[
        Path | None,
        typer.Argument(
            metavar="[WALK.csv|COHORT.csv|FOLDER]",
            help="A recording, as of jgait estimate, also a folder; a table of recordings with a column `file`; or the "
            "folder that jgait evaluate wrote.",
        ),
    ] = None,
    dataset: cohorts.Dataset = None,
    simulated: cohorts.Simulated = None,
    recording: Annotated[
        str | None, typer.Option(help="Only this recording of --dataset, with its reference in the figures.")
    ] = None,
    estimator: options.OneEstimator = None,
    paper: options.Paper = False,
    params: options.Params = None,
    person: options.PersonFile = None,
    height: options.Height = None,
    thigh: options.Thigh = None,
    shank: options.Shank = None,
    option: options.Options = None,
    rate: recordings.Rate = None,
    gyr_unit: recordings.GyrUnit = None,
    acc_unit: recordings.AccUnit = None,
    range_unit: recordings.RangeUnit = "m",
    format: recordings.Format = None,
    place: recordings.Place = None,
    trial: recordings.Trial = None,
    seed: cohorts.Seed = 0,
    out: Annotated[Path, typer.Option(help="The page.")] = Path("report.html"),
    explain: Annotated[
        str | None,
        typer.Option(help="Add what moves a number of a recording, such as stride_length; see jgait explain."),
    ] = None,
    show: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    json_file: Json = None,
) -> None:
    """One self-contained HTML page about a recording or a cohort: summary, warnings in plain words, figures, tables.

    Of one recording, every estimator that has its sensors runs, and the page compares them; with --estimator, one
    method runs alone. Of a cohort, one estimator runs, leg_ekf if none is named.

    The page loads nothing from other addresses and names no folder. Exit code 0: success; 1: some recordings of a
    cohort could not be used; 2: no page could be made.
    """
    if out.suffix.lower() not in (".html", ".htm"):
        stop(f"--out is the name of a page and ends with .html; got {out.name!r}")
    keep_inputs([out, json_file], [what, params])
    if json_file is not None and json_file.resolve() == out.resolve():
        stop(f"--json and --out are the same file: {out}")
    files = recordings.how(rate, gyr_unit, acc_unit, range_unit, format, place, trial)
    command, given = command_of(context.obj), options.given(option, height, thigh, shank)
    if recording is not None and dataset is None:
        stop("--recording names a recording of a --dataset; there is none")
    table_of_cohort = dataset or simulated or what is None or is_cohort(what)
    if what is not None and dataset is None and simulated is None and is_evaluation(what):
        page, failures = _of_folder(what, command)
    elif recording is not None or not table_of_cohort:
        if what is not None and dataset is not None:
            stop("give one of: a file, --dataset NAME; got both")
        job = jobs.job_of(estimator or (COHORTS_BY if paper or params else None), paper, params, person, given)
        if what is not None:
            walk = Walk(recordings.only(what, files), None, {})
        else:
            with refused(f"{dataset}: ", DatasetUnavailable):
                walk = cohorts.of_set(str(dataset), str(recording))
        page, failures = of_walk(walk, job, str(what or f"{dataset}: {recording}"), command, explain), 0
    else:
        if person is not None:
            stop("--person is of one recording; for a cohort put columns into its table")
        for name in given:
            stop(f"{options.named(name)} is of one recording; for a cohort put a column into its table")
        words = what, dataset, simulated, seed, gyr_unit, acc_unit
        pipeline, start, source = cohorts.opened(estimator or COHORTS_BY, paper, params, *words)
        keep_inputs((out, json_file), source.files)
        rows, failed = source.with_failures(cohorts.evaluated(pipeline, start, source))
        made = reports.Made(
            pipeline.name, start, pipeline.params, "the paper's" if paper else "", source.title, command,
            tuple(source.notes),
        )  # fmt: skip
        page, failures = reports.of_cohort(rows, title=source.title, made=made), len(failed)
    write(out, page.html)
    write_json(json_file, page.numbers)
    wrote([out, *([] if json_file is None else [json_file])])
    if show:
        webbrowser.open(out.resolve().as_uri())
    if failures:
        say(f"{count(failures, 'recording', 'recordings')} could not be used")
        raise typer.Exit(1)


def command_of(words: Sequence[str]) -> str:
    """The command line of the words after `jgait`, with file names without folders."""
    shown, kept = ["jgait"], ("--trial", "--gyr-unit", "--acc-unit")  # options whose values have "/" and are no file
    for before, word in itertools.pairwise(["", *words]):
        option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
        folder = ("/" in value or "\\" in value) and not {option, before} & {*kept}
        shown.append(option + equals + (Path(value).name if folder else value))
    return shlex.join(word for word in shown if word != "--open")


def of_walk(walk: Walk, job: jobs.EstimateJob, data: str, command: str, explain: str | None = None) -> Report:
    """The page of one recording, perhaps with what moves a number; exits with code 2 if it cannot be used."""
    known = cohorts.body(walk, tuple({name for names in MEASURES.values() for name in names}))
    try:
        result = job.compute(walk.recording, known)
    except Exception as error:
        stop(f"{data}: {reason_of(error)}")
    for line in grouped(result.notes):
        note(line)
    more: list[Section] = []
    if isinstance(result.made, Analysis):
        first, person = result.made.sources[0], result.made.person
        estimator = estimators.get(first.estimator)
    else:
        first, person, estimator = result.made, {}, estimators.get(job.name, **result.made.settings)
    if explain is not None:
        with refused(f"--explain: {data}: "):
            more = [moves.section(explained_by(estimator, first.params, walk.recording, explain, person=person))]
    more += _moved(result.made.estimate, walk)
    if isinstance(result.made, Analysis):
        made = reports.Made("all sensors together", file=data, command=command)
        return reports.of_analysis(result.made, walk.recording, reference=walk.reference, made=made, more=more)
    pipeline = "the paper's" if job.paper else ""
    made = reports.Made(job.name, first.params, estimator.params, pipeline, data, command)
    return reports.of_estimate(result.made.estimate, walk.recording, reference=walk.reference, made=made, more=more)


def _moved(estimate: Estimate, walk: Walk) -> list[Section]:
    """Errors of angles in the window of walking, without their offset in that of standing, as README states them, if
    any.
    """
    windows = walk.info.get("windows") or {}
    if walk.reference is None or not {"whole", "standing"} <= set(windows):
        return []
    samples = np.arange(len(walk.reference.time))
    walking, standing = ((samples >= first) & (samples < end)
                         for first, end in map(windows.get, ("whole", "standing")))  # fmt: skip
    try:
        errors = evaluate.trajectory_errors(estimate, walk.reference, walking, standing)
    except ValueError:
        return []
    rows = [[Cell(f"{joint} angle, {side}"), Cell(significant(errors.loc[side, f"{joint}_deg"]))]
            for side in errors.index for joint in ("hip", "knee")]  # fmt: skip
    caption = (
        "Root mean square differences from walking off to standing again, without the mean difference at standing."
    )
    return [Section(MOVED, "", [Table(caption, ("", "difference [°]"), rows)])]


def is_evaluation(folder: Path) -> bool:
    """Whether a folder has files of `jgait evaluate`; else it is a recording."""
    return any((folder / name).exists() for name in ("recordings.csv", ".jgait-evaluate.json"))


def _of_folder(folder: Path, command: str) -> tuple[Report, int]:
    """The page of the results of `jgait evaluate` in a folder."""
    wrong = f"{folder} is no folder that jgait evaluate wrote"
    try:
        if unfinished(folder, "evaluate"):
            stop(f"{folder} holds an evaluation that did not end; repeat it")
        rows, made = reports.cohort.read_folder(folder)
        page = reports.of_cohort(rows, title=folder.resolve().name, made=made._replace(command=command))
        return page, len(rows.failures)
    except typer.Exit:
        raise
    except FileNotFoundError as error:
        lacking = Path(error.filename or "recordings.csv").name
        stop(f"{wrong}: it has no {lacking}. Give the folder that it wrote, or a file: one recording, or a table of "
             "recordings with a column 'file'")  # fmt: skip
    except Exception as error:
        stop(f"{wrong}: {reason_of(error)}")
