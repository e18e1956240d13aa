"""Whether a reference, its clock and its sides are those of the recording, by all that both measure."""

from collections.abc import Callable
from functools import partial

import numpy as np

from jgait.notes import Kind, Note
from jgait.types import SIDES, Estimate, Feet, Legs, as_float

type Search = Callable[[Estimate, Estimate, np.ndarray], np.ndarray | None]
"""(estimate, reference, shifts of the reference [s]) → (shifts,) error; None where one of the two lacks something."""

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

STRIDE_S = 0.6
"""[s] Duration of a short stride: offsets this far from the one nearest to 0 belong to another stride."""

OFFSET_S = 0.1
"""[s] Least offset that is noted; contacts differ by less where two methods define them."""

SWING = (0.5, 0.9)
"""[1] Part of a stride in which a knee is bent most; chosen wide, so that it holds for slow and fast walking, stiff
legs, shuffling and running."""

SCATTER = 0.1
"""[1] Largest difference of that moment from its median over the strides of a leg; chosen, far above that of most."""

BETTER = 0.5
"""[1] Largest part of the error, or of the contacts that do not match, that is left with the offset that is noted.
Without such an offset, a reference is noted if this part of its error is above that of `CHECKS`; chosen."""

MOST_SAMPLES = 3000
"""Largest number of samples of a reference whose signals are compared."""

DISTANCE_M = 1.0
"""[m] Least distance whose course is compared."""

STRIDES, STRIDES_OF_LEG = 3, 100
"""Least number of strides whose contacts or swings are compared, and largest number of a leg for its swings."""


def clock_notes(estimate: Estimate, reference: Estimate) -> tuple[Note, ...]:
    """A note for each part of a reference that agrees with an estimate much better with exchanged sides, or else at
    other times, or never.

    What both have is compared, of `CHECKS`; a reference of samples and strides is of two files, of which one can be
    wrong. Distances, which tell least, are compared where nothing else is noted.
    """
    notes = tuple(note for check in CHECKS for note in _checked(estimate, reference, *check))
    return notes or _checked(estimate, reference, *OF_DISTANCES)


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
    least = shifts[error <= error.min() + 1e-9]  # contacts agree as well over some shifts, and a whole stride later
    best = float(np.mean(least[np.abs(least - least[np.argmin(np.abs(least))]) < STRIDE_S]))
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


def _knee(estimate: Estimate, side: str) -> np.ndarray | None:
    """(T,) flexion of a knee [rad]."""
    leg = getattr(estimate.legs, side)
    return None if leg is None else as_float(leg.knee_angle)


def _speed(estimate: Estimate, side: str) -> np.ndarray | None:
    """(T,) horizontal speed of a foot [m/s]."""
    foot = None if estimate.feet is None else getattr(estimate.feet, side)
    if foot is None or np.size(estimate.time) < 2:
        return None
    return np.hypot(*np.gradient(as_float(foot.position)[:, :2], as_float(estimate.time), axis=0).T)


def _of_signal(
    signal: Callable[[Estimate, str], np.ndarray | None], estimate: Estimate, reference: Estimate, shifts: np.ndarray
) -> np.ndarray | None:
    """(shifts,) standard deviation of the difference of a signal, the reference shifted [s]; None without both.

    A shift that leaves less than half of the samples in common counts as no agreement.
    """
    errors = []
    known, valid = np.asarray(reference.valid, bool), np.asarray(estimate.valid, bool)
    if not known.any() or not valid.any():
        return None
    rows = np.flatnonzero(known)[:: -(-int(known.sum()) // MOST_SAMPLES)]
    time, ours_at = as_float(reference.time)[rows], as_float(estimate.time)[valid]
    for side in SIDES:
        ours, theirs = signal(estimate, side), signal(reference, side)
        if ours is None or theirs is None:
            continue
        at = time[None, :] + shifts[:, None]
        there = (at >= ours_at[0]) & (at <= ours_at[-1])
        gap = np.where(there, np.interp(at, ours_at, ours[valid]) - theirs[rows], np.nan)
        enough = there.sum(axis=1) > 0.5 * len(time)
        spread = np.full(len(shifts), np.inf)
        spread[enough] = np.nanstd(gap[enough], axis=1)
        errors.append(spread)
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


def _of_contacts(estimate: Estimate, reference: Estimate, shifts: np.ndarray) -> np.ndarray | None:
    """(shifts,) share of the reference's contacts, shifted [s], without a contact of the estimate near."""
    ours, theirs = estimate.strides, reference.strides
    if ours is None or theirs is None or ours.end is None or theirs.end is None:
        return None
    lacking, count = np.zeros(len(shifts)), 0
    for number in range(len(SIDES)):
        estimated, true = (
            as_float(strides.end)[np.asarray(strides.valid, bool) & (np.asarray(strides.side) == number)]
            for strides in (ours, theirs)
        )
        if estimated.size and true.size:
            ends, at = np.concatenate([[-np.inf], np.sort(estimated), [np.inf]]), true + shifts[:, None]
            following = np.searchsorted(ends, at)
            apart = np.minimum(ends[following] - at, at - ends[following - 1])
            lacking += np.sum(apart > OFFSET_S, axis=1)
            count += true.size
    return lacking / count if count >= STRIDES else None


def _of_swings(estimate: Estimate, reference: Estimate, shifts: np.ndarray) -> np.ndarray | None:
    """(shifts,) share of the reference's strides, shifted [s], in which the estimate's knee is not bent most in the
    swing, or at another part of the stride than in most; None without knees or strides.
    """
    strides, valid = reference.strides, np.asarray(estimate.valid, bool)
    if strides is None or strides.start is None or strides.end is None or not valid.any():
        return None
    time, part = as_float(estimate.time)[valid], np.linspace(0.0, 1.0, 51)
    lacking, count = np.zeros(len(shifts)), 0
    for number, side in enumerate(SIDES):
        knee = _knee(estimate, side)
        leg_strides = np.flatnonzero(np.asarray(strides.valid, bool) & (np.asarray(strides.side) == number))
        if knee is None or not leg_strides.size:
            continue
        end = as_float(strides.end)[leg_strides]
        lasts = float(np.median(end - as_float(strides.start)[leg_strides]))  # a first stride from standing begins late
        end = end[:: -(-end.size // STRIDES_OF_LEG)]
        for row, shift in enumerate(shifts):
            at = (end + shift - lasts)[:, None] + lasts * part
            most = part[np.argmax(np.interp(at, time, knee[valid]), axis=1)]
            swings = (most > SWING[0]) & (most < SWING[1]) & (np.abs(most - np.median(most)) < SCATTER)
            lacking[row] += np.sum(~swings | (at[:, 0] < time[0]) | (at[:, -1] > time[-1]))
        count += end.size
    return lacking / count if count >= STRIDES else None


def _of_their_swings(estimate: Estimate, reference: Estimate, shifts: np.ndarray) -> np.ndarray | None:
    """As `_of_swings`, of the estimate's strides and the reference's knee."""
    return _of_swings(reference, estimate, -shifts)


CHECKS: tuple[tuple[str, float, Search], ...] = (
    ("the knee's angles", np.deg2rad(8.0), partial(_of_signal, _knee)),
    ("contacts", 0.3, _of_contacts),
    ("speeds of the feet", 0.4, partial(_of_signal, _speed)),
    ("contacts", 0.3, _of_swings),
    ("the knee's angles", 0.3, _of_their_swings),
)
OF_DISTANCES: tuple[str, float, Search] = ("distances", 0.05, _of_way)
"""What is compared, the error below which it agrees, and how. Errors are differences of knees about their means [rad],
differences of speeds of feet [m/s], differences over the whole distance, and shares of contacts, or of swings, that do
not match."""
