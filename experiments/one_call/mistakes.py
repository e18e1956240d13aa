"""Mistakes in wearing, labels, units and clocks: how many are named, and how many correct walks raise an alarm."""

from collections.abc import Iterator
from typing import Any

import jax
import numpy as np

from experiments.common.row import Row, show
from jgait import simulate
from jgait.estimators.combined import crosscheck
from jgait.notes import Note
from jgait.simulate.sensors import MPU6000, OPAL
from jgait.types import SIDES, Imu, Recording

WALKS = 20
"""Walks of each mistake."""

CORRECT = 200
"""Walks without a mistake."""

LATE_S = 0.5
KINDS = ("thigh", "shank", "foot")
PEOPLE_KEY = 2303


def late(imu: Imu, rate_hz: float) -> Imu:
    """The sensor with a clock that is late by `LATE_S`: every reading has a later time."""
    samples = round(LATE_S * rate_hz)

    def moved(values: Any) -> np.ndarray:
        return np.concatenate([np.repeat(np.asarray(values)[:1], samples, axis=0), np.asarray(values)[:-samples]])

    return imu._replace(gyr=moved(imu.gyr), acc=moved(imu.acc), mask=moved(imu.mask))


def scaled(imu: Imu, gyr: float = 1.0, acc: float = 1.0) -> Imu:
    """The sensor with its signals multiplied."""
    return imu._replace(gyr=np.asarray(imu.gyr) * gyr, acc=np.asarray(imu.acc) * acc)


def spoilt(recording: Recording, kind: str, chooser: np.random.Generator) -> tuple[Recording, str, tuple[str, ...]]:
    """A recording with one mistake of a kind, the code of the note that names it, and the placements it must name."""
    sensors = dict(recording.sensors)
    name, side = str(chooser.choice(sorted(sensors))), str(chooser.choice(SIDES))
    segment = str(chooser.choice(KINDS))
    if kind == "sides exchanged":
        a, b = (f"{segment}_{one}" for one in SIDES)
        sensors[a], sensors[b] = sensors[b], sensors[a]
        return recording._replace(sensors=sensors), "places_exchanged", (a, b)
    if kind == "thigh for shank":
        a, b = f"thigh_{side}", f"shank_{side}"
        sensors[a], sensors[b] = sensors[b], sensors[a]
        return recording._replace(sensors=sensors), "places_exchanged", (a, b)
    if kind == "gyroscope in another unit":
        factor = np.pi / 180.0 if chooser.random() < 0.5 else 180.0 / np.pi
        sensors[name] = scaled(sensors[name], gyr=factor)
        return recording._replace(sensors=sensors), "sensor_unit", (name,)
    if kind == "accelerometer in g":
        sensors[name] = scaled(sensors[name], acc=1.0 / 9.80665)
        return recording._replace(sensors=sensors), "sensor_unit", (name,)
    sensors[name] = late(sensors[name], recording.sampling_rate_hz)
    return recording._replace(sensors=sensors), "clock_off", (name,)


MISTAKES = (
    "sides exchanged", "thigh for shank", "gyroscope in another unit", "accelerometer in g",
    "clock 0.5 s late",
)  # fmt: skip


def named(notes: tuple[Note, ...], code: str, placements: tuple[str, ...]) -> bool:
    """Whether a note of this code names all placements."""
    return any(note.code == code and all(name in note.text for name in placements) for note in notes)


def correct_walks(people: int) -> Iterator[Recording]:
    """Straight walks, out and back, and round corners, of people drawn anew, with two kinds of sensors."""
    routes = (simulate.straight(12.0), simulate.u_turn(8.0), simulate.rectangle(6.0, 4.0))
    each = -(-people // (2 * len(routes)))
    key = jax.random.key(PEOPLE_KEY)
    left = people
    for number, (route, errors) in enumerate((r, e) for r in routes for e in (OPAL, MPU6000)):
        for recording, _ in simulate.cohort(
            jax.random.fold_in(key, number), min(each, left), route, errors, 100.0, recorded=False
        ):
            yield recording
        left -= min(each, left)
        if left < 1:
            return


def rows(quick: bool) -> list[Row]:
    """Of all mistakes, and of correct walks."""
    correct, repeats = (6, 3) if quick else (CORRECT, WALKS)
    chooser = np.random.default_rng(PEOPLE_KEY)
    alarms, found, extra = [], dict.fromkeys(MISTAKES, 0), dict.fromkeys(MISTAKES, 0)
    walks = 0
    step = max(1, correct // repeats)
    for number, recording in enumerate(correct_walks(correct)):
        notes = crosscheck(recording).notes
        alarms += [f"{number}: {note}" for note in notes]
        walks += bool(notes)
        if number % step == 0 and number // step < repeats:
            for kind in MISTAKES:
                wrong, code, placements = spoilt(recording, kind, chooser)
                told = crosscheck(wrong).notes
                found[kind] += named(told, code, placements)
                extra[kind] += len(told) > 1
    lines = [[kind, f"{found[kind]} of {repeats}", extra[kind]] for kind in MISTAKES]
    show(
        "mistakes that are named", ["mistake", "named", "further notes"], [*lines, ["none", f"{walks} of {correct}", 0]]
    )
    for alarm in alarms[:10]:
        print(f"false alarm, walk {alarm}")
    worst = 100.0 * min(found.values()) / repeats
    people = "people drawn anew, straight, U-turn and rectangle, two kinds of sensors"
    line = "cross-check of the sensors, seven placements, worst of six mistakes"
    return [
        Row("exchanged_found_pct", worst, "%", n=repeats, split=people).on(line, "named", "walks", simulated=True),
        Row("false_alarms", float(walks), "walks", n=correct, split=people).on(
            line, "false alarms", "walks", simulated=True
        ),
    ]
