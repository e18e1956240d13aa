"""Quantities of a walk by several sources, and notes about contradictions between the sources."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jgait.estimators.combined.distance import WalkedDistance
from jgait.estimators.combined.phases import CLOCK_OFF
from jgait.estimators.combined.sources import SourceEstimate
from jgait.estimators.combined.strides import LEG_WORN, SAME_CONTACT, JoinedStrides
from jgait.estimators.stride_flags import STRIDE_FLAGS, without
from jgait.estimators.totals import median
from jgait.notes import WRONG_PLACE, Kind, Note
from jgait.quality import StrideQuality
from jgait.types import SIDES, as_float

FEET_OF_CONTACTS_DIFFER = Kind(
    "feet_of_contacts_differ", "check", "right and left: {source} and {other} say the opposite of {opposite} of "
    "{contacts} contacts: the labels of the right and left sensors seem exchanged, the waist's sensor faces the other "
    "way, or the person walks backwards",
    WRONG_PLACE,
)  # fmt: skip

MEASURED_BY_WAIST = Kind(
    "measured_by_waist", "check", "",
    "The waist's sensor measures contacts and lengths less exactly than sensors on the leg, with an error that is the "
    "same in all strides: do not read a difference between right and left as asymmetry. In the summary, lengths and "
    "speeds are those of the leg with the better sensor, if its errors are far smaller.",
)  # fmt: skip

APART_S = 0.1
"""[s] Least difference between the legs in the time from a foot's contacts to the contacts of its ankle or shank.
It is 0.06 or less in undamaged walks, public and simulated of all gaits, and larger where sensors are exchanged."""

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
        seconds = float(np.diff([np.median(late) for late in each])[0]) if min(map(len, each)) >= FEWEST_COMPARED else 0
        if abs(seconds) > APART_S:
            text = (
                "contacts of the {other} follow those of the feet {seconds:.2f} s {words} on the right leg than on the "
                "left: the clock of one of these sensors seems to be off"
            )
            words = "later" if seconds < 0.0 else "earlier"
            notes.append(CLOCK_OFF.note(text, other=other, seconds=abs(seconds), words=words))
    return notes


def waist_notes(sources: Sequence[SourceEstimate], strides: JoinedStrides, doubtful: frozenset[str]) -> list[Note]:
    """A note for each side most of whose strides have the waist's times, because the sensors on the leg are in doubt,
    or because the other leg alone has one.
    """
    first, sides, usual = np.array(strides.first), np.asarray(strides.strides.side), regular(strides)
    worn = {name for source in sources if source.name in LEG_WORN for name in source.placements}
    most = []
    for number in range(len(SIDES)):
        names = first[usual & (sides == number)].tolist()
        most.append(max(sorted(set(names)), key=names.count, default=""))
    notes = []
    for number, side in enumerate(SIDES):
        of_side, other = sides == number, 1 - number
        sensors = " and ".join(name for name in sorted(worn & doubtful) if name.endswith(side))
        if sensors and (first[of_side] == "waist").sum() > 0.5 * of_side.sum():
            names = [name for name, used in strides.used.items() if used[of_side].mean() > 0.5] or ["waist"]
            text = "{side}: strides have times of the waist and lengths of {sources}, because {sensors} are in doubt"
            notes.append(MEASURED_BY_WAIST.note(text, side=side, sources=" and ".join(names), sensors=sensors))
        elif not sensors and most[number] == "waist" and most[other] in LEG_WORN:
            text = "strides of the {side} leg are measured by the waist alone, those of the {other} leg by {source}"
            notes.append(MEASURED_BY_WAIST.note(text, side=side, other=SIDES[other], source=most[other]))
    return notes


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
