"""One table of strides from several sources: common strides are matched, and quantities combined by their variances."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import PyTree

from jgait.estimators.combined.sources import SourceEstimate
from jgait.estimators.plausible import impossible
from jgait.estimators.stride_flags import (
    CLIPPED,
    DOUBTFUL,
    HALF,
    SIDE_UNKNOWN,
    STAIRS,
    STRIDE_FLAGS,
    TURNING,
    UNEVEN_DURATION,
    UNSURE,
    without,
)
from jgait.notes import WRONG_PLACE, Kind, Note, record
from jgait.quality import StrideQuality
from jgait.types import SIDES, Estimate, Legs, Strides, as_float

FEET_OF_CONTACTS_DIFFER = Kind(
    "feet_of_contacts_differ", "check", "right and left: {source} and {other} say the opposite of {opposite} of "
    "{contacts} contacts: the labels of the right and left sensors seem exchanged, the waist's sensor faces the other "
    "way, or the person walks backwards",
    WRONG_PLACE,
)  # fmt: skip

SAME_CONTACT = 0.25
"""[s] Contacts of a side, from two sensors, that are closer than this are the same; so are strides that end there.
Chosen by hand, a quarter of a stride."""

CONSISTENT = 3.0
"""[1] Values of a stride are combined if they differ by fewer standard deviations of their difference than this; chosen
by hand."""

FIELDS = tuple(name for name in Strides._fields if name not in ("side", "valid"))
"""Quantities of a stride."""

TIMES = ("start", "final_contact", "end", "standing", "standing_end", "speed")
"""Quantities of a stride from its first source, or from sources with the same clock."""

COMBINED = ("length", "height", "turn")
"""Quantities of a stride that are combined; others are those of the first source that has them."""

FLAGS = (TURNING, STAIRS, HALF, CLIPPED, UNSURE, SIDE_UNKNOWN)
"""Flags of strides that sources state."""


@record
class JoinedStrides(NamedTuple):
    """Strides of all sources, each once, (n,) in the order of their starts."""

    strides: Strides
    stddev: Strides  #: their standard deviations.
    rows: dict[str, np.ndarray]  #: source → (n,) row of the stride in the source's estimate; −1 where it lacks it.
    used: dict[str, np.ndarray]  #: source → (n,) bool, the source's length is part of the combined length.
    first: tuple[str, ...]  #: (n,) name of the source of times and flags.
    flags: dict[str, np.ndarray]  #: name of a flag → (n,) bool.
    contradicts: np.ndarray  #: (n,) bool, lengths of sources differ by more than `CONSISTENT`.


def joined(
    sources: Sequence[SourceEstimate], doubtful: frozenset[str] = frozenset(), wrong: frozenset[str] = frozenset()
) -> JoinedStrides | None:
    """The strides of all sources as one table; None if no source has a stride.

    Sources are in the order in which times are preferred. Times of placements in `doubtful` do not count, unless
    nothing else is left; strides of those in `wrong` are in doubt themselves.
    """
    columns = [_columns(s, doubtful, wrong) for s in sources if s.estimate.strides is not None and s.name != "width"]
    unlike = [any(facts.unlike or facts.runs for facts in c.source.quality.values()) for c in columns]
    if not all(unlike):
        columns = [c._replace(doubted=c.doubted | odd) for c, odd in zip(columns, unlike, strict=True)]
    groups = [group for side in range(len(SIDES)) for group in _matched(columns, side, wrong)]
    return _table(columns, groups, next((s for s in sources if s.name == "width"), None)) if groups else None


class _Columns(NamedTuple):
    """The strides of a source: an array of quantities, and what is in doubt."""

    source: SourceEstimate
    values: np.ndarray  #: (n, F) `FIELDS` of each stride; NaN where the source does not give it.
    spread: np.ndarray  #: (n, F) their standard deviations.
    flags: dict[str, np.ndarray]  #: name → (n,) bool, of the flags that the source states.
    doubted: np.ndarray  #: (n,) bool, strides that contradict the model, that nobody walks, or of a wrong sensor.
    timed: tuple[bool, bool]  #: whether times of each side count.


def _columns(source: SourceEstimate, doubtful: frozenset[str], wrong: frozenset[str]) -> _Columns:
    estimate = source.estimate
    strides, side = estimate.strides, np.asarray(estimate.strides.side)
    nothing = np.full(len(side), np.nan)

    def table(record: PyTree) -> np.ndarray:
        every = (getattr(record, field, None) for field in FIELDS)
        return np.stack([nothing if column is None else as_float(column) for column in every], axis=1)

    read = {flag.name: flag.read(estimate) for flag in FLAGS}
    read[UNEVEN_DURATION.name] = estimate.diagnostics.get(UNEVEN_DURATION.name)
    flags = {name: np.asarray(marked, bool) for name, marked in read.items() if marked is not None}
    doubted = impossible(strides)
    doubted |= np.array([not _trusted(source, name, wrong) for name in SIDES])[side]
    if (stated := DOUBTFUL.read(estimate)) is not None:
        doubted |= stated
    right, left = (_trusted(source, name, doubtful) for name in SIDES)
    return _Columns(source, table(strides), table(estimate.strides_stddev), flags, doubted, (right, left))


def _trusted(source: SourceEstimate, side: str, doubtful: frozenset[str]) -> bool:
    placements = [name for name in source.placements if name.endswith(side) or not name.endswith(SIDES)]
    return not doubtful.intersection(placements)


def _matched(columns: list[_Columns], side: int, wrong: frozenset[str]) -> list[dict[str, int]]:
    """The strides of a side, each with its row in every source that measures it."""
    groups: list[tuple[float, float, dict[str, int]]] = []
    alone = not any(each.timed[side] for each in columns)
    # doubtful sources come last, so that their times and strides count only where no other source has any
    for source, _, _, flags, _, timed in sorted(columns, key=lambda each: not each.timed[side]):
        new = timed[side] or alone or not groups
        if not new and not _trusted(source, SIDES[side], wrong):
            continue
        strides, before = source.estimate.strides, list(groups)
        known = np.asarray(strides.valid, bool) & (np.asarray(strides.side) == side)
        if before and SIDE_UNKNOWN.name in flags:
            known &= ~flags[SIDE_UNKNOWN.name]
        for row in np.flatnonzero(known).tolist():
            start, end = float(strides.start[row]), float(strides.end[row])
            shared = [max(0.0, min(end, b) - max(start, a)) for a, b, _ in before]
            alike = [
                1.0 if abs(end - b) < SAME_CONTACT else share / (max(end, b) - min(start, a))
                for share, (a, b, _) in zip(shared, before, strict=True)
            ]
            best = int(np.argmax(alike)) if alike else -1
            # [1] of the time that they cover
            if best >= 0 and alike[best] > 0.5 and source.name not in before[best][2]:
                before[best][2][source.name] = row
            elif new and (not alike or max(shared) < 0.3 * (end - start)):  # [1] of its time
                groups.append((start, end, {source.name: row}))
    return [group for *_, group in groups]


AT = {name: number for number, name in enumerate(FIELDS)}
"""Quantity → its column."""


def _table(columns: list[_Columns], groups: list[dict[str, int]], width: SourceEstimate | None) -> JoinedStrides:
    """The strides of groups, which map the name of each source that has the stride to its row.

    Rows in doubt count only where no other source has the stride. If the clock of a source is in doubt, all but its
    times count.
    """
    by_name = {each.source.name: each for each in columns}
    values, spread = np.full((2, len(groups), len(FIELDS)), np.nan)
    side, contradicts, doubtful = np.zeros(len(groups), int), *np.zeros((2, len(groups)), bool)
    rows = {name: np.array([group.get(name, -1) for group in groups], int) for name in by_name}
    used = {name: np.zeros(len(groups), bool) for name in by_name}
    flags = {name: np.zeros(len(groups), bool) for each in columns for name in each.flags}
    firsts = np.full(len(groups), "", object)
    length, step, speed = (AT[name] for name in ("length", "step_length", "speed"))
    for n, group in enumerate(groups):
        every = [name for name in by_name if name in group]
        value = {name: by_name[name].values[group[name]] for name in every}
        sd = {name: by_name[name].spread[group[name]] for name in every}
        sure = [name for name in every if not by_name[name].doubted[group[name]]]
        side[n] = by_name[every[0]].source.estimate.strides.side[group[every[0]]]
        timed = [name for name in every if by_name[name].timed[side[n]]] or every
        timed = [name for name in timed if name in sure] or timed
        names, first = sure or timed, timed[0]
        combines, firsts[n], doubtful[n] = names[:1], first, not sure
        for field, at in AT.items():
            known = [name for name in (timed if field in TIMES else names) if np.isfinite(value[name][at])]
            if known:
                values[n, at], spread[n, at] = value[known[0]][at], sd[known[0]][at]
            known = [name for name in known if sd[name][at] > 0.0]
            if field in COMBINED and known:
                numbers = np.array([[value[name][at], sd[name][at]] for name in known])
                values[n, at], spread[n, at], agree = combined(numbers[:, 0], numbers[:, 1], correlation(known))
                if field == "length":
                    combines = [name for name, agrees in zip(known, agree, strict=True) if agrees]
                    contradicts[n] = not agree.all()
        stepped = next((name for name in names if np.isfinite(value[name][step])), first)
        share = values[n, length] / value[stepped][length] if value[stepped][length] > 0.0 else np.nan
        values[n, step], spread[n, step] = share * values[n, step], share * spread[n, step]  # of the combined stride
        if value[first][length] > 0.0:
            values[n, speed] = value[first][speed] * values[n, length] / value[first][length]
        if sd[first][length] > 0.0:
            spread[n, speed] = sd[first][speed] * spread[n, length] / sd[first][length]
        for name in combines:
            used[name][n] = True
        for name in names:
            for stated, of_source in by_name[name].flags.items():
                flags[stated][n] |= of_source[group[name]]
    order = np.argsort(values[:, AT["start"]], kind="stable")
    side, firsts, contradicts, doubtful = (column[order] for column in (side, firsts, contradicts, doubtful))
    rows, used, flags = ({name: of[order] for name, of in table.items()} for table in (rows, used, flags))
    of_field, of_spread = (dict(zip(FIELDS, table[order].T, strict=True)) for table in (values, spread))
    if width is not None:
        flags["width_valid"] = _widths(of_field, of_spread, side, width)
    flags[DOUBTFUL.name] = doubtful
    needed, valid = ("length", "width", "height"), np.ones(len(side), bool)
    kept: list[dict[str, PyTree]] = [
        {name: column if name in needed or np.isfinite(column).any() else None for name, column in table.items()}
        for table in (of_field, of_spread)
    ]
    strides, deviations = (Strides(side=side, valid=valid, **table) for table in kept)
    none = np.zeros(0)
    whole = Estimate(none, Legs(None, None), None, None, none, dict(flags), strides, strides_stddev=deviations)
    for flag in (STAIRS, HALF, UNEVEN_DURATION):  # as every table reads them
        if (marked := flag.read(whole)) is not None:
            flags[flag.name] = np.asarray(marked, bool)
    return JoinedStrides(strides, deviations, rows, used, tuple(firsts.tolist()), flags, contradicts)


def correlation(names: Iterable[str]) -> np.ndarray:
    """(k, k) correlation of the errors of sources; ankle and shank are one segment, measured by one method."""
    known = list(names)
    return np.array([[1.0 if a == b else 0.5 * ({a, b} == {"ankles", "shanks"}) for b in known] for a in known])


def combined(
    values: np.ndarray, deviations: np.ndarray, correlation: np.ndarray | None = None
) -> tuple[float, float, np.ndarray]:
    """Weighted mean of measurements (k,) with the least variance, its standard deviation, and (k,) bool, the
    measurements used.

    Two measurements agree if they differ by at most `CONSISTENT` standard deviations of the difference. The mean
    contains the measurement with which most independent ones agree, and these; if several have as many, the most
    certain of them. The others are not used; if as many independent ones support one of them, the deviation includes
    half of the difference from it. `correlation` (k, k) is that of the errors; None: independent.
    """
    cov = np.outer(deviations, deviations) * (np.eye(len(values)) if correlation is None else correlation)
    apart = np.abs(values[:, None] - values)
    spread = np.sqrt(np.diag(cov)[:, None] + np.diag(cov) - 2.0 * cov)
    # of those that agree with one, only the less certain ones support it: what is uncertain agrees with everything
    agree = (apart <= CONSISTENT * spread) & (deviations[:, None] <= deviations)
    # correlated measurements count as fewer: as many independent ones, rounded down, have the same information
    shared = cov / np.outer(deviations, deviations)
    support = [
        int(np.linalg.solve(shared[np.ix_(members, members)], np.ones(members.sum())).sum() + 1e-9) for members in agree
    ]
    best = min(range(len(cov)), key=lambda number: (-support[number], deviations[number]))
    kept = agree[best]
    rivals = [apart[best, number] for number in np.flatnonzero(~kept) if support[number] == support[best]]
    weights = np.linalg.solve(cov[np.ix_(kept, kept)], np.ones(kept.sum()))
    weights = np.maximum(weights, 0.0)  # a strongly correlated, less certain measurement would get a negative weight
    weights = weights / weights.sum()
    sd = np.sqrt(weights @ cov[np.ix_(kept, kept)] @ weights)
    return float(weights @ values[kept]), float(np.hypot(sd, 0.5 * min(rivals, default=0.0))), kept


def _widths(
    values: dict[str, np.ndarray], spread: dict[str, np.ndarray], side: np.ndarray, width: SourceEstimate
) -> np.ndarray:
    """Widths and step lengths of the strides, from those that end at the same time; (n,) bool, reliable widths."""
    table, deviations = width.estimate.strides, width.estimate.strides_stddev
    trusted = width.estimate.diagnostics.get("width_valid", np.ones(np.shape(table.side), bool))
    same = np.abs(as_float(table.end) - values["end"][:, None]) < SAME_CONTACT
    same &= np.asarray(table.side) == side[:, None]
    there, row = same.any(axis=1), same.argmax(axis=1)
    for field in ("width", "step_length"):
        for columns, of_width in ((values, table), (spread, deviations)):
            columns[field][there] = as_float(getattr(of_width, field))[row[there]]
    return there & np.asarray(trusted, bool)[row]


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
