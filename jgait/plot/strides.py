"""The picture of a leg's strides: how long, how quick, rising and turning, and what is special about each."""

from typing import Any

import numpy as np

from jgait.estimators import stride_flags
from jgait.plot.feet import FOOT, HOLD, legend, rows_of
from jgait.plot.walk import blank
from jgait.types import SIDES, Estimate, as_float

DEGREES = 180.0 / np.pi
PANELS = (
    ("length", "stride length [m]", 1.0),
    ("duration", "stride time [s]", 1.0),
    ("height", "rise [cm]", 100.0),
    ("turn", "turn [°]", DEGREES),
)
"""Field of `Strides` (the duration is end − start), what the axis says, and what its SI unit is multiplied by."""

RING = {"linestyle": "none", "markerfacecolor": "none", "color": "black", "zorder": 4}
SPECIAL = {
    "turning": {"marker": "D", "markersize": 10, "markeredgewidth": 1.0, "label": stride_flags.TURNING.label},
    "stairs": {"marker": "^", "markersize": 12, "markeredgewidth": 1.0, "label": stride_flags.STAIRS.label},
    "clipped": {"marker": "x", "markersize": 9, "markeredgewidth": 1.4, "label": stride_flags.CLIPPED.label},
    "half": {"marker": "s", "markersize": 8, "markeredgewidth": 1.0, "label": stride_flags.HALF.label},
}
"""Flag in the diagnostics → the mark around a stride that has it; told apart by form, not colour."""


def leg_strides(estimate: Estimate, *, title: str = "") -> Any:
    """Length, time, rise and turn of every stride over time, bars of two standard deviations, flags as marks.

    Args:
        estimate: of `ankle_stride`, or any with `strides` whose `diagnostics` has the flags of `SPECIAL` or none.
        title: above the figure.

    Returns:
        A matplotlib figure.

    Raises:
        ValueError: if the estimate has no strides, or none of them is valid.
    """
    rows = rows_of(estimate)
    if not rows.size:
        raise ValueError("no stride is valid: there is nothing to draw")
    told = [panel for panel in PANELS if _told(estimate, panel[0], rows)]
    figure, axes = blank(len(told), 1, 8.6, 1.9 * len(told) + 1.1, sharex=True)
    for number, (axis, (field, unit, scale)) in enumerate(zip(axes[:, 0], told, strict=True)):
        if field in ("height", "turn"):
            axis.axhline(0.0, color="0.6", linewidth=0.8)
        _series(axis, estimate, rows, field, scale, labelled=number == 0)
        _marks(axis, estimate, rows, field, scale, labelled=number == 0)
        axis.set_ylabel(unit)
        axis.grid(alpha=0.3)
        axis.margins(y=0.15)
    axes[-1, 0].set_xlabel("time [s]")
    legend(figure, title)
    return figure


def _values(estimate: Estimate, field: str) -> np.ndarray | None:
    strides = estimate.strides
    if field == "duration":
        return as_float(strides.end) - as_float(strides.start)
    values = getattr(strides, field)
    return None if values is None else as_float(values)


def _told(estimate: Estimate, field: str, rows: np.ndarray) -> bool:
    values = _values(estimate, field)
    return values is not None and bool(np.isfinite(values[rows]).any())


def _series(axis: Any, estimate: Estimate, rows: np.ndarray, field: str, scale: float, *, labelled: bool) -> None:
    """The strides of both legs, joined by a thin line, with bars where deviations are stated."""
    when, values = as_float(estimate.strides.end), _values(estimate, field)
    stated = None if estimate.strides_stddev is None or field == "duration" else estimate.strides_stddev
    spread = None if stated is None else getattr(stated, field)
    for number, side in enumerate(SIDES):
        own = rows[np.asarray(estimate.strides.side)[rows] == number]
        if not own.size or values is None:
            continue
        bars = None if spread is None else 2.0 * scale * np.nan_to_num(as_float(spread)[own])
        words = f"{side} leg{', ±2σ' if spread is not None else ''}" if labelled else None
        axis.plot(when[own], scale * values[own], color=FOOT[side]["color"], linewidth=0.6, alpha=0.6)
        style = {**HOLD[side], "elinewidth": 1.0, "ecolor": FOOT[side]["color"]}
        axis.errorbar(when[own], scale * values[own], yerr=bars, label=words, **style)


def _marks(axis: Any, estimate: Estimate, rows: np.ndarray, field: str, scale: float, *, labelled: bool) -> None:
    """A mark around every stride that is special, in the legend only if there is one."""
    when, values = as_float(estimate.strides.end), _values(estimate, field)
    for name, style in SPECIAL.items():
        flags = estimate.diagnostics.get(name)
        if flags is None or values is None or np.shape(flags) != when.shape:
            continue
        own = rows[np.asarray(flags, bool)[rows]]
        if own.size:
            shown = style if labelled else {**style, "label": None}
            axis.plot(when[own], scale * values[own], **RING, **shown)
