"""The output of `jgait tune`: printed tables and written files."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jgait import evaluate, io, plot
from jgait.commands.console import count, note, say, show, write_json, wrote
from jgait.commands.folder import ResultsFolder
from jgait.commands.tune_run import Job, TuningResults
from jgait.evaluate import PairedDifference
from jgait.io.write import in_cells
from jgait.notes import resolved
from jgait.plot import cohort as plot_cohort
from jgait.plot import tuning as plot_tuning
from jgait.report.made import flat
from jgait.report.page import significant
from jgait.tune.identifiability import OFF

if TYPE_CHECKING:
    import pandas as pd

PLANNED = ("tuned.json", "training.png", "held_out.csv", "before_after.png")
"""Names of the files that the command may write."""

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
    out, fit, left = folder.stage, results.fit, results.validation
    values = _values(job, results)
    spreads = {name: row["stderr"] for name, row in values.items() if row["stderr"] is not None}
    known = results.known
    undetermined = [] if known is None else known.undetermined
    doubts = {"not_learned": list(fit.not_learned), "not_determined": undetermined}
    held_out, change = None, None
    files = [plot.save(plot_tuning.training(fit, title=title), out / "training.png")]
    if left is not None:
        medians = {name: float(left.table[f"error_{name}"].median()) for name in ("before", "after")}
        held_out = {
            "error": job.error.words,
            "unit": job.error.unit,
            "n": len(left.table),
            **medians,
        }  # of people, or of days
        change = _held_out(job, left.items, out, files)
    origin = how | doubts | {"held_out": held_out}
    tuned = io.write_params(out / "tuned.json", fit.params, estimator=job.pipeline.name, stderr=spreads, made=origin)
    files = folder.publish([tuned, *files])
    people, taken = count(how["people"], "person", "people"), count(fit.losses.size, "step", "steps")
    recordings = count(len(job.made.names), "recording", "recordings")
    say(f"{title}: {recordings} of {people}, {taken} of at most {how['steps']}")
    if left is not None and change is not None:
        _show_held_out(left.table, job, change)
    _show_values(values)
    if results.errors is not None:
        before, after = map(significant, results.errors)
        losses = (significant(value, 4) for value in (fit.losses[0], fit.best_loss))
        error_text = f"{job.error.words} [{job.error.unit}] of the recordings learned from, median: "
        say(f"{error_text}{before} before, {after} after; loss {' before, '.join(losses)} after")
    for line in [] if known is None else known.sentences:
        say(f"· {line}")
    if undetermined:
        note(
            f"not determined: {', '.join(undetermined)}; the value may be far off. Leave it out of --free, or learn "
            "from a loss or recordings that depend on it"
        )
    elif known is not None and known.decrement > OFF:
        note("more --steps, or other --starts, may reach the optimum more closely")
    for line in results.left_out:
        note(line)
    wrote(files)
    write_json(json_file, {
        **how, **doubts, "steps_taken": fit.losses.size, "values": values,
        "held_out": None if change is None else change._asdict() | {"unit": job.error.unit},
        "losses": [float(v) for v in fit.losses], "failures": dict(failures), "files": list(map(str, files)),
    })  # fmt: skip
    if held_out is not None and left is not None:
        each = json.loads(left.table.reset_index().to_json(orient="records"))
        origin["held_out"] = held_out | {"each": each}
    return TuningOutcome(origin, spreads, change)


def _held_out(job: Job, items: "pd.DataFrame", out: Path, files: list[Path]) -> PairedDifference:
    """Write the errors of the recordings left out, and draw them; returns their change."""
    items = items.assign(recording=job.made.names)
    days = {"day": items["subject"]} if job.groups.singular == "day" else {}
    table = items.assign(subject=job.made.subjects, **days)
    columns = ["recording", "subject", *days, "fold", "error_before", "error_after"]
    in_cells(table[columns]).to_csv(out / "held_out.csv", index=False)
    rows = items[np.isfinite(items[["error_before", "error_after"]]).all(axis=1)]
    drawn = plot_cohort.before_after(
        rows, unit=job.error.unit, name=job.error.words,
        title=f"each {job.groups.singular} judged by parameters learned from other {job.groups.many}",
    )  # fmt: skip
    files += [out / "held_out.csv", plot.save(drawn, out / "before_after.png")]
    return evaluate.paired_difference(rows["error_before"], rows["error_after"], rows["subject"], seed=0)


def _values(job: Job, results: TuningResults) -> dict[str, dict[str, Any]]:
    """Every learned number: unit, value before and after; standard error and ends of its 95 % interval, or None."""
    units, known = io.units(job.start), results.known
    free, before, after = (flat(params) for params in (results.fit.free, job.start, results.fit.params))
    ends = ("stderr", "low", "high")
    rows = {
        name: {"unit": units[name], "before": before[name], "after": after[name], **dict.fromkeys(ends)}
        for name in after if name in free
    }  # fmt: skip
    for name, *numbers in () if known is None else zip(known.names, known.stderr, known.low, known.high, strict=True):
        if np.isfinite(numbers).all():
            rows[name] |= dict(zip(ends, map(float, numbers), strict=True))
    return rows


def _show_held_out(table: "pd.DataFrame", job: Job, change: PairedDifference) -> None:
    """Print the error of each person or day before and after learning from the others, and the verdict."""
    singular, plural = job.groups.singular, job.groups.many
    ordered = table.sort_values("error_after", ascending=False, kind="stable")
    errors = ["error_before", "error_after", "change"]
    rows = [(subject, f"{row['n']:.0f}", *map(significant, row[errors]))
            for subject, row in ordered.head(30).iterrows()]  # fmt: skip
    rows += [(f"… and {len(table) - 30} more",)] if len(table) > 30 else []
    every = ((f"median of {plural}", np.nanmedian), ("worst", np.nanmax))
    below = [(name, "", *(significant(of(table[error])) for error in errors[:2])) for name, of in every]
    title = f"{job.error.words} [{job.error.unit}] of {plural} left out of the tuning, worst first"
    show(singular, "recordings", "before", "after", "change", rows=rows, below=below, title=title)
    change_words = (
        f"median change {significant(change.estimate)} {'points' if job.error.unit == '%' else job.error.unit}"
    )
    sides = f"{change.better} better, {change.worse} worse"
    if change.n < ENOUGH:
        say(f"{change_words}; {sides} (a verdict needs {ENOUGH} {plural})")
        return
    verdict = "better" if change.high < 0.0 else "worse" if change.low > 0.0 else "no clear change"
    low, high = (resolved(end, change.high - change.low) for end in (change.low, change.high))
    say(f"{verdict}: {change_words} (95 %: {low} to {high}, bootstrap over {plural}); {sides}")


def _show_values(values: dict[str, dict[str, Any]]) -> None:
    """Print every learned number before and after, with its standard error."""
    rows = []
    for name, row in values.items():
        width = math.nan if row["low"] is None else row["high"] - row["low"]
        ends = "–" if row["low"] is None else f"{resolved(row['low'], width)} … {resolved(row['high'], width)}"
        numbers = (significant(row["before"]), resolved(row["after"], width / 4.0, 4), significant(row["stderr"], 2))
        rows.append((name, row["unit"], *numbers, ends))
    headings = ("parameter", "unit", "before", "after", "standard error", "95 % interval")
    show(*headings, rows=rows, left=2, title="learned from all people")
