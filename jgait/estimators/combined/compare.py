"""Quantities of a walk by several sources, and notes about contradictions between the sources."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jgait.estimators.combined.distance import WalkedDistance
from jgait.estimators.combined.sources import SourceEstimate
from jgait.estimators.combined.strides import CONSISTENT, LEG_WORN, SAME_CONTACT, JoinedStrides
from jgait.estimators.stride_flags import STRIDE_FLAGS, without
from jgait.estimators.totals import median
from jgait.notes import WRONG_PLACE, Kind, Note
from jgait.quality import StrideQuality
from jgait.types import SIDES, as_float

LENGTHS_DIFFER = Kind(
    "lengths_differ", "check", "stride length: {source} says {length:.2f} m, {other} {other_length:.2f} m (medians of "
    "{strides} common strides), more apart than their deviations allow",
    "At least one of the two is wrong: a measure of the person, a sensor's place, its range or its label. Both are in "
    "the table of sources; the combined table has the one that other sources agree with, or else the more certain one.",
)  # fmt: skip
FEET_OF_CONTACTS_DIFFER = Kind(
    "feet_of_contacts_differ", "check", "right and left: {source} and {other} say the opposite of {opposite} of "
    "{contacts} contacts: the labels of the right and left sensors seem exchanged, the waist's sensor faces the other "
    "way, or the person walks backwards",
    WRONG_PLACE,
)  # fmt: skip
CONTACTS_APART = Kind(
    "contacts_apart", "check", "contacts of the {other} follow those of the feet {seconds:.2f} s {words} on the right "
    "leg than on the left: the clock of one of these sensors seems to be off",
    "Times of steps, and what differs between right and left in time, are wrong by this. Strides of a single sensor "
    "hold.",
)  # fmt: skip

STEPS_UNEVEN = Kind(
    "steps_uneven", "check", "steps of the right foot last {right:.2f} s and those of the left {left:.2f} s: either "
    "the person limps, or the clocks of the two shoes differ by {seconds:.2f} s",
    "If both shoes have one clock, the durations of the steps hold. If their clocks differ, steps are even, and what "
    "differs between right and left in time is wrong; strides and lengths hold.",
)  # fmt: skip

STRIDES_OF_WAIST = Kind(
    "strides_of_waist", "check",
    "{side}: strides have times of the waist and lengths of {sources}, because {sensors} are in doubt",
    "The waist's sensor measures contacts and lengths less exactly than sensors on the leg. What differs between right "
    "and left can come from the sensors: do not read it as asymmetry.",
)  # fmt: skip

SIDES_UNLIKE_MEASURED = Kind(
    "sides_measured_otherwise", "info",
    "strides of the {side} leg are measured by the waist alone, those of the {other} leg by {source}: what differs "
    "between right and left comes from the sensors",
    "The waist's sensor measures lengths and contacts less exactly than sensors on the leg, with an error that is the "
    "same in all strides: do not read a difference as asymmetry. In the summary, lengths and speeds are those of the "
    "leg with the better sensor, if its errors are far smaller.",
)  # fmt: skip

CONTACTS_CONTRADICT = Kind(
    "contacts_contradict", "check", "{side}: contacts by {source} are up to {seconds:.2f} s from those by {other} in "
    "{strides} of {of} strides; times by {other} count there, because they make strides more even",
    "One of the two detects contacts wrongly there, as where a sensor loses or repeats samples, or moves on the leg. "
    "Times of these strides, and of steps beside them, are less certain; lengths hold.",
)  # fmt: skip

APART_S = 0.1
"""[s] Least difference between the legs in the time from a foot's contacts to the contacts of its ankle or shank.
It is 0.06 or less in undamaged walks, public and simulated of all gaits, and larger where sensors are exchanged."""

UNEVEN_S = 0.085
"""[s] Least difference of right and left step durations that is noted: three standard deviations of a summary."""

FEWEST_COMPARED = 4
"""[1] Least number of common strides or contacts for a comparison."""

OPPOSITE = 0.75
"""[1] Threshold on the share of contacts with opposite sides."""


class Comparison(NamedTuple):
    """One quantity of a walk as one source measures it.

    Attributes:
        quantity: "stride_length" [m], "distance" [m], "walking_speed" [m/s] or "strides" [1].
        source: name of the source, or "combined".
        value: the value; of strides the median over the regular ones, see `regular`.
        stddev: its standard deviation, or None where none is stated.
        strides: number of strides that the value is from; 0 for a distance.
    """

    quantity: str
    source: str
    value: float
    stddev: float | None
    strides: int


def comparisons(
    sources: Sequence[SourceEstimate], strides: JoinedStrides | None, walked: Sequence[WalkedDistance],
    total: WalkedDistance | None,
) -> list[Comparison]:  # fmt: skip
    """Every quantity that a source measures, and the combined value."""
    rows: list[Comparison] = []
    if strides is not None:
        usual = regular(strides)
        tables = {
            source.name: (strides.rows[source.name], source.estimate.strides, source.estimate.strides_stddev)
            for source in sources if source.name in strides.rows
        }  # fmt: skip
        tables["combined"] = np.arange(len(usual)), strides.strides, strides.stddev
        for quantity, field in (("stride_length", "length"), ("walking_speed", "speed")):
            for name, (at, values, spread) in tables.items():
                rows += _median(quantity, name, field, at[(at >= 0) & usual], values, spread)
        counts = {name: int((at >= 0).sum()) for name, (at, *_) in tables.items()}
        rows += [Comparison("strides", name, float(count), None, count) for name, count in counts.items()]
    rows += [
        Comparison("distance", distance.source, float(distance.distance[-1]), distance.stddev, 0) for distance in walked
    ]
    if total is not None:
        rows.append(Comparison("distance", "combined", float(total.distance[-1]), total.stddev, 0))
    return rows


def regular(strides: JoinedStrides, column: str = "stride_length_m") -> np.ndarray:
    """(n,) bool, strides that count in medians of a column, as in reports."""
    return without(strides.flags, STRIDE_FLAGS, len(strides.first), column)


def _median(
    quantity: str, source: str, field: str, rows: np.ndarray, strides: object, stddev: object
) -> list[Comparison]:
    values = getattr(strides, field)
    known = rows[:0] if values is None else rows[np.isfinite(as_float(values)[rows])]
    middle, sd = median(values, known), median(getattr(stddev, field, None), known)
    return [] if middle is None else [Comparison(quantity, source, middle, sd or None, len(known))]


def length_notes(sources: Sequence[SourceEstimate], strides: JoinedStrides) -> list[Note]:
    """A note for each source whose stride lengths contradict those of the most certain source."""
    measured_lengths = {}
    for source in sources:
        at, tables = strides.rows.get(source.name), (source.estimate.strides, source.estimate.strides_stddev)
        if at is not None and (at >= 0).any() and tables[1] is not None:
            measured_lengths[source.name] = [np.where(at >= 0, as_float(table.length)[at], np.nan) for table in tables]
    notes = []
    usual = regular(strides)
    usual = usual if usual.any() else ~usual
    order = sorted(measured_lengths, key=lambda name: median(measured_lengths[name][1]) or np.inf)
    for name, other in itertools.combinations(order, 2):
        (a, sa), (b, sb) = measured_lengths[name], measured_lengths[other]
        both = np.isfinite(a) & np.isfinite(b) & usual
        if both.sum() >= FEWEST_COMPARED:
            apart = abs(float(np.median((a - b)[both])))
            if apart > CONSISTENT * float(np.median(np.hypot(sa, sb)[both])):
                lengths = {"length": np.median(a[both]), "other_length": np.median(b[both])}
                notes.append(LENGTHS_DIFFER(source=name, other=other, strides=both.sum(), **lengths))
    return notes


def contact_notes(sources: Sequence[SourceEstimate], strides: JoinedStrides, doubtful: frozenset[str]) -> list[Note]:
    """A note if the time between the contacts of foot and ankle or shank differs between the legs.

    Sources with a sensor in `doubtful`, whose place or clock another note explains, are not compared.
    """
    starts = {
        source.name: np.where(at >= 0, as_float(source.estimate.strides.start)[at], np.nan)
        for source in sources
        if (at := strides.rows.get(source.name)) is not None and (at >= 0).any()
        and not doubtful & set(source.placements)
    }  # fmt: skip
    sides = np.asarray(strides.strides.side)
    notes = []
    for other in (name for name in ("ankles", "shanks") if {name, "feet"} <= starts.keys()):
        later = starts[other] - starts["feet"]
        each = [later[np.isfinite(later) & (sides == side)] for side in range(len(SIDES))]
        if min(map(len, each)) >= FEWEST_COMPARED:
            seconds = float(np.median(each[0]) - np.median(each[1]))
            if abs(seconds) > APART_S:
                words = "later" if seconds > 0.0 else "earlier"
                notes.append(CONTACTS_APART(other=other, seconds=abs(seconds), words=words))
    return notes


def step_notes(strides: JoinedStrides) -> list[Note]:
    """A note if steps of one shoe last longer than those of the other, because of the person or of their clocks."""
    from_feet = np.array(strides.first) == "feet"
    side, start, end = (np.asarray(getattr(strides.strides, name)) for name in ("side", "start", "end"))
    lasts = []
    for number in range(len(SIDES)):
        theirs = from_feet & (side != number)
        contacts = np.unique(np.concatenate([start[theirs], end[theirs]]))
        rows = np.flatnonzero(from_feet & (side == number) & regular(strides, "stride_duration_s"))
        last = np.append(-np.inf, contacts)[np.searchsorted(contacts, end[rows])]  # the last one before the end
        lasts.append((end[rows] - last)[last > start[rows]])
    if min(map(len, lasts)) < FEWEST_COMPARED:
        return []
    right, left = (float(np.median(each)) for each in lasts)
    apart = abs(right - left)
    return [STEPS_UNEVEN(right=right, left=left, seconds=0.5 * apart)] if apart > UNEVEN_S else []


def even_notes(sources: Sequence[SourceEstimate], strides: JoinedStrides, doubtful: frozenset[str]) -> list[Note]:
    """A note for each side and source on the legs whose contacts are replaced by those of a later source.

    Sources with a sensor in `doubtful`, whose place or clock another note explains, have none.
    """
    notes, first, names = [], np.array(strides.first), [source.name for source in sources]
    for number, source in enumerate(sources):
        if source.name not in LEG_WORN or doubtful.intersection(source.placements):
            continue
        at, source_strides = strides.rows[source.name], source.estimate.strides
        ends = [(as_float(table.start), as_float(table.end)) for table in (source_strides, strides.strides)]
        apart = np.max([np.abs(theirs[at] - ours) for theirs, ours in zip(*ends, strict=True)], axis=0)
        for side, word in enumerate(SIDES):
            mine = np.asarray(strides.strides.side) == side
            for other in (name for name in names[number + 1 :] if name in LEG_WORN):
                rows = mine & (at >= 0) & (first == other) & (apart > SAME_CONTACT)
                if rows.any():
                    values = {"seconds": apart[rows].max(), "strides": rows.sum(), "of": mine.sum()}
                    notes.append(CONTACTS_CONTRADICT(side=word, source=source.name, other=other, **values))
    return notes


def waist_notes(sources: Sequence[SourceEstimate], strides: JoinedStrides, doubtful: frozenset[str]) -> list[Note]:
    """A note for each side whose strides have the waist's times because the sensors on the leg are in doubt."""
    notes = []
    waist = np.array([name == "waist" for name in strides.first], bool)
    for number, side in enumerate(SIDES):
        of_side = np.asarray(strides.strides.side) == number
        worn = {name for source in sources if source.name in LEG_WORN for name in source.placements}
        sensors = [name for name in sorted(worn & doubtful) if name.endswith(side)]
        if sensors and of_side.any() and waist[of_side].mean() > 0.5:
            names = [name for name, used in strides.used.items() if used[of_side].mean() > 0.5] or ["waist"]
            notes.append(STRIDES_OF_WAIST(side=side, sources=" and ".join(names), sensors=" and ".join(sensors)))
    return notes


def source_notes(strides: JoinedStrides) -> list[Note]:
    """A note if most strides of one side are of the waist, and most of the other side's of a sensor on that leg."""
    sides, usual = np.asarray(strides.strides.side), regular(strides)
    most = []
    for side in range(len(SIDES)):
        names = [name for name, mine in zip(strides.first, usual & (sides == side), strict=True) if mine]
        most.append(max(sorted(set(names)), key=names.count, default=""))
    waist = [number for number, name in enumerate(most) if name == "waist"]
    if len(waist) != 1 or most[1 - waist[0]] not in LEG_WORN:
        return []
    mine, other = waist[0], 1 - waist[0]
    return [SIDES_UNLIKE_MEASURED(side=SIDES[mine], other=SIDES[other], source=most[other])]


def side_notes(sources: Sequence[SourceEstimate], strides: JoinedStrides) -> list[Note]:
    """A note if the waist's contacts are on the other side than those of feet, ankles or shanks."""
    waist = next((source for source in sources if source.name == "waist"), None)
    worn = [name for name in strides.rows if name != "waist" and (strides.rows[name] >= 0).any()]
    ours = np.array([name != "waist" for name in strides.first], bool)
    if waist is None or not ours.any() or set(np.asarray(strides.strides.side)) != set(range(len(SIDES))):
        return []
    diagnostics = waist.estimate.diagnostics
    sure = as_float(diagnostics["initial_contact_side_probability"]) > 0.9
    apart = np.abs(as_float(diagnostics["initial_contact"])[sure, None] - as_float(strides.strides.end)[ours])
    near = apart.min(axis=1) < SAME_CONTACT
    theirs = np.asarray(strides.strides.side)[ours][apart.argmin(axis=1)]
    contacts = int(near.sum())
    opposite = int((near & (theirs != np.asarray(diagnostics["initial_contact_side"])[sure])).sum())
    if contacts < FEWEST_COMPARED or opposite < OPPOSITE * contacts:
        return []
    return [FEET_OF_CONTACTS_DIFFER(source="waist", other=" and ".join(worn), opposite=opposite, contacts=contacts)]


def quality_of(strides: JoinedStrides, sources: Sequence[SourceEstimate]) -> StrideQuality:
    """The quality of joined strides: of the sources that their lengths come from the smallest doubt, for these agree,
    and the widest interval.
    """
    doubt, wide = np.full(len(strides.first), np.inf), np.zeros(len(strides.first))
    for source in sources:
        if (quality := source.estimate.diagnostics.get("quality")) is not None and source.name in strides.used:
            used = np.flatnonzero(strides.used[source.name])
            rows = strides.rows[source.name][used]
            doubt[used] = np.minimum(doubt[used], quality.doubt[rows])
            wide[used] = np.maximum(wide[used], quality.interval[rows])
    known = np.isfinite(doubt)
    doubt, wide = np.where(known, doubt, np.nan), np.where(known, wide, np.nan)
    return StrideQuality(doubt, np.ones(len(known)), wide, {})
