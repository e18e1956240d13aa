"""One table of strides from several sources: common strides are matched, and quantities combined by their variances."""

from collections.abc import Iterable, Mapping, Sequence
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
    TURNING,
    UNEVEN_DURATION,
    UNSURE,
)
from jgait.notes import record
from jgait.types import SIDES, Estimate, Legs, Strides, as_float

SAME_CONTACT = 0.25
"""[s] Contacts of a side, from two sensors, that are closer than this are the same; so are strides that end there."""

CONSISTENT = 3.0
"""[1] Values of a stride are combined if they differ by fewer standard deviations of their difference than this."""

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


class _JoinedStride(NamedTuple):
    """One stride, with the values of its sources."""

    first: str
    side: int
    group: dict[str, int]
    values: np.ndarray
    spread: np.ndarray
    flags: set[str]
    used: frozenset[str]
    contradicts: bool
    doubtful: bool


AT = {name: number for number, name in enumerate(FIELDS)}
"""Quantity → its column."""


def _stride(columns: Mapping[str, _Columns], group: dict[str, int]) -> _JoinedStride:
    """A stride from its row in each source; rows in doubt count only where no other source has the stride. If the clock
    of a source is in doubt, all but its times count.
    """
    every = [name for name in columns if name in group]
    value, sd = ({name: getattr(columns[name], part)[group[name]] for name in every} for part in ("values", "spread"))
    sure = [name for name in every if not columns[name].doubted[group[name]]]
    side = int(columns[every[0]].source.estimate.strides.side[group[every[0]]])
    timed = [name for name in every if columns[name].timed[side]] or every
    timed = [name for name in timed if name in sure] or timed
    names = sure or timed
    first = timed[0]
    values, spread = np.full((2, len(FIELDS)), np.nan)
    for field, at in AT.items():
        of_field = timed if field in TIMES else names
        if name := next((name for name in of_field if np.isfinite(value[name][at])), ""):
            values[at], spread[at] = value[name][at], sd[name][at]
    used, contradicts = frozenset([names[0]]), False
    for field in COMBINED:
        at = AT[field]
        known = [name for name in names if np.isfinite(value[name][at]) and sd[name][at] > 0.0]
        if known:
            numbers = np.array([[value[name][at], sd[name][at]] for name in known])
            values[at], spread[at], kept = combined(numbers[:, 0], numbers[:, 1], correlation(known))
            if field == "length":
                used = frozenset(name for name, keeps in zip(known, kept, strict=True) if keeps)
                contradicts = not kept.all()
    length, step, speed = (AT[name] for name in ("length", "step_length", "speed"))
    stepped = next((name for name in names if np.isfinite(value[name][step])), first)
    share = values[length] / value[stepped][length] if value[stepped][length] > 0.0 else np.nan
    values[step], spread[step] = share * values[step], share * spread[step]  # a part of the combined stride
    if value[first][length] > 0.0:
        values[speed] = value[first][speed] * values[length] / value[first][length]
    if sd[first][length] > 0.0:
        spread[speed] = sd[first][speed] * spread[length] / sd[first][length]
    flags = {flag for name in names for flag, of_source in columns[name].flags.items() if of_source[group[name]]}
    return _JoinedStride(first, side, group, values, spread, flags, used, contradicts, names[0] not in sure)


def _table(columns: list[_Columns], groups: list[dict[str, int]], width: SourceEstimate | None) -> JoinedStrides:
    by_name = {each.source.name: each for each in columns}
    rows = sorted((_stride(by_name, group) for group in groups), key=lambda stride: stride.values[AT["start"]])
    side = np.array([stride.side for stride in rows], int)
    values, spread = (dict(zip(FIELDS, np.array([getattr(stride, part) for stride in rows]).T, strict=True))
                      for part in ("values", "spread"))  # fmt: skip
    stated = dict.fromkeys(name for each in columns for name in each.flags)
    flags = {name: np.array([name in stride.flags for stride in rows], bool) for name in stated}
    if width is not None:
        flags["width_valid"] = _widths(values, spread, side, width)
    flags[DOUBTFUL.name] = np.array([stride.doubtful for stride in rows], bool)
    strides, deviations = _strides(side, values), _strides(side, spread)
    none = np.zeros(0)
    whole = Estimate(none, Legs(None, None), None, None, none, dict(flags), strides, strides_stddev=deviations)
    for flag in (STAIRS, HALF, UNEVEN_DURATION):  # as every table reads them
        if (marked := flag.read(whole)) is not None:
            flags[flag.name] = np.asarray(marked, bool)
    return JoinedStrides(
        strides, deviations,
        {name: np.array([stride.group.get(name, -1) for stride in rows], int) for name in by_name},
        {name: np.array([name in stride.used for stride in rows], bool) for name in by_name},
        tuple(stride.first for stride in rows), flags, np.array([stride.contradicts for stride in rows], bool),
    )  # fmt: skip


def correlation(names: Iterable[str]) -> np.ndarray:
    """(k, k) correlation of the errors of sources; ankle and shank are one segment, measured by one method."""
    known = list(names)
    shared = {frozenset(("ankles", "shanks")): 0.5}
    return np.array([[1.0 if a == b else shared.get(frozenset((a, b)), 0.0) for b in known] for a in known])


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


def _strides(side: np.ndarray, columns: dict[str, np.ndarray]) -> Strides:
    """A record of strides; optional columns without any number are None."""
    needed = ("length", "width", "height")
    kept: dict[str, PyTree] = {
        name: values if name in needed or np.isfinite(values).any() else None for name, values in columns.items()
    }
    return Strides(side=side, valid=np.ones(len(side), bool), **kept)
