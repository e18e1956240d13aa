"""A figure of the trunk in walking: its accelerations with the initial contacts of both feet.

Right contacts are black dots, left contacts light blue squares: they differ in lightness and shape, also in grey.
"""

import numpy as np
from jax import Array

from jgait.estimators.programs import bucket, compiled
from jgait.events.trunk import PAPER_RATE, PaperRule, Peaks, details, initial_contacts
from jgait.plot.style import FOOT, FOOTHOLD, GROUND, Figure, Style, legend, panels, windowed
from jgait.types import SIDES, Estimate, as_float

INTEREST: Style = {"color": "0.91", "label": "interval of interest", **GROUND}
RULE = PaperRule()


def trunk_contacts(estimate: Estimate, *, wavelet: bool = True, title: str = "") -> Figure:
    """The trunk's accelerations, their reconstruction from wavelet details, and the contacts of both feet, for four
    seconds.

    The estimate is of `waist`. Grey background marks the interval of interest, in which the paper searches the largest
    forward acceleration; wavelet and interval are the paper's, and left out without `wavelet`. Raises ValueError if the
    estimate has no contacts, or no accelerations of the trunk.
    """
    contacts = contacts_of(estimate)
    if "trunk_acceleration" not in estimate.diagnostics:
        raise ValueError("the estimate has no accelerations of the trunk; it should be an estimate of `waist` alone")
    time, trunk = as_float(estimate.time), as_float(estimate.diagnostics["trunk_acceleration"])
    every = np.sort(np.concatenate(list(contacts.values())))
    middle = float(every[every.size // 2])
    first, last = max(float(time[0]), middle - 2.0), min(float(time[-1]), middle + 2.0)
    at, rebuilt, peaks = _wavelet(time, trunk) if wavelet else (np.zeros(0), trunk[:0], np.zeros(0))
    kept, fine = (windowed(t, (first, last)) for t in (time, at))
    figure, axes = panels(3, 1, 8.8, 6.8, sharex=True)
    for peak in peaks:
        axes[0, 0].axvspan(peak - RULE.before, peak + RULE.after, **INTEREST)
    rows = ((0, "forward [m/s²]"), (2, "upward [m/s²]"), (1, "to the left [m/s²]"))
    for axis, (column, unit) in zip(axes[:, 0], rows, strict=True):
        raw = trunk[:, column]
        axis.plot(time[kept], raw[kept], color="0.6", linewidth=1.0, label="acceleration")
        if wavelet:
            axis.plot(at[fine], rebuilt[fine, column], color="black", linewidth=1.9, label="its wavelet details")
        for side, times in contacts.items():
            of_side = times[windowed(times, (first, last))]
            for when in of_side:
                axis.axvline(when, zorder=1.5, **FOOT[side], linestyle="-" if side == "right" else (0, (5, 1.5)))
            axis.plot(of_side, np.interp(of_side, time, raw), label=f"{side} contact", zorder=3.0,
                      **{**FOOTHOLD[side], "markersize": 6.0})  # fmt: skip
        axis.set_ylabel(unit)
        axis.set_xlim(first, last)
        axis.set_xticks(np.arange(np.ceil(first / 0.2), np.floor(last / 0.2) + 1.0) * 0.2, minor=True)
        axis.grid(alpha=0.18, which="minor", axis="x")
    axes[-1, 0].set_xlabel("time [s]")
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


def _wavelet(time: np.ndarray, trunk: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s] at the paper's sampling rate, the wavelet details of (T, 3) accelerations there, and peaks [s]."""
    count, rate = len(time), round(1.0 / float(np.median(np.diff(time))), 2)
    padded = np.pad(trunk, [(0, bucket(count) - count), (0, 0)])
    measured = np.arange(len(padded)) < count
    kept = np.asarray(compiled(details)(padded, measured, sampling_rate_hz=rate, p=RULE))
    kept = kept[: int(count * PAPER_RATE / rate)]
    peaks, valid = compiled(_times)(padded[:, 0], padded[:, 2], measured, rate=rate)
    return time[0] + np.arange(len(kept)) / PAPER_RATE, kept, time[0] + as_float(peaks)[np.asarray(valid)]


def _times(forward: Array, upward: Array, measured: Array, rate: float) -> tuple[Array, Array]:
    """Peak of the low-passed forward acceleration before each contact, and which of the entries are valid."""
    # sides are not needed here, so no yaw rate is needed
    contacts = initial_contacts(forward, upward, forward, rate, Peaks(0.0), mask=measured)
    return contacts.time, contacts.valid
