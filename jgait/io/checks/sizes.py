"""Units by the size of signals: rates of a moving limb, gravity where an accelerometer is calm, ranges between feet."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jgait.estimators.checks import FASTEST, busy, fast_rate
from jgait.geometry.vectors import GRAVITY
from jgait.io.units import ACC_UNITS, GYR_UNITS, Unit, Units, unit_of_gravity
from jgait.quality import SensorQuality
from jgait.types import SIDES, AnyArray, Imu, RecordingError, as_float

IN_RADIANS = 12.0  # [unit of the file] fast rate below which it is in rad/s; in deg/s a walking limb has more
USUAL_RATE = 6.0  # [rad/s] usual fast rate of a leg, between shank and foot
SLOWEST_WALK = 0.3  # [rad/s] smallest fast rate of a moving person; the trunk of a slow walker turns faster
MOVING_ACC = 0.5  # [m/s²] standard deviation of |acc| above which the person moves; 0.05 when standing
GRAVITY_RANGE = (0.8, 1.2)  # [g] specific force of a worn accelerometer where it is calm
CALM_S, CALM_SHARE = 0.2, 0.2  # [s], [1] length of the windows that are compared, and share of the calmest of them
STEADY = 0.5  # [1] share of the mean force that keeps its direction; of acceleration without gravity it is small
PIECES, PIECE = 16, 256  # [1], [samples] most pieces in which it does, and their least length: some strides
COUNTS, LARGE_COUNT = 8, 10.0  # [1] fewest different numbers of raw counts, and least size of the largest
RANGE_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
FEET_APART = (0.02, 1.5)  # [m] median distance of one leg from the other where a range between them is measured


class Sizes(NamedTuple):
    """By what a signal's size decides its unit in a file that states none."""

    signal: str  #: in words.
    what: str  #: the size that decides.
    percentile: float  #: [%] the same as a number.
    limits: Mapping[str, tuple[float, float]]  #: unit → limits of this size in walking.
    hint: str = ""  #: what else to do.


BY_SIZE = {
    "gyr": Sizes("angular rate", "99th percentile", 99.0,
                 {"rad/s": (1.0, 12.0), "deg/s": (30.0, 2e3), "mrad/s": (2e3, 1.2e4), "mdeg/s": (3.5e4, np.inf)}),
    "acc": Sizes("acceleration", "median", 50.0,
                 {unit: (0.6 * GRAVITY / scale, 2.0 * GRAVITY / scale) for unit, scale in ACC_UNITS.items()},
                 "find the raw signal if gravity was removed, or "),
    "feet_range": Sizes("distances", "median", 50.0,
                        {unit: (FEET_APART[0] / scale, FEET_APART[1] / scale) for unit, scale in RANGE_UNITS.items()},
                        "use read_csv and "),
}  # fmt: skip
"""Signal → sizes in walking; none of the gyroscope's and the accelerometer's are in two units."""

SIGNALS = {"gyr": "gyroscope", "acc": "accelerometer"}

RAW_COUNTS = "its numbers are whole, as raw counts of a converter are."

NO_GRAVITY = ": gravity was taken off; record or export the specific force, with gravity"


def usable_sensors(
    sensors: Mapping[str, Imu], units: Units, name: str
) -> tuple[dict[str, Imu], dict[str, SensorQuality]]:
    """The sensors without those whose numbers cannot be right, and why each of these is left out.

    Raises:
        RecordingError: if no sensor has signals, or the sizes of most contradict their unit: a limb turns
            impossibly fast, a moving person impossibly slowly, or the accelerometer does not measure gravity.
    """
    left, faulty = dict(sensors), dict[str, SensorQuality]()
    for check in (_dead, _too_fast, _without_gravity):
        part, faults, right = check(left, units)
        if len(faults) > len(right):
            worst = next(iter(faults))
            words, meant = faults[worst]
            whose = f"the {part} of {worst}" if part else worst
            raise RecordingError(f"{name}: {whose} {words}", argument=f"{part[:3]}_unit" if meant else "", value=meant)
        for placement, (words, _) in faults.items():
            del left[placement]
            faulty[placement] = SensorQuality(left_out=f"{f'its {part}' if part else 'it'} {words}")
    _check_moving(left, units, name)
    return left, faulty


type _Found = tuple[str, dict[str, tuple[str, str]], list[str]]
"""Part that is judged; placement → why its numbers cannot be right and the unit that may be meant; those that are."""


def _dead(sensors: Mapping[str, Imu], _: Units) -> _Found:
    """Gyroscopes without data: no sample, or all axes constant."""
    faults, part = {}, "gyroscope"
    for placement, imu in sensors.items():
        there = as_float(imu.gyr)[np.asarray(imu.mask)]
        if not len(there):
            faults[placement], part = (f"has no usable sample; all {len(imu.gyr)} are missing", ""), ""
        elif (np.ptp(there, axis=0) == 0.0).all():
            reading = ", ".join(f"{value:.4g}" for value in there[0])
            faults[placement] = f"is constant at ({reading}) rad/s; it recorded nothing", ""
    return part, faults, list(sensors) if len(faults) < len(sensors) else []


def _too_fast(sensors: Mapping[str, Imu], units: Units) -> _Found:
    """Sensors that turn impossibly fast, the fastest first; others that turn as those of a walking person are right."""
    rates = {placement: fast_rate(imu) for placement, imu in sensors.items()}
    right = [placement for placement, rate in rates.items() if SLOWEST_WALK < rate < IN_RADIANS]
    faults = {}
    for placement in sorted((p for p in rates if rates[p] > FASTEST), key=lambda p: -rates[p]):
        rate, unit = rates[placement], units[placement]["gyr"]
        raw = np.round(as_float(sensors[placement].gyr) / GYR_UNITS[unit.name], 6)
        # too fast in deg/s, it is in mrad/s or was converted twice, and these are close
        meant = "" if unit.name == "deg/s" or are_counts(raw) else _rate_meant(rate, unit)
        cause = RAW_COUNTS if are_counts(raw) else "is it in mrad/s, or was it converted twice?"
        twice = f"; {cause} State the unit, or correct its columns in the file"
        advice = _advice(meant, unit, right, twice if np.deg2rad(rate) < IN_RADIANS or are_counts(raw) else "")
        faults[placement] = (
            f"reaches {rate:.4g} rad/s (99th percentile, {unit}), but nothing worn while walking exceeds {FASTEST:g} "
            f"rad/s{advice}",
            "" if right else meant,
        )
    return "gyroscope", faults, right


def _without_gravity(sensors: Mapping[str, Imu], units: Units) -> _Found:
    """Sensors whose accelerometer does not measure gravity where it is calm."""
    forces, (low, high) = {}, (bound * GRAVITY for bound in GRAVITY_RANGE)
    for placement, imu in sensors.items():
        if imu.acc is None:
            continue
        acc = as_float(imu.acc)[np.asarray(imu.mask)]
        usual = float(np.median(np.linalg.norm(acc, axis=1)))
        # a trunk that never rests is calm in mid stance, where it feels less than gravity; its median is near it
        trunk = not placement.endswith(SIDES) and low <= usual <= high
        forces[placement] = usual if trunk else calm_force(acc, 1.0 / float(np.median(np.diff(imu.time))))
    right, faults = [placement for placement, force in forces.items() if low <= force <= high], {}
    for placement, force in forces.items():
        if placement in right:
            continue
        unit = units[placement]["acc"]
        steady = measures_gravity(as_float(sensors[placement].acc))
        meant = unit_of_gravity(force / ACC_UNITS[unit.name], GRAVITY_RANGE) if steady else ""
        advice = _advice(meant, unit, right, ": check the unit" if steady else NO_GRAVITY)
        faults[placement] = (
            f"reads {force:.4g} m/s² where it is calm ({unit}), but gravity alone is {GRAVITY:.4g} m/s²{advice}",
            "" if right else meant,
        )
    return "accelerometer", faults, right


def _rate_meant(rate: float, unit: Unit) -> str:
    """The unit in which an impossible rate [rad/s] is one of walking, the most usual of them; "" for none."""
    rates = {name: scale * rate / GYR_UNITS[unit.name] for name, scale in GYR_UNITS.items()}
    apart = {name: abs(np.log(each / USUAL_RATE)) for name, each in rates.items() if SLOWEST_WALK < each < FASTEST}
    return min(apart, key=lambda name: apart[name], default="")


def _check_moving(sensors: Mapping[str, Imu], units: Units, name: str) -> None:
    """Refuse gyroscopes that turn too slowly in deg/s while accelerometers, if any, show that the person moves.

    A file whose format states the unit, or whose unit is deduced from the signals, is not refused.
    """
    rates = {placement: fast_rate(imu) for placement, imu in sensors.items()}
    fastest = max(rates, key=lambda placement: rates[placement])
    unit, rate = units[fastest]["gyr"], rates[fastest]
    if unit.name == "rad/s" or unit.origin not in ("argument", "header", "names") or rate >= SLOWEST_WALK:
        return
    spread = [np.linalg.norm(imu.acc[busy(imu)], axis=1).std() for imu in sensors.values() if imu.acc is not None]
    if spread and max(spread) <= MOVING_ACC:
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
    size, samples = np.linalg.norm(acc, axis=1), max(round(CALM_S * rate_hz), 2)
    windows = len(size) // samples
    if windows < 5:
        return float(np.median(size))
    cut = size[: windows * samples].reshape(windows, samples)
    calm = np.argsort(cut.std(axis=1))[: max(round(CALM_SHARE * windows), 1)]
    return float(np.median(cut[calm].mean(axis=1)))


def are_counts(values: np.ndarray) -> bool:
    """Whether a signal (T, 3) holds whole numbers alone, as raw counts of a converter are."""
    numbers = np.unique(values[np.isfinite(values)])
    return len(numbers) >= COUNTS and bool((numbers % 1 == 0).all()) and float(np.abs(numbers).max()) >= LARGE_COUNT


def counts_without_unit(where: str, kind: str, name: str) -> RecordingError:
    """The error about whole numbers without a unit."""
    return RecordingError(
        f"{name}: the {SIGNALS[kind]} of {where} has whole numbers and no unit, as raw counts have: multiply its "
        "columns by the sensor's sensitivity, or state their unit by {argument}",
        argument=f"{kind}_unit",
    )


def measures_gravity(acc: np.ndarray) -> bool:
    """Whether an acceleration (T, 3) in any unit has gravity in it: its mean over some strides does not vanish."""
    present = acc[np.isfinite(acc).all(axis=1)]
    pieces = np.array_split(present, max(min(len(present) // PIECE, PIECES), 1))
    steady = sum(len(piece) * float(np.linalg.norm(piece.mean(axis=0))) for piece in pieces if len(piece))
    return steady > STEADY * float(np.linalg.norm(present, axis=1).sum())


def _correct(unit: Unit) -> str:
    return "correct the header, or " if unit.origin == "header" else ""


def _advice(meant: str, unit: Unit, others: Sequence[str], unclear: str) -> str:
    """What to do about a sensor that seems to be in another unit than the stated one, or in none that is known."""
    if not meant:
        return unclear
    seems = f": it seems to be in {meant.replace('^2', '²')}"
    if not others:
        return f"{seems}; {_correct(unit)}pass {{argument}}"
    if unit.origin == "header":
        return f"{seems}; correct the header of this sensor"
    rest = f"{others[0]} is" if len(others) == 1 else f"{len(others)} other sensors are"
    return f"{seems}, but {rest} not; convert the columns of this sensor in the file"


def check_range(distance: AnyArray, unit: str, name: str) -> None:
    """Refuse impossible distances between the feet (n,) [m] of a recording, given their stated unit.

    Raises:
        RecordingError: if a distance is not positive, or their median is outside `FEET_APART`.
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
