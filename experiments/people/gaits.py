"""Gaits that are not the usual one: which sensors measure them, and whether wrong results come with a note.

Three people who move as recorded ones do walk in each gait (`simulate.GAITS`) and on each route, with MPU-6000 sensors.
How soft tissue moves is known of usual walking alone, so sensors are fixed to bones. Lengths of the legs and the height
of the waist's sensor are known. A result is wrong if it is more than a tenth and more than three stated deviations off.
Notes of doubt that an estimator also makes about a usual walk, such as clipped signals, do not count.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.common.recordings import attempt
from experiments.common.row import Row, show
from jgait import estimators, simulate
from jgait.estimators.about import About
from jgait.simulate import Body, Person, Route, Truth
from jgait.simulate.person import DEGREE
from jgait.simulate.sensors import MPU6000
from jgait.types import Estimate, Recording

PEOPLE, METRES = 3, 16.0
ESTIMATORS = ("foot_ins", "ankle_stride", "leg_ekf", "waist")
PLACEMENTS = (*simulate.SEVEN, "ankle_right", "ankle_left")
WRONG, DEVIATIONS = 0.1, 3.0
CLIMBING = (("stride_length", 0.62), ("stride_time", 1.2), ("knee_stance", 12.0 * DEGREE))


class Kind(NamedTuple):
    """A gait of `simulate.GAITS`, if it is not the usual one; the route, changed fields of `Gait`, and the breaks [s]
    after which the route is walked again.
    """

    gait: str | None = None
    along: Route = simulate.straight(METRES)
    changes: tuple[tuple[str, float], ...] = ()
    breaks: tuple[float, ...] = ()


def stairs(riser: float) -> Route:
    """Level, stairs with steps of a height [m] for four metres, level."""
    return simulate.route({"length": 2.0}, {"length": 4.0, "riser": riser}, {"length": 3.0})


GAITS = {
    "usual": Kind(),
    **{name.replace("_", " "): Kind(name) for name in simulate.GAITS},
    "very slow": Kind("slow", changes=(("stride_length", 0.55), ("stride_time", 2.2))),
    "very slow for a while": Kind(along=simulate.faster(6.0, 1.0, 0.15, 1.0)),
    "limping strongly": Kind("limping", changes=(("length_asymmetry", 0.3), ("time_asymmetry", 0.25))),
    "uphill 10 %": Kind(along=simulate.route({"length": METRES, "slope": 0.1})),
    "downhill 10 %": Kind(along=simulate.route({"length": METRES, "slope": -0.1})),
    "stairs up": Kind(along=stairs(0.17), changes=CLIMBING),
    "stairs down": Kind(along=stairs(-0.17), changes=CLIMBING),
    "back and forth": Kind(along=simulate.u_turn(8.0, 0.3)),
    "turn on the spot": Kind(along=simulate.about_turn(8.0)),
    "in a circle of 1 m": Kind(along=simulate.circle(1.0, 3.0)),
    "with breaks": Kind(along=simulate.straight(5.0), breaks=(2.0, 8.0)),
}


class Walked(NamedTuple):
    """Distance by one estimator in one walk: error and stated deviation over the true one [1], and codes of doubts."""

    error: float
    stated: float
    notes: tuple[str, ...]

    @property
    def wrong(self) -> bool:
        """Whether it is off by more than `WRONG` and by more than `DEVIATIONS`."""
        return not abs(self.error) <= max(WRONG, DEVIATIONS * self.stated)


def person(kind: Kind, drawn: Person, key: Any) -> Person:
    """A drawn person in a gait, with strides that cover the route."""
    who = drawn if kind.gait is None else simulate.walking(drawn, kind.gait)
    return simulate.covering(
        key, Person(who.body, who.gait._replace(**{"soft_tissue": 0.0, **dict(kind.changes)})), kind.along
    )


def simulated(kind: Kind, who: Person, key: Any) -> tuple[Recording, Truth]:
    """One walk."""
    if kind.breaks:
        ways = [kind.along] * (len(kind.breaks) + 1)
        return simulate.with_breaks(key, who, ways, kind.breaks, MPU6000, placements=PLACEMENTS)
    return simulate.recording(key, who, kind.along, MPU6000, placements=PLACEMENTS)


def measures(body: Body, about: About) -> dict[str, float]:
    """What a lab measures of a person, as far as an estimator takes it [m]."""
    known = {name: float(getattr(body, name)) for name in ("thigh_length", "shank_length")}
    taken = {measure.name for measure in about.measures}
    return {
        name: value for name, value in {**known, "sensor_height": float(body.sensor_height)}.items() if name in taken
    }


def stated(estimate: Estimate) -> float:
    """Standard deviation of the distance [m]."""
    return float(np.ravel(estimate.diagnostics["distance_stddev"])[-1])


def doubts(notes: Any) -> tuple[str, ...]:
    """Codes of the notes that put a result in doubt."""
    return tuple(note.code for note in notes if note.severity in ("stop", "check"))


def walks(names: list[str], people: int) -> Iterator[tuple[str, str, Walked]]:
    """Gait, estimator and error of every walk."""
    drawn = simulate.population(jax.random.key(50), people, recorded=True)
    for name in names:
        kind = GAITS[name]
        for number in range(people):
            key = jax.random.fold_in(jax.random.key(51), number)
            who = person(kind, simulate.person_of(drawn, number), key)
            made = attempt(
                f"{name}, person {number + 1}",
                lambda key=key, who=who, kind=kind: simulated(kind, who, key),
            )
            if made is None:
                continue
            recording, truth = made
            true = float(truth.estimate.distance[-1])
            for one in ESTIMATORS:
                estimator = estimators.get(one)
                p = estimator.with_body(estimator.params, measures(who.body, estimator.about))
                found = attempt(f"{one}, {name}", lambda e=estimator, p=p, r=recording: e.estimate(p, r))
                if found is not None:
                    error = float(found.distance[-1]) / true - 1.0
                    yield name, one, Walked(error, stated(found) / true, doubts(found.diagnostics["notes"]))


def rows(quick: bool) -> list[Row]:
    """Of every gait."""
    names = list(GAITS)[:2] if quick else list(GAITS)
    found: dict[tuple[str, str], list[Walked]] = {}
    for name, one, walked in walks(names, 1 if quick else PEOPLE):
        usual = {code for other in found.get(("usual", one), []) for code in other.notes} if name != "usual" else ()
        kept = tuple(code for code in walked.notes if code not in usual)
        found.setdefault((name, one), []).append(walked._replace(notes=kept))
    lines, every = [], [walked for each in found.values() for walked in each]
    for name in names:
        line = [name]
        for one in ESTIMATORS:
            of = found.get((name, one), [])
            worst = max(of, key=lambda walked: abs(walked.error), default=None)
            mark = "" if worst is None or not worst.wrong else " noted" if worst.notes else " SILENT"
            line.append("refused" if worst is None else f"{100.0 * worst.error:+.0f}{mark}")
        lines.append(line)
    show("Worst error of the distance of three people (%)", ["gait", *ESTIMATORS], lines)
    silent, wrong = (
        100.0 * float(np.mean([walked.wrong and not (quiet and walked.notes) for walked in every]))
        for quiet in (True, False)
    )
    split = f"more than {100.0 * WRONG:g} % and {DEVIATIONS:g} stated deviations off; {len(names)} gaits"
    line = "distances of unusual gaits that are wrong"
    return [
        Row("gaits_wrong_pct", wrong, "%", None, len(every), split).on(line, "", "distances", simulated=True),
        Row("gaits_silent_pct", silent, "%", None, len(every), split).on(
            line, "without a note", "distances", simulated=True
        ),
    ]
