"""Units by the size of signals: rates of a moving limb, gravity where an accelerometer is calm, ranges between feet."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jgait.estimators.checks import FASTEST, busy, fast_rate
from jgait.geometry.vectors import GRAVITY
from jgait.io.checks.readings import SIGNALS
from jgait.io.units import ACC_UNITS, GYR_UNITS, Unit, Units
from jgait.notes import Kind
from jgait.quality import SensorQuality
from jgait.types import SIDES, AnyArray, Imu, RecordingError, as_float

IN_RADIANS = 12.0
"""[rad/s] 99th percentile of the rate of a walking limb; in deg/s it has more. Chosen by hand."""

SLOWEST_WALK = 0.3
"""[rad/s] Smallest 99th percentile of a moving person's rates; the trunk of a slow walker turns faster."""

RANGE_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Unit of a range between the feet → m."""

FEET_APART = (0.02, 1.5)
"""[m] Median distance of one leg from the other where a range between them is measured; chosen by hand."""


class Sizes(NamedTuple):
    """By what a signal's size decides its unit in a file that states none."""

    signal: str  #: in words.
    what: str  #: the size that decides.
    percentile: float  #: [%] the same as a number.
    limits: Mapping[str, tuple[float, float]]  #: unit → limits of this size in walking.
    hint: str = ""  #: what else to do.


BY_SIZE = {
    "gyr": Sizes("angular rate", "99th percentile", 99.0,
                 {"rad/s": (1.0, IN_RADIANS), "deg/s": (30.0, 2e3), "mrad/s": (2e3, 1.2e4), "mdeg/s": (3.5e4, np.inf)}),
    "acc": Sizes("acceleration", "median", 50.0,
                 {unit: (0.6 * GRAVITY / scale, 2.0 * GRAVITY / scale) for unit, scale in ACC_UNITS.items()},
                 "find the raw signal if gravity was removed, or "),
    "feet_range": Sizes("distances", "median", 50.0,
                        {unit: (FEET_APART[0] / scale, FEET_APART[1] / scale) for unit, scale in RANGE_UNITS.items()},
                        "use read_csv and "),
}  # fmt: skip
"""Signal → sizes in walking; none of the gyroscope's and the accelerometer's are in two units."""

RAW_COUNTS = "its numbers are whole, as raw counts of a converter are."

NO_GRAVITY = ": gravity was taken off; record or export the specific force, with gravity"

COUNTS_GIVEN = Kind(
    "counts_given", "check",
    "{placement}: the numbers of its gyroscope are whole, as raw counts of a converter are; they are taken to be in "
    "{unit}, as given",
    "If they are counts, angles and lengths of this sensor have a wrong scale: multiply its columns by the sensor's "
    "sensitivity, and state that unit.",
)  # fmt: skip


class _Fault(NamedTuple):
    """Why the numbers of a sensor cannot be right."""

    part: str  #: of the sensor.
    words: str
    meant: str = ""  #: the unit that may be meant.
    unclear: str = ""  #: what to do if none is meant.


def usable_sensors(
    sensors: Mapping[str, Imu], units: Units, name: str
) -> tuple[dict[str, Imu], dict[str, SensorQuality]]:
    """The sensors without those whose numbers cannot be right, and why each of these is left out. Raises RecordingError
    if no sensor has signals, or the sizes of most contradict their unit.
    """
    dead = dict[str, str]()
    for placement, imu in sensors.items():
        there = as_float(imu.gyr)[np.asarray(imu.mask)]
        if not len(there):
            dead[placement] = f"it has no usable sample; all {len(imu.gyr)} are missing"
        elif not np.ptp(there, axis=0).any():
            reading = ", ".join(f"{value:.4g}" for value in there[0])
            dead[placement] = f"its gyroscope is constant at ({reading}) rad/s; it recorded nothing"
    if len(dead) == len(sensors):
        first = next(iter(dead))
        raise RecordingError(f"{name}: {first} {dead[first].removeprefix('it ')}")
    left = {placement: imu for placement, imu in sensors.items() if placement not in dead}
    faults = {
        placement: fault for placement, imu in left.items() if (fault := _fault(placement, imu, units[placement]))
    }
    right = [placement for placement in left if placement not in faults]
    turning = [placement for placement in right if SLOWEST_WALK < fast_rate(left[placement]) < IN_RADIANS]
    advice = dict[str, str]()
    for part, others in (("gyroscope", turning), ("accelerometer", right)):
        wrong = [placement for placement, fault in faults.items() if fault.part == part]
        advice |= {placement: _advice(faults[placement], units[placement][part[:3]], others) for placement in wrong}
        if len(wrong) > len(others):
            worst = max(wrong, key=lambda placement: fast_rate(left[placement]))
            raise RecordingError(
                f"{name}: the {part} of {worst} {faults[worst].words}{advice[worst]}",
                argument="" if others or not faults[worst].meant else f"{part[:3]}_unit", value=faults[worst].meant,
            )  # fmt: skip
    left = {placement: imu for placement, imu in left.items() if placement not in faults}
    _check_moving(left, units, name)
    dead |= {placement: f"its {fault.part} {fault.words}{advice[placement]}" for placement, fault in faults.items()}
    return left, {placement: SensorQuality(left_out=words) for placement, words in dead.items()}


def _fault(placement: str, imu: Imu, units: Mapping[str, Unit]) -> _Fault | None:
    """The fault of a sensor that turns impossibly fast, or does not measure gravity where it is calm."""
    rate, unit = fast_rate(imu), units["gyr"]
    if rate > FASTEST:
        counts = are_counts(np.round(as_float(imu.gyr) / GYR_UNITS[unit.name], 6))
        # too fast in deg/s, it is in mrad/s or was converted twice, and these are close
        cause = RAW_COUNTS if counts else "is it in mrad/s, or was it converted twice?"
        unclear = f"; {cause} State the unit, or correct its columns in the file"
        return _Fault(
            "gyroscope", f"reaches {rate:.4g} rad/s (99th percentile, {unit}), but nothing worn while walking exceeds "
            f"{FASTEST:g} rad/s", "" if unit.name == "deg/s" or counts else _rate_meant(rate, unit),
            unclear if np.deg2rad(rate) < IN_RADIANS or counts else "",
        )  # fmt: skip
    if imu.acc is None:
        return None
    (low, high), unit = (0.8 * GRAVITY, 1.2 * GRAVITY), units["acc"]
    acc = as_float(imu.acc)[np.asarray(imu.mask)]
    force = float(np.median(np.linalg.norm(acc, axis=1)))
    # a trunk that never rests is calm in mid stance, where it feels less than gravity; its median is near it
    if placement.endswith(SIDES) or not low <= force <= high:
        force = calm_force(acc, 1.0 / float(np.median(np.diff(imu.time))))
    if low <= force <= high:
        return None
    steady = measures_gravity(as_float(imu.acc))
    return _Fault(
        "accelerometer", f"reads {force:.4g} m/s² where it is calm ({unit}), but gravity alone is {GRAVITY:.4g} m/s²",
        next((name for name, scale in ACC_UNITS.items() if low <= force / ACC_UNITS[unit.name] * scale <= high), "")
        if steady else "",
        ": check the unit" if steady else NO_GRAVITY,
    )  # fmt: skip


def _rate_meant(rate: float, unit: Unit) -> str:
    """The unit in which an impossible rate [rad/s] is one of walking, the most usual of them; "" for none."""
    rates = {name: scale * rate / GYR_UNITS[unit.name] for name, scale in GYR_UNITS.items()}
    # legs have 6 rad/s, between shank and foot
    apart = {name: abs(np.log(each / 6.0)) for name, each in rates.items() if SLOWEST_WALK < each < FASTEST}
    return min(apart, key=lambda name: apart[name], default="")


def _check_moving(sensors: Mapping[str, Imu], units: Units, name: str) -> None:
    """Refuse gyroscopes whose stated unit makes them too slow for a person whom accelerometers, if any, show moving."""
    rates = {placement: fast_rate(imu) for placement, imu in sensors.items()}
    fastest = max(rates, key=lambda placement: rates[placement])
    unit, rate = units[fastest]["gyr"], rates[fastest]
    if unit.name == "rad/s" or unit.origin not in ("argument", "header", "names") or rate >= SLOWEST_WALK:
        return
    spread = [np.linalg.norm(imu.acc[busy(imu)], axis=1).std() for imu in sensors.values() if imu.acc is not None]
    if spread and max(spread) <= 0.5:  # [m/s²], of a standing person 0.05
        return
    by, meant = f", {unit}" if unit.origin == "header" else "", _rate_meant(rate, unit) or "rad/s"
    raise RecordingError(
        f"{name}: no gyroscope exceeds {rate:.4g} rad/s ({np.rad2deg(rate):.4g} deg/s, 99th percentile, {fastest}{by}"
        f"), too slow for walking: the gyroscopes seem to be in {meant}; {_correct(unit)}pass {{argument}}, or nobody "
        "walks",
        argument="gyr_unit",
        value=meant,
    )


def calm_force(acc: np.ndarray, rate_hz: float) -> float:
    """Median size [m/s²] of the specific force (T, 3) in the calmest windows: gravity's, even at a runner's foot."""
    size, samples = np.linalg.norm(acc, axis=1), max(round(0.2 * rate_hz), 2)
    windows = len(size) // samples
    if windows < 5:
        return float(np.median(size))
    cut = size[: windows * samples].reshape(windows, samples)
    calm = np.argsort(cut.std(axis=1))[: max(round(0.2 * windows), 1)]
    return float(np.median(cut[calm].mean(axis=1)))


def are_counts(values: np.ndarray) -> bool:
    """Whether a signal (T, 3) holds whole numbers alone, as raw counts of a converter are."""
    numbers = np.unique(values[np.isfinite(values)])
    return len(numbers) >= 8 and bool((numbers % 1 == 0).all()) and float(np.abs(numbers).max()) >= 10.0


def counts_without_unit(where: str, kind: str, name: str) -> RecordingError:
    """The error about whole numbers without a unit."""
    return RecordingError(
        f"{name}: the {SIGNALS[kind].words} of {where} has whole numbers and no unit, as raw counts have: multiply its "
        "columns by the sensor's sensitivity, or state their unit by {argument}",
        argument=f"{kind}_unit",
    )


def measures_gravity(acc: np.ndarray) -> bool:
    """Whether an acceleration (T, 3) in any unit has gravity in it: its mean over some strides does not vanish."""
    present = acc[np.isfinite(acc).all(axis=1)]
    pieces = np.array_split(present, max(min(len(present) // 256, 16), 1))
    steady = sum(len(piece) * float(np.linalg.norm(piece.mean(axis=0))) for piece in pieces if len(piece))
    return steady > 0.5 * float(np.linalg.norm(present, axis=1).sum())


def _correct(unit: Unit) -> str:
    return "correct the header, or " if unit.origin == "header" else ""


def _advice(fault: _Fault, unit: Unit, others: Sequence[str]) -> str:
    """What to do about a sensor that seems to be in another unit than the stated one, or in none that is known."""
    if not fault.meant:
        return fault.unclear
    seems = f": it seems to be in {fault.meant.replace('^2', '²')}"
    if not others:
        return f"{seems}; {_correct(unit)}pass {{argument}}"
    if unit.origin == "header":
        return f"{seems}; correct the header of this sensor"
    rest = f"{others[0]} is" if len(others) == 1 else f"{len(others)} other sensors are"
    return f"{seems}, but {rest} not; convert the columns of this sensor in the file"


def check_range(distance: AnyArray, unit: str, name: str) -> None:
    """Refuse, by a RecordingError, distances between the feet (n,) [m] that are not positive, or not within
    `FEET_APART`.
    """
    if not distance.size:
        return
    if distance.min() <= 0.0:
        raise RecordingError(
            f"{name}: feet_range must be positive; {int(np.sum(distance <= 0.0))} readings are not. "
            "Leave the cell empty where nothing was measured"
        )
    (low, high), middle = FEET_APART, float(np.median(distance))
    if low <= middle <= high:
        return
    raw = middle / RANGE_UNITS[unit]
    meant = min(RANGE_UNITS, key=lambda u: abs(np.log(raw * RANGE_UNITS[u] / np.sqrt(low * high))))
    fits = low <= raw * RANGE_UNITS[meant] <= high
    hint = f"it seems to be in {meant}; pass {{argument}}" if fits else "check the unit"
    raise RecordingError(
        f"{name}: feet_range is {middle:.4g} m in the median (given as {unit}), but feet that pass each other are "
        f"{low:g} to {high:g} m apart: {hint}",
        argument="range_unit" if fits else "",
        value=meant,
    )
