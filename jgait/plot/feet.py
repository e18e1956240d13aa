"""Figures of feet: trajectories from above and from the side, and strides over time.

The right foot is black with dots, the left foot light blue with squares: they also differ in grey.
"""

from collections.abc import Sequence

import numpy as np

from jgait.estimators import stride_flags
from jgait.estimators.columns import COLUMNS
from jgait.estimators.stride_flags import STRIDE_COLUMNS
from jgait.evaluate.errors import common_samples, yaw_aligned
from jgait.plot.style import FOOT, FOOTHOLD, RED, Axes, Figure, Seconds, Style, legend, panels, windowed
from jgait.types import SIDES, Estimate, FootTrajectory, as_float

REFERENCE: dict[str, Style] = {
    "right": {"color": "#7b1d12", "linewidth": 1.0, "linestyle": (0, (5, 2))},
    "left": {"color": RED, "linewidth": 1.1, "linestyle": (0, (1, 1.4))},
}
SERIES = ("stride_length_m", "stride_width_m", "stride_height_m")
PANELS = ("stride_length_m", "stride_duration_s", "stride_height_m", "turn_deg")
"""Columns of the table of strides that `stride_series` and `leg_strides` draw."""


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
    return rows[np.argsort(_when(estimate)[rows], kind="stable")]


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
    figure, _ = _series(estimate, SERIES, "foot")
    legend(figure, title, columns=5)
    return figure


def _series(estimate: Estimate, columns: Sequence[str], part: str) -> tuple[Figure, list[tuple[Axes, str, float]]]:
    """A figure with one row for each column that any stride has; its axes with field and scale."""
    rows = rows_of(estimate)
    if not rows.size:
        raise ValueError("no stride is valid: there is nothing to draw")
    every = [(STRIDE_COLUMNS[name][0] or "duration", COLUMNS[name], STRIDE_COLUMNS[name][1]) for name in columns]
    present = [one for one in every if has(estimate, one[0], rows)]
    figure, axes = panels(len(present), 1, 8.6, 1.9 * len(present) + 1.0, sharex=True)
    drawn = []
    for number, (axis, (field, column, scale)) in enumerate(zip(axes[:, 0], present, strict=True)):
        drawn.append((axis, field, scale * column.scale))
        series_of(axis, estimate, rows, field, scale * column.scale, labelled=number == 0, part=part)
        axis.set_ylabel(column.heading)
        _marks(axis, estimate, rows, field, scale * column.scale)
    axes[-1, 0].set_xlabel("time [s]")
    return figure, drawn


def values_of(estimate: Estimate, field: str) -> np.ndarray:
    """(strides,) a field of `Strides`, or the duration as in the table; NaN where the estimate lacks the value."""
    strides = estimate.strides
    if field == "duration" and strides.start is not None and strides.end is not None:
        return stride_flags.durations(strides)
    values = getattr(strides, field, None)
    return np.full(np.shape(strides.side), np.nan) if values is None else as_float(values)


def has(estimate: Estimate, field: str, rows: np.ndarray) -> bool:
    """Whether any of the strides has a value of the field."""
    return bool(np.isfinite(values_of(estimate, field)[rows]).any())


def series_of(
    axis: Axes, estimate: Estimate, rows: np.ndarray, field: str, scale: float, *, labelled: bool, part: str = "foot"
) -> None:
    """One quantity of the strides of both sides over time; rows without a value are left out."""
    strides, stated = estimate.strides, estimate.strides_stddev
    when = _when(estimate)
    values = scale * values_of(estimate, field)
    spread = None if stated is None or field == "duration" else getattr(stated, field)
    bars = np.zeros_like(values) if spread is None else np.nan_to_num(2.0 * scale * as_float(spread))
    trusted = np.ones(values.size, bool)
    flags = estimate.diagnostics.get("width_valid")
    if field == "width" and flags is not None and np.shape(flags) == values.shape:
        trusted = np.asarray(flags, bool)
    for side in SIDES:
        of_side = rows[np.asarray(strides.side)[rows] == SIDES.index(side)]
        if not of_side.size:
            continue
        good, bad = of_side[trusted[of_side]], of_side[~trusted[of_side] & np.isfinite(values[of_side])]
        style = {**FOOTHOLD[side], "elinewidth": 1.0, "ecolor": FOOT[side]["color"]}
        axis.errorbar(when[good], values[good], yerr=bars[good] if bars.any() else None,
                      label=f"{side} {part}{', ±2σ' if bars.any() else ''}" if labelled else None, **style)  # fmt: skip
        hollow = {**FOOTHOLD[side], "markerfacecolor": "white"}
        axis.plot(when[bad], values[bad], label=f"{side} {part}, not trusted" if bad.size else None, **hollow)


APART_S = 10.0
"""[s] Least time between the ends of two strides of a side that no line joins: a pause, not a missed stride."""

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


def leg_strides(estimate: Estimate, *, title: str = "") -> Figure:
    """Length, time, rise and turn of every stride over time, bars of two standard deviations, flags as marks.

    The estimate is of `ankle_stride`, or any with `strides`, with or without the flags of `SPECIAL`.

    Raises:
        ValueError: if the estimate has no strides, or none of them is valid.
    """
    figure, drawn = _series(estimate, PANELS, "leg")
    rows = rows_of(estimate)
    for axis, field, scale in drawn:
        if field in ("height", "turn"):
            axis.axhline(0.0, color="0.6", linewidth=0.8)
        _joined(axis, estimate, rows, field, scale)
        axis.margins(y=0.15)
    legend(figure, title)
    return figure


def _joined(axis: Axes, estimate: Estimate, rows: np.ndarray, field: str, scale: float) -> None:
    """Draw a line through the strides of each side, with a gap where they are `APART_S` or more apart."""
    when, values = as_float(estimate.strides.end), values_of(estimate, field)
    for number, side in enumerate(SIDES):
        of_side = rows[np.asarray(estimate.strides.side)[rows] == number]
        gaps = np.flatnonzero(np.diff(when[of_side]) >= APART_S) + 1
        times, heights = (np.insert(line, gaps, np.nan) for line in (when[of_side], scale * values[of_side]))
        axis.plot(times, heights, color=FOOT[side]["color"], linewidth=0.6, alpha=0.6)


def _marks(axis: Axes, estimate: Estimate, rows: np.ndarray, field: str, scale: float) -> None:
    """Draw a mark around every flagged stride; the legend lists only flags that occur."""
    when, values = _when(estimate), values_of(estimate, field)
    for name, flags in special(estimate).items():
        marked = rows[flags[rows] & np.isfinite(values[rows])]
        if marked.size:
            axis.plot(when[marked], scale * values[marked], **RING, **SPECIAL[name])


def special(estimate: Estimate) -> dict[str, np.ndarray]:
    """Flag of `SPECIAL` → (strides,) bool, as in the table of strides; only flags that a valid stride has."""
    valid = np.asarray(estimate.strides.valid, bool)
    read = {flag.name: flag.read(estimate) for flag in stride_flags.STRIDE_FLAGS if flag.name in SPECIAL}
    marked = {name: np.asarray(flags, bool) & valid for name, flags in read.items() if flags is not None}
    return {name: flags for name, flags in marked.items() if flags.any()}


def _when(estimate: Estimate) -> np.ndarray:
    """(strides,) time at which each stride is drawn [s]: its end."""
    strides = estimate.strides
    return as_float(strides.standing_end if strides.end is None else strides.end)
