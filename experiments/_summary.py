"""One table of what jgait reaches beside the papers' figures, in experiments/README.md and the README.

`make experiments` writes results/NAME.json; `make summary` takes the numbers of the table (`_summary_lines.py`) out of
them into experiments/results.json, which is versioned, and writes the table from there into both files. Numbers of an
experiment that has no full run in the folder stay as they were, and are named. `--check` writes nothing and says
whether both files are what the versioned numbers give.
"""

import argparse
import ast
import json
import math
import string
import sys
from pathlib import Path
from typing import Any, NamedTuple, Self

from _summary_lines import LINES, Line

HERE = Path(__file__).parent
NUMBERS = HERE / "results.json"
SUMMARY = HERE / "README.md"
README = HERE.parent / "README.md"
BEGIN, END = "<!-- table: written by `make summary` -->", "<!-- end of the table -->"
DIGITS = 6  # kept of a number: more than the table shows, fewer than another machine's rounding changes
HEAD = ["", "paper's figure", "ours in simulation", "ours on real recordings", "n", "command"]

Known = dict[str, dict[str, Any]]
"""Experiment → its version, and its metrics: name → value, n, paper."""


def _spelled(number: float, form: str) -> str:
    return format(number, form).replace("-", "−").replace(",", " ")


class Count(int):
    """How many something is made of."""

    def __format__(self, form: str) -> str:
        return _spelled(int(self), form)


class Cell(NamedTuple):
    """A number of the table, as the cells' format strings see it."""

    value: float
    n: Count = Count(1)
    printed: float | None = None

    def __format__(self, form: str) -> str:
        return _spelled(self.value, form)

    @property
    def paper(self) -> Self:
        """The paper's figure."""
        if self.printed is None:
            raise ValueError("the paper gives no figure for this metric")
        return type(self)(self.printed)

    @property
    def cm(self) -> Self:
        """In centimetres, of metres."""
        return type(self)(100.0 * self.value)

    @property
    def pct(self) -> Self:
        """In per cent, of a ratio."""
        return type(self)(100.0 * self.value)

    @property
    def ms(self) -> Self:
        """In milliseconds, of seconds."""
        return type(self)(1000.0 * self.value)


class Chosen:
    """`least[a,b]`, `most[a,b]`: one of several metrics; `total[a,b]`: what they are made of together."""

    def __init__(self, what: str, cells: dict[str, Cell]) -> None:
        self.what, self.cells = what, cells

    def __getitem__(self, names: str) -> Cell | Count:
        cells = [self.cells[name] for name in names.split(",")]
        if self.what == "total":
            return Count(sum(cell.n for cell in cells))
        return (min if self.what == "least" else max)(cells, key=lambda cell: cell.value)


def metrics(line: Line) -> set[str]:
    """The metrics that a line shows."""
    found = set()
    for text in (line.paper, line.simulated, line.real, line.n):
        for _, field, _, _ in string.Formatter().parse(text):
            if field:
                name, _, rest = field.partition("[")
                found |= set(rest.rstrip("]").split(",")) if rest else {name.split(".")[0]}
    return found


def wanted() -> dict[str, set[str]]:
    """Experiment → the metrics that the table shows of it."""
    found: dict[str, set[str]] = {}
    for line in LINES:
        found.setdefault(line.experiment, set()).update(metrics(line))
    return found


def experiments() -> list[str]:
    """The scripts that `make experiments` runs."""
    names = sorted(path.stem for path in HERE.glob("*.py"))
    return [name for name in names if not name.startswith(("_", "common", "benchmark"))]


# --- the numbers ---


def refreshed(known: Known, folder: Path) -> tuple[Known, list[str]]:
    """Known numbers, with those of the full runs in a folder in their place.

    Args:
        known: the versioned numbers.
        folder: where `make experiments` wrote NAME.json.

    Returns:
        The numbers, of the metrics that the table shows and no others, and remarks on what was kept, and why.
    """
    result: Known = {}
    remarks = []
    for name, names in sorted(wanted().items()):
        before = known.get(name, {"version": None, "metrics": {}})
        path = folder / f"{name}.json"
        run = json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
        if run is None or run["quick"]:
            remarks.append(f"{name}: as before; {path} " + ("is a quick run" if run else "is not there"))
            result[name] = {**before, "metrics": {m: v for m, v in sorted(before["metrics"].items()) if m in names}}
            continue
        rows = {row["metric"]: row for row in run["rows"] if row["metric"] in names and math.isfinite(row["value"])}
        kept = sorted(m for m in names - set(rows) if m in before["metrics"])
        if kept:
            remarks.append(f"{name}: as before, for the run has none of them: {', '.join(kept)}")
        new = {m: {"value": rounded(r["value"]), "n": r["n"], "paper": r["paper"]} for m, r in rows.items()}
        result[name] = {
            "version": run["version"],
            "metrics": dict(sorted((new | {m: before["metrics"][m] for m in kept}).items())),
        }
    return result, remarks


def rounded(value: float) -> float:
    """To DIGITS digits."""
    return float(f"{value:.{DIGITS}g}")


def load() -> Known:
    """The versioned numbers."""
    return json.loads(NUMBERS.read_text(encoding="utf-8")) if NUMBERS.exists() else {}


# --- the table ---


def cells(line: Line, known: Known) -> list[str]:
    """A line's cells; ValueError names a metric that is not known, or that cannot be shown so."""
    rows = known.get(line.experiment, {"metrics": {}})["metrics"]
    numbers = {name: Cell(row["value"], Count(row["n"]), row["paper"]) for name, row in rows.items()}
    chosen = {what: Chosen(what, numbers) for what in ("least", "most", "total")}
    shown = []
    for text in (line.paper, line.simulated, line.real, line.n):
        try:
            shown.append(text.format_map({**numbers, **chosen}))
        except (KeyError, AttributeError, ValueError) as error:
            raise ValueError(f"{line.experiment}, {line.label!r}: {error} in {text!r}") from error
    return [line.label, *shown, f"`experiments/{line.experiment}.py`"]


def table(known: Known) -> str:
    """The table in Markdown."""
    lines = [HEAD, ["---"] * len(HEAD), *(cells(line, known) for line in LINES)]
    return "\n".join(f"| {' | '.join(line)} |".replace("|  |", "| |") for line in lines)


def first_line(name: str) -> str:
    """The first line of a script's docstring."""
    source = (HERE / f"{name}.py").read_text(encoding="utf-8")
    said = (ast.get_docstring(ast.parse(source)) or "").split("\n\n")[0].replace("\n", " ")
    return said if said.endswith((".", "?")) else f"{said}."


def page(known: Known) -> str:
    """experiments/README.md."""
    scripts = "\n".join(f"- `{name}.py`: {first_line(name)}" for name in experiments())
    versions = sorted({str(one["version"]) for one in known.values()})
    return f"""# Experiments

Each script reproduces what a paper reports, or judges a part of jgait, in simulation and on the public recordings that
are there, and writes its numbers as JSON:

    make experiments                                  # all of them, in full: results/NAME.json
    .venv/bin/python experiments/leg_ekf.py --quick   # one of them, a first look

{scripts}

`make bench` runs `benchmark_*.py`, beside other libraries; their table is in `docs/guide/own_filter.md`.

## What jgait reaches beside the papers

`make summary` writes this table, here and in the README, from the JSON of all experiments; the numbers of record are in
`results.json` (jgait {", ".join(versions)}). n counts simulation first, then recordings. What the rows say, and what to
know before trusting them, is in `docs/experiments.md`.

{table(known)}
"""


def replaced(readme: str, known: Known) -> str:
    """The README with the table between its two marks."""
    before, begin, rest = readme.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"README.md has no {BEGIN} … {END} to write the table between")
    return f"{before}{BEGIN}\n\n{table(known)}\n\n{END}{after}"


def stale(known: Known) -> list[str]:
    """The files that are not what the numbers give."""
    readme = README.read_text(encoding="utf-8")
    here = SUMMARY.read_text(encoding="utf-8") if SUMMARY.exists() else ""
    return [
        str(path.relative_to(HERE.parent))
        for path, text, ought in ((SUMMARY, here, page(known)), (README, readme, replaced(readme, known)))
        if text != ought
    ]


def main(arguments: list[str] | None = None) -> int:
    """Write the numbers and both tables, or say whether they are up to date."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--results", type=Path, default=Path("results"), metavar="FOLDER", help="of the experiments' JSON"
    )
    parser.add_argument("--check", action="store_true", help="write nothing; exit code 1 if a file is out of date")
    given = parser.parse_args(arguments)
    try:
        if given.check:
            old = stale(load())
            print(f"out of date: {', '.join(old)}; make summary writes them" if old else "up to date")
            return bool(old)
        known, remarks = refreshed(load(), given.results)
        readme = replaced(README.read_text(encoding="utf-8"), known)
        summary = page(known)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 1
    NUMBERS.write_text(json.dumps(known, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    SUMMARY.write_text(summary, encoding="utf-8")
    README.write_text(readme, encoding="utf-8")
    print("\n".join([*remarks, f"written: {', '.join(path.name for path in (NUMBERS, SUMMARY, README))}"]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
