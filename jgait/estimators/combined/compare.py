"""Quantities of a walk by several sources, and what contradicts: contacts, sides, and lengths of both sides."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jgait.estimators.combined.distance import WalkedDistance
from jgait.estimators.combined.sources import SourceEstimate
from jgait.estimators.combined.strides import SAME_CONTACT, JoinedStrides
from jgait.estimators.stride_flags import DOUBTFUL, LARGEST_TURN, STRIDE_FLAGS, without
from jgait.estimators.totals import median
from jgait.notes import WRONG_PLACE, Kind, Note
from jgait.quality import StrideQuality, widened
from jgait.types import SIDES, as_float

FEET_OF_CONTACTS_DIFFER = Kind(
    "feet_of_contacts_differ", "check", "right and left: {source} and {other} say the opposite of {opposite} of "
    "{contacts} contacts: the labels of the right and left sensors seem exchanged, the waist's sensor faces the other "
    "way, or the person walks backwards",
    WRONG_PLACE,
)  # fmt: skip

SIDES_UNLIKE = Kind(
    "lengths_of_sides_apart", "check", "stride length by {source}: {right:.2f} m on the right, {left:.2f} m on the "
    "left (medians of {strides} pairs of strides at the same time)",
    "Both feet of a person who walks straight go as far. At least one side is measured wrongly, as of a stiff leg "
    "whose shank hardly swings, a sensor of another scale, or one that moves on the leg. Which one is not known: the "
    "deviations of stride lengths and of the distance contain half of the difference. Do not read it as asymmetry.",
)  # fmt: skip

UNLIKE = 0.1
"""[1] Difference of the stride lengths of both sides over their mean up to which sensors that turn differently are not
wrong, as on a stiff leg; and above which one side is wrong. Chosen between walks of public sets and simulated
hemiparetic walks with shanks whose distance is off by more than three stated deviations."""


class Comparison(NamedTuple):
    """One quantity of a walk as one source measures it."""

    quantity: str  #: "stride_length" [m], "distance" [m], "walking_speed" [m/s] or "strides" [1].
    source: str  #: name of the source, or "combined".
    value: float  #: the value; of strides the median over the regular ones, see `regular`.
    stddev: float | None  #: its standard deviation, or None where none is stated.
    strides: int  #: number of strides that the value is from; 0 for a distance.


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
                if (column := getattr(values, field)) is not None:
                    known = at[(at >= 0) & usual]
                    known = known[np.isfinite(as_float(column)[known])]
                    middle, sd = median(column, known), median(getattr(spread, field, None), known)
                    rows += [] if middle is None else [Comparison(quantity, name, middle, sd or None, len(known))]
        counts = {name: int((at >= 0).sum()) for name, (at, *_) in tables.items()}
        rows += [Comparison("strides", name, float(count), None, count) for name, count in counts.items()]
    every = [*walked, *([] if total is None else [total._replace(source="combined")])]
    return rows + [Comparison("distance", each.source, float(each.distance[-1]), each.stddev, 0) for each in every]


def regular(strides: JoinedStrides, column: str = "stride_length_m") -> np.ndarray:
    """(n,) bool, strides that count in medians of a column, as in reports."""
    return without(strides.flags, STRIDE_FLAGS, len(strides.first), column)


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
    if contacts < 4 or opposite < 0.75 * contacts:
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


def pairs(source: SourceEstimate) -> np.ndarray:
    """(n, 2) lengths of a right and a left stride at the same time [m], neither in a turn or in doubt."""
    strides = source.estimate.strides
    if strides is None or source.name == "width":
        return np.zeros((0, 2))
    side, start, end, length = (as_float(getattr(strides, name)) for name in ("side", "start", "end", "length"))
    straight = np.asarray(strides.valid, bool)
    if strides.turn is not None:
        straight = straight & (np.abs(as_float(strides.turn)) <= LARGEST_TURN)
    if (doubted := DOUBTFUL.read(source.estimate)) is not None:
        straight = straight & ~doubted
    right, left = (np.flatnonzero(straight & (side == number)) for number in range(len(SIDES)))
    if not len(left):
        return np.zeros((0, 2))
    middle = 0.5 * (start + end)
    near = left[np.argmin(np.abs(middle[right, None] - middle[left]), axis=1)]
    at_once = (start[right] < end[near]) & (start[near] < end[right])
    return np.stack([length[right], length[near]], axis=1)[at_once]


def apart(lengths: np.ndarray) -> float:
    """The difference between the sides of `pairs` over their mean [1]; NaN for few pairs."""
    if len(lengths) < 6:
        return np.nan
    return abs(float(np.median(lengths[:, 0] - lengths[:, 1]))) / float(np.median(lengths, axis=0).mean())


def alike(sources: Sequence[SourceEstimate], placements: frozenset[str]) -> bool:
    """Whether a source with these two sensors measures strides of the same length on both sides."""
    # as on a stiff leg
    return any(apart(pairs(source)) < 0.05 for source in sources if placements.issubset(source.placements))


def with_sides_unlike(
    sources: Sequence[SourceEstimate], wrong: frozenset[str]
) -> tuple[list[SourceEstimate], list[Note]]:
    """The sources, with larger deviations where both sides' strides differ in length, and a note for each such source;
    sources with a sensor in `wrong`, which another note explains, do not change.
    """
    changed, notes = list(sources), []
    for number, source in enumerate(sources):
        lengths = pairs(source)
        differs = apart(lengths)
        if len(source.placements) == len(SIDES) and not wrong.intersection(source.placements) and differs > UNLIKE:
            share = np.full(np.shape(source.estimate.strides.side), 0.5 * differs)
            changed[number] = source._replace(estimate=widened(source.estimate, share))
            right, left = np.median(lengths, axis=0)
            notes.append(SIDES_UNLIKE(source=source.name, right=right, left=left, strides=len(lengths)))
    return changed, notes
