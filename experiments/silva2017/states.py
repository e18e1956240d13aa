"""The paper's Figure 3: the state machine over the rate of a shank."""

from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from jax import Array, lax

from experiments.common import protocols
from experiments.common.row import Row
from jgait import plot
from jgait.estimators import ankle_stride
from jgait.estimators.ankle_stride.params import AnkleOptions
from jgait.estimators.ankle_stride.prepare import AnkleSignals
from jgait.events import shank as shank_events
from jgait.events.shank import FLAT, HEEL_STRIKE, MACHINE, SWING, TOE_OFF, Detector, ShankEvents, ShankState
from jgait.plot.style import (
    BLUE,
    DASHED,
    GROUND,
    RED,
    Axes,
    Figure,
    Seconds,
    Style,
    blank,
    check_overlap,
    legend,
    windowed,
)
from jgait.signal import butterworth
from jgait.types import SIDES, Recording, Scalar, as_float

RAW: Style = {"color": "0.6", "linewidth": 0.9}
FILTERED: Style = {"color": "black", "linewidth": 1.9}
LIMIT: Style = {"color": RED, "linewidth": 1.2, "linestyle": DASHED}
STATES = ((FLAT, "foot flat", "1.0"), (TOE_OFF, "toe-off", "0.8"), (SWING, "swing", "0.91"),
          (HEEL_STRIKE, "heel strike", "0.7"))  # fmt: skip
"""State, its name, and the grey level of its background."""

EVENTS: tuple[tuple[str, str, Style], ...] = (
    ("push_off", "push-off", {"marker": "^", "color": "white"}),
    ("start", "swing begins", {"marker": "D", "color": BLUE}),
    ("end", "swing ends: a stride", {"marker": "v", "color": RED}),
)
"""Field of `events.shank.ShankEvents`, its label, and its mark."""

SHOWN_S = 4.0
"""[s] Length of the default window, about the middle stride."""


class Machine(NamedTuple):
    """The state machine over a recording: filtered rate [rad/s], states, events; times [s] without its delay."""

    time: np.ndarray
    rate: np.ndarray
    state: np.ndarray
    found: ShankEvents


def rows(quick: bool) -> list[Row]:
    """None: this part draws."""
    return []


def draw(rows: list[Row], folder: Path, quick: bool) -> None:
    """Write the figure of a simulated person, with the paper's detector."""
    recording = protocols.silva(jax.random.key(0), route="B")[0].recording
    folder.mkdir(parents=True, exist_ok=True)
    print(plot.save(swing_states(recording, detector=shank_events.PAPER), folder / "figure3.png"))


def swing_states(
    recording: Recording,
    *,
    side: str | None = None,
    detector: Detector | None = None,
    seconds: Seconds = None,
    title: str = "",
) -> Figure:
    """The sagittal rate at an ankle or on a shank with the state machine's states, events and thresholds.

    The side is 'right', 'left' or the first with a sensor; the settings are `events.shank.MACHINE`, or for example
    `events.shank.PAPER`; the window [s] is four seconds about the middle stride, unless `seconds` has another.

    Raises:
        ValueError: if that side was not measured, or no sample lies in the window.
        RecordingError: as `ankle_stride.estimate`.
    """
    d = MACHINE if detector is None else detector
    side, time, leg = _leg(recording, side, ankle_stride.DEFAULT)
    raw = (as_float(leg.gyr) - as_float(leg.gyr_bias))[:, 1]
    machine = _machine(raw, time, recording.sampling_rate_hz, d)
    strides = np.flatnonzero(machine.found.stride)
    middle = float(machine.found.end[strides[strides.size // 2]]) if strides.size else float(np.median(time))
    first, last = (middle - 0.5 * SHOWN_S, middle + 0.5 * SHOWN_S) if seconds is None else seconds
    inside = windowed(time, (first, last))
    check_overlap(time, (first, last))
    figure, axes = blank(2, 1, 8.8, 5.6, sharex=True, height_ratios=(3.0, 1.0))
    above, below = axes[:, 0]
    _grounds(above, machine, (first, last))
    above.axhline(0.0, color="0.5", linewidth=0.8)
    above.plot(time[inside], raw[inside], label="rate", **RAW)
    part = windowed(machine.time, (first, last))
    above.plot(machine.time[part], machine.rate[part], label=f"its part below {float(d.cutoff_hz):g} Hz", **FILTERED)
    for sign in (1.0, -1.0):
        above.axhline(sign * float(d.threshold), label="threshold of push-off and swing", **LIMIT)
    for field, words, style in EVENTS:
        when = as_float(getattr(machine.found, field))[strides]
        when = when[windowed(when, (first, last))]
        above.plot(when, np.interp(when, machine.time, machine.rate), label=words, linestyle="none", markersize=7.0,
                   markeredgecolor="black", zorder=3.0, **style)  # fmt: skip
    above.set_ylabel(f"rate of the {side} shank [rad/s],\nforward swing negative")
    below.step(machine.time[part], machine.state[part], where="post", color="black", linewidth=1.4)
    below.set_yticks([state for state, _, _ in STATES], [name for _, name, _ in STATES])
    below.set_ylim(FLAT - 0.4, HEEL_STRIKE + 0.4)
    below.set_xlabel("time [s]")
    for axis in (above, below):
        axis.set_xlim(max(first, float(time[0])), min(last, float(time[-1])))
        axis.grid(alpha=0.3)
    legend(figure, title)
    return figure


def _leg(recording: Recording, side: str | None, options: "AnkleOptions") -> tuple[str, np.ndarray, "AnkleSignals"]:
    """A side with a sensor, the time [s], and the leg's signals and detected stances."""
    if side not in (None, *SIDES):
        raise ValueError(f"side must be 'right' or 'left'; got {side!r}")
    inputs = ankle_stride.prepared(recording, options).inputs
    legs = {name: getattr(inputs, name) for name in SIDES if getattr(inputs, name) is not None}
    chosen = next(iter(legs)) if side is None else side
    if chosen not in legs:
        raise ValueError(f"the {chosen} leg was not measured; the {next(iter(legs))} one was")
    return chosen, as_float(inputs.time), legs[chosen]


@jax.jit
def _phases(
    d: Detector, values: Array, time: Array, rate_hz: Scalar
) -> tuple[Array, Scalar, tuple[Array, ShankEvents]]:
    """The result of `events.shank.phases`: filtered rate, delay of the filter, and state and events at each sample."""
    filtered = butterworth.low_pass(values, d.cutoff_hz, rate_hz)

    def one(state: ShankState, sample: tuple[Array, Array]) -> tuple[ShankState, tuple[Array, ShankEvents]]:
        state, events = shank_events.phase_step(d, state, *sample)
        return state, (state.phase, events)

    began = shank_events.begin(filtered[0], time[0])
    return filtered, butterworth.delay(d.cutoff_hz, rate_hz), lax.scan(one, began, (filtered, time))[1]


def _machine(rate: np.ndarray, time: np.ndarray, rate_hz: float, d: Detector) -> Machine:
    """The state machine over the whole recording; the filter's delay is subtracted from the times."""
    filtered, late, (state, events) = _phases(d, rate, time, float(rate_hz))
    late = float(late)
    moved = {field: as_float(getattr(events, field)) - late for field in ("push_off", "start", "end")}
    events = events._replace(stride=np.asarray(events.stride, bool), **moved)
    return Machine(time - late, as_float(filtered), np.asarray(state), events)


def _grounds(axis: Axes, machine: Machine, span: tuple[float, float]) -> None:
    """Shade the background in the grey of each state; foot flat is white."""
    edges = np.flatnonzero(np.diff(machine.state)) + 1
    for start, stop in zip([0, *edges], [*edges, len(machine.state) - 1], strict=True):
        state = int(machine.state[start])
        if state == FLAT or machine.time[stop] < span[0] or machine.time[start] > span[1]:
            continue
        _, name, grey = STATES[state]
        axis.axvspan(machine.time[start], machine.time[stop], color=grey, label=name, **GROUND)
