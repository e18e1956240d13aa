"""The output of `jgait tune`: printed tables and written files."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jgait import evaluate, io, plot
from jgait.commands.console import console, count, note, table_of, visible, write_json, wrote
from jgait.commands.folder import ResultsFolder
from jgait.commands.tune_run import Job, TuningResults
from jgait.evaluate import PairedDifference
from jgait.io.write import in_cells
from jgait.notes import resolved
from jgait.plot import cohort as plot_cohort
from jgait.plot import tuning as plot_tuning
from jgait.report.made import flat
from jgait.report.page import significant
from jgait.tune.words import OFF

if TYPE_CHECKING:
    import pandas as pd

PLANNED = ("tuned.json", "training.png", "held_out.csv", "before_after.png")
"""Names of the files that the command may write."""

MOST = 30
"""Largest number of people in the table on the terminal; the file has all people."""

ENOUGH = 6
"""Smallest number of people for a verdict: fewer change in the same direction by chance in more than 5 % of cases."""


class TuningOutcome(NamedTuple):
    """What a preset takes from a tuning: how it was made, standard errors, and the change on people left out."""

    made: dict[str, Any]
    spreads: dict[str, float]
    change: PairedDifference | None


def report(
    title: str, job: Job, results: TuningResults, how: dict[str, Any], folder: ResultsFolder,
    failures: list[tuple[str, str]], json_file: Path | None,
) -> TuningOutcome:  # fmt: skip
    """Write and print everything."""
    out = folder.stage
    values = _values(job, results)
    spreads = {name: row["stderr"] for name, row in values.items() if row["stderr"] is not None}
    doubts = {"not_learned": list(results.fit.not_learned), "not_determined": results.undetermined}
    held_out = None
    if results.validation is not None:
        each = results.validation.table
        medians = {name: float(each[f"error_{name}"].median()) for name in ("before", "after")}
        held_out = {"error": job.judged, "unit": job.unit, "n": len(each), **medians}  # of people, or of days
    origin = how | doubts | {"held_out": held_out}
    files = [
        io.write_params(
            out / "tuned.json", results.fit.params, estimator=job.pipeline.name, stderr=spreads, made=origin
        ),
        plot.save(plot_tuning.training(results.fit, title=title), out / "training.png"),
    ]  # fmt: skip
    change = None
    if results.validation is not None:
        table = results.validation.table
        items = results.validation.items.assign(recording=job.made.names)
        files.append(out / "held_out.csv")
        people = items.assign(
            subject=job.made.subjects, **({"day": items["subject"]} if job.groups.singular == "day" else {})
        )
        columns = ["recording", "subject", "day", "fold", "error_before", "error_after"]
        in_cells(people[[name for name in columns if name in people]]).to_csv(files[-1], index=False)
        rows = items[np.isfinite(items[["error_before", "error_after"]]).all(axis=1)]
        change = evaluate.paired_difference(rows["error_before"], rows["error_after"], rows["subject"], seed=0)
        drawn = plot_cohort.before_after(
            rows, unit=job.unit, name=job.judged,
            title=f"each {job.groups.singular} judged by parameters learned from other {job.groups.many}",
        )  # fmt: skip
        files.append(plot.save(drawn, out / "before_after.png"))
    files = folder.publish(files)
    taken = f"{count(results.fit.losses.size, 'step', 'steps')} of at most {how['steps']}"
    console.print(
        f"{visible(title)}: {count(len(job.made.names), 'recording', 'recordings')} of "
        f"{count(how['people'], 'person', 'people')}, {taken}", highlight=False,
    )  # fmt: skip
    if change is not None:
        _show_held_out(table, job, change)
    _show_values(values)
    if results.errors is not None:
        before, after = map(significant, results.errors)
        losses = (significant(value, 4) for value in (results.fit.losses[0], results.fit.best_loss))
        error_text = f"{job.judged} [{job.unit}] of the recordings learned from, median: {before} before, {after} after"
        console.print(visible(f"{error_text}; loss {' before, '.join(losses)} after"), highlight=False, soft_wrap=True)
    for line in [] if results.known is None else results.known.sentences:
        console.print(visible(f"· {line}"), highlight=False)
    if results.undetermined:
        why = "" if results.known else "the loss hardly changes with a factor of e, or a quarter of the range, so that "
        note(
            f"not determined: {', '.join(results.undetermined)}; {why}the value may be far off. Leave it out of "
            "--free, or learn from a loss or recordings that depend on it"
        )
    elif results.known is not None and results.known.decrement > OFF:
        note("more --steps, or other --starts, may reach the optimum more closely")
    for line in results.left_out:
        note(line)
    wrote(files)
    write_json(json_file, {
        **how, **doubts, "steps_taken": results.fit.losses.size, "values": values,
        "held_out": None if change is None else change._asdict() | {"unit": job.unit},
        "losses": [float(v) for v in results.fit.losses], "failures": dict(failures), "files": list(map(str, files)),
    })  # fmt: skip
    if held_out is not None:
        origin["held_out"] = held_out | {"each": json.loads(each.reset_index().to_json(orient="records"))}
    return TuningOutcome(origin, spreads, change)


def _values(job: Job, results: TuningResults) -> dict[str, dict[str, Any]]:
    """Every learned number: unit, value before and after; standard error and ends of its 95 % interval, or None."""
    units, known = io.units(job.start), results.known
    free, before, after = (flat(params) for params in (results.fit.free, job.start, results.fit.params))
    rows = {
        name: {"unit": units[name], "before": before[name], "after": after[name], "stderr": None, "low": None,
               "high": None}
        for name in after if name in free
    }  # fmt: skip
    for name, *numbers in () if known is None else zip(known.names, known.stderr, known.low, known.high, strict=True):
        if np.isfinite(numbers).all():
            rows[name] |= dict(zip(("stderr", "low", "high"), map(float, numbers), strict=True))
    return rows


def _show_held_out(table: "pd.DataFrame", job: Job, change: PairedDifference) -> None:
    """Print the error of each person or day before and after learning from the others, and the verdict."""
    singular, plural = job.groups.singular, job.groups.many
    title = f"\n{job.judged} [{job.unit}] of {plural} left out of the tuning, worst first"
    console.print(visible(title), style="italic")
    shown = table_of(singular, "recordings", "before", "after", "change")
    ordered = table.sort_values("error_after", ascending=False, kind="stable")
    for subject, row in ordered.head(MOST).iterrows():
        numbers = (significant(row[name]) for name in ("error_before", "error_after", "change"))
        shown.add_row(visible(str(subject)), f"{row['n']:.0f}", *numbers)
    if len(table) > MOST:
        shown.add_row(f"… and {len(table) - MOST} more", "", "", "", "")
    shown.add_section()
    for name, of in ((f"median of {plural}", np.nanmedian), ("worst", np.nanmax)):
        shown.add_row(name, "", significant(of(table["error_before"])), significant(of(table["error_after"])), "")
    console.print(shown)
    change_words = f"median change {significant(change.estimate)} {'points' if job.unit == '%' else job.unit}"
    sides = f"{change.better} better, {change.worse} worse"
    if change.n < ENOUGH:
        console.print(f"{change_words}; {sides} (a verdict needs {ENOUGH} {plural})", highlight=False)
        return
    verdict = "better" if change.high < 0.0 else "worse" if change.low > 0.0 else "no clear change"
    low, high = (resolved(end, change.high - change.low) for end in (change.low, change.high))
    ends = f"95 %: {low} to {high}, bootstrap over {plural}"
    console.print(f"{verdict}: {change_words} ({ends}); {sides}", highlight=False)


def _show_values(values: dict[str, dict[str, Any]]) -> None:
    """Print every learned number before and after, with its standard error."""
    console.print("\nlearned from all people", style="italic")
    shown = table_of("parameter", "unit", "before", "after", "standard error", "95 % interval", left=2)
    for name, row in values.items():
        width = math.nan if row["low"] is None else row["high"] - row["low"]
        ends = "–" if row["low"] is None else f"{resolved(row['low'], width)} … {resolved(row['high'], width)}"
        numbers = (significant(row["before"]), resolved(row["after"], width / 4.0, 4), significant(row["stderr"], 2))
        shown.add_row(name, row["unit"], *numbers, ends)
    console.print(shown)
