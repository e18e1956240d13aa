"""Figures of strides from a sensor at the ankle: the state machine over the shank's rate, and one stride integrated.

Readable in grey, with units. Each function returns the matplotlib figure. `jgait.plot` has all of them.
"""

from collections.abc import Iterable
from typing import NamedTuple

import jax
import numpy as np
from jax import Array, lax

from jgait.estimators import ankle_stride
from jgait.estimators.ankle_stride import length_steps as steps
from jgait.estimators.ankle_stride import readout
from jgait.estimators.ankle_stride.inputs import AnkleSignals
from jgait.estimators.ankle_stride.length import StrideLengthParams
from jgait.estimators.ankle_stride.params import AnkleOptions, AnkleParams
from jgait.events import shank as shank_events
from jgait.events.shank import FLAT, HEEL_STRIKE, MACHINE, SWING, TOE_OFF, Detector, ShankEvents, ShankState
from jgait.geometry.rotation import rotated
from jgait.geometry.vectors import Vector, cross, vector
from jgait.plot.style import (
    AXES,
    BLUE,
    DASHED,
    DOTTED,
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
from jgait.signal.marks import Marks
from jgait.types import SIDES, AnyArray, Recording, Scalar, as_float

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

ROWS = ("acceleration [m/s²]", "velocity [m/s]", "displacement [m]")
UNCORRECTED: Style = {"linewidth": 0.9, "linestyle": DOTTED}


class Machine(NamedTuple):
    """The state machine over a recording: filtered rate [rad/s], states, events; times [s] without its delay."""

    time: np.ndarray
    rate: np.ndarray
    state: np.ndarray
    found: ShankEvents


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


def stride_integration(
    recording: Recording,
    *,
    p: "AnkleParams | None" = None,
    options: "AnkleOptions | None" = None,
    side: str | None = None,
    stride: int | None = None,
    title: str = "",
) -> Figure:
    """One stride integrated in three dimensions: the ankle's acceleration, velocity and displacement forward, left and
    up.

    Strapdown integration from one stance to the next, rotated to the direction of the stride. Thin dotted lines are
    uncorrected, with the first specific force as gravity; the others are corrected by the velocity at both ends. The
    stride is that of a number from 0, or the middle one, of a side, 'right', 'left' or the first with a sensor.

    Raises:
        ValueError: if that side was not measured, or there is no such stride.
        RecordingError: as `ankle_stride.estimate`.
    """
    p = ankle_stride.AnkleParams() if p is None else p
    options = ankle_stride.DEFAULT if options is None else options
    side, time, leg = _leg(recording, side, options)
    count = int(leg.count)
    if not count:
        raise ValueError(f"the {side} leg makes no stride")
    number = count // 2 if stride is None else stride
    if not 0 <= number < count:
        raise ValueError(f"stride must lie between 0 and {count - 1}; got {stride}")
    first, last = int(leg.begin[number]), int(leg.end[number])
    went = _integrated(leg, p, first, last, readout.lever_of(p, leg))
    when = time[first : last + 1]
    figure, axes = blank(3, 1, 7.2, 7.0, sharex=True)
    for axis, unit, name in zip(axes[:, 0], ROWS, ("acceleration", "velocity", "way"), strict=True):
        axis.axhline(0.0, color="0.5", linewidth=0.8)
        for k, (style, words) in enumerate(zip(AXES, ("forward", "to the left", "up"), strict=True)):
            if name != "acceleration":
                axis.plot(when, went[f"plain_{name}"][:, k], color=style["color"], **UNCORRECTED)
            axis.plot(when, went[name][:, k], label=words, **style)
        axis.set_ylabel(unit)
        axis.grid(alpha=0.3)
        axis.set_xlim(when[0], when[-1])
    axes[1, 0].plot([], [], label="before the correction", color="black", **UNCORRECTED)
    axes[-1, 0].set_xlabel("time [s]")
    length, rise = float(np.hypot(*went["way"][-1, :2])), float(went["way"][-1, 2])
    summary = (
        f"stride {number} of the {side} leg: {length:.2f} m, rise {100.0 * rise:.0f} cm, {when[-1] - when[0]:.2f} s"
    )
    legend(figure, f"{title}\n{summary}" if title else summary)
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


Integrals = tuple[steps.StrideState, Vector, Vector]
"""The integrals of a stride, its lever and the lever's velocity, in the axes of the first sample."""


@jax.jit
def _strapdown(p: StrideLengthParams, gyr: Array, acc: Array, dt: Scalar) -> Integrals:
    """The integrals of `stride_length` at each sample after the first; compiled once for each length."""
    nowhere = Marks(np.False_, np.False_)

    def one(state: steps.StrideState, sample: tuple[Array, Array]) -> tuple[steps.StrideState, Integrals]:
        state, _ = steps.stride_step(p, state, vector(sample[0]), vector(sample[1]), nowhere, dt)
        return state, (state, rotated(state.attitude, p.lever), rotated(state.attitude, cross(state.gyr, p.lever)))

    return lax.scan(one, steps.stride_begin(p, vector(gyr[0]), vector(acc[0])), (gyr[1:], acc[1:]))[1]


def _integrated(
    leg: "AnkleSignals", p: "AnkleParams", first: int, last: int, lever: Vector
) -> dict[str, np.ndarray]:  # fmt: skip
    """Acceleration, velocity and displacement (n, 3) of the ankle, forward, left, up; and the uncorrected integrals.

    With V and W the single and double integral of the specific force, v the velocity ω × r of the sensor about the
    ankle, and g a constant that gives the right velocity at the end, the ankle has W − g t²/2 + v(0) t − (R r − r).
    """
    rate_hz = float(leg.rate_hz)
    gyr, acc = (
        np.asarray(butterworth.low_pass_until(as_float(v), p.cutoff_hz, rate_hz, int(leg.last)))[first : last + 1]
        for v in (leg.gyr, leg.acc)
    )
    lever = Vector(*(np.asarray(float(part)) for part in lever))
    known = StrideLengthParams(lever=lever)
    gyr = gyr - as_float(leg.gyr_bias)
    state, arm, about = _strapdown(known, gyr, acc, 1.0 / rate_hz)
    t = np.arange(last - first + 1)[:, None] / rate_hz

    def rows(parts: Iterable[AnyArray], start: np.ndarray) -> np.ndarray:
        return np.concatenate([start[None], np.stack([as_float(part) for part in parts], axis=1)])

    nothing, r = np.zeros(3), np.array([float(part) for part in lever])
    force, single, double = rows(state.force, acc[0]), rows(state.velocity, nothing), rows(state.way, nothing)
    turned, round_ankle = rows(arm, r), rows(about, np.cross(gyr[0], r))
    mean = (single[-1] - round_ankle[-1] + round_ankle[0]) / t[-1]
    way = double - 0.5 * mean * t**2 + round_ankle[0] * t - (turned - r)
    velocity = single - mean * t + round_ankle[0] - round_ankle
    up = mean / np.linalg.norm(mean)
    forward = way[-1] - up * (way[-1] @ up)
    forward = forward / max(float(np.linalg.norm(forward)), 1e-9)
    axes = np.stack([forward, np.cross(up, forward), up])
    result = {
        "acceleration": force - mean - np.gradient(round_ankle, 1.0 / rate_hz, axis=0),
        "velocity": velocity,
        "way": way,
        "plain_velocity": single - acc[0] * t,
        "plain_way": double - 0.5 * acc[0] * t**2,
    }
    return {name: values @ axes.T for name, values in result.items()}
