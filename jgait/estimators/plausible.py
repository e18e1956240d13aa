"""Results that no person can have walked: strides, speeds, knees, widths and heights, each with its likely causes."""

from typing import NamedTuple

import numpy as np

from jgait.notes import Kind, Note
from jgait.types import SIDES, Estimate, Strides, as_float

FASTEST_RUN = 8.0
"""[m/s] Fastest running over a distance; chosen."""

QUICK_S = 0.75
"""[s] Strides that last less are of running (160 steps a minute), or of small children, see `STRIDES_QUICK` of
`ankle_stride`."""

CAUSES = (
    "Likely causes: a wrong unit or sampling rate, a sensor at the limit of its range, samples that are lost or "
    "damaged, axes of one gyroscope turned round, or a sensor at another place than stated. Do not use these numbers."
)
"""Meaning of all these kinds."""

IMPLAUSIBLE = Kind("implausible", "check", "", CAUSES)
KNEE_IMPLAUSIBLE = Kind(
    "knee_implausible",
    "stop",
    "",
    f"{CAUSES} Knees that bend the wrong way on both sides can also mean that the person walks backwards.",
    measure="joint angles",
)


def implausible(estimate: Estimate) -> tuple[Note, ...]:
    """Notes about results that no person can have walked, in an estimate without padding; on the host."""
    notes: list[Note] = []
    if estimate.strides is not None:
        notes += _strides(estimate.strides, estimate.strides_stddev)
    worn = np.asarray(estimate.valid, bool)
    for side, knee in knees(estimate).items():
        notes += knee_notes(estimate, side)
        leg = getattr(estimate.legs, side)
        angles = (np.rad2deg(as_float(angle)[worn]) for angle in (leg.knee_angle, leg.hip_angle))
        moves = [0.0 if knee.lost or not a.size else float(np.ptp(np.percentile(a, (1, 99)))) for a in angles]
        if moves[0] < 5.0 and moves[1] > 20.0:  # [°] chosen
            text = (
                "{side}: the knee moves by {knee:.0f}° only, while the hip swings by {hip:.0f}°: both sensors can "
                "be on one segment, or have one signal under two names, unless an orthosis locks the knee"
            )
            notes.append(IMPLAUSIBLE.note(text, side=side, knee=moves[0], hip=moves[1]))
    if too_fast(estimate):
        distance, seconds = _walked(estimate)
        text = "{distance:.4g} m in {seconds:.3g} s is faster than a person walks"
        notes.append(IMPLAUSIBLE.note(text, distance=distance, seconds=seconds))
    return tuple(notes)


class Knee(NamedTuple):
    """Knee angles of a leg that cannot be right, in the samples in which its sensors are worn."""

    lost: int  #: number of samples with an angle that is not finite.
    implausible: bool  #: True if the knee bends as none does in more than 1 % of the samples.
    angle: np.ndarray  #: the angles [°].
    share: float  #: share of the samples in which the knee bends as none does [1].


def knees(estimate: Estimate) -> dict[str, Knee]:
    """Side → what is wrong with its knee angles, of each measured leg."""
    measured, worn = {}, np.asarray(estimate.valid, bool)
    for side in SIDES:
        if (leg := getattr(estimate.legs, side)) is not None:
            angle = np.rad2deg(as_float(leg.knee_angle)[worn])
            # [°] what a knee does, with a margin of 10° and more for a wrong zero
            lost, beyond = int(np.sum(~np.isfinite(angle))), (angle < -20.0) | (angle > 160.0)
            share = float(beyond.mean()) if beyond.size else 0.0
            measured[side] = Knee(lost, not lost and share > 0.01, angle, share)
    return measured


def knee_notes(estimate: Estimate, side: str) -> list[Note]:
    """A note on a leg if it is measured, and its knee bends as none does, or its angles are not finite."""
    knee = knees(estimate).get(side)
    if knee is not None and knee.lost:
        text = "{side}: {samples} valid {samples:sample|samples} of the knee {samples:is|are} not finite"
        return [KNEE_IMPLAUSIBLE.note(text, side=side, samples=knee.lost)]
    if knee is None or not knee.implausible:
        return []
    text = (
        "{side}: the knee reaches {low:.0f} to {high:.0f}°; {percent:.0f} % of its samples are beyond what a knee does"
    )
    reaches = {"low": knee.angle.min(), "high": knee.angle.max(), "percent": max(100.0 * knee.share, 1.0)}
    return [KNEE_IMPLAUSIBLE.note(text, side=side, **reaches)]


def _walked(estimate: Estimate) -> tuple[float, float]:
    """Distance [m] and duration [s] of the valid samples of an estimate."""
    valid = np.asarray(estimate.valid, bool)
    return float(as_float(estimate.distance)[valid][-1]), float(np.ptp(as_float(estimate.time)[valid]))


def too_fast(estimate: Estimate) -> bool:
    """True if no person runs the distance of an estimate in its time."""
    if estimate.distance is None or not np.any(estimate.valid):
        return False
    distance, seconds = _walked(estimate)
    return not distance <= FASTEST_RUN * max(seconds, 1.0)


def distance_implausible(estimate: Estimate) -> bool:
    """True if no person can have walked the distance of an estimate, or the strides whose sum it is."""
    strides = estimate.strides
    return too_fast(estimate) or (
        strides is not None and bool((impossible(strides) & np.asarray(strides.valid, bool)).any())
    )


def impossible(strides: Strides) -> np.ndarray:
    """(n,) bool, strides that are longer or faster than a person walks or runs, or whose length is not finite.

    Race walkers take strides of 2.4 m, and reach 4.3 m/s over a kilometre. A stride of 0.95 s or more is walked:
    runners take more than 126 steps a minute.
    """
    length, last, speed = _paces(strides)
    walked = ~(last < 0.95)
    wrong = (walked & ((length > 2.5) | (speed > 4.0))) | (speed > FASTEST_RUN)
    return np.asarray(wrong | ~np.isfinite(length))


def _paces(strides: Strides) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Length [m], duration [s] and speed [m/s] of strides; NaN where they are not known."""
    length = as_float(strides.length)
    last = np.full(length.shape, np.nan)
    if strides.start is not None and strides.end is not None:
        last = as_float(strides.end) - as_float(strides.start)
    speed = as_float(strides.speed) if strides.speed is not None else length / np.where(last > 0.0, last, np.nan)
    return length, last, speed


def _strides(strides: Strides, stddev: Strides | None) -> list[Note]:
    """Notes about the strides of both feet; a width counts as negative if it is below 0 by two standard deviations."""
    notes = []
    used, wrong = np.asarray(strides.valid, bool), impossible(strides)
    length, last, speed = _paces(strides)
    height, width = as_float(strides.height), as_float(strides.width)
    for number, side in enumerate(SIDES):
        of_side = used & (np.asarray(strides.side) == number)
        if (far := of_side & wrong).any():
            text = (
                "{side}: {strides} of {of} strides {strides:is|are} longer or faster than a person walks, up to "
                "{length:.3g} m and {speed:.3g} m/s"
            )
            largest = {"length": np.nanmax(length[far]), "speed": np.nanmax(np.nan_to_num(speed[far]))}
            notes.append(IMPLAUSIBLE.note(text, side=side, strides=far.sum(), of=of_side.sum(), **largest))
        product = (length * last)[of_side & ~wrong & np.isfinite(last)]
        # [m s] people take longer steps faster: 1.6 at usual speeds (Sekiya and Nagasaki 1998: 0.0065 m a step per step
        # a minute), at most 2.0 in walks of five public sets
        if len(product) >= 4 and np.median(product) > 2.4:
            text = "{side}: strides of {length:.2f} m that last {last:.2f} s; nobody takes so long steps so slowly"
            middle = {"length": np.nanmedian(length[of_side]), "last": np.nanmedian(last[of_side])}
            notes.append(IMPLAUSIBLE.note(text, side=side, **middle))
        rise, gone = float(np.nansum(height[of_side])), float(np.nansum(length[of_side]))
        if abs(rise) > max(0.5, gone):  # strides on stairs rise by 0.6 of their length
            text = "{side}: the foot rises by {rise:.2f} m over {length:.3g} m, steeper than stairs"
            notes.append(IMPLAUSIBLE.note(text, side=side, rise=rise, length=gone))
    spread = np.zeros_like(width) if stddev is None or stddev.width is None else as_float(stddev.width)
    negative = used & (width < -2.0 * np.nan_to_num(spread))
    if negative.any():
        text = "{strides} of {of} strides {strides:has|have} a negative width: left and right may be exchanged"
        notes.append(IMPLAUSIBLE.note(text, strides=negative.sum(), of=used.sum()))
    return notes
