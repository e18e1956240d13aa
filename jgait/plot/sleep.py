"""The picture of what the Kalman filter makes of a gyroscope, always on and with sleep, and of what the sleep costs.

`jgait.plot` has the function; it returns the matplotlib figure.
"""

from typing import Any

import numpy as np

from jgait.duty_cycle.fillers.base import MEASURED
from jgait.plot.duty import ASLEEP
from jgait.plot.waist import check_overlap, legend_once
from jgait.plot.walk import blank
from jgait.signal.windows import true_runs
from jgait.types import PLACEMENTS, Estimate, as_float

READ = {"color": "0.8", "linewidth": 4.0}
AWAKE = {"color": "black", "linewidth": 1.0}
SLEPT = {"color": "#c0392b", "linewidth": 1.6, "linestyle": (0, (4, 1.5))}
ERROR = {"color": "#c0392b", "linewidth": 1.0}


def filtered_rates(
    estimate: Estimate,
    awake: Estimate | None = None,
    *,
    placement: str | None = None,
    seconds: tuple[float, float] | None = None,
    title: str = "",
) -> Any:
    """The Kalman filter's rate of each segment over the gyroscope's reading; or with sleep over without, and the error.

    Args:
        estimate: of `duty_cycled_gyro`.
        awake: of the same recording with its gyroscopes always on; then the estimate is drawn over it, and their
            difference beneath. None: the gyroscope's own rate, measured or filled, is drawn beneath the estimate.
        placement: one sensor alone, such as "shank_right"; None: all.
        seconds: from and to [s]; None: everything.
        title: above the figure.

    Returns:
        A matplotlib figure. Errors are over the root mean square of the rate without sleep, as in the paper, within the
        time shown.

    Raises:
        ValueError: if an estimate tells of no such gyroscope, or of other times than the other, or if nothing lies in
            the time asked for.
    """
    names = [name for name in PLACEMENTS if placement in (None, name) and _told(estimate, name)]
    if not names:
        which = "gyroscope" if placement is None else f"gyroscope of {placement!r}"
        raise ValueError(f"the estimate tells of no {which}; it should be one of duty_cycled_gyro")
    time = as_float(estimate.time)
    span = (float(time[0]), float(time[-1])) if seconds is None else seconds
    check_overlap(estimate, span)
    kept = (time >= span[0]) & (time <= span[1])
    if awake is not None:
        _same(awake, names, time)
    rows = len(names) * (1 if awake is None else 2)
    figure, axes = blank(rows, 1, 8.8, 1.9 * rows + 1.1, sharex=True)
    for number, name in enumerate(names):
        axis = axes[number * rows // len(names), 0]
        rate = as_float(estimate.diagnostics[f"rate_{name}"])[kept]
        _shade(axis, estimate, name, span)
        if awake is None:
            read = as_float(estimate.diagnostics[f"gyro_{name}"])[kept]
            axis.plot(time[kept], read, label="gyroscope, measured or filled", **READ)
            axis.plot(time[kept], rate, label="Kalman filter", **AWAKE)
        else:
            whole = as_float(awake.diagnostics[f"rate_{name}"])[kept]
            axis.plot(time[kept], whole, label="Kalman filter, gyroscope always on", **AWAKE)
            axis.plot(time[kept], rate, label="Kalman filter, gyroscope asleep at times", **SLEPT)
            _error(axes[2 * number + 1, 0], time[kept], rate - whole, whole)
            _shade(axes[2 * number + 1, 0], estimate, name, span)
        axis.set_ylabel(f"{name.replace('_', ', ')}\nrate [rad/s]")
    for axis in axes[:, 0]:
        axis.grid(alpha=0.3)
        axis.set_xlim(max(span[0], float(time[0])), min(span[1], float(time[-1])))
    axes[-1, 0].set_xlabel("time [s]")
    figure.align_ylabels()
    legend_once(figure, axes[:, 0], title)
    return figure


def _told(estimate: Estimate, name: str) -> bool:
    return {f"rate_{name}", f"gyro_{name}", f"how_{name}"} <= estimate.diagnostics.keys()


def _same(awake: Estimate, names: list[str], time: np.ndarray) -> None:
    """Refuse an estimate of other gyroscopes or times."""
    missing = [name for name in names if not _told(awake, name)]
    if missing or not np.array_equal(as_float(awake.time), time):
        what = f"tells nothing of {missing[0]}" if missing else "has other times"
        raise ValueError(f"both estimates must be of the same recording; the one that is awake {what}")


def _shade(axis: Any, estimate: Estimate, name: str, span: tuple[float, float]) -> None:
    time, how = as_float(estimate.time), np.asarray(estimate.diagnostics[f"how_{name}"])
    for start, end in true_runs(how != MEASURED):
        first, last = time[start], time[min(end, time.size - 1)]
        if first <= span[1] and last >= span[0]:
            axis.axvspan(first, last, label="gyroscope asleep, or sample lost", **ASLEEP)


def _error(axis: Any, time: np.ndarray, error: np.ndarray, whole: np.ndarray) -> None:
    size = float(np.sqrt(np.mean(whole**2)))
    axis.axhline(0.0, color="0.5", linewidth=0.8)
    axis.plot(time, error, **ERROR)
    axis.set_ylabel("error [rad/s]")
    if size > 0.0:
        share = 100.0 * float(np.sqrt(np.mean(error**2))) / size
        axis.set_title(f"root mean square {share:.0f} % of the rate's", fontsize=9, loc="right", pad=3.0)
