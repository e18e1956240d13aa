"""From the content of a measuring system's file to a `Recording`: what the file leaves open is decided here.

A reader only parses: it gives a `Measured` of one `Part` a sensor, in the file's own units, and states which units the
file or its specification states. Where neither does, the signals decide (gravity, the size of the rates) and
the decision becomes a note; where the signals do not decide, `settle` refuses. Where a sensor sat comes from the
caller, or from the name that the file gives the sensor, which is noted too.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from jgait.io.arrays import recording_in_units
from jgait.io.checks.readings import placeholders_in
from jgait.io.checks.sizes import BY_SIZE, NO_GRAVITY, are_counts, counts_without_unit, measures_gravity
from jgait.io.clock import CLOCK_BEGINS, by_stated_rate
from jgait.io.clocks import on_one_counter, one_clock
from jgait.io.dates import date_of
from jgait.io.names import NOT_USED, no_placement, placement_of
from jgait.io.part import Measured, Part
from jgait.io.units import Unit
from jgait.notes import AS_READ, BY_NAME, DEDUCED, LEFT_OUT, Note
from jgait.types import PLACEMENTS, Recording, RecordingError, as_float


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
            argument="placements", value={labels[0]: "shank_right"},
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
