"""Inputs of the ankle's estimator, and how a recording gives them: axes, swings, stances, standing. In NumPy.

This module makes the decisions: the sensor's axes, begin and end of strides, when the ankle stands, the gyroscope's
bias. Decisions carry no gradient; given the decisions, `ankle_stride.run` is differentiable.
"""

from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import PyTree

from jgait.estimators import checks
from jgait.estimators import notes as kinds
from jgait.estimators.ankle_stride.params import DEFAULT, KNOWN, AnkleOptions
from jgait.estimators.interface import Axis, Held, Prepared, Sampled, Times, axes_of
from jgait.estimators.plausible import QUICK_S
from jgait.estimators.programs import bucket, compiled
from jgait.events import shank as shank_events
from jgait.events import shank_stance
from jgait.events.rest import longest_still
from jgait.geometry.rotation import level
from jgait.geometry.vectors import GRAVITY
from jgait.mounting import shank as shank_axes
from jgait.mounting.places import FORWARD_UNSURE
from jgait.mounting.shank import Axes
from jgait.notes import Kind, Note, record
from jgait.quality import SensorQuality
from jgait.quality.evidence import FAR_OFF
from jgait.signal import butterworth
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Counts, Imu, Recording, RecordingError, Values, as_float

WINDOW_S = 0.03
"""[s] Duration before a valley, and after it, in which the ankle is taken to stand; chosen by hand."""

STANDING = 0.2
"""[rad/s] Angular rate below which the leg stands in a pause, and before and after the walk; chosen by hand."""

LOST = (2.5, 0.2), (5.0, 1e-3)
"""([rad/s], [s]), ([m/s²], [s]) Error of linear interpolation over lost samples of the rate and of the force, see
`checks.bridged`. On moving shanks of three data sets (experiment `damage.gaps`) 0.9 rad/s and 3.2 m/s² over 0.2 s, 1.4
and 3.3 over 0.9 s; and half as much again for people who walk faster."""

STRIDES_QUICK = Kind(
    "strides_quick", "check", "{placement}: strides last {seconds:.2f} s, as in running",
    "In running the leg does not stand as in walking: lengths and distance, and angles with sleeping gyroscopes, may "
    "be wrong by much more than their deviations say. Small children walk with such strides too.",
)  # fmt: skip

SWINGS_SMALL = Kind(
    "swings_too_small", "check", "{placement}: {swings} {swings:swing is|swings are} too slow or too small to be "
    "counted, beside {strides} {strides:stride|strides}",
    "Strides and distance lack steps if the person took very short or very slow steps there; legs that tremble make "
    "such swings too. The deviation of the distance from all sensors contains half a stride for each.",
)  # fmt: skip

PerStride = Annotated[Values, Axis("zero", 10, 2)]
"""(K,), one entry per stride, none shorter than ten samples; 0 or False after the last stride."""


class AnkleSignals(NamedTuple):
    """Signals of one leg's sensor in the segment's axes (forward, left, up), and the decisions of `prepare`."""

    gyr: Held  #: (T, 3) angular rate at each sample [rad/s], not filtered.
    acc: Held  #: (T, 3) specific force [m/s²], not filtered.
    gyr_jump: Sampled  #: (T,) largest change of the rate from sample to sample in a window around the sample [rad/s].
    acc_jump: Sampled  #: (T,) the same of the specific force [m/s²].
    gyr_doubt: Sampled  #: (T,) standard deviation of the rate where it was lost or clipped, else 0 [rad/s].
    acc_doubt: Sampled  #: (T,) the same of the specific force [m/s²].
    stands: Sampled  #: (T,) bool, the ankle stands: around valleys, and while the person stands.
    restart: Sampled  #: (T,) 1 at the sample after the begin of a stride, else 0; in floats.
    dt: Sampled  #: (T,) time since the sample before [s]; 0 up to the first stance, where the filter starts.
    valid: Sampled  #: (T,) bool; False before the first stance and in padding.
    last: Counts  #: index of the last sample before the padding.
    rate_hz: Values  #: sampling rate.
    attitude: PyTree  #: (4,) q_ws at the first stance, w first, its heading arbitrary.
    gyr_bias: Values  #: (3,) gyroscope bias while standing [rad/s].
    still_time: Values  #: duration of the standing from which that bias was measured [s]; 0: the leg never stood still.
    mid_shank: Values  #: 1 if the sensor is at mid shank, 0 at the ankle.
    axes: Values  #: (3, 3) forward, left and up in the sensor's axes.
    begin: PerStride  #: (K,) sample at which each stride begins; after the last stride, 0.
    end: PerStride  #: (K,) sample at which each stride ends.
    swing_begin: PerStride  #: (K,) sample at which the shank's forward swing begins.
    swing_end: PerStride  #: (K,) sample at which the shank's forward swing ends.
    leaves: PerStride  #: (K,) time at which the swing begins, between samples [s].
    lands: PerStride  #: (K,) time at which the swing ends, between samples [s].
    half: PerStride  #: (K,) bool, the stride begins or ends with standing.
    clips: PerStride  #: (K,) bool, the stride's swing reaches the gyroscope's range.
    follows: PerStride  #: (K,) bool, the stride begins where the stride before ended.
    count: Counts  #: number of strides.


@record
class AnkleInputs(NamedTuple):
    """Inputs of `ankle_stride.run`: signals of each leg with a sensor at times (T,) [s]; every leaf is an array."""

    time: Times
    right: AnkleSignals | None
    left: AnkleSignals | None


def prepare(recording: Recording, options: AnkleOptions = DEFAULT) -> Prepared[AnkleInputs]:
    """The inputs of `ankle_stride.run` for a recording with one or two sensors at ankles or on shanks, on one clock.

    Raises:
        RecordingError: no such sensor, clocks that differ or run backwards, no accelerometer, NaN, too short, or a
            sampling rate that is not supported.
    """
    checks.check_options(options, KNOWN)
    kinds = ("ankle", "shank") if options.site == "auto" else (options.site,)
    # the ankle's sensor where there is one
    names = ((side, f"{kind}_{side}") for side in SIDES for kind in reversed(kinds))
    worn = {side: name for side, name in names if name in recording.sensors}
    if not worn:
        wanted = " or ".join(f"'{kind}_{side}'" for kind in kinds for side in SIDES)
        raise RecordingError(f"ankle_stride needs {wanted}; {checks.sensors_of(recording)}")
    time = _checked(recording, list(worn.values()))
    legs: dict[str, AnkleSignals | None] = dict.fromkeys(SIDES)
    notes: list[Note] = []
    quality: dict[str, SensorQuality] = {}
    standing = None
    for side, name in worn.items():
        placement, note = shank_axes.worn_on_shank(recording, side) if name.startswith("shank") else (name, None)
        if placement != name:  # labels are exchanged, and the other leg's sensor is not checked yet
            _checked(recording, [name, placement])
        legs[side], quality[name], leg_notes, still = _leg(
            recording.sensors[placement], time, recording.sampling_rate_hz, name, options
        )
        notes += ([note] if note and note not in notes else []) + leg_notes
        standing = still if standing is None else standing
    inputs = AnkleInputs(time, legs["right"], legs["left"])
    # both sites share a compiled program
    return Prepared(inputs, options._replace(site="auto"), tuple(notes), standing, quality=quality)


def _checked(recording: Recording, names: list[str]) -> np.ndarray:
    """The time that all sensors share, checked together with the signals."""
    rate, (low, high) = recording.sampling_rate_hz, shank_events.RATES
    if not low <= rate <= high:
        raise RecordingError(f"ankle_stride needs {low:g} to {high:g} Hz; the recording has {rate:g} Hz")
    time = checks.common_time(recording, names, "ankle_stride", "both legs", least_s=1.0)
    checks.check_nominal_rate(time, names[0], rate)
    return time


def _padded(values: np.ndarray) -> np.ndarray:
    return Axis("hold").padded(values, bucket(len(values)) - len(values))


def _slow(values: Values, rate_hz: float) -> np.ndarray:
    """The signal (T, 3), low-passed for the search for stances."""
    slow = butterworth.low_pass_both_ways(_padded(as_float(values)), shank_stance.CUTOFF_HZ, float(rate_hz))
    return np.asarray(slow[: len(values)])


def swings_of(imu: Imu, axes: Axes, rate_hz: float, detector: str) -> tuple[np.ndarray, np.ndarray, int]:
    """Begin and end of each swing, in samples and parts of them, and the number of swings too small to be strides.

    Each swing ends before the next swing begins.
    """
    rate, count = as_float(imu.gyr) @ axes.rows[1], len(imu.time)
    # of 42 legs of `walking5m`, `tripod` and `neura_sparse` none has more than one swing of half the threshold that is
    # no stride; in very slow stances the shank moves less
    small = shank_events.LOBES._replace(threshold=np.deg2rad(20.0), least_angle=np.deg2rad(10.0))
    detect, settings = {
        "swings": (shank_events.swings, small), "machine": (shank_events.phases, shank_events.MACHINE),
        "paper": (shank_events.phases, shank_events.PAPER),
    }[detector]  # fmt: skip
    swings = compiled(detect)(_padded(rate), sampling_rate_hz=rate_hz, d=settings)
    there = np.flatnonzero(np.asarray(swings.stride)[:count])
    start, end, peak, angle = (np.asarray(v)[there] for v in (swings.start, swings.end, swings.peak, swings.angle))
    large = (peak > shank_events.LOBES.threshold) & (angle > shank_events.LOBES.least_angle)
    large |= detector != "swings"
    start, end = (np.clip(times[large] * rate_hz, 0.0, count - 1.0) for times in (start, end))
    start = np.maximum(start, np.concatenate([[0.0], end[:-1] + 1.0])[: len(end)])
    kept = np.rint(end) > np.rint(start)
    return start[kept], end[kept], int(np.sum(~large))


def _leg(
    imu: Imu, time: np.ndarray, rate_hz: float, name: str, options: AnkleOptions
) -> tuple[AnkleSignals, SensorQuality, list[Note], tuple[int, int] | None]:
    """Signals and decisions of one leg, facts and notes about the sensor, and the samples at which the leg stands
    still.
    """
    notes: list[Note] = []
    quality = SensorQuality()
    # a range of ±4 g cuts off some 40 m/s² at the shanks of simulated runners
    read = checks.readings(imu, time, clips_above=(4.0, 18.0), doubt=(2.0, 40.0), least=3)
    lost = read.lost
    still = longest_still(
        imu.gyr, rate_hz, mask=np.asarray(imu.mask, bool), threshold=shank_axes.RESTING, at_least_s=0.5
    )
    bias = shank_axes.rest_bias(imu, rate_hz) if options.standing else None
    bias = np.zeros(3) if bias is None else bias
    at_rest = imu._replace(gyr=read.gyr - bias, acc=read.acc)
    axes = shank_axes.functional_axes(at_rest)
    start = end = np.zeros(0)
    if axes is None:
        notes.append(kinds.NO_STEPS(placement=name))
        quality = quality._replace(unusable=True)
        axes = Axes(np.eye(3), 0.0)
    else:
        start, end, small = swings_of(at_rest, axes, rate_hz, options.detector)
        if small > max(1, 0.1 * len(start)):
            quality = quality._replace(swings=len(start), small_swings=small)
        if abs(axes.asymmetry) < shank_axes.LEAST_ASYMMETRY:
            text = "it swings as fast backwards as forwards: which way is forward is not sure"
            notes.append(FORWARD_UNSURE.note(text, placement=name))
    slow = _slow(at_rest.gyr, rate_hz)
    speed, swings = np.linalg.norm(slow, axis=1), len(start)
    start, end, stood = _stances(
        slow @ axes.rows[1], speed, start, end, checks.not_bridged(lost, time, kinds.LONGEST_LOSS), rate_hz
    )
    missing = swings - len(start)
    stands = _standing(stood, speed, rate_hz) & ~lost
    start, end, stood = _kept(stood.rests.all(axis=1), start, end, stood)
    if len(start):
        valleys = stood.end[~stood.standing[:, 1]]
        axes = shank_axes.stance_up(axes, _slow(read.acc, rate_hz), valleys if len(valleys) else stood.end)
    if rate_hz < (usual_hz := 35.0):  # strides are less certain than the filter states; chosen by hand
        notes.append(kinds.SAMPLED_SLOWLY(placement=name, rate_hz=rate_hz, least_hz=usual_hz))
    rests = still if options.standing else None
    if rests is not None:
        off = float(np.linalg.norm(read.acc[slice(*rests)].mean(axis=0))) / GRAVITY - 1.0
        quality = quality._replace(force_off=off)
    elif options.standing:
        text = "it never stands still for half a second: its gyroscope's bias is left to the filter"
        notes.append(kinds.NO_FIRST_STANDING.note(text, placement=name))
    if lost.any():
        notes.append(
            kinds.STRIDES_UNCERTAIN(samples=lost.sum(), placement=name, longest_s=checks.longest_loss(lost, time))
        )
    gyr, acc = (values @ axes.rows.T for values in (read.gyr, read.acc))
    gyr_jump, acc_jump = checks.jumps(gyr, acc, rate_hz)
    index, first = np.arange(len(time)), int(np.argmax(stands)) if stands.any() else len(time)
    upright = acc[first : first + max(3, round(2 * WINDOW_S * rate_hz))] if stands.any() else acc
    restart = np.zeros(len(time) + 1)
    restart[stood.begin + 1] = 1.0
    gone = checks.not_bridged(lost, time)
    measured = checks.lost_between(lost, time, stood.begin, stood.end) <= kinds.LONGEST_LOSS
    measured &= ~gone[stood.begin] & ~gone[stood.end]
    missing += int((~measured).sum())
    if missing:
        notes.append(kinds.STRIDES_MISSING(strides=missing, placement=name, seconds=kinds.LONGEST_LOSS))
        start, end, stood = _kept(measured, start, end, stood)
    last = float(np.median(time[stood.end] - time[stood.begin])) if len(start) else np.inf
    quality = quality._replace(
        gyr_clipped=int(read.gyr_clipped.sum()), acc_clipped=int(read.acc_clipped.sum()), lost=int(lost.sum()),
        strides_missing=missing, quick_stride=last if last < QUICK_S else np.inf,
    )  # fmt: skip
    notes += shank_notes(name, quality)
    dt = np.where(index > first, np.diff(time, prepend=time[0]), 0.0)
    over = checks.bridged(lost, time, dt, gyr, acc, *LOST)
    still_s = 0.0 if rests is None else (rests[1] - rests[0]) / rate_hz
    signals = AnkleSignals(
        gyr=gyr, acc=acc, gyr_jump=gyr_jump, acc_jump=acc_jump, gyr_doubt=np.maximum(read.gyr_doubt, over.rate),
        acc_doubt=np.maximum(read.acc_doubt, over.force), stands=stands, restart=restart[: len(time)], dt=over.dt,
        valid=index >= first, last=np.asarray(len(time) - 1, np.int32), rate_hz=np.asarray(float(rate_hz)),
        attitude=level(upright.mean(axis=0)), gyr_bias=axes.rows @ bias, still_time=np.asarray(still_s),
        mid_shank=np.asarray(float(name.startswith("shank"))), axes=axes.rows,
        **_strides(start, end, stood, time, read.gyr_clipped), count=np.asarray(len(start), np.int32),
    )  # fmt: skip
    return signals, quality, notes, still


def _stances(
    rate: np.ndarray, speed: np.ndarray, start: np.ndarray, end: np.ndarray, gone: np.ndarray, rate_hz: float
) -> tuple[np.ndarray, np.ndarray, shank_stance.ShankStances]:
    """Swings with their stances; each part of the recording between long losses (T,) has its own begin and end."""
    kept = np.zeros(len(start), bool)
    parts = [shank_stance.ShankStances(*(np.zeros(0, np.int64),) * 2, *(np.zeros((0, 2), bool),) * 2)]
    for first, after in true_runs(~gone):
        inside = (np.rint(start) >= first) & (np.rint(end) < after)
        if inside.any():
            part = slice(first, after)
            stood = shank_stance.stances(rate[part], speed[part], start[inside] - first, end[inside] - first, rate_hz)
            parts.append(stood._replace(begin=stood.begin + first, end=stood.end + first))
            kept |= inside
    stood = shank_stance.ShankStances(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    return start[kept], end[kept], stood


def _kept(
    whole: np.ndarray, start: np.ndarray, end: np.ndarray, stood: shank_stance.ShankStances
) -> tuple[np.ndarray, np.ndarray, shank_stance.ShankStances]:
    """Some of the swings and of their stances."""
    return start[whole], end[whole], shank_stance.ShankStances(*(part[whole] for part in stood))


def _standing(stood: shank_stance.ShankStances, speed: np.ndarray, rate_hz: float) -> np.ndarray:
    """(T,) bool, the ankle stands: around stance instants, and while the leg turns slowly in a pause or at the ends."""
    flags = np.zeros(len(speed), bool)
    if not len(stood.begin):
        return flags
    reach = max(1, round(WINDOW_S * rate_hz))
    for instant in np.concatenate([stood.begin[stood.rests[:, 0]], stood.end[stood.rests[:, 1]]]):
        flags[max(0, instant - reach) : instant + reach + 1] = True
    edges = np.concatenate([[0], np.stack([stood.begin, stood.end], axis=1).ravel(), [len(speed)]])
    pauses = np.concatenate([[True], (stood.rests & stood.standing).ravel(), [True]])
    for first, last, pause in zip(edges[::2], edges[1::2], pauses[::2] & pauses[1::2], strict=True):
        flags[first:last] |= pause & (speed[first:last] < STANDING)
    return flags


def _strides(
    start: np.ndarray, end: np.ndarray, stood: shank_stance.ShankStances, time: np.ndarray, clips: np.ndarray
) -> dict[str, np.ndarray]:
    """Events and flags of each stride, padded."""
    axis, index = axes_of(AnkleSignals)["begin"], np.arange(len(time))
    assert axis is not None
    rows = axis.length(len(time))
    first, last = (np.rint(values).astype(np.int32) for values in (start, end))
    clipped = np.concatenate([[0], np.cumsum(clips)])
    columns = {
        "begin": stood.begin.astype(np.int32), "end": stood.end.astype(np.int32), "swing_begin": first,
        "swing_end": last, "leaves": np.interp(start, index, time), "lands": np.interp(end, index, time),
        "half": stood.standing.any(axis=1), "clips": clipped[last + 1] > clipped[first],
        "follows": np.concatenate([[False], stood.begin[1:] == stood.end[:-1]])[: len(first)],
    }  # fmt: skip
    return {name: np.pad(values, (0, rows - len(values))) for name, values in columns.items()}


def shank_notes(placement: str, facts: SensorQuality) -> list[Note]:
    """Notes on steps that a sensor lacks, on signals that are off or clip, and on running."""
    notes = []
    if facts.small_swings:
        notes.append(SWINGS_SMALL(placement=placement, swings=facts.small_swings, strides=facts.swings))
    if abs(facts.force_off) > FAR_OFF:
        notes.append(kinds.ACCELEROMETER_OFF(placement=placement, percent=100.0 * facts.force_off, when="at rest"))
    for signal, samples in (("gyroscope", facts.gyr_clipped), ("accelerometer", facts.acc_clipped)):
        if samples:
            notes.append(kinds.CLIPPED(signal=signal, placement=placement, samples=samples))
    return notes + ([STRIDES_QUICK(placement=placement, seconds=facts.quick_stride)] if facts.runs else [])
