"""Inputs of `duty_cycled_gyro` from a recording whose gyroscopes are off at times. NumPy, on the host.

Standing, axes, signs and biases are computed only from samples at which the gyroscopes were on; samples that a
schedule hides are not used.
"""

from collections.abc import Mapping

import numpy as np

from jgait.duty_cycle.filling import RATES
from jgait.duty_cycle.power import Masks
from jgait.duty_cycle.recording import SEGMENTS, acc_of, acc_received, check_filler, gyroscope_masks
from jgait.estimators.checks import check_nominal_rate, common_time, sensors_of
from jgait.estimators.duty_cycled_gyro.params import DEFAULT, DutyCycledInputs, DutyCycledOptions, GapLeg, GapSegment
from jgait.estimators.interface import Prepared
from jgait.estimators.leg_ekf.prepare import LOWEST_RATE_HZ, in_segment
from jgait.estimators.notes import NO_ACCELEROMETER, NO_FIRST_STANDING
from jgait.events.rest import LEGS_RATE, LEGS_SHORTEST_S, legs_at_rest
from jgait.mounting.leg import SegmentMounting, WornLegs, measured, worn_legs
from jgait.notes import UNSURE_FORWARD, Kind
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Imu, Recording, RecordingError, Values, as_float

NAME = "duty_cycled_gyro"

NEEDS_STANDING = (
    f"{NAME} needs {LEGS_SHORTEST_S:g} s of quiet standing (all leg gyroscopes below {LEGS_RATE:g} rad/s) to find the "
    "gyroscope bias and the upright pose"
)

LOST = 0.1
"""[s] Shorter gaps of a gyroscope do not interrupt standing, and do not make the estimate invalid."""


WORN_ALONE = Kind(
    "worn_alone", "check", "{placement} is worn alone: which way is forward is computed from its swing", UNSURE_FORWARD
)

RATE_HELD = Kind(
    "rate_held",
    "check",
    "{placement}: {samples} {samples:sample|samples}, the first at {begin_s:.2f} s and the last at {end_s:.2f} s, "
    "{samples:has|have} no rate and no angles: too few strides, or none alike, were measured before for the filler",
    "Angles are missing there. A longer warm-up measures more strides before the gyroscope sleeps; turns, starts and "
    "stops are unlike strides.",
)


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


def find_rests(
    sensors: Mapping[str, Imu], used: Mapping[str, Masks], time: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(T,) bool, where no leg moves with every gyroscope on, and with at least one on; while all are off, as before.
    Raises RecordingError if no leg rests with all gyroscopes on.
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

    strict, loose = (
        legs_at_rest([instead(name, unknown) for name in sensors], rate_hz)
        # a missing rate of 10 rad/s counts as movement
        for unknown in (np.full(time.size, 10.0), np.where(some, 0.0, 10.0))
    )
    if not any(stop - start >= LEGS_SHORTEST_S * rate_hz for start, stop in true_runs(strict)):
        together = np.all([m.usable for m in used.values()], axis=0)
        more = f"; its gyroscopes are on together for {together.sum() / rate_hz:.1f} s"
        raise RecordingError(f"{NEEDS_STANDING}{'' if together.all() else more}")
    return strict, strict | loose


def worn_legs_of(
    recording: Recording, used: Mapping[str, Masks], rests: np.ndarray, still: np.ndarray,
    gyro_on: Mapping[str, Values],
) -> tuple[dict[str, Imu], WornLegs]:  # fmt: skip
    """The sensors, without readings of a gyroscope while it was off, and how they are worn. Raises RecordingError if
    the person never stands, or does not walk.
    """
    longest = slice(*max(true_runs(rests), key=lambda run: run[1] - run[0]))
    sensors = {}
    for name, masks in used.items():
        imu = recording.sensors[name]._replace(
            mask=masks.usable, acc=acc_of(recording.sensors[name], gyro_on.get(name))
        )
        # While the gyroscope is off its rate is that at rest, so that sums of the rate do not change.
        gyr = as_float(imu.gyr)
        sensors[name] = imu._replace(gyr=np.where(masks.usable[:, None], gyr, gyr[measured(imu, longest)].mean(axis=0)))
    asleep = ~np.any([masks.usable for masks in used.values()], axis=0)
    worn = worn_legs(sensors, rests | asleep & still, recording.sampling_rate_hz, estimator=NAME)
    if worn.standing is None:
        raise RecordingError(f"{NEEDS_STANDING}: {'; '.join(str(note) for note in worn.notes)}")
    return sensors, worn


def prepare(
    recording: Recording, options: DutyCycledOptions = DEFAULT, gyro_on: Mapping[str, Values] | None = None
) -> Prepared[DutyCycledInputs]:
    """Check a recording and turn it into the inputs of `duty_cycled_gyro.run`; arguments as of `estimate`.

    `extra` maps each placement to the masks (T,) of its gyroscope.

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
    rests, still = find_rests(sensors, used, time)
    legs, slept = dict[str, GapLeg](), gyro_on or {}
    awake, worn = worn_legs_of(recording, used, rests, still, slept)

    def signals(worn: SegmentMounting | None) -> GapSegment | None:
        if worn is None:
            return None
        segment = in_segment(awake[worn.placement], worn)
        gyr = np.where(segment.measured, -segment.gyr[:, 1], 0.0)
        turn = np.where(segment.measured, segment.gyr[:, 2] - segment.bias[2], 0.0)
        there = acc_received(recording.sensors[worn.placement], slept.get(worn.placement))
        return GapSegment(gyr, turn, segment.acc, segment.measured, there, -segment.bias[1], segment.variance)

    notes = list(worn.notes)
    for side, leg in worn.legs.items():
        mountings = leg.segments
        legs[side] = GapLeg(*map(signals, map(mountings.get, SEGMENTS)))
        if list(mountings) == ["thigh"]:
            notes.append(WORN_ALONE(placement=mountings["thigh"].placement))
    if bare:
        notes.append(NO_ACCELEROMETER())
    if not still[0]:
        notes.append(NO_FIRST_STANDING())
    dt = np.concatenate([[0.0], np.diff(time)])
    inputs = DutyCycledInputs(
        legs.get("right"), legs.get("left"), time, dt, still, np.ones(time.size, bool),
        np.asarray(1e-4 if worn.upright[0] else 2.0 if still[0] else 0.1),  # [rad²] who is still and not upright sits
    )  # fmt: skip
    # Options that only masks and energies depend on are left out, so that they do not cause a new compilation.
    resolved = DutyCycledOptions(
        filler=options.filler, above=options.above, sampling_rate_hz=float(recording.sampling_rate_hz), gaps=gaps,
        accelerometers=not bare,
    )  # fmt: skip
    return Prepared(inputs, resolved, tuple(notes), worn.standing, used)
