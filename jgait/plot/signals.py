"""The signals of a recording, as they were read."""

import numpy as np

from jgait.plot.style import AXES, Figure, blank
from jgait.types import Recording, as_float


def signals(recording: Recording, *, title: str = "") -> Figure:
    """A row for each sensor: its angular rates [deg/s] and specific forces [m/s²] over time; masked samples are gaps.
    Raises ValueError if the recording has no sensor.
    """
    if not recording.sensors:
        raise ValueError("a figure of signals needs a sensor; the recording has none")
    figure, axes = blank(len(recording.sensors), 2, 12.0, 1.0 + 1.7 * len(recording.sensors), sharex=True)
    for (left, right), (name, imu) in zip(axes, recording.sensors.items(), strict=True):
        lost = ~np.asarray(imu.mask, bool)[:, None]
        left.set_ylabel(name.replace("_", " "))
        for panel, values in ((left, np.rad2deg(as_float(imu.gyr))), (right, imu.acc)):
            if values is None:
                panel.set_axis_off()
                continue
            known = np.where(lost, np.nan, as_float(values))
            for column, axis, line in zip(known.T, "xyz", AXES, strict=True):
                panel.plot(as_float(imu.time), column, **(line | {"linewidth": 0.8}), label=axis)
            panel.grid(alpha=0.3)
    axes[0, 0].set_title("angular rate [deg/s]")
    axes[0, 1].set_title("specific force [m/s²]")
    axes[0, 0].legend(ncols=3, fontsize="small", loc="upper right")
    for panel in axes[-1]:
        panel.set_xlabel("time [s]")
    figure.suptitle(title)
    return figure
