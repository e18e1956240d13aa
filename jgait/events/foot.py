"""Stances, final contacts and initial contacts of a foot, from the sensor on the foot; on the host.

A fixed threshold on the angular rate misses stances of fast gait, where the foot never comes to rest, and detects false
stances in slow swings. Here the threshold follows the stride: a stance is a valley of the rate between two swings whose
rate is `RATIO` times as high, and the threshold is the lowest rate of that valley times a factor.

A valley may also lie in a swing, in which the foot turns to and fro. So each has two hypotheses: the foot stands, and
two strides meet there, or it moves, and one stride spans it. If the foot rests before, at time a, and after, at b, its
velocity at t between them follows from the integral of the specific force S(t), in any axes that do not turn,

    v(t) = S(t) − S(a) − (t − a) / (b − a) (S(b) − S(a)),

without the direction of gravity; under Vicon it is right to some cm/s. The sensor may be mounted in any orientation.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jgait.events import rest
from jgait.geometry.rotation import integrated
from jgait.signal.windows import held_mean
from jgait.types import AnyArray

WINDOW = 0.1
"""[s] Window of the root mean square of the rate."""

RATIO = 3.0
"""[1] Smallest ratio of the peak rate of a swing to the lowest rate of the valley beside it."""

SWING = 1.2
"""[rad/s] Smallest peak rate of a swing; a foot in swing reaches 4 to 12, a dragged foot 2."""

STANCE = 2.5
"""[rad/s] Largest rate of a valley that counts as a stance: the valley of a run."""

STILL = 0.8
"""[rad/s] A foot with a lower rate always stands; between heel-off and contact the rate is above 2."""

ABOVE = 1.5
"""[1] A stance ends where the rate exceeds `STILL` and this multiple of the rate in its valley."""

SHORTEST_STRIDE_S = 0.45
"""[s] Shortest time from one stance to the next; a run has 0.65."""

WORSE = 3.0
"""[1] Largest ratio of the rate of a first or last stance to that of its neighbour; above it, the recording cuts a
swing there."""

SLOW_STILL = 0.15
"""[rad/s] Largest `unrest` in a rest between slow steps, in which a foot never turns as fast as `SWING`."""

LANDED = 0.1
"""[1] Share of its peak in late swing by which the pitch of the foot has fallen at initial contact."""

EROSION = (0.06, 0.02)
"""[s] Time removed from start and end of a stance. Without it footholds are 5 mm too high: the foot still sinks."""


class Stances(NamedTuple):
    """Stances of one foot, in order; every field is (n,)."""

    start: np.ndarray  #: first sample of the stance [samples].
    end: np.ndarray  #: one past the last sample of the stance [samples].
    stillest: np.ndarray  #: sample of least `unrest` [samples].
    rate: np.ndarray  #: root mean square rate at that sample [rad/s].


def moving_rate(gyr: Float[AnyArray, "time 3"], sampling_rate_hz: float) -> np.ndarray:
    """Root mean square of the angular rate over a centred `WINDOW` (T,) [rad/s]; the ends are repeated."""
    power = held_mean((np.asarray(gyr, np.float64) ** 2).sum(axis=1), _window(sampling_rate_hz))
    return np.sqrt(np.maximum(power, 0.0))


def _window(sampling_rate_hz: float) -> int:
    return max(3, 2 * round(WINDOW * sampling_rate_hz / 2) + 1)


def unrest(gyr: Float[AnyArray, "time 3"], acc: Float[AnyArray, "time 3"], sampling_rate_hz: float) -> np.ndarray:
    """(T,) [rad/s], see `rest.unrest`; over `WINDOW`."""
    return rest.unrest(gyr, acc, _window(sampling_rate_hz))


def stances(gyr: Float[AnyArray, "time 3"], acc: Float[AnyArray, "time 3"], sampling_rate_hz: float) -> Stances:
    """The stances of a foot, at any speed of gait; empty if the foot never moves enough, or never comes to rest.

    A stance extends from its valley to where the rate exceeds `STILL` and `ABOVE` times the rate of the valley, less
    `EROSION`, except at the ends of the recording. Angular rate (T, 3) [rad/s], without the gyroscope's bias as far as
    it is known, and specific force (T, 3) [m/s²] are finite.
    """
    rate, restless = moving_rate(gyr, sampling_rate_hz), unrest(gyr, acc, sampling_rate_hz)
    valleys = _valleys(rate, SWING, STANCE)
    after_start, before_end = (round(seconds * sampling_rate_hz) for seconds in EROSION)
    rows = []
    borders = np.concatenate([[-1], valleys, [len(rate)]])
    for before, at, after in zip(borders[:-2], valleys, borders[2:], strict=True):
        if slow := _slow(rate, restless, at, (before + 1, after), sampling_rate_hz):
            rows += slow
            continue
        first, last = _around(rate, at, (before + 1, after), max(STILL, ABOVE * rate[at]))
        first = min(first + after_start, at) if first > 0 else first
        last = max(last - before_end, at) if last < len(rate) - 1 else last
        middle = first + int(np.argmin(restless[first : last + 1]))
        first, last = _around(restless, middle, (first, last + 1), max(STILL, ABOVE * restless[middle]))
        # a foot that comes down flat and softly still moves without turning, for at most 0.35 s
        landing = restless[first : min(first + round(0.35 * sampling_rate_hz), middle)]
        soft = landing > max(0.3, 10.0 * restless[middle])  # [rad/s]
        first += int(np.flatnonzero(soft)[-1]) + 1 if first > 0 and soft.any() else 0
        rows.append((first, last + 1, middle))
    places = np.array(rows, int).reshape(-1, 3)
    force = integrated(gyr, acc, sampling_rate_hz)[1]
    while (moves := _moving(places, restless, force, sampling_rate_hz)).any():
        places = places[~moves]
    start, end, stillest = _apart(places, rate, sampling_rate_hz).T
    return Stances(start, end, stillest, rate[stillest])


def _moving(rows: np.ndarray, restless: np.ndarray, force: np.ndarray, sampling_rate_hz: float) -> np.ndarray:
    """(n,) bool, stances (start, end, stillest) in which the foot moves, and that are more restless than moving ones
    beside them, whose velocity follows from these; `force` (T, 3) is the integral of the specific force [m/s].
    """
    # A stance beside is at rest at its sample that is nearest to `stillest`, and less than 1.6 s away if possible. The
    # likelihood of the velocity has the tail of Student's t, that of the unrest is a power of its ratio to the largest
    # velocity. The numbers were learned from 1248 valleys of `footprints`, `pyshoe_vicon`, `neura_sparse`,
    # `gaitmap_example` and two simulated walks; 2 of 1290 swings of `ipol_gait` have a stance, 6 stances are missed.
    unrest_if_moving, reach = np.zeros(len(rows) + 2), round(1.6 * sampling_rate_hz)
    for k, ((_, left, before), (_, _, at), (enters, _, after)) in enumerate(
        zip(rows, rows[1:], rows[2:], strict=False)
    ):
        a, b = max(before, min(at - reach, left - 1)), min(after, max(at + reach, enters))
        if b - a > 4.0 * sampling_rate_hz:  # the velocity is not known
            continue
        velocity = force[a : b + 1] - force[a] - np.linspace(0.0, 1.0, b - a + 1)[:, None] * (force[b] - force[a])
        speed = np.linalg.norm(velocity, axis=1)
        scale = np.hypot(0.05, 0.04 * speed.max())  # [m/s], [1]
        turns = np.clip(restless[at], 0.05, STANCE) / (3.0 * (speed.max() + 0.1))  # [rad/m]
        stands = (1.0 + 0.25 * (speed[at - a] / scale) ** 2) ** -3.0 + 3e-4
        if 2.5 * np.log(turns) > np.log(stands):
            unrest_if_moving[k + 2] = restless[at]
    here = unrest_if_moving[1:-1]
    return (here > 0.0) & (here >= unrest_if_moving[:-2]) & (here > unrest_if_moving[2:])


def _apart(rows: np.ndarray, rate: np.ndarray, sampling_rate_hz: float) -> np.ndarray:
    """Stances without the worse of two that are too near each other, and without those at either end of the recording
    in which the foot turns much faster than in the next: a swing that the recording cuts.
    """
    depth = rate[rows[:, 2]]
    while len(rows) > 1:
        gaps = np.diff(rows[:, 2]) / sampling_rate_hz
        close = int(np.argmin(gaps))
        if gaps[close] >= SHORTEST_STRIDE_S:
            break
        drop = close if depth[close] > depth[close + 1] else close + 1
        rows, depth = np.delete(rows, drop, axis=0), np.delete(depth, drop)
    edge = SHORTEST_STRIDE_S * sampling_rate_hz
    for end, beside in ((-1, -2), (0, 1)):
        cut = len(rows) > 1 and min(rows[end, 2], len(rate) - 1 - rows[end, 2]) < edge
        if cut and depth[end] > max(STILL, WORSE * depth[beside]):
            rows, depth = np.delete(rows, end, axis=0), np.delete(depth, end)
    return rows


def _slow(
    rate: np.ndarray, restless: np.ndarray, at: int, within: tuple[int, int], sampling_rate_hz: float
) -> list[tuple[int, int, int]]:
    """Start, end and stillest sample of the stances of a foot that moves slowly (see `SLOW_STILL`) in the stretch
    without a swing around the sample `at`; else none.
    """
    first, last = _around(rate, at, within, SWING)
    end = last + 1
    if end - first <= 1.5 * sampling_rate_hz:
        return []
    part, rows, edge = restless[first:end], [], round(0.1 * sampling_rate_hz)
    valleys = _valleys(part, 0.25, SLOW_STILL)
    borders = np.concatenate([[-1], valleys, [len(part)]])
    for before, at, after in zip(borders[:-2], valleys, borders[2:], strict=True):
        begins, last = _around(part, at, (before + 1, after), SLOW_STILL)
        if last - begins < 0.4 * sampling_rate_hz:  # longer than in the middle of a swing
            continue
        start = first + begins + (edge if first + begins > 0 else 0)
        stop = first + last + 1 - (edge if first + last + 1 < len(restless) else 0)
        rows.append((start, stop, min(max(first + at, start), stop - 1)))
    return rows if len(rows) > 1 else []


def _around(values: np.ndarray, at: int, within: tuple[int, int], limit: float) -> tuple[int, int]:
    """First and last sample of the stretch around the sample `at` in which values stay below a limit."""
    before, after = values[within[0] : at] >= limit, values[at + 1 : within[1]] >= limit
    first = at - int(np.argmax(before[::-1])) if before.any() else within[0]
    last = at + int(np.argmax(after)) if after.any() else within[1] - 1
    return first, last


def _valleys(rate: np.ndarray, swing: float, deep: float) -> np.ndarray:
    """Samples of the valleys below `deep`: a rise to a swing ends a valley, a fall of the rate ends a swing, and the
    recording's end both.
    """
    points, seeking, extreme, at = list[int](), True, np.inf, 0
    for index, value in enumerate(rate.tolist()):
        if seeking:
            if value < extreme:
                extreme, at = value, index
            elif value > swing and value > RATIO * extreme:
                points.append(at)
                seeking, extreme = False, value
        elif value > extreme:
            extreme = value
        elif value < extreme / RATIO:
            seeking, extreme, at = True, value, index
    valleys = np.array([*points, at] if seeking else points, int)
    return valleys[rate[valleys] < deep] if len(rate) else valleys[:0]


def inside(stances: Stances, samples: int) -> np.ndarray:
    """(T,) bool, True in a stance."""
    change = np.zeros(samples + 1, int)
    np.add.at(change, stances.start, 1)
    np.add.at(change, stances.end, -1)
    return np.cumsum(change[:-1]) > 0


def margin(
    gyr: Float[AnyArray, "time 3"], acc: Float[AnyArray, "time 3"], stances: Stances, sampling_rate_hz: float
) -> np.ndarray:
    """(T,) logarithm of the threshold of the nearest stance over `unrest`; large while a foot is still. Where it
    contradicts `inside`, it is near 0, with the sign of `inside`.
    """
    restless = unrest(gyr, acc, sampling_rate_hz)
    middles = 0.5 * (stances.stillest[1:] + stances.stillest[:-1])
    limits = np.maximum(STILL, ABOVE * restless[stances.stillest])
    limit = limits[np.searchsorted(middles, np.arange(len(gyr)))]
    stands, margins = inside(stances, len(gyr)), np.log(limit / np.maximum(restless, 1e-3))
    return np.where(stands, np.maximum(margins, 1e-3), np.minimum(margins, -1e-3))


def contacts(
    gyr: Float[AnyArray, "time 3"], stances: Stances, sampling_rate_hz: float
) -> tuple[np.ndarray, np.ndarray]:
    """Samples of the final and the initial contact of every stride, (n − 1,) each, between one of n stances and the
    next.

    At the final contact the foot is pitched down most. At the initial contact the pitch has fallen by `LANDED` from its
    peak in late swing, and the foot does not lie flat yet; a soft landing has no larger acceleration than a swing, so
    accelerations are not used. Pitch is the integral of the angular rate (T, 3) without bias [rad/s] about the foot's
    main axis of rotation, however the sensor is mounted.
    """
    gyr = np.asarray(gyr, np.float64)
    count = max(len(stances.stillest) - 1, 0)
    final, initial = np.zeros(count, int), np.zeros(count, int)
    if not count:
        return final, initial
    swinging = ~inside(stances, len(gyr))
    axis = np.linalg.eigh(gyr[swinging].T @ gyr[swinging])[1][:, -1]
    about = gyr @ axis
    reach = int(0.25 * sampling_rate_hz)
    for k in range(count):
        a = max(stances.stillest[k], stances.end[k] - reach)
        b = min(stances.stillest[k + 1], stances.start[k + 1] + reach)
        pitch = np.cumsum(about[a:b]) / sampling_rate_hz
        pitch -= np.linspace(0.0, pitch[-1], b - a)
        down, up = sorted((int(np.argmax(pitch)), int(np.argmin(pitch))))
        lower = np.flatnonzero(pitch[up:] / pitch[up] < 1.0 - LANDED) if pitch[up] else np.zeros(0, int)
        final[k] = a + down
        initial[k] = min(a + up + (lower[0] if lower.size else 0), b - 1)
        if initial[k] > stances.start[k + 1] - 0.03 * sampling_rate_hz:
            initial[k] = max(stances.start[k + 1] - round(0.18 * sampling_rate_hz), final[k])  # as in `ipol_gait`
    return final, initial
