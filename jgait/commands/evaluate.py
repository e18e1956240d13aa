"""`jgait evaluate`: an estimator on a whole cohort, compared with its reference."""

import contextlib
import json
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from jaxtyping import PyTree

from jgait import evaluate as evaluation
from jgait import plot
from jgait.commands import cohort as cohorts
from jgait.commands import recordings
from jgait.commands.console import (
    console,
    count,
    note,
    say_failures,
    stop,
    table_of,
    visible,
    write_json,
    wrote,
)
from jgait.commands.folder import results_folder
from jgait.commands.lessons import check_answers, lessons_of, losses_of, prepared
from jgait.commands.warnings import say_warnings
from jgait.estimators import Estimator
from jgait.estimators.stride_flags import STRIDE_COLUMNS
from jgait.evaluate import Cohort
from jgait.evaluate.store import REGULAR
from jgait.notes import Note, from_json, of_recordings
from jgait.plot import cohort as plot_cohort
from jgait.report.cohort import DRAWN, drawn
from jgait.report.page import significant
from jgait.report.recording import readable
from jgait.tune import LOSSES as KNOWN
from jgait.types import reason_of

if TYPE_CHECKING:
    import pandas as pd
    from distributed import Client

WITHIN = "_within_2sd_percent"
"""End of the name of a quantity that states how many errors the stated deviations contain."""

NOT_COMPARED = (
    "the body's way, which is estimated, differs from the foot's from and to standing and in turns",
    "no estimated stride fits their times: the estimate lacks them, or the reference is of other times",
)
"""Why strides are not compared, without and with strides of the estimate."""

NOT_USED = "the notes say that the result should not be used (see below); quantities.csv and strides.csv have them"
"""Why recordings are not compared."""

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
    *(f"{quantity.rpartition('_')[0]}_{figure}.png" for quantity in DRAWN for figure in FIGURES),
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
    batch: Annotated[int, typer.Option(min=1, help="Recordings that run at once.")] = 64,
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
    names = [] if loss is None else list(losses_of("--loss", loss))
    if names:
        check_answers(pipeline, names)
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
        written.append(folder.stage / NOTES)
        written[-1].write_text(_notes(source.notes, results), encoding="utf-8")
        if judged is not None:
            written.append(folder.stage / LOSSES)
            judged.to_csv(written[-1], index=False)
        files = folder.publish(written)
    write_json(json_file, {
        "estimator": pipeline.name, "recordings": len(results.recordings), "failures": dict(failures),
        "not_to_be_used": sorted({*results.recordings["recording"]} - {*usable.recordings["recording"]}),
        "agreement": agreement.astype(object).to_dict("index"), "files": list(map(str, files)),
    })  # fmt: skip
    _show(f"{pipeline.name}{', the paper’s pipeline' if paper else ''} on {source.title}", results, usable, agreement,
          has_strides="stride_time" in (pipeline.about.losses or ()))  # fmt: skip
    if judged is not None:
        _show_losses(judged[judged["recording"].isin(usable.recordings["recording"])], names)
    every = f"column notes of {out / 'recordings.csv'}, or jgait report {out}"
    say_warnings(results.recordings[["recording", "notes"]].itertuples(index=False, name=None), every)
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
        tables[name].to_csv(file, index=False)
    for name, rows, words, unit in drawn(usable.paired()):
        what = name.rpartition("_")[0]
        files.append(plot.save(plot_cohort.bland_altman(rows, words, unit=unit), out / f"{what}_agreement.png"))
        files.append(plot.save(plot_cohort.per_subject(rows, words, unit=unit), out / f"{what}_per_subject.png"))
    return files


def _notes(of_cohort: Iterable[Note], results: Cohort) -> str:
    """All notes as JSON, first those of the cohort, whose `recording` is null."""
    recordings: Iterable[tuple[str, str]] = zip(
        results.recordings["recording"], results.recordings["notes"], strict=True
    )
    of_recordings = [{"recording": name, **one.to_dict()} for name, text in recordings for one in from_json(text)]
    every = [*({"recording": None, **one.to_dict()} for one in of_cohort), *of_recordings]
    return json.dumps(every, indent=1, ensure_ascii=False) + "\n"


def _label(name: str) -> str:
    words, unit = readable(name)
    return visible(f"{words} [{unit}]" if unit else words)


def _span(low: float, high: float) -> str:
    return "–" if not math.isfinite(low) else f"{significant(low)} … {significant(high)}"


def _show(title: str, results: Cohort, usable: Cohort, agreement: "pd.DataFrame", *, has_strides: bool) -> None:
    """Print the results in tables that fit a terminal, errors of the usable ones."""
    recordings = results.recordings
    console.print(
        f"{visible(title)}: {count(len(recordings), 'recording', 'recordings')} of "
        f"{count(recordings['subject'].nunique(), 'person', 'people')}, "
        f"{recordings['seconds'].sum():.0f} s recorded", highlight=False,
    )  # fmt: skip
    known = list(agreement.index[agreement["n"] > 0])
    covered = [name for name in known if name.endswith(WITHIN)]
    shapes = [name for name in known if "_rmse_" in name]
    compared = [name for name in known if name not in (*covered, *shapes)]
    if compared:
        console.print("\nagreement with the reference", style="italic")
        shown = table_of("quantity", "n / people", "bias", "95 % limits", "mean |error|", "worst", "ICC(2,1)")
        for name in compared:
            row = agreement.loc[name]
            shown.add_row(
                _label(name), f"{row['n']:.0f} / {row['n_subjects']:.0f}", significant(row["bias"]),
                _span(row["loa_low"], row["loa_high"]), significant(row["mae"]), significant(row["max_abs"]),
                significant(row["icc"]),
            )  # fmt: skip
        console.print(shown)
        if any(name.startswith(REGULAR) for name in compared):
            note("regular strides are in no turn, on no stairs, no half-step, not uneven and not in doubt")
        dropped: dict[str, list[str]] = {}
        for name in (name for name in compared if name in STRIDE_COLUMNS and agreement["n_dropped"][name]):
            lacks = f"{agreement['n_dropped'][name]:.0f} of {agreement[['n', 'n_dropped']].loc[name].sum():.0f}"
            dropped.setdefault(lacks, []).append(name.rpartition("_")[0].replace("_", " "))
        for lacks, what in dropped.items():
            note(f"{', '.join(what)}: {lacks} strides of the reference are not compared; {NOT_COMPARED[has_strides]}")
        if (agreement.loc[compared, "icc"].isna() & (agreement.loc[compared, "n"] > 1)).any():
            note("ICC – : the reference does not vary, so that differences between people cannot be judged")
    rows = usable.paired()
    for name in covered:
        share = rows.loc[rows["quantity"] == name, "estimate"].dropna()
        console.print(
            f"{visible(name.removesuffix(WITHIN).replace('_', ' '))}: {share.mean():.1f} % of a recording's strides "
            f"within two stated standard deviations, lowest {share.min():.1f} % (95.4 % are to be expected)",
            highlight=False,
        )  # fmt: skip
    relative = 100.0 * rows.loc[rows["quantity"] == "distance_m", "rel_error"].abs().dropna()
    if len(relative):
        console.print(
            f"distance: |error| {relative.mean():.1f} % on average, median {relative.median():.1f} %, "
            f"worst {relative.max():.1f} %", highlight=False,
        )  # fmt: skip
    if shapes:
        _show_shapes(rows, shapes)
    left_out = len(recordings) - len(usable.recordings)
    if left_out:
        note(f"{of_recordings(left_out, len(recordings), 'is', 'are')} in none of these errors: {NOT_USED}")
    without = len(usable.recordings) - rows.loc[rows["estimate"].notna(), "recording"].nunique()
    if without:
        note(f"{of_recordings(without, len(recordings), 'has', 'have')} no reference to be compared with")


def _show_shapes(rows: "pd.DataFrame", names: list[str]) -> None:
    meaning = "feet turned and shifted to fit" if names[0].startswith("foot") else "offsets while standing included"
    console.print(f"\nroot mean square error of whole recordings, {meaning}", style="italic")
    shown = table_of("quantity", "recordings", "median", "mean", "worst")
    for name in names:
        errors = rows.loc[rows["quantity"] == name, "estimate"].dropna()
        numbers = (significant(v) for v in (errors.median(), errors.mean(), errors.max()))
        shown.add_row(_label(name), str(len(errors)), *numbers)
    console.print(shown)
