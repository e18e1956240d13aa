"""Figures of gait per stride from sensor signals in plain arrays, simulated or recorded.

A stride runs from one middle of a swing to the next: from peak to peak of the shank's (without
one, the foot's) sagittal rate, low-passed at `SEGMENT_HZ`. The sagittal rate is about the axis on which the gyroscope
turns most (the first principal component), positive where the distal end of the segment swings forward. Rates and the
pelvis' acceleration are low-passed at `CUTOFF_HZ`; accelerations at heel strike are not, so they depend on the
sampling rate, the range (16 g on the shoes) and the mounting: sample a simulated signal like the recording's.

Initial contact, by the gyroscope, is the first trough of the rate after the middle of the swing; final contact the
deepest trough between it and the next swing. Both lie near the true ones but not on them: `stance_gyr` is 0.02 to 0.11
shorter than a reference's `stance`, and is compared with the same figure of a simulation.
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import find_peaks

from experiments.common.signals import low_pass

SEGMENT_HZ = 4.0
CUTOFF_HZ = 15.0
STRIDE_TIME = (0.6, 2.0)  # [s]
THIGH_LEAD = 0.16  # [s] by which the thigh swings forward before the shank
STRIKE = 0.1  # [s] around initial contact in which the acceleration's peak is looked for


class Figures(NamedTuple):
    """Figures of gait, each (n,) over strides; empty where the data do not contain it; n differs.

    Attributes:
        speed: [m/s] distance over time.
        stride_time: [s].
        stride_length: [m] distance from one middle of a swing to the next.
        stride_width: [m] of the heels.
        stance: [1] part of the stride in which the foot is on the ground, by a reference.
        stance_gyr: [1] the same by the shank's (or foot's) gyroscope.
        shank_swing: [rad/s] largest rate of the shank, in swing.
        shank_back: [rad/s] most negative rate of the shank between initial and final contact, both included.
        thigh_forward: [rad/s] largest rate of the thigh.
        thigh_back: [rad/s] most negative rate of the thigh.
        foot_push_off: [rad/s] most negative rate of the foot, heel up.
        foot_swing: [rad/s] largest rate of the foot, toe up.
        shank_strike: [m/s²] largest magnitude of the shank's specific force around initial contact.
        foot_strike: [m/s²] of the foot's.
        pelvis_acc_range: [m/s²] largest minus smallest vertical acceleration of the pelvis.
        pelvis_rise: [m] highest minus lowest position of the pelvis.
        hip_range: [rad] of the thigh's angle from the vertical.
        knee_range: [rad] of the knee's flexion.
    """

    speed: np.ndarray
    stride_time: np.ndarray
    stride_length: np.ndarray
    stride_width: np.ndarray
    stance: np.ndarray
    stance_gyr: np.ndarray
    shank_swing: np.ndarray
    shank_back: np.ndarray
    thigh_forward: np.ndarray
    thigh_back: np.ndarray
    foot_push_off: np.ndarray
    foot_swing: np.ndarray
    shank_strike: np.ndarray
    foot_strike: np.ndarray
    pelvis_acc_range: np.ndarray
    pelvis_rise: np.ndarray
    hip_range: np.ndarray
    knee_range: np.ndarray


NONE = Figures(*(np.zeros(0) for _ in Figures._fields))
STRIKES = ("shank_strike", "foot_strike")


class Truth(NamedTuple):
    """What else is known of a walk, each (T,) on the sensors' clock or None.

    Attributes:
        distance: [m] walked.
        contact: bool, this leg's foot on the ground.
        hip: [rad] angle of the thigh from the vertical.
        knee: [rad] flexion.
        height: [m] of the pelvis.
    """

    distance: Any = None
    contact: Any = None
    hip: Any = None
    knee: Any = None
    height: Any = None


class Strides(NamedTuple):
    """Samples of each stride: middle of the swing, initial contact, final contact, middle of the next swing, (n,)."""

    start: np.ndarray
    contact: np.ndarray
    off: np.ndarray
    end: np.ndarray


def principal_rate(gyr: np.ndarray, rate_hz: float, windows: Sequence[tuple[int, int]]) -> np.ndarray:
    """(T,) [rad/s], low-passed, about the axis on which the sensor turns most in the windows; its sign is open."""
    smooth = low_pass(gyr, CUTOFF_HZ, rate_hz)
    walked = np.concatenate([smooth[start:end] for start, end in windows])
    return smooth @ np.linalg.svd(walked, full_matrices=False)[2][0]


def swing_sign(segment: str, rate: np.ndarray, rate_hz: float, windows: Sequence[tuple[int, int]]) -> float:
    """+1 if the rate of a shank or foot is positive in swing.

    A shank's swing is the fastest that it does, and short. A foot may push off faster than it swings; but its swing
    follows push-off soon, and the next push-off comes a stance later.
    """
    parts = [low_pass(rate, SEGMENT_HZ, rate_hz)[start:end] for start, end in windows]
    if segment == "shank":
        return 1.0 if sum(float((part**3).sum()) for part in parts) >= 0 else -1.0
    early = []
    for part in parts:
        tops, troughs = _tops(part, rate_hz), _tops(-part, rate_hz)
        for top in tops:
            before, after = troughs[troughs < top], troughs[troughs > top]
            if len(before) and len(after):
                early.append((top - before[-1]) < (after[0] - top))
    return 1.0 if np.mean(early or [True]) >= 0.5 else -1.0


def sagittal_rates(
    sensors: Mapping[str, tuple[Any, Any]], rate_hz: float, windows: Sequence[tuple[int, int]]
) -> tuple[str, dict[str, np.ndarray]]:
    """The segment that strides are found by, shank or foot, and the rate of each segment but the pelvis (T,) [rad/s]:
    see `principal_rate`, positive in swing.

    Raises:
        ValueError: if there is neither a shank nor a foot.
    """
    leader = next((segment for segment in ("shank", "foot") if segment in sensors), None)
    if leader is None:
        raise ValueError(f"strides need 'shank' or 'foot'; got {sorted(sensors)}")
    rates = {s: principal_rate(np.asarray(sensors[s][0]), rate_hz, windows) for s in sensors if s != "pelvis"}
    lead = rates[leader] = rates[leader] * swing_sign(leader, rates[leader], rate_hz, windows)
    walked = np.concatenate([np.arange(start, end) for start, end in windows])
    for segment, seconds in (("thigh", THIGH_LEAD), ("foot", 0.0)):
        if segment in rates and segment != leader:
            later = np.minimum(walked + round(seconds * rate_hz), len(lead) - 1)
            rates[segment] = rates[segment] * np.sign(rates[segment][walked] @ lead[later])
    return leader, rates


def find_strides(
    rate: np.ndarray, rate_hz: float, windows: Sequence[tuple[int, int]], trim: int = 0, good: np.ndarray | None = None
) -> Strides:
    """Strides in the windows from a shank's (or foot's) sagittal rate, positive in swing.

    Args:
        rate: (T,) [rad/s].
        rate_hz: sampling rate [Hz].
        windows: (start, end) [samples], half-open; each is cut into strides on its own.
        trim: strides left out at both ends of each window, where a walk starts and stops.
        good: (T,) bool; a stride with a sample that is not good is left out.

    Returns:
        The strides.
    """
    slow = low_pass(rate, SEGMENT_HZ, rate_hz)
    rows = []
    for start, end in windows:
        tops = start + _tops(slow[start:end], rate_hz)
        tops = tops[trim : len(tops) - trim]
        for first, last in itertools.pairwise(tops):
            if not STRIDE_TIME[0] <= (last - first) / rate_hz <= STRIDE_TIME[1]:
                continue
            if good is not None and not good[first:last].all():
                continue
            part = rate[first : last + 1]
            troughs = find_peaks(-part)[0]
            early = troughs[(troughs < 0.45 * len(part)) & (part[troughs] < 0)]
            contact = early[0] if len(early) else int(np.argmin(part[: int(0.45 * len(part))]))
            late = int(0.55 * len(part))
            rows.append((first, first + contact, first + late + int(np.argmin(part[late:])), last))
    return Strides(*np.array(rows, np.int64).reshape(-1, 4).T)


def _tops(slow: np.ndarray, rate_hz: float) -> np.ndarray:
    if len(slow) < STRIDE_TIME[0] * rate_hz:
        return np.zeros(0, np.int64)
    height = 0.5 * np.percentile(slow, 98)
    return find_peaks(slow, height=max(height, 1e-9), distance=round(STRIDE_TIME[0] * rate_hz))[0]


def figures(
    sensors: Mapping[str, tuple[Any, Any]],
    rate_hz: float,
    windows: Sequence[tuple[int, int]],
    truth: Truth | None = None,
    *,
    trim: int = 0,
    good: np.ndarray | None = None,
) -> Figures:
    """Figures of one leg, per stride.

    Args:
        sensors: "shank", "thigh", "foot", "pelvis" → gyroscope (T, 3) [rad/s], accelerometer (T, 3) [m/s²] or None, in
            any axes; a shank or a foot is needed.
        rate_hz: sampling rate [Hz].
        windows: (start, end) [samples] of straight walking.
        truth: what else is known.
        trim: see `find_strides`.
        good: see `find_strides`.

    Returns:
        The figures; those that the sensors and the truth do not contain are empty.

    Raises:
        ValueError: if there is neither a shank nor a foot.
    """
    leader, rates = sagittal_rates(sensors, rate_hz, windows)
    lead = rates[leader]
    walked = np.concatenate([np.arange(start, end) for start, end in windows])
    strides = find_strides(lead, rate_hz, windows, trim, good)
    found = _of_truth(truth or Truth(), strides, rate_hz)
    time = strides.end - strides.start
    found |= {"stride_time": time / rate_hz, "stance_gyr": (strides.off - strides.contact) / time}
    for segment, rate in rates.items():
        found |= _of_segment(segment, rate, sensors[segment][1], strides, rate_hz)
    if "pelvis" in sensors:
        acc = np.asarray(sensors["pelvis"][1])
        up = acc[walked].mean(axis=0)
        vertical = low_pass(acc @ (up / np.linalg.norm(up)), CUTOFF_HZ, rate_hz)
        found["pelvis_acc_range"] = _range(vertical, strides)
    return NONE._replace(**found)


def _of_segment(segment: str, rate: np.ndarray, acc: Any, strides: Strides, rate_hz: float) -> dict[str, np.ndarray]:
    """Rates of a segment in each stride, and its largest specific force around initial contact."""
    largest = _over(np.max, rate, strides.start, strides.end)
    smallest = _over(np.min, rate, strides.start, strides.end)
    time = strides.end - strides.start
    # The swing lies around the stride's first sample: a segment's peak may come before it or after.
    swing = _over(np.max, rate, np.maximum(strides.start - time * 3 // 20, 0), strides.start + time // 4)
    if segment == "thigh":
        return {"thigh_forward": largest, "thigh_back": smallest}
    names = {"shank": ("shank_swing", "shank_back"), "foot": ("foot_swing", "foot_push_off")}[segment]
    if segment == "shank":
        smallest = _over(np.min, rate, strides.contact, strides.off + 1)
    found = dict(zip(names, (swing, smallest), strict=True))
    if acc is not None:
        size, reach = np.linalg.norm(np.asarray(acc), axis=1), round(STRIKE * rate_hz)
        strike = _over(np.max, size, np.maximum(strides.contact - reach, 0), strides.contact + reach + 1)
        found[f"{segment}_strike"] = strike
    return found


def _of_truth(truth: Truth, strides: Strides, rate_hz: float) -> dict[str, np.ndarray]:
    found = {}
    if truth.distance is not None:
        distance = np.asarray(truth.distance)
        found["stride_length"] = distance[strides.end] - distance[strides.start]
        found["speed"] = found["stride_length"] * rate_hz / (strides.end - strides.start)
    if truth.contact is not None:
        contact = np.asarray(truth.contact)
        # A foot on the ground in the middle of its swing is a sole that does not let go; such a stride is left out.
        swings = ~contact[strides.start] & ~contact[strides.end]
        found["stance"] = _over(np.mean, contact.astype(np.float64), strides.start[swings], strides.end[swings])
    for name, series in (("hip_range", truth.hip), ("knee_range", truth.knee), ("pelvis_rise", truth.height)):
        if series is not None:
            found[name] = _range(np.asarray(series), strides)
    return found


def _over(what: Any, series: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    return np.array([what(series[start:end]) for start, end in zip(starts, ends, strict=True)])


def _range(series: np.ndarray, strides: Strides) -> np.ndarray:
    return _over(np.ptp, series, strides.start, strides.end)


def pool(parts: Sequence[Figures]) -> Figures:
    """The strides of several legs or walks together."""
    return Figures(*(np.concatenate(columns) for columns in zip(*parts, strict=True))) if parts else NONE


def summary(strides: Figures) -> dict[str, float]:
    """Median of each figure that there is, and the 99th percentile of the accelerations at heel strike."""
    found = {name: float(np.median(values)) for name, values in strides._asdict().items() if len(values)}
    for name in STRIKES:
        if name in found:
            found[f"{name}_p99"] = float(np.percentile(getattr(strides, name), 99.0))
    return found
