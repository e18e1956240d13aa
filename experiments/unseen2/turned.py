"""Sensors on legs that are worn the other way round, or exchanged: mended, said, or neither; and how tables are made.

Each public and simulated walk is judged with every pair of its sensors on thighs and shanks exchanged, with all sensors
of both legs exchanged, and with every sensor turned at random. Tables of one half of the people are judged on the other
half, and tables of simulated people alone on the public ones. A case is right if each sensor is put in its place and
its forward axis points the right way; it counts as said if a note names what is wrong.
"""

import itertools
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from scipy.spatial.transform import Rotation

from experiments.common.recordings import available, names, walks
from experiments.common.row import Row, show
from jgait import simulate
from jgait.mounting import places
from jgait.mounting.cycle import HARMONICS, SEGMENTS, Cycle, cycle_of
from jgait.simulate.sensors import MPU6000
from jgait.types import SIDES, Imu

LEGS = tuple(f"{segment}_{side}" for segment in SEGMENTS for side in SIDES)
FOUR = LEGS[:4]
SETS = ("walking5m", "neura_sparse")
GAITS = ("slow", "fast", "shuffling", "limping", "stiff_leg", "hemiparetic", "unsteady", "crouched", "toes_out")
LEAST_SD = 0.03
"""[1] Least standard deviation of a harmonic between people."""


class Worn(NamedTuple):
    """The sensors of one walk, each in its place."""

    group: str
    subject: str
    sensors: dict[str, Imu]


def public(quick: bool) -> Iterator[Worn]:
    """Public walks, with sensors that their files exchange in their places."""
    for name in SETS:
        if not available(name):
            continue
        for walk in walks(name, names(name)[:2] if quick else None):
            sensors = {k: imu for k, imu in walk.recording.sensors.items() if k in LEGS}
            for one, other in walk.info.get("misplaced", ()):
                sensors[one], sensors[other] = sensors[other], sensors[one]
            yield Worn(name, walk.recording.subject, sensors)


def simulated(people: int, seed: int) -> Iterator[Worn]:
    """Simulated walks of 11 m: of three people, one with a gait that is not the usual one, and one as slow as people
    walk by the simpler rules of `simulate.gait`.
    """
    key = jax.random.key(seed)
    drawn = simulate.population(key, people)
    errors, along = MPU6000._replace(packet_loss=0.0, mounting=0.1), simulate.straight(11.0)
    for number in range(people):
        person, each = simulate.person_of(drawn, number), jax.random.fold_in(key, number)
        if number % 3 == 2:
            person = simulate.walking(person, GAITS[number // 3 % len(GAITS)])
        if number % 3 == 1:
            speed = float(jax.random.uniform(each, minval=0.25, maxval=1.4))
            person = simulate.Person(gait=simulate.gait(speed=speed, stature=1.75)._replace(
                knee_stance=person.gait.knee_stance, standing_knee=person.gait.standing_knee))  # fmt: skip
        try:
            able = simulate.covering(each, person, along)
            recording, _ = simulate.recording(each, able, along, errors, placements=LEGS)
        except ValueError as error:
            print(f"simulated {number} left out: {error}")
            continue
        yield Worn("simulated", f"{seed}/{number}", dict(recording.sensors))


_SIGNS = {"thigh": np.array([0.36 + 0.43j, -0.12 + 0.17j]), "foot": np.array([0.7 - 0.2j, 0.9 + 0.5j])}
"""[1] First two harmonics of a thigh and a foot with axes to the right, which give signs before tables are learned."""


def in_places(cycle: Cycle) -> dict[str, np.ndarray]:
    """Placement → (2, HARMONICS) harmonics of sensors known to be in their places, as the tables have them.

    The axes point to the right, the sides are mirrored, and the stride begins at the maximum of both shanks' first
    harmonic; for learning the tables. Empty without a shank.
    """
    orders = np.arange(1, HARMONICS + 1)
    made = {}
    for name, turning in cycle.turning.items():
        left = name.endswith("left")
        made[name] = turning.waves * ((-1.0) ** orders * np.array([[1.0], [-1.0]]) if left else 1.0)
    shanks = [name for name in made if name.startswith("shank")]
    if not shanks:
        return {}
    for name in shanks:  # the forward swing of a shank is the faster one
        first, second = made[name][0, :2]
        made[name] = made[name] * (1.0 if (second * np.conj(first) ** 2).real > 0.0 else -1.0)
    begin = np.exp(-1j * np.angle(np.sum([made[name][0, 0] for name in shanks])) * orders)
    made = {name: waves * begin for name, waves in made.items()}
    for name, waves in made.items():
        if not name.startswith("shank"):
            mean = _SIGNS[name.partition("_")[0]]
            made[name] = waves * (1.0 if np.real(np.vdot(mean, waves[0, :2])) > 0.0 else -1.0)
    return made


def learned(cycles: list[Cycle]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Segment → mean and standard deviation of the harmonics of sensors in their places, see `mounting.places`."""
    each = [in_places(cycle) for cycle in cycles]
    tables = {}
    for segment in SEGMENTS:
        waves = np.array([wave for one in each for name, wave in one.items() if name.startswith(segment)])
        mean = waves.mean(axis=0)
        spread = np.maximum((waves - mean).real.std(axis=0), LEAST_SD) + 1j * np.maximum(
            (waves - mean).imag.std(axis=0), LEAST_SD
        )
        tables[segment] = mean, spread
    return tables


def write(path: Path, tables: Mapping[str, tuple[np.ndarray, np.ndarray]], source: str) -> None:
    """Write tables as `mounting.places` reads them."""

    def numbers(values: np.ndarray) -> list[list[list[float]]]:
        return [[[round(float(v.real), 3), round(float(v.imag), 3)] for v in row] for row in values]

    made = {segment: {"mean": numbers(mean), "spread": numbers(spread)} for segment, (mean, spread) in tables.items()}
    path.write_text(json.dumps({"source": source, "segments": made}) + "\n", encoding="utf-8")


class Case(NamedTuple):
    """A mistake, and what became of it."""

    what: str
    right: bool  #: every sensor is in its place, and every axis points the right way.
    noted: bool  #: a note says that a place or an axis is not sure.
    left_out: bool  #: sensors are not combined with others, for they rather have changed places than not.


def cases(worn: Worn, four: bool, rng: np.random.Generator) -> Iterator[Case]:
    """Every exchange of two sensors on thighs and shanks, of all, and none, with sensors turned at random."""
    kept = {name: imu for name, imu in worn.sensors.items() if name in FOUR or not four}
    plain = cycle_of(kept)
    if plain is None:
        return
    truth = in_places(plain)
    mirrored = {name: _other(name) for name in kept}
    orders: dict[str, dict[str, str]] = {"in place": {}, "all exchanged": mirrored}
    for one, other in itertools.combinations([name for name in FOUR if name in kept], 2):
        orders[f"{one} and {other}"] = {one: other, other: one}
    for what, order in orders.items():
        turns = {name: Rotation.random(random_state=int(rng.integers(2**31))) for name in kept}
        sensors = {}
        for name in kept:
            imu = kept[order.get(name, name)]
            gyr, acc = (turns[name].apply(np.asarray(part)) for part in (imu.gyr, imu.acc))
            sensors[name] = imu._replace(gyr=gyr, acc=acc)
        cycle = cycle_of(sensors)
        assert cycle is not None
        where = places.places_of(cycle)
        right = all(order.get(label, label) == name for name, label in where.worn.items())
        for name, label in where.worn.items():
            # the second harmonic over the first one's square is odd in the sign of the axis, and knows no begin
            wave, true = where.right[name] * cycle.turning[label].waves[0], truth[name][0]
            right &= bool((wave[1] * np.conj(wave[0]) ** 2 * np.conj(true[1] * np.conj(true[0]) ** 2)).real > 0.0)
        unsure = [note for name in where.worn for note in where.unsure(name)]
        yield Case(what, right, bool(where.unsure_of or unsure), bool(where.doubtful))


def _other(name: str) -> str:
    segment, _, side = name.partition("_")
    return f"{segment}_{SIDES[1 - SIDES.index(side)]}"


def judged(judge: list[Worn], tables: Mapping[str, tuple[np.ndarray, np.ndarray]], four: bool) -> list[Case]:
    """All cases of some walks by given tables."""
    rng = np.random.default_rng(0)
    before, places._tables = places._tables, lambda: dict(tables)
    try:
        return [case for worn in judge for case in cases(worn, four, rng)]
    finally:
        places._tables = before


def rows(quick: bool) -> list[Row]:
    """Cases that are mended or said, of people left out."""
    walked = [*public(quick), *simulated(4 if quick else 90, 11)]
    cycles = {id(worn): cycle for worn in walked if (cycle := cycle_of(worn.sensors)) is not None}
    walked = [worn for worn in walked if id(worn) in cycles]
    halves = [walked[0::2], walked[1::2]]
    lines, everything = [], list[Case]()

    def add(title: str, judge: list[Worn], learn: list[Worn], four: bool) -> None:
        if not judge or not learn:
            return
        made = judged(judge, learned([cycles[id(worn)] for worn in learn]), four)
        everything.extend(made)
        right, noted = (np.array([getattr(case, key) for case in made]) for key in ("right", "noted"))
        wrong = sorted({case.what for case in made if not case.right and not case.noted})
        lines.append([title, len(made), 100.0 * right.mean(), 100.0 * (right & noted).mean(),
                      100.0 * (right | noted).mean(), "; ".join(wrong[:3])])  # fmt: skip

    for four in (False, True):
        sensors = "thighs and shanks" if four else "with feet"
        for judge, learn in (halves, halves[::-1]):
            add(f"every other person, {sensors}", judge, learn, four)
        groups = [[worn for worn in walked if (worn.group == "simulated") == made] for made in (False, True)]
        add(f"public, learned on simulated, {sensors}", groups[0], groups[1], four)
        add(f"simulated, learned on public, {sensors}", groups[1], groups[0], four)
    columns = ["", "cases", "right %", "right, doubted %", "right or said %", "silent"]
    show("Sensors on legs turned at random and exchanged, by tables of other people", columns, lines)
    if not everything:
        return []
    share = 100.0 * float(np.mean([case.right or case.noted for case in everything]))
    right = 100.0 * float(np.mean([case.right for case in everything]))
    doubted, left_out = (
        100.0 * float(np.mean([case.right and each for case, each in zip(everything, flags, strict=True)]))
        for flags in ([case.noted for case in everything], [case.left_out for case in everything])
    )
    n, line = len(everything), "legs, sensors turned or exchanged"
    guess = 100.0 / math.factorial(len(FOUR)) / 2 ** len(FOUR)
    return [
        Row("leg_sensor_turned_pct", share, "%", n=n, split="left out").on(f"{line}: mended or said", "", "cases"),
        Row("leg_sensor_mended_pct", right, "%", n=n, split="left out").on(f"{line}: mended", "", "cases"),
        Row("leg_sensor_mended_pct_guess", guess, "%", n=n, split="guess").on(f"{line}: mended", "by chance", "cases"),
        Row("leg_sensor_doubted_pct", doubted, "%", n=n, split="left out").on(
            f"{line}: right, with a note", "", "cases"
        ),
        Row("leg_sensor_left_out_pct", left_out, "%", n=n, split="left out").on(
            f"{line}: right, and not combined", "", "cases"
        ),
    ]


def learn() -> None:
    """Write the tables that the library has, from all people."""
    walked = [*public(False), *simulated(90, 11)]
    cycles = [cycle for worn in walked if (cycle := cycle_of(worn.sensors)) is not None]
    path = Path(places.__file__).with_name("places.json")
    write(path, learned(cycles), "experiments.unseen2.turned: walking5m, neura_sparse, 90 simulated people")


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    learn()
