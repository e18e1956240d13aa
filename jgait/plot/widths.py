"""A figure of two feet in one world frame: stride widths from above, in sections, and over time."""

import itertools

import numpy as np

from jgait.estimators.columns import COLUMNS
from jgait.io.strides import strides_to_dataframe
from jgait.plot.feet import feet_of, footholds, height_of, places_at, plan_of, rows_of, series_of, shown
from jgait.plot.style import FOOT, FOOTHOLD, RED, Axes, Figure, Seconds, Style, legend, panels
from jgait.types import SIDES, Estimate, as_float

ACROSS: Style = {"color": RED, "linewidth": 0.9}


def two_feet(estimate: Estimate, *, title: str = "") -> Figure:
    """Both feet in one world frame with the widths of their strides: from above, in sections, and over time.

    A width is the line from a foothold to the line between the two footholds of the other foot. In the sections the
    walking direction points to the right, and lateral distances are drawn at a larger scale; they are up to three
    of the longest straight parts. The width over time has bars of two standard
    deviations; below it is its standard deviation over the last ten strides.

    Raises:
        ValueError: if the estimate lacks a foot or has no width; estimates of `stride_width_ekf` have both.
    """
    feet = feet_of(estimate)
    if len(feet) < 2:
        raise ValueError(f"two_feet needs both feet; the estimate has the {next(iter(feet))} one alone")
    rows = rows_of(estimate)
    if not np.isfinite(as_float(estimate.strides.width)[rows]).any():
        raise ValueError("no stride of the estimate has a width; stride_width_ekf gives them")
    widths = _width_lines(estimate, rows)
    sections = _straight(estimate, rows)
    ways = {side: shown(estimate, foot) for side, foot in feet.items()}
    heights = (height_of(ways, 8.2), 2.1, 1.9, 1.1)
    figure, axes = panels(4, 1, 9.2, sum(heights) + 2.9, height_ratios=heights)
    above, whole, over_time, moving = axes[:, 0]
    grid = whole.get_subplotspec().subgridspec(1, len(sections))
    whole.remove()
    moving.sharex(over_time)
    _draw(above, estimate, widths, None)
    plan_of(above)
    for number, part in enumerate(sections):
        axis = figure.add_subplot(grid[number])
        _draw(axis, estimate, widths, part)
        axis.set_title(f"{part[0]:.0f} to {part[1]:.0f} s", fontsize=9)
        axis.set_xlabel("along [m]")
        axis.grid(alpha=0.3)
        if number == 0:
            axis.set_ylabel("across [m]")
    series_of(over_time, strides_to_dataframe(estimate), COLUMNS["stride_width_m"], labelled=False)
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
    groups = itertools.groupby(range(rows.size), key=lambda k: bool(abs(turn[k]) < np.deg2rad(15.0)))
    runs = [list(members) for straight, members in groups if straight]
    spans = [(float(first[run].min()), float(last[run].max())) for run in runs if len(run) >= 4]
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
    width = 100.0 * as_float(estimate.strides.width)[rows]
    there = np.isfinite(width)
    when, width = as_float(estimate.strides.end)[rows][there], width[there]
    last = [width[max(0, k - 9) : k + 1] for k in range(width.size)]
    spread = [float(np.std(widths, ddof=1)) if widths.size == 10 else np.nan for widths in last]
    axis.plot(when, spread, color="0.3", linewidth=1.2)
    axis.set_ylabel("SD of 10 [cm]")
    axis.set_ylim(bottom=0.0)
