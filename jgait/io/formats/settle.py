"""From the content of a measuring system's file to a `Recording`: what the file leaves open is decided here.

A reader only parses: it gives a `Measured` of one `Part` a sensor, in the file's own units, and states which units the
file or its specification states. Where neither does, the signals decide (gravity, the size of the rates) and
the decision becomes a note; where the signals do not decide, `settle` refuses. Where a sensor sat comes from the
caller, or from the name that the file gives the sensor, which is noted too.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from jgait.io.arrays import recording_in_units
from jgait.io.checks.sizes import FEET_APART, RANGE_UNITS
from jgait.io.clock import CLOCK_FROM_DATE
from jgait.io.dates import date_of
from jgait.io.formats.clocks import on_one_counter, one_clock
from jgait.io.formats.part import SENSORS_LEFT_OUT, Measured, Part
from jgait.io.names import placement_of
from jgait.io.units import ACC_UNITS, Unit, unit_of_gravity
from jgait.notes import DEDUCED, ORIGIN, Kind, Note
from jgait.types import PLACEMENTS, Recording, RecordingError

RATES = {"rad/s": (1.0, 12.0), "deg/s": (30.0, 2e3), "mrad/s": (2e3, 1.2e4), "mdeg/s": (3.5e4, np.inf)}
"""Unit → limits [unit of the file] of the 99th percentile of a walking sensor's rate; chosen, none in two units."""

MOST_SHAKEN = 0.6, 2.0
"""[g] Limits of the median specific force of a sensor in walking; gravity is checked where the sensor is calm."""

PLACED_BY_NAME = Kind("placed_by_name", "info", "the sensor {sensor!r} is taken to have sat at {placement}", DEDUCED)
UNIT_DEDUCED = Kind("unit_deduced", "info", "{placement}: the file states no unit of {signal}; {unit}, {why}", DEDUCED)
AXES_STATED = Kind("axes_stated", "info", "{placement}: axes {axes}", ORIGIN)
AXIS_UP = Kind(
    "axis_up", "info", "{placement}: the sensor's {axis} points up ({share:.2f} of gravity){stated}", ORIGIN
)  # fmt: skip


def settle(
    measured: Measured,
    *,
    placements: Mapping[str, str] | None = None,
    gyr_unit: str | None = None,
    acc_unit: str | None = None,
    sampling_rate_hz: float | None = None,
    name: str | None = None,
    subject: str | None = None,
) -> Recording:
    """A recording in SI units, on one clock, with every placement and unit given, stated or deduced from the signals.

    Args:
        measured: what the reader found.
        placements: the file's name of a sensor → where it sat; sensors that are not named here are placed by their
            names, and left out, with a note, where at least one other could be placed.
        gyr_unit: overrules the file.
        acc_unit: overrules the file.
        sampling_rate_hz: [Hz] for files that do not state it.
        name: name of the recording in tables and figures; None: as `measured`.
        subject: name of the person; None: as `measured`, or the name of the recording.

    Raises:
        RecordingError: if no sensor can be placed, two have one place, a unit cannot be told, clocks do not overlap,
            or the signals make no usable recording.
    """
    called = measured.name if name is None else name
    notes = list(measured.notes)
    placed = _placed(measured.parts, placements or {}, called, notes)
    placed = on_one_counter(placed, called, notes)
    units_gyr = _rate_units(placed, gyr_unit, called, notes)
    units_acc = _force_units(placed, acc_unit, called, notes)
    units = {
        where: {
            "gyr": Unit(units_gyr[where], _origin(gyr_unit, part.gyr_unit, part.units_by)),
            "acc": Unit(units_acc[where], _origin(acc_unit, part.acc_unit, part.units_by)),
        }
        for where, part in placed.items()
    }
    for where, part in placed.items():
        notes += _which_way_up(part, where)
    sensors = {
        where: {
            kind: np.asarray(values, np.float64)
            for kind, values in (("gyr", part.gyr), ("acc", part.acc)) if values is not None
        }
        for where, part in placed.items()
    }  # fmt: skip
    time, rate_hz = one_clock(placed, sensors, sampling_rate_hz, called, notes)
    recording = recording_in_units(
        sensors,
        units,
        time=time,
        feet_range=measured.feet_range,
        range_unit=_range_unit(measured.feet_range, called, notes),
        time_unit=None if time is None else "s",
        sampling_rate_hz=rate_hz,
        name=called,
        subject=(measured.subject or called) if subject is None else subject,
    )
    begins = {part.begin_s for part in placed.values()}
    if time is not None and len(begins) == 1 and (begin_s := begins.pop()) is not None:
        notes.append(CLOCK_FROM_DATE(date=date_of(begin_s + float(time[0]))))
    return recording._replace(notes=(*notes, *recording.notes))


def _origin(given: str | None, stated: str | None, by: str) -> str:
    """What states a unit: the argument, the file, or else the signals."""
    return "argument" if given is not None else by if stated is not None else "signals"


def _placed(parts: Sequence[Part], chosen: Mapping[str, str], name: str, notes: list[Note]) -> dict[str, Part]:
    """Placement → part; what is left out is noted."""
    labels = [part.label for part in parts]
    if not parts:
        raise RecordingError(f"{name} holds no inertial sensor")
    unknown = [label for label in chosen if label not in labels]
    if unknown:
        raise RecordingError(
            f"{name} has no sensor {unknown[0]!r} (named by {{argument}}); it has {labels}", argument="placements"
        )
    placed: dict[str, Part] = {}
    nowhere: list[str] = []
    for part in parts:
        where = chosen.get(part.label) or part.placement or placement_of(part.label)
        if where is None or where not in PLACEMENTS:
            if part.label in chosen:
                raise RecordingError(f"{name}: there is no placement {where!r}; known are {', '.join(PLACEMENTS)}")
            nowhere.append(part.label)
            continue
        if where in placed:
            raise RecordingError(
                f"{name}: the sensors {placed[where].label!r} and {part.label!r} both sat at {where}; state which "
                "is which by {argument}",
                argument="placements",
            )
        if part.label != where:
            notes.append(PLACED_BY_NAME(sensor=part.label, placement=where))
        placed[where] = part
    if not placed:
        raise RecordingError(
            f"{name} does not state where its sensors sat: pass {{argument}}; its "
            f"sensors are {labels}, known placements {', '.join(PLACEMENTS)}",
            argument="placements",
            value={nowhere[0]: "shank_right"},
        )
    if nowhere:
        notes.append(SENSORS_LEFT_OUT(sensors=[f"{label!r} (its place is not known)" for label in nowhere]))
    return placed


def sizes(values: ArrayLike | None) -> np.ndarray:
    """The sizes of vectors (T, 3) that are finite."""
    size = np.linalg.norm(np.zeros((0, 3)) if values is None else np.asarray(values, np.float64), axis=1)
    return size[np.isfinite(size)]


def _force_units(placed: Mapping[str, Part], chosen: str | None, name: str, notes: list[Note]) -> dict[str, str]:
    """Placement → the accelerometer's unit: given, stated, or deduced from gravity, which is near its median."""
    units: dict[str, str] = {}
    for where, part in placed.items():
        size = sizes(part.acc)
        units[where] = chosen or part.acc_unit or ("" if size.size else "m/s^2")
        if units[where]:
            continue
        median = float(np.median(size))
        units[where] = unit_of_gravity(median, MOST_SHAKEN)
        if not units[where]:
            raise RecordingError(
                f"{name}: the file states no unit of acceleration, and the median of {where} is {median:.4g}, which is "
                f"gravity in none of {', '.join(ACC_UNITS)}; give {{argument}}, or find the raw signal if gravity was "
                "removed",
                argument="acc_unit",
            )
        why = f"for its median is {median:.4g}"
        notes.append(UNIT_DEDUCED(placement=where, signal="acceleration", unit=units[where], why=why))
    return units


def _rate_units(placed: Mapping[str, Part], chosen: str | None, name: str, notes: list[Note]) -> dict[str, str]:
    """Placement → the gyroscope's unit: given, stated, or deduced from its size, which needs walking.

    One system writes one unit: the unit of the sensor with the largest rate is used for all sensors without a unit.
    """
    units = {where: chosen or part.gyr_unit for where, part in placed.items()}
    rates = {where: sizes(part.gyr) for where, part in placed.items() if units[where] is None}
    reached = {where: float(np.percentile(size, 99.0)) if size.size else 0.0 for where, size in rates.items()}
    fastest = max(reached, key=lambda where: reached[where], default="")
    most = reached.get(fastest, 0.0)
    unit = next((name for name, (low, high) in RATES.items() if low < most <= high), None)
    if reached and unit is None:
        raise RecordingError(
            f"{name}: the file states no unit of angular rate, and the size of {fastest} does not decide (99th "
            f"percentile {most:.4g}; walking has {' or '.join(f'{a:g} to {b:g} {u}' for u, (a, b) in RATES.items())}); "
            "give {argument}",
            argument="gyr_unit",
        )
    for where in reached:
        why = f"for the 99th percentile is {most:.4g}" if where == fastest else f"as {fastest}"
        notes.append(UNIT_DEDUCED(placement=where, signal="angular rate", unit=unit, why=why))
    return {where: known or str(unit) for where, known in units.items()}


def _range_unit(values: ArrayLike | None, name: str, notes: list[Note]) -> str:
    """The unit of a range between feet, deduced from the size of the distances."""
    ranges = np.asarray([] if values is None else values, np.float64)
    ranges = ranges[np.isfinite(ranges)]
    if not ranges.size:
        return "m"
    middle = float(np.median(ranges))
    fits = [unit for unit, metres in RANGE_UNITS.items() if FEET_APART[0] <= middle * metres <= FEET_APART[1]]
    if len(fits) != 1:
        raise RecordingError(
            f"{name}: the file states no unit of feet_range, and its median, {middle:.4g}, does not decide (feet that "
            f"pass each other are {FEET_APART[0]:g} to {FEET_APART[1]:g} m apart); use read_csv and give {{argument}}",
            argument="range_unit",
        )
    why = f"for its median is {middle:.4g}"
    notes.append(UNIT_DEDUCED(placement="feet_range", signal="distances", unit=fits[0], why=why))
    return fits[0]


def _which_way_up(part: Part, where: str) -> list[Note]:
    """Which of the sensor's axes points up, from the accelerometer, and what is known of the axes."""
    if part.acc is None:
        return [AXES_STATED(placement=where, axes=part.axes)] if part.axes else []
    mean = np.nanmean(np.asarray(part.acc, np.float64), axis=0)
    size = float(np.linalg.norm(mean))
    if not size > 0.0:
        return []
    axis = int(np.argmax(np.abs(mean)))
    share = float(mean[axis]) / size
    name = f"{'-' if share < 0 else '+'}{'xyz'[axis]}"
    stated = f"; axes {part.axes}" if part.axes else ""
    return [AXIS_UP(placement=where, axis=name, share=abs(share), stated=stated)]
