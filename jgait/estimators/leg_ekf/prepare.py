"""Inputs of the leg estimator from a recording: quiet standing, segment axes, exchanged sensors. NumPy, on the host.

This module detects quiet standing and finds the mediolateral axis of each sensor and its sign. It has no gradient;
`leg_ekf.run` is differentiable for given standing and axes.
"""

import itertools
from collections.abc import Mapping

import numpy as np

from jgait.estimators.ankle_stride.params import AnkleOptions
from jgait.estimators.ankle_stride.prepare import AnkleInputs, shank_notes
from jgait.estimators.ankle_stride.prepare import prepare as prepare_shanks
from jgait.estimators.checks import common_time, sensors_of
from jgait.estimators.interface import Prepared
from jgait.estimators.leg_ekf.inputs import LegInputs, LegSignals, Segment
from jgait.estimators.leg_ekf.notes import NOT_ESTIMATED, ONE_LEG, SLIPPED, STANDS_OTHERWISE, ZERO_OF_WALKING
from jgait.estimators.leg_ekf.params import DEFAULT, LegOptions
from jgait.estimators.notes import NO_ACCELEROMETER, NO_FIRST_STANDING
from jgait.events.rest import BRIDGED_S, LEGS_RATE, LEGS_SHORTEST_S, legs_at_rest
from jgait.mounting.leg import SegmentMounting, worn_legs
from jgait.mounting.places import at_times
from jgait.notes import LEFT_OUT, Note
from jgait.quality import SensorQuality, merged
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Imu, Recording, RecordingError, as_float

LOWEST_RATE_HZ = 40.0
"""[Hz] Lowest sampling rate. Simulated knee angles err by 1.0° (rms) at 100 Hz, 1.2° at 41 Hz, 2.8° at 25 Hz."""

LONG_GAP = 0.3
"""[s] Shortest gap in the samples for which no estimate is made; the leg's angles after the gap are unknown. Chosen by
hand: a swing lasts 0.4 s."""


def resting_legs(
    recording: Recording, options: LegOptions
) -> tuple[tuple[str, ...], dict[str, Imu], np.ndarray, np.ndarray]:
    """The sides on which both thigh and shank are measured, their sensors and common time, resampled and filtered, with
    rates of 0 where samples are lost; and where no leg moves (T,). Raises RecordingError if neither side has both.
    """
    sides = tuple(s for s in SIDES if f"thigh_{s}" in recording.sensors and f"shank_{s}" in recording.sensors)
    if not sides:
        missing = [p for p in ("thigh_right", "shank_right") if p not in recording.sensors]
        if any(p.endswith("_left") for p in recording.sensors) and len(missing) == 2:
            missing = [p for p in ("thigh_left", "shank_left") if p not in recording.sensors]
        wanted = " and ".join(f"'{p}'" for p in missing)
        feet = any(p.startswith("foot_") for p in recording.sensors)
        other = "; for sensors on the feet take the estimator foot_ins" if feet else ""
        raise RecordingError(f"leg_ekf needs {wanted}; {sensors_of(recording)}{other}")
    sensors = {f"{part}_{side}": recording.sensors[f"{part}_{side}"] for side in sides for part in ("thigh", "shank")}
    time = common_time(recording, list(sensors), "leg_ekf", "thigh and shank", acc=False)
    rate = 1.0 / float(np.median(np.diff(time)))
    if rate < 0.99 * LOWEST_RATE_HZ:  # a clock is a little off its nominal rate
        raise RecordingError(
            f"leg_ekf needs {LOWEST_RATE_HZ:g} Hz or more; the recording has {rate:.3g} Hz: between such samples a "
            "shank turns by up to 20°, and errors of knee angles are three times as large as at 100 Hz"
        )
    sensors = {k: i._replace(gyr=np.where(np.asarray(i.mask)[:, None], i.gyr, 0.0)) for k, i in sensors.items()}
    time, sensors = resampled(time, sensors, options.rate_hz)
    if options.median > 1:
        from scipy import ndimage  # takes a quarter of a second to import

        size = (options.median, 1)
        sensors = {k: i._replace(gyr=ndimage.median_filter(i.gyr, size, mode="mirror")) for k, i in sensors.items()}
    gyrs, masks = zip(*((imu.gyr, imu.mask) for imu in sensors.values()), strict=True)
    return sides, sensors, time, legs_at_rest(gyrs, 1.0 / float(np.median(np.diff(time))), masks)


def resampled(time: np.ndarray, sensors: dict[str, Imu], rate_hz: float | None) -> tuple[np.ndarray, dict[str, Imu]]:
    """The sensors at a rate; unchanged for None. Raises RecordingError if the recording's rate is lower."""
    rate = 1.0 / float(np.median(np.diff(time)))
    if rate_hz is None or abs(rate / rate_hz - 1.0) < 0.01:
        return time, sensors
    if rate < rate_hz:
        raise RecordingError(f"rate_hz={rate_hz:g} is above the recording's rate of {rate:.1f} Hz")
    grid = np.arange(time[0], time[-1] + 1e-6, 1.0 / rate_hz)
    return grid, {name: at_times(imu, grid) for name, imu in sensors.items()}


def _started(segment: Segment, still: np.ndarray, stride: int, step: float) -> Segment:
    """The segment with its inclination at the first sample: that of the rest with which the recording begins, or of the
    first stride [samples], over which gravity is the mean of the specific force turned along.
    """
    count = (int(np.argmin(still)) or len(still)) if still[0] else stride
    rate = segment.bias[1] - segment.gyr[:count, 1]
    angle = np.zeros(count) if still[0] else np.cumsum(rate) * step
    force = np.mean((segment.acc[:count, 2] + 1j * segment.acc[:count, 0]) * np.exp(-1j * (angle - angle[0])))
    return segment._replace(start=np.asarray(np.angle(force)))


def with_feet(recording: Recording, sensors: Mapping[str, Imu], time: np.ndarray) -> dict[str, Imu]:
    """The sensors on thighs and shanks, and those on feet that have the same times."""
    feet = {k: i for k, i in recording.sensors.items() if k.startswith("foot_")}
    return {**sensors, **{k: i for k, i in feet.items() if np.array_equal(as_float(i.time), time)}}


def in_segment(imu: Imu, worn: SegmentMounting) -> Segment:
    """A sensor's signals in the axes of its segment."""
    gyr, time, measured = as_float(imu.gyr) @ worn.axes.T, np.asarray(imu.time), np.asarray(imu.mask, bool)
    acc = np.zeros_like(gyr) if imu.acc is None else as_float(imu.acc) @ worn.axes.T * worn.scale
    last = np.maximum.accumulate(np.where(measured, np.arange(time.size), -1))
    since = time - np.where(last >= 0, time[np.maximum(last, 0)], time[0])
    lost = np.where(measured, 0.0, np.maximum(since, np.median(np.diff(time))))
    return Segment(gyr, acc, measured, worn.bias, worn.variance, lost, worn.unrest)


def rates_between(segment: Segment, time: np.ndarray) -> Segment:
    """A segment whose rates are interpolated over losses of up to `BRIDGED_S`; over longer ones they are 0."""
    gyr = np.where(segment.measured[:, None], segment.gyr, 0.0)
    for first, after in true_runs(~segment.measured):
        if first > 0 and after < time.size and segment.lost[after - 1] <= BRIDGED_S + 1e-9:
            share = (time[first:after] - time[first - 1]) / (time[after] - time[first - 1])
            gyr[first:after] = gyr[first - 1] + share[:, None] * (gyr[after] - gyr[first - 1])
    return segment._replace(gyr=gyr)


def long_gaps(leg: LegSignals, time: np.ndarray) -> list[tuple[int, int]]:
    """Half-open ranges of samples in which nothing is stated of a leg, because one of its sensors lacks samples."""
    step = float(np.median(np.diff(time)))
    lost = ~(leg.thigh.measured & leg.shank.measured)
    return [(start, stop) for start, stop in true_runs(lost) if (stop - start) * step >= LONG_GAP]


def slips(
    sensors: Mapping[str, Imu], upright: np.ndarray, standing: slice, time: np.ndarray
) -> tuple[dict[str, SensorQuality], list[Note]]:
    """Sensors that slipped, and notes on those whose tilt in another standing differs from that in the calibrating one.

    If the last standing has such a tilt, and the movement before it too, the sensor slipped, see `_since`.
    """
    step = float(np.median(np.diff(time)))
    runs = [slice(first, after) for first, after in true_runs(upright) if after - first >= LEGS_SHORTEST_S / step]
    quality: dict[str, SensorQuality] = {}
    notes = []
    for name, imu in sensors.items():
        if imu.acc is None or not runs:
            continue
        force = as_float(imu.acc)
        down = force[standing].mean(axis=0)
        others = np.stack([force[run].mean(axis=0) for run in runs])
        cosines = others @ down / np.maximum(np.linalg.norm(others, axis=1) * np.linalg.norm(down), 1e-9)
        degrees = np.rad2deg(np.arccos(np.clip(cosines, -1.0, 1.0)))
        worst, otherwise = int(np.argmax(degrees)), degrees > 10.0  # above the change of legs of public sets
        if not otherwise.any():
            continue
        since = None
        if otherwise[-1] and runs[-1].start >= standing.stop:
            moving = np.flatnonzero(np.asarray(imu.mask, bool) & ~upright)
            moving = moving[(moving >= standing.stop) & (moving < runs[-1].start)]
            # [s] accelerations of walking vanish over it
            since = _since(force, moving, round(1.0 / step), down, others[-1])
        if since is None:
            notes.append(
                STANDS_OTHERWISE(placement=name, degrees=degrees[worst], at_s=time[runs[worst].start] - time[0])
            )
        else:
            quality[name] = SensorQuality(slips_at=float(time[since] - time[0]))
            notes.append(SLIPPED(placement=name, degrees=degrees[-1], from_s=quality[name].slips_at))
    return quality, notes


def _since(force: np.ndarray, moving: np.ndarray, width: int, before: np.ndarray, after: np.ndarray) -> int | None:
    """The sample from which on a sensor is tilted as in the standing `after` (3,), and not as in that `before`.

    It splits windows of the samples in which the person moves so that their tilts vary least around the mean of either
    part. None if the parts differ by less than half of the change in standing, and if none is after.
    """
    count = len(moving) // width
    if count < 2:
        return None
    change = after - before
    kept = moving[: count * width].reshape(count, width)
    tilts = (force[kept].mean(axis=1) - before) @ change / (change @ change)
    values = np.concatenate([[0.0], tilts])  # the standing before, from which a sensor may slip before the walk
    parts = [(values[:number], values[number:]) for number in range(1, len(values))]
    best = min(range(len(parts)), key=lambda number: sum(len(part) * float(np.var(part)) for part in parts[number]))
    first, last = parts[best]
    return None if last.mean() - first.mean() < 0.5 else int(kept[max(best - 1, 0), 0])


SHANKS = AnkleOptions(site="shank")
"""Options of the strapdown of the shanks' sensors."""


def _shanks(
    recording: Recording, sides: tuple[str, ...]
) -> tuple[AnkleInputs | None, dict[str, SensorQuality], list[Note]]:
    """The inputs of the strapdown, and facts and notes about steps that it lacks, running, and signals that clip or are
    off; None without accelerometers, or if the sampling rate does not suit.
    """
    placements = [f"{segment}_{side}" for segment in ("thigh", "shank") for side in sides]
    try:
        made = prepare_shanks(
            recording._replace(sensors={name: recording.sensors[name] for name in placements}), SHANKS
        )
    except RecordingError:
        return None, {}, []
    notes = [note for name, facts in made.quality.items() for note in shank_notes(name, facts)]
    return made.inputs, made.quality, notes


def prepare(recording: Recording, options: LegOptions = DEFAULT) -> Prepared[LegInputs]:
    """Check a recording with at least one leg; turn it into the inputs of `leg_ekf.run`.

    `standing` is the calibrating stance; None if nobody stands, and angles count from the mean of walking. Without
    accelerometers the options have no `gravity`. By "strapdown" the inputs have `shanks`, unless the recording is
    resampled; with `smooth` rates are interpolated over short losses.

    Raises:
        RecordingError: missing placement, clocks that differ, no walking; no standing, without accelerometers.
    """
    sides, sensors, time, still = resting_legs(recording, options)
    rate = 1.0 / float(np.median(np.diff(time)))
    every = with_feet(recording, sensors, time)
    worn = worn_legs(every, still, rate, estimator="leg_ekf")
    bare = any(imu.acc is None for imu in sensors.values())
    if worn.standing is None and (bare or not options.gravity):
        raise RecordingError(
            f"leg_ekf needs {LEGS_SHORTEST_S:g} s of quiet standing (all leg gyroscopes below {LEGS_RATE:g} rad/s) to "
            "know the upright pose without accelerometers"
        )
    stride = round(worn.cycle.stride_time * rate)
    begins_walking = not bare and bool(worn.cycle.walks[:stride].all())
    legs, notes, slipping = {}, list(worn.notes), dict[str, SensorQuality]()
    for side in sides:
        mountings = worn.legs[side].segments.values()
        segments = [in_segment(every[mounting.placement], mounting) for mounting in mountings]
        if still[0] or begins_walking:
            segments = [_started(segment, still, stride, 1.0 / rate) for segment in segments]
        else:
            segments = [segment._replace(start=np.zeros(())) for segment in segments]
        thigh, shank = (rates_between(signals, time) if options.smooth else signals for signals in segments)
        legs[side] = LegSignals(thigh, shank, worn.legs[side].pose)
    if worn.standing is None:
        notes.append(ZERO_OF_WALKING())
    else:
        slipping, more = slips(sensors, worn.upright, slice(*worn.standing), time)
        notes += more
    if bare:
        notes.append(NO_ACCELEROMETER())
    if not still[0]:
        notes.append(NO_FIRST_STANDING())
    alone = {
        f"{segment}_{side}": other for side in SIDES for segment, other in (("thigh", "shank"), ("shank", "thigh"))
        if side not in sides and f"{segment}_{side}" in recording.sensors
    }  # fmt: skip
    notes += [
        LEFT_OUT.note(f"{placement} is left out, because it is worn without the {other} of that leg")
        for placement, other in alone.items()
    ]
    strapdown = options.distance == "strapdown" and options.rate_hz is None
    shanks, quality, more = _shanks(recording, sides) if strapdown else (None, {}, [])
    notes += more
    if len(sides) == 1 and shanks is None:
        notes.append(ONE_LEG(side=sides[0]))
    gaps = {side: long_gaps(leg, time) for side, leg in legs.items()}
    valid = np.ones(time.size, bool)
    for start, stop in sorted(set(itertools.chain(*gaps.values()))):
        valid[start:stop] = False
        lacks = " and ".join(side for side in SIDES if (start, stop) in gaps.get(side, []))
        notes.append(NOT_ESTIMATED(side=lacks, seconds=(stop - start) / rate, begin_s=time[start] - time[0]))
    dt = np.concatenate([[0.0], np.diff(time)])
    variance = np.asarray(1e-4 if still[0] else 0.01 if begins_walking else 0.1)
    inputs = LegInputs(legs.get("right"), legs.get("left"), time, dt, still, valid, variance, shanks)
    gravity = options.gravity and not bare
    quality = merged(quality, slipping, dict.fromkeys(alone, SensorQuality(alone=True)))
    return Prepared(inputs, options._replace(gravity=gravity), tuple(notes), worn.standing, quality=quality)
