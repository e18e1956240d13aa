"""The distance of a walk by each source and by all together; doubtful sources count only if there are no others."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jgait.estimators.checks import lost_between
from jgait.estimators.combined.sources import SourceEstimate
from jgait.estimators.combined.strides import CONSISTENT, combined, correlation
from jgait.estimators.notes import LONGEST_LOSS
from jgait.estimators.plausible import knees, too_fast
from jgait.estimators.stride_flags import FEWEST_STRIDES
from jgait.estimators.walking import MID_STANCE, durations
from jgait.notes import Kind, Note
from jgait.quality import of_sensor
from jgait.types import SIDES, Estimate, Imu, Recording, as_float

DISTANCES_DIFFER = Kind(
    "distances_differ", "check", "distance: {source} says {distance:.1f} m, {other} {other_distance:.1f} m, more apart "
    "than their deviations allow",
    "At least one of the two is wrong, or some strides are missing in one of them. Both are in the table of sources. "
    "The combined distance is from the sources that no other note puts in doubt; of these, those that most others "
    "agree with, or else the more certain ones.",
)  # fmt: skip
DISTANCE_OF_ONE_SIDE = Kind(
    "distance_of_one_side", "corrected", "distance by {source}: only the {side} side counts, because the sensor of the "
    "other side is in doubt, lost samples or lacks strides while this side walks",
    "Both feet of a person walk as far: the distance, and its deviation, are those of this side.",
)  # fmt: skip
DISTANCE_ADDED = Kind(
    "distance_added", "corrected", "distance: {metres:.1f} m of it are {where}, at the median walking speed",
    "What is walked where the recording cuts strides off or loses samples is not measured stride by stride; the "
    "deviation contains it. A person who stood still in a loss walked less.",
)  # fmt: skip

USUAL_SPEED, USUAL_STRIDE_S = 1.2, 1.1
"""[m/s], [s] Walking speed and duration of a stride of healthy adults, for the distance that a sensor did not see;
chosen by hand."""


class WalkedDistance(NamedTuple):
    """Distance of a whole walk."""

    source: str  #: name of the source, or of the sources that are combined.
    time: np.ndarray  #: (T,) [s].
    distance: np.ndarray  #: (T,) [m].
    stddev: float  #: standard deviation at the end [m].
    doubtful: bool  #: whether its sensors are in doubt, so that it counts only if there is no other.
    cut: float = 0.0  #: what of it is walked before the first and after the last whole stride [m].
    bridged: float = 0.0  #: what of it is walked in strides that losses cut off [m].
    unseen: float = 0.0  #: standard deviation of what is not measured [m], part of `stddev`.


type Spans = list[tuple[float, float]]
"""Begin and end [s] of each of several parts of a recording."""


class _Side(NamedTuple):
    """The distance by the sensor of one side, or of the trunk."""

    name: str
    rows: np.ndarray  #: its strides, in the order of their starts.
    length: float  #: sum of stride lengths [m].
    unknown: float  #: what it did not see, and is not in the distance [m].
    doubtful: bool
    speed: float  #: median speed [m/s].
    lacking: float  #: standard deviation of what swings too small to be counted add [m].
    #: "cut", walking before the first and after the last stride, and "bridged", losses in walking → begin and end [s].
    added: dict[str, Spans]


def distances(
    sources: Sequence[SourceEstimate], recording: Recording, wrong: frozenset[str], late: frozenset[str],
    rates_share: float = 0.0,
) -> tuple[list[WalkedDistance], list[Note]]:  # fmt: skip
    """The distance of every source that has one, the most certain first, and notes about sides that do not count.

    Errors of a source's strides are taken to have one cause, so that they add up. Its deviation contains lost samples.
    The distance is the mean of two sides, unless one is in doubt or lost more. `wrong` are placements whose signals,
    label or unit are in doubt, `late` those whose clock is, and `rates_share` is that of `with_time_wrong`.
    """
    walked_distances, notes = [], []
    runs = any(facts.runs for source in sources for facts in source.quality.values())
    for source in sources:
        estimate, legs = source.estimate, source.name == "legs"
        if estimate.distance is None or source.name == "width":
            continue
        total = float(estimate.distance[-1])
        sd = float(np.ravel(estimate.diagnostics["distance_stddev"])[-1])
        if legs:  # the deviations of other sources contain the error of rates
            sd = float(np.hypot(sd, rates_share * total))
        useless = any(knee.lost or knee.implausible for knee in knees(estimate).values())
        doubted = {name for name in source.placements if useless or of_sensor(source.quality, name).unusable}
        doubted |= wrong | late if legs else wrong
        sides = _sides(source, recording, doubted)
        # sides that are not in doubt, or else all; of these, those that do not lack more than others, by 0.5 m
        sound = [side for side in sides if not side.doubtful and side.length > 0.0] or sides
        least = min((side.unknown for side in sound), default=0.0)
        used = [side for side in sound if side.unknown <= least + 0.5]
        way, doubtful = as_float(estimate.distance), bool(doubted.intersection(source.placements)) or _lacking(source)
        doubtful |= runs and legs  # in the flight phase no foot carries the hip
        if len(used) < len(sides):
            scale = float(np.mean([side.length for side in used]) / max(np.mean([side.length for side in sides]), 1e-6))
            # sums of one side's stride lengths deviate by 0.01 to 0.05 from the mean of both on recorded walks
            way, sd = _by_strides(estimate, used[0].rows, scale * total), scale * float(np.hypot(sd, 0.03 * total))
            doubtful = used[0].doubtful or _lacking(source, used[0].name)
            notes.append(DISTANCE_OF_ONE_SIDE(source=source.name, side=used[0].name))
        if total > 0.0 and sd > 0.0:
            walked_distances.append(_whole(source, way, sd, doubtful, used))
    return sorted(walked_distances, key=lambda distance: distance.stddev), notes


def _lacking(source: SourceEstimate, side: str = "") -> bool:
    """True if steps of a source, or of one side of it, are missing, or are beyond what it can measure."""
    quality = (facts for name, facts in source.quality.items() if name.endswith(side))
    return too_fast(source.estimate) or any(facts.runs or facts.unlike for facts in quality)


def _sides(source: SourceEstimate, recording: Recording, doubted: set[str]) -> list[_Side]:
    """The sides of a source whose strides are measured by one sensor each, or the trunk; none without strides."""
    strides = source.estimate.strides
    if strides is None or not np.any(strides.valid):
        return []
    length, end, lasts = as_float(strides.length), as_float(strides.end), durations(strides)
    usual = float(np.nanmedian(lasts)) if np.isfinite(lasts).any() else USUAL_STRIDE_S
    start = as_float(strides.start) - np.where(np.isfinite(lasts), 0.0, 2.0 * MID_STANCE * usual)  # from the stance
    order = np.argsort(start, kind="stable")
    order = order[np.asarray(strides.valid, bool)[order]]
    of_sides = [order[np.asarray(strides.side)[order] == number] for number in range(len(SIDES))]
    spans = np.stack([as_float(strides.start), end], axis=1)
    begin, until = (float(source.estimate.time[row]) for row in (0, -1))
    sides = []
    for name in source.placements:
        side = next((side for side in SIDES if name.endswith(side)), "")
        rows = of_sides[SIDES.index(side)] if side else order
        timed = rows[np.isfinite(lasts[rows])]
        speed = float(np.nanmedian(length[timed] / lasts[timed])) if timed.size else USUAL_SPEED
        seconds, bridged = _not_seen(recording.sensors[name], start[rows], end[rows], usual)
        unknown = USUAL_SPEED * seconds
        if side:
            unknown += speed * _other_alone(spans[rows], spans[of_sides[1 - SIDES.index(side)]])
        facts = of_sensor(source.quality, name)
        # steps that a shank missed in simulated walks of 0.1 to 0.15 m/s have 0.4 to 1 of the median stride; chosen
        lacking = 0.5 * facts.small_swings * float(np.nanmedian(length[rows])) if rows.size else 0.0
        cut = [(begin, begin + facts.walks_before), (until - facts.walks_after, until)]
        added = {"cut": [(first, last) for first, last in cut if last > first], "bridged": bridged}
        total = float(np.nansum(length[rows]))
        sides.append(_Side(side, rows, total, unknown, name in doubted, speed, lacking, added))
    return sides


def _other_alone(mine: np.ndarray, other: np.ndarray) -> float:
    """Time [s] in which the other leg takes `FEWEST_STRIDES` strides or more and this leg none, from start and end of
    the strides of both (n, 2): its sensor fell off, or was put on anew in a way in which it finds none.
    """
    seconds = 0.0
    for after, before in zip([-np.inf, *np.maximum.accumulate(mine[:, 1])], [*mine[:, 0], np.inf], strict=True):
        alone = other[(other[:, 0] >= after) & (other[:, 1] <= before)]
        if len(mine) and len(alone) >= FEWEST_STRIDES:
            seconds += float(np.ptp(alone))
    return seconds


def _whole(source: SourceEstimate, way: np.ndarray, sd: float, doubtful: bool, used: list[_Side]) -> WalkedDistance:
    """The distance of a source, with the distance walked in times that no stride of its sides covers. The distance of
    the trunk contains short losses, in which its strides are left out.
    """
    time, measured_way = as_float(source.estimate.time), way
    added = {"cut": 0.0, "bridged": 0.0}
    for side in used:
        for name, spans in side.added.items():
            for begin, end in spans:
                gained = 0.0 if side.name else float(np.diff(np.interp([begin, end], time, measured_way))[0])
                metres = max(side.speed * (end - begin) - gained, 0.0) / len(used)
                way = way + np.interp(time, [begin, end], [0.0, metres])
                added[name] += metres
    unknown, lacking = USUAL_SPEED * float(np.median(np.diff(time)) * np.sum(~np.asarray(source.estimate.valid))), 0.0
    if used:
        unknown, lacking = np.mean([(side.unknown, side.lacking) for side in used], axis=0).tolist()
    # [1] a person can also stand still there; chosen
    unseen = float(np.linalg.norm([unknown, *(0.3 * metres for metres in added.values())]))
    spread = float(np.linalg.norm([sd, unseen, lacking]))
    return WalkedDistance(source.name, time, way, spread, doubtful, **added, unseen=unseen)


def _by_strides(estimate: Estimate, rows: np.ndarray, total: float) -> np.ndarray:
    """(T,) [m] distance along some strides, `total` at its end. In the mean of both sides, a bout that only one side
    measured would have a part of its length.
    """
    strides, time = estimate.strides, as_float(estimate.time)
    if not len(rows):
        return np.zeros(time.size)
    start, end, length = (as_float(column)[rows] for column in (strides.start, strides.end, strides.length))
    knots = np.maximum.accumulate(np.stack([start, end], axis=1).ravel())
    done = np.cumsum(np.nan_to_num(length))
    way = np.interp(time, knots, np.stack([done - np.nan_to_num(length), done], axis=1).ravel())
    return np.asarray(way * (total / max(float(done[-1]), 1e-6)))


def _not_seen(imu: Imu, start: np.ndarray, end: np.ndarray, usual: float) -> tuple[float, Spans]:
    """Walking that is lost between strides, which are given by start and end [s] in the order of their starts: the
    duration [s] in which strides can be missing, and the losses in walking between two strides.

    A stride is measured from one stance to the next, so that a loss up to the middle of the stance after its end can
    take it away. `usual` is the duration of a stride [s].
    """
    time, lost, seconds, bridged = as_float(imu.time), ~np.asarray(imu.mask, bool), 0.0, []
    after, before = np.maximum.accumulate([time[0], *end]), np.array([*start, time[-1]])
    first, last, stance = (
        np.clip(np.searchsorted(time, at), 0, time.size - 1) for at in (after, before, before + MID_STANCE * usual)
    )
    of_gaps, near = (lost_between(lost, time, first, until) for until in (last, stance))
    for number, (begin, until, gone) in enumerate(zip(after, before, of_gaps, strict=True)):
        if gone <= LONGEST_LOSS and (near[number] == 0.0 or until - begin < 0.6 * usual):
            continue
        # a lost stance removes two strides and a part of a third
        if 0 < number < len(start) and until - begin < gone + 3.0 * max(usual, USUAL_STRIDE_S):
            bridged.append((float(begin), float(until)))
        elif gone > LONGEST_LOSS:
            seconds += float(min(until - begin, gone + 2.0 * USUAL_STRIDE_S))
    return seconds, bridged


def walked(distances: Sequence[WalkedDistance]) -> tuple[WalkedDistance | None, list[Note]]:
    """The distances of several sources combined by their variances, and a note for each that contradicts the first.

    Walking that no source measured has the same error in all of them. The combined distance follows the most certain
    source in time. Doubtful sources count if there are no others; then half of the difference between them, and a
    tenth, are part of the deviation.
    """
    if not distances:
        return None, []
    apart, sure = 0.0, [distance for distance in distances if not distance.doubtful]
    if not sure:
        totals, sure = np.array([distance.distance[-1] for distance in distances]), list(distances)
        apart = float(np.hypot(0.5 * np.ptp(totals), 0.1 * totals.mean()))  # chosen with simulated runners
    ends, common = np.array([distance.distance[-1] for distance in sure]), min(distance.unseen for distance in sure)
    # [m²] variances can be compared
    independent_sd = np.sqrt(np.maximum(np.square([distance.stddev for distance in sure]) - common**2, 1e-12))
    value, sd, kept = combined(ends, independent_sd, correlation([distance.source for distance in sure]))
    used = [distance for distance, keeps in zip(sure, kept, strict=True) if keeps]
    best, total = used[0], used[0].distance[-1]
    notes = [
        DISTANCES_DIFFER(source=best.source, distance=total, other=each.source, other_distance=each.distance[-1])
        for each in distances
        if abs(each.distance[-1] - total) > CONSISTENT * float(np.hypot(each.stddev, best.stddev))
    ]
    for metres, where in (
        (best.cut, "before the first and after the last whole stride"),
        (best.bridged, "in strides that losses of samples cut off"),
    ):  # fmt: skip
        if metres >= 0.05:  # less is 0.0 m in words
            notes.append(DISTANCE_ADDED(metres=metres, where=where))
    name, spread = "+".join(distance.source for distance in used), float(np.linalg.norm([sd, common, apart]))
    return best._replace(source=name, distance=best.distance * value / total, stddev=spread), notes
