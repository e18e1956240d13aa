"""Figures of feet: trajectories from above and from the side, and widths of strides.

The right foot is black with dots, the left foot light blue with squares: they also differ in grey.
"""

import itertools
from typing import TYPE_CHECKING

import numpy as np

from jgait.estimators.columns import COLUMNS
from jgait.geometry.matching import aligned_error, common_samples
from jgait.io.strides import strides_to_dataframe
from jgait.plot.legs import series_of
from jgait.plot.style import FOOT, FOOTHOLD, RED, Axes, Figure, Seconds, Style, legend, panels, single, windowed
from jgait.types import SIDES, Estimate, FootTrajectory, as_float

if TYPE_CHECKING:
    pass


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
    """Both feet from above, footholds marked; axes equal. Each foot of `foot_ins` has a world frame of its own, with x
    along its first stride; the reference, dashed or dotted, is turned and shifted to fit. Raises ValueError without
    feet.
    """
    feet = feet_of(estimate)
    ways = {side: shown(estimate, foot) for side, foot in feet.items()}
    figure, axis = single(8.6, 1.3 + height_of(ways, 7.6))
    for side, way in ways.items():
        axis.plot(way[:, 0], way[:, 1], label=f"{side} foot", **FOOT[side])
        holds = places_at(estimate, feet[side], footholds(estimate, side))
        axis.plot(holds[:, 0], holds[:, 1], **FOOTHOLD[side])
    for side, foot in feet.items():
        known = None if reference is None or reference.feet is None else getattr(reference.feet, side)
        if reference is not None and known is not None:
            common = common_samples(estimate, reference)
            ours = places_at(estimate, foot, as_float(reference.time)[common])
            fitted = np.full((common.size, 3), np.nan)
            fitted[common] = ours + aligned_error(as_float(known.position)[common], ours, np.ones(len(ours), bool))
            style: Style = (
                {"color": "#7b1d12", "dashes": (5, 2)} if side == "right" else {"color": RED, "dashes": (1, 1.4)}
            )
            axis.plot(fitted[:, 0], fitted[:, 1], label=f"reference, {side}", linewidth=1.0, **style)
    plan_of(axis)
    legend(figure, title, columns=5)
    return figure


def height_of(ways: dict[str, np.ndarray], width: float) -> float:
    """Height of a plan of a given width with equal axes [inch], limited."""
    everything = np.concatenate(list(ways.values()))
    extent = np.nanmax(everything, axis=0) - np.nanmin(everything, axis=0) + 0.3
    return float(np.clip(width * extent[1] / extent[0], 1.5, 6.0))


def plan_of(axis: Axes) -> None:
    """Label the axes for a view from above."""
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.grid(alpha=0.3)


def foot_height(estimate: Estimate, *, title: str = "") -> Figure:
    """Each foot from the side, footholds marked; heights are drawn larger. Raises ValueError if the estimate has no
    feet.
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


def two_feet(estimate: Estimate, *, title: str = "") -> Figure:
    """Both feet in one world frame with the widths of their strides: from above, in sections, and over time.

    A width is the line from a foothold to the line between the two footholds of the other foot. Sections are the
    longest straight parts, with lateral distances at a larger scale. The width over time has bars of two standard
    deviations; below it is its standard deviation over ten strides. Raises ValueError if the estimate lacks a foot or
    has no width.
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
            axis.plot(*(turn @ (line - origin).T), label=named, color=RED, linewidth=0.9)
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
