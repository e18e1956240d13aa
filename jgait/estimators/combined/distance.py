"""The distance of a walk by each source and by all together; what is in doubt counts only if there is no other."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jgait.estimators.ankle_stride.notes import SWINGS_SMALL
from jgait.estimators.combined.sources import SourceEstimate
from jgait.estimators.combined.strides import CONSISTENT, UNLIKE, combined, correlation
from jgait.estimators.ends import WALKING_CUT
from jgait.estimators.leg_ekf.notes import NOT_ESTIMATED
from jgait.estimators.losses import lost_between
from jgait.estimators.notes import LONGEST_LOSS
from jgait.estimators.plausible import SPEED_IMPLAUSIBLE, impossible
from jgait.estimators.proportions import SHARE_SD, SHARES
from jgait.estimators.sides import of_turns
from jgait.estimators.stride_flags import LARGEST_TURN, durations
from jgait.notes import LEFT_OUT, Kind, Note
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Imu, Recording, Strides, as_float

DISTANCES_DIFFER = Kind(
    "distances_differ", "check", "distance: {source} says {distance:.1f} m, {other} {other_distance:.1f} m, more apart "
    "than their deviations allow",
    "At least one of the two is wrong, or some strides are missing in one of them. Both are in the table of sources. "
    "The combined distance is from the sources that no other note puts in doubt; of these, those that most others "
    "agree with, or else the more certain ones.",
)  # fmt: skip
DISTANCE_OF_ONE_SIDE = Kind(
    "distance_of_one_side", "corrected", "distance by {source}: only the {side} side counts, because the sensor of the "
    "other side is in doubt or lost samples", LEFT_OUT,
)  # fmt: skip

DISTANCE_EXTENDED = Kind(
    "distance_extended", "corrected", "distance: {metres:.1f} m of it are before the first and after the last whole "
    "stride, at the median walking speed, because the recording begins or ends in walking",
    "The recording cuts strides off. What is walked there is not measured stride by stride; the deviation contains it.",
)  # fmt: skip

LACKING = (SPEED_IMPLAUSIBLE.code, SWINGS_SMALL.code, *UNLIKE)
"""Codes of an estimator's notes by which its distance is in doubt."""

LEG_DISTANCE_SD = 0.06
"""[1] Standard deviation of the distance of `leg_ekf` over the distance, with measured segments and without a scale
learned on the person; errors on people left out by `experiments/unseen`."""

USUAL_SPEED, USUAL_STRIDE_S = 1.2, 1.1
"""[m/s], [s] Walking speed and duration of a stride, for the distance that a sensor did not see."""

CUT_SD = 0.2
"""[1] Standard deviation of what is walked where the recording cuts a stride off, over it: speed and time differ."""

ALIKE = 0.5
"""[m] Largest difference of what the two sides did not see, with which both count in the distance."""

ONE_SIDE = 0.03
"""[1] Deviation of one side's sum of stride lengths from the mean of both, over that mean: 0.02 to 0.03 on 18 walks of
`walking5m` (root mean square), 0.01 on `tripod`, 0.04 to 0.05 on the one walk of `neura_sparse`."""


class WalkedDistance(NamedTuple):
    """Distance of a whole walk."""

    source: str  #: name of the source, or of the sources that are combined.
    time: np.ndarray  #: (T,) [s].
    distance: np.ndarray  #: (T,) [m].
    stddev: float  #: standard deviation at the end [m].
    doubtful: bool  #: whether its sensors are in doubt, so that it counts only if there is no other.
    cut: float = 0.0  #: what of it is walked before the first and after the last whole stride [m].


class _Side(NamedTuple):
    """What the sensor of one side says about the distance."""

    name: str
    length: float  #: sum of stride lengths [m].
    unknown: float  #: what it did not see [m].
    doubtful: bool
    speed: float  #: median speed [m/s].
    before: float  #: duration of walking before its first stride [s], see `jgait.estimators.ends`.
    after: float  #: and after its last stride [s].


def distances(
    sources: Sequence[SourceEstimate], recording: Recording, person: dict[str, float], wrong: frozenset[str],
    late: frozenset[str],
) -> tuple[list[WalkedDistance], list[Note]]:  # fmt: skip
    """The distance of every source that has one, the most certain first, and notes about sides that do not count.

    Errors of a source's strides are taken to have one cause, so that they add up. The part of the walk that a source
    did not see, because samples are lost, and strides that no person walks count in its deviation. Of two sides the
    distance is the mean, unless one is in doubt or saw less.

    Args:
        sources: the sources.
        recording: the signals.
        person: measures of the person.
        wrong: placements whose signals, label or unit are in doubt.
        late: placements whose clock is; the strides of a single sensor hold nevertheless.
    """
    walked_distances, notes = [], []
    for source in sources:
        estimate = source.estimate
        if estimate.distance is None or source.name == "width":
            continue
        total = float(estimate.distance[-1])
        stated = estimate.diagnostics.get("distance_stddev")
        if stated is not None and source.name != "legs":
            sd = float(np.ravel(stated)[-1])
        elif estimate.strides is not None and estimate.strides_stddev is not None:
            lengths = float(np.nansum(as_float(estimate.strides.length)))
            sd = total * float(np.nansum(as_float(estimate.strides_stddev.length))) / max(lengths, 1e-6)
            if estimate.strides.turn is not None:
                turned = np.nansum(as_float(of_turns(estimate.strides.length, estimate.strides.turn)[1]))
                sd = float(np.hypot(sd, turned / max(len(source.placements), 1)))
        else:
            share = SHARE_SD / SHARES["thigh_length"] if "height" in person else 0.0
            sd = total * float(np.hypot(LEG_DISTANCE_SD, share))
        doubted = _stopped(source) | (wrong if source.name != "legs" else wrong | late)
        sides = _sides(source, recording, doubted)
        used = _best(sides)
        if used and len(used) < len(sides):
            scale = float(np.mean([one.length for one in used]) / max(np.mean([one.length for one in sides]), 1e-6))
            notes.append(DISTANCE_OF_ONE_SIDE(source=source.name, side=used[0].name))
            unknown = float(np.hypot(used[0].unknown, ONE_SIDE * scale * total))
            doubtful = used[0].doubtful or _lacking(source, used[0].name)
        else:
            scale = 1.0
            unknown = float(np.mean([one.unknown for one in sides])) if sides else _not_measured(source, recording)
            doubtful = bool(doubted.intersection(source.placements)) or _lacking(source)
        if total > 0.0 and sd > 0.0:
            time = as_float(estimate.time)
            way, cut = _extended(scale * as_float(estimate.distance), time, used)
            spread = float(np.linalg.norm([scale * sd, unknown, CUT_SD * cut]))
            walked_distances.append(WalkedDistance(source.name, time, way, spread, doubtful, cut))
    return sorted(walked_distances, key=lambda one: one.stddev), notes


def _stopped(source: SourceEstimate) -> frozenset[str]:
    """Placements of a source whose numbers are not to be used by the source's own notes."""
    stops = [note for note in source.estimate.diagnostics["notes"] if note.severity == "stop"]
    return frozenset(name for note in stops for name in source.placements if note.values.get("placement", name) == name)


def _lacking(source: SourceEstimate, side: str = "") -> bool:
    """Whether a source's own notes, of a side only those that concern it, say that steps are missing, or measured
    beyond what the source can measure.
    """
    notes = (note for note in source.estimate.diagnostics["notes"] if note.code in LACKING)
    return any(str(note.values.get("placement", side)).endswith(side) for note in notes)


def _best(sides: list[_Side]) -> list[_Side]:
    """The sides that are not in doubt, if there are any; of these, those that saw the most of the walk."""
    sound = [side for side in sides if not side.doubtful] or sides
    least = min((side.unknown for side in sound), default=0.0)
    return [side for side in sound if side.unknown <= least + ALIKE]


def _sides(source: SourceEstimate, recording: Recording, doubted: frozenset[str]) -> list[_Side]:
    """The sides of a source whose strides are measured by one sensor each; none of other sources."""
    strides = source.estimate.strides
    sides: list[_Side] = []
    if strides is None:
        return sides
    length, beyond = as_float(strides.length), impossible(strides)
    for number, side in enumerate(SIDES):
        of_side = (np.asarray(strides.side) == number) & np.asarray(strides.valid, bool)
        for name in source.placements:
            if name.endswith(side):
                start, end = (as_float(part)[of_side & ~beyond] for part in (strides.start, strides.end))
                unknown = USUAL_SPEED * _not_seen(recording.sensors[name], start, end)
                unknown += float(np.nansum(length[of_side & beyond]))
                lengths, speed = float(np.nansum(length[of_side])), _speed(strides, of_side)
                sides.append(_Side(side, lengths, unknown, name in doubted, speed, *_cut(source, name)))
    return sides


def _cut(source: SourceEstimate, placement: str) -> tuple[float, float]:
    """Duration of walking before the first and after the last stride of a sensor [s]."""
    for note in source.estimate.diagnostics["notes"]:
        if note.code == WALKING_CUT.code and note.values["placement"] == placement:
            return float(note.values["before_s"]), float(note.values["after_s"])
    return 0.0, 0.0


def _speed(strides: Strides, of_side: np.ndarray) -> float:
    """Median speed [m/s] of the strides of a side, without those from standing, and without turns if others remain."""
    speeds = as_float(strides.length) / durations(strides)
    known = of_side & np.isfinite(speeds)
    turns = np.zeros(len(speeds), bool) if strides.turn is None else np.abs(as_float(strides.turn)) > LARGEST_TURN
    chosen = known & ~turns if (known & ~turns).any() else known
    return float(np.median(speeds[chosen])) if chosen.any() else 0.0


def _extended(way: np.ndarray, time: np.ndarray, sides: list[_Side]) -> tuple[np.ndarray, float]:
    """The distance (T,) [m] with what is walked before the first and after the last stride, and the sum of both [m]."""
    total = 0.0
    for side in sides:
        since = np.clip(time - time[0], 0.0, side.before) + np.clip(time - time[-1] + side.after, 0.0, side.after)
        way = way + side.speed * since / len(sides)
        total += side.speed * (side.before + side.after) / len(sides)
    return way, total


def _not_measured(source: SourceEstimate, recording: Recording) -> float:
    """Length [m] of what a source without a sensor for each side did not see of a walk."""
    notes = source.estimate.diagnostics["notes"]
    if source.estimate.strides is None:
        return USUAL_SPEED * sum(float(note.values["seconds"]) for note in notes if note.code == NOT_ESTIMATED.code)
    trunk = recording.sensors[source.placements[0]]
    time = as_float(trunk.time)
    gone = [time[end - 1] - time[begin] for begin, end in true_runs(~np.asarray(trunk.mask, bool))]
    return USUAL_SPEED * float(sum(seconds for seconds in gone if seconds > LONGEST_LOSS))


def _not_seen(imu: Imu, start: np.ndarray, end: np.ndarray) -> float:
    """Duration [s] between strides, given by start and end [s], where so much is lost that strides can be missing."""
    time = as_float(imu.time)
    edges = [np.clip(np.searchsorted(time, at), 0, time.size - 1) for at in ([time[0], *end], [*start, time[-1]])]
    lost = lost_between(~np.asarray(imu.mask, bool), time, *edges)
    total = 0.0
    for after, before, gone in zip([time[0], *end], [*start, time[-1]], lost, strict=True):
        if gone > LONGEST_LOSS:
            total += float(min(before - after, gone + 2.0 * USUAL_STRIDE_S))
    return total


def walked(distances: Sequence[WalkedDistance]) -> tuple[WalkedDistance | None, list[Note]]:
    """The distances of several sources combined by their variances, and a note for each that contradicts the first.

    The combined distance follows the most certain source in time. Doubtful sources count if there are no others; then
    half of the difference between them is part of the deviation.
    """
    if not distances:
        return None, []
    sure = [distance for distance in distances if not distance.doubtful]
    apart = 0.0 if sure else 0.5 * float(np.ptp([distance.distance[-1] for distance in distances]))
    sure = sure or list(distances)
    ends = np.array([distance.distance[-1] for distance in sure])
    shared = correlation([distance.source for distance in sure])
    value, sd, kept = combined(ends, np.array([distance.stddev for distance in sure]), shared)
    best = next(distance for distance, keeps in zip(sure, kept, strict=True) if keeps)
    total = best.distance[-1]
    notes = [
        DISTANCES_DIFFER(
            source=best.source, distance=total, other=distance.source, other_distance=distance.distance[-1]
        )
        for distance in distances
        if abs(distance.distance[-1] - best.distance[-1]) > CONSISTENT * float(np.hypot(distance.stddev, best.stddev))
    ]  # fmt: skip
    if best.cut > 0.0:
        notes.append(DISTANCE_EXTENDED(metres=best.cut))
    used = "+".join(distance.source for distance, keeps in zip(sure, kept, strict=True) if keeps)
    way = best.distance * value / best.distance[-1]
    return WalkedDistance(used, best.time, way, float(np.hypot(sd, apart)), best.doubtful, best.cut), notes
