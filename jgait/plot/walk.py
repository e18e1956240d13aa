"""The signals of a recording; and of a simulated walk an animated stick figure, and all signals of one stride."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import PyTree

from jgait.geometry.segments import in_world
from jgait.geometry.vectors import Vector
from jgait.io.atomic import replaced
from jgait.plot.style import AXES, Axes, Figure, Style, blank, legend, panels
from jgait.types import PLACEMENTS, SIDES, Recording, Strides, as_float

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation

    from jgait.simulate import Body, Truth

BODY: dict[str, Style] = {
    "right": {"color": "black", "linewidth": 2.6}, "left": {"color": "0.62", "linewidth": 2.6},
    "pelvis": {"color": "0.3", "linewidth": 2.6},
}  # fmt: skip
"""Line of each leg and of the pelvis."""

FRAMES_HZ = 25.0
"""[Hz] Frames of the animation per second; chosen by hand."""

SIGNALS = (("gyr", "angular rate [rad/s]"), ("acc", "specific force [m/s²]"))


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


def stick_figure(truth: "Truth", path: str | Path | None = None) -> "FuncAnimation":
    """Animation of the body of a simulated walk from the side and from the front; the view follows the pelvis.

    The right leg is black, the left leg grey; a foot is drawn from its heel to its ball. With a path, an animated GIF
    is written; in a notebook, `HTML(animation.to_jshtml())` shows the animation.
    """
    from matplotlib.animation import FuncAnimation, PillowWriter

    from jgait.simulate import Body

    time = np.asarray(truth.estimate.time)
    wanted = np.arange(time[0], time[-1] + 1e-9, 1.0 / FRAMES_HZ)
    chosen = np.unique(np.clip(np.searchsorted(time, wanted), 0, time.size - 1))
    lines = _lines(truth, Body(), chosen)
    figure, axes = blank(1, 2, 6.2, 4.4, width_ratios=(2.3, 1.0))
    drawn, label = _stage(axes[0], lines)

    def show(number: int) -> list[PyTree]:
        for (view, name), artist in drawn.items():
            artist.set_data(lines[name][number][:, view], lines[name][number][:, 2])
        label.set_text(f"{time[chosen[number]]:.2f} s")
        return [*drawn.values(), label]

    show(0)
    if (layout := figure.get_layout_engine()) is not None:
        layout.execute(figure)
    figure.set_layout_engine("none")  # every frame has the layout of the first
    animation = FuncAnimation(
        figure, show, frames=len(chosen), interval=1000.0 / FRAMES_HZ, blit=False, cache_frame_data=False
    )
    if path is not None:
        with replaced(path) as part:
            animation.save(part, writer=PillowWriter(fps=round(FRAMES_HZ)), dpi=80)
    return animation


def _stage(axes: np.ndarray, lines: dict[str, np.ndarray]) -> tuple[dict[tuple[int, str], PyTree], PyTree]:
    """Both views with an empty line for each part of the body; and the text for the time."""
    everything = np.concatenate([points.reshape(-1, 3) for points in lines.values()])
    low, high = everything.min(axis=0) - 0.12, everything.max(axis=0) + 0.12
    drawn = {}
    for view, (axis, name) in enumerate(
        zip(axes, ("forward of the pelvis [m]", "left of the pelvis [m]"), strict=True)
    ):
        # The part nearest to the viewer is drawn last: in the side view the right leg.
        for part in ("left", "pelvis", "right"):
            (drawn[view, part],) = axis.plot([], [], solid_capstyle="round", solid_joinstyle="round", **BODY[part])
        axis.set_aspect("equal")
        wide = max(high[view], -low[view])
        axis.set_xlim(-wide, wide)
        axis.set_ylim(low[2], high[2])
        axis.set_xlabel(name)
        axis.grid(alpha=0.25)
    axes[0].set_ylabel("height [m]")
    axes[0].set_title("from the right", fontsize=10)
    axes[1].set_title("from the front", fontsize=10)
    axes[1].tick_params(labelleft=False)
    for side in SIDES:
        axes[0].plot([], [], label=f"{side} leg", **BODY[side])
    axes[0].legend(loc="upper left", fontsize=8, framealpha=0.9)
    label = axes[1].text(0.97, 0.97, "", transform=axes[1].transAxes, ha="right", va="top", fontsize=9)
    return drawn, label


def _lines(truth: "Truth", body: "Body", chosen: np.ndarray) -> dict[str, np.ndarray]:
    """Points (n, points, 3) of pelvis and legs, forward and left of the pelvis and up [m]."""
    segments = truth.motion.pose
    lines = {}
    for side in SIDES:
        thigh, shank, foot = (getattr(segments, f"{part}_{side}") for part in ("thigh", "shank", "foot"))
        joints = [_points(part.origin, chosen) for part in (thigh, shank, foot)]
        heel, ball = (_points(in_world(foot, Vector(ahead, 0.0, -body.ankle_height)), chosen)
                      for ahead in (-body.heel_length, body.ball_length))  # fmt: skip
        lines[side] = np.stack([*joints, heel, ball, joints[-1]], axis=1)
    middle = _points(segments.pelvis.origin, chosen)
    top = middle + body.back_height * 2.0 * _points(segments.pelvis.z, chosen)
    right, left = (lines[side][:, 0] for side in SIDES)
    lines["pelvis"] = np.stack([right, top, left, right], axis=1)
    heading = np.asarray(truth.estimate.diagnostics["heading"])[chosen, None]
    c, s, middle = np.cos(heading), np.sin(heading), middle[:, None]
    for name, points in lines.items():
        x, y, z = np.moveaxis(points, -1, 0)
        x, y = x - middle[..., 0], y - middle[..., 1]
        lines[name] = np.stack([c * x + s * y, c * y - s * x, z], axis=-1)
    return lines


def _points(vector: Vector, chosen: np.ndarray) -> np.ndarray:
    return np.stack([np.asarray(part, float)[chosen] for part in vector], axis=1)


def stride_signals(recording: Recording, truth: "Truth") -> Figure:
    """All sensor signals of the middle stride of a simulated walk, with the contacts of both feet. Raises ValueError if
    there is no stride.
    """
    strides = truth.strides
    rows = np.flatnonzero(np.asarray(strides.valid))
    if not rows.size:
        raise ValueError("the walk has no stride to show")
    stride = int(rows[len(rows) // 2])
    start, end = float(strides.start[stride]), float(strides.end[stride])
    worn = sorted(recording.sensors.items(), key=lambda placed: PLACEMENTS.index(placed[0]))
    figure, axes = panels(len(worn), 2, 8.6, 1.35 * len(worn) + 1.3, sharex=True)
    for row, (placement, imu) in enumerate(worn):
        time = np.asarray(imu.time)
        part = slice(*np.searchsorted(time, [start - 1e-9, end + 1e-9]))
        share = 100.0 * (time[part] - start) / (end - start)
        for column, (field, _) in enumerate(SIGNALS):
            axis, values = axes[row, column], getattr(imu, field)
            _contacts(axis, strides, stride)
            if values is None:
                axis.text(0.5, 0.5, "not measured", transform=axis.transAxes, ha="center", va="center", color="0.4")
            else:
                kept = np.where(np.asarray(imu.mask)[part, None], np.asarray(values, float)[part], np.nan)
                for number, style in enumerate(AXES):
                    axis.plot(share, kept[:, number], label="xyz"[number], **style)
            axis.set_xlim(-1.5, 101.5)
            axis.margins(y=0.08)
        axes[row, 0].set_ylabel(placement.replace("_", "\n"))
    side = SIDES[int(strides.side[stride])]
    for column, (_, unit) in enumerate(SIGNALS):
        axes[0, column].set_title(unit, fontsize=10)
        axes[-1, column].set_xlabel(f"stride of the {side} foot [%]")
    legend(figure, f"{recording.name}: {end - start:.2f} s, {float(strides.length[stride]):.2f} m")
    return figure


def _contacts(axis: Axes, strides: Strides, stride: int) -> None:
    """Draw vertical lines at initial and final contacts: dark for the foot of the stride, light for the other foot."""
    start, end, leg = float(strides.start[stride]), float(strides.end[stride]), int(strides.side[stride])
    rows = np.flatnonzero(np.asarray(strides.valid))
    for side in (1 - leg, leg):
        color = "0.25" if side == leg else "0.7"
        mine = rows[np.asarray(strides.side)[rows] == side]
        each = (("initial contact", "-", strides.end), ("final contact", (0, (1, 1.5)), strides.final_contact))
        for name, dashes, times in each:
            style: Style = {"color": color, "linewidth": 1.1, "linestyle": dashes, "label": f"{name}, {SIDES[side]}"}
            for time in np.asarray(times)[mine]:
                if start - 1e-9 <= time <= end + 1e-9:
                    axis.axvline(100.0 * (time - start) / (end - start), zorder=0.5, **style)
