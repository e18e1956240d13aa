"""Whether a reference, its clock and its sides are those of the recording, by all that both measure."""

from collections.abc import Callable
from functools import partial

import numpy as np

from jgait.notes import Kind, Note
from jgait.types import SIDES, Estimate, Feet, Legs, as_float

type Search = Callable[[Estimate, Estimate, np.ndarray], np.ndarray | None]
"""(estimate, reference, shifts of the reference [s]) → (shifts,) error; None where one of the two lacks something."""

type Signal = tuple[np.ndarray, np.ndarray, bool]
"""Times [s] and values of a signal, and whether it is 0 outside these times."""

REFERENCE_CLOCK = Kind(
    "reference_clock", "check", "{what} of the reference agree with the estimate if the reference is {seconds:.2f} s "
    "{when}",
    "The clock of the reference seems to begin at another time than the recording's. All errors against it are too "
    "large; correct the times of the reference. After a whole stride more or less, signals are alike again.",
)  # fmt: skip

REFERENCE_SIDES = Kind(
    "reference_sides", "check", "{what} of the reference agree with the estimate if its left and right are exchanged",
    "Left and right seem to be exchanged in the reference, or on the body. Errors of single strides and legs are wrong "
    "until that is corrected.",
)  # fmt: skip

REFERENCE_OTHER = Kind(
    "reference_other", "check", "{what} of the reference agree with the estimate at no time within {seconds:.0f} s",
    "The reference seems to be of another walk or person, as with files that were mixed up, or most of the estimate is "
    "wrong. Errors against it are too large until that is corrected.",
)  # fmt: skip

MOST_S, STEP_S = 5.0, 0.02
"""[s] Largest offset of a clock that is looked for, and step of the search."""

OFFSET_S = 0.1
"""[s] Least offset that is noted; contacts differ by less where two methods define them."""

SWING, WIDE = 0.7, 0.12
"""[1] Part of a stride in the middle of which a knee is bent most, and deviation of the pulse that stands for it."""

AGREES = 0.35
"""[1] One minus the correlation below which two signals agree; chosen above that of most recordings of public sets."""

BETTER = 0.5
"""[1] Largest part of the error that is left with the offset that is noted. Without such an offset, a reference is
noted if this part of its error is above `AGREES`; chosen."""

MOST_SAMPLES = 3000
"""Largest number of samples of a reference whose signals are compared."""

DISTANCE_M, DISTANCE_AGREES = 1.0, 0.05
"""[m] Least distance whose course is compared, and [1] difference over the whole distance below which it agrees."""

STRIDES = 3
"""Least number of strides of a leg whose contacts or swings are compared."""

COMPARED = (
    ("the knee's angles", "knee", "knee"), ("contacts", "contacts", "contacts"), ("speeds of the feet", "foot", "foot"),
    ("contacts", "knee", "swings"), ("the knee's angles", "swings", "knee"),
)  # fmt: skip
"""What is compared, and the signals of the estimate and of the reference, see `_signal`."""


def clock_notes(estimate: Estimate, reference: Estimate) -> tuple[Note, ...]:
    """A note for each part of a reference that agrees with an estimate much better with exchanged sides, or else at
    other times, or never.

    What both have is compared, of `COMPARED`; a reference of samples and strides is of two files, of which one can be
    wrong. Distances, which tell least, are compared where nothing else is noted.
    """
    searches = [(what, AGREES, partial(_of_signals, ours, theirs)) for what, ours, theirs in COMPARED]
    notes = tuple(note for search in searches for note in _checked(estimate, reference, *search))
    return notes or _checked(estimate, reference, "distances", DISTANCE_AGREES, _of_way)


def _checked(estimate: Estimate, reference: Estimate, what: str, agrees: float, search: Search) -> tuple[Note, ...]:
    shifts = np.arange(-MOST_S, MOST_S + 0.5 * STEP_S, STEP_S)
    now = search(estimate, reference, np.zeros(1))
    if now is None or not now[0] > agrees or (error := search(estimate, reference, shifts)) is None:
        return ()
    error = np.nan_to_num(error, nan=np.inf)
    mirrored = search(estimate, _exchanged(reference), np.zeros(1))
    if mirrored is not None and mirrored[0] <= min(agrees, BETTER * now[0], error.min()):
        return (REFERENCE_SIDES(what=what),)
    if error.min() > BETTER * now[0]:
        return (REFERENCE_OTHER(what=what, seconds=MOST_S),) if BETTER * now[0] > agrees else ()
    best = float(shifts[np.argmin(error + 1e-6 * np.abs(shifts))])
    note = REFERENCE_CLOCK(what=what, seconds=abs(best), when="later" if best > 0.0 else "earlier")
    return (note,) if abs(best) > OFFSET_S else ()


def _exchanged(reference: Estimate) -> Estimate:
    """The reference with left and right exchanged."""
    strides, feet = reference.strides, reference.feet
    return reference._replace(
        legs=Legs(reference.legs.left, reference.legs.right),
        strides=None if strides is None else strides._replace(side=1 - np.asarray(strides.side)),
        feet=None if feet is None else Feet(feet.left, feet.right),
    )


def _signal(estimate: Estimate, kind: str, side: str) -> Signal | None:
    """A signal of a leg and the times that it covers; None if the estimate lacks it.

    "knee": flexion of the knee; "foot": horizontal speed of the foot; "contacts": pulses at the contacts; "swings":
    pulses at the middles of the swings.
    """
    strides, valid = estimate.strides, np.asarray(estimate.valid, bool)
    if kind in ("contacts", "swings"):
        if strides is None or strides.start is None or strides.end is None:
            return None
        rows = np.asarray(strides.valid, bool) & (np.asarray(strides.side) == SIDES.index(side))
        end = np.sort(as_float(strides.end)[rows])
        if end.size < STRIDES:
            return None
        lasts = float(np.median(as_float(strides.end)[rows] - as_float(strides.start)[rows]))
        at, wide = (end, OFFSET_S) if kind == "contacts" else (end - (1.0 - SWING) * lasts, WIDE * lasts)
        grid = np.arange(at[0] - lasts, at[-1] + lasts, STEP_S)
        pulses = np.exp(-0.5 * (np.abs(grid - at[np.searchsorted(0.5 * (at[1:] + at[:-1]), grid)]) / wide) ** 2)
        return grid, pulses, True
    leg = getattr(estimate.legs, side) if kind == "knee" else getattr(estimate.feet or Feet(None, None), side)
    if leg is None or valid.sum() < 2:
        return None
    time = as_float(estimate.time)
    if kind == "knee":
        return time[valid], as_float(leg.knee_angle)[valid], False
    return time[valid], np.hypot(*np.gradient(as_float(leg.position)[:, :2], time, axis=0).T)[valid], False


def _of_signals(
    our_kind: str, their_kind: str, estimate: Estimate, reference: Estimate, shifts: np.ndarray
) -> np.ndarray | None:
    """(shifts,) one minus the correlation of two signals, the reference shifted [s]; None without both.

    A shift that leaves less than half of the samples in common counts as no agreement.
    """
    errors = []
    for side in SIDES:
        ours, theirs = _signal(estimate, our_kind, side), _signal(reference, their_kind, side)
        if ours is None or theirs is None:
            continue
        rows = slice(None, None, -(-theirs[0].size // MOST_SAMPLES))
        time, y = theirs[0][rows], theirs[1][rows]
        at = time + shifts[:, None]
        x = np.interp(at, *ours[:2], left=0.0 if ours[2] else np.nan, right=0.0 if ours[2] else np.nan)
        there = np.isfinite(x)
        count = np.maximum(there.sum(axis=1), 1)
        x, y = np.where(there, x, 0.0), np.where(there, y, 0.0)
        sums = [np.sum(part, axis=1) / count for part in (x, y, x * x, y * y, x * y)]
        spread = np.sqrt(np.maximum(sums[2] - sums[0] ** 2, 0.0) * np.maximum(sums[3] - sums[1] ** 2, 0.0))
        r = np.divide(sums[4] - sums[0] * sums[1], spread, out=np.full(len(shifts), np.nan), where=spread > 1e-12)
        errors.append(np.where(count > 0.5 * time.size, 1.0 - r, np.inf))
    return np.mean(errors, axis=0) if errors else None


def _of_way(estimate: Estimate, reference: Estimate, shifts: np.ndarray) -> np.ndarray | None:
    """(shifts,) difference of the distances so far, the reference shifted [s] and in any unit, over the whole distance;
    None without both, or if nobody goes a metre.
    """
    known, valid = np.asarray(reference.valid, bool), np.asarray(estimate.valid, bool)
    if estimate.distance is None or reference.distance is None or not known.any() or not valid.any():
        return None
    rows = np.flatnonzero(known)[:: -(-int(known.sum()) // MOST_SAMPLES)]
    theirs = as_float(reference.distance)[rows]
    if np.ptp(theirs) < DISTANCE_M:
        return None
    at = as_float(reference.time)[rows] + shifts[:, None]
    ours = np.interp(at, as_float(estimate.time)[valid], as_float(estimate.distance)[valid])
    ours, theirs = ours - ours.mean(axis=1, keepdims=True), theirs - theirs.mean()
    scale = (ours @ theirs) / np.maximum(np.sum(ours**2, axis=1), DISTANCE_M)
    return np.std(scale[:, None] * ours - theirs, axis=1) / np.ptp(theirs)
