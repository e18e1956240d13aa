"""Figures of sleeping sensors: error against energy saved, and error against duty cycle."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jgait.plot.style import DASHED, RED, Axes, Figure, Style, blank

PAPER: Style = {"color": "black", "linewidth": 1.6, "linestyle": DASHED, "marker": "s", "markersize": 5.0,
         "markerfacecolor": "white"}  # fmt: skip
FOUND: Style = {"color": RED, "linewidth": 2.4, "marker": "D", "markersize": 5.5}
POLICY: Style = {"color": "black", "linestyle": "none", "marker": "*", "markersize": 14.0, "markerfacecolor": "#f2c84b"}
SHADES = ("0.15", "0.45", "0.65")
MARKS = ("o", "^", "v", "P", "X", "<", ">", "d", "p", "h")
TICKS = (0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)


class Series(NamedTuple):
    """One line of a figure."""

    x: ArrayLike  #: (n,) duty cycle, or share of the energy saved [1].
    error: ArrayLike  #: (n,) root mean square error over the root mean square of the signal [1].
    role: str = "filler"  #: "filler", "paper", "found" (schedules found by gradient) or "policy" (single points).


def _style(series: Series, number: int) -> Style:
    special = {"paper": PAPER, "found": FOUND, "policy": POLICY}
    if series.role in special:
        return special[series.role]
    if series.role != "filler":
        raise ValueError(f"role must be 'filler', 'paper', 'found' or 'policy'; got {series.role!r}")
    return {"color": SHADES[number % len(SHADES)], "linewidth": 1.0, "marker": MARKS[number % len(MARKS)],
            "markersize": 4.5}  # fmt: skip


def _drawn(axis: Axes, lines: Mapping[str, Series]) -> None:
    """Draw every series over 100 x; series of the paper and those found by gradient are drawn on top."""
    number = 0
    for name, series in lines.items():
        x, error = (np.asarray(v, np.float64) for v in (series.x, series.error))
        if x.shape != error.shape or x.ndim != 1:
            raise ValueError(f"x and error of {name!r} must be (n,), both; got {x.shape} and {error.shape}")
        order = np.argsort(x)
        above = 2.0 if series.role == "filler" else 3.0
        axis.plot(100.0 * x[order], error[order], label=name, zorder=above, **_style(series, number))
        number += series.role == "filler"
    axis.set_yscale("log")
    axis.set_yticks(TICKS, [f"{tick:g}" for tick in TICKS])
    axis.set_yticks([], minor=True)
    every = np.concatenate([np.asarray(s.error, np.float64) for s in lines.values()])
    positive = every[np.isfinite(every) & (every > 0.0)]
    if len(positive):
        axis.set_ylim(0.85 * positive.min(), 1.15 * positive.max())
    axis.grid(alpha=0.3)


def error_over_duty(panels: Mapping[str, Mapping[str, Series]], *, title: str = "") -> Figure:
    """Error of each filler of gaps over the duty cycle of the gyroscope.

    Args:
        panels: title of the panel → name → series over the duty cycle [1].
        title: above the figure.

    Raises:
        ValueError: if there is no panel, or the arrays of a series have different lengths.
    """
    return _panels(panels, "time that the gyroscope measures [%]", None, title)


def error_over_saving(
    panels: Mapping[str, Mapping[str, Series]], *, power: float | None = None, title: str = ""
) -> Figure:
    """Error over the energy saved; points below and to the right are better.

    Args:
        panels: title of the panel → name → series over the share of the gyroscope's energy that is saved [1].
        power: power of the gyroscope while it is on [W]; adds its mean power as a second axis.
        title: above the figure.

    Raises:
        ValueError: as `error_over_duty`.
    """
    return _panels(panels, "energy of the gyroscope saved, wake-ups paid [%]", power, title)


def _panels(panels: Mapping[str, Mapping[str, Series]], label: str, power: float | None, title: str) -> Figure:
    if not panels or not all(panels.values()):
        raise ValueError("a figure needs a panel, and every panel a series; got none")
    figure, axes = blank(len(panels), 1, 8.2, 0.6 + 3.9 * len(panels))
    for axis, (name, lines) in zip(axes[:, 0], panels.items(), strict=True):
        _drawn(axis, lines)
        axis.set_xlabel(label)
        axis.set_ylabel("error over signal [1]")
        axis.set_title(name, fontsize=10, loc="left")
        axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=8, frameon=False, borderaxespad=0.0)
        if power is not None:
            _second(axis, power)
    if title:
        figure.suptitle(title)
    return figure


def _second(axis: Axes, power: float) -> None:
    def both_ways(value: ArrayLike) -> ArrayLike:
        return value

    above = axis.secondary_xaxis("top", functions=(both_ways, both_ways))
    ticks = np.arange(0.0, 101.0, 20.0)
    above.set_xticks(ticks, [f"{1e3 * power * (1.0 - tick / 100.0):.3g}" for tick in ticks])
    above.set_xlabel("mean power [mW]", fontsize=8)
    above.tick_params(labelsize=8)
