"""The table of all experiments in experiments/README.md, and its main lines in the README.

`make experiments` writes results/NAME.json; `make summary` takes the rows that have a line in the table out of these
files into experiments/results.json, which is versioned, and writes the table. Rows that no full run in the folder holds
stay as they were, and are named. `--check` writes nothing and prints whether the table agrees with the versioned rows.
"""

import argparse
import ast
import json
import math
import sys
from pathlib import Path
from typing import Any, NamedTuple

from experiments import EXPERIMENTS
from experiments.common.row import Row

HERE = Path(__file__).resolve().parents[1]
NUMBERS = HERE / "results.json"
PAGE = HERE / "README.md"
README = HERE.parent / "README.md"
DIGITS = 6  # kept of a number: more than the table shows, fewer than another machine's rounding changes
HEAD = ["", "paper", "simulation", "recordings", "n", "experiment"]
BARE = ("", "1", "ratio", "F1", "bool")
"""Units that the table does not print."""

BEGIN, END = "<!-- table: written by `make summary` -->", "<!-- end of the table -->"


class Headline(NamedTuple):
    """A row of the README's table. Numbers are named by their metrics.

    Attributes:
        quantity: what was measured, and by which sensors.
        errors: what a number is → its metric.
        worst: the metric of the largest error; "" where none is measured.
        guess: what a guess without sensors is → its metric.
        where: the kind of walk, after the number of cases.
    """

    quantity: str
    errors: dict[str, str]
    worst: str
    guess: dict[str, str]
    where: str


HEADLINES = (
    Headline(
        "hip and knee angles; sensors on thigh and shank",
        {"right hip": "default_whole_hip_deg_right", "left hip": "default_whole_hip_deg_left",
         "right knee": "default_whole_knee_deg_right", "left knee": "default_whole_knee_deg_left"},
        "", {}, "with a U-turn, beside motion capture; root mean squares",
    ),
    Headline(
        "stride length; a sensor on the shoe",
        {"mean": "foot_stride_mae_cm_pyshoe_vicon"}, "foot_stride_worst_cm_pyshoe_vicon", {},
        "from slow steps to running, beside motion capture",
    ),
    Headline(
        "walked distance; sensors on thigh and shank",
        {"median": "walking5m_loso_distance_median_pct", "mean": "walking5m_loso_distance_mae_pct"},
        "walking5m_loso_distance_worst_pct", {"mean": "leg_distance_pct_guess"}, "who walked 5 m",
    ),
    Headline(
        "walked distance; one sensor at the waist",
        {"median": "distance_median_pct_ipol_straight", "mean": "distance_mae_pct_ipol_straight"},
        "distance_worst_pct_ipol_straight",
        {"mean": "waist_distance_pct_guess", "worst": "waist_distance_worst_pct_guess"}, "on straight ways",
    ),
    Headline(
        "time of initial contacts; one sensor at the waist",
        {"mean": "waist_ic_mae_ms"}, "", {}, "of straight walks, checked by hand",
    ),
    Headline(
        "strides wrong by more than three stated standard deviations without a warning",
        {"share": "flags_missed_pct"}, "", {}, "of all public sets; shoe, shank or waist",
    ),
)  # fmt: skip
"""The rows of the README's table."""

Known = dict[str, dict[str, Any]]
"""Experiment → `version` of jgait, and `rows`: those with a line in the table."""


def load() -> Known:
    """The versioned rows."""
    return json.loads(NUMBERS.read_text(encoding="utf-8")) if NUMBERS.exists() else {}


def refreshed(known: Known, folder: Path) -> tuple[Known, list[str]]:
    """Known rows, with those of the full runs in a folder in their place; and remarks on rows that were kept."""
    result: Known = {}
    remarks = []
    for name in EXPERIMENTS:
        path = folder / f"{name}.json"
        run = json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
        before = known.get(name, {"version": None, "rows": []})
        if run is None or run["quick"]:
            remarks.append(f"{name}: as before; {path} " + ("is a quick run" if run else "is not there"))
            result[name] = before
            continue
        rows = [rounded(row) for row in run["rows"] if row["line"] and math.isfinite(row["value"])]
        measured = {row["metric"] for row in rows}
        kept = [row for row in before["rows"] if row["metric"] not in measured]
        if kept:
            metrics = ", ".join(row["metric"] for row in kept)
            remarks.append(f"{name}: as before, for the run has none of them: {metrics}")
        result[name] = {"version": run["version"], "rows": rows + kept}
    return {name: one for name, one in result.items() if one["rows"]}, remarks


def rounded(row: dict[str, Any]) -> dict[str, Any]:
    """A row with its value to `DIGITS` digits."""
    return {**row, "value": float(f"{row['value']:.{DIGITS}g}")}


def number(value: float) -> str:
    """Three digits, as in text."""
    text = f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:#.3g}".rstrip(".")
    return text.replace("-", "−").replace(",", " ")


def count(row: Row) -> str:
    """How many cases a number is made of."""
    return f"{row.n:,} {row.of}".replace(",", " ").strip()


def cell(rows: list[Row], paper: bool = False) -> str:
    """The numbers of a line in one column, each with what it is."""
    if paper:
        return ", ".join(dict.fromkeys(number(row.paper) for row in rows if row.paper is not None)) or "–"
    return "; ".join(f"{row.part} {number(row.value)}".strip() for row in rows) or "–"


def lines(name: str, rows: list[Row]) -> list[list[str]]:
    """The lines of an experiment: rows that name the same line and have the same unit stand together."""
    grouped: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        grouped.setdefault((row.line, row.unit), []).append(row)
    found = []
    for (line, unit), some in grouped.items():
        by = {data: [row for row in some if row.data == data] for data in ("simulation", "recordings")}
        counts = dict.fromkeys(count(row) for part in by.values() for row in part)
        label = line if unit in BARE else f"{line} [{unit}]"
        found.append([label, cell(some, paper=True), *map(cell, by.values()), "; ".join(counts), f"`{name}`"])
    return found


def table(known: Known) -> str:
    """The table in Markdown."""
    every = [line for name, one in known.items() for line in lines(name, [Row(**row) for row in one["rows"]])]
    return markdown([HEAD, ["---"] * len(HEAD), *every])


def headlines(known: Known) -> str:
    """The table of the README."""
    rows = {row["metric"]: Row(**row) for one in known.values() for row in one["rows"]}

    def numbers(metrics: dict[str, str]) -> str:
        return "; ".join(f"{part} {number(rows[metric].value)}" for part, metric in metrics.items()) or "–"

    found = [["error of", "usual", "worst", "a guess without sensors", "measured on"], ["---"] * 5]
    for one in HEADLINES:
        first = rows[next(iter(one.errors.values()))]
        worst = number(rows[one.worst].value) if one.worst else "–"
        cells = [numbers(one.errors), worst, numbers(one.guess), f"{count(first)} {one.where}"]
        found.append([f"{one.quantity} [{first.unit}]", *cells])
    return markdown(found)


def markdown(every: list[list[str]]) -> str:
    """A table."""
    return "\n".join(f"| {' | '.join(line)} |".replace("|  |", "| |") for line in every)


def replaced(readme: str, known: Known) -> str:
    """The README with the lines between its two marks."""
    before, begin, rest = readme.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"README.md has no {BEGIN} … {END} to write the table between")
    return f"{before}{BEGIN}\n\n{headlines(known)}\n\n{END}{after}"


def texts(known: Known) -> dict[Path, str]:
    """The files that hold the table, as they ought to be."""
    return {PAGE: page(known), README: replaced(README.read_text(encoding="utf-8"), known)}


def first_line(name: str) -> str:
    """The first sentence of an experiment's docstring."""
    home = HERE / EXPERIMENTS[name]
    source = (home / "__init__.py" if home.is_dir() else home.with_suffix(".py")).read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(source)) or "").split("\n\n")[0].replace("\n", " ")


def page(known: Known) -> str:
    """experiments/README.md."""
    each = "\n".join(f"- `{name}` in `{EXPERIMENTS[name]}`: {first_line(name)}" for name in EXPERIMENTS)
    versions = sorted({str(one["version"]) for one in known.values()})
    return f"""# Experiments

An experiment repeats what a paper reports, or judges a part of jgait, in simulation and on the public recordings that
are here. Each experiment has a folder; most files of a folder are a table or a figure of the paper.

    make experiments NAMES="leg_ekf foot_ins"               # in full, results/NAME.json; without NAMES: all
    .venv/bin/python -m experiments leg_ekf --quick         # one experiment, a first look
    .venv/bin/python -m experiments leg_ekf.table2 --quick  # one part of it

{each}

`make bench` runs the comparisons with other libraries (`benchmark`); their table is in `docs/benchmarks.md`.
`common` holds what experiments share: the row, recordings with their references, matching, and libraries with
environments of their own (`make peers`).

## What jgait reaches beside the papers

`make summary` writes this table from `results.json`, the rows of the last full runs (jgait {", ".join(versions)}). Each
row states its line, its unit, the paper's figure and its n. `docs/experiments.md` says what to know before trusting the
numbers.

{BEGIN}

{table(known)}
"""


def main(arguments: list[str] | None = None) -> int:
    """Write rows and table, or print whether the table is up to date."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--results", type=Path, default=Path("results"), metavar="FOLDER", help="of the experiments' JSON"
    )
    parser.add_argument("--check", action="store_true", help="write nothing; exit code 1 if the table is out of date")
    given = parser.parse_args(arguments)
    try:
        if given.check:
            old = [path.name for path, text in texts(load()).items() if path.read_text(encoding="utf-8") != text]
            print(f"out of date: {', '.join(old)}; make summary writes them" if old else "up to date")
            return bool(old)
        known, remarks = refreshed(load(), given.results)
        written = texts(known)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 1
    NUMBERS.write_text(json.dumps(known, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    for path, text in written.items():
        path.write_text(text, encoding="utf-8")
    print("\n".join([*remarks, f"written: {', '.join(path.name for path in (NUMBERS, *written))}"]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
