"""Checks of a recording: errors if it is unusable, notes if it is doubtful (units, dead channels, clipping)."""

from collections.abc import Mapping, Sequence

import numpy as np

from jgait.estimators.checks import FASTEST, busy, fast_rate
from jgait.geometry.vectors import GRAVITY
from jgait.io.damage.agreement import LONG_GAP_S
from jgait.io.damage.samples import COARSE, finest_step
from jgait.io.units import ACC_UNITS, GYR_UNITS, Unit, Units, unit_of_gravity
from jgait.notes import CLIPPING, LOSSES, Kind, Note
from jgait.signal.windows import true_runs
from jgait.types import SIDES, AnyArray, Imu, Recording, RecordingError

IN_RADIANS = 12.0  # [unit of the file] fast rate below which it is in rad/s; in deg/s a walking limb has more
USUAL_RATE = 6.0  # [rad/s] usual fast rate of a leg, between shank and foot
SLOWEST_WALK = 0.3  # [rad/s] smallest fast rate of a moving person; the trunk of a slow walker turns faster
MOVING_ACC = 0.5  # [m/s²] standard deviation of |acc| above which the person moves; 0.05 when standing
GRAVITY_RANGE = (0.8, 1.2)  # [g] specific force of a worn accelerometer where it is calm
CALM_S, CALM_SHARE = 0.2, 0.2  # [s], [1] length of the windows that are compared, and share of the calmest of them
CLIP_RUN = 3  # [samples] shortest run at the extreme value of a clipped channel; noise does not repeat exactly
CLIP_FLOOR = {"gyr": 1.0, "acc": 1.5 * GRAVITY}  # smallest clipped value; quiet channels repeat smaller values
CLIP_EDGE = 5.0  # [steps] least change beside a run of a coarse sensor; three samples at a rounded peak have up to 5
RANGE_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
WEAK = ": gravity seems to have been taken off; the raw specific force is needed"
TWICE = "; is it in mrad/s, or was it converted twice? State the unit, or correct its columns in the file"
FEET_APART = (0.02, 1.5)  # [m] median distance of one leg from the other where a range between them is measured

SENSOR_LEFT_OUT = Kind(
    "sensor_left_out",
    "check",
    "{placement} is left out: {reason}",
    "The numbers of this sensor cannot be right. What the other sensors measure does not depend on it.",
)
SAMPLES_MISSING = Kind(
    "samples_missing", "check", "{placement}: {missing} of {samples} samples {missing:is|are} missing", LOSSES
)
STRETCH_MISSING = Kind("stretch_missing", "check", "{placement}: {seconds:.2f} s missing from {begin_s:.2f} s", LOSSES)
CHANNEL_CONSTANT = Kind(
    "channel_constant",
    "check",
    "{channel} is constant at {value:.4g} {unit}",
    "One axis of a sensor gives the same value all the time: it is broken, or was not recorded.",
)
ACCELEROMETER_COARSE = Kind(
    "accelerometer_coarse",
    "info",
    "{placement}: the accelerometer reads in steps of {step:.2g} m/s²",
    "Standing may not be found, tilts are less certain, and lengths and distances may change by several per cent. "
    "Record with a finer resolution, or export more digits.",
)
CHANNEL_CLIPPED = Kind(
    "channel_clipped",
    "check",
    "{placement}: {channel} is clipped at ±{value:.4g} {unit} in {samples} {samples:sample|samples}",
    CLIPPING,
)


type _Fault = tuple[str, str]
"""Why the numbers of a sensor cannot be right: its part, or "" for the whole sensor, and the predicate."""


def usable_sensors(sensors: Mapping[str, Imu], units: Units, name: str) -> tuple[dict[str, Imu], list[Note]]:
    """The sensors without those whose numbers cannot be right, and a note about each of these.

    Raises:
        RecordingError: if no sensor has signals, or the sizes of most contradict their unit: a limb turns
            impossibly fast, a moving person impossibly slowly, or the accelerometer does not measure gravity.
    """
    faults = {placement: fault for placement, imu in sensors.items() if (fault := _dead(imu))}
    if len(faults) == len(sensors):
        placement, (part, words) = next(iter(faults.items()))
        raise RecordingError(f"{name}: {f'the {part} of ' if part else ''}{placement} {words}")
    faults |= _too_fast(_without(sensors, faults), units, name)
    faults |= _without_gravity(_without(sensors, faults), units, name)
    _check_moving(_without(sensors, faults), units, name)
    notes = [
        SENSOR_LEFT_OUT(placement=placement, reason=f"{f'its {part}' if part else 'it'} {words}")
        for placement, (part, words) in faults.items()
    ]
    return _without(sensors, faults), notes


def _without(sensors: Mapping[str, Imu], faults: Mapping[str, _Fault]) -> dict[str, Imu]:
    return {placement: imu for placement, imu in sensors.items() if placement not in faults}


def _dead(imu: Imu) -> _Fault | None:
    """The fault of a gyroscope without data: no sample, or all axes constant."""
    there = np.asarray(imu.gyr)[np.asarray(imu.mask)]
    if not len(there):
        return "", f"has no usable sample; all {len(imu.gyr)} are missing"
    if (np.ptp(there, axis=0) == 0.0).all():
        reading = ", ".join(f"{value:.4g}" for value in there[0])
        return "gyroscope", f"is constant at ({reading}) rad/s; it recorded nothing"
    return None


def _judged(
    name: str, part: str, worst: str, reasons: Mapping[str, str], meant: Mapping[str, str], right: Sequence[str]
) -> dict[str, _Fault]:
    """The faults of sensors; refuses a recording in which they are more than those that are right."""
    if len(reasons) <= len(right):
        return {placement: (part, reason) for placement, reason in reasons.items()}
    raise RecordingError(
        f"{name}: the {part} of {worst} {reasons[worst]}",
        argument=f"{part[:3]}_unit" if meant[worst] and not right else "",
        value=meant[worst],
    )


def _too_fast(sensors: Mapping[str, Imu], units: Units, name: str) -> dict[str, _Fault]:
    """The sensors that turn impossibly fast, unless these are more than those that turn as a walking person."""
    rates = {placement: fast_rate(imu) for placement, imu in sensors.items()}
    fast = {placement: rate for placement, rate in rates.items() if rate > FASTEST}
    if not fast:
        return {}
    others = [placement for placement, rate in rates.items() if SLOWEST_WALK < rate < IN_RADIANS]
    limit = f"nothing worn while walking exceeds {FASTEST:g} rad/s"
    # too fast in deg/s, it is in mrad/s or was converted twice, and these are close
    meant = {
        placement: "" if units[placement]["gyr"].name == "deg/s" else _rate_meant(rate, units[placement]["gyr"])
        for placement, rate in fast.items()
    }
    reasons = {
        placement: f"reaches {rate:.4g} rad/s (99th percentile, {units[placement]['gyr']}), but {limit}"
        f"{_advice(meant[placement], units[placement]['gyr'], others, TWICE if np.deg2rad(rate) < IN_RADIANS else '')}"
        for placement, rate in fast.items()
    }
    return _judged(name, "gyroscope", max(fast, key=lambda placement: fast[placement]), reasons, meant, others)


def _rate_meant(rate: float, unit: Unit) -> str:
    """The unit in which an impossible rate [rad/s] is one of walking, the most usual of them; "" for none."""
    rates = {name: scale * rate / GYR_UNITS[unit.name] for name, scale in GYR_UNITS.items()}
    apart = {name: abs(np.log(each / USUAL_RATE)) for name, each in rates.items() if SLOWEST_WALK < each < FASTEST}
    return min(apart, key=lambda name: apart[name], default="")


def _check_moving(sensors: Mapping[str, Imu], units: Units, name: str) -> None:
    """Refuse gyroscopes that turn too slowly in deg/s while accelerometers show that the person moves.

    A file whose format states the unit, or whose unit is deduced from the signals, is not refused.
    """
    rates = {placement: fast_rate(imu) for placement, imu in sensors.items()}
    fastest = max(rates, key=lambda placement: rates[placement])
    unit = units[fastest]["gyr"]
    asserted = unit.name != "rad/s" and unit.origin in ("argument", "header")
    if asserted and rates[fastest] < SLOWEST_WALK and _moves(sensors):
        by = f", {unit}" if unit.origin == "header" else ""
        meant = _rate_meant(rates[fastest], unit) or "rad/s"
        raise RecordingError(
            f"{name}: no gyroscope exceeds {rates[fastest]:.4g} rad/s ({np.rad2deg(rates[fastest]):.4g} deg/s, 99th "
            f"percentile, {fastest}{by}), too slow for walking: the gyroscopes seem to be in {meant}; "
            f"{_correct(unit)}pass {{argument}}, or nobody walks",
            argument="gyr_unit",
            value=meant,
        )


def _moves(sensors: Mapping[str, Imu]) -> bool:
    """Whether any accelerometer shows that the person moves; True without an accelerometer."""
    spread = [
        float(np.linalg.norm(imu.acc[busy(imu)], axis=1).std()) for imu in sensors.values() if imu.acc is not None
    ]
    return not spread or max(spread) > MOVING_ACC


def calm_force(acc: np.ndarray, rate_hz: float) -> float:
    """Median size [m/s²] of the specific force (T, 3) in the calmest windows: gravity's, even at a runner's foot."""
    size = np.linalg.norm(acc, axis=1)
    samples = max(round(CALM_S * rate_hz), 2)
    windows = len(size) // samples
    if windows < 5:
        return float(np.median(size))
    cut = size[: windows * samples].reshape(windows, samples)
    calm = np.argsort(cut.std(axis=1))[: max(round(CALM_SHARE * windows), 1)]
    return float(np.median(cut[calm].mean(axis=1)))


def _correct(unit: Unit) -> str:
    return "correct the header, or " if unit.origin == "header" else ""


def _advice(meant: str, unit: Unit, others: Sequence[str], unclear: str) -> str:
    """What to do about a sensor that seems to be in another unit than the stated one, or in none that is known."""
    if not meant:
        return unclear
    shown = meant.replace("^2", "²")
    if not others:
        return f": it seems to be in {shown}; {_correct(unit)}pass {{argument}}"
    if unit.origin == "header":
        return f": it seems to be in {shown}; correct the header of this sensor"
    rest = f"{others[0]} is" if len(others) == 1 else f"{len(others)} other sensors are"
    return f": it seems to be in {shown}, but {rest} not; convert the columns of this sensor in the file"


def _without_gravity(sensors: Mapping[str, Imu], units: Units, name: str) -> dict[str, _Fault]:
    """The sensors whose accelerometer does not measure gravity where it is calm, unless these are most."""
    forces = {}
    low, high = (bound * GRAVITY for bound in GRAVITY_RANGE)
    for placement, imu in sensors.items():
        if imu.acc is None:
            continue
        acc = np.asarray(imu.acc)[np.asarray(imu.mask)]
        forces[placement] = calm_force(acc, 1.0 / float(np.median(np.diff(imu.time))))
        if not placement.endswith(SIDES):
            # A trunk that never rests is calm in mid stance, where it feels less than gravity; its median is near it.
            usual = float(np.median(np.linalg.norm(acc, axis=1)))
            forces[placement] = usual if low <= usual <= high else forces[placement]
    right = [placement for placement, force in forces.items() if low <= force <= high]
    wrong = {placement: force for placement, force in forces.items() if placement not in right}
    if not wrong:
        return {}
    unclear = {placement: WEAK if force < 0.3 * GRAVITY else ": check the unit" for placement, force in wrong.items()}
    meant = {
        placement: unit_of_gravity(force / ACC_UNITS[units[placement]["acc"].name], GRAVITY_RANGE)
        for placement, force in wrong.items()
    }
    reasons = {
        placement: f"reads {force:.4g} m/s² where it is calm ({units[placement]['acc']}), but gravity alone is "
        f"{GRAVITY:.4g} m/s²{_advice(meant[placement], units[placement]['acc'], right, unclear[placement])}"
        for placement, force in wrong.items()
    }
    return _judged(name, "accelerometer", next(iter(wrong)), reasons, meant, right)


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
    low, high = FEET_APART
    middle = float(np.median(distance))
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


def quality_notes(recording: Recording, noted: Mapping[str, np.ndarray] | None = None) -> tuple[Note, ...]:
    """Notes about doubtful signals of a structurally sound recording: missing samples, clipped or constant channels.

    Args:
        recording: the recording.
        noted: placement → (T,) bool, missing samples that other notes report.
    """
    notes: list[Note] = []
    for placement, imu in recording.sensors.items():
        present = np.asarray(imu.mask) | (False if noted is None else noted[placement])
        notes += _missing_notes(placement, present, imu, recording.sampling_rate_hz)
        step = 0.0 if imu.acc is None else finest_step(np.asarray(imu.acc)[np.asarray(imu.mask)])
        if step >= COARSE:
            notes.append(ACCELEROMETER_COARSE(placement=placement, step=step))
        for kind, signal, unit in (("gyr", imu.gyr, "rad/s"), ("acc", imu.acc, "m/s²")):
            if signal is None:
                continue
            for axis, values in zip("xyz", np.asarray(signal).T, strict=True):
                notes += _channel_notes(
                    f"{placement} {kind}_{axis}", values, np.asarray(imu.mask), CLIP_FLOOR[kind], unit
                )
    return tuple(notes)


def _missing_notes(placement: str, present: np.ndarray, imu: Imu, rate_hz: float) -> list[Note]:
    """Notes about long stretches of samples that are not present, and about their number if there are others."""
    missing = int((~present).sum())
    long = [(start, end) for start, end in true_runs(~present) if end - start > LONG_GAP_S * rate_hz]
    notes = []
    if missing > sum(end - start for start, end in long):
        notes.append(SAMPLES_MISSING(placement=placement, missing=missing, samples=len(present)))
    for start, end in long:
        begin = float(imu.time[start] - imu.time[0])
        notes.append(STRETCH_MISSING(placement=placement, seconds=(end - start) / rate_hz, begin_s=begin))
    return notes


def _channel_notes(name: str, values: np.ndarray, mask: np.ndarray, floor: float, unit: str) -> list[Note]:
    there = values[mask]
    if not len(there):
        return []
    if np.ptp(there) == 0.0:
        return [CHANNEL_CONSTANT(channel=name, value=there[0], unit=unit)]
    limits = {}
    step = finest_step(there) if unit == "m/s²" else 0.0
    for extreme in (there.max(), there.min()):
        at_extreme = mask & (np.abs(values - extreme) <= 1e-6 * abs(extreme))
        runs = [(start, end) for start, end in true_runs(at_extreme) if end - start >= CLIP_RUN]
        if step >= COARSE:
            change = np.abs(np.diff(values, prepend=values[:1], append=values[-1:]))
            runs = [run for run in runs if change[list(run)].max() > CLIP_EDGE * step]
        clipped = sum(end - start for start, end in runs)
        if clipped and abs(extreme) >= floor:
            limits[float(abs(extreme))] = clipped
    if not limits:
        return []
    placement, _, channel = name.partition(" ")
    clips = CHANNEL_CLIPPED(
        placement=placement, channel=channel, value=max(limits), unit=unit, samples=sum(limits.values())
    )
    return [clips]
