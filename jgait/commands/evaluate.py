"""`jgait evaluate`: an estimator on a whole cohort, compared with its reference."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from jaxtyping import PyTree

from jgait import evaluate as evaluation
from jgait import plot
from jgait import report as reports
from jgait.commands import cohort as cohorts
from jgait.commands import console, machines, options, recordings
from jgait.commands.cohort_table import Source
from jgait.commands.folder import results_folder
from jgait.commands.tune_run import lessons_of, prepared
from jgait.estimators import Estimator
from jgait.evaluate import Cohort
from jgait.evaluate.cohort import BATCH, FEW
from jgait.io.write import in_cells
from jgait.notes import from_json, of_recordings
from jgait.plot import cohort as plot_cohort
from jgait.report.page import significant
from jgait.tune import LOSSES as KNOWN
from jgait.tune import objective, parsed

if TYPE_CHECKING:
    import pandas as pd

TABLES = ("recordings", "quantities", "strides", "agreement", "failures")
LOSSES = "losses.csv"
NOTES = "notes.json"
PLANNED = (
    LOSSES, NOTES, *(f"{name}.csv" for name in TABLES),
    *(f"{quantity.rpartition('_')[0]}_{figure}.png" for quantity in reports.cohort.DRAWN
      for figure in ("agreement", "per_subject")),
)  # fmt: skip
"""Names of the files that the command may write."""


def evaluate(
    context: typer.Context,
    table: cohorts.File = None,
    dataset: cohorts.Dataset = None,
    simulated: cohorts.Simulated = None,
    estimator: options.EstimatorName = "leg_ekf",
    paper: options.Paper = False,
    params: options.Params = None,
    gyr_unit: recordings.GyrUnit = None,
    acc_unit: recordings.AccUnit = None,
    seed: cohorts.Seed = 0,
    loss: Annotated[
        str | None, typer.Option(help="Losses of jgait tune to report too, for example position,stride_length.")
    ] = None,
    batch: Annotated[
        int | None,
        typer.Option(min=1, help="Recordings that run at once; default 64, but 1 for at most 32 recordings."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for tables and figures; an interrupted run continues there.")] = (
        Path("jgait-evaluation")
    ),
    dask: machines.Dask = None,
    part: machines.PartText = None,
    fresh: console.Fresh = False,
    json_file: console.Json = None,
) -> None:
    """Run an estimator on a whole cohort, and compare it with the reference where there is one.

    Writes recordings.csv (samples, notes), quantities.csv and strides.csv (estimate, reference, error), agreement.csv
    (bias, limits), failures.csv (why a recording could not be used), notes.json (all notes, of the cohort and of each
    recording) and figures. A recording that cannot be used stops no other. Exit code 0: all recordings were used; 1:
    some could not be used; 2: none.
    """
    words = table, dataset, simulated, seed, gyr_unit, acc_unit
    pipeline, start, source = cohorts.opened(estimator, paper, params, *words)
    with console.refused("--loss: "):
        names = [] if loss is None else list(parsed(loss))
    with console.refused():
        if names:
            objective(pipeline, None, dict.fromkeys(names, 1.0))
    batch = batch or (1 if len(source.items) <= FEW else BATCH)  # numbers are the same on one and on many machines
    read = [table, params, *source.files]
    if (of := machines.part_of(part)) is not None:
        with of.folder(out, "evaluate", context, source.marks, read, fresh) as folder:
            share = source._replace(items=of.share(source.items))
            results = cohorts.evaluated(pipeline, start, share, dask, out=folder.run, batch=batch)
        console.say_failures([*results.failures[["recording", "reason"]].itertuples(index=False, name=None)])
        of.end(out, len(results.recordings), len(results.failures))
        return
    with results_folder(
        out, "evaluate", source.marks, planned=PLANNED, inputs=read, json_file=json_file, fresh=fresh
    ) as folder:
        continued = any(folder.run.glob("part-*-*"))
        results = cohorts.evaluated(pipeline, start, source, dask, out=folder.run, batch=batch)
        if continued:
            console.say(f"continuing an earlier run in {out}; its finished recordings were not computed again")
        if not len(results.recordings):
            folder.forget()
        results = Cohort(*(rows[rows["recording"].isin(source.marks)] for rows in results))
        results, failures = source.with_failures(results)
        usable = results.usable()
        agreement = usable.agreement()
        judged = _judged(pipeline, source, start, names, failures) if names else None
        files = folder.publish(_write(folder.stage, source, results, usable, agreement, judged))
    console.write_json(json_file, {
        "estimator": pipeline.name, "recordings": len(results.recordings), "failures": dict(failures),
        "not_to_be_used": sorted({*results.recordings["recording"]} - {*usable.recordings["recording"]}),
        "agreement": agreement.astype(object).to_dict("index"), "files": list(map(str, files)),
    })  # fmt: skip
    rows = results.recordings
    of_people = console.count(rows["subject"].nunique(), "person", "people")
    many = f"{console.count(len(rows), 'recording', 'recordings')} of {of_people}"
    title = f"{pipeline.name}{', the paper’s pipeline' if paper else ''} on {source.title}"
    console.say(f"{title}: {many}, {rows['seconds'].sum():.0f} s recorded")
    for agreement_table in reports.cohort.agreement_tables(agreement):
        console.show_table(agreement_table, "agreement with the reference")
    for line in reports.cohort.remarks(usable, agreement, "stride_time" in (pipeline.about.losses or ())):
        console.say(line)
    if judged is not None:
        _show_losses(judged[judged["recording"].isin(usable.recordings["recording"])], names)
    console.say_flags(reports.cohort.doubts(results, usable), f"notes of recordings.csv, or jgait report {out}")
    console.wrote(files)
    if failures:
        console.say(f"{of_recordings(len(failures), len(failures) + len(results.recordings))} could not be used")
        raise typer.Exit(1)


def _judged(
    pipeline: Estimator[PyTree, PyTree], source: Source, start: PyTree, names: list[str],
    printed: list[tuple[str, str]],
) -> "pd.DataFrame":  # fmt: skip
    """The errors of the recordings in each loss, empty where a reference cannot answer it; `printed` are known
    failures.
    """
    import pandas as pd

    source, pipeline = prepared(source, pipeline, [])
    tables = []
    for name in names:
        failures: list[tuple[str, str]] = []
        try:
            lessons = lessons_of(pipeline, source, start, [], failures, [name])
            console.say_failures([failure for failure in failures if failure not in printed])
            tables.append(evaluation.judged(pipeline, start, lessons, [name]).set_index(["recording", "subject"]))
        except ValueError as error:
            console.note(f"--loss: {error}")
    return pd.concat(tables, axis=1).reset_index() if tables else pd.DataFrame(columns=["recording", "subject"])


def _show_losses(judged: "pd.DataFrame", names: list[str]) -> None:
    rows = []
    for name in judged.columns.intersection(names):
        column, known = judged[name], KNOWN[name]
        numbers = map(significant, (column.median(), column.mean(), column.max()))
        rows.append((name, f"{known.words} [{known.unit}]", column.count(), *numbers))
    headings = ("loss", "error", "recordings", "median", "mean", "worst")
    console.show(*headings, rows=rows, left=2, title="losses, over the recordings")


def _write(
    out: Path, source: Source, results: Cohort, usable: Cohort, agreement: "pd.DataFrame",
    judged: "pd.DataFrame | None",
) -> list[Path]:  # fmt: skip
    """Write tables, notes and figures."""
    tables = {f"{name}.csv": rows for name, rows in results._asdict().items()}
    tables |= {"agreement.csv": agreement.reset_index()} | ({} if judged is None else {LOSSES: judged})
    for name, rows in tables.items():
        in_cells(rows).to_csv(out / name, index=False)
    notes = [{"recording": None, **note.to_dict()} for note in source.notes]
    for name, text in results.recordings[["recording", "notes"]].itertuples(index=False, name=None):
        notes += [{"recording": name, **note.to_dict()} for note in from_json(text)]
    (out / NOTES).write_text(json.dumps(notes, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    files = [*(out / name for name in tables), out / NOTES]
    for name, rows, words, unit in reports.cohort.drawn(usable.paired()):
        what = out / name.rpartition("_")[0]
        files.append(plot.save(plot_cohort.bland_altman(rows, words, unit=unit), f"{what}_agreement.png"))
        files.append(plot.save(plot_cohort.per_subject(rows, words, unit=unit), f"{what}_per_subject.png"))
    return files
