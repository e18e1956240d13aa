"""Gyroscopes that are switched off part of the time: the times when each was on, and the recording with filled gaps.

A sample of a gyroscope is usable where three masks are True: the sensor's mask, a mask of the gyroscope alone (the
accelerometer is always on), and the mask of a schedule, which hides samples of a gyroscope that was always on.
"""

import math
from collections.abc import Collection, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import keystr, tree_map_with_path
from jaxtyping import Bool, Float, Int

from jgait.duty_cycle import power
from jgait.duty_cycle.fillers import FILLERS
from jgait.duty_cycle.filling import FILLED, HELD, MEASURED, Filler, On, Thigh
from jgait.duty_cycle.power import GYROSCOPE, Masks, Schedule, Sensor
from jgait.notes import Kind
from jgait.types import SIDES, Imu, Recording, RecordingError, as_float

SEGMENTS = ("thigh", "shank")
"""Segments whose gaps are filled: the fillers are made for a sagittal rate."""

SLEEP_FILLED = Kind(
    "sleep_filled",
    "check",
    "{placement}: of the gyroscope's samples {filled:.0%} are filled ({filler}), {held:.0%} masked, since too little "
    "or nothing alike was measured before them",
    "Filled samples were computed by the filler and not measured. `duty_cycled_gyro` counts their errors; the "
    "deviations of other estimators do not, so that their angles can be off by far more than they state.",
)


def schedule_of(given: Schedule | float | None, sensor: Sensor = GYROSCOPE) -> Schedule | None:
    """A schedule, or the schedule of a duty cycle [1] in the paper's units; None: the gyroscope is always on. Raises
    ValueError if the duty cycle is outside (0, 1], or the sensor cannot follow the schedule.
    """
    if given is None:
        return None
    if isinstance(given, Schedule):
        power.check_schedule(given, sensor)
        return given
    return power.schedule_of_duty(given, sensor=sensor)


def gyroscope_masks(
    recording: Recording, names: Collection[str], *, schedule: Schedule | float | None = None,
    gyro_on: Mapping[str, On] | None = None, warm_up: float = 0.0, sensor: Sensor = GYROSCOPE,
) -> dict[str, Masks]:  # fmt: skip
    """Placement → masks (T,) of its gyroscope: when it was powered, and when its samples were usable.

    Args as of `fill_recording`; a gyroscope that is off in a mask was switched off, and woken before the next sample.

    Raises:
        ValueError: if the gyroscope cannot follow the schedule, a mask has the wrong shape or names no sensor, or
            the warm-up is negative.
    """
    plan = schedule_of(schedule, sensor)
    if not (math.isfinite(warm_up) and warm_up >= 0.0):
        raise ValueError(f"warm_up must be a number of seconds, not negative; got {warm_up!r}")
    given = {} if gyro_on is None else dict(gyro_on)
    unknown = [name for name in given if name not in recording.sensors]
    if unknown:
        raise ValueError(f"gyro_on has a mask of {unknown[0]!r}; the recording has {sorted(recording.sensors)}")
    masks = {}
    for name in names:
        imu, rate_hz = recording.sensors[name], recording.sampling_rate_hz
        count = np.shape(imu.time)[0]
        usable = np.asarray(given.get(name, np.ones(count, bool)))
        if usable.shape != (count,) or usable.dtype != bool:
            raise ValueError(f"gyro_on of {name!r} must be ({count},) bool; got {usable.shape} {usable.dtype}")
        powered = usable if usable.all() else np.asarray(power.powered_for(usable, rate_hz, sensor))
        if plan is not None and name.startswith("shank"):
            warm = min(count, round(warm_up * rate_hz))
            begun = round(plan.on * plan.unit * rate_hz) if warm else 0
            later = power.masks(plan, begun + count - warm, rate_hz, sensor)
            followed = (np.concatenate([np.ones(warm, bool), mask[begun:]]) for mask in later)
            powered, usable = powered & next(followed), usable & next(followed)
        # A lost sample also costs energy.
        masks[name] = Masks(powered, usable & np.asarray(imu.mask, bool))
    return masks


def check_filler(name: str | Filler) -> Filler:
    """A filler by name, or as it is. Raises ValueError if there is none of the name."""
    if isinstance(name, Filler):
        return name
    if name not in FILLERS:
        raise ValueError(f"filler must be one of {', '.join(FILLERS)}; got {name!r}")
    return FILLERS[name]


def acc_received(imu: Imu, gyro_on: On | None = None) -> Bool[np.ndarray, "time"]:
    """(T,) bool, the accelerometer's sample is not lost, or by `gyro_on` only the gyroscope is off."""
    kept = np.asarray(imu.mask, bool)
    return kept if gyro_on is None else kept | ~np.asarray(gyro_on, bool)


def acc_of(imu: Imu, gyro_on: On | None = None) -> Float[np.ndarray, "time 3"] | None:
    """Specific force [m/s²]; a lost sample (see `acc_received`) has the value of the sample before it."""
    if imu.acc is None:
        return None
    kept = acc_received(imu, gyro_on)
    last = np.maximum.accumulate(np.where(kept, np.arange(kept.size), -1))
    return as_float(imu.acc)[np.where(last < 0, int(np.argmax(kept)), last)]


def _filled(
    gyr: Float[np.ndarray, "time 3"], usable: Bool[np.ndarray, "time"], acc: Float[np.ndarray, "time 3"] | None,
    thigh: Thigh | None, filler: Filler, rate_hz: float,
) -> tuple[Float[np.ndarray, "time 3"], Int[np.ndarray, "time"]]:  # fmt: skip
    """Rates about the same axes without gaps, and the origin of each sample, which the first axis decides."""

    def at_once(path: tuple[Any, ...], value: Any) -> Any:
        return 0.0 if keystr(path).endswith("least_strides") else value

    settings = {"usable": jnp.asarray(usable), "acc": acc, "sampling_rate_hz": rate_hz, "thigh": thigh}
    sagittal = filler.fill(rate=jnp.asarray(gyr[:, 0]), params=filler.params, **settings)
    params = tree_map_with_path(at_once, filler.params)
    across = jax.vmap(lambda rate: filler.fill(rate=rate, params=params, **settings).rate)(jnp.asarray(gyr[:, 1:].T))
    return np.asarray(jnp.concatenate([sagittal.rate[:, None], across.T], axis=1)), np.asarray(sagittal.how)


def fill_recording(
    recording: Recording, *, schedule: Schedule | float | None = None, filler: str | Filler = "neighbours",
    gyro_on: Mapping[str, On] | None = None, warm_up: float = 0.0, sensor: Sensor = GYROSCOPE,
) -> Recording:  # fmt: skip
    """The recording with the gaps of the gyroscopes of thighs and shanks filled, for any other estimator.

    The deviations of that estimator do not contain the errors of filled samples: angles can be off by far more.

    The filler fills the rate about the axis with the largest rate, the sagittal rate. The same filler fills the
    rates about the two perpendicular axes, each from its past and the same accelerometer: these rates also repeat
    with the stride, and zeros would state that the leg stays in its plane. The sagittal rate gives the number of
    measured strides for all three. While it is less than the filler needs, samples are masked as lost,
    accelerometer included: a held rate would rotate the leg by a large angle. A sample that the sensor's mask hides
    has no accelerometer and stays masked, unless `gyro_on` shows that only the gyroscope was off, as in a file
    whose gyroscope columns are partly empty: {name: recording.sensors[name].mask}.

    Args:
        recording: with sensors on thighs or shanks; other sensors stay as they are.
        schedule: hides samples of shanks; a duty cycle [1] is in units of 1.4 s; None: only masked samples are filled.
        filler: a filler, or its name in `jgait.duty_cycle.fillers`; a shank's also uses a thigh's signals.
        gyro_on: placement → (T,) bool, when its gyroscope was on and awake.
        warm_up: time for which gyroscopes are on before the schedule, which then begins with the off-time [s]; 0: the
            schedule begins at the first sample, with the on-time.
        sensor: the gyroscope, for its wake-up time.

    Returns:
        The same recording; its notes state the share of filled samples.

    Raises:
        ValueError: as `gyroscope_masks`, or if there is no such filler.
        RecordingError: if there is no sensor on a thigh or shank, or no accelerometer for a filler that needs it.
    """
    way = check_filler(filler)
    called = way.fill.__name__
    names = [f"{segment}_{side}" for side in SIDES for segment in SEGMENTS]
    names = [name for name in names if name in recording.sensors]
    if not names:
        raise RecordingError(
            f"there is no gyroscope of a thigh or shank to be filled; the recording has {sorted(recording.sensors)}"
        )
    used = gyroscope_masks(recording, names, schedule=schedule, gyro_on=gyro_on, warm_up=warm_up, sensor=sensor)
    sensors, notes, above = dict(recording.sensors), list(recording.notes), dict[str, Thigh]()
    for name in names:
        imu, side = recording.sensors[name], name.split("_")[1]
        slept = (gyro_on or {}).get(name)
        usable, acc = np.asarray(used[name].usable), acc_of(imu, slept)
        gyr = np.where(usable[:, None], as_float(imu.gyr), 0.0)
        axes = np.linalg.eigh(gyr.T @ gyr)[1][:, ::-1]  # the sensor turns most about the first
        gyr, how = gyr @ axes, np.full(len(gyr), MEASURED)
        if not usable.all():
            if way.needs_acc and acc is None:
                raise RecordingError(f"the filler {called!r} needs an accelerometer; {name!r} has only a gyroscope")
            beside = above.get(side) if name.startswith("shank") else None
            gyr, how = _filled(gyr, usable, acc, beside, way, recording.sampling_rate_hz)
            filled, held = np.mean(how == FILLED), np.mean(how == HELD)
            notes.append(SLEEP_FILLED(placement=name, filled=filled, filler=called, held=held))
        if name.startswith("thigh") and acc is not None:
            above[side] = Thigh(jnp.asarray(gyr[:, 0]), jnp.asarray(acc))
        there = np.asarray(imu.mask, bool) | (np.zeros(len(how), bool) if slept is None else ~np.asarray(slept))
        kept = there & (how != HELD)
        sensors[name] = imu._replace(gyr=np.where(kept[:, None], gyr @ axes.T, 0.0), mask=kept)
    return recording._replace(sensors=sensors, notes=tuple(notes))
