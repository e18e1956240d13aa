"""What of a recording is walking: all else replaced by standing, and walking beside the first and the last stride;
the duration of strides, and the way along them.

Estimators take what moves for walking: contacts, swings and stances, the axes of a sensor, the zero of angles, and all
that sensors must have in common. So stretches without walking (`jgait.events.movement`) are replaced by the standing
beside them before anything is measured, and named in a note.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jgait.estimators.checks import FASTEST, fast_rate, force_unit
from jgait.events.movement import CARRIED_S, KINDS, STEP_S, WALKS, Activity, movement
from jgait.events.rest import longest_still
from jgait.geometry.arrays import interpolated, xp
from jgait.notes import Kind, Note
from jgait.quality import SensorQuality
from jgait.signal.windows import true_runs
from jgait.types import AnyArray, Estimate, Flags, Imu, Recording, Strides, Values, as_float

LEAST_S, PAUSE_S = 1.5, 0.6
"""[s] Least duration of a movement that is judged; longest rest inside a movement; chosen."""

NOT_WALKING = Kind(
    "not_walking",
    "info",
    "the person {does} for {seconds:.0f} s in all, from {begin_s:.3g} s to {end_s:.3g} s; taken for standing",
    "Only walking gives strides, distance, axes of sensors and the zero of angles. Other movements are detected by how "
    "far the legs get along their paths, and by how the trunk is accelerated with the steps.",
)

type Span = tuple[float, float]
"""Begin and end of a stretch [s]."""


class Walking(NamedTuple):
    """A recording without its movements that are no walking."""

    recording: Recording  #: with standing in their place.
    spans: tuple[Span, ...]  #: the stretches that were replaced, in the sensors' time [s].
    notes: tuple[Note, ...]  #: one for each kind of movement.


def walking_alone(recording: Recording) -> Walking:
    """The recording with standing in place of movements that are no walking; unchanged if there are none, or units seem
    wrong.
    """
    if recording.moves is not None or (moved := movement(recording)) is None:
        return Walking(recording, recording.moves or (), ())
    if any(fast_rate(imu) > FASTEST or force_unit(imu)[1] for imu in recording.sensors.values()):
        return Walking(recording, (), ())
    runs, kinds = _stretches(moved)
    if not runs:
        return Walking(recording._replace(moves=()), (), ())
    upright = np.all([_upright(imu, moved) for imu in recording.sensors.values()], axis=0)
    rests = ~moved.carried & moved.quiet & upright
    runs, kinds = _joined([_with_sitting(run, moved.quiet | moved.carried, rests) for run in runs], kinds)
    sensors = {name: _stood(imu, moved, runs, rests) for name, imu in recording.sensors.items()}
    spans = tuple((float(moved.time[a]), float(moved.time[b - 1])) for a, b in runs)
    begin = min(float(imu.time[0]) for imu in recording.sensors.values())
    notes = []
    for kind in dict.fromkeys(kinds):
        of = [span for span, each in zip(spans, kinds, strict=True) if each == kind]
        seconds, begin_s, end_s = sum(b - a for a, b in of), of[0][0] - begin, of[-1][1] - begin
        notes.append(NOT_WALKING(does=KINDS[kind], seconds=seconds, begin_s=begin_s, end_s=end_s))
    apart = recording.feet_range
    if apart is not None:
        apart = apart._replace(mask=np.asarray(apart.mask, bool) & ~inside(as_float(apart.time), spans))
    return Walking(recording._replace(sensors=sensors, moves=spans, feet_range=apart), spans, tuple(notes))


def inside(time: np.ndarray, spans: tuple[Span, ...]) -> np.ndarray:
    """(T,) bool, times [s] in one of the stretches."""
    return np.any([(time >= begin) & (time <= end) for begin, end in spans], axis=0) if spans else time < -np.inf


def _stretches(moved: Activity) -> tuple[list[tuple[int, int]], list[str]]:
    """Half-open ranges of samples of movements that are no walking, and the kind of each."""
    moves = ~moved.quiet & ~moved.carried
    for a, b in true_runs(~moves):
        moves[a:b] |= a > 0 and b < len(moves) and b - a < PAUSE_S / STEP_S
    names = [name for name in KINDS if name != "walking"]
    runs, kinds = [], []
    for a, b in true_runs(moves):
        chance = moved.probability["walking"][a:b]
        for first, last in true_runs(chance <= WALKS):
            # a walk begins and ends with weight on both feet: what is left of its bout belongs to it, and what follows
            # without a rest is its slow part if walking has a probability of 0.0005 there
            beside = first > 0 or last < b - a
            slows = max(first, b - a - last) >= LEAST_S / STEP_S and np.median(chance[first:last]) > 0.0005
            if not slows and last - first >= (1 + beside) * LEAST_S / STEP_S:
                runs.append((a + first, a + last))
                total = [moved.probability[name][a + first : a + last].sum() for name in names]
                kinds.append(names[int(np.argmax(total))])
    carried = [(a, b) for a, b in true_runs(moved.carried) if b - a >= CARRIED_S / STEP_S]
    return runs + carried, kinds + ["riding"] * len(carried)


def _upright(imu: Imu, moved: Activity) -> np.ndarray:
    """(N,) bool, the sensor's mean force over half a second is within 30° of that in walking; all if nobody walks.

    In standing it is, in sitting that of a thigh is not.
    """
    on_grid = [np.interp(moved.time, as_float(imu.time), column) for column in as_float(imu.acc).T]
    slow = np.stack([np.convolve(column, np.full(11, 1 / 11), "same") for column in on_grid], 1)
    walks = ~moved.quiet & ~moved.carried & (moved.probability["walking"] > WALKS)
    if walks.sum() * STEP_S < LEAST_S:
        return np.ones(len(moved.time), bool)
    mean = slow[walks].mean(axis=0)
    size = np.linalg.norm(slow, axis=1) * np.linalg.norm(mean)
    return np.asarray(slow @ mean > np.cos(np.deg2rad(30.0)) * size)


def _with_sitting(run: tuple[int, int], quiet: np.ndarray, rests: np.ndarray) -> tuple[int, int]:
    """The stretch with the rests beside it in which the person does not stand."""
    a, b = run
    while a > 0 and quiet[a - 1] and not rests[a - 1]:
        a -= 1
    while b < len(quiet) and quiet[b] and not rests[b]:
        b += 1
    return a, b


def _joined(runs: list[tuple[int, int]], kinds: list[str]) -> tuple[list[tuple[int, int]], list[str]]:
    """The stretches in order, those with hardly any standing between them as one, of the kind of the longest."""
    joined, of = list[tuple[int, int]](), list[tuple[int, str]]()
    for (a, b), kind in sorted(zip(runs, kinds, strict=True)):
        if joined and a <= joined[-1][1] + PAUSE_S / STEP_S:
            joined[-1] = joined[-1][0], max(b, joined[-1][1])
            of[-1] = max(of[-1], (b - a, kind))
        else:
            joined.append((a, b))
            of.append((b - a, kind))
    return joined, [kind for _, kind in of]


def _stood(imu: Imu, moved: Activity, runs: list[tuple[int, int]], rests: np.ndarray) -> Imu:
    """The sensor with standing in place of some stretches; where there is none beside them, samples are lost.

    2.6 s beside walking are lost, so that no bout seems to begin or end there in standing.
    """
    time = as_float(imu.time)
    gyr, acc, mask = as_float(imu.gyr).copy(), as_float(imu.acc).copy(), np.asarray(imu.mask, bool).copy()
    for a, b in runs:
        rows = np.flatnonzero((time >= moved.time[a]) & (time <= moved.time[b - 1]))
        beside = [_rest(time, mask, moved.time, rests, a - 1, -1), _rest(time, mask, moved.time, rests, b, 1)]
        known = [rest for rest in beside if rest is not None]
        carried = bool((moved.quiet | moved.carried)[a:b].all())
        if not len(rows) or (not known and carried):
            continue
        if not known:
            acc[rows], gyr[rows] = acc[rows].mean(axis=0), 0.0
            mask[rows] &= len(rows) >= len(time) * 0.9
            continue
        share = np.linspace(0.0, 1.0, len(rows))[:, None]
        first, last = known[0], known[-1]
        for values in (gyr, acc):
            means = values[first].mean(axis=0), values[last].mean(axis=0)
            around = values[first] - means[0]
            noise = np.take(np.concatenate([around, around[::-1]]), np.arange(len(rows)), axis=0, mode="wrap")
            values[rows] = means[0] * (1.0 - share) + means[1] * share + noise
        mask[rows] = True
        apart = time[rows]
        if beside[0] is None and a > 0 and not carried:
            mask[rows[apart < apart[0] + 2.6]] = False
        if beside[1] is None and b < len(moved.time) and not carried:
            mask[rows[apart > apart[-1] - 2.6]] = False
    return imu._replace(gyr=gyr, acc=acc, mask=mask)


def _rest(
    time: np.ndarray, mask: np.ndarray, grid: np.ndarray, rests: np.ndarray, at: int, way: int
) -> np.ndarray | None:
    """Samples of the rest that begins at a moment of the grid in one direction of time, without 0.15 s at its ends.

    None without a rest of 0.45 s.
    """
    near = at
    while 0 <= near < len(rests) and not rests[near] and abs(near - at) < PAUSE_S / STEP_S:
        near += way
    until = near
    while 0 <= until < len(rests) and rests[until]:
        until += way
    first, last = sorted((near, until - way))
    if abs(until - near) * STEP_S < 0.45:
        return None
    rows = np.flatnonzero((time >= grid[first] + 0.15) & (time <= grid[last] - 0.15) & mask)
    return rows if len(rows) > 4 else None


# --- recordings that begin or end in walking ---

MID_STANCE = 0.31
"""[1] Share of a stride from the middle of a stance to the final contact: a foot stands for some 62 % of a stride."""

LEAST_CUT_STRIDES, MOST = 0.2, 1.5
"""[strides] Limits of the walking that a recording cuts off: in less, a person stands for a moment; in more, the
activity is another one."""

WALKING_CUT = Kind(
    "walking_cut", "info", "{placement}: the recording {does} in walking, {seconds:.1f} s {where} whole stride",
    "The part of a stride there is in no stride of the table. The distance of one estimator does not count it; that of "
    "all sensors together counts it with the median walking speed, and with a larger deviation.",
)  # fmt: skip


def cut_off(estimate: Estimate, sensors: Mapping[int, tuple[str, AnyArray]]) -> dict[str, SensorQuality]:
    """Walking before the first and after the last stride of each sensor, from an estimate without padding.

    `sensors` are side → placement, and angular rate (T,) or (T, 3) of its sensor, without bias [rad/s].
    """
    cuts = {placement: unseen(estimate, side, gyr) for side, (placement, gyr) in sensors.items()}
    return {
        placement: SensorQuality(walks_before=before, walks_after=after) for placement, (before, after) in cuts.items()
    }


def cut_notes(quality: Mapping[str, SensorQuality]) -> list[Note]:
    """Notes on sensors whose recording cuts off a stride."""
    return [
        WALKING_CUT(placement=placement, seconds=seconds, does=does, where=where)
        for placement, facts in quality.items()
        for seconds, does, where in (
            (facts.walks_before, "begins", "before the first"), (facts.walks_after, "ends", "after the last"),
        ) if seconds > 0.0
    ]  # fmt: skip


def unseen(estimate: Estimate, side: int, gyr: AnyArray) -> tuple[float, float]:
    """Duration of walking before the first and after the last stride of a side [s]; 0 where the person stands.

    The person stands if the stride beside it is shorter than half of the median, for strides in turns are longer; if
    the sensor turns at less than 0.5 rad/s for longer than in a stance, 0.45 of a stride; or if 0.75 of a stride passes
    without the rate of a swing, 2 rad/s.
    """
    strides, time = estimate.strides, as_float(estimate.time)
    mine = np.flatnonzero((np.asarray(strides.side) == side) & np.asarray(strides.valid, bool))
    leaves, lands, length = (as_float(part)[mine] for part in (strides.final_contact, strides.end, strides.length))
    known = durations(strides)[mine]
    if not np.isfinite(known).any():
        return 0.0, 0.0
    lasts, usual = float(np.nanmedian(known)), float(np.nanmedian(length))
    rates = as_float(gyr).reshape(len(time), -1)
    hz = (len(time) - 1) / max(float(np.ptp(time)), 1e-9)
    cuts = []
    speed, stance = np.linalg.norm(rates, axis=1), MID_STANCE * lasts
    for at, beyond, moment, beside in (
        (time <= leaves[0], time <= leaves[0] - stance, leaves[0] - time[0], length[0]),
        (time >= lands[-1], time >= lands[-1] + stance, time[-1] - lands[-1], length[-1]),
    ):
        missing = float(moment) - stance
        walks = LEAST_CUT_STRIDES * lasts < missing < MOST * lasts and beside > 0.5 * usual
        if walks:
            rests = longest_still(rates[at], hz, threshold=0.5, at_least_s=0.45 * lasts)
            stays = moment > 0.75 * lasts and not (speed[beyond] > 2.0).any()
            walks = rests is None and not stays
        cuts.append(missing if walks else 0.0)
    return cuts[0], cuts[1]


# --- strides: duration, and the way of a person that turns ---


def durations(strides: Strides) -> np.ndarray:
    """(strides,) [s] from contact to contact; NaN for a first stride from standing, which has no contact before it.

    The strides have starts and ends.
    """
    lasts = as_float(strides.end) - as_float(strides.start)
    if strides.final_contact is None:
        return lasts
    return np.where(as_float(strides.final_contact) <= as_float(strides.start), np.nan, lasts)


def of_turns(length: Values, turn: Values) -> tuple[Values, Values]:
    """Way of the person over strides that turn, and its standard deviation [m].

    Length (n,) is the chord from foothold to foothold [m], turn (n,) that of the foot [rad]. On a curve the person
    walks the arc, in turning on the spot the chord or less. The way is the mean of arc and chord, with the standard
    deviation of a uniform distribution between them.
    """
    arc = length / xp.sinc(xp.clip(turn / (2.0 * math.pi), -0.5, 0.5))
    return 0.5 * (length + arc), (arc - length) / math.sqrt(12.0)


def along(time: Values, start: Values, end: Values, real: Flags, lengths: Values) -> Values:
    """Running sums (T, m) of values of strides (n, m), each added linearly from the start [s] to the end [s] of its
    stride.

    The strides are in the order of their starts and do not overlap; those that are not `real` follow the others, and
    add nothing.
    """
    rows = xp.arange(start.shape[0], dtype=xp.int32).astype(time.dtype)
    beyond = time[-1] + 1.0 + rows  # after the recording, in order
    knots = xp.stack([xp.where(real, start, beyond), xp.where(real, end, beyond + 0.5)], axis=1).ravel()
    done = xp.cumsum(lengths, axis=0)
    values = xp.stack([done - lengths, done], axis=1).reshape(-1, lengths.shape[1])
    return interpolated(time, knots, values)
