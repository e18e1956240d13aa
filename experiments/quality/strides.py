"""Strides beside a reference, with the evidence about each: public recordings, and simulated walks with and without
faults.

The strides have the deviations that the methods state, before the model of `jgait.quality`: what it gave them is
divided out again. Faults are those of `damage.harm`, and gaits those of `people.gaits`; each fault changes one sensor,
or all where it concerns the file.
"""

import zlib
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import jax
import numpy as np

from experiments.common.matching import overlapping
from experiments.common.recordings import attempt
from experiments.damage.harm import DAMAGES, Damage, read, rows_of, signal, times
from experiments.people.gaits import GAITS, measures, person, simulated
from experiments.unseen.judged import Judged, judged
from jgait import estimators, simulate
from jgait.quality import EVIDENCE
from jgait.types import SIDES, Estimate, Recording, RecordingError, Strides, as_float

SENSORS = {"foot_ins": ("foot_right", "foot_left"), "ankle_stride": ("shank_right", "shank_left"), "waist": ("pelvis",)}
"""Estimator → its sensors of a simulated walk; the first one is damaged."""

FAULTS = {
    **DAMAGES,
    "gyroscope by 1.03": signal("gyr", times(1.03)), "gyroscope by 0.95": signal("gyr", times(0.95)),
    "gyroscope by 1.1": signal("gyr", times(1.1)), "accelerometer by 1.05": signal("acc", times(1.05)),
    "accelerometer by 0.97": signal("acc", times(0.97)), "one axis by 0.9": signal("gyr", times((1.0, 0.9, 1.0))),
    **{f"rate stated {100 * factor - 100:+.0f} %": Damage(
        lambda r, *_, f=factor: r._replace(time=None, rate_hz=f / np.median(np.diff(r.time))), everywhere=True)
       for factor in (0.97, 1.03, 1.1)},
}  # fmt: skip
"""Name → fault."""


class Table(NamedTuple):
    """Strides (n,), of all estimators.

    Attributes:
        estimator: name.
        group: of the set, "gait NAME" or "fault NAME".
        recording: name.
        person: those whose strides are left out together.
        error: of the length [m].
        stated: deviation that the method states [m].
        reference: deviation of the reference [m].
        length: true one [m].
        evidence: (n, F), in the order of `EVIDENCE`.
    """

    estimator: np.ndarray
    group: np.ndarray
    recording: np.ndarray
    person: np.ndarray
    error: np.ndarray
    stated: np.ndarray
    reference: np.ndarray
    length: np.ndarray
    evidence: np.ndarray


def table(
    estimator: str, group: str, recording: str, who: str, estimate: Estimate, rows: np.ndarray, true: np.ndarray,
    reference: np.ndarray | float,
) -> Table:  # fmt: skip
    """Some strides of an estimate beside their true lengths [m]."""
    strides, spread = estimate.strides, estimate.strides_stddev
    assert isinstance(strides, Strides)
    assert isinstance(spread, Strides)
    quality, n = estimate.diagnostics["quality"], len(rows)
    evidence = np.zeros((n, len(EVIDENCE)))
    for name, values in quality.evidence.items():
        evidence[:, EVIDENCE.index(name)] = np.broadcast_to(values, quality.doubt.shape)[rows]
    names = (np.full(n, text, dtype=object) for text in (estimator, group, recording, who))
    return Table(
        *names, as_float(strides.length)[rows] - true, (as_float(spread.length) / quality.factor)[rows],
        np.broadcast_to(np.asarray(reference, float), (n,)), true, evidence,
    )  # fmt: skip


def joined(tables: list[Table]) -> Table:
    """All rows."""
    return Table(*(np.concatenate(columns) for columns in zip(*tables, strict=True)))


def public(quick: bool) -> Iterator[Table]:
    """The strides of all public sets that are here; where a set has one person, its walks stand for people."""
    people: dict[str, set[str]] = {}
    every = list(judged(quick))
    for walk in every:
        people.setdefault(walk.group, set()).add(walk.person)
    for walk in every:
        yield of_judged(walk, walk.recording if len(people[walk.group]) == 1 else walk.person)


def of_judged(walk: Judged, who: str) -> Table:
    """The strides of a public recording."""
    estimator, _, name = walk.group.partition(", ")
    return table(estimator, name, walk.recording, f"{name} {who}", walk.estimate, walk.rows, walk.true, walk.reference)


def beside(estimate: Estimate, truth: Strides, when: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of an estimate's strides, and of the true strides that they are; `when` (n, 2) has their true times."""
    ours = np.asarray(estimate.strides.side)
    pairs = []
    for side in range(len(SIDES)):
        mine = np.flatnonzero((ours == side) & np.asarray(estimate.strides.valid, bool))
        theirs = np.flatnonzero((np.asarray(truth.side) == side) & np.asarray(truth.valid, bool))
        if not len(mine) or not len(theirs):
            continue
        spans = np.stack([as_float(truth.start), as_float(truth.end)], axis=1)[theirs]
        matches = overlapping(spans, when[mine])
        pairs.append(np.stack([mine[matches[:, 1]], theirs[matches[:, 0]]], axis=1))
    both = np.concatenate(pairs) if pairs else np.zeros((0, 2), int)
    return both[:, 0], both[:, 1]


def spans(estimate: Estimate) -> np.ndarray:
    """(n, 2) begin and end of the strides [s]."""
    strides = estimate.strides
    return np.stack([as_float(strides.start), as_float(strides.end)], axis=1)


def walked(gait: str, number: int, seed: int) -> tuple[Recording, Strides, dict[str, dict[str, float]]] | None:
    """A simulated walk, its true strides, and the measures of the person for each estimator."""
    key = jax.random.fold_in(jax.random.key(seed), number)
    who = person(GAITS[gait], simulate.person_of(simulate.population(jax.random.key(seed), 8), number), key)
    made = attempt(f"{gait}, person {number}", lambda: simulated(GAITS[gait], who, key))
    if made is None:
        return None
    body = {name: measures(who.body, estimators.get(name).about) for name in SENSORS}
    return made[0], made[1].estimate.strides, body


def gaits(quick: bool, people: int = 3, seed: int = 70) -> Iterator[Table]:
    """Undamaged simulated walks in all gaits."""
    for gait in list(GAITS)[:1] if quick else GAITS:
        for number in range(1 if quick else people):
            made = walked(gait, number, seed)
            if made is None:
                continue
            recording, truth, body = made
            for name, placements in SENSORS.items():
                part = recording._replace(sensors={place: recording.sensors[place] for place in placements})
                yield from of_walk(name, f"gait {gait}", f"gait {gait} {number}", part, truth, body[name])


def of_walk(
    name: str, group: str, who: str, recording: Recording, truth: Strides, body: dict[str, float],
    true_time: Callable[[np.ndarray], np.ndarray] = np.asarray,
) -> Iterator[Table]:  # fmt: skip
    """The strides of one estimator in one walk; `true_time` maps its times to those of the truth."""
    estimator = estimators.get(name)
    try:
        estimate = estimator.estimate(estimator.with_body(estimator.params, body), recording)
    except RecordingError:
        return
    ours, theirs = beside(estimate, truth, np.stack([true_time(column) for column in spans(estimate).T], axis=1))
    if len(ours):
        yield table(name, group, who, who, estimate, ours, as_float(truth.length)[theirs], 0.0)


def faults(quick: bool, people: int = 3, seed: int = 71) -> Iterator[Table]:
    """Simulated walks with faults, of people who walk as usual or in one of the other gaits."""
    usual = ("usual", "back and forth", "limping", "slow", "fast")
    for number in range(1 if quick else people):
        made = walked(usual[number % len(usual)], number, seed)
        if made is None:
            continue
        for fault in list(FAULTS)[: 3 if quick else None]:
            for name in SENSORS:
                yield from attempt(f"{fault}, {name}", partial(of_fault, fault, name, number, *made)) or []


def of_fault(
    fault: str, name: str, number: int, recording: Recording, truth: Strides, body: dict[str, dict[str, float]]
) -> list[Table]:
    """The strides of one estimator in a walk with a fault; none if the reader refuses the recording."""
    placements = SENSORS[name]
    rows = rows_of(recording, placements)
    draw = np.random.default_rng(zlib.crc32(f"{number} {fault} {name}".encode()))
    try:
        damaged = FAULTS[fault].change(rows, placements[0], draw)
        part = read(damaged, "walk")
    except RecordingError:
        return []
    first = float(as_float(part.sensors[placements[0]].time)[0])

    def true_time(time: np.ndarray) -> np.ndarray:
        return float(rows.time[0]) + damaged.true_time(np.append(first, time))[1:]

    who = f"fault {fault} {number}"
    return list(of_walk(name, f"fault {fault}", who, part, truth, body[name], true_time))
