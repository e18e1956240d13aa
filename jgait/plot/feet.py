"""Pictures of where feet went: from above, from the side, stride by stride, and how far apart.

The right foot is black with dots, the left one light blue with squares: told apart in grey by lightness and shape.
Each function returns the matplotlib figure. `jgait.plot` has all of them.
"""

from typing import Any

import numpy as np

from jgait.evaluate.errors import common_samples, yaw_aligned
from jgait.plot.walk import blank
from jgait.types import SIDES, Estimate, FootTrajectory, as_float

FOOT = {
    "right": {"color": "black", "linewidth": 1.1},
    "left": {"color": "#6fb1e0", "linewidth": 1.6},
}
HOLD = {
    "right": {"marker": "o", "color": "black", "markersize": 4.0, "linestyle": "none"},
    "left": {"marker": "s", "color": "#6fb1e0", "markersize": 4.5, "markeredgecolor": "#2b6a99", "linestyle": "none"},
}
REFERENCE = {
    "right": {"color": "#7b1d12", "linewidth": 1.0, "linestyle": (0, (5, 2))},
    "left": {"color": "#c0392b", "linewidth": 1.1, "linestyle": (0, (1, 1.4))},
}
SERIES = (("length", "length [m]", 1.0), ("width", "width [cm]", 100.0), ("height", "rise [cm]", 100.0))


def feet_of(estimate: Estimate) -> dict[str, FootTrajectory]:
    """Side → trajectory of each foot that was measured.

    Raises:
        ValueError: if none was.
    """
    found = {} if estimate.feet is None else {side: getattr(estimate.feet, side) for side in SIDES}
    found = {side: foot for side, foot in found.items() if foot is not None}
    if not found:
        raise ValueError("the estimate says nothing of feet; foot_ins and stride_width_ekf do")
    return found


def rows_of(estimate: Estimate) -> np.ndarray:
    """The valid strides in the order in which they end."""
    strides = estimate.strides
    if strides is None:
        raise ValueError("the estimate says nothing of strides")
    rows = np.flatnonzero(np.asarray(strides.valid, bool))
    last = strides.standing_end if strides.end is None else strides.end
    return rows[np.argsort(as_float(last)[rows], kind="stable")]


def footholds(estimate: Estimate, side: str) -> np.ndarray:
    """Times at which a foot stands on its footholds [s]; none if nothing is known of them."""
    if estimate.strides is None or estimate.strides.standing is None:
        return np.zeros(0)
    rows = [k for k in rows_of(estimate) if np.asarray(estimate.strides.side)[k] == SIDES.index(side)]
    # A foot that stands for long is seen to arrive and to leave: it is where it is seen to leave from.
    first, last = as_float(estimate.strides.standing)[rows], as_float(estimate.strides.standing_end)[rows]
    return np.concatenate([first, last[-1:]])


def places_at(estimate: Estimate, foot: FootTrajectory, times: np.ndarray) -> np.ndarray:
    """Places (n, 3) [m] of a foot at some times [s]."""
    time = as_float(estimate.time)
    return np.stack([np.interp(times, time, axis) for axis in as_float(foot.position).T], axis=1)


def shown(estimate: Estimate, foot: FootTrajectory, seconds: tuple[float, float] | None) -> np.ndarray:
    """Places (T, 3) with gaps where nothing is known, or outside the time asked for."""
    time = as_float(estimate.time)
    seen = np.asarray(estimate.valid, bool)
    if seconds is not None:
        seen = seen & (time >= seconds[0]) & (time <= seconds[1])
    return np.where(seen[:, None], as_float(foot.position), np.nan)


def inside(times: np.ndarray, seconds: tuple[float, float] | None) -> np.ndarray:
    """The times that lie between two [s]."""
    return times if seconds is None else times[(times >= seconds[0]) & (times <= seconds[1])]


def foot_paths(
    estimate: Estimate,
    reference: Estimate | None = None,
    *,
    seconds: tuple[float, float] | None = None,
    title: str = "",
    label: str = "",
    reference_label: str = "reference",
) -> Any:
    """Both feet from above, footholds marked; axes equal.

    Args:
        estimate: with `feet`; of `foot_ins` each foot is in a world of its own, which begins where the foot does and
            has x along its first stride.
        reference: with `feet`, right dashed, left dotted; each foot is turned about the vertical and shifted to
            fit the estimate.
        seconds: from and to [s].
        title: above the figure.
        label: before the names of the feet.
        reference_label: name of the reference.

    Returns:
        A matplotlib figure.

    Raises:
        ValueError: if the estimate says nothing of feet.
    """
    feet = feet_of(estimate)
    ways = {side: shown(estimate, foot, seconds) for side, foot in feet.items()}
    figure, axes = blank(1, 1, 8.6, 1.3 + height_of(ways, 7.6))
    axis = axes[0, 0]
    for side, way in ways.items():
        axis.plot(way[:, 0], way[:, 1], label=f"{label} {side} foot".strip(), **FOOT[side])
        holds = places_at(estimate, feet[side], inside(footholds(estimate, side), seconds))
        axis.plot(holds[:, 0], holds[:, 1], **HOLD[side])
    for side in feet:
        known = None if reference is None else _fitted(reference, estimate, side)
        if known is not None:
            axis.plot(known[:, 0], known[:, 1], label=f"{reference_label}, {side}", **REFERENCE[side])
    plan_of(axis)
    legend(figure, title)
    return figure


def height_of(ways: dict[str, np.ndarray], width: float) -> float:
    """How high a plan of some width is with equal axes [inch], within reason."""
    everything = np.concatenate(list(ways.values()))
    extent = np.nanmax(everything, axis=0) - np.nanmin(everything, axis=0) + 0.3
    return float(np.clip(width * extent[1] / extent[0], 1.5, 6.0))


def _fitted(reference: Estimate, estimate: Estimate, side: str) -> np.ndarray | None:
    """The reference's places of one foot turned about the vertical and shifted onto the estimate's; None if none."""
    foot = None if reference.feet is None else getattr(reference.feet, side)
    if foot is None or estimate.feet is None:
        return None
    common = common_samples(estimate, reference)
    theirs = as_float(foot.position)[common]
    ours = places_at(estimate, getattr(estimate.feet, side), as_float(reference.time)[common])
    places = np.full((common.size, 3), np.nan)
    places[common] = yaw_aligned(theirs, ours)
    return places


def plan_of(axis: Any) -> None:
    """Make axes those of a view from above."""
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.grid(alpha=0.3)


def legend(figure: Any, title: str) -> None:
    """One legend for all axes, below them, and the title above."""
    figure.legend(loc="outside lower center", ncols=5, fontsize=8, frameon=False)
    figure.align_ylabels()
    if title:
        figure.suptitle(title, fontsize=11)


def foot_height(
    estimate: Estimate, *, seconds: tuple[float, float] | None = None, title: str = "", label: str = ""
) -> Any:
    """Each foot from the side: its height along its way, footholds marked; heights are drawn larger than lengths.

    Args:
        estimate: with `feet`.
        seconds: from and to [s].
        title: above the figure.
        label: before the names of the feet.

    Returns:
        A matplotlib figure.

    Raises:
        ValueError: if the estimate says nothing of feet.
    """
    feet = feet_of(estimate)
    figure, axes = blank(len(feet), 1, 8.6, 2.1 * len(feet) + 0.9, sharex=True)
    for axis, (side, foot) in zip(axes[:, 0], feet.items(), strict=True):
        way = shown(estimate, foot, seconds)
        steps = np.nan_to_num(np.linalg.norm(np.diff(way[:, :2], axis=0), axis=1))
        along = np.concatenate([[0.0], np.cumsum(steps)])
        axis.plot(along, 100.0 * way[:, 2], label=f"{label} {side} foot".strip(), **FOOT[side])
        times = inside(footholds(estimate, side), seconds)
        heights = 100.0 * places_at(estimate, foot, times)[:, 2]
        axis.plot(np.interp(times, as_float(estimate.time), along), heights, **HOLD[side])
        axis.set_ylabel("height [cm]")
        axis.grid(alpha=0.3)
    axes[-1, 0].set_xlabel("way of the foot, seen from above [m]")
    legend(figure, title)
    return figure


def stride_series(estimate: Estimate, *, title: str = "") -> Any:
    """Length, width and rise of every stride over time, with bars of two standard deviations where they are stated.

    Widths that the estimator does not trust (`diagnostics["width_valid"]`) are hollow and without bars.

    Args:
        estimate: with `strides`.
        title: above the figure.

    Returns:
        A matplotlib figure.

    Raises:
        ValueError: if the estimate has no strides, or none of them is valid.
    """
    rows = rows_of(estimate)
    if not rows.size:
        raise ValueError("no stride is valid: there is nothing to draw")
    told = [one for one in SERIES if any_finite(getattr(estimate.strides, one[0]), rows)]
    figure, axes = blank(len(told), 1, 8.6, 1.9 * len(told) + 1.0, sharex=True)
    for number, (axis, (field, unit, scale)) in enumerate(zip(axes[:, 0], told, strict=True)):
        series_of(axis, estimate, rows, field, scale, labelled=number == 0)
        axis.set_ylabel(unit)
    axes[-1, 0].set_xlabel("time [s]")
    legend(figure, title)
    return figure


def any_finite(values: Any, rows: np.ndarray) -> bool:
    """Whether anything is told of some strides."""
    return values is not None and bool(np.isfinite(as_float(values)[rows]).any())


def series_of(axis: Any, estimate: Estimate, rows: np.ndarray, field: str, scale: float, *, labelled: bool) -> None:
    """One quantity of the strides of both feet over time."""
    strides, stated = estimate.strides, estimate.strides_stddev
    when = as_float(strides.standing_end if strides.end is None else strides.end)
    values = scale * as_float(getattr(strides, field))
    spread = None if stated is None else getattr(stated, field)
    bars = np.zeros_like(values) if spread is None else np.nan_to_num(2.0 * scale * as_float(spread))
    trusted = np.ones(values.size, bool)
    flags = estimate.diagnostics.get("width_valid")
    if field == "width" and flags is not None and np.shape(flags) == values.shape:
        trusted = np.asarray(flags, bool)
    for side in SIDES:
        own = rows[np.asarray(strides.side)[rows] == SIDES.index(side)]
        if not own.size:
            continue
        good, bad = own[trusted[own]], own[~trusted[own]]
        style = {**HOLD[side], "elinewidth": 1.0, "ecolor": FOOT[side]["color"]}
        axis.errorbar(when[good], values[good], yerr=bars[good] if bars.any() else None,
                      label=f"{side} foot{', ±2σ' if bars.any() else ''}" if labelled else None, **style)  # fmt: skip
        hollow = {**HOLD[side], "markerfacecolor": "white"}
        axis.plot(when[bad], values[bad], label=f"{side} foot, not trusted" if bad.size else None, **hollow)
    axis.grid(alpha=0.3)
