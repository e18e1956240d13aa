"""A figure of gyroscopes that sleep: measured and filled rates, and angles."""

import numpy as np

from jgait.duty_cycle.filling import FILLED, HELD, MEASURED
from jgait.plot.style import BLUE, GROUND, Axes, Figure, Seconds, Style, band, legend, panels, windowed
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Estimate, as_float

ASLEEP: Style = {"color": "0.9", "label": "gyroscope asleep, or sample lost", **GROUND}
RATES: tuple[tuple[int, str, Style], ...] = (
    (MEASURED, "measured", {"color": "black", "linewidth": 1.1}),
    (FILLED, "filled", {"color": "#d35400", "linewidth": 1.7}),
    (HELD, "held, not used", {"color": "#2e86c1", "linewidth": 1.3, "linestyle": (0, (1, 1.5))}),
)
"""Origin of a sample, its name and its line; the lines differ in width, dashes and colour."""


def sleeping_gyroscopes(estimate: Estimate, *, seconds: Seconds = None, title: str = "") -> Figure:
    """Angles and gyroscope rates of every leg over time; the background is grey while a gyroscope sleeps.

    A column for each leg: hip and knee, or the segment's angle with one sensor alone, above the rate of each sensor.
    The window `seconds` is from and to [s]. Raises ValueError if the estimate has no gyroscope with filled gaps.
    """
    names = [f"{segment}_{side}" for side in SIDES for segment in ("thigh", "shank")]
    names = [name for name in names if f"how_{name}" in estimate.diagnostics]
    if not names:
        raise ValueError("the estimate has no gyroscope that may sleep; use an estimate of duty_cycled_gyro")
    sides = [side for side in SIDES if any(name.endswith(side) for name in names)]
    rows = 1 + max(sum(name.endswith(side) for name in names) for side in sides)
    figure, axes = panels(rows, len(sides), 6.2 * len(sides) + 1.4, 2.0 * rows + 1.0, sharex=True, sharey="row")
    time = as_float(estimate.time)
    part = windowed(time, seconds)
    for column, side in enumerate(sides):
        worn = [name for name in names if name.endswith(side)]
        axes[0, column].set_title(f"{side} leg", fontsize=10)
        _angles(axes[0, column], estimate, side, worn, part)
        for axis, name in zip(axes[1:, column], worn, strict=False):
            _rates(axis, estimate, name, part)
            axis.set_ylabel(f"{name.split('_')[0]} rate [rad/s]")
        for axis in axes[1 + len(worn) :, column]:
            axis.set_visible(False)
        axes[len(worn), column].set_xlabel("time [s]")
        axes[len(worn), column].tick_params(labelbottom=True)
    legend(figure, title, columns=5)
    return figure


def shade_sleep(axis: Axes, time: np.ndarray, asleep: np.ndarray) -> None:
    """Shade the background from the first sample of each sleep to the first sample after it."""
    for start, end in true_runs(asleep):
        axis.axvspan(time[start], time[min(end, time.size - 1)], **ASLEEP)


def _rates(axis: Axes, estimate: Estimate, name: str, part: np.ndarray) -> None:
    """Draw one gyroscope's rate; each piece begins at the last sample of the piece before, so the line has no gaps."""
    time, rate = as_float(estimate.time)[part], as_float(estimate.diagnostics[f"gyro_{name}"])[part]
    how = np.asarray(estimate.diagnostics[f"how_{name}"])[part]
    shade_sleep(axis, time, how != MEASURED)
    for kind, word, style in RATES:
        of_kind = how == kind
        if of_kind.any():
            kept = of_kind | np.r_[of_kind[1:], False] if kind != MEASURED else of_kind
            axis.plot(time, np.where(kept, rate, np.nan), label=word, **style)


def _angles(axis: Axes, estimate: Estimate, side: str, worn: list[str], part: np.ndarray) -> None:
    """Draw hip and knee with bands of two standard deviations, or the angle of a single segment."""
    time, diagnostics = as_float(estimate.time)[part], estimate.diagnostics
    asleep = np.any([np.asarray(diagnostics[f"how_{name}"])[part] != MEASURED for name in worn], axis=0)
    shade_sleep(axis, time, asleep)
    hip: Style = {"color": BLUE, "linewidth": 1.6}
    knee: Style = {"color": "#5b2c83", "linewidth": 1.1}
    leg = getattr(estimate.legs, side)
    if leg is None:
        lines = [(f"{name.split('_')[0]} angle", knee, diagnostics[f"angle_{name}"],
                  diagnostics[f"angle_stddev_{name}"]) for name in worn]  # fmt: skip
        axis.set_ylabel("angle [°]")
    else:
        spread = None if estimate.stddev is None else getattr(estimate.stddev, side)
        lines = [(f"{joint} flexion", style, getattr(leg, f"{joint}_angle"), getattr(spread, f"{joint}_angle", None))
                 for joint, style in (("hip", hip), ("knee", knee))]  # fmt: skip
        axis.set_ylabel("flexion [°]")
    valid = np.asarray(estimate.valid, bool)[part]
    for word, style, values, deviation in lines:
        angle = np.where(valid, np.rad2deg(as_float(values)[part]), np.nan)
        if deviation is not None:
            band(axis, time, angle, np.rad2deg(as_float(deviation)[part]), label=None, color=style["color"], alpha=0.22)
        axis.plot(time, angle, label=f"{word}, ±2σ" if deviation is not None else word, **style)
