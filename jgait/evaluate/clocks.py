"""Whether a reference, its clock and its sides are those of the recording, by angles of knees or contacts."""

import numpy as np

from jgait.notes import Kind, Note
from jgait.types import SIDES, Estimate, Legs, as_float

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

LEAST_S = 0.1
"""[s] Least offset that is noted; contacts differ by less where two methods define them."""

AGREES = {"the knee's angles": np.deg2rad(8.0), "contacts": 0.3}
"""[rad] Difference of knees about their means, and share of contacts that do not match, below which clocks agree."""

BETTER = 0.5
"""[1] Largest part of the error, or of the contacts that do not match, that is left with the offset that is noted.
Without such an offset, a reference is noted if this part of its error is above `AGREES`; chosen."""

MOST_SAMPLES = 3000
"""Largest number of samples of a reference whose angles are compared."""

LEAST_STRIDES = 3
"""Least number of strides of the reference whose contacts are compared."""


def clock_notes(estimate: Estimate, reference: Estimate) -> tuple[Note, ...]:
    """A note if a reference agrees with an estimate much better with exchanged sides, or else at other times, or never.

    Knees are compared if both have one, else the contacts at the ends of strides.
    """
    shifts = np.arange(-MOST_S, MOST_S + 0.5 * STEP_S, STEP_S)
    for (what, agrees), search in zip(AGREES.items(), (_of_knees, _of_contacts), strict=True):
        now = search(estimate, reference, np.zeros(1))
        if now is None:
            continue
        if now[0] <= agrees:
            return ()
        error = search(estimate, reference, shifts)
        mirrored = search(estimate, _exchanged(reference), np.zeros(1))
        if error is not None and mirrored is not None and mirrored[0] <= min(agrees, BETTER * now[0], error.min()):
            return (REFERENCE_SIDES(what=what),)
        if error is None or error.min() > BETTER * now[0]:
            return (REFERENCE_OTHER(what=what, seconds=MOST_S),) if BETTER * now[0] > agrees else ()
        best = float(np.mean(shifts[error <= error.min() + 1e-9]))  # contacts agree as well over some shifts
        note = REFERENCE_CLOCK(what=what, seconds=abs(best), when="later" if best > 0.0 else "earlier")
        return (note,) if abs(best) > LEAST_S else ()
    return ()


def _exchanged(reference: Estimate) -> Estimate:
    """The reference with left and right exchanged."""
    strides = reference.strides
    strides = None if strides is None else strides._replace(side=1 - np.asarray(strides.side))
    return reference._replace(legs=Legs(reference.legs.left, reference.legs.right), strides=strides)


def _of_knees(estimate: Estimate, reference: Estimate, shifts: np.ndarray) -> np.ndarray | None:
    """(shifts,) standard deviation of the difference of knees [rad], the reference shifted [s]; None without both.

    A shift that leaves less than half of the samples in common counts as no agreement.
    """
    errors = []
    known, valid = np.asarray(reference.valid, bool), np.asarray(estimate.valid, bool)
    if not known.any() or not valid.any():
        return None
    rows = np.flatnonzero(known)[:: -(-int(known.sum()) // MOST_SAMPLES)]
    time, ours_at = as_float(reference.time)[rows], as_float(estimate.time)[valid]
    for side in SIDES:
        ours, theirs = getattr(estimate.legs, side), getattr(reference.legs, side)
        if ours is None or theirs is None:
            continue
        angle, true = as_float(ours.knee_angle)[valid], as_float(theirs.knee_angle)[rows]
        at = time[None, :] + shifts[:, None]
        there = (at >= ours_at[0]) & (at <= ours_at[-1])
        gap = np.where(there, np.interp(at, ours_at, angle) - true, np.nan)
        enough = there.sum(axis=1) > 0.5 * len(time)
        spread = np.full(len(shifts), np.inf)
        spread[enough] = np.nanstd(gap[enough], axis=1)
        errors.append(spread)
    return np.mean(errors, axis=0) if errors else None


def _of_contacts(estimate: Estimate, reference: Estimate, shifts: np.ndarray) -> np.ndarray | None:
    """(shifts,) share of the reference's contacts, shifted [s], without a contact of the estimate near."""
    ours, theirs = estimate.strides, reference.strides
    if ours is None or theirs is None or ours.end is None or theirs.end is None:
        return None
    lacking, count = np.zeros(len(shifts)), 0
    for number in range(len(SIDES)):
        found, true = (
            as_float(one.end)[np.asarray(one.valid, bool) & (np.asarray(one.side) == number)] for one in (ours, theirs)
        )
        if found.size and true.size:
            ends, at = np.concatenate([[-np.inf], np.sort(found), [np.inf]]), true + shifts[:, None]
            following = np.searchsorted(ends, at)
            apart = np.minimum(ends[following] - at, at - ends[following - 1])
            lacking += np.sum(apart > LEAST_S, axis=1)
            count += true.size
    return lacking / count if count >= LEAST_STRIDES else None
