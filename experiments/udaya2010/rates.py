"""The paper's Figures 5 and 6: the Kalman filter's rates with and without sleep, and the error caused by sleep."""

from pathlib import Path

import jax
import numpy as np

from experiments.common import protocols
from experiments.common.row import Row
from jgait import plot
from jgait.duty_cycle.filling import MEASURED
from jgait.estimators import duty_cycled_gyro
from jgait.plot.duty import shade_sleep
from jgait.plot.style import RED, Axes, Figure, Seconds, Style, blank, check_overlap, legend, windowed
from jgait.types import PLACEMENTS, Estimate, as_float

READ: Style = {"color": "0.8", "linewidth": 4.0}
AWAKE: Style = {"color": "black", "linewidth": 1.0}
SLEPT: Style = {"color": RED, "linewidth": 1.6, "linestyle": (0, (4, 1.5))}
ERROR: Style = {"color": RED, "linewidth": 1.0}


def rows(quick: bool) -> list[Row]:
    """None: this part draws."""
    return []


def draw(rows: list[Row], folder: Path, quick: bool) -> None:
    """Write both figures of a simulated person."""
    recording = protocols.udaya_shankar(jax.random.key(0))[0].recording
    always, half = (duty_cycled_gyro.DEFAULT._replace(schedule=duty) for duty in (1.0, 0.5))
    awake, asleep = (duty_cycled_gyro.estimate(duty_cycled_gyro.params_of(o), recording, o) for o in (always, half))
    folder.mkdir(parents=True, exist_ok=True)
    print(plot.save(filtered_rates(asleep), folder / "figure5.png"))
    print(plot.save(filtered_rates(asleep, awake), folder / "figure6.png"))


def filtered_rates(
    estimate: Estimate,
    awake: Estimate | None = None,
    *,
    placement: str | None = None,
    seconds: Seconds = None,
    title: str = "",
) -> Figure:
    """The Kalman filter's rate of each segment and the gyroscope's; or the rates with and without sleep, and the error.

    Behind the estimate of `duty_cycled_gyro` the gyroscope's rate is drawn, measured or filled; or, of the same
    recording with the gyroscopes always on, the estimate `awake`, with the difference below. A placement, such as
    "shank_right", shows one sensor alone; `seconds` is from and to [s]. Errors are divided by the root mean square of
    the rate without sleep, as in the paper, within the time shown.

    Raises:
        ValueError: if an estimate has no such gyroscope, or both have different times, or no sample lies in the
            window.
    """
    names = [name for name in PLACEMENTS if placement in (None, name) and _told(estimate, name)]
    if not names:
        which = "gyroscope" if placement is None else f"gyroscope of {placement!r}"
        raise ValueError(f"the estimate has no {which}; use an estimate of duty_cycled_gyro")
    time = as_float(estimate.time)
    span = (float(time[0]), float(time[-1])) if seconds is None else seconds
    check_overlap(time, span)
    kept = windowed(time, span)
    if awake is not None:
        _same(awake, names, time)
    rows = len(names) * (1 if awake is None else 2)
    figure, axes = blank(rows, 1, 8.8, 1.9 * rows + 1.1, sharex=True)
    for number, name in enumerate(names):
        axis = axes[number * rows // len(names), 0]
        rate = as_float(estimate.diagnostics[f"rate_{name}"])[kept]
        asleep = np.asarray(estimate.diagnostics[f"how_{name}"])[kept] != MEASURED
        shade_sleep(axis, time[kept], asleep)
        if awake is None:
            read = as_float(estimate.diagnostics[f"gyro_{name}"])[kept]
            axis.plot(time[kept], read, label="gyroscope, measured or filled", **READ)
            axis.plot(time[kept], rate, label="Kalman filter", **AWAKE)
        else:
            whole = as_float(awake.diagnostics[f"rate_{name}"])[kept]
            axis.plot(time[kept], whole, label="Kalman filter, gyroscope always on", **AWAKE)
            axis.plot(time[kept], rate, label="Kalman filter, gyroscope asleep at times", **SLEPT)
            _error(axes[2 * number + 1, 0], time[kept], rate - whole, whole)
            shade_sleep(axes[2 * number + 1, 0], time[kept], asleep)
        axis.set_ylabel(f"{name.replace('_', ', ')}\nrate [rad/s]")
    axes[0, 0].set_xlim(max(span[0], float(time[0])), min(span[1], float(time[-1])))
    for axis in axes[:, 0]:
        axis.grid(alpha=0.3)
    axes[-1, 0].set_xlabel("time [s]")
    legend(figure, title)
    return figure


def _told(estimate: Estimate, name: str) -> bool:
    return {f"rate_{name}", f"gyro_{name}", f"how_{name}"} <= estimate.diagnostics.keys()


def _same(awake: Estimate, names: list[str], time: np.ndarray) -> None:
    """Refuse a second estimate with other gyroscopes or other times."""
    missing = [name for name in names if not _told(awake, name)]
    if missing or not np.array_equal(as_float(awake.time), time):
        what = f"does not have {missing[0]}" if missing else "has other times"
        raise ValueError(f"both estimates must be of the same recording; the one that is awake {what}")


def _error(axis: Axes, time: np.ndarray, error: np.ndarray, whole: np.ndarray) -> None:
    size = float(np.sqrt(np.mean(whole**2)))
    axis.axhline(0.0, color="0.5", linewidth=0.8)
    axis.plot(time, error, **ERROR)
    axis.set_ylabel("error [rad/s]")
    if size > 0.0:
        share = 100.0 * float(np.sqrt(np.mean(error**2))) / size
        axis.set_title(f"root mean square {share:.0f} % of the rate's", fontsize=9, loc="right", pad=3.0)
