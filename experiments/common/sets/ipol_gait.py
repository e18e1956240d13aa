"""`ipol_gait`: lower back and both feet, 100 Hz; stand, 10 m, U-turn, 10 m, stand (Voisard et al. 2023, IPOL 497).

Upstream has 110 recordings (`<subject>-<trial>`) of 19 healthy people, more than this version of jgait can fetch;
all recordings in the folder are read. Upstream m/s² and rad/s; the sensors' axes are kept. Lower back: x up, y left,
z backwards, tilted by up to 30° (z rises after every initial contact). Feet, parallel to the instep: x backwards
and up, y right, z up.

The accelerometers are not calibrated: at rest they read 9.8 to 10.1 m/s² on the back, 9.8 to 10.0 on the right foot,
10.0 to 10.5 on the left. The scale is not corrected here: divide by the reading at rest before integrating.

Time is the packet counter, the same for all sensors; lost packets are masked (one in 8-4, one in 19-3, in all three
sensors; up to a quarter of a sensor's in 17-2 and others), and so is a packet whose number the counter repeats (11-1).
Events are packet numbers and not rows: if they are read as rows, the signals about the events in 8-4 are shifted by a
sample after a lost packet.

In 4-1 and 4-2 the foot sensors were worn on the wrong feet: late in swing the outer edge of the foot rises and not the
inner edge, each foot's signals are those of the other foot in 4-5, and the back is accelerated towards the foot that
is listed as the stance foot. In such recordings, jgait exchanges sensors and events of right and left.

Reference: swings of both feet, packets of foot off and foot strike, detected by two published methods and all checked
by hand. One contact seems to be missing in the U-turn of 19-3 and of some others, and one or two elsewhere in 2-3, 17-2
and 18-3; a stride with a missing contact is not `valid`. Twelve recordings (3-3, 12-3, 18-1 …) have events 1 to 12 s
after the trial's end: single steps of a standing person, some where a third of the packets is lost. They are among the
contacts; their strides are not `valid`, and bout and straight parts end with the trial. No distance was measured; the
person was instructed to walk 20 m. Strides have no lengths.

Keys of `Walk.info`; empty or None where unknown, for example without the .json:
    initial_contacts, initial_contact_sides: (n,) [s], and 0 right, 1 left; in order of time.
    final_contacts, final_contact_sides: (n,) [s] and sides; each final contact begins a swing that a contact ends.
    bouts: {"start", "end" [s], "distance" [m], "speed" [m/s], "straight" (bool): (1,)}, one from the first contact to
        the last of the trial; distance and speed are NaN.
    turns: {"start", "end" [s]: (1,)}, the U-turn. 15-1 has one more turn 2 s before its end, which upstream does not
        list.
    straight_parts: (2, 2) [s] from the first contact to the U-turn, from the U-turn to the trial's last contact.
    trial: (start, end) [s], upstream's: first foot off to last strike.
    test: what the person was instructed to do.
    height [m], mass [kg], age [years], gender: None where not known; upstream writes NaN for height and mass of persons
        10 and 14 and for the mass of person 2. sensor_height: None, upstream does not give it.
    reference_system: source of the reference.
    no_reference: why there is no reference; None where there is one.
    feet_exchanged: whether upstream's right is left; jgait has corrected it.
    verified: whether every file's sha256 was known and agreed.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import PyTree

from jgait.datasets import reading, registry
from jgait.datasets.reading import Files
from jgait.io.clock import REPEATED
from jgait.io.files import json_object
from jgait.notes import DATA_LOST, LEFT_OUT, Kind, Note
from jgait.types import SIDES, Estimate, Imu, Legs, Recording, RecordingError, Strides, Walk

ROOT = "GaitData"
RATE_HZ = 100.0
SENSORS = {"lb": "lower_back", "rf": "foot_right", "lf": "foot_left"}
EVENTS = {"right": "RightFootEvents", "left": "LeftFootEvents"}
LOST = 0.5  # [1] largest share of lost packets; with more, the column is not a packet counter
EXCHANGED = -1.0  # [rad/s] right minus left roll rate late in swing; below it the sensors are exchanged
ACC_AS_UPSTREAM = Kind(
    "acc_as_upstream",
    "info",
    "accelerometers as upstream: at rest the left foot's reads up to 7 % more than gravity",
    "Lengths by integration of the left foot's accelerometer are too large without a correction of its scale.",
)
FEET_EXCHANGED = Kind(
    "feet_exchanged",
    "corrected",
    "the foot sensors were worn on the other foot: both raise the outer edge late in swing; sensors and events of "
    "right and left are exchanged",
    "The error was found in the data and corrected; nothing needs to be done.",
)
SWINGS_LEFT_OUT = Kind(
    "swings_left_out",
    "info",
    "{events}: {left_out} of {swings} left out, outside the recording or not in order",
    LEFT_OUT.meaning,
)
INTERVAL_OUTSIDE = Kind(
    "interval_outside", "info", "{interval} is no part of the recording's {samples} samples", LEFT_OUT.meaning
)


def names() -> list[str]:
    """Recordings whose back sensor or table of events is on this computer, for example '17-5'."""
    trials = [Path(file).name.removesuffix("_lb.txt") for file in registry.listing("ipol_gait", ROOT, "*_lb.txt")]
    trials += [Path(file).stem for file in registry.listing("ipol_gait", ROOT, "*.json")]
    return sorted(
        set(trials), key=lambda name: [int(part) if part.isdigit() else 0 for part in name.split("-")] + [name]
    )


def load_one(name: str) -> Walk:
    """One walk with its contacts."""
    files = Files("ipol_gait", ACC_AS_UPSTREAM())
    notes = files.notes
    tables = {}
    for code, placement in SENSORS.items():
        path = files.find(f"{ROOT}/{name}_{code}.txt")
        if path is not None:
            tables[placement] = _read_sensor(path)
    if not tables:
        raise RecordingError(f"{name} has none of the sensors {', '.join(SENSORS.values())}")
    sensors, first = _on_one_clock(name, tables, notes)
    time = next(iter(sensors.values())).time
    path = files.find(f"{ROOT}/{name}.json")
    about, why = ({}, str(notes[-1])) if path is None else (_read_about(path), None)
    swings = {
        side: _swings(f"{name}.json: {key}", about.get(key, []), first, len(time), notes)
        for side, key in EVENTS.items()
    }
    if why is None and not any(len(of) for of in swings.values()):
        why = f"{name}.json has no events"
    exchanged = _feet_exchanged(sensors, swings)
    if exchanged:
        right, left = (sensors[f"foot_{side}"] for side in SIDES)
        sensors |= {"foot_right": left, "foot_left": right}
        swings = {"right": swings["left"], "left": swings["right"]}
        notes.append(FEET_EXCHANGED())
    details = _contacts(swings) | _intervals(name, about, swings, first, len(time), notes) | _person(about)
    reference = None
    if why is None:
        start, end = details["trial"] or (time[0], time[-1])
        source = {"source": "contacts by two methods, checked by hand"}
        valid = (time >= start) & (time <= end)
        strides = _strides(swings)
        strides = strides._replace(valid=strides.valid & (strides.end <= end + 0.5 / RATE_HZ))
        reference = Estimate(time, Legs(None, None), None, None, valid, source, strides)
    details |= {
        "test": "stand, 10 m, U-turn, 10 m, stand",
        "reference_system": None if reference is None else "checked by hand",
        "feet_exchanged": exchanged,
        "no_reference": why,
        "verified": files.verified,
    }
    subject = str(about.get("Subject", name.split("-")[0]))
    return Walk(Recording(sensors, RATE_HZ, name, subject, tuple(notes)), reference, details)


def _read_sensor(path: Path) -> np.ndarray:
    """(n, 7): packet, gyroscope [rad/s], accelerometer [m/s²]."""
    values, rate = reading.xsens(path)
    if rate not in (None, RATE_HZ):
        raise RecordingError(f"{path.name} was recorded at {rate:g} Hz; {RATE_HZ:.0f} Hz is expected")
    packets = values[:, 0]
    least = 0 if np.sum(np.diff(packets) == 0) <= REPEATED * len(packets) else 1
    bad = np.flatnonzero((np.diff(packets) < least) | (packets[1:] % 1 != 0))
    if len(bad):
        row = bad[0] + 1
        raise RecordingError(f"{path.name}: PacketCounter must count upwards; in row {row} it is {packets[row]}")
    return values


def _on_one_clock(name: str, tables: dict[str, np.ndarray], notes: list[Note]) -> tuple[dict[str, Imu], int]:
    """Sensors on the union of their packets, a sensor's missing packets masked; and the number of the first packet."""
    first = min(int(table[0, 0]) for table in tables.values())
    length = max(int(table[-1, 0]) for table in tables.values()) + 1 - first
    fewest = min(map(len, tables.values()))
    if fewest < (1 - LOST) * length:
        raise RecordingError(f"{name}: PacketCounter spans {length} packets, and there are {fewest} of a sensor")
    for placement, table in tables.items():
        repeated = np.diff(table[:, 0]) == 0
        if repeated.any():
            numbers = ", ".join(map(str, table[1:][repeated, 0].astype(int)))
            notes.append(DATA_LOST.note(f"packet numbers that occur twice are masked: {numbers}", placement=placement))
            # it is not known which of the two rows was measured at that time
            table[np.append(repeated, False) | np.append(False, repeated), 1:] = np.nan
    return reading.on_counter(tables, first, length, RATE_HZ, notes), first


def _read_about(path: Path) -> dict[str, Any]:
    about = json_object(path)
    lacking = [key for key in EVENTS.values() if key not in about]
    if lacking:
        raise RecordingError(f"{path.name} has no {lacking[0]}")
    return about


def _swings(what: str, events: PyTree, first: int, length: int, notes: list[Note]) -> np.ndarray:
    """(n, 3) int: samples of foot off and foot strike, and upstream's event number; impossible swings are left out."""
    try:
        swings = np.asarray(events, np.float64).reshape(len(events), 2) - first
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{what} must be pairs of foot off and foot strike: {error}") from error
    keep = (
        np.isfinite(swings).all(axis=1) & (swings[:, 0] >= 0) & (swings[:, 1] < length) & (swings[:, 0] < swings[:, 1])
    )
    latest = np.maximum.accumulate(np.where(keep, swings[:, 1], -1.0))
    keep[1:] &= swings[1:, 0] > latest[:-1]
    if not keep.all():
        notes.append(SWINGS_LEFT_OUT(events=what, left_out=(~keep).sum(), swings=len(keep)))
    return np.concatenate([swings[keep], np.flatnonzero(keep)[:, None]], axis=1).astype(np.int64)


def _feet_exchanged(sensors: dict[str, Imu], swings: dict[str, np.ndarray]) -> bool:
    """Whether the foot sensors were exchanged: late in swing, the inner edge of a foot rises.

    The inner edge is the left edge of a right foot. The median rate about the forward axis, over the second halves of
    the swings, is at least 1.1 rad/s larger for the right foot than for the left, and 3.5 rad/s less in 4-1 and 4-2.
    """
    rates = []
    for side in SIDES:
        imu = sensors.get(f"foot_{side}")
        if imu is None or not len(swings[side]):
            return False
        up = np.asarray(imu.acc)[: max(swings[side][0, 0], 1)].mean(axis=0)
        forward = np.cross(up, np.eye(3)[1])  # y points right
        rolls = np.asarray(imu.gyr) @ (forward / max(float(np.linalg.norm(forward)), 1e-9))
        rates.append(np.median([rolls[(off + strike) // 2 : strike].mean() for off, strike, _ in swings[side]]))
    return bool(rates[0] - rates[1] < EXCHANGED)


def _contacts(swings: dict[str, np.ndarray]) -> dict[str, Any]:
    """Initial and final contacts of both feet, in order of time."""
    side = np.concatenate([np.full(len(swings[side]), SIDES.index(side)) for side in SIDES])
    contacts: dict[str, Any] = {}
    for name, column in (("initial_contact", 1), ("final_contact", 0)):
        when = np.concatenate([swings[side][:, column] for side in SIDES]) / RATE_HZ
        order = np.argsort(when, kind="stable")
        contacts |= {f"{name}s": when[order], f"{name}_sides": side[order]}
    return contacts


def _strides(swings: dict[str, np.ndarray]) -> Strides:
    """Strides from each contact of a foot to its next; not valid where a swing between them is missing or left out.

    A swing is missing where the other foot has two contacts during the stride.
    """
    before, after = (np.concatenate([swings[side][part] for side in SIDES]) for part in (slice(-1), slice(1, None)))
    side = np.concatenate([np.full(max(len(swings[side]) - 1, 0), SIDES.index(side)) for side in SIDES])
    start, final, end = (samples / RATE_HZ for samples in (before[:, 1], after[:, 0], after[:, 1]))
    other = [swings[SIDES[1 - of]][:, 1] / RATE_HZ for of in side]
    between = np.array([np.sum((of > a) & (of < b)) for of, a, b in zip(other, start, end, strict=True)])
    valid = (after[:, 2] - before[:, 2] == 1) & (between <= 1)
    nothing = np.full(len(side), np.nan)
    return Strides(side, start, final, end, nothing, nothing, nothing, valid)


def _intervals(
    name: str, about: dict[str, Any], swings: dict[str, np.ndarray], first: int, length: int, notes: list[Note]
) -> dict[str, Any]:
    """The walking bout, the trial, the turn and the straight parts."""

    def interval(key: str) -> tuple[float, float] | None:
        given = about.get(key)
        if given is None:
            return None
        if len(given) == 2 and first <= given[0] < given[1] < first + length:
            return (given[0] - first) / RATE_HZ, (given[1] - first) / RATE_HZ
        notes.append(INTERVAL_OUTSIDE(interval=f"{name}.json: {key} {given}", samples=length))
        return None

    trial, turn = interval("TrialBoundaries"), interval("UTurnBoundaries")
    strikes = np.concatenate([of[:, 1] for of in swings.values()]) / RATE_HZ
    if trial is not None:
        strikes = strikes[(strikes >= trial[0]) & (strikes <= trial[1] + 0.5 / RATE_HZ)]
    walked = np.array([[strikes.min(), strikes.max()]]) if len(strikes) else np.zeros((0, 2))
    turns = np.zeros((0, 2)) if turn is None else np.array([turn])
    parts = np.array([[walked[0, 0], turn[0]], [turn[1], walked[0, 1]]]) if turn and len(walked) else np.zeros((0, 2))
    unknown = np.full(len(walked), np.nan)
    return {
        "bouts": {
            "start": walked[:, 0], "end": walked[:, 1], "distance": unknown, "speed": unknown,
            "straight": np.zeros(len(walked), bool),
        },
        "turns": {"start": turns[:, 0], "end": turns[:, 1]},
        "straight_parts": parts[parts[:, 1] > parts[:, 0]],
        "trial": trial,
    }  # fmt: skip


def _person(about: dict[str, Any]) -> dict[str, Any]:
    def number(key: str, factor: float) -> float | None:
        value = about.get(key)
        # Upstream writes NaN for an unknown measure.
        if not isinstance(value, int | float) or not math.isfinite(value) or value <= 0:
            return None
        return float(value) * factor

    return {
        "height": number("Height", 0.01), "mass": number("Weight", 1.0), "age": number("Age", 1.0),
        "gender": about.get("Gender"), "sensor_height": None,
    }  # fmt: skip
