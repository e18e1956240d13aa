"""Figures of two feet in one world frame: stride widths from above and over time, and distances between the feet."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import PyTree

from jgait.plot.feet import (
    feet_of,
    footholds,
    has,
    height_of,
    places_at,
    plan_of,
    rows_of,
    series_of,
    shown,
)
from jgait.plot.style import (
    BLUE,
    FOOT,
    FOOTHOLD,
    GROUND,
    RED,
    Axes,
    Figure,
    Seconds,
    Style,
    band,
    blank,
    legend,
    over_time,
    windowed,
)
from jgait.types import SIDES, Estimate, Recording, as_float

ACROSS: Style = {"color": RED, "linewidth": 0.9}
THROUGH: Style = {"color": "0.55", "linewidth": 0.8}
TOGETHER: Style = {
    "marker": "o",
    "markersize": 4.5,
    "linestyle": "none",
    "color": "black",
    "elinewidth": 1.2,
    "zorder": 3.0,
}
READ: Style = {"marker": "x", "markersize": 5.0, "linestyle": "none", "color": RED, "zorder": 2.5}
TRUE: Style = {
    "marker": "_",
    "markersize": 11.0,
    "markeredgewidth": 2.0,
    "linestyle": "none",
    "color": BLUE,
    "zorder": 2.0,
}
STRAIGHT = np.deg2rad(15.0)
"""[rad] Largest turn of a straight stride."""

FEWEST = 4
"""Smallest number of strides of both feet in a section."""

MOVING = 10
"""Number of strides in the moving standard deviation of the width."""


def two_feet(estimate: Estimate, *, sections: Sequence[tuple[float, float]] | None = None, title: str = "") -> Figure:
    """Both feet in one world frame with the widths of their strides: from above, in sections, and over time.

    A width is the line from a foothold to the line between the two footholds of the other foot. In the sections the
    walking direction points to the right, and lateral distances are drawn at a larger scale; their times from and to
    [s] are by default up to three of the longest straight parts. The width over time has bars of two standard
    deviations; below it is its standard deviation over the last ten strides.

    Raises:
        ValueError: if the estimate lacks a foot or has no width; estimates of `stride_width_ekf` have both.
    """
    feet = feet_of(estimate)
    if len(feet) < 2:
        raise ValueError(f"two_feet needs both feet; the estimate has the {next(iter(feet))} one alone")
    rows = rows_of(estimate)
    if not has(estimate, "width", rows):
        raise ValueError("no stride of the estimate has a width; stride_width_ekf gives them")
    widths = _width_lines(estimate, rows)
    sections = _straight(estimate, rows) if sections is None else sections
    ways = {side: shown(estimate, foot, None) for side, foot in feet.items()}
    heights = (height_of(ways, 8.2), 2.1, 1.9, 1.1)
    figure, _ = blank(1, 1, 9.2, sum(heights) + 2.6)
    figure.clear()
    grid = figure.add_gridspec(4, len(sections), height_ratios=heights)
    above, over_time = figure.add_subplot(grid[0, :]), figure.add_subplot(grid[2, :])
    moving = figure.add_subplot(grid[3, :], sharex=over_time)
    _draw(above, estimate, widths, None)
    plan_of(above)
    for number, part in enumerate(sections):
        axis = figure.add_subplot(grid[1, number])
        _draw(axis, estimate, widths, part)
        axis.set_title(f"{part[0]:.0f} to {part[1]:.0f} s", fontsize=9)
        axis.set_xlabel("along [m]")
        axis.grid(alpha=0.3)
        if number == 0:
            axis.set_ylabel("across [m]")
    series_of(over_time, estimate, rows, "width", 100.0, labelled=False)
    over_time.set_ylabel("stride width [cm]")
    over_time.tick_params(labelbottom=False)
    _moving(moving, estimate, rows)
    moving.set_xlabel("time [s]")
    legend(figure, title, columns=5)
    return figure


def _straight(estimate: Estimate, rows: np.ndarray) -> list[tuple[float, float]]:
    """From and to [s] of the longest parts without a turning stride, in order of time; the whole walk if none."""
    strides = estimate.strides
    first, last = as_float(strides.standing)[rows], as_float(strides.standing_end)[rows]
    turn = np.zeros(rows.size) if strides.turn is None else np.nan_to_num(as_float(strides.turn)[rows])
    groups = itertools.groupby(range(rows.size), key=lambda k: bool(abs(turn[k]) < STRAIGHT))
    runs = [list(members) for straight, members in groups if straight]
    spans = [(float(first[run].min()), float(last[run].max())) for run in runs if len(run) >= FEWEST]
    longest = sorted(spans, key=lambda span: span[0] - span[1])[:3]
    return sorted(longest) or [(float(first.min()), float(last.max()))]


def _width_lines(estimate: Estimate, rows: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """For each stride with a width its middle [s], and the line (2, 2) [m] that shows the width."""
    feet, strides = feet_of(estimate), estimate.strides
    lines = []
    for k in rows:
        side = SIDES[int(np.asarray(strides.side)[k])]
        other = "left" if side == "right" else "right"
        first, last = float(strides.standing[k]), float(strides.standing_end[k])
        between = [time for time in footholds(estimate, other) if first < time < last]
        if not np.isfinite(strides.width[k]) or not between:
            continue
        a, b = places_at(estimate, feet[side], np.array([first, last]))[:, :2]
        there = places_at(estimate, feet[other], np.array(between[:1]))[0, :2]
        way = (b - a) / max(float(np.hypot(*(b - a))), 1e-9)
        lines.append((0.5 * (first + last), np.stack([there, a + way * (way @ (there - a))])))
    return lines


def _draw(axis: Axes, estimate: Estimate, widths: list[tuple[float, np.ndarray]], part: Seconds) -> None:
    """Draw feet, footholds and widths from above; a section is rotated so that it leads to the right from 0."""
    feet = feet_of(estimate)
    ways = {side: shown(estimate, foot, part)[:, :2] for side, foot in feet.items()}
    origin, turn = np.zeros(2), np.eye(2)
    if part is not None:
        visible = ways["right"][np.isfinite(ways["right"][:, 0])]
        if not visible.size:
            return
        origin, way = 0.5 * (visible[0] + ways["left"][np.isfinite(ways["left"][:, 0])][0]), visible[-1] - visible[0]
        c, s = way / max(float(np.hypot(*way)), 1e-9)
        turn = np.array([[c, s], [-s, c]])
    for side, way in ways.items():
        x, y = turn @ (way - origin).T
        axis.plot(x, y, label=f"{side} foot" if part is None else None, **FOOT[side])
        holds = places_at(estimate, feet[side], footholds(estimate, side, part))[:, :2]
        axis.plot(*(turn @ (holds - origin).T), **FOOTHOLD[side])
    named = "width" if part is None else None
    for time, line in widths:
        if part is None or part[0] <= time <= part[1]:
            axis.plot(*(turn @ (line - origin).T), label=named, **ACROSS)
            named = None


def _moving(axis: Axes, estimate: Estimate, rows: np.ndarray) -> None:
    """Draw the standard deviation of the width over the last strides."""
    width = 100.0 * as_float(estimate.strides.width)[rows]
    there = np.isfinite(width)
    when, width = as_float(estimate.strides.end)[rows][there], width[there]
    last = [width[max(0, k + 1 - MOVING) : k + 1] for k in range(width.size)]
    spread = [float(np.std(widths, ddof=1)) if widths.size == MOVING else np.nan for widths in last]
    axis.plot(when, spread, color="0.3", linewidth=1.2)
    axis.set_ylabel(f"SD of {MOVING} [cm]")
    axis.set_ylim(bottom=0.0)
    axis.grid(alpha=0.3)


def feet_apart(
    estimate: Estimate,
    recording: Recording | None = None,
    *,
    reference: Estimate | None = None,
    range_offset: float = 0.08,
    seconds: Seconds = None,
    title: str = "",
) -> Figure:
    """The distances z₁ and z₂ between the feet, across and along the left foot's heading, and the feet's σ.

    Dots with bars are at double support, where the paper evaluates both; the line contains every instant at which a
    foot stands or a range is measured. The diagnostics of the estimate, of `stride_width_ekf`, have both distances;
    those of a reference are drawn at the same double supports, the measured ranges of a recording with `range_offset`
    [m] added. The window `seconds` is from and to [s]. The standard deviation of each foot's position is, with
    `stride_width_ekf.estimate`, since the last stance, with `estimate_from_feet` in the common world frame.

    Raises:
        ValueError: if the estimate lacks a foot, or has no distances between the feet.
    """
    feet = feet_of(estimate)
    if len(feet) < 2 or not {"z1", "z2"} <= estimate.diagnostics.keys():
        raise ValueError("the estimate has no z1 and z2 between two feet; use an estimate of stride_width_ekf")
    time, visible, diagnostics = _moments(estimate, seconds)
    if not visible.any():
        raise ValueError(f"there is no moment in the window; got seconds = {seconds}")
    spread = estimate.feet_stddev
    stated = spread is not None and all(getattr(spread, side) is not None for side in SIDES)
    figure, axes = blank(2 + stated, 1, 8.8, 5.2 + 1.7 * stated, sharex=True)
    for axis, (name, unit) in zip(axes[:2, 0], (("z1", "across, z₁ [cm]"), ("z2", "along, z₂ [cm]")), strict=True):
        _distance(axis, estimate, name, time, visible)
        if reference is not None:
            known = _moments(reference, None)
            when = time[visible & _flags(diagnostics, "double_support", time)]
            axis.plot(when, 100.0 * np.interp(when, known[0], as_float(known[2][name])), label="reference", **TRUE)
        axis.set_ylabel(unit)
    if recording is not None and recording.feet_range is not None:
        read = recording.feet_range
        there = np.asarray(read.mask, bool) & (as_float(read.time) >= time[visible][0])
        there &= as_float(read.time) <= time[visible][-1]
        values = 100.0 * (as_float(read.distance)[there] + range_offset)
        axes[0, 0].plot(as_float(read.time)[there], values, label="range read, with its offset", **READ)
    if stated:
        _places(axes[2, 0], estimate, seconds)
    over_time(axes[:, 0])
    legend(figure, title)
    return figure


def _moments(estimate: Estimate, seconds: Seconds) -> tuple[np.ndarray, np.ndarray, dict[str, PyTree]]:
    """Times [s] of z₁ and z₂, which of these lie in the window, and the diagnostics."""
    diagnostics = estimate.diagnostics
    at_samples = "moment_time" not in diagnostics
    time = as_float(estimate.time if at_samples else diagnostics["moment_time"])
    visible = np.asarray(estimate.valid, bool) if at_samples else np.ones(time.size, bool)
    visible = visible & np.isfinite(as_float(diagnostics["z1"])) & np.isfinite(as_float(diagnostics["z2"]))
    return time, visible & windowed(time, seconds), diagnostics


def _flags(diagnostics: dict[str, Any], name: str, like: np.ndarray) -> np.ndarray:
    return np.asarray(diagnostics.get(name, np.zeros(like.size, bool)), bool)


def _distance(axis: Axes, estimate: Estimate, name: str, time: np.ndarray, visible: np.ndarray) -> None:
    """Draw z₁ or z₂: a line through every instant with a band, dots at double support, turns shaded."""
    diagnostics = estimate.diagnostics
    values, spread = 100.0 * as_float(diagnostics[name]), 100.0 * as_float(diagnostics[f"{name}_stddev"])
    band(axis, time[visible], values[visible], spread[visible], color="0.87", zorder=0.5)
    axis.plot(time[visible], values[visible], label="every moment", **THROUGH)
    both = visible & _flags(diagnostics, "double_support", time)
    axis.errorbar(time[both], values[both], yerr=2.0 * spread[both], label="double support, ±2σ", **TOGETHER)
    turns = np.flatnonzero(visible & _flags(diagnostics, "turning", time))
    for run in np.split(turns, np.flatnonzero(np.diff(turns) > 1) + 1) if turns.size else ():
        axis.axvspan(
            time[run[0]], time[min(run[-1] + 1, time.size - 1)], label="a foot turns", color="#f3e3b5", **GROUND
        )


def _places(axis: Axes, estimate: Estimate, seconds: Seconds) -> None:
    """Draw the standard deviation of each foot's horizontal position."""
    time, visible = as_float(estimate.time), np.asarray(estimate.valid, bool) & windowed(estimate.time, seconds)
    for side in SIDES:
        deviation = as_float(getattr(estimate.feet_stddev, side).position)[:, :2]
        axis.plot(time[visible], 100.0 * np.hypot(*deviation[visible].T), label=f"{side} foot", **FOOT[side])
    since = "\nsince it last stood" if "moment_time" in estimate.diagnostics else ""
    axis.set_ylabel(f"σ of place{since} [cm]")
    axis.set_ylim(bottom=0.0)
