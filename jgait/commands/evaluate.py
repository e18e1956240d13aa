"""`jgait evaluate`: an estimator on a whole cohort, compared with its reference."""

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from jaxtyping import PyTree

from jgait import evaluate as evaluation
from jgait import plot
from jgait import report as reports
from jgait.commands import cohort as cohorts
from jgait.commands import recordings
from jgait.commands.console import (
    console,
    count,
    note,
    refused,
    say_failures,
    say_flags,
    show_table,
    stop,
    table_of,
    visible,
    write_json,
    wrote,
)
from jgait.commands.folder import results_folder
from jgait.commands.lessons import lessons_of, prepared
from jgait.estimators import Estimator
from jgait.evaluate import Cohort
from jgait.io.write import in_cells
from jgait.notes import from_json, of_recordings
from jgait.plot import cohort as plot_cohort
from jgait.report.page import significant
from jgait.tune import LOSSES as KNOWN
from jgait.tune import objective, parsed
from jgait.types import reason_of

if TYPE_CHECKING:
    import pandas as pd
    from distributed import Client

CONNECT_S = 10
"""[s] Longest time in which a Dask scheduler has to answer."""

TABLES = ("recordings", "quantities", "strides", "agreement", "failures")
FIGURES = ("agreement", "per_subject")
LOSSES = "losses.csv"
NOTES = "notes.json"
PLANNED = (
    LOSSES,
    NOTES,
    *(f"{name}.csv" for name in TABLES),
    *(f"{quantity.rpartition('_')[0]}_{figure}.png" for quantity in reports.cohort.DRAWN for figure in FIGURES),
)
"""Names of the files that the command may write."""


def evaluate(
    table: cohorts.File = None,
    dataset: cohorts.Dataset = None,
    simulated: cohorts.Simulated = None,
    estimator: cohorts.EstimatorName = "leg_ekf",
    paper: cohorts.Paper = False,
    params: cohorts.Params = None,
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
    dask: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, whose workers read the files and compute.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for tables and figures; an interrupted run continues there.")] = (
        Path("jgait-evaluation")
    ),
    fresh: Annotated[bool, typer.Option("--fresh", help="Delete the results of an earlier run in the folder.")] = False,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the numbers here.")] = None,
) -> None:
    """Run an estimator on a whole cohort, and compare it with the reference where there is one.

    Writes recordings.csv (samples, notes), quantities.csv and strides.csv (estimate, reference, error), agreement.csv
    (bias, limits), failures.csv (why a recording could not be used), notes.json (all notes, of the cohort and of each
    recording) and figures. A recording that cannot be used stops no other. Exit code 0: all recordings were used; 1:
    some could not be used; 2: none.
    """
    pipeline, start, source = cohorts.opened(
        table, dataset, simulated, seed, estimator, paper, params, gyr_unit, acc_unit
    )
    with refused("--loss: "):
        names = [] if loss is None else list(parsed(loss))
    with refused():
        if names:
            objective(pipeline, None, dict.fromkeys(names, 1.0))
    read = [table, params, *source.files]
    with results_folder(
        out, "evaluate", source.marks, planned=PLANNED, inputs=read, json_file=json_file, fresh=fresh
    ) as folder:
        continued = any(folder.run.glob("part-*-*"))
        with _client(dask) as client:
            results = cohorts.evaluated(pipeline, start, source, out=folder.run, batch=batch, client=client)
        if continued:
            console.print(
                f"continuing an earlier run in {out}; its finished recordings were not computed again", highlight=False
            )
        if not len(results.recordings):
            folder.forget()
        results = evaluation.Cohort(*(rows[rows["recording"].isin(source.marks)] for rows in results))
        results, failures = source.with_failures(results)
        usable = results.usable()
        agreement = usable.agreement()
        judged = _judged(pipeline, source, start, names, failures) if names else None
        written = _write(folder.stage, results, usable, agreement)
        every = [{"recording": None, **cohort_note.to_dict()} for cohort_note in source.notes]
        for name, text in results.recordings[["recording", "notes"]].itertuples(index=False, name=None):
            every += [{"recording": name, **recording_note.to_dict()} for recording_note in from_json(text)]
        written.append(folder.stage / NOTES)
        written[-1].write_text(json.dumps(every, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        if judged is not None:
            written.append(folder.stage / LOSSES)
            in_cells(judged).to_csv(written[-1], index=False)
        files = folder.publish(written)
    write_json(json_file, {
        "estimator": pipeline.name, "recordings": len(results.recordings), "failures": dict(failures),
        "not_to_be_used": sorted({*results.recordings["recording"]} - {*usable.recordings["recording"]}),
        "agreement": agreement.astype(object).to_dict("index"), "files": list(map(str, files)),
    })  # fmt: skip
    _show(f"{pipeline.name}{', the paper’s pipeline' if paper else ''} on {source.title}", results)
    for agreement_table in reports.cohort.agreement_tables(agreement):
        show_table(agreement_table, "agreement with the reference")
    for line in reports.cohort.remarks(usable, agreement, "stride_time" in (pipeline.about.losses or ())):
        console.print(visible(line), highlight=False, soft_wrap=True)
    if judged is not None:
        _show_losses(judged[judged["recording"].isin(usable.recordings["recording"])], names)
    say_flags(reports.cohort.doubts(results, usable), f"notes of recordings.csv, or jgait report {out}")
    wrote(files)
    if failures:
        console.print(f"{of_recordings(len(failures), len(failures) + len(results.recordings))} could not be used")
        raise typer.Exit(1)


@contextlib.contextmanager
def _client(address: str | None) -> "Iterator[Client | None]":
    """A client of the Dask scheduler at an address, or None; exits with code 2 if there is no scheduler."""
    if address is None:
        yield None
        return
    try:
        from distributed import Client

        client = Client(address, timeout=CONNECT_S)
    except ImportError:
        stop("--dask needs the package distributed: pip install 'jgait[cluster]'")
    except (OSError, ValueError) as error:
        stop(f"--dask: no Dask scheduler answers at {address}: {reason_of(error)}")
    with client:
        yield client


def _judged(
    pipeline: Estimator[PyTree, PyTree], source: cohorts.Source, start: PyTree, names: list[str],
    printed: list[tuple[str, str]],
) -> "pd.DataFrame":  # fmt: skip
    """The errors of the recordings in each loss, empty where a reference cannot answer it; `printed` are failures that
    were printed before.
    """
    import pandas as pd

    source, pipeline = prepared(source, pipeline, [])
    tables = []
    for name in names:
        failures: list[tuple[str, str]] = []
        try:
            lessons = lessons_of(pipeline, source, start, [], failures, [name])
            say_failures([failure for failure in failures if failure not in printed])
            tables.append(evaluation.judged(pipeline, start, lessons, [name]).set_index(["recording", "subject"]))
        except ValueError as error:
            note(f"--loss: {error}")
    return pd.concat(tables, axis=1).reset_index() if tables else pd.DataFrame(columns=["recording", "subject"])


def _show_losses(judged: "pd.DataFrame", names: list[str]) -> None:
    console.print("\nlosses, over the recordings", style="italic")
    shown = table_of("loss", "error", "recordings", "median", "mean", "worst", left=2)
    for name in judged.columns.intersection(names):
        column, known = judged[name], KNOWN[name]
        numbers = (significant(v) for v in (column.median(), column.mean(), column.max()))
        shown.add_row(name, visible(f"{known.words} [{known.unit}]"), f"{column.count()}", *numbers)
    console.print(shown)


def _write(out: Path, results: Cohort, usable: Cohort, agreement: "pd.DataFrame") -> list[Path]:
    tables = {**results._asdict(), "agreement": agreement.reset_index()}
    files = [out / f"{name}.csv" for name in TABLES]
    for name, file in zip(TABLES, files, strict=True):
        in_cells(tables[name]).to_csv(file, index=False)
    for name, rows, words, unit in reports.cohort.drawn(usable.paired()):
        what = name.rpartition("_")[0]
        files.append(plot.save(plot_cohort.bland_altman(rows, words, unit=unit), out / f"{what}_agreement.png"))
        files.append(plot.save(plot_cohort.per_subject(rows, words, unit=unit), out / f"{what}_per_subject.png"))
    return files


def _show(title: str, results: Cohort) -> None:
    """Print how many recordings of how many people there are."""
    recordings = results.recordings
    console.print(
        f"{visible(title)}: {count(len(recordings), 'recording', 'recordings')} of "
        f"{count(recordings['subject'].nunique(), 'person', 'people')}, "
        f"{recordings['seconds'].sum():.0f} s recorded", highlight=False,
    )  # fmt: skip
