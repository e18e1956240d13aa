"""The picture of a gyroscope that sleeps: its rate, measured and filled, over the time it slept, and the angles."""

from typing import Any

import numpy as np

from jgait.duty_cycle.fillers.base import FILLED, HELD, MEASURED
from jgait.plot.feet import legend
from jgait.plot.walk import blank
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Estimate, as_float

DEGREES = 180.0 / np.pi
ASLEEP = {"color": "0.9", "linewidth": 0.0, "zorder": 0.0}
RATES = (
    (MEASURED, "measured", {"color": "black", "linewidth": 1.1}),
    (FILLED, "filled", {"color": "#d35400", "linewidth": 1.7}),
    (HELD, "held, not used", {"color": "#2e86c1", "linewidth": 1.3, "linestyle": (0, (1, 1.5))}),
)
"""How a sample was had, its name and its line; told apart by width and dashes as well as colour."""

ANGLES = (("hip", {"color": "#6fb1e0", "linewidth": 1.6}), ("knee", {"color": "#5b2c83", "linewidth": 1.1}))


def sleeping_gyroscopes(estimate: Estimate, *, seconds: tuple[float, float] | None = None, title: str = "") -> Any:
    """Angles and gyroscope rates of every leg over time; where a gyroscope slept the ground is grey.

    Args:
        estimate: of `duty_cycled_gyro`.
        seconds: from and to [s]; None draws everything.
        title: above the figure.

    Returns:
        A matplotlib figure: a column for each leg; hip and knee, or the segment's angle where one is worn alone, over
        the rate of each sensor.

    Raises:
        ValueError: if the estimate has no gyroscope whose gaps were filled.
    """
    names = [f"{segment}_{side}" for side in SIDES for segment in ("thigh", "shank")]
    names = [name for name in names if f"how_{name}" in estimate.diagnostics]
    if not names:
        raise ValueError("the estimate tells of no gyroscope that may sleep; it should be one of duty_cycled_gyro")
    sides = [side for side in SIDES if any(name.endswith(side) for name in names)]
    rows = 1 + max(sum(name.endswith(side) for name in names) for side in sides)
    figure, axes = blank(rows, len(sides), 6.2 * len(sides) + 1.4, 2.0 * rows + 1.0, sharex=True, sharey="row")
    time = as_float(estimate.time)
    part = slice(0, time.size) if seconds is None else slice(*np.searchsorted(time, seconds))
    labelled = set[str]()
    for column, side in enumerate(sides):
        own = [name for name in names if name.endswith(side)]
        axes[0, column].set_title(f"{side} leg", fontsize=10)
        _angles(axes[0, column], estimate, side, own, part, labelled)
        for axis, name in zip(axes[1:, column], own, strict=False):
            _rates(axis, estimate, name, part, labelled)
            axis.set_ylabel(f"{name.split('_')[0]} rate [rad/s]")
        for axis in axes[1 + len(own) :, column]:
            axis.set_visible(False)
        axes[len(own), column].set_xlabel("time [s]")
        axes[len(own), column].tick_params(labelbottom=True)
    legend(figure, title)
    return figure


def _once(name: str, labelled: set[str]) -> str | None:
    """A name for the legend the first time, None after that."""
    if name in labelled:
        return None
    labelled.add(name)
    return name


def _shade(axis: Any, time: np.ndarray, asleep: np.ndarray, labelled: set[str]) -> None:
    """Grey ground from the first sample of each sleep to the first after it."""
    for start, end in true_runs(asleep):
        label = _once("gyroscope asleep, or sample lost", labelled)
        axis.axvspan(time[start], time[min(end, time.size - 1)], label=label, **ASLEEP)


def _rates(axis: Any, estimate: Estimate, name: str, part: slice, labelled: set[str]) -> None:
    """One gyroscope: each piece reaches back to the sample before it, so that the line has no holes."""
    time, rate = as_float(estimate.time)[part], as_float(estimate.diagnostics[f"gyro_{name}"])[part]
    how = np.asarray(estimate.diagnostics[f"how_{name}"])[part]
    _shade(axis, time, how != MEASURED, labelled)
    for kind, word, style in RATES:
        own = how == kind
        if own.any():
            kept = own | np.r_[own[1:], False] if kind != MEASURED else own
            axis.plot(time, np.where(kept, rate, np.nan), label=_once(word, labelled), **style)
    axis.grid(alpha=0.3)


def _angles(axis: Any, estimate: Estimate, side: str, own: list[str], part: slice, labelled: set[str]) -> None:
    """Hip and knee with bands of two standard deviations, or the angle of the one segment."""
    time, told = as_float(estimate.time)[part], estimate.diagnostics
    asleep = np.any([np.asarray(told[f"how_{name}"])[part] != MEASURED for name in own], axis=0)
    _shade(axis, time, asleep, labelled)
    leg = getattr(estimate.legs, side)
    if leg is None:
        lines = [(f"{name.split('_')[0]} angle", told[f"angle_{name}"], told[f"angle_stddev_{name}"]) for name in own]
        styles = [ANGLES[1][1]] * len(lines)
        axis.set_ylabel("angle [°]")
    else:
        spread = None if estimate.stddev is None else getattr(estimate.stddev, side)
        fields = [(f"{joint} flexion", f"{joint}_angle") for joint, _ in ANGLES]
        lines = [(word, getattr(leg, f), None if spread is None else getattr(spread, f)) for word, f in fields]
        styles = [style for _, style in ANGLES]
        axis.set_ylabel("flexion [°]")
    for (word, values, deviation), style in zip(lines, styles, strict=True):
        angle = DEGREES * as_float(values)[part]
        if deviation is not None:
            band = 2.0 * DEGREES * as_float(deviation)[part]
            axis.fill_between(time, angle - band, angle + band, color=style["color"], alpha=0.22, linewidth=0.0)
        axis.plot(time, angle, label=_once(f"{word}, ±2σ" if deviation is not None else word, labelled), **style)
    axis.grid(alpha=0.3)
