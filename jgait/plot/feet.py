"""Figures of feet: trajectories from above and from the side, and strides over time.

The right foot is black with dots, the left foot light blue with squares: they also differ in grey.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jgait.estimators import stride_flags
from jgait.estimators.columns import COLUMNS, Column
from jgait.evaluate.errors import common_samples, yaw_aligned
from jgait.io.strides import strides_to_dataframe
from jgait.plot.style import FOOT, FOOTHOLD, RED, Axes, Figure, Seconds, Style, legend, panels, windowed
from jgait.types import SIDES, Estimate, FootTrajectory, as_float

if TYPE_CHECKING:
    import pandas as pd

REFERENCE: dict[str, Style] = {
    "right": {"color": "#7b1d12", "linewidth": 1.0, "linestyle": (0, (5, 2))},
    "left": {"color": RED, "linewidth": 1.1, "linestyle": (0, (1, 1.4))},
}


def feet_of(estimate: Estimate) -> dict[str, FootTrajectory]:
    """Side → trajectory of each foot in the estimate. Raises ValueError if the estimate has no foot."""
    feet = {} if estimate.feet is None else {side: getattr(estimate.feet, side) for side in SIDES}
    feet = {side: foot for side, foot in feet.items() if foot is not None}
    if not feet:
        raise ValueError("the estimate has no feet; use an estimate of foot_ins or stride_width_ekf")
    return feet


def rows_of(estimate: Estimate) -> np.ndarray:
    """The valid strides in the order in which they end."""
    strides = estimate.strides
    if strides is None:
        raise ValueError("the estimate has no strides")
    rows = np.flatnonzero(np.asarray(strides.valid, bool))
    ends = as_float(strides.standing_end if strides.end is None else strides.end)
    return rows[np.argsort(ends[rows], kind="stable")]


def footholds(estimate: Estimate, side: str, seconds: Seconds = None) -> np.ndarray:
    """Times at which a foot stands on its footholds [s], within a window; empty if they are unknown."""
    if estimate.strides is None or estimate.strides.standing is None:
        return np.zeros(0)
    rows = [k for k in rows_of(estimate) if np.asarray(estimate.strides.side)[k] == SIDES.index(side)]
    # A long stance has a time of arrival and a time of leaving: the foothold is the position at leaving.
    first, last = as_float(estimate.strides.standing)[rows], as_float(estimate.strides.standing_end)[rows]
    times = np.concatenate([first, last[-1:]])
    return times[windowed(times, seconds)]


def places_at(estimate: Estimate, foot: FootTrajectory, times: np.ndarray) -> np.ndarray:
    """Positions (n, 3) [m] of a foot at given times [s]."""
    time = as_float(estimate.time)
    return np.stack([np.interp(times, time, axis) for axis in as_float(foot.position).T], axis=1)


def shown(estimate: Estimate, foot: FootTrajectory, seconds: Seconds = None) -> np.ndarray:
    """Positions (T, 3) [m], NaN outside the window and where the estimate is not valid."""
    visible = np.asarray(estimate.valid, bool) & windowed(estimate.time, seconds)
    return np.where(visible[:, None], as_float(foot.position), np.nan)


def foot_paths(estimate: Estimate, reference: Estimate | None = None, *, title: str = "") -> Figure:
    """Both feet from above, footholds marked; axes equal.

    Each foot of `foot_ins` has a separate world frame, with the origin at the foot's start and x along its first
    stride. Feet of the reference, right dashed, left dotted, are turned about the vertical and shifted to fit the
    estimate.

    Raises:
        ValueError: if the estimate has no feet.
    """
    feet = feet_of(estimate)
    ways = {side: shown(estimate, foot) for side, foot in feet.items()}
    figure, axes = panels(1, 1, 8.6, 1.3 + height_of(ways, 7.6))
    axis = axes[0, 0]
    for side, way in ways.items():
        axis.plot(way[:, 0], way[:, 1], label=f"{side} foot", **FOOT[side])
        holds = places_at(estimate, feet[side], footholds(estimate, side))
        axis.plot(holds[:, 0], holds[:, 1], **FOOTHOLD[side])
    for side in feet:
        known = None if reference is None else _fitted(reference, estimate, side)
        if known is not None:
            axis.plot(known[:, 0], known[:, 1], label=f"reference, {side}", **REFERENCE[side])
    plan_of(axis)
    legend(figure, title, columns=5)
    return figure


def height_of(ways: dict[str, np.ndarray], width: float) -> float:
    """Height of a plan of a given width with equal axes [inch], limited."""
    everything = np.concatenate(list(ways.values()))
    extent = np.nanmax(everything, axis=0) - np.nanmin(everything, axis=0) + 0.3
    return float(np.clip(width * extent[1] / extent[0], 1.5, 6.0))


def _fitted(reference: Estimate, estimate: Estimate, side: str) -> np.ndarray | None:
    """The reference's trajectory of one foot, turned about the vertical and shifted onto the estimate's; or None."""
    foot = None if reference.feet is None else getattr(reference.feet, side)
    if foot is None or estimate.feet is None:
        return None
    common = common_samples(estimate, reference)
    theirs = as_float(foot.position)[common]
    ours = places_at(estimate, getattr(estimate.feet, side), as_float(reference.time)[common])
    places = np.full((common.size, 3), np.nan)
    places[common] = yaw_aligned(theirs, ours)
    return places


def plan_of(axis: Axes) -> None:
    """Label the axes for a view from above."""
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.grid(alpha=0.3)


def foot_height(estimate: Estimate, *, title: str = "") -> Figure:
    """Each foot from the side: its height along its way, footholds marked; heights are drawn larger than lengths.

    Raises:
        ValueError: if the estimate has no feet.
    """
    feet = feet_of(estimate)
    figure, axes = panels(len(feet), 1, 8.6, 2.1 * len(feet) + 0.9, sharex=True)
    for axis, (side, foot) in zip(axes[:, 0], feet.items(), strict=True):
        way = shown(estimate, foot)
        steps = np.nan_to_num(np.linalg.norm(np.diff(way[:, :2], axis=0), axis=1))
        along = np.concatenate([[0.0], np.cumsum(steps)])
        axis.plot(along, 100.0 * way[:, 2], label=f"{side} foot", **FOOT[side])
        times = footholds(estimate, side)
        heights = 100.0 * places_at(estimate, foot, times)[:, 2]
        axis.plot(np.interp(times, as_float(estimate.time), along), heights, **FOOTHOLD[side])
        axis.set_ylabel("height [cm]")
    axes[-1, 0].set_xlabel("way of the foot, seen from above [m]")
    legend(figure, title, columns=5)
    return figure


def stride_series(estimate: Estimate, *, title: str = "") -> Figure:
    """Length, width and rise of every stride over time, with bars of two standard deviations where they are stated.

    Widths that the estimator does not trust (`diagnostics["width_valid"]`) are hollow and without bars; flags are marks
    around a stride.

    Raises:
        ValueError: if the estimate has no strides, or none of them is valid.
    """
    figure = _series(estimate, ("stride_length_m", "stride_width_m", "stride_height_m"), "foot", joined=False)
    legend(figure, title, columns=5)
    return figure


def leg_strides(estimate: Estimate, *, title: str = "") -> Figure:
    """Length, time, rise and turn of every stride over time, bars of two standard deviations, flags as marks.

    The estimate is of `ankle_stride`, or any with `strides`, with or without the flags of `SPECIAL`.

    Raises:
        ValueError: if the estimate has no strides, or none of them is valid.
    """
    figure = _series(
        estimate, ("stride_length_m", "stride_duration_s", "stride_height_m", "turn_deg"), "leg", joined=True
    )
    legend(figure, title)
    return figure


def _series(estimate: Estimate, columns: Sequence[str], part: str, *, joined: bool) -> Figure:
    """A figure with one row for each column of the table of strides that any stride has."""
    table = strides_to_dataframe(estimate)
    if not len(table):
        raise ValueError("no stride is valid: there is nothing to draw")
    present = [COLUMNS[name] for name in columns if name in table and table[name].notna().any()]
    figure, axes = panels(len(present), 1, 8.6, 1.9 * len(present) + 1.0, sharex=True)
    marked = special(estimate)
    for number, (axis, column) in enumerate(zip(axes[:, 0], present, strict=True)):
        series_of(axis, table, column, labelled=number == 0, part=part, joined=joined)
        axis.set_ylabel(column.heading)
        when, values = _when(table), column.scale * table[column.name]
        for name, flags in marked.items():
            if (there := flags & values.notna()).any():
                axis.plot(when[there], values[there], **RING, **SPECIAL[name])
        if joined:
            axis.margins(y=0.15)
            if column.quantity in ("stride_height", "turn"):
                axis.axhline(0.0, color="0.6", linewidth=0.8)
    axes[-1, 0].set_xlabel("time [s]")
    return figure


def series_of(
    axis: Axes, table: "pd.DataFrame", column: Column, *, labelled: bool, part: str = "foot", joined: bool = False
) -> None:
    """One column of the table of strides of both sides over time; strides without a value are left out. With `joined`,
    a line goes through the strides of a side, with a gap where they are 10 s or more apart: a pause.
    """
    for side in SIDES:
        rows = table[table["side"] == side]
        values, when = column.scale * rows[column.name], _when(rows)
        trusted = rows.get("width_valid", values.notna()) if column.quantity == "stride_width" else values.notna()
        bars = 2.0 * column.scale * rows[column.deviation].fillna(0.0) if column.deviation in rows else 0.0 * values
        if not len(rows):
            continue
        good, bad = values.notna() & trusted, values.notna() & ~trusted
        stated = bool(bars.any())
        axis.errorbar(when[good], values[good], yerr=bars[good] if stated else None,
                      label=f"{side} {part}{', ±2σ' if stated else ''}" if labelled else None,
                      **FOOTHOLD[side], elinewidth=1.0, ecolor=FOOT[side]["color"])  # fmt: skip
        hollow = {**FOOTHOLD[side], "markerfacecolor": "white"}
        axis.plot(when[bad], values[bad], label=f"{side} {part}, not trusted" if bad.any() else None, **hollow)
        if joined:
            gaps = np.flatnonzero(np.diff(when) >= 10.0) + 1
            times, heights = (np.insert(line.to_numpy(float), gaps, np.nan) for line in (when, values))
            axis.plot(times, heights, color=FOOT[side]["color"], linewidth=0.6, alpha=0.6)


RING: Style = {"linestyle": "none", "markerfacecolor": "none", "color": "black", "zorder": 4}
SPECIAL: dict[str, Style] = {
    flag.name: {"marker": marker, "markersize": size, "markeredgewidth": width, "label": flag.label}
    for flag, marker, size, width in (
        (stride_flags.TURNING, "D", 10, 1.0), (stride_flags.STAIRS, "^", 12, 1.0), (stride_flags.CLIPPED, "x", 9, 1.4),
        (stride_flags.HALF, "s", 8, 1.0), (stride_flags.UNEVEN_DURATION, "p", 13, 1.0),
        (stride_flags.UNSURE, "v", 12, 1.0), (stride_flags.SIDE_UNKNOWN, "o", 10, 1.0),
        (stride_flags.DOUBTFUL, "+", 13, 1.2),
    )
}  # fmt: skip
"""Flag of strides → the mark around a stride with this flag; marks differ in shape, not in colour."""


def special(estimate: Estimate) -> dict[str, np.ndarray]:
    """Flag of `SPECIAL` → (rows,) bool for the rows of the table of strides; only flags that a stride has."""
    marked = stride_flags.marks(estimate, stride_flags.STRIDE_FLAGS)
    return {name: flags for name, flags in marked.items() if name in SPECIAL and flags.any()}


def _when(table: "pd.DataFrame") -> "pd.Series":
    """Time at which each stride is drawn [s]: its end."""
    return table["end_s" if "end_s" in table else "standing_end_s"]
