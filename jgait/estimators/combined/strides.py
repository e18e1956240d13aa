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
    durations,
)
from jgait.notes import record
from jgait.types import SIDES, Estimate, Flags, Legs, Strides, as_float

SAME = 0.5
"""[1] Two strides of a side are the same if the time they share is more than this part of the time they cover."""

SAME_CONTACT = 0.25
"""[s] Contacts of a side, from two sensors, that are closer than this are the same; so are strides that end there."""

ALONE = 0.3
"""[1] A stride that is not in the first sources is added if it overlaps their strides by less than this part of it."""

CONSISTENT = 3.0
"""[1] Values of a stride are combined if they differ by fewer standard deviations of their difference than this."""

OFTEN = 1.0 / 3.0
"""[1] Share of a source's common strides that contradict others, above which the source contradicts often; chosen."""

BRIEF = 0.6
"""[1] A stride that lasts less than this part of the median stride, and is not from or to standing, is wrong."""

LEG_WORN = ("feet", "ankles", "shanks")
"""Sources whose sensors are on the legs; contacts by a trunk are less certain than theirs."""

SHARED = {frozenset(("ankles", "shanks")): 0.5}
"""Correlation of the errors of two sources [1]; chosen: ankle and shank are one segment, measured by one method."""

FIELDS = tuple(name for name in Strides._fields if name not in ("side", "valid"))
"""Quantities of a stride."""

TIMES = ("start", "final_contact", "end", "standing", "standing_end", "speed")
"""Quantities of a stride from its first source, or from sources with the same clock."""

PITCHES = ("contact_angle", "push_off_angle")
"""Quantities of a stride at its contacts."""

COMBINED = ("length", "height", "turn")
"""Quantities of a stride that are combined; others are those of the first source that has them."""

FLAGS = {flag.name: flag.read for flag in (TURNING, STAIRS, HALF, CLIPPED, UNSURE, SIDE_UNKNOWN)}
FLAGS[UNEVEN_DURATION.name] = lambda estimate: estimate.diagnostics.get(UNEVEN_DURATION.name)
"""Flag of strides → function of a source's estimate: (strides,) bool, or None."""


@record
class JoinedStrides(NamedTuple):
    """Strides of all sources, each once, (n,) in the order of their starts.

    Attributes:
        strides: the strides.
        stddev: their standard deviations.
        rows: source → (n,) row of the stride in the source's estimate; −1 where the source lacks the stride.
        used: source → (n,) bool, the source's length is part of the combined length.
        first: (n,) name of the source of times and flags.
        flags: name of a flag → (n,) bool.
        contradicts: (n,) bool, lengths of sources differ by more than `CONSISTENT`.
    """

    strides: Strides
    stddev: Strides
    rows: dict[str, np.ndarray]
    used: dict[str, np.ndarray]
    first: tuple[str, ...]
    flags: dict[str, np.ndarray]
    contradicts: np.ndarray


def joined(
    sources: Sequence[SourceEstimate], doubtful: frozenset[str] = frozenset(), wrong: frozenset[str] = frozenset()
) -> JoinedStrides | None:
    """The strides of all sources as one table; None if no source has a stride.

    Args:
        sources: in the order in which times are preferred.
        doubtful: placements whose times do not count, unless nothing else is left.
        wrong: those of them whose strides are in doubt themselves, and not only their times. Lengths of the others
            count for the strides that they are the same as.
    """
    having = [source for source in sources if source.estimate.strides is not None and source.name != "width"]
    if not having:
        return None
    trusted = {(s.name, side): _trusted(s, side, doubtful) for s in having for side in SIDES}
    groups: list[dict[str, int]] = []
    for number, side in enumerate(SIDES):
        # doubtful sources come last, so that their times and strides count only where no other source has any
        order = sorted(having, key=lambda source: not trusted[source.name, side])
        alone = not any(trusted[source.name, side] for source in having)
        of_side: list[tuple[float, float, dict[str, int]]] = []
        for source in order:
            if trusted[source.name, side] or alone or not of_side:
                _add(of_side, source, number)
            elif _trusted(source, side, wrong):
                _add(of_side, source, number, new=False)
        groups += [group for *_, group in of_side]
    if not groups:
        return None
    doubts = {source.name: _doubted(source, wrong) for source in having}
    unlike = [s.name for s in having if any(facts.unlike or facts.runs for facts in s.quality.values())]
    if len(unlike) < len(having):
        doubts |= {name: np.ones_like(doubts[name]) for name in unlike}
    return _table(having, groups, trusted, doubts, next((s for s in sources if s.name == "width"), None))


def _trusted(source: SourceEstimate, side: str, doubtful: frozenset[str]) -> bool:
    placements = [name for name in source.placements if name.endswith(side) or not name.endswith(SIDES)]
    return not doubtful.intersection(placements)


def _add(
    groups: list[tuple[float, float, dict[str, int]]], source: SourceEstimate, side: int, *, new: bool = True
) -> None:
    """Add the strides of a source and a side to the strides that they are the same as, or as `new` ones."""
    strides, unknown = source.estimate.strides, source.estimate.diagnostics.get("side_unknown")
    rows = np.flatnonzero((np.asarray(strides.side) == side) & np.asarray(strides.valid, bool))
    before = list(groups)
    for row in rows:
        if unknown is not None and unknown[row] and before:
            continue
        start, end = float(strides.start[row]), float(strides.end[row])
        shared = [max(0.0, min(end, b) - max(start, a)) for a, b, _ in before]
        alike = [
            1.0 if abs(end - b) < SAME_CONTACT else share / (max(end, b) - min(start, a))
            for share, (a, b, _) in zip(shared, before, strict=True)
        ]
        best = int(np.argmax(alike)) if alike else -1
        if best >= 0 and alike[best] > SAME and source.name not in before[best][2]:
            before[best][2][source.name] = int(row)
        elif new and (not alike or max(shared) < ALONE * (end - start)):
            groups.append((start, end, {source.name: int(row)}))


def _table(
    sources: Sequence[SourceEstimate], groups: list[dict[str, int]], trusted: Mapping[tuple[str, str], bool],
    doubts: Mapping[str, np.ndarray], width: SourceEstimate | None,
) -> JoinedStrides:  # fmt: skip
    by_name = {source.name: source for source in sources}
    marks = {name: {flag: read(source.estimate) for flag, read in FLAGS.items()} for name, source in by_name.items()}
    lasts = {s.name: as_float(s.estimate.strides.end) - as_float(s.estimate.strides.start) for s in sources}
    usual = float(np.median([lasts[name][row] for group in groups for name, row in group.items()]))
    rows = [_told(by_name, group, trusted, doubts, marks, usual) for group in groups]
    rows.sort(key=lambda stride: stride.values["start"])
    rows = _alone(rows, _walks(sources))
    n = len(rows)
    side = np.array([stride.side for stride in rows], int)
    values = {name: np.array([stride.values[name] for stride in rows], float) for name in FIELDS}
    spread = {name: np.array([stride.spread[name] for stride in rows], float) for name in FIELDS}
    flags = {name: np.array([stride.flags[name] for stride in rows], bool) for name in FLAGS}
    known = {flag for source_marks in marks.values() for flag, column in source_marks.items() if column is not None}
    flags = {name: flag for name, flag in flags.items() if name in known}
    if width is not None:
        flags["width_valid"] = _widths(values, spread, side, width)
    flags[DOUBTFUL.name] = np.array([stride.doubtful for stride in rows], bool)
    strides, deviations = _strides(side, values), _strides(side, spread)
    none = np.zeros(0)
    whole = Estimate(none, Legs(None, None), None, None, none, dict(flags), strides, strides_stddev=deviations)
    for flag in (STAIRS, HALF, UNEVEN_DURATION):  # as every table reads them
        if (marked := flag.read(whole)) is not None:
            flags[flag.name] = np.asarray(marked, bool)
    flags[UNEVEN_DURATION.name] |= ~flags[HALF.name] & (durations(strides) < BRIEF * usual)
    return JoinedStrides(
        strides, deviations,
        {name: np.array([stride.group.get(name, -1) for stride in rows], int).reshape(n) for name in by_name},
        {name: np.array([name in stride.used for stride in rows], bool) for name in by_name},
        tuple(stride.first for stride in rows), flags, np.array([stride.contradicts for stride in rows], bool),
    )  # fmt: skip


def _doubted(source: SourceEstimate, wrong: frozenset[str]) -> np.ndarray:
    """(n,) bool, strides that contradict the source's model, that nobody walks, or that a wrong sensor measured."""
    strides = source.estimate.strides
    lasts = as_float(strides.end) - as_float(strides.start)
    brief = lasts < BRIEF * np.median(lasts) if len(lasts) else np.zeros(0, bool)
    untrusted = np.array([not _trusted(source, side, wrong) for side in SIDES])[np.asarray(strides.side)]
    doubted = impossible(strides) | (brief & ~HALF.read(source.estimate)) | untrusted
    flagged = DOUBTFUL.read(source.estimate)
    return np.asarray(doubted if flagged is None else doubted | flagged)


class _Told(NamedTuple):
    """One stride, with the values of its sources."""

    first: str
    side: int
    group: dict[str, int]
    values: dict[str, float]
    spread: dict[str, float]
    flags: dict[str, bool]
    used: frozenset[str]
    contradicts: bool
    doubtful: bool


def _walks(sources: Sequence[SourceEstimate]) -> list[tuple[int, float, float]]:
    """Side, and begin and end of walking [s] by the sensor of a leg that neither lost samples nor cuts strides off."""
    walks = []
    for source in sources:
        strides = source.estimate.strides
        unsure = [name for name, facts in source.quality.items() if facts.incomplete]
        for side in range(len(SIDES)) if source.name in LEG_WORN else ():
            mine = np.asarray(strides.valid, bool) & (np.asarray(strides.side) == side)
            if mine.any() and not any(name.endswith(SIDES[side]) for name in unsure):
                begin, end = as_float(strides.start)[mine].min(), as_float(strides.end)[mine].max()
                walks.append((side, float(begin), float(end)))
    return walks


def _alone(joined: list[_Told], walks: list[tuple[int, float, float]]) -> list[_Told]:
    """The strides, with doubt where the length comes only from sources that often contradict others, or from the trunk
    before or after the walking that the leg's own sensors measure.
    """
    shared = [stride for stride in joined if len(stride.group) > 1]
    left = {
        name: [name not in stride.used for stride in shared if name in stride.group]
        for stride in joined
        for name in stride.group
    }
    wrong = {name for name, out in left.items() if out and np.mean(out) > OFTEN}

    def doubted(stride: _Told) -> bool:
        beyond = any(
            side == stride.side and not begin <= 0.5 * (stride.values["start"] + stride.values["end"]) <= end
            for side, begin, end in walks
        )
        return wrong.issuperset(stride.used) or (beyond and set(stride.group) == {"waist"})

    return [stride._replace(doubtful=stride.doubtful or doubted(stride)) for stride in joined]


def _told(
    by_name: Mapping[str, SourceEstimate], group: dict[str, int], trusted: Mapping[tuple[str, str], bool],
    doubts: Mapping[str, np.ndarray], marks: Mapping[str, Mapping[str, Flags]], usual: float,
) -> _Told:  # fmt: skip
    """A stride from its row in each source; rows in doubt count only where no other source has the stride.

    If the clock of a source is in doubt, all but its times count. Where contacts of two sources on the legs differ,
    times are those of the source whose duration is nearer to the `usual` one [s].
    """
    every = [name for name in by_name if name in group]
    side = int(by_name[every[0]].estimate.strides.side[group[every[0]]])
    timed = [name for name in every if trusted[name, SIDES[side]]] or every
    timed = [name for name in timed if not doubts[name][group[name]]] or timed
    names = [name for name in every if not doubts[name][group[name]]] or timed
    worn = [name for name in timed if name in LEG_WORN]
    at = {name: np.array([_of(by_name[name], end, group[name])[0] for end in ("start", "end")]) for name in worn}
    wrong: set[str] = set()
    if not any(_marked(marks[name], flag, group[name]) for name in worn for flag in (HALF.name, TURNING.name)):
        even = min(worn, key=lambda name: abs(float(np.ptp(at[name])) - usual), default="")
        if any(np.abs(at[name] - at[worn[0]]).max() > SAME_CONTACT for name in worn):
            wrong = {name for name in worn if np.abs(at[name] - at[even]).max() > SAME_CONTACT}
            timed = [even, *(name for name in timed if name not in wrong and name != even)]
    first = timed[0]
    values, spread, given = {}, {}, {}
    for field in FIELDS:
        of_field = timed if field in TIMES else [name for name in names if name not in wrong or field not in PITCHES]
        known = {name: _of(by_name[name], field, group[name]) for name in of_field}
        given[field] = next((name for name, (value, _) in known.items() if np.isfinite(value)), first)
        values[field], spread[field] = known.get(given[field], (np.nan, np.nan))
    (length, length_sd), (speed, speed_sd) = (_of(by_name[first], name, group[first]) for name in ("length", "speed"))
    used, contradicts = frozenset([names[0]]), False
    for field in COMBINED:
        known = {name: _of(by_name[name], field, group[name]) for name in names}
        known = {name: (value, sd) for name, (value, sd) in known.items() if np.isfinite(value) and sd > 0.0}
        if known:
            numbers = np.array(list(known.values()))
            values[field], spread[field], kept = combined(numbers[:, 0], numbers[:, 1], correlation(known))
            if field == "length":
                used = frozenset(name for name, keeps in zip(known, kept, strict=True) if keeps)
                contradicts = not kept.all()
    stepped = given["step_length"]
    stepped_length, _ = _of(by_name[stepped], "length", group[stepped])
    share = values["length"] / stepped_length if stepped_length > 0.0 else np.nan
    if contradicts and stepped not in used:  # half of a length that is not used
        share = np.nan
    for both in (values, spread):  # a part of the combined stride
        both["step_length"] *= share
    if length > 0.0:
        values["speed"] = speed * values["length"] / length
    if length_sd > 0.0:
        spread["speed"] = speed_sd * spread["length"] / length_sd
    flags = {flag: any(_marked(marks[name], flag, group[name]) for name in names) for flag in FLAGS}
    return _Told(first, side, group, values, spread, flags, used, contradicts, bool(doubts[names[0]][group[names[0]]]))


def _marked(marks: Mapping[str, Flags], flag: str, row: int) -> bool:
    """Whether a source states a flag of one of its strides."""
    return marks[flag] is not None and bool(marks[flag][row])


def correlation(names: Iterable[str]) -> np.ndarray:
    """(k, k) correlation of the errors of sources, see `SHARED`."""
    known = list(names)
    return np.array([[1.0 if a == b else SHARED.get(frozenset((a, b)), 0.0) for b in known] for a in known])


def combined(
    values: np.ndarray, deviations: np.ndarray, correlation: np.ndarray | None = None
) -> tuple[float, float, np.ndarray]:
    """Weighted mean of measurements (k,) with the least variance, its standard deviation, and (k,) bool, the
    measurements used.

    Two measurements agree if they differ by at most `CONSISTENT` standard deviations of the difference. The mean
    contains the measurement with which most independent ones agree, and these; if several have as many, the most
    certain of them.
    Correlated measurements count as fewer, because sources with the same method share its errors. The others are not
    used; if as many independent ones support one of them, the deviation includes half of the difference from it.
    `correlation` (k, k) is that of the errors; None: independent.
    """
    cov = np.outer(deviations, deviations) * (np.eye(len(values)) if correlation is None else correlation)
    apart = np.abs(values[:, None] - values)
    spread = np.sqrt(np.diag(cov)[:, None] + np.diag(cov) - 2.0 * cov)
    # of those that agree with one, only the less certain ones support it: what is uncertain agrees with everything
    agree = (apart <= CONSISTENT * spread) & (deviations[:, None] <= deviations)
    support = [_independent(cov[np.ix_(members, members)]) for members in agree]
    best = min(range(len(cov)), key=lambda number: (-support[number], deviations[number]))
    kept = agree[best]
    rivals = [apart[best, number] for number in np.flatnonzero(~kept) if support[number] == support[best]]
    mean, variance = _mean(values[kept], cov[np.ix_(kept, kept)])
    return mean, float(np.hypot(np.sqrt(variance), 0.5 * min(rivals, default=0.0))), kept


def _independent(cov: np.ndarray) -> int:
    """Number of independent measurements with the same information as correlated ones, rounded down."""
    deviations = np.sqrt(np.diag(cov))
    return int(np.linalg.solve(cov / np.outer(deviations, deviations), np.ones(len(cov))).sum() + 1e-9)


def _mean(values: np.ndarray, cov: np.ndarray) -> tuple[float, float]:
    """The mean of the least variance, with weights that are not negative, and its variance."""
    weights = np.linalg.solve(cov, np.ones(len(values)))
    weights = np.maximum(weights, 0.0)  # a strongly correlated, less certain measurement would get a negative weight
    weights = weights / weights.sum()
    return float(weights @ values), float(weights @ cov @ weights)


def _widths(
    values: dict[str, np.ndarray], spread: dict[str, np.ndarray], side: np.ndarray, width: SourceEstimate
) -> np.ndarray:
    """Widths and step lengths of the strides, from those that end at the same time; (n,) bool, reliable widths."""
    theirs = width.estimate.strides
    valid = np.zeros(len(side), bool)
    trusted = width.estimate.diagnostics.get("width_valid")
    for i in range(len(side)):
        near = np.abs(as_float(theirs.end) - values["end"][i]) < SAME_CONTACT
        same = np.flatnonzero(near & (np.asarray(theirs.side) == side[i]))
        if same.size:
            for field in ("width", "step_length"):
                values[field][i], spread[field][i] = _of(width, field, int(same[0]))
            valid[i] = trusted is None or bool(trusted[same[0]])
    return valid


def _of(source: SourceEstimate, field: str, row: int) -> tuple[float, float]:
    """One number of a stride of a source, and its standard deviation; NaN if the source does not give it."""
    tables = source.estimate.strides, source.estimate.strides_stddev
    value, sd = (np.nan if (column := getattr(table, field, None)) is None else float(column[row]) for table in tables)
    return value, sd


def _strides(side: np.ndarray, columns: dict[str, np.ndarray]) -> Strides:
    """A record of strides; optional columns without any number are None."""
    needed = ("length", "width", "height")
    kept: dict[str, PyTree] = {
        name: values if name in needed or np.isfinite(values).any() else None for name, values in columns.items()
    }
    return Strides(side=side, valid=np.ones(len(side), bool), **kept)
