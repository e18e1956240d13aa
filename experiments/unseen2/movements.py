"""Movements that are no walking, before, between and after walks: strides counted in them, and what the walks lose.

Simulated people walk with seven sensors and do something else before, between or after; the recording is measured with
the sensor at the waist, those on the shanks, those on the feet, and all seven. The numbers that tell walking from other
movements (`jgait.events.movement`) were learned from the movements of `bodies.CHOSEN` with other seeds, and never saw
those of `bodies.JUDGED`. On public sets it is counted how many strides of real walking are taken for other movements.
"""

from collections.abc import Iterator
from typing import NamedTuple

import jax
import numpy as np

from experiments.common.recordings import attempt, available, names, walks
from experiments.common.row import Row, show
from experiments.unseen2.bodies import CHOSEN, JUDGED, RATE_HZ, Movement, readings, turned
from jgait import simulate
from jgait.estimators.combined.analysis import Analysis, analyse
from jgait.estimators.walking import inside, walking_alone
from jgait.types import Imu, Recording, as_float

SENSORS = {
    "waist": ("pelvis",), "shanks": ("shank_right", "shank_left"), "feet": ("foot_right", "foot_left"),
    "seven": simulate.SEVEN,
}  # fmt: skip
"""Sensors that a person wears."""

PLACES = ("before", "between", "after")
"""When a person moves without walking."""

SEED, PEOPLE, LENGTH_M = 1000, 2, 15.0
"""First seed, none of which was used for learning; number of people; length of a walk [m]."""

SETS = ("ipol_gait", "mobgap_lab", "walking5m", "pyshoe_vicon", "footprints", "tripod", "neura_sparse")
"""Public sets of walking, among them runs, U-turns, elderly people and patients."""

GYR_NOISE, GYR_BIAS, ACC_NOISE, MOUNTED = 0.003, 0.005, 0.03, 0.15
"""[rad/s], [rad/s], [m/s²], [rad] Errors of the sensors, and how far they are turned on their segments."""


class Case(NamedTuple):
    """A recording with a movement that is no walking, and the same walks with standing in its place."""

    kind: str  #: of the movement.
    place: str  #: of `PLACES`.
    sensors: str  #: of `SENSORS`.
    recording: Recording  #: of all of `SENSORS`.
    alone: Recording  #: without the movement.
    span: tuple[float, float]  #: begin and end of the movement [s].


type Signals = dict[str, tuple[np.ndarray, np.ndarray]]
"""Placement → angular rates and specific forces in the axes of the segment."""


def of_person(number: int) -> list[Signals]:
    """Two walks of a simulated person, as ideal sensors measure them."""
    person = simulate.person_of(simulate.population(jax.random.key(SEED), PEOPLE), number)
    keys = jax.random.split(jax.random.key(SEED + number), 2)
    every = []
    for key in keys:
        way = simulate.straight(LENGTH_M)
        recording, _ = simulate.recording(key, simulate.covering(key, person, way), way)
        every.append({name: (as_float(imu.gyr), as_float(imu.acc)) for name, imu in recording.sensors.items()})
    return every


def fitted(movement: Signals, walk: Signals) -> Signals:
    """The movement in the axes of the walk's sensors: turned so that both have one direction of gravity in standing."""
    moved = {}
    for name, (gyr, acc) in movement.items():
        here, there = (values[: int(RATE_HZ)].mean(axis=0) for values in (acc, walk[name][1]))
        pitch = np.arctan2(here[0], here[2]) - np.arctan2(there[0], there[2])
        turn = turned(np.array([[0.0, pitch, 0.0]]))[0]
        moved[name] = gyr @ turn, acc @ turn
    return moved


def cases(people: int, places: tuple[str, ...]) -> Iterator[Case]:
    """Every movement at these places, for each of some people and each choice of sensors."""
    for number in range(people):
        first, second = of_person(number)
        for index, (kind, movement) in enumerate({**CHOSEN, **JUDGED}.items()):
            for place in places:
                yield from variants(kind, movement, place, first, second, SEED + 100 * number + index)


def variants(kind: str, movement: Movement, place: str, first: Signals, second: Signals, seed: int) -> Iterator[Case]:
    """A movement before, between or after two walks of a person, for each choice of sensors."""
    rng = np.random.default_rng(seed)
    moved = fitted(readings(movement(rng)), first)
    order = {
        "before": [moved, first, second], "between": [first, moved, second], "after": [first, second, moved],
    }[place]  # fmt: skip
    lengths = [len(part["pelvis"][0]) for part in order]
    begin = sum(lengths[: PLACES.index(place)]) / RATE_HZ
    span = begin + 1.5, begin + len(moved["pelvis"][0]) / RATE_HZ - 1.5
    state = rng.bit_generator.state
    for sensors, placements in SENSORS.items():
        rng.bit_generator.state = state
        with_movement = worn(order, placements, rng)
        rng.bit_generator.state = state
        yield Case(kind, place, sensors, with_movement, worn([first, second], placements, rng), span)


def worn(parts: list[Signals], placements: tuple[str, ...], rng: np.random.Generator) -> Recording:
    """The parts one after another, as sensors with errors measure them."""
    sensors = {}
    for name in placements:
        gyr, acc = (np.concatenate([part[name][k] for part in parts]) for k in (0, 1))
        turn, bias = turned(MOUNTED * rng.normal(size=(1, 3)))[0], GYR_BIAS * rng.normal(size=3)
        time = np.arange(len(gyr)) / RATE_HZ
        gyr = gyr @ turn + bias + GYR_NOISE * rng.normal(size=gyr.shape)
        sensors[name] = Imu(time, gyr, acc @ turn + ACC_NOISE * rng.normal(size=acc.shape), np.ones(len(time), bool))
    return Recording(sensors, RATE_HZ)


class Outcome(NamedTuple):
    """What a movement does."""

    kind: str  #: of the movement.
    sensors: str  #: of `SENSORS`.
    inside: int  #: strides counted in the movement.
    walked: int  #: strides of the walks alone.
    beside: int  #: difference of the numbers of strides of the walks.
    off_pct: float  #: difference of the distances with and without the movement over the latter [%].


def _strides(analysis: Analysis | None) -> tuple[np.ndarray, float]:
    """Middles of strides [s], and distance [m]; none where nobody walks."""
    if analysis is None or analysis.strides is None or analysis.estimate.distance is None:
        return np.zeros(0), 0.0
    strides = analysis.strides.strides
    return 0.5 * (as_float(strides.start) + as_float(strides.end)), float(as_float(analysis.estimate.distance)[-1])


def outcome(case: Case, alone: tuple[np.ndarray, float]) -> Outcome:
    """What the movement of a case does; `alone` as of `_strides`."""
    middles, distance = _strides(attempt(f"{case.kind}, {case.sensors}", lambda: analyse(case.recording)))
    within = (middles > case.span[0]) & (middles < case.span[1])
    off = 100.0 * abs(distance / alone[1] - 1.0) if alone[1] > 0.0 else np.nan
    return Outcome(
        case.kind, case.sensors, int(within.sum()), len(alone[0]), abs(int((~within).sum()) - len(alone[0])), off
    )


def rows(quick: bool) -> list[Row]:
    """On simulated people, and on the sets that are here."""
    alone: dict[tuple[str, int], tuple[np.ndarray, float]] = {}
    outcomes = []
    for case in cases(1 if quick else PEOPLE, PLACES[:1] if quick else PLACES):
        if quick and case.sensors == "seven":
            continue
        key = case.sensors, len(case.alone.sensors[next(iter(case.alone.sensors))].time)
        if key not in alone:
            alone[key] = _strides(attempt("the walks alone", lambda case=case: analyse(case.alone)))
        outcomes.append(outcome(case, alone[key]))
    found = []
    for name, kinds in (("chosen", CHOSEN), ("judged", JUDGED)):
        of = [each for each in outcomes if each.kind in kinds]
        show(
            f"Movements that are no walking, {name}",
            ["movement", "sensors", "strides in it", "strides of the walks", "more or fewer", "distance off [%]"],
            [list(each) for each in of],
        )
        split = "other seeds of these movements" if name == "chosen" else "movements of which nothing was learned"
        line = f"movements that are no walking, five kinds {name}"
        walked, off = sum(each.walked for each in of), [each.off_pct for each in of]
        counted, beside = (sum(getattr(each, name) for each in of) for name in ("inside", "beside"))
        for metric, value, part in (
            ("strides", 100.0 * counted / max(1, counted + walked), "strides counted in them"),
            ("beside", 100.0 * beside / max(1, walked), "strides of the walks, more or fewer"),
            ("distance_median", float(np.nanmedian(off)), "distance off, median"),
            ("distance_worst", float(np.nanmax(off)), "distance off, worst"),
        ):
            row = Row(f"not_walking_{metric}_pct_{name}", value, "%", n=len(of), split=split)
            found.append(row.on(line, part, "recordings", simulated=True))
    share = 100.0 * sum(each.inside for each in outcomes) / max(1, sum(each.inside + each.walked for each in outcomes))
    total = Row("not_walking_strides_pct", share, "%", n=len(outcomes), split="other seeds, all ten movements")
    return [*found, total, *public(quick)]


def public(quick: bool) -> list[Row]:
    """Strides of public walks that are taken for other movements."""
    found, lines = [], []
    for name in SETS[:1] if quick else SETS:
        if not available(name):
            continue
        taken = total = 0
        seconds = 0.0
        for walk in walks(name, names(name)):
            spans = walking_alone(walk.recording).spans
            seconds += sum(end - begin for begin, end in spans)
            reference = walk.reference
            if reference is not None and reference.strides is not None and reference.strides.start is not None:
                middles = 0.5 * (as_float(reference.strides.start) + as_float(reference.strides.end))
                middles = middles[np.asarray(reference.strides.valid, bool)]
                taken, total = taken + int(inside(middles, spans).sum()), total + len(middles)
        lines.append([name, taken, total, seconds])
        if total:
            row = Row(f"walking_lost_pct_{name}", 100.0 * taken / total, "%", n=total, split="all sets")
            found.append(row.on("walking taken for other movements", f"`{name}`", "strides"))
    show("Public walks", ["set", "strides taken for other movements", "of", "all replaced [s]"], lines)
    return found
