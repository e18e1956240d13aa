"""From arrays, or from what a reader found in a file, to a `Recording` in SI units, on one clock, lost samples masked.

A reader only parses: it gives a `Measured` of one `Part` a sensor, in the file's own units, and states which units the
file or its specification states. Where neither does, the signals decide (gravity, the size of the rates) and
the decision becomes a note; where the signals do not decide, `settle` refuses. Where a sensor sat comes from the
caller, or from the name that the file gives the sensor, which is noted too.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from jgait.estimators.walking import walking_alone
from jgait.io.checks import contradictions, quality_notes
from jgait.io.checks.readings import RANGE_LOST, placeholders_in, without_damage, without_repeats
from jgait.io.checks.sizes import (
    BY_SIZE,
    COUNTS_GIVEN,
    NO_GRAVITY,
    RANGE_UNITS,
    are_counts,
    check_range,
    counts_without_unit,
    measures_gravity,
    usable_sensors,
)
from jgait.io.clock import CLOCK_BEGINS, SampleTimes, by_stated_rate, count_samples, make_clock
from jgait.io.dates import date_of
from jgait.io.names import NOT_USED, no_placement, placement_of
from jgait.io.part import Measured, Part, on_one_counter, one_clock
from jgait.io.units import ACC_UNITS, GYR_UNITS, Unit, Units, known_unit, unit_scale
from jgait.notes import AS_READ, BY_NAME, DATA_LOST, DEDUCED, LEFT_OUT, Note
from jgait.quality import SensorQuality, merged
from jgait.quality import notes as writer
from jgait.signal.windows import over_losses
from jgait.types import PLACEMENTS, Imu, RangeReadings, Recording, RecordingError, as_float


def recording_from_arrays(
    sensors: Mapping[str, Mapping[str, ArrayLike]],
    *,
    time: ArrayLike | None = None,
    feet_range: ArrayLike | None = None,
    sampling_rate_hz: float | None = None,
    time_unit: str | None = None,
    gyr_unit: str = "deg/s",
    acc_unit: str = "m/s^2",
    range_unit: str = "m",
    name: str = "recording",
    subject: str = "subject",
) -> Recording:
    """A recording from arrays, all sensors on one clock.

    Samples that are NaN or infinite are masked: the gyroscope is then set to 0, and missing samples of the
    accelerometer are interpolated. Gaps in time are filled with masked samples.

    Args:
        sensors: placement (see `jgait.types.PLACEMENTS`) → {"gyr": (T, 3), "acc": (T, 3) or absent}.
        time: (T,) time stamps, or numbers of the samples if the rate is given, or None.
        feet_range: (T,) distance from the inner side of the left ankle to the right leg, NaN where it was not
            measured; None without such a sensor.
        sampling_rate_hz: rate [Hz], or None to take it from `time`.
        time_unit: 's', 'ms' or 'us'; None: deduced from the steps, and noted.
        gyr_unit: 'deg/s', 'rad/s', 'mdeg/s' or 'mrad/s'.
        acc_unit: 'm/s^2', 'g' or 'mg'.
        range_unit: 'm', 'cm' or 'mm'.
        name: name of the recording in tables and figures.
        subject: name of the person.

    Returns:
        The recording in SI units; its notes state deduced units, filled gaps and doubtful signals, and sensors that
        are left out, because their numbers cannot be right although those of the others are.

    Raises:
        ValueError: for an unknown unit.
        RecordingError: if the arrays, the clock or the units make the recording unusable; the message states the
            expected and the given values.
    """
    units = {placement: {"gyr": Unit(gyr_unit), "acc": Unit(acc_unit)} for placement in sensors}
    recording = recording_in_units(
        sensors, units, time=time, feet_range=feet_range, sampling_rate_hz=sampling_rate_hz, time_unit=time_unit,
        range_unit=range_unit, name=name, subject=subject,
    )  # fmt: skip
    return by_stated_rate(recording) if time is None or (not time_unit and count_samples(as_float(time))) else recording


def recording_in_units(
    sensors: Mapping[str, Mapping[str, ArrayLike]],
    units: Units,
    *,
    time: ArrayLike | None,
    feet_range: ArrayLike | None,
    sampling_rate_hz: float | None,
    time_unit: str | None,
    range_unit: str,
    name: str,
    subject: str,
) -> Recording:
    """As `recording_from_arrays`, with a unit for each signal of each sensor."""
    scales = {
        placement: {
            "gyr": unit_scale(each["gyr"].name, GYR_UNITS, "gyr_unit"),
            "acc": unit_scale(each["acc"].name, ACC_UNITS, "acc_unit"),
        }
        for placement, each in units.items()
    }
    units = {placement: {kind: unit._replace(name=str(known_unit(unit.name))) for kind, unit in each.items()}
             for placement, each in units.items()}  # fmt: skip
    metres = unit_scale(range_unit, RANGE_UNITS, "range_unit")
    if not sensors:
        raise RecordingError(f"{name} has no sensor; expected at least one of {', '.join(PLACEMENTS)}")
    samples = None
    for placement, signals in sensors.items():
        if placement not in PLACEMENTS:
            raise RecordingError(f"{name}: {no_placement(placement)}")
        if signals.get("gyr") is None:
            raise RecordingError(f"{name}: {placement} needs 'gyr' of shape (T, 3); it has {sorted(signals)}")
        for kind in (kind for kind in ("gyr", "acc") if signals.get(kind) is not None):
            shape = np.shape(signals[kind])
            if len(shape) != 2 or shape[1] != 3:
                raise RecordingError(f"{name}: {kind} of {placement} must have shape (T, 3); got {shape}")
            if samples not in (None, shape[0]):
                raise RecordingError(f"{name}: {kind} of {placement} has {shape[0]} samples; the others have {samples}")
            samples = shape[0]
    notes_of: dict[str, tuple[Note, ...]] = {}
    imus, noted, by_header = {}, {}, dict[str, list[str]]()
    every = np.hstack([as_float(values) for each in sensors.values() for values in each.values() if values is not None])
    again = ~np.diff(every, axis=0).any(axis=1)
    clock = make_clock(int(samples or 0), time, sampling_rate_hz, time_unit, name, again)
    twice = again if len(sensors) > 1 else None
    for placement, signals in sensors.items():
        read = {
            kind: as_float(signals[kind]) * scale
            for kind, scale in scales[placement].items() if signals.get(kind) is not None
        }  # fmt: skip
        read = {kind: np.where(np.isfinite(values), values, np.nan) for kind, values in read.items()}
        masked, notes_of[placement] = without_damage(placement, read, scales[placement], clock.sampling_rate_hz, twice)
        imus[placement] = _imu(masked, clock)
        asleep = np.isnan(read["gyr"]).all(axis=1)  # as a gyroscope that is switched off
        asleep &= np.isfinite(read["acc"]).all(axis=1) if "acc" in read else False
        if asleep.mean() > 0.05:
            text = (
                "{placement}: in {share:.0%} of the samples the accelerometer has a reading and the gyroscope has "
                "none; they count as lost; if it was switched off to save power, `duty_cycled_gyro` fills its rate: "
                "`estimate` takes gyro_on={{name: recording.sensors[name].mask}}"
            )
            notes_of[placement] += (DATA_LOST.note(text, placement=placement, share=asleep.mean()),)
        for kind in read:
            if units[placement][kind].origin == "header":
                by_header.setdefault(f"{kind} in {units[placement][kind].name}", []).append(placement)
        unit = units[placement]["gyr"]
        if unit.origin == "argument" and unit.name in ("mdeg/s", "mrad/s") and are_counts(as_float(signals["gyr"])):
            notes_of[placement] += (COUNTS_GIVEN(placement=placement, unit=unit.name),)
        damaged = np.any([np.isfinite(v) & np.isnan(masked[k]) for k, v in read.items()], axis=(0, 2))
        noted[placement] = (clock.rows < 0) | damaged[clock.rows]
    imus, left_out = usable_sensors(imus, units, name)
    recording = Recording(imus, clock.sampling_rate_hz, name, subject, clock.notes)
    damage = [note for placement in imus for note in notes_of[placement]]
    stated = ", ".join(f"{of} ({', '.join(where)})" for of, where in by_header.items())
    header = [AS_READ.note(f"units by the header: {stated}")] if stated else []
    # other movements show neither sides nor places nor clocks
    walking = walking_alone(recording).recording
    wrong, contrary = contradictions(walking, {placement: units[placement]["gyr"] for placement in imus}, recording)
    notes = (
        *clock.notes, *header, *writer.left_out(left_out), *damage,
        *quality_notes(recording, noted), *contrary,
    )  # fmt: skip
    begin = dict.fromkeys(imus, SensorQuality(begin=clock.begin))
    recording = recording._replace(quality=merged(left_out, begin, wrong))
    if feet_range is None:
        return recording._replace(notes=notes)
    distance = as_float(feet_range)
    if distance.shape != (samples,):
        raise RecordingError(f"{name}: feet_range must have one value a sample, ({samples},); got {distance.shape}")
    measured = (clock.rows >= 0) & np.isfinite(distance)[clock.rows]
    apart = RangeReadings(clock.time, np.where(measured, metres * distance[clock.rows], 0.0), measured)
    check_range(apart.distance[apart.mask], range_unit, name)
    apart, repeats = without_repeats(apart, imus)
    notes = (*notes, *repeats)
    if not apart.mask.any():
        notes = (*notes, RANGE_LOST.note("feet_range holds no reading"))
    return recording._replace(notes=notes, feet_range=apart)


def _imu(signals: Mapping[str, np.ndarray], clock: SampleTimes) -> Imu:
    """One sensor on the clock, with missing samples masked."""
    rate, force = signals["gyr"], signals.get("acc")
    finite = np.isfinite(rate).all(axis=1) if force is None else np.isfinite(np.hstack([rate, force])).all(axis=1)
    mask = (clock.rows >= 0) & finite[clock.rows]
    gyr = np.where(mask[:, None], rate[clock.rows], 0.0)
    if force is None:
        return Imu(clock.time, gyr, None, mask)
    # While the gyroscope sleeps, the accelerometer's samples are kept.
    measured = (clock.rows >= 0) & np.isfinite(force).all(axis=1)[clock.rows]
    acc = over_losses(clock.time, force[clock.rows], measured) if measured.any() else np.zeros_like(gyr)
    return Imu(clock.time, gyr, acc, mask)


def settle(
    measured: Measured,
    *,
    placements: Mapping[str, str] | None = None,
    gyr_unit: str | None = None,
    acc_unit: str | None = None,
    range_unit: str | None = None,
    sampling_rate_hz: float | None = None,
    usual: Mapping[str, str] | None = None,
    name: str | None = None,
    subject: str | None = None,
) -> Recording:
    """A recording in SI units, on one clock, with every placement and unit given, stated or deduced from the signals.
    `placements` are by the file's names of sensors; those not named are placed by their names, or left out, and noted.
    `usual` are units where the file states none. Raises RecordingError for what cannot be told or joined.
    """
    called = measured.name if name is None else name
    notes = list(measured.notes)
    placed = _placed(measured.parts, placements or {}, called, notes)
    placed = on_one_counter(placed, called, notes)
    given, usual = {"gyr": gyr_unit, "acc": acc_unit}, usual or {}
    units_by_kind = {kind: _units(placed, kind, unit, usual.get(kind), called, notes) for kind, unit in given.items()}
    units = {where: {kind: units_by_kind[kind][where] for kind in given} for where in placed}
    sensors = {
        where: {
            kind: np.asarray(values, np.float64)
            for kind, values in (("gyr", part.gyr), ("acc", part.acc)) if values is not None
        }
        for where, part in placed.items()
    }  # fmt: skip
    apart = measured.feet_range
    if range_unit is None and apart is not None and np.isfinite(as_float(apart)).any():
        range_unit = _by_size("feet_range", {"feet_range": as_float(apart)}, called, notes)["feet_range"]
    time, rate_hz = one_clock(placed, sensors, sampling_rate_hz, called, notes)
    recording = recording_in_units(
        sensors, units, time=time, feet_range=apart, range_unit=range_unit or "m", sampling_rate_hz=rate_hz,
        time_unit=None if time is None else "s", name=called,
        subject=(measured.subject or called) if subject is None else subject,
    )  # fmt: skip
    if time is None and sampling_rate_hz is not None:
        recording = by_stated_rate(recording)
    begins = {part.begin_s for part in placed.values()}
    if time is not None and len(begins) == 1 and (begin_s := begins.pop()) is not None:
        date = date_of(begin_s + float(time[0]))
        notes.append(CLOCK_BEGINS.note("times count from {date}, the date of the first sample", date=date))
    return recording._replace(notes=(*notes, *recording.notes))


def _placed(parts: Sequence[Part], chosen: Mapping[str, str], name: str, notes: list[Note]) -> dict[str, Part]:
    """Placement → part; what is left out is noted."""
    labels = [part.label for part in parts]
    if not parts:
        raise RecordingError(f"{name} holds no inertial sensor")
    # sensors whose columns were recognised by their names are called by their placements
    chosen = {where if label not in labels and (where := placement_of(label)) in labels else label: place
              for label, place in chosen.items()}  # fmt: skip
    for label, place in chosen.items():
        if label not in labels:
            text = f"{name} has no sensor {label!r} (named by {{argument}}); it has {labels}"
            raise RecordingError(text, argument="placements")
        if place not in (*PLACEMENTS, NOT_USED):
            raise RecordingError(f"{name}: {no_placement(place)}")
    placed: dict[str, Part] = {}
    nowhere: list[str] = []
    for part in parts:
        where = chosen.get(part.label) or part.placement or placement_of(part.label)
        if where is None or where not in PLACEMENTS:
            nowhere.append(f"{part.label!r} ({'as asked' if where == NOT_USED else 'its place is not known'})")
            continue
        if where in placed:
            both = f"the sensors {placed[where].label!r} and {part.label!r} both sat at {where}"
            raise RecordingError(f"{name}: {both}; state which is which by {{argument}}", argument="placements")
        if part.label != where:
            stated = part.stated or part.label in chosen
            kind, sat = (AS_READ, "was stated to sit") if stated else (BY_NAME, "is taken to have sat")
            notes.append(kind.note(f"the sensor {part.label!r} {sat} at {where}"))
        placed[where] = part
    if not placed:
        raise RecordingError(
            f"{name} does not state where its sensors sat: pass {{argument}}; its sensors are {', '.join(labels)}; "
            "places are waist, lower_back, foot_right, shank_left and so on; a wrong one lists all",
            argument="placements", value={labels[0]: "PLACE"},
        )  # fmt: skip
    if nowhere:
        notes.append(LEFT_OUT.note(f"left out: {', '.join(nowhere)}"))
    return placed


def _units(
    placed: Mapping[str, Part], kind: str, chosen: str | None, usual: str | None, name: str, notes: list[Note]
) -> dict[str, Unit]:
    """Placement → unit of a signal: given, stated by the file, the usual one, or deduced from its size."""
    units, unknown = dict[str, Unit](), dict[str, np.ndarray]()
    for where, part in placed.items():
        stated = part.gyr_unit if kind == "gyr" else part.acc_unit
        signal = np.zeros((0, 3)) if getattr(part, kind) is None else as_float(getattr(part, kind))
        signal = signal[~np.isin(np.abs(signal), np.abs(placeholders_in(signal))).any(axis=1)]
        if chosen is None and stated is None and np.isfinite(signal).all(axis=1).any():
            if are_counts(signal):
                raise counts_without_unit(where, kind, name)
            unknown |= {where: signal} if usual is None else {}
        by = part.units_by if chosen is None and stated is not None else "argument"
        units[where] = Unit(chosen or stated or usual or next(iter(BY_SIZE[kind].limits)), by)
    heavy = {where: signal for where, signal in unknown.items() if kind == "gyr" or measures_gravity(signal)}
    if unknown and not heavy:
        raise RecordingError(f"{name}: the accelerometer of {next(iter(unknown))} does not measure gravity{NO_GRAVITY}")
    sizes = {where: np.linalg.norm(signal, axis=1) for where, signal in heavy.items()}
    deduced = _by_size(kind, sizes, name, notes)
    usual = next(iter(deduced.values()), "")
    return units | {where: Unit(deduced.get(where, usual), "signals") for where in unknown}


def _by_size(kind: str, values: Mapping[str, np.ndarray], name: str, notes: list[Note]) -> dict[str, str]:
    """Sensor → unit of its sizes (T,), as those of the sensor with the largest decide: one system writes one unit."""
    signal, what, share, limits, hint = BY_SIZE[kind]
    sizes = {where: float(np.nanpercentile(signals, share)) for where, signals in values.items()}
    if not sizes:
        return {}
    largest = max(sizes, key=lambda where: sizes[where])
    fits = [unit for unit, (low, high) in limits.items() if low < sizes[largest] <= high]
    if len(fits) != 1:
        usual = " or ".join(f"{low:.4g} to {high:.4g} {unit}" for unit, (low, high) in limits.items())
        raise RecordingError(
            f"{name}: the file states no unit of {signal}, and the size of {largest} does not decide ({what} "
            f"{sizes[largest]:.4g}; walking has {usual}); {hint}give {{argument}}",
            argument="range_unit" if kind == "feet_range" else f"{kind}_unit",
        )
    for where in sizes:
        why = f"for the {what} is {sizes[largest]:.4g}" if where == largest else f"as {largest}"
        notes.append(DEDUCED.note(f"the file states no unit of {signal}; {fits[0]}, {why}", placement=where))
    return dict.fromkeys(sizes, fits[0])
