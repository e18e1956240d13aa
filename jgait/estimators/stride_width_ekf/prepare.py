"""Inputs of the stride width estimator, from trajectories of both feet and ranges. NumPy, on the host.

This module selects the ranges and detects turns. It has no gradient; `stride_width_ekf.run` is differentiable for given
inputs. Without a range, `passings` takes its place.
"""

import itertools
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
import numpy.typing as npt

from jgait.estimators.interface import Axis, Held, Prepared, Sampled
from jgait.estimators.stride_width_ekf.model import PathControl
from jgait.estimators.stride_width_ekf.params import DEFAULT, WidthOptions
from jgait.estimators.stride_width_ekf.trajectories import FootTrack, Pair, checked_feet, contact_times
from jgait.notes import NO_RANGE, Kind, Note, record
from jgait.types import Feet, RangeReadings, RecordingError, Values

FEW_STRIDES = Kind(
    "few_strides", "check", "a foot has {strides} {strides:stride|strides}, and two of each are needed: no widths",
    "Stride widths are stated from two strides of each foot on; a longer walk has them.",
)  # fmt: skip
RANGE_ABSENT = Kind("range_absent", "check", "{why}: widths have the mean of usual people", NO_RANGE)
RANGES_LEFT_OUT = Kind(
    "ranges_left_out", "corrected", "left out {ranges} {ranges:range|ranges} {why}",
    "Distances between the feet that cannot be right, or come at the wrong moment, were not used.",
)  # fmt: skip

HALF_PASSING = 0.12
"""[s] Readings closer than this to each other, or to the shortest one, belong to one passing of the feet: chosen by
hand, below a quarter of a stride."""


class StrideRows(NamedTuple):
    """Strides of both feet as indices of moments in `WidthInputs`; every field is (N,), with padding at the end."""

    side: np.ndarray  #: 0 right, 1 left.
    moment: np.ndarray  #: index of the moment at the end of the stride, the middle of its second stance.
    start: np.ndarray  #: initial contact at the start of the stride [s].
    final_contact: np.ndarray  #: final contact [s].
    end: np.ndarray  #: initial contact at the end of the stride [s].
    standing: np.ndarray  #: middle of the first stance [s].
    standing_end: np.ndarray  #: middle of the second stance [s].
    height: np.ndarray  #: rise from stance to stance [m].
    turn: np.ndarray  #: change of heading from the previous stride [rad].
    passed: np.ndarray  #: True if the other foot has exactly one stance in between.
    valid: np.ndarray  #: False for padding.


@record
class WidthInputs(NamedTuple):
    """Inputs of `stride_width_ekf.run` at N moments: stances, ranges, double support; every leaf is an array, so that
    inputs can be padded, stacked and mapped.
    """

    time: Held  #: (N,) [s].
    right: Annotated[PathControl, Axis()]  #: control over the interval that ends at each moment, fields (N,).
    left: Annotated[PathControl, Axis()]
    height_right: Held  #: (N,) height of the right foot's sensor in the world frame of its trajectory [m].
    height_left: Held
    #: (N,) measured range, or without one how far swinging feet keep outside, see `passings` [m]; 0 at other moments.
    distance: Sampled
    range_measured: Sampled  #: (N,) bool, True at moments with a usable range.
    turning: Sampled  #: (N,) bool, True in a turn of one of the feet.
    double_support: Sampled  #: (N,) bool, both feet are on the ground.
    usual: np.ndarray  #: bool, True: there is no range, and feet pass each other as those of usual people.
    start_heading: np.ndarray  #: (2,) heading of the right and of the left foot before the first moment [rad].
    strides: Annotated[StrideRows, Axis()]  #: strides and the moments at which they end.
    valid: Sampled  #: (N,) bool, False for padding.


def prepare_from_feet(
    time: Values, feet: Feet, stances: tuple[npt.ArrayLike, npt.ArrayLike], feet_range: RangeReadings | None,
    options: WidthOptions = DEFAULT, *, start_heading: tuple[float, float] = (0.0, 0.0),
) -> Prepared[WidthInputs]:  # fmt: skip
    """Make the inputs of `stride_width_ekf.run` from trajectories of any method.

    Args:
        time: (T,) [s], of both feet, strictly increasing.
        feet: trajectories, each in a separate world with z up; rows that are not finite are interpolated.
        stances: for the right and the left foot the samples in the middle of its stances, increasing.
        feet_range: distance from the inner side of the left ankle to the right leg, or None: then feet pass each other
            as those of usual people.
        options: limits for the selection of ranges.
        start_heading: heading of the first right and left stride in one world [rad]; by default parallel, as at
            the start of a straight walk.

    Returns:
        Inputs and options. `notes` lists ranges that were left out, and missing strides.

    Raises:
        RecordingError: a foot is missing, shapes differ, time runs backwards, stances are not samples or not in order.
    """
    pair, notes = checked_feet(time, feet, stances)
    # start and end of each turn of a foot [s]: the two strides between which its heading changes
    turning = [
        (foot.mids[k], foot.mids[k + 2])
        for foot in pair for k in np.flatnonzero(np.abs(np.diff(foot.heading)) > options.turn)
    ]  # fmt: skip
    times, distances, more = _usable(pair, turning, feet_range, options)
    notes += more
    if usual := options.usual_passings and not times.size:
        times, distances = passings(pair)
        known = _known(pair, times) & ~_inside(times, turning)
        times, distances = times[known], distances[known]
    strides = min(len(foot.mids) - 1 for foot in pair)
    if strides < 2:
        notes.append(FEW_STRIDES(strides=max(strides, 0)))
    inputs = _inputs(pair, turning, times, distances, usual, start_heading, strides >= 2)
    return Prepared(inputs, options, tuple(notes))


def passings(pair: Pair) -> tuple[np.ndarray, np.ndarray]:
    """Times at which a foot has made half of its stride (n,) [s], and the mean of δ (n,) [m], in place of a range.

    In mid-swing a foot passes the other one, which stands: it has then made half of its stride, since the steps of most
    people are alike, and the feet are nearly as far apart at each passing of a walk (within 0.5 to 2 cm). This distance
    differs from the width w between footholds by δ, how far the swinging foot keeps outside of the line between its own
    two footholds. Each foot's trajectory shows its δ. Between people, both distances vary alike; with the mean of δ
    over a walk

        z₁ = μ + δ̄ / 2

    at each passing, half of what usual distances at passings say of the width, and half of what usual widths say. So
    changes of the width from stride to stride are measured, and so are those of the headings; the mean width has the
    spread of people (`WidthParams.people_noise`), and that of a person with a wide or a narrow base is wrong by more.

    Source: this library. μ from the markers on 8 healthy people: 4 of `nikonpic`, 3 of `gaitspeed`, 1 of
    `gaitmap_example`, with widths of 7 to 15 cm, distances at passings of 9 to 17 cm, and δ from −3 to 5 cm.
    """
    times, outside = [], []
    for side, foot in enumerate(pair):
        for first, last in itertools.pairwise(np.searchsorted(foot.time, foot.mids)):
            way = foot.position[first : last + 1, :2] - foot.position[first, :2]
            length = float(np.hypot(*way[-1]))
            if length < 0.5:  # [m] feet that shuffle or turn on the spot do not pass as in walking
                continue
            along, left = way @ way[-1] / length, (way[:, 1] * way[-1, 0] - way[:, 0] * way[-1, 1]) / length
            half = int(np.argmax(along >= 0.5 * length))
            times.append(foot.time[first + half])
            outside.append(left[half] if side else -left[half])
    return np.array(times), np.full(len(times), np.mean(outside) if outside else 0.0)


def _inside(times: np.ndarray, spans: Sequence[tuple[float, float]]) -> np.ndarray:
    inside = np.zeros(times.shape, bool)
    for start, end in spans:
        inside |= (times >= start) & (times <= end)
    return inside


def _known(pair: Pair, times: np.ndarray) -> np.ndarray:
    """(k,) bool, times [s] at which both feet are known."""
    known = np.ones(times.shape, bool)
    for foot in pair:
        known &= (times >= foot.time[0]) & (times <= foot.time[-1]) & ~_inside(times, foot.gaps)
    return known


def _usable(
    pair: Pair, turning: list[tuple[float, float]], read: RangeReadings | None, options: WidthOptions
) -> tuple[np.ndarray, np.ndarray, list[Note]]:
    """Times [s] and distances [m] of the usable ranges, one for each passing of the feet; notes."""
    from scipy.ndimage import median_filter

    def none(why: str) -> tuple[np.ndarray, np.ndarray, list[Note]]:
        return np.zeros(0), np.zeros(0), [RANGE_ABSENT(why=why)]

    if read is None:
        return none("there is no range between the feet")
    times, distances, mask = (np.asarray(v) for v in read)
    if not times.shape == distances.shape == mask.shape or times.ndim != 1:
        raise RecordingError(
            "a range needs times, distances and mask of one length; got shapes "
            f"{times.shape}, {distances.shape} and {mask.shape}"
        )
    measured = mask.astype(bool) & np.isfinite(times) & np.isfinite(distances)
    near = measured & (distances > 0.0) & (distances <= options.longest_range)
    if not near.any():
        within = f" within {options.longest_range:g} m" if measured.any() else ""
        return none(f"the range sensor measured nothing{within}")
    times, distances = _passings(times[near].astype(float), distances[near].astype(float))
    # unlike the four passings before and after it, for example an echo
    odd = np.abs(distances - median_filter(distances, 9, mode="nearest")) > options.outlier
    times, distances = times[~odd], distances[~odd]
    known, turned = _known(pair, times), _inside(times, turning)
    left_out = {
        f"above {options.longest_range:g} m": measured & ~near, "unlike those around": odd, "in turns": turned,
        "at which the feet were not known": ~known & ~turned,
    }  # fmt: skip
    notes = [RANGES_LEFT_OUT(ranges=which.sum(), why=why) for why, which in left_out.items() if which.any()]
    usable = known & ~turned
    if not usable.any():
        notes.append(RANGE_ABSENT(why="no range is left"))
    return times[usable], distances[usable], notes


def _passings(times: np.ndarray, distances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Time and distance of each passing of the feet, when the distance is shortest.

    Readings of one passing are not independent and count once, also those of feet that stand side by side. A
    directional sensor measures only close to the passing: the middle time and the median distance. An omnidirectional
    one measures approach and departure too: the minimum of d², a parabola of time; too few readings for it are left
    out.
    """
    order = np.argsort(times, kind="stable")
    times, distances = times[order], distances[order]
    groups = np.split(np.arange(times.size), np.flatnonzero(np.diff(times) > HALF_PASSING) + 1)
    passings = np.array([passing for g in groups for passing in _nearest(times[g], distances[g])]).reshape(-1, 2)
    return passings[:, 0], passings[:, 1]


def _nearest(times: np.ndarray, distances: np.ndarray) -> list[tuple[float, float]]:
    """The passings in one group of readings: (time, distance) each."""
    if np.ptp(distances) < 0.06:  # [m] neither approach nor departure of a foot
        return [(0.5 * (times[0] + times[-1]), float(np.median(distances)))]
    nearest, left, higher = (
        [],
        np.ones(distances.size, bool),
        0.1,
    )  # [m] readings of a passing are less above the lowest
    while left.any():
        lowest = np.flatnonzero(left)[np.argmin(distances[left])]
        since = times - times[lowest]
        near = (np.abs(since) <= HALF_PASSING) & (distances <= distances[lowest] + higher)
        if 0 < lowest < distances.size - 1 and near.sum() >= 3:
            curve, slope, level = np.polyfit(since[near], distances[near] ** 2, 2)
            at = -0.5 * slope / curve if curve > 0.0 else np.inf
            square = level + 0.5 * slope * at if curve > 0.0 else -1.0
            if abs(at) < HALF_PASSING and square > 0.0:
                nearest.append((float(times[lowest] + at), float(np.sqrt(square))))
        # another passing is at least a quarter of a stride away
        left &= (np.abs(since) > 2.0 * HALF_PASSING) & (distances <= distances[lowest] + 2.0 * higher)
    return nearest


def _inputs(
    pair: Pair, turning: list[tuple[float, float]], ranges: np.ndarray, distances: np.ndarray,
    usual: bool, start_heading: tuple[float, float], walks: bool,
) -> WidthInputs:  # fmt: skip
    """Sort stances, ranges, double supports, first and last sample by time, and make the inputs."""
    both = _double_supports(pair) if walks else np.zeros(0)
    right, left = pair
    moments = [right.mids, left.mids, ranges, both, right.time[[0, -1]]]
    time = np.concatenate(moments)
    kind = np.repeat(np.arange(len(moments)), [len(times) for times in moments])
    order = np.lexsort((kind, time))
    time, kind = time[order], kind[order]
    distance = np.zeros(time.shape)
    distance[kind == 2] = distances
    return WidthInputs(
        time, _control(right, time, kind == 0), _control(left, time, kind == 1), right.at(time)[:, 2],
        left.at(time)[:, 2], distance, kind == 2, _inside(time, turning), kind == 3, np.asarray(usual),
        np.asarray(start_heading, float), _rows(pair, time, kind, walks), np.full(time.shape, walks),
    )  # fmt: skip


def _control(foot: FootTrack, time: np.ndarray, mid: np.ndarray) -> PathControl:
    """Movement of a foot between moments; an interval lies within one stride, since stances are moments.

    A gap of the trajectory leaves the foot's mean velocity open, by 1 m/s.
    """
    before = np.maximum(np.arange(time.size) - 1, 0)
    heading = foot.heading[np.clip(np.cumsum(mid)[before] - 1, 0, max(len(foot.heading) - 1, 0))]
    dx, dy = np.diff(foot.at(time)[:, :2], axis=0, prepend=foot.at(time[:1])[:, :2]).T
    c, s = np.cos(heading), np.sin(heading)
    leaves, lost = mid[before] & (np.arange(time.size) > 0), np.zeros(time.size)
    for first, last in foot.gaps:
        lost += (last - first) * np.clip(np.minimum(time, last) - np.maximum(time[before], first), 0.0, None)
    return PathControl(
        c * dx + s * dy, c * dy - s * dx, np.diff(heading, prepend=heading[:1]), np.hypot(dx, dy),
        leaves.astype(float), lost,
    )  # fmt: skip


def _double_supports(pair: Pair) -> np.ndarray:
    """Times of double support [s]: between stances of different feet, when the faster is slowest; none in gaps."""
    time, gaps = pair[0].time, [gap for foot in pair for gap in foot.gaps]
    speed = np.where(_inside(time, gaps), np.inf, np.maximum(*(foot.speed() for foot in pair)))
    stances = sorted((mid, side) for side, foot in enumerate(pair) for mid in foot.mids)
    supports = []
    for (mid, side), (later, other) in itertools.pairwise(stances):
        first, last = np.searchsorted(time, [mid, later])
        if side != other and last - first > 2 and np.isfinite(speed[first + 1 : last]).any():
            supports.append(time[first + 1 + int(np.argmin(speed[first + 1 : last]))])
    return np.array(supports)


def _rows(pair: Pair, time: np.ndarray, kind: np.ndarray, walks: bool) -> StrideRows:
    """Strides of both feet in the order of their ends."""
    table = []
    for side, foot in enumerate(pair if walks else ()):
        other, count = pair[1 - side].mids, len(foot.mids) - 1
        (leave, land), height = contact_times(foot), foot.at(foot.mids)[:, 2]
        passed = np.searchsorted(other, foot.mids[1:]) - np.searchsorted(other, foot.mids[:-1], side="right") == 1
        table.append((
            np.full(count, side), np.flatnonzero(kind == side)[1:], np.append(leave[:1], land[:-1]), leave, land,
            foot.mids[:-1], foot.mids[1:], np.diff(height), np.diff(foot.heading, prepend=foot.heading[:1]), passed,
            np.ones(count, bool),
        ))  # fmt: skip
    types = (np.int32, np.int32, *(float,) * 7, bool, bool)
    columns = [np.concatenate(parts) for parts in zip(*table, strict=True)] or [np.zeros(0)] * len(types)
    order = np.argsort(columns[StrideRows._fields.index("standing_end")], kind="stable")
    return StrideRows(
        *(
            np.pad(values[order].astype(of), (0, time.size - len(order)))
            for values, of in zip(columns, types, strict=True)
        )
    )
