"""What all experiments share: their command line, and the form of their results.

Every experiment runs as `python experiments/NAME.py [--quick] [--json FILE]`, prints its tables and writes
`{"experiment": NAME, "version": VERSION OF JGAIT, "quick": BOOL, "rows": [{metric, value, unit, paper, n, split}]}`.
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
from rich.console import Console
from rich.table import Table

import jgait


class Row(NamedTuple):
    """One measured number.

    Attributes:
        metric: its name, stable over time.
        value: the number.
        unit: of the number.
        paper: the paper's figure, or None where it gives none.
        n: how many walks, subjects or strides it is made of.
        split: what it was judged on, and what the tuning saw.
    """

    metric: str
    value: float
    unit: str
    paper: float | None = None
    n: int = 1
    split: str = "untuned"


def show(title: str, columns: list[str], lines: list[list[Any]]) -> None:
    """Print a table; floats with three digits."""
    table = Table(title=title, title_justify="left")
    for number, name in enumerate(columns):
        table.add_column(name, justify="left" if number == 0 else "right")
    for line in lines:
        table.add_row(*(f"{cell:.3g}" if isinstance(cell, float) else str(cell) for cell in line))
    Console(width=max(120, Console().width)).print(table)


def main(name: str, description: str, experiment: Callable[[bool], list[Row]]) -> None:
    """Run an experiment from the command line.

    Args:
        name: of the experiment, as in its file's name.
        description: first line of the help.
        experiment: takes `quick`, returns rows.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--quick", action="store_true", help="a small version that only shows that it runs")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers here")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    rows = experiment(arguments.quick)
    show(
        f"{name}: all numbers",
        ["metric", "value", "unit", "paper", "n", "judged on"],
        [[r.metric, r.value, r.unit, "–" if r.paper is None else r.paper, r.n, r.split] for r in rows],
    )
    if arguments.json is not None:
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        result = {
            "experiment": name,
            "version": jgait.__version__,
            "quick": arguments.quick,
            "rows": [r._asdict() for r in rows],
        }
        arguments.json.write_text(json.dumps(result, indent=1) + "\n")
