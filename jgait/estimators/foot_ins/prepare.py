"""Inputs of the foot estimator, and how a recording gives them: stances, scale, attitude, footholds; on the host.

This module detects stances and footholds and measures the gyroscope bias at rest. It has no gradient; `foot_ins.run`
is differentiable for given stances and footholds.
"""

import itertools
from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import PyTree

from jgait.estimators.checks import (
    bridged,
    common_time,
    jumps,
    longest_loss,
    lost_between,
    mean_over_interval,
    not_bridged,
    readings,
    sensors_of,
)
from jgait.estimators.foot_ins.params import DEFAULT, FootOptions
from jgait.estimators.interface import Axis, Held, Prepared, Sampled, Times
from jgait.estimators.noise import features
from jgait.estimators.notes import (
    ACCELEROMETER_OFF,
    LONGEST_LOSS,
    RATES_OFF,
    SCALE_CORRECTED,
    SCALE_NOTED,
    STRIDES_MISSING,
    STRIDES_UNCERTAIN,
)
from jgait.estimators.walking import Span
from jgait.events import foot as events
from jgait.events.rest import Rest, rest
from jgait.geometry.rotation import Quaternion, conjugate, integrated, level, rotated
from jgait.geometry.vectors import GRAVITY, as_array, vector
from jgait.notes import FEW_RESTS, Kind, Note, record
from jgait.quality import SensorQuality
from jgait.quality.evidence import FAR_OFF
from jgait.types import SIDES, Counts, Imu, Recording, RecordingError, Values

SLOWEST_HZ = 45.0
"""[Hz] Lowest sampling rate; a lower rate does not sample the jolt of a heel strike, which lasts some 30 ms."""

LOST_RATE, LOST_FORCE = (0.3, 1e-3), (3.3, 1e-3)
"""([rad/s], [s]), ([m/s²], [s]) Error of linear interpolation over lost samples, see `bridged`; less than on feet
of five data sets (experiment `damage.gaps`: 1.4 rad/s and 5.5 m/s² over 0.2 s). With those values the filter explained
the motion of a runner's foot by a tilt: strides after a loss of 0.2 s were wrong by a metre, without a large
innovation."""

REST_STEP = 20.0
"""[s] Time between the footholds of a foot at rest."""

STANCE_EDGE_S = 0.3
"""[s] `leaves` is at most this long before the end of a stance, `arrives` at most this long after its start."""

OFF_FROM = 2.0
"""[1] Least size of the logarithm of the scale over its deviation that is noted, chosen so that none of 52 shoes of
public sets is noted as measured (`experiments.unseen2.scales`)."""

NEVER_RESTS = Kind(
    "foot_never_rests",
    "check",
    "{placement} never rests for half a second: its gyroscope's bias is not known, headings drift more",
    FEW_RESTS,
)


FOOTHOLDS = Axis("hold", 20, 2)
"""The axis of footholds; from stance to stance are twenty samples or more."""

PerFoothold = Annotated[Values, FOOTHOLDS]
"""(K,), one entry a foothold; padding repeats the last entry."""


class FootSignals(NamedTuple):
    """Signals of one foot's sensor, with its stances and footholds."""

    gyr: Held  #: (T, 3) mean angular rate over the interval that ends at each sample [rad/s].
    acc: Held  #: (T, 3) mean specific force over it [m/s²].
    gyr_jump: Sampled  #: (T,) change of the rate from sample to sample, the largest over a short window [rad/s].
    acc_jump: Sampled  #: (T,) change of the specific force from sample to sample, likewise [m/s²].
    gyr_doubt: Sampled  #: (T,) standard deviation of the rate where it was lost or clipped, else 0 [rad/s].
    acc_doubt: Sampled  #: (T,) standard deviation of the specific force, likewise [m/s²].
    rate: Sampled  #: (T,) magnitude of the rate, without bias [rad/s].
    stands: Sampled  #: (T,) bool, True in stance.
    margin: Sampled  #: (T,) logarithm of the detector's threshold over its statistic, above 0 exactly where `stands`.
    features: Held  #: (T, F) features of noise models, see `jgait.estimators.noise.features`.
    restart: Sampled  #: (T,) float, 1 at the sample after each foothold, else 0.
    dt: Sampled  #: (T,) time since the previous sample [s]; 0 up to the first stance, where the filter starts.
    valid: Sampled  #: (T,) bool; False before the first stance and in padding.
    attitude: PyTree  #: (4,) q_ws at the first stance, w first, its heading arbitrary.
    gyr_bias: Values  #: (3,) gyroscope bias at rest [rad/s].
    acc_bias: Values  #: (3,) accelerometer bias along the vertical, measured from gravity at rest [m/s²].
    up: Values  #: (3,) the vertical at the first stance, in the sensor's axes [1].
    still_time: Values  #: duration of rest over which the gyroscope bias was measured [s].
    foothold: PerFoothold  #: (K,) samples of the footholds, in order; padding repeats the last.
    #: (K,) sample at or before the end of the stance, at which the timing of the next stride starts.
    leaves: PerFoothold
    #: (K,) sample at or after the start of the stance, at which the timing of the last stride ends.
    arrives: PerFoothold
    final_contact: PerFoothold  #: (K,) sample of the final contact after the foothold.
    initial_contact: PerFoothold  #: (K,) sample of the next initial contact.
    whole: PerFoothold  #: (K,) bool; False where too many samples are lost up to the next foothold to estimate a stride
    known: Sampled  #: (T,) bool; False in the strides that `whole` excludes.
    count: Counts  #: number of footholds.


@record
class FootInputs(NamedTuple):
    """Inputs of `foot_ins.run`: signals of each foot with a sensor at times (T,) [s]; every leaf is an array."""

    time: Times
    right: FootSignals | None
    left: FootSignals | None


def prepare(recording: Recording, options: FootOptions = DEFAULT) -> Prepared[FootInputs]:
    """The inputs of `foot_ins.run` for a recording of one or both feet on one clock.

    Raises:
        RecordingError: no foot sensor, clocks that differ, no accelerometer, NaN, sampling rate too low, wrong unit,
            or no stance of a foot.
    """
    worn = {side: f"foot_{side}" for side in SIDES if f"foot_{side}" in recording.sensors}
    if not worn:
        raise RecordingError(f"foot_ins needs 'foot_right' or 'foot_left'; {sensors_of(recording)}")
    time = common_time(recording, list(worn.values()), "foot_ins", "both feet")
    rate = 1.0 / float(np.median(np.diff(time)))
    if rate < 0.99 * SLOWEST_HZ:  # a clock is a little off its nominal rate
        raise RecordingError(f"foot_ins needs {SLOWEST_HZ:g} Hz or more; the recording has {rate:.1f} Hz")
    feet: dict[str, FootSignals | None] = dict.fromkeys(SIDES)
    notes: list[Note] = []
    quality: dict[str, SensorQuality] = {}
    standing = None
    for side, name in worn.items():
        feet[side], quality[name], foot_notes, rests = _foot(recording.sensors[name], time, name, recording.moves or ())
        notes += foot_notes
        standing = rests if standing is None else standing
    inputs = FootInputs(time, feet["right"], feet["left"])
    return Prepared(inputs, options, tuple(notes), standing, quality=quality)


def _foot(
    imu: Imu, time: np.ndarray, name: str, moves: tuple[Span, ...]
) -> tuple[FootSignals, SensorQuality, list[Note], tuple[int, int] | None]:
    """Inputs of one foot, facts and notes about its sensor, and the longest rest as a half-open range of samples.

    Footholds between which the person moves without walking give no stride.
    """
    notes: list[Note] = []
    # a runner's foot turns faster than 8 rad/s and jolts by more than 18 m/s² before a sensor clips
    read = readings(imu, time, clips_above=(8.0, 18.0), doubt=(3.0, 30.0))
    gyr, acc, lost, step = read.gyr, read.acc, read.lost, np.diff(time, prepend=time[0])
    hz = 1.0 / float(np.median(step[1:]))
    gone = not_bridged(lost, time)
    at_rest = rest(gyr, acc, ~not_bridged(~np.asarray(imu.mask, bool), time), hz)
    free = gyr - at_rest.gyr_bias
    acc_bias = bias_at_rest(at_rest, name, notes)
    stances = events.stances(free, acc, hz)
    if not len(stances.start):
        lowest = float(events.moving_rate(free, hz).min())
        raise RecordingError(
            f"'{name}' never stands: a foot on the ground turns at less than {events.STANCE:g} rad/s between two "
            f"swings; its lowest rate is {lowest:.2f} rad/s"
        )
    stands = events.inside(stances, len(gyr)) & ~lost
    # the zero velocity of a lost sample gets no weight
    margin = np.where(lost, -20.0, np.clip(events.margin(free, acc, stances, hz), -20.0, 20.0))
    notes += read.notes(name)
    bad = lost | read.acc_clipped | read.gyr_clipped
    factor, deviation = gyroscope_scale(free, acc, stances.stillest, bad, hz) or (1.0, 1.0)
    if off_rates := abs(np.log(factor)) > OFF_FROM * deviation:
        notes.append(RATES_OFF(placement=name, factor=factor))
    stances = _measured(_more_footholds(stances, hz), gone)
    whole, known = _whole(stances, lost, time)
    quality = SensorQuality(
        force_off=acc_bias / GRAVITY, rates_factor=factor, rates_off=bool(off_rates), lost=int(lost.sum()),
        gyr_clipped=int(read.gyr_clipped.sum()), acc_clipped=int(read.acc_clipped.sum()),
        strides_missing=int(np.sum(~whole)),
    )  # fmt: skip
    lands = time[np.append(stances.start[1:], len(time) - 1)]
    for begin, end in moves:
        whole &= (lands < begin) | (time[stances.end - 1] > end)
    if quality.lost:
        notes.append(STRIDES_UNCERTAIN(samples=quality.lost, placement=name, longest_s=longest_loss(lost, time)))
    if quality.strides_missing:
        notes.append(STRIDES_MISSING(strides=quality.strides_missing, placement=name, seconds=LONGEST_LOSS))
    first = int(np.flatnonzero(stands)[0]) if stands.any() else int(stances.stillest[0])
    up = acc[first : min(max(stances.end[0], first + 1), first + int(hz))].mean(axis=0)
    vertical, jumped = up / np.linalg.norm(up), jumps(gyr, acc, hz)
    over = bridged(lost, time, np.where(np.arange(len(time)) > first, step, 0.0), gyr, acc, LOST_RATE, LOST_FORCE)
    restart = np.zeros(len(time) + 1)
    restart[stances.stillest + 1] = 1.0
    signals = FootSignals(
        gyr=mean_over_interval(gyr), acc=mean_over_interval(acc), gyr_jump=jumped[0], acc_jump=jumped[1],
        gyr_doubt=np.maximum(read.gyr_doubt, over.rate), acc_doubt=np.maximum(read.acc_doubt, over.force),
        rate=np.linalg.norm(free, axis=1), stands=stands, margin=margin,
        features=features(free, acc, jumped, stands, bad, hz), restart=restart[: len(time)], dt=over.dt,
        valid=np.arange(len(time)) >= first, attitude=level(up), gyr_bias=at_rest.gyr_bias,
        acc_bias=acc_bias * vertical, up=vertical, still_time=np.asarray(max(at_rest.time, 0.05)),
        whole=np.pad(whole, (0, FOOTHOLDS.length(len(time)) - len(whole))), known=known,
        **_footholds(free, stances, hz, len(time)),
    )  # fmt: skip
    longest = max(at_rest.windows, key=lambda window: window[1] - window[0], default=None)
    return signals, quality, notes, longest


def bias_at_rest(at_rest: Rest, name: str, notes: list[Note]) -> float:
    """Bias of the accelerometer along the vertical [m/s²]: the force at rest minus gravity; 0 without a rest.

    One attitude cannot separate a bias from a scale. Mean errors of strides of four public sets differ by 0.01 cm at
    most between both. A true scale error of 10 % gives 4 to 7 % in lengths; taken as a scale, 3.5 to 5.6 %.
    """
    if not at_rest.windows:
        notes.append(NEVER_RESTS(placement=name))
        return 0.0
    off = at_rest.force / GRAVITY - 1.0
    if abs(off) > 0.12:
        raise RecordingError(
            f"acc of '{name}' must read {GRAVITY:.2f} m/s² at rest; it reads {at_rest.force:.3g}: another unit, or a "
            "sensor that was moved while the rate was low"
        )
    if abs(off) > FAR_OFF:
        notes.append(ACCELEROMETER_OFF(placement=name, percent=100.0 * off, when="at rest"))
    elif abs(off) > SCALE_NOTED:
        notes.append(SCALE_CORRECTED(placement=name, percent=100.0 * off, when="at rest"))
    return at_rest.force - GRAVITY


def gyroscope_scale(
    gyr: np.ndarray, acc: np.ndarray, footholds: np.ndarray, bad: np.ndarray, hz: float
) -> tuple[float, float] | None:
    """Factor of the rates with which strides end at rest [1], and the deviation of its logarithm [1], medians over
    strides; None if they cannot be computed.

    With rates s ω, the specific force of a stride, in axes of its first foothold, integrates to the velocity v(s) at
    the next one. A foot that rests at both has v = 0; near s = 1, v ≈ v(1) + (s − 1) v′, and each stride gives
    s = 1 − v(1)·v′ / v′·v′, the first of Newton's steps. What is left of v across v′ does not come from a scale; its
    share of v′ is how uncertain s is: feet of runners do not rest. A wrong interval between samples turns the foot by
    too much or too little as well: s is the scale of the rates times the interval.

    Args:
        gyr: (T, 3) [rad/s], without bias.
        acc: (T, 3) [m/s²].
        footholds: (n,) samples at which the foot rests.
        bad: (T,) bool, samples that were not measured, or are clipped; strides with many do not count.
        hz: sampling rate [Hz].
    """
    first, last = footholds[:-1], footholds[1:]
    seconds, so_far = (last - first) / hz, np.concatenate([[0], np.cumsum(bad)])
    good = so_far[last + 1] - so_far[first] <= 0.1 * (last - first)
    at = np.flatnonzero((seconds > 0.5) & (seconds < 2.5) & good)
    if len(at) < 5:
        return None
    at = at[np.linspace(0.0, len(at) - 1.0, min(len(at), 200)).round().astype(int)]
    first, last, seconds = first[at], last[at], seconds[at, None]
    width = max(round(0.03 * hz), 1)
    up = np.stack([acc[max(at - width, 0) : at + width + 1].mean(axis=0) for at in first])
    size = np.linalg.norm(up, axis=1, keepdims=True)

    def at_rest(factor: float) -> np.ndarray:
        """(n, 3) velocity at the next foothold [m/s], where the force at the first one is gravity, and has no scale."""
        attitude, force = integrated(factor * gyr, acc, hz)
        back = conjugate(Quaternion(*(part[first] for part in attitude)))
        gained = as_array(rotated(back, vector(force[last] - force[first])))
        return np.asarray(GRAVITY * (gained - up * seconds) / size)

    scale, step = 1.0, 0.05
    for _ in range(2):  # Newton's steps
        rest = at_rest(scale)
        slope = (at_rest(scale + step) - rest) / step
        effect = np.maximum(np.sum(slope * slope, axis=1), 1e-9)
        more = -np.sum(rest * slope, axis=1) / effect
        across = np.linalg.norm(rest + more[:, None] * slope, axis=1) / np.sqrt(effect)
        scale = float(np.clip(scale + np.median(more), 0.3, 3.0))
    # 3 % where all strides end at rest: of a gyroscope, and by rates sampled 50 times a second, whose peaks are lower
    return scale, float(np.hypot(0.03, np.median(across) / scale))


def _more_footholds(stances: events.Stances, hz: float) -> events.Stances:
    """Add a foothold every `REST_STEP` to a long stance; their strides have no length and are invalid."""
    step = int(REST_STEP * hz)
    rows: list[tuple[float, ...]] = []
    for start, end, stillest, rate in zip(*stances, strict=True):
        more = [k for k in range(start + step, end - step, step) if abs(k - stillest) >= step]
        places = sorted({int(stillest), *more})
        cuts = [start, *(int(0.5 * (a + b)) for a, b in itertools.pairwise(places)), end]
        rows += [(a, b, at, rate) for a, b, at in zip(cuts[:-1], cuts[1:], places, strict=True)]
    return events.Stances(*(np.array(column) for column in zip(*rows, strict=True)))


def _measured(stances: events.Stances, gone: np.ndarray) -> events.Stances:
    """The stances, with footholds at measured samples where the stance has any; `gone` (T,) is True at lost samples."""
    stillest = stances.stillest.copy()
    for row in np.flatnonzero(gone[stillest]):
        there = stances.start[row] + np.flatnonzero(~gone[stances.start[row] : stances.end[row]])
        if there.size:
            stillest[row] = there[np.argmin(np.abs(there - stillest[row]))]
    return stances._replace(stillest=stillest)


def _whole(stances: events.Stances, lost: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Footholds (n,) whose next stride can be estimated, and samples (T,) outside the strides that cannot be.

    A stride is estimated between two measured footholds, with little lost between them.
    """
    ends = np.append(stances.stillest[1:], len(lost) - 1)
    unseen = np.append(not_bridged(lost, time)[stances.stillest], False)
    whole = (lost_between(lost, time, stances.stillest, ends) <= LONGEST_LOSS) & ~unseen[:-1] & ~unseen[1:]
    known = np.ones(len(lost), bool)
    for at, end in zip(stances.stillest[~whole], ends[~whole], strict=True):
        known[at + 1 : end] = False
    return whole, known


def _footholds(gyr: np.ndarray, stances: events.Stances, hz: float, samples: int) -> dict[str, np.ndarray]:
    """Samples of footholds and contacts, padded with the last."""
    rows, reach = FOOTHOLDS.length(samples), int(STANCE_EDGE_S * hz)
    final, initial = events.contacts(gyr, stances, hz)
    last = stances.end - 1

    def filled(values: np.ndarray) -> np.ndarray:
        return np.pad(values.astype(np.int32), (0, rows - len(values)), mode="edge")

    return {
        "foothold": filled(stances.stillest),
        "leaves": filled(np.maximum(stances.stillest, last - reach)),
        "arrives": filled(np.minimum(stances.stillest, stances.start + reach)),
        "final_contact": filled(np.append(final, samples - 1)),
        "initial_contact": filled(np.append(initial, samples - 1)),
        "count": np.asarray(len(stances.stillest), np.int32),
    }
