"""Gyroscopes of a recording that sleep part of the time: when each was on, and the recording with its gaps filled.

A gyroscope's sample is good where the sensor's own mask says so, a mask of the gyroscope alone does (its accelerometer
never sleeps), and a schedule does, under which samples of a recording that was always on are hidden as if asleep.
"""

import math
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jgait.duty_cycle import power
from jgait.duty_cycle.fillers.base import FILLED, HELD, MEASURED, Filler, Thigh
from jgait.duty_cycle.fillers.registry import fillers
from jgait.duty_cycle.power import GYROSCOPE, Masks, Schedule, Sensor
from jgait.notes import Kind
from jgait.types import SIDES, Imu, Recording, RecordingError, as_float

SEGMENTS = ("thigh", "shank")
"""What is filled: where the fillers know a sagittal rate."""


SLEEP_FILLED = Kind(
    "sleep_filled",
    "check",
    "{placement}: of the gyroscope's samples {filled:.0%} are filled ({filler}), {held:.0%} masked, since too little "
    "was measured before them",
    "Filled samples were computed by the filler and not measured; results there are less certain.",
)


def schedule_of(given: Schedule | float | None, sensor: Sensor = GYROSCOPE) -> Schedule | None:
    """A schedule, or that of a duty cycle [1] in the paper's units; None is always on.

    Raises:
        ValueError: if the duty cycle is outside (0, 1], or the sensor cannot follow the schedule.
    """
    if given is None:
        return None
    if isinstance(given, Schedule):
        power.check_schedule(given, sensor)
        return given
    return power.schedule_of_duty(given, sensor=sensor)


def gyroscope_masks(
    recording: Recording, names: Collection[str], *, schedule: Schedule | float | None = None,
    gyro_on: Mapping[str, Any] | None = None, asleep: Collection[str] = ("shank",), warm_up: float = 0.0,
    sensor: Sensor = GYROSCOPE,
) -> dict[str, Masks]:  # fmt: skip
    """When the gyroscopes were powered, and when their samples were good.

    Args:
        recording: what was worn.
        names: placements that are asked for.
        schedule: that hides samples as if asleep, wake-up time included; a duty cycle [1]; or None.
        gyro_on: placement → (T,) bool, when its gyroscope was on and awake; None, or not named: always.
        asleep: which segments follow the schedule, of `SEGMENTS`.
        warm_up: how long they are on before, and then off first [s]; 0: the schedule begins at once, on first.
        sensor: the gyroscope.

    Returns:
        Placement → masks (T,). What a mask tells to be off is taken to have been switched off, and woken ahead.

    Raises:
        ValueError: a schedule that cannot be followed, a mask of the wrong shape or of no sensor, no such segment, a
            negative warm-up.
    """
    plan = schedule_of(schedule, sensor)
    if not (math.isfinite(warm_up) and warm_up >= 0.0):
        raise ValueError(f"warm_up must be a number of seconds, not negative; got {warm_up!r}")
    wrong = [segment for segment in asleep if segment not in SEGMENTS]
    if wrong:
        raise ValueError(f"asleep names segments of {SEGMENTS}; got {wrong[0]!r}")
    given = {} if gyro_on is None else dict(gyro_on)
    unknown = [name for name in given if name not in recording.sensors]
    if unknown:
        raise ValueError(f"gyro_on has a mask of {unknown[0]!r}; the recording has {sorted(recording.sensors)}")
    found = {}
    for name in names:
        imu, rate_hz = recording.sensors[name], recording.sampling_rate_hz
        count = np.shape(imu.time)[0]
        own = np.asarray(given.get(name, np.ones(count, bool)))
        if own.shape != (count,) or own.dtype != bool:
            raise ValueError(f"gyro_on of {name!r} must be ({count},) bool; got {own.shape} {own.dtype}")
        powered = np.asarray(power.powered_for(own, rate_hz, sensor)) if not own.all() else own
        usable = own
        if plan is not None and name.split("_")[0] in asleep:
            followed = _followed(plan, count, rate_hz, warm_up, sensor)
            powered, usable = powered & followed.powered, usable & followed.usable
        # A lost sample was paid for.
        found[name] = Masks(powered, usable & np.asarray(imu.mask, bool))
    return found


def _followed(plan: Schedule, count: int, rate_hz: float, warm_up: float, sensor: Sensor) -> Masks:
    """A schedule at so many samples, after a warm-up."""
    warm = min(count, round(warm_up * rate_hz))
    begun = round(plan.on * plan.unit * rate_hz) if warm else 0
    later = power.masks(plan, begun + count - warm, rate_hz, sensor)
    return Masks(*(np.concatenate([np.ones(warm, bool), mask[begun:]]) for mask in later))


def check_filler(name: str) -> Filler:
    """A filler by name.

    Raises:
        ValueError: if there is none.
    """
    every = fillers()
    if name not in every:
        raise ValueError(f"filler must be one of {', '.join(every)}; got {name!r}")
    return every[name]


def acc_of(imu: Imu, gyro_on: Any = None) -> np.ndarray | None:
    """(T, 3) what the accelerometer felt [m/s²]; where a sample was lost, the one before it.

    Args:
        imu: the sensor.
        gyro_on: (T,) bool, when its gyroscope was on: where it was off, the accelerometer was there all the same.
    """
    if imu.acc is None:
        return None
    kept = np.asarray(imu.mask, bool)
    if gyro_on is not None:
        kept = kept | ~np.asarray(gyro_on, bool)
    last = np.maximum.accumulate(np.where(kept, np.arange(kept.size), -1))
    return as_float(imu.acc)[np.where(last < 0, int(np.argmax(kept)), last)]


def trusted_at_once(params: Any) -> Any:
    """A filler's parameters with no strides to be measured first."""
    if not hasattr(params, "_asdict"):
        return params
    fields = params._asdict()
    inner = {k: 0.0 if k == "least_strides" else trusted_at_once(v) for k, v in fields.items()}
    return params._replace(**inner)


class _Turned(NamedTuple):
    """A sensor's signals with the sagittal rate first.

    Attributes:
        gyr: (T, 3) [rad/s], about the axes in `rows`.
        rows: (3, 3) those axes in the sensor's, the one that turns most while the gyroscope is on first.
        acc: (T, 3) [m/s²] in the sensor's axes, or None.
        usable: (T,) bool.
    """

    gyr: np.ndarray
    rows: np.ndarray
    acc: np.ndarray | None
    usable: np.ndarray


def _turned(imu: Imu, usable: np.ndarray, gyro_on: Any) -> _Turned:
    gyr = np.where(usable[:, None], as_float(imu.gyr), 0.0)
    rows = np.linalg.eigh(gyr.T @ gyr)[1][:, ::-1].T
    return _Turned(gyr @ rows.T, rows, acc_of(imu, gyro_on), usable)


def _filled(one: _Turned, thigh: Thigh | None, filler: Filler, params: Any, rate_hz: float) -> tuple[Any, Any]:
    """Rates (T, 3) about the same axes, and how each sample was had (T,)."""
    signals = jnp.asarray(one.gyr)
    settings = {"usable": jnp.asarray(one.usable), "acc": one.acc, "sampling_rate_hz": rate_hz, "thigh": thigh}
    sagittal = filler.fill(rate=signals[:, 0], params=params, **settings)
    across = jax.vmap(lambda rate: filler.fill(rate=rate, params=trusted_at_once(params), **settings).rate)
    others = across(signals[:, 1:].T).T
    return np.asarray(jnp.concatenate([sagittal.rate[:, None], others], axis=1)), np.asarray(sagittal.how)


def fill_recording(
    recording: Recording, *, schedule: Schedule | float | None = None, filler: str = "neighbours", params: Any = None,
    gyro_on: Mapping[str, Any] | None = None, asleep: Collection[str] = ("shank",), warm_up: float = 0.0,
    thigh: bool = True, sensor: Sensor = GYROSCOPE,
) -> Recording:  # fmt: skip
    """The recording with the gaps of its thighs' and shanks' gyroscopes filled, for any other estimator.

    The rate about the axis that turns most is filled as the filler is meant to. The rates about the two axes across it
    are filled by the same filler, each from its own past and the same accelerometer: they repeat with the stride as
    well, though less, and zeros in their place would say that the leg keeps its plane. What the sagittal rate tells of
    strides decides for all three. Where fewer strides than the filler asks for were measured nothing is made up: such
    samples are masked as lost, accelerometer included, for a held rate would turn the leg over. Where the sensor's own
    mask hides a sample its accelerometer is lost too, and it stays masked; unless `gyro_on` says that the gyroscope
    alone slept there, as in a file whose gyroscope's columns are empty at times: {name: recording.sensors[name].mask}.

    Args:
        recording: with thigh or shank sensors; others pass through.
        schedule: that hides samples as if asleep; a duty cycle [1] in units of 1.4 s; None: what is masked only.
        filler: name, see `gap_filling.fillers`.
        params: of the filler; None: its usual ones.
        gyro_on: placement → (T,) bool, when its gyroscope was on and awake.
        asleep: which segments follow the schedule, "shank", "thigh" or both.
        warm_up: how long they are on before the schedule, which is then off first [s].
        thigh: whether a shank's filler is told the signals of the thigh where it is worn.
        sensor: the gyroscope, for its wake-up time.

    Returns:
        The same recording; notes say what was filled.

    Raises:
        ValueError: a schedule or mask as of `gyroscope_masks`, no such filler.
        RecordingError: no thigh or shank, or a filler that needs an accelerometer that is not there.
    """
    way = check_filler(filler)
    names = [f"{segment}_{side}" for side in SIDES for segment in SEGMENTS]
    names = [name for name in names if name in recording.sensors]
    if not names:
        raise RecordingError(
            f"there is no gyroscope of a thigh or shank to be filled; the recording has {sorted(recording.sensors)}"
        )
    used = gyroscope_masks(
        recording, names, schedule=schedule, gyro_on=gyro_on, asleep=asleep, warm_up=warm_up, sensor=sensor
    )  # fmt: skip
    params = way.params if params is None else params
    sensors, notes, above = dict(recording.sensors), list(recording.notes), dict[str, Thigh]()
    for name in names:
        imu, side = recording.sensors[name], name.split("_")[1]
        slept = (gyro_on or {}).get(name)
        one = _turned(imu, used[name].usable, slept)
        gyr, how = one.gyr, np.full(len(one.gyr), MEASURED)
        if not one.usable.all():
            if way.needs_acc and one.acc is None:
                raise RecordingError(
                    f"the filler {filler!r} is told from the accelerometer; {name!r} has only a gyroscope"
                )
            told = above.get(side) if thigh and name.startswith("shank") else None
            gyr, how = _filled(one, told, way, params, recording.sampling_rate_hz)
            filled, held = np.mean(how == FILLED), np.mean(how == HELD)
            notes.append(SLEEP_FILLED(placement=name, filled=filled, filler=filler, held=held))
        if name.startswith("thigh") and one.acc is not None:
            above[side] = Thigh(jnp.asarray(gyr[:, 0]), jnp.asarray(one.acc))
        there = np.asarray(imu.mask, bool) | (np.zeros(len(how), bool) if slept is None else ~np.asarray(slept))
        kept = there & (how != HELD)
        sensors[name] = imu._replace(gyr=np.where(kept[:, None], gyr @ one.rows, 0.0), mask=kept)
    return recording._replace(sensors=sensors, notes=tuple(notes))
