"""Whether a reference, its clock and its sides are those of the recording, by all that both measure."""

import numpy as np

from jgait.notes import Kind, Note
from jgait.types import SIDES, Estimate, Feet, Legs, as_float

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
"""[s] Largest offset of a clock that is looked for, and step of the search; chosen by hand."""

OFFSET_S = 0.1
"""[s] Least offset that is noted; chosen by hand: contacts differ by less where two methods define them."""

AGREES, BETTER = 0.35, 0.5
"""[1] One minus the correlation below which two signals agree, chosen above that of most recordings of public sets; and
largest part of it that is left with the offset that is noted. Without such an offset, a reference is noted if this part
is above `AGREES`; chosen."""

COMPARED = (
    ("the knee's angles", "knee", "knee"), ("contacts", "contacts", "contacts"), ("speeds of the feet", "foot", "foot"),
    ("contacts", "knee", "swings"), ("the knee's angles", "swings", "knee"),
)  # fmt: skip
"""What is compared, and the signals of the estimate and of the reference, see `_signal`."""


def clock_notes(estimate: Estimate, reference: Estimate) -> tuple[Note, ...]:
    """A note for each part of a reference, of `COMPARED`, that agrees with an estimate much better with exchanged
    sides, or else at other times, or never; samples and strides of a reference are two files, of which one can be
    wrong.
    """
    notes, shifts = list[Note](), np.arange(-MOST_S, MOST_S + 0.5 * STEP_S, STEP_S)
    for what, ours, theirs in COMPARED:
        now = _apart(estimate, reference, ours, theirs, np.zeros(1))[0]
        if not now > AGREES:
            continue
        error = np.nan_to_num(_apart(estimate, reference, ours, theirs, shifts), nan=np.inf)
        mirrored = _apart(estimate, _exchanged(reference), ours, theirs, np.zeros(1))[0]
        best = float(shifts[np.argmin(error + 1e-6 * np.abs(shifts))])
        if mirrored <= min(AGREES, BETTER * now, error.min()):
            notes.append(REFERENCE_SIDES(what=what))
        elif error.min() > BETTER * now:
            notes += [REFERENCE_OTHER(what=what, seconds=MOST_S)] if BETTER * now > AGREES else []
        elif abs(best) > OFFSET_S:
            notes.append(REFERENCE_CLOCK(what=what, seconds=abs(best), when="later" if best > 0.0 else "earlier"))
    return tuple(notes)


def _exchanged(reference: Estimate) -> Estimate:
    """The reference with left and right exchanged."""
    strides, feet = reference.strides, reference.feet
    return reference._replace(
        legs=Legs(reference.legs.left, reference.legs.right),
        strides=None if strides is None else strides._replace(side=1 - np.asarray(strides.side)),
        feet=None if feet is None else Feet(feet.left, feet.right),
    )


def _signal(estimate: Estimate, kind: str, side: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Times [s] and values of a signal of a leg, or None: flexion of the knee, horizontal speed of the foot, or pulses
    at the contacts or at the middles of the swings.
    """
    strides, valid = estimate.strides, np.asarray(estimate.valid, bool)
    if kind in ("contacts", "swings"):
        if strides is None or strides.start is None or strides.end is None:
            return None
        rows = np.asarray(strides.valid, bool) & (np.asarray(strides.side) == SIDES.index(side))
        end = np.sort(as_float(strides.end)[rows])
        if end.size < 3:
            return None
        lasts = float(np.median(as_float(strides.end)[rows] - as_float(strides.start)[rows]))
        # a knee is bent most 0.3 strides before a contact
        at, wide = (end, OFFSET_S) if kind == "contacts" else (end - 0.3 * lasts, 0.12 * lasts)
        grid = np.arange(at[0] - lasts, at[-1] + lasts, STEP_S)
        pulses = np.exp(-0.5 * (np.abs(grid - at[np.searchsorted(0.5 * (at[1:] + at[:-1]), grid)]) / wide) ** 2)
        return grid, pulses
    leg = getattr(estimate.legs, side) if kind == "knee" else getattr(estimate.feet or Feet(None, None), side)
    if leg is None or valid.sum() < 2:
        return None
    time = as_float(estimate.time)
    if kind == "knee":
        return time[valid], as_float(leg.knee_angle)[valid]
    return time[valid], np.hypot(*np.gradient(as_float(leg.position)[:, :2], time, axis=0).T)[valid]


def _apart(estimate: Estimate, reference: Estimate, our_kind: str, their_kind: str, shifts: np.ndarray) -> np.ndarray:
    """(shifts,) one minus the correlation of two signals, the reference shifted [s]; NaN without both, no agreement
    (inf) if less than half of the samples are in common. Pulses are 0 outside their times.
    """
    errors = []
    for side in SIDES:
        ours, theirs = _signal(estimate, our_kind, side), _signal(reference, their_kind, side)
        if ours is None or theirs is None:
            continue
        rows = slice(None, None, -(-theirs[0].size // 3000))
        time, y = theirs[0][rows], theirs[1][rows]
        outside = 0.0 if our_kind in ("contacts", "swings") else np.nan
        x = np.interp(time + shifts[:, None], *ours, left=outside, right=outside)
        there = np.isfinite(x)
        count = np.maximum(there.sum(axis=1), 1)
        x, y = np.where(there, x, 0.0), np.where(there, y, 0.0)
        sums = [np.sum(part, axis=1) / count for part in (x, y, x * x, y * y, x * y)]
        spread = np.sqrt(np.maximum(sums[2] - sums[0] ** 2, 0.0) * np.maximum(sums[3] - sums[1] ** 2, 0.0))
        r = np.divide(sums[4] - sums[0] * sums[1], spread, out=np.full(len(shifts), np.nan), where=spread > 1e-12)
        errors.append(np.where(count > 0.5 * time.size, 1.0 - r, np.inf))
    return np.mean(errors, axis=0) if errors else np.full(len(shifts), np.nan)
