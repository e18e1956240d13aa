"""Convert arrays to a `Recording` in SI units, on one clock, with missing samples masked."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from jgait.estimators.walking import walking_alone
from jgait.io.checks import contradictions, quality_notes
from jgait.io.checks.readings import RANGE_LOST, without_damage, without_repeats
from jgait.io.checks.sizes import COUNTS_GIVEN, RANGE_UNITS, are_counts, check_range, usable_sensors
from jgait.io.clock import SampleTimes, by_stated_rate, count_samples, make_clock
from jgait.io.names import no_placement
from jgait.io.units import ACC_UNITS, GYR_UNITS, Unit, Units, known_unit, unit_scale
from jgait.notes import AS_READ, DATA_LOST, Note
from jgait.quality import SensorQuality, merged
from jgait.quality import notes as writer
from jgait.signal.windows import over_losses
from jgait.types import PLACEMENTS, Imu, RangeReadings, Recording, RecordingError, as_float

ASLEEP = 0.05  # [1] largest share of samples that a gyroscope lacks, and its accelerometer has, without a note


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
        samples = _check_arrays(placement, signals, samples, name)
    notes_of: dict[str, tuple[Note, ...]] = {}
    imus, noted = {}, {}
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
        notes_of[placement] += _asleep(placement, read)
        unit = units[placement]["gyr"]
        if unit.origin == "argument" and unit.name in ("mdeg/s", "mrad/s") and are_counts(as_float(signals["gyr"])):
            notes_of[placement] += (COUNTS_GIVEN(placement=placement, unit=unit.name),)
        damaged = np.any([np.isfinite(v) & np.isnan(masked[k]) for k, v in read.items()], axis=(0, 2))
        noted[placement] = (clock.rows < 0) | damaged[clock.rows]
    imus, left_out = usable_sensors(imus, units, name)
    recording = Recording(imus, clock.sampling_rate_hz, name, subject, clock.notes)
    damage = [note for placement in imus for note in notes_of[placement]]
    # other movements show neither sides nor places nor clocks
    walking = walking_alone(recording).recording
    wrong = contradictions(walking, {placement: units[placement]["gyr"] for placement in imus}, recording)
    notes = (
        *clock.notes, *_by_header(units, sensors), *writer.left_out(left_out), *damage,
        *quality_notes(recording, noted), *wrong.notes,
    )  # fmt: skip
    begin = dict.fromkeys(imus, SensorQuality(begin=clock.begin))
    recording = recording._replace(quality=merged(left_out, begin, wrong.quality))
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


def _asleep(placement: str, read: Mapping[str, np.ndarray]) -> tuple[Note, ...]:
    """The note about a gyroscope without readings where its accelerometer has some, as while it is switched off."""
    alone = np.isfinite(read["acc"]).all(axis=1) & np.isnan(read["gyr"]).all(axis=1) if "acc" in read else np.zeros(1)
    text = (
        "{placement}: in {share:.0%} of the samples the accelerometer has a reading and the gyroscope has none; they "
        "count as lost; if it was switched off to save power, `duty_cycled_gyro` fills its rate: `estimate` takes "
        "gyro_on={{name: recording.sensors[name].mask}}"
    )
    return (DATA_LOST.note(text, placement=placement, share=alone.mean()),) if alone.mean() > ASLEEP else ()


def _by_header(units: Units, sensors: Mapping[str, Mapping[str, ArrayLike]]) -> list[Note]:
    """The note about signals whose unit the names of their columns state."""
    stated: dict[str, list[str]] = {}
    for placement, signals in sensors.items():
        for kind, unit in units[placement].items():
            if unit.origin == "header" and signals.get(kind) is not None:
                stated.setdefault(f"{kind} in {unit.name}", []).append(placement)
    text = ", ".join(f"{of} ({', '.join(where)})" for of, where in stated.items())
    return [AS_READ.note(f"units by the header: {text}")] if stated else []


def _check_arrays(placement: str, signals: Mapping[str, ArrayLike], samples: int | None, name: str) -> int:
    """Check the names and shapes of one sensor's signals; returns its number of samples."""
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
    return int(samples or 0)


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
