"""Figures of what moves a number, and of what set-ups of a study would give."""

from typing import TYPE_CHECKING

from jgait.estimators.columns import QUANTITIES
from jgait.plot.style import BLUE, RED, Figure, single

if TYPE_CHECKING:
    import pandas as pd

    from jgait.tune import Explanation


def explanation(explained: "Explanation", *, title: str = "") -> Figure:
    """Bars of the effects of each assumption on a number, the largest first; see `jgait.tune.explain`."""
    rows = [a for a in explained.assumptions if a.share >= 5e-4][:10]
    figure, axis = single(6.5, 0.9 + 0.3 * max(len(rows), 1))
    factor, unit = explained.small
    effects = [factor * abs(a.effect) for a in rows]
    bars = axis.barh([a.words for a in rows], effects, color=BLUE, edgecolor="black", linewidth=0.6)
    axis.bar_label(bars, [f"{100.0 * a.share:.0f} %" for a in rows], padding=3)
    axis.invert_yaxis()
    axis.margins(x=0.15)
    axis.set_xlabel(f"standard deviation of {explained.column.words} [{unit}]")
    axis.set_title(title or explained.sentence.partition(":")[0], fontsize="medium")
    return figure


def study(table: "pd.DataFrame", measure: str, *, within: float | None = None, title: str = "") -> Figure:
    """Expected error of each set-up that has one, the smallest first, and its bias.

    The table is of `jgait.evaluate.study.plan` for the measure, with a column `name`; `within`, the largest error that
    is wanted, in the unit of the table, is drawn as a line.
    """
    rows, column = table[table["walks"] > 0].sort_values("expected"), QUANTITIES[measure]
    factor, unit = (100.0, "cm") if column.unit == "m" else (1.0, column.shown)
    figure, axis = single(6.5, 1.3 + 0.26 * max(len(rows), 1))
    axis.barh(
        rows["name"], factor * rows["expected"], xerr=factor * rows["expected_sd"], color=BLUE, edgecolor="black",
        linewidth=0.6, capsize=3, label="expected, ± its standard deviation",
    )  # fmt: skip
    axis.plot(factor * rows["bias"].abs(), rows["name"], "k|", markersize=9, markeredgewidth=2, label="|bias|")
    if within is not None:
        axis.axvline(factor * within, color=RED, linestyle="--", label="wanted")
    axis.invert_yaxis()
    figure.legend(loc="outside lower center", ncols=3)
    axis.set_xlabel(f"error of {column.words} [{unit}]")
    axis.set_title(title, fontsize="medium")
    return figure
