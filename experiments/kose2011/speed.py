"""The paper's Figure 4: forward acceleration, integrated with the velocity update to speed and distance."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common import protocols
from experiments.common.row import Row
from jgait import plot
from jgait.estimators import waist
from jgait.estimators.waist.inputs import WaistInputs
from jgait.estimators.waist.params import WaistOptions, WaistParams
from jgait.estimators.waist.velocity_update import Cycles, bouts_begin, updated
from jgait.plot.style import DASHED, RED, Figure, Seconds, Style, blank, check_overlap, legend, windowed
from jgait.plot.waist import contacts_of
from jgait.types import Estimate, Recording, as_float

ACCELERATION: Style = {"color": "0.35", "linewidth": 0.8}
UPDATED: Style = {"color": "black", "linewidth": 0.9, "label": "direct and reverse, velocity update"}
OURS: Style = {"color": RED, "linewidth": 2.2}
TRUE: Style = {"color": "black", "linewidth": 1.3, "linestyle": DASHED}
EVERY = 5
"""[cycles] Distance between two vertical lines."""

PAUSE_S = 1.5
"""[s] Longest time between two contacts of one bout; a longer time is a pause."""


def rows(quick: bool) -> list[Row]:
    """None: this part draws."""
    return []


def draw(rows: list[Row], folder: Path, quick: bool) -> None:
    """Write the figure of a simulated person."""
    walked = protocols.kose(jax.random.key(0))[0]
    figure = forward_speed(walked.recording, waist.estimate(waist.WaistParams(), walked.recording),
                           reference=walked.truth.estimate)  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    print(plot.save(figure, folder / "figure4.png"))


def forward_speed(
    recording: Recording,
    estimate: Estimate,
    *,
    reference: Estimate | None = None,
    p: "WaistParams | None" = None,
    options: "WaistOptions | None" = None,
    seconds: Seconds = None,
    title: str = "",
) -> Figure:
    """Forward acceleration, speed and distance of the trunk: integrated with the velocity update, and as estimated.

    The estimate is of `waist` for this recording, with these parameters and options; a reference with a distance is
    dashed. Distances begin with 0 at the start of the window `seconds`, from and to [s]. Vertical lines mark every
    fifth integrated cycle.

    Raises:
        ValueError: if the estimate has no distance or no contacts, or no sample lies in the window.
        RecordingError: as `waist.estimate`.
    """
    contacts = np.sort(np.concatenate(list(contacts_of(estimate).values())))
    if estimate.distance is None:
        raise ValueError("the estimate has no distance; it should be an estimate of `waist`")
    first, last = (float(estimate.time[0]), float(estimate.time[-1])) if seconds is None else seconds
    check_overlap(estimate.time, (first, last))
    p, options = waist.WaistParams() if p is None else p, waist.DEFAULT if options is None else options
    time, forward = as_float(estimate.time), as_float(estimate.diagnostics["trunk_acceleration"])[:, 0]
    inputs = waist.prepared(recording, options).inputs
    velocity, gone = _covered(p, inputs, forward)
    kept = windowed(time, (first, last))
    figure, axes = blank(3, 1, 8.8, 7.6, sharex=True, height_ratios=(1.0, 1.5, 1.3))
    above, speed, way = axes[:, 0]
    above.plot(time[kept], forward[kept], **ACCELERATION)
    speed.plot(time[kept], velocity[kept], **UPDATED)
    way.plot(time[kept], gone[kept] - gone[kept][0], **UPDATED)
    for one, name, style in ((estimate, "estimate", OURS), (reference, "reference", TRUE)):
        if one is not None and one.distance is not None:
            speed.plot(*_steps(one, contacts), label=f"{name}, contact to contact", **style)
            way.plot(*_gone(one, (first, last)), **style)
    begins = np.asarray(inputs.cycle_begin)[: int(inputs.cycles) : EVERY]
    for axis, unit in ((above, "forward accel-\neration [m/s²]"), (speed, "speed [m/s]"), (way, "way [m]")):
        for begin in time[begins]:
            axis.axvline(begin, color="0.8", linewidth=0.9, zorder=0.5, label=f"every {EVERY} cycles")
        axis.set_ylabel(unit)
        axis.grid(alpha=0.3, axis="y")
        axis.set_xlim(first, last)
    way.set_xlabel("time [s]")
    legend(figure, title)
    return figure


_updated = jax.jit(updated)


def _covered(p: "WaistParams", inputs: "WaistInputs", forward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocity [m/s] and distance [m] (T,) with the velocity update."""
    known, start = bouts_begin(p, jax.tree.map(jnp.asarray, inputs), jnp.asarray(forward))
    cycles = Cycles(inputs.cycle_begin, inputs.cycle_end, inputs.cycles)
    found = _updated(p.update, forward, cycles, inputs.dt, start, mask=inputs.valid, known=known)
    return as_float(found.velocity), as_float(found.displacement)


def _steps(estimate: Estimate, contacts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Speed from each contact to the next [m/s] as a step function, with gaps at pauses."""
    time, way = as_float(estimate.time), as_float(estimate.distance)
    there = np.asarray(estimate.valid, bool) & np.isfinite(way)
    at = np.interp(contacts, time[there], way[there], left=np.nan, right=np.nan)
    apart = np.diff(contacts)
    speed = np.where(apart < PAUSE_S, np.diff(at) / np.maximum(apart, 1e-9), np.nan)
    return np.repeat(contacts, 2)[1:-1], np.repeat(speed, 2)


def _gone(estimate: Estimate, span: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Time [s], and distance since the start of the span [m]."""
    time, way = as_float(estimate.time), as_float(estimate.distance)
    visible = np.asarray(estimate.valid, bool) & np.isfinite(way) & windowed(time, span)
    return time[visible], way[visible] - (way[visible][0] if visible.any() else 0.0)
