"""A recording in which the person stands wherever they move without walking, so that only walking is measured.

Estimators take what moves for walking: contacts, swings and stances, the axes of a sensor, the zero of angles, and all
that sensors must have in common. So stretches without walking (`jgait.events.movement`) are replaced by the standing
beside them before anything is measured, and named in a note.
"""

from typing import NamedTuple

import numpy as np

from jgait.estimators.checks import FASTEST, fast_rate, force_unit
from jgait.events.movement import CARRIED_S, KINDS, STEP_S, WALKS, Activity, movement
from jgait.notes import Kind, Note
from jgait.signal.windows import true_runs
from jgait.types import Imu, Recording, as_float

LEAST_S, PAUSE_S, SLOWS = 1.5, 0.6, 0.0005
"""[s] Least duration of a movement that is judged; longest rest inside a movement. [1] Median probability of walking
from which a movement beside walking, without rest between them, is its slow part."""

UPRIGHT = np.deg2rad(30.0)
"""[rad] Largest angle of a sensor's mean force in standing from that in walking; in sitting a thigh has more."""

EDGE_S, APART_S = 0.15, 2.6
"""[s] Ends of a rest that are not used. Time between walking and other movements, without rest between them, that is
marked as lost, so that no bout seems to begin or end there in standing."""

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
    rests = ~moved.carried & np.stack([moved.quiet & _upright(imu, moved) for imu in recording.sensors.values()]).all(
        axis=0
    )
    runs, kinds = _joined([_with_sitting(run, moved.quiet | moved.carried, rests) for run in runs], kinds)
    sensors = {name: _stood(imu, moved, runs, rests) for name, imu in recording.sensors.items()}
    spans = tuple((float(moved.time[a]), float(moved.time[b - 1])) for a, b in runs)
    begin = min(float(imu.time[0]) for imu in recording.sensors.values())
    notes = []
    for kind in dict.fromkeys(kinds):
        of = [span for span, each in zip(spans, kinds, strict=True) if each == kind]
        notes.append(
            NOT_WALKING(
                does=KINDS[kind], seconds=sum(b - a for a, b in of), begin_s=of[0][0] - begin, end_s=of[-1][1] - begin
            )
        )
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
            # a walk begins and ends with weight on both feet: what is left of its bout belongs to it
            beside = first > 0 or last < b - a
            slows = max(first, b - a - last) >= LEAST_S / STEP_S and np.median(chance[first:last]) > SLOWS
            if not slows and last - first >= (1 + beside) * LEAST_S / STEP_S:
                runs.append((a + first, a + last))
                total = [moved.probability[name][a + first : a + last].sum() for name in names]
                kinds.append(names[int(np.argmax(total))])
    carried = [(a, b) for a, b in true_runs(moved.carried) if b - a >= CARRIED_S / STEP_S]
    return runs + carried, kinds + ["riding"] * len(carried)


def _upright(imu: Imu, moved: Activity) -> np.ndarray:
    """(N,) bool, the sensor's mean force over half a second is near that in walking; all if nobody walks."""
    time, acc = as_float(imu.time), as_float(imu.acc)
    slow = np.stack(
        [np.convolve(np.interp(moved.time, time, column), np.full(11, 1 / 11), "same") for column in acc.T], 1
    )
    walks = ~moved.quiet & ~moved.carried & (moved.probability["walking"] > WALKS)
    if walks.sum() * STEP_S < LEAST_S:
        return np.ones(len(moved.time), bool)
    mean = slow[walks].mean(axis=0)
    size = np.linalg.norm(slow, axis=1) * np.linalg.norm(mean)
    return np.asarray(slow @ mean > np.cos(UPRIGHT) * size)


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
    joined: list[tuple[int, int]] = []
    of: list[tuple[int, str]] = []
    for (a, b), kind in sorted(zip(runs, kinds, strict=True)):
        if joined and a <= joined[-1][1] + PAUSE_S / STEP_S:
            joined[-1] = joined[-1][0], max(b, joined[-1][1])
            of[-1] = max(of[-1], (b - a, kind))
        else:
            joined.append((a, b))
            of.append((b - a, kind))
    return joined, [kind for _, kind in of]


def _stood(imu: Imu, moved: Activity, runs: list[tuple[int, int]], rests: np.ndarray) -> Imu:
    """The sensor with standing in place of some stretches; where there is none beside them, samples are lost."""
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
            mask[rows[apart < apart[0] + APART_S]] = False
        if beside[1] is None and b < len(moved.time) and not carried:
            mask[rows[apart > apart[-1] - APART_S]] = False
    return imu._replace(gyr=gyr, acc=acc, mask=mask)


def _rest(
    time: np.ndarray, mask: np.ndarray, grid: np.ndarray, rests: np.ndarray, at: int, way: int
) -> np.ndarray | None:
    """Samples of the rest that begins at a moment of the grid in one direction of time; None without a rest."""
    near = at
    while 0 <= near < len(rests) and not rests[near] and abs(near - at) < PAUSE_S / STEP_S:
        near += way
    until = near
    while 0 <= until < len(rests) and rests[until]:
        until += way
    first, last = sorted((near, until - way))
    if abs(until - near) * STEP_S < 3.0 * EDGE_S:
        return None
    rows = np.flatnonzero((time >= grid[first] + EDGE_S) & (time <= grid[last] - EDGE_S) & mask)
    return rows if len(rows) > 4 else None
