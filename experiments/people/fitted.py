"""Walkers fitted to recordings (`experiments.common.fitting`): what do sensors read that the fit did not see?

Sensors on thighs and shanks are fitted; those on ankles and feet are predicted, and compared with what was recorded in
the same strides, in the first harmonics of the stride. Beside the fitted walker stands the usual one at this stride: it
has the mean manner of recorded people. A share that is not explained is a root mean square difference over the root
mean square variation of the signal in the stride.
"""

from collections.abc import Iterator
from typing import NamedTuple

import jax
import numpy as np

from experiments.common.fitting import LOW, PersonFit, StrideSignals, fitted, mean_strides, unexplained, virtual
from experiments.common.recordings import attempt, available, walks
from experiments.common.row import Row, show
from jgait import simulate
from jgait.simulate import Person
from jgait.simulate.sensors import OPAL
from jgait.types import Recording

OTHERS = ("ankle_right", "ankle_left", "foot_right", "foot_left")
SETS = ("neura_sparse", "walking5m")
METRES = 12.0


class Predicted(NamedTuple):
    """Of a sensor that was not fitted: unexplained shares of rates and forces [1], and the correlation of rates [1]."""

    gyr: float
    acc: float
    correlation: float


def usual(fit: PersonFit) -> Person:
    """The usual person at the stride of a fitted one."""
    gait = fit.person.gait
    same = {name: getattr(gait, name) for name in ("stride_length", "stride_time", "right_first")}
    return Person(fit.person.body, simulate.RECORDED._replace(**same, soft_tissue=1.0))


def predicted(person: Person, late: float, seen: dict[str, StrideSignals]) -> dict[str, Predicted]:
    """Sensor → how well a person's stride, which begins late [s], predicts the recorded one."""
    made = virtual(person, tuple(seen), late / float(person.gait.stride_time))
    found = {}
    for name, own in seen.items():
        ours, theirs = (StrideSignals(*(np.asarray(part)[None] for part in one)) for one in (made[name], own))
        shares, turn = (np.asarray(part) for part in unexplained(ours, theirs))
        rates = [(LOW @ part[0]) - part[0].mean(axis=0) for part in (ours.gyr @ turn[0].T, theirs.gyr)]
        found[name] = Predicted(*map(float, np.sqrt(shares[:, 0])), float(np.corrcoef(*map(np.ravel, rates))[0, 1]))
    return found


def recorded() -> Iterator[tuple[str, Recording, dict[str, float] | None]]:
    """Set, recording with sensors on both legs, and the lengths of the legs [m], if known."""
    for name in SETS:
        for walk in walks(name) if available(name) else ():
            crossed = {one for pair in walk.info.get("misplaced", ()) for one in pair}
            if set(simulate.FOUR) <= set(walk.recording.sensors) - crossed:
                lengths = np.mean(list(walk.info["lengths"].values()), axis=0)
                yield (
                    name,
                    walk.recording,
                    dict(zip(("thigh_length", "shank_length"), map(float, lengths), strict=True)),
                )


def simulated(people: int) -> Iterator[tuple[str, Recording, dict[str, float] | None]]:
    """The same of simulated people in styles of their own."""
    drawn, along = simulate.population(jax.random.key(40), people, recorded=True), simulate.straight(METRES)
    for i in range(people):
        key = jax.random.fold_in(jax.random.key(41), i)
        person = simulate.covering(key, simulate.person_of(drawn, i), along)
        placements = (*simulate.FOUR, *OTHERS)
        body = {name: float(getattr(person.body, name)) for name in ("thigh_length", "shank_length")}
        yield "simulated", simulate.recording(key, person, along, OPAL, placements=placements)[0], body


def judged(recording: Recording, body: dict[str, float] | None) -> list[dict[str, Predicted]]:
    """Sensor → prediction by the fitted walker, and by the usual one."""
    sensors = recording.sensors
    fit = fitted(recording._replace(sensors={name: sensors[name] for name in simulate.FOUR}), body)
    others = {name: sensors[name] for name in OTHERS if name in sensors}
    seen = mean_strides(recording._replace(sensors=others), fit.strides)
    return [predicted(person, fit.late, seen) for person in (fit.person, usual(fit))]


def rows(quick: bool) -> list[Row]:
    """Of simulated people, and of every set."""
    cases = [*simulated(1 if quick else 8), *(() if quick else recorded())]
    pooled: dict[tuple[str, str], list[tuple[Predicted, Predicted]]] = {}
    for name, recording, body in cases:
        both = attempt(f"{name}: {recording.name}", lambda recording=recording, body=body: judged(recording, body))
        for sensor in both[0] if both else ():
            pooled.setdefault((name, sensor.split("_")[0]), []).append((both[0][sensor], both[1][sensor]))
    found, lines = [], []
    for (name, sensor), pairs in pooled.items():
        ours, theirs = np.median(np.array(pairs), axis=0)
        worst = float(np.array(pairs)[:, 0, 0].max())
        lines.append([name, sensor, len(pairs), *map(float, ours), *map(float, theirs), worst])
        line = f"walker fitted to thighs and shanks, sensor on the {sensor} predicted, {name}: unexplained share"
        for kind, k in (("gyr", 0), ("acc", 1)):
            for part, values in (("", ours), ("usual", theirs)):
                metric = "_".join(filter(None, ("fitted", name, sensor, kind, part)))
                row = Row(metric, float(values[k]), "1", None, len(pairs), "median; the sensor was not fitted")
                words = f"{'rate' if k == 0 else 'force'}{', usual walker' if part else ''}"
                found.append(row.on(line, words, "sensors", simulated=name == "simulated"))
    columns = ["", "sensor", "n", "rate", "force", "correlation", "rate, usual", "force", "correlation", "worst rate"]
    show("Sensors that the fit did not see, medians: unexplained shares", columns, lines)
    return found
