"""The record of one measured number, and how rows are printed and written.

A row states everything that the table of all experiments needs: its line, its part in that line, its unit, the
paper's figure, and what n counts. `make summary` reads nothing else.
"""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

from rich.console import Console
from rich.markup import escape
from rich.table import Table

import jgait


class Row(NamedTuple):
    """One measured number.

    Attributes:
        metric: its name, stable over time.
        value: the number.
        unit: of the number.
        paper: the paper's figure, or None where the paper gives none.
        n: how many walks, subjects or strides the number is made of.
        split: what the number was judged on, and what the tuning used.
        line: the line of the table of all experiments that shows the number; "" if the table does not show it.
        part: what the number is within its line ("worst", "left"); "" for the line's main number.
        data: the column of the table: "simulation" or "recordings".
        of: what n counts ("strides").
    """

    metric: str
    value: float
    unit: str
    paper: float | None = None
    n: int = 1
    split: str = "untuned"
    line: str = ""
    part: str = ""
    data: Literal["simulation", "recordings"] = "recordings"
    of: str = ""

    def on(self, line: str, part: str = "", of: str = "", *, simulated: bool = False) -> "Row":
        """The row in a line of the table of all experiments."""
        return self._replace(line=line, part=part, of=of, data="simulation" if simulated else "recordings")


def show(title: str, columns: Sequence[str], lines: Sequence[Sequence[Any]]) -> None:
    """Print a table; floats with three digits."""
    table = Table(title=escape(title), title_justify="left")
    for number, name in enumerate(columns):
        table.add_column(escape(name), justify="left" if number == 0 else "right")
    for line in lines:
        table.add_row(*(f"{cell:.3g}" if isinstance(cell, float) else str(cell) for cell in line))
    Console(width=max(120, Console().width)).print(table)


def finished(name: str, rows: Sequence[Row]) -> None:
    """Print all rows of an experiment."""
    show(
        f"{name}: all numbers",
        ["metric", "value", "unit", "paper", "n", "judged on"],
        [[r.metric, r.value, r.unit, "–" if r.paper is None else r.paper, r.n, r.split] for r in rows],
    )


def result(name: str, quick: bool, rows: Sequence[Row]) -> dict[str, Any]:
    """The rows as results/NAME.json holds them."""
    return {"experiment": name, "version": jgait.__version__, "quick": quick, "rows": [row._asdict() for row in rows]}
