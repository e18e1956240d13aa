"""Inputs of `duty_cycled_gyro` from a recording whose gyroscopes are off at times. NumPy, on the host.

Standing, axes, signs and biases are computed only from samples at which the gyroscopes were on; samples that a
schedule hides are not used.
"""

from collections.abc import Mapping

import numpy as np

from jgait.duty_cycle.fillers.base import RATES
from jgait.duty_cycle.power import Masks
from jgait.duty_cycle.recording import SEGMENTS, acc_of, acc_received, check_filler, gyroscope_masks
from jgait.estimators.checks import check_nominal_rate, common_time, sensors_of
from jgait.estimators.duty_cycled_gyro.notes import ACCELEROMETER_ABSENT, WORN_ALONE
from jgait.estimators.duty_cycled_gyro.params import DEFAULT, DutyCycledInputs, DutyCycledOptions, GapLeg, GapSegment
from jgait.estimators.interface import Prepared
from jgait.estimators.leg_ekf.prepare import LOWEST_RATE_HZ, SEATED, SegmentMounting, in_segment, mounted
from jgait.estimators.notes import NO_FIRST_STANDING
from jgait.events.rest import LegRest, standing_of_legs
from jgait.mounting.leg import measured
from jgait.notes import Note
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Imu, Recording, RecordingError, Values, as_float

NAME = "duty_cycled_gyro"

LOST = 0.1
"""[s] Shorter gaps of a gyroscope do not interrupt standing, and do not make the estimate invalid."""

MOVES = 10.0
"""[rad/s] Replaces a missing rate in the detection of standing, so that the gap counts as movement."""


def worn_names(recording: Recording) -> list[str]:
    """Placements of the thigh and shank sensors. Raises RecordingError if no such sensor exists."""
    names = [f"{segment}_{side}" for side in SIDES for segment in SEGMENTS]
    names = [name for name in names if name in recording.sensors]
    if not names:
        raise RecordingError(
            f"{NAME} needs 'thigh_right' or 'shank_right', or those of the left leg; {sensors_of(recording)}"
        )
    return names


def checked(recording: Recording, names: list[str]) -> np.ndarray:
    """The common time of the sensors; their arrays are checked as well."""
    time = common_time(recording, names, NAME, "the legs' sensors", acc=False)
    check_nominal_rate(time, names[0], recording.sampling_rate_hz)
    if not LOWEST_RATE_HZ <= recording.sampling_rate_hz <= RATES[1]:
        reason = ": between such samples a shank turns by up to 20°, and knee angles err by 3° more than at 100 Hz"
        slow = recording.sampling_rate_hz < LOWEST_RATE_HZ
        raise RecordingError(
            f"{NAME} needs {LOWEST_RATE_HZ:g} to {RATES[1]:g} Hz; the recording has {recording.sampling_rate_hz:g} Hz"
            f"{reason if slow else ''}"
        )
    return time


def find_standing(sensors: Mapping[str, Imu], used: Mapping[str, Masks], time: np.ndarray) -> LegRest:
    """Rests, standing, the calibrating stance, in which every gyroscope is on, and notes.

    A sample counts as rest if at least one gyroscope is on and no gyroscope that is on measures movement.

    Raises:
        RecordingError: if the person never stands still with all gyroscopes on.
    """
    some = np.any([m.usable for m in used.values()], axis=0)
    rate_hz = 1.0 / float(np.median(np.diff(time)))
    most = LOST * rate_hz

    def instead(name: str, unknown: np.ndarray) -> np.ndarray:
        on, gyr = used[name].usable, as_float(sensors[name].gyr)
        for start, stop in true_runs(~on):
            if start > 0 and stop - start < most:
                on, gyr = on.copy(), gyr.copy()
                on[start:stop], gyr[start:stop] = True, gyr[start - 1]
        return np.where(on[:, None], gyr, unknown[:, None])

    accs = [imu.acc for imu in sensors.values()]
    try:
        strict = standing_of_legs([instead(name, np.full(time.size, MOVES)) for name in sensors], accs, rate_hz, NAME)
    except RecordingError as error:
        together = np.all([m.usable for m in used.values()], axis=0)
        more = f"; its gyroscopes are on together for {together.sum() / rate_hz:.1f} s"
        raise RecordingError(f"{error}{'' if together.all() else more}") from error
    loose = standing_of_legs([instead(name, np.where(some, 0.0, MOVES)) for name in sensors], accs, rate_hz, NAME)
    return strict._replace(still=strict.still | loose.still, upright=strict.upright | loose.upright)


def worn_leg(
    recording: Recording, side: str, used: Mapping[str, Masks], still: np.ndarray, standing: slice,
    gyro_on: Mapping[str, Values],
) -> tuple[dict[str, tuple[Imu, SegmentMounting]], list[Note]]:  # fmt: skip
    """Segment → its sensor, without readings of the gyroscope while it was off, and its mounting; and notes."""
    names = {segment: f"{segment}_{side}" for segment in SEGMENTS if f"{segment}_{side}" in used}
    asleep = ~np.all([used[name].usable for name in names.values()], axis=0)

    def awake(name: str) -> Imu:
        on = used[name].usable
        imu = recording.sensors[name]._replace(mask=on, acc=acc_of(recording.sensors[name], gyro_on.get(name)))
        # While the gyroscope is off its rate is that at rest, so that sums of the rate do not change.
        gyr = as_float(imu.gyr)
        return imu._replace(gyr=np.where(on[:, None], gyr, gyr[measured(imu, standing)].mean(axis=0)))

    # A sensor worn alone is used as thigh and as shank: the sign of the shank's axis follows from its swing alone.
    either = next(iter(names.values()))
    both = {f"{segment}_{side}": awake(names.get(segment, either)) for segment in SEGMENTS}
    worn, notes = mounted(both, side, standing, still | asleep, recording.sampling_rate_hz, estimator=NAME)
    if len(names) == 1:
        worn = {segment: worn["shank"]._replace(placement=name) for segment, name in names.items()}
        notes = [WORN_ALONE(placement=either)] if "thigh" in names else []
    return {segment: (both[mounting.placement], mounting) for segment, mounting in worn.items()}, notes


def _signals(imu: Imu, worn: SegmentMounting, there: np.ndarray) -> GapSegment:
    """Signals of a sensor whose accelerometer's samples arrived where `there` (T,)."""
    segment = in_segment(imu, worn)
    gyr = np.where(segment.measured, -segment.gyr[:, 1], 0.0)
    turn = np.where(segment.measured, segment.gyr[:, 2] - segment.bias[2], 0.0)
    return GapSegment(gyr, turn, segment.acc, segment.measured, there, -segment.bias[1], segment.variance)


def prepare(
    recording: Recording, options: DutyCycledOptions = DEFAULT, gyro_on: Mapping[str, Values] | None = None
) -> Prepared[DutyCycledInputs]:
    """Check a recording and turn it into the inputs of `duty_cycled_gyro.run`.

    Args:
        recording: with a thigh or shank sensor, standing still at some time with all gyroscopes on.
        options: which parts of the method are used; its schedule hides samples.
        gyro_on: placement → (T,) bool, True while its gyroscope was on and awake; default: always on.

    Returns:
        Prepared inputs; `extra` maps each placement to the masks (T,) of its gyroscope.

    Raises:
        RecordingError: no such sensor, clocks that differ, no standing, no walking, no accelerometer for the filler.
        ValueError: a schedule that the gyroscope cannot follow, a mask of the wrong shape, an unknown filler.
    """
    names = worn_names(recording)
    needs_acc, time = check_filler(options.filler).needs_acc, checked(recording, names)
    used = gyroscope_masks(
        recording, names, schedule=options.schedule, gyro_on=gyro_on, warm_up=options.warm_up,
        sensor=options.gyroscope,
    )  # fmt: skip
    sensors = {name: recording.sensors[name] for name in names}
    gaps = not all(m.usable.all() for m in used.values())
    bare = [name for name in names if sensors[name].acc is None]
    if gaps and bare and needs_acc:
        raise RecordingError(
            f"the filler {options.filler!r} needs an accelerometer; '{bare[0]}' has only a gyroscope: take "
            f"another filler"
        )
    still, upright, (start, stop), notes = find_standing(sensors, used, time)
    legs, slept = dict[str, GapLeg](), gyro_on or {}
    there = {name: acc_received(recording.sensors[name], slept.get(name)) for name in names}
    for side in SIDES:
        if any(name.endswith(side) for name in names):
            worn, more = worn_leg(recording, side, used, still, slice(start, stop), slept)
            legs[side] = GapLeg(
                *(
                    _signals(*worn[segment], there[worn[segment][1].placement]) if segment in worn else None
                    for segment in SEGMENTS
                )
            )
            notes += more
    if bare:
        notes.append(ACCELEROMETER_ABSENT())
    if not still[0]:
        notes.append(NO_FIRST_STANDING())
    dt = np.concatenate([[0.0], np.diff(time)])
    inputs = DutyCycledInputs(
        legs.get("right"), legs.get("left"), time, dt, still, np.ones(time.size, bool),
        np.asarray(1e-4 if upright[0] else SEATED if still[0] else 0.1),
    )  # fmt: skip
    # Options that only masks and energies depend on are left out, so that they do not cause a new compilation.
    resolved = DutyCycledOptions(
        filler=options.filler, above=options.above, sampling_rate_hz=float(recording.sampling_rate_hz), gaps=gaps,
        accelerometers=not bare,
    )  # fmt: skip
    return Prepared(inputs, resolved, tuple(notes), (start, stop), used)
