"""Inputs of the foot estimator from a recording: stances, scale, attitude, footholds. NumPy, on the host.

This module detects stances and footholds and measures the gyroscope bias at rest. It has no gradient; `foot_ins.run`
is differentiable for given stances and footholds.
"""

import itertools

import numpy as np

from jgait.estimators.checks import bridged, common_time, longest_loss, lost_between, not_bridged, sensors_of
from jgait.estimators.foot_ins.inputs import FootInputs, FootSignals, capacity
from jgait.estimators.foot_ins.params import DEFAULT, FootOptions
from jgait.estimators.foot_ins.sensor import OFF_FROM, gyroscope_scale
from jgait.estimators.interface import Prepared
from jgait.estimators.noise import features
from jgait.estimators.notes import (
    ACCELEROMETER_OFF,
    CLIPPED,
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
from jgait.geometry.rotation import level
from jgait.geometry.vectors import GRAVITY
from jgait.notes import FEW_RESTS, Kind, Note
from jgait.quality import SensorQuality
from jgait.quality.stride import FAR_OFF
from jgait.signal import clipping
from jgait.signal.windows import held_mean, over_losses, window_maximum, window_size
from jgait.types import SIDES, Imu, Recording, RecordingError

SLOWEST_HZ = 45.0
"""[Hz] Lowest sampling rate; a lower rate does not sample the jolt of a heel strike, which lasts some 30 ms."""

OFF_SCALE = 0.12
"""[1] Largest relative difference of the specific force at rest from gravity; a larger one raises an error."""

SCALE_SPREAD, BIAS_SPREAD = 0.005, 0.1
"""[1], [m/s²] Usual errors of accelerometers, by which a difference from gravity is divided into scale and bias."""

QUIET_STANCE, STANCE_S, FEWEST_STANCES, STANCE_OFF = 0.3, 0.1, 3, 0.02
"""[rad/s], [s], [1], [1] Rate below which the sensor of a foot in stance measures hardly more than gravity, window of
that force, least number of such stances, and least difference from gravity that is corrected. Of feet of public sets
that rest as well, hardly one has a larger difference between such stances and rest; in stances of running, which turn
more, many have.
"""

LOST_RATE, LOST_FORCE = (0.3, 1e-3), (3.3, 1e-3)
"""([rad/s], [s]), ([m/s²], [s]) Error of linear interpolation over lost samples, see `bridged`; less than on feet
of five data sets (experiment `damage.gaps`: 1.4 rad/s and 5.5 m/s² over 0.2 s). With those values the filter explained
the motion of a runner's foot by a tilt: strides after a loss of 0.2 s were wrong by a metre, without a large
innovation."""

CLIPPED_RATE, CLIPPED_FORCE = 3.0, 30.0
"""[rad/s], [m/s²] Standard deviation of a clipped sample that is not restored."""

CLIPS_ABOVE_RATE, CLIPS_ABOVE_FORCE = 8.0, 18.0
"""[rad/s], [m/s²] Consecutive equal samples at an axis's maximum count as clipped only above this value."""

REST_STEP = 20.0
"""[s] Time between the footholds of a foot at rest."""

NEVER = -20.0
"""[1] Margin of a sample that is lost: its zero velocity gets no weight."""

STANCE_EDGE_S = 0.3
"""[s] `leaves` is at most this long before the end of a stance, `arrives` at most this long after its start."""


NEVER_RESTS = Kind(
    "foot_never_rests",
    "check",
    "{placement} never rests for half a second: its gyroscope's bias is not known, headings drift more",
    FEW_RESTS,
)


def worn_sides(recording: Recording) -> tuple[str, ...]:
    """The sides with a foot sensor. Raises RecordingError if neither foot has a sensor."""
    sides = tuple(side for side in SIDES if f"foot_{side}" in recording.sensors)
    if not sides:
        raise RecordingError(f"foot_ins needs 'foot_right' or 'foot_left'; {sensors_of(recording)}")
    return sides


def prepare(recording: Recording, options: FootOptions = DEFAULT) -> Prepared[FootInputs]:
    """The inputs of `foot_ins.run` for a recording of one or both feet on one clock.

    Raises:
        RecordingError: no foot sensor, clocks that differ, no accelerometer, NaN, sampling rate too low, wrong unit,
            or no stance of a foot.
    """
    sides = worn_sides(recording)
    time = checked_clock(recording, sides)
    feet: dict[str, FootSignals | None] = dict.fromkeys(SIDES)
    notes: list[Note] = []
    quality: dict[str, SensorQuality] = {}
    standing = None
    for side, name in zip(sides, (f"foot_{side}" for side in sides), strict=True):
        feet[side], quality[name], foot_notes, rests = _foot(recording.sensors[name], time, name, recording.moves or ())
        notes += foot_notes
        standing = rests if standing is None else standing
    inputs = FootInputs(time, feet["right"], feet["left"])
    return Prepared(inputs, options, tuple(notes), standing, quality=quality)


def checked_clock(recording: Recording, sides: tuple[str, ...]) -> np.ndarray:
    """The common time of all feet; the signals are checked as well."""
    time = common_time(recording, [f"foot_{side}" for side in sides], "foot_ins", "both feet")
    rate = 1.0 / float(np.median(np.diff(time)))
    if rate < 0.99 * SLOWEST_HZ:  # a clock is a little off its nominal rate
        raise RecordingError(f"foot_ins needs {SLOWEST_HZ:g} Hz or more; the recording has {rate:.1f} Hz")
    return time


def _mean_over_interval(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values[:1], 0.5 * (values[1:] + values[:-1])])


def _foot(
    imu: Imu, time: np.ndarray, name: str, moves: tuple[Span, ...]
) -> tuple[FootSignals, SensorQuality, list[Note], tuple[int, int] | None]:
    """Inputs of one foot, facts and notes about its sensor, and the longest rest as a half-open range of samples.

    Footholds between which the person moves without walking give no stride.
    """
    notes: list[Note] = []
    mask = np.asarray(imu.mask, bool)
    gyr, acc = (over_losses(np.arange(len(time)), values, mask) for values in (imu.gyr, imu.acc))
    peaks = clipping.restored(gyr)
    gyr = peaks.signal
    read_gyr, read_acc = (np.where(mask[:, None], np.asarray(v, np.float64), 0.0) for v in (imu.gyr, imu.acc))
    clips = clipping.forces_clipped(read_acc, CLIPS_ABOVE_FORCE)
    forces = clipping.restored_forces(acc, clips | ~mask)
    acc = forces.signal
    step = np.diff(time, prepend=time[0])
    nominal = float(np.median(step[1:]))
    hz = 1.0 / nominal
    at_rest = rest(gyr, acc, ~not_bridged(~mask, time), hz)
    if not at_rest.windows:
        at_rest = at_rest._replace(force=force_in_stances(gyr, acc, hz))
    scale, acc_bias, off = errors_at_rest(at_rest, name, notes)
    acc = acc * scale
    lost = ~mask | (step > 1.5 * nominal)
    stances = events.stances(gyr - at_rest.gyr_bias, acc, hz)
    if not len(stances.start):
        lowest = float(events.moving_rate(gyr - at_rest.gyr_bias, hz).min())
        raise RecordingError(
            f"'{name}' never stands: a foot on the ground turns at less than {events.STANCE:g} rad/s between two "
            f"swings; its lowest rate is {lowest:.2f} rad/s"
        )
    stands = events.inside(stances, len(gyr)) & ~lost
    margin = events.margin(gyr - at_rest.gyr_bias, acc, stances, hz)
    margin = np.where(lost, NEVER, np.clip(margin, NEVER, -NEVER))
    equal = clipping.at_limit(read_gyr, CLIPS_ABOVE_RATE) & ~peaks.clipped
    turned = equal | peaks.clipped
    for what, flags in (("accelerometer", clips), ("gyroscope", turned)):
        if flags.any():
            notes.append(CLIPPED(signal=what, placement=name, samples=flags.sum()))
    scaled = gyroscope_scale(gyr - at_rest.gyr_bias, acc, stances.stillest, lost | clips | turned, hz)
    factor, deviation = scaled or (1.0, 1.0)
    if off_rates := abs(np.log(factor)) > OFF_FROM * deviation:
        notes.append(RATES_OFF(placement=name, factor=factor))
    stances = _measured(_more_footholds(stances, hz), not_bridged(lost, time))
    whole, known = _whole(stances, lost, time)
    quality = SensorQuality(
        force_off=off, rates_factor=factor, rates_off=bool(off_rates), gyr_clipped=int(turned.sum()),
        acc_clipped=int(clips.sum()), lost=int(lost.sum()), strides_missing=int(np.sum(~whole)),
    )  # fmt: skip
    lands = time[np.append(stances.start[1:], len(time) - 1)]
    for begin, end in moves:
        whole &= (lands < begin) | (time[stances.end - 1] > end)
    if quality.lost:
        notes.append(STRIDES_UNCERTAIN(samples=quality.lost, placement=name, longest_s=longest_loss(lost, time)))
    if quality.strides_missing:
        notes.append(STRIDES_MISSING(strides=quality.strides_missing, placement=name, seconds=LONGEST_LOSS))
    first = int(np.flatnonzero(stands)[0]) if stands.any() else int(stances.stillest[0])
    until = min(max(stances.end[0], first + 1), first + int(hz))
    up = acc[first:until].mean(axis=0)
    size = max(3, 2 * round(0.0075 * hz) + 1)
    jumps = [window_maximum(np.linalg.norm(np.gradient(values, axis=0), axis=1), size) for values in (gyr, acc)]
    dt = np.where(np.arange(len(time)) > first, step, 0.0)
    over = bridged(lost, time, dt, gyr, acc, LOST_RATE, LOST_FORCE)
    restart = np.zeros(len(time) + 1)
    restart[stances.stillest + 1] = 1.0
    signals = FootSignals(
        gyr=_mean_over_interval(gyr),
        acc=_mean_over_interval(acc),
        gyr_jump=jumps[0],
        acc_jump=jumps[1],
        gyr_doubt=np.maximum(peaks.doubt, np.maximum(over.rate, CLIPPED_RATE * equal)),
        acc_doubt=np.maximum(over.force, np.where(forces.clipped, forces.doubt, CLIPPED_FORCE * clips)),
        rate=np.linalg.norm(gyr - at_rest.gyr_bias, axis=1),
        stands=stands,
        margin=margin,
        features=features(gyr - at_rest.gyr_bias, acc, (jumps[0], jumps[1]), stands, lost | clips | turned, hz),
        restart=restart[: len(time)],
        dt=over.dt,
        valid=np.arange(len(time)) >= first,
        attitude=level(up),
        gyr_bias=at_rest.gyr_bias,
        acc_bias=acc_bias * up / np.linalg.norm(up),
        up=up / np.linalg.norm(up),
        still_time=np.asarray(max(at_rest.time, 0.05)),
        whole=np.pad(whole, (0, capacity(len(time)) - len(whole))),
        known=known,
        **_footholds(gyr - at_rest.gyr_bias, stances, hz, len(time)),
    )
    longest = max(at_rest.windows, key=lambda window: window[1] - window[0], default=None)
    return signals, quality, notes, longest


def force_in_stances(gyr: np.ndarray, acc: np.ndarray, hz: float) -> float:
    """Size of the specific force of a foot that never rests [m/s²]: the median over stances in which it hardly turns,
    see `QUIET_STANCE`; 0 if there are too few.
    """
    stances = events.stances(gyr, acc, hz)
    quiet = stances.stillest[stances.rate < QUIET_STANCE]
    force = np.linalg.norm(held_mean(acc, window_size(STANCE_S, hz)), axis=1)
    return float(np.median(force[quiet])) if len(quiet) >= FEWEST_STANCES else 0.0


def errors_at_rest(at_rest: Rest, name: str, notes: list[Note]) -> tuple[float, float, float]:
    """Scale factor of the accelerometer, its bias along the vertical [m/s²], and its relative difference from
    gravity.

    One attitude cannot separate scale from bias; the difference is divided by the usual sizes of both errors.
    """
    off, when = at_rest.force / GRAVITY - 1.0, "at rest"
    if not at_rest.windows:
        notes.append(NEVER_RESTS(placement=name))
        when = "in stances"
        if not STANCE_OFF < abs(off) < OFF_SCALE:
            return 1.0, 0.0, 0.0
    if abs(off) > OFF_SCALE:
        raise RecordingError(
            f"acc of '{name}' must read {GRAVITY:.2f} m/s² at rest; it reads {at_rest.force:.3g}: another unit, or a "
            "sensor that was moved while the rate was low"
        )
    if abs(off) > FAR_OFF:
        notes.append(ACCELEROMETER_OFF(placement=name, percent=100.0 * off, when=when))
    elif abs(off) > SCALE_NOTED:
        notes.append(SCALE_CORRECTED(placement=name, percent=100.0 * off, when=when))
    share = SCALE_SPREAD**2 / (SCALE_SPREAD**2 + (BIAS_SPREAD / GRAVITY) ** 2)
    scale = 1.0 / (1.0 + share * off)
    return scale, scale * at_rest.force - GRAVITY, off


def _more_footholds(stances: events.Stances, hz: float) -> events.Stances:
    """Add a foothold every `REST_STEP` to a long stance; their strides have no length and are invalid."""
    step = int(REST_STEP * hz)
    rows = []
    for start, end, stillest, rate in zip(*stances, strict=True):
        more = [k for k in range(start + step, end - step, step) if abs(k - stillest) >= step]
        places = sorted({int(stillest), *more})
        cuts = [start, *(int(0.5 * (a + b)) for a, b in itertools.pairwise(places)), end]
        rows += [(a, b, at, rate) for a, b, at in zip(cuts[:-1], cuts[1:], places, strict=True)]
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return events.Stances(*columns)


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
    """Samples of footholds and contacts, padded to `capacity` with the last."""
    rows, reach = capacity(samples), int(STANCE_EDGE_S * hz)
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
