"""A figure of the trunk in walking: its accelerations with the initial contacts of both feet.

Right contacts are black dots, left contacts light blue squares: they differ in lightness and shape, also in grey.
`jgait.plot` has the function; it returns the matplotlib figure.
"""

from typing import NamedTuple

import numpy as np
from jax import Array

from jgait.estimators import waist
from jgait.estimators.axes import pad
from jgait.estimators.programs import bucket, compiled
from jgait.estimators.waist.inputs import WaistInputs
from jgait.estimators.waist.motion import motion, motion_and_likelihood
from jgait.estimators.waist.params import WaistOptions, WaistParams
from jgait.estimators.waist.prepare import SILENCE
from jgait.events.trunk import PAPER_RATE, PaperRule, Peaks, details, initial_contacts
from jgait.plot.style import (
    BLUE,
    FOOTHOLD,
    GROUND,
    Axes,
    Figure,
    Style,
    blank,
    legend,
    over_time,
    windowed,
)
from jgait.types import SIDES, Estimate, Recording, as_float

RAW: Style = {"color": "0.6", "linewidth": 1.0}
REBUILT: Style = {"color": "black", "linewidth": 1.9}
INTEREST: Style = {"color": "0.91", "label": "interval of interest", **GROUND}
CONTACT: dict[str, Style] = {
    "right": {"color": "black", "linewidth": 1.0, "zorder": 1.5},
    "left": {"color": BLUE, "linewidth": 1.5, "linestyle": (0, (5, 1.5)), "zorder": 1.5},
}
RULE = PaperRule()
SHOWN_S = 4.0
"""[s] Length of the window that is drawn, about the middle contact."""

TICK_S = 0.2
"""[s] Distance of the ticks of a short time axis."""

ROWS = (("forward", "forward [m/s²]"), ("upward", "upward [m/s²]"), ("left", "to the left [m/s²]"))


class Trunk(NamedTuple):
    """Accelerations of the trunk in a recording [m/s²], (T,) each, without gravity and padding; and the inputs."""

    time: np.ndarray
    forward: np.ndarray
    left: np.ndarray
    upward: np.ndarray
    inputs: "WaistInputs"


def moves(recording: Recording, p: "WaistParams", options: "WaistOptions", *, smooth: bool) -> Trunk:
    """Accelerations of the trunk in a recording, as the estimator `waist` computes them.

    `smooth` uses later samples too: True for distances, False for contacts.

    Raises:
        RecordingError: as `waist.estimate`.
    """
    inputs = waist.prepared(recording, options).inputs
    count = np.size(inputs.time)
    padded = pad(inputs, bucket(count + round(SILENCE * recording.sampling_rate_hz)))
    # without smoothing it is the program that `prepared` has run
    moved = compiled(motion)(p, padded, smooth=True) if smooth else compiled(motion_and_likelihood)(p, padded)[0]
    forward, left, upward = (as_float(values)[:count] for values in (moved.forward, moved.left, moved.upward))
    return Trunk(as_float(inputs.time), forward, left, upward, padded)


def trunk_contacts(
    recording: Recording,
    estimate: Estimate,
    *,
    p: "WaistParams | None" = None,
    options: "WaistOptions | None" = None,
    wavelet: bool = True,
    title: str = "",
) -> Figure:
    """The trunk's accelerations forward, up and left, their reconstruction from wavelet details, and the contacts of
    both feet.

    The estimate is of `waist` for this recording, with these parameters and options. Grey background
    marks the interval of interest, in which the paper searches the largest forward acceleration; wavelet and interval
    are the paper's, and left out without `wavelet`. Four seconds about the middle contact are drawn.

    Raises:
        ValueError: if the estimate has no contacts.
        RecordingError: as `waist.estimate`.
    """
    contacts = contacts_of(estimate)
    first, last = _window(as_float(estimate.time), np.concatenate(list(contacts.values())))
    p, options = waist.WaistParams() if p is None else p, waist.DEFAULT if options is None else options
    trunk = moves(recording, p, options, smooth=False)
    at, rebuilt = _rebuilt(trunk, recording.sampling_rate_hz) if wavelet else (np.zeros(0), {})
    peaks = _peaks(trunk, recording.sampling_rate_hz) if wavelet else ()
    kept, fine = (windowed(t, (first, last)) for t in (trunk.time, at))
    figure, axes = blank(len(ROWS), 1, 8.8, 6.8, sharex=True)
    for axis, (field, unit) in zip(axes[:, 0], ROWS, strict=True):
        for peak in peaks if field == "forward" else ():
            axis.axvspan(peak - RULE.before, peak + RULE.after, **INTEREST)
        raw = getattr(trunk, field)
        axis.plot(trunk.time[kept], raw[kept], label="acceleration", **RAW)
        if wavelet:
            axis.plot(at[fine], rebuilt[field][fine], label="its wavelet details", **REBUILT)
        _drawn(axis, trunk.time, raw, contacts, (first, last))
        axis.set_ylabel(unit)
        axis.set_xlim(first, last)
        axis.set_xticks(np.arange(np.ceil(first / TICK_S), np.floor(last / TICK_S) + 1.0) * TICK_S, minor=True)
        axis.grid(alpha=0.18, which="minor", axis="x")
    over_time(axes[:, 0])
    legend(figure, title)
    return figure


def contacts_of(estimate: Estimate) -> dict[str, np.ndarray]:
    """Side → times of its initial contacts [s]. Raises ValueError if the estimate has no contacts."""
    diagnostics = estimate.diagnostics
    if "initial_contact" not in diagnostics or "initial_contact_side" not in diagnostics:
        raise ValueError("the estimate has no initial contacts at the trunk; it should be an estimate of `waist`")
    when, side = as_float(diagnostics["initial_contact"]), np.asarray(diagnostics["initial_contact_side"])
    there = np.asarray(diagnostics.get("initial_contact_valid", np.ones(when.shape, bool)), bool)
    if not there.any():
        raise ValueError("there is no initial contact to draw")
    return {name: when[there & (side == number)] for number, name in enumerate(SIDES)}


def _window(time: np.ndarray, contacts: np.ndarray) -> tuple[float, float]:
    """From and to [s]: four seconds about the middle contact."""
    middle = float(np.sort(contacts)[contacts.size // 2])
    return max(float(time[0]), middle - 0.5 * SHOWN_S), min(float(time[-1]), middle + 0.5 * SHOWN_S)


def _rebuilt(trunk: Trunk, rate: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times [s] at the paper's sampling rate of the wavelet, and the wavelet details of each acceleration."""
    count = len(trunk.time)
    measured = np.asarray(trunk.inputs.measured, bool)[:count]
    signals = np.stack([getattr(trunk, field) for field, _ in ROWS], axis=1)
    signals, measured = (np.pad(v, [(0, bucket(count) - count)] + [(0, 0)] * (v.ndim - 1)) for v in (signals, measured))
    kept = np.asarray(compiled(details)(signals, measured, sampling_rate_hz=float(rate), p=RULE))
    kept = kept[: int(count * PAPER_RATE / rate)]
    time = trunk.time[0] + np.arange(len(kept)) / PAPER_RATE
    return time, {field: kept[:, k] for k, (field, _) in enumerate(ROWS)}


def _times(forward: Array, upward: Array, measured: Array, rate: float) -> tuple[Array, Array]:
    """Peak of the low-passed forward acceleration before each contact, and which of the entries are valid."""
    # sides are not needed here, so no yaw rate is needed
    contacts = initial_contacts(forward, upward, forward, rate, Peaks(0.0), mask=measured)
    return contacts.time, contacts.valid


def _peaks(trunk: Trunk, rate: float) -> np.ndarray:
    """Times [s] of the peaks of the low-passed forward acceleration, the centres of the intervals of interest."""
    measured = np.asarray(trunk.inputs.measured, bool)
    forward, upward = (np.pad(v, (0, measured.size - v.size)) for v in (trunk.forward, trunk.upward))
    time, valid = compiled(_times)(forward, upward, measured, rate=float(rate))
    return trunk.time[0] + as_float(time)[np.asarray(valid)]


def _drawn(
    axis: Axes, time: np.ndarray, raw: np.ndarray, contacts: dict[str, np.ndarray], span: tuple[float, float]
) -> None:
    """Draw contacts of both feet as vertical lines and as marks on the acceleration."""
    for side, times in contacts.items():
        of_side = times[windowed(times, span)]
        for when in of_side:
            axis.axvline(when, **CONTACT[side])
        axis.plot(of_side, np.interp(of_side, time, raw), label=f"{side} contact", zorder=3.0,
                  **{**FOOTHOLD[side], "markersize": 6.0})  # fmt: skip
