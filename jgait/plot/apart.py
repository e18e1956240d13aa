"""The picture of how far two feet are apart, across and along, and how sure that and their places are.

`jgait.plot` has the function; it returns the matplotlib figure.
"""

from typing import Any

import numpy as np

from jgait.plot.feet import FOOT, feet_of
from jgait.plot.waist import legend_once
from jgait.plot.walk import blank
from jgait.types import SIDES, Estimate, Recording, as_float

THROUGH = {"color": "0.55", "linewidth": 0.8}
BAND = {"color": "0.87", "linewidth": 0.0, "zorder": 0.5}
TOGETHER = {"marker": "o", "markersize": 4.5, "linestyle": "none", "color": "black", "elinewidth": 1.2, "zorder": 3.0}
READ = {"marker": "x", "markersize": 5.0, "linestyle": "none", "color": "#c0392b", "zorder": 2.5}
TRUE = {
    "marker": "_",
    "markersize": 11.0,
    "markeredgewidth": 2.0,
    "linestyle": "none",
    "color": "#6fb1e0",
    "zorder": 2.0,
}
TURN = {"color": "#f3e3b5", "linewidth": 0.0, "zorder": 0.0}
PANELS = (("z1", "across, z₁ [cm]"), ("z2", "along, z₂ [cm]"))


def feet_apart(
    estimate: Estimate,
    recording: Recording | None = None,
    *,
    reference: Estimate | None = None,
    range_offset: float = 0.08,
    seconds: tuple[float, float] | None = None,
    title: str = "",
) -> Any:
    """The distances z₁ and z₂ between the feet, across and along the left foot's heading, and where feet are, ±2σ.

    Dots with bars are double support, at which the paper judges both; the line goes through every moment at which a
    foot stood or a range was read.

    Args:
        estimate: of `stride_width_ekf` or `two_feet`: its diagnostics have `z1`, `z2` and their deviations.
        recording: draws the ranges that were read, with their offset.
        reference: whose diagnostics have `z1` and `z2`, drawn at the estimate's double supports.
        range_offset: from what the range sensor reads to z₁ [m].
        seconds: from and to [s]; None: everything.
        title: above the figure.

    Returns:
        A matplotlib figure: z₁, z₂, and where the estimate states it the standard deviation of each foot's place: of
        `stride_width_ekf.estimate` since the foot last stood, of `estimate_from_feet` and `two_feet` in the one world.

    Raises:
        ValueError: if the estimate lacks a foot, or says nothing of the distances.
    """
    feet = feet_of(estimate)
    if len(feet) < 2 or not {"z1", "z2"} <= estimate.diagnostics.keys():
        raise ValueError("the estimate says nothing of z1 and z2 between two feet; stride_width_ekf and two_feet do")
    time, seen, told = _moments(estimate, seconds)
    if not seen.any():
        raise ValueError(f"there is no moment between the times asked for; got seconds = {seconds}")
    spread = estimate.feet_stddev
    stated = spread is not None and all(getattr(spread, side) is not None for side in SIDES)
    figure, axes = blank(2 + stated, 1, 8.8, 5.2 + 1.7 * stated, sharex=True)
    for axis, (name, unit) in zip(axes[:2, 0], PANELS, strict=True):
        _distance(axis, estimate, name, time, seen)
        if reference is not None:
            known = _moments(reference, None)
            when = time[seen & _flags(told, "double_support", time)]
            axis.plot(when, 100.0 * np.interp(when, known[0], as_float(known[2][name])), label="reference", **TRUE)
        axis.set_ylabel(unit)
    if recording is not None and recording.feet_range is not None:
        read = recording.feet_range
        there = np.asarray(read.mask, bool) & (as_float(read.time) >= time[seen][0])
        there &= as_float(read.time) <= time[seen][-1]
        values = 100.0 * (as_float(read.distance)[there] + range_offset)
        axes[0, 0].plot(as_float(read.time)[there], values, label="range read, with its offset", **READ)
    if stated:
        _places(axes[2, 0], estimate, seconds)
    for axis in axes[:, 0]:
        axis.grid(alpha=0.3)
    axes[-1, 0].set_xlabel("time [s]")
    figure.align_ylabels()
    legend_once(figure, axes[:, 0], title)
    return figure


def _moments(estimate: Estimate, seconds: tuple[float, float] | None) -> tuple[np.ndarray, np.ndarray, dict[str, Any]]:
    """Times at which z₁ and z₂ are told [s], which of them are to be seen, and what is told."""
    told = estimate.diagnostics
    own = "moment_time" not in told
    time = as_float(estimate.time if own else told["moment_time"])
    seen = np.asarray(estimate.valid, bool) if own else np.ones(time.size, bool)
    seen = seen & np.isfinite(as_float(told["z1"])) & np.isfinite(as_float(told["z2"]))
    return time, seen if seconds is None else seen & (time >= seconds[0]) & (time <= seconds[1]), told


def _flags(told: dict[str, Any], name: str, like: np.ndarray) -> np.ndarray:
    return np.asarray(told.get(name, np.zeros(like.size, bool)), bool)


def _distance(axis: Any, estimate: Estimate, name: str, time: np.ndarray, seen: np.ndarray) -> None:
    """One of both distances: a line through every moment with a band, dots at double support, turns shaded."""
    told = estimate.diagnostics
    values, spread = 100.0 * as_float(told[name]), 200.0 * as_float(told[f"{name}_stddev"])
    axis.fill_between(time[seen], (values - spread)[seen], (values + spread)[seen], label="±2σ", **BAND)
    axis.plot(time[seen], values[seen], label="every moment", **THROUGH)
    both = seen & _flags(told, "double_support", time)
    axis.errorbar(time[both], values[both], yerr=spread[both], label="double support, ±2σ", **TOGETHER)
    turns = np.flatnonzero(seen & _flags(told, "turning", time))
    for run in np.split(turns, np.flatnonzero(np.diff(turns) > 1) + 1) if turns.size else ():
        axis.axvspan(time[run[0]], time[min(run[-1] + 1, time.size - 1)], label="a foot turns", **TURN)


def _places(axis: Any, estimate: Estimate, seconds: tuple[float, float] | None) -> None:
    """The standard deviation of each foot's horizontal place."""
    time, seen = as_float(estimate.time), np.asarray(estimate.valid, bool)
    if seconds is not None:
        seen = seen & (time >= seconds[0]) & (time <= seconds[1])
    for side in SIDES:
        deviation = as_float(getattr(estimate.feet_stddev, side).position)[:, :2]
        axis.plot(time[seen], 100.0 * np.hypot(*deviation[seen].T), label=f"{side} foot", **FOOT[side])
    since = "\nsince it last stood" if "moment_time" in estimate.diagnostics else ""
    axis.set_ylabel(f"σ of place{since} [cm]")
    axis.set_ylim(bottom=0.0)
