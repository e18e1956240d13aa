"""Whether errors on simulated people predict those on recorded ones: foot, ankle, shank, waist and legs.

Simulated people move as recorded ones do (`simulate.population(recorded=True)`) with Opal sensors, on shoes those of
`ON_SHOE`, on a straight way as long as that of the recorded walks. The same measures are taken of them as stand in the
table of all experiments for the recordings. Where a reference has an error of its own, the simulated one errs as much.
A factor is the larger of both numbers over the smaller.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.common import summary
from experiments.common.matching import nearest
from experiments.common.recordings import attempt
from experiments.common.row import Row, show
from experiments.silva2017.lever import REFERENCE_SD
from experiments.unseen.legs import REFERENCE_SD as DISTANCE_SD
from jgait import simulate
from jgait.estimators import ankle_stride, foot_ins, leg_ekf, waist
from jgait.evaluate.windows import judge
from jgait.simulate import Person, Truth
from jgait.simulate.sensors import ON_SHOE, OPAL
from jgait.types import SIDES, Estimate, Recording, as_float

SHOES = ("foot_right", "foot_left")
PLACEMENTS = ("thigh_right", "thigh_left", "shank_right", "shank_left", "ankle_right", "ankle_left", "lower_back")
RATE_HZ, LONG, SHORT = 100.0, 20.0, 5.0
"""[Hz] Of most sets; [m] ways of most sets and of `walking5m`."""
SAME_S, SHORTEST = 0.3, 0.5
"""[s] Largest difference of the ends of a stride and of its reference; [m] shortest stride that counts."""


class Walked(NamedTuple):
    """A simulated walk."""

    person: Person
    recording: Recording
    truth: Truth


class Compared(NamedTuple):
    """Errors and stated deviations of one number, of all walks (n,)."""

    error: np.ndarray
    stated: np.ndarray


def walked(people: int, metres: float) -> list[Walked]:
    """Walks of people drawn anew; one who cannot walk like that is left out, and printed."""
    drawn, along = simulate.population(jax.random.key(31), people, recorded=True), simulate.straight(metres)

    def one(i: int) -> Walked:
        key = jax.random.fold_in(jax.random.key(32), i)
        person = simulate.covering(key, simulate.person_of(drawn, i), along)
        recording, truth = simulate.recording(key, person, along, OPAL, RATE_HZ, placements=PLACEMENTS)
        shoes, _ = simulate.recording(key, person, along, ON_SHOE, RATE_HZ, placements=SHOES)
        return Walked(person, recording._replace(sensors=recording.sensors | shoes.sensors), truth)

    found = (attempt(f"simulated person {i + 1}, {metres:g} m", lambda i=i: one(i)) for i in range(people))
    return [walk for walk in found if walk is not None]


def strides(estimator: Any, p: Any, placement: str, deviation: float, walks: Sequence[Walked]) -> Compared:
    """Lengths [m] of strides by one sensor of each leg, beside a reference that errs by a deviation [m]."""
    rng, error, stated = np.random.default_rng(7), [], []
    for walk in walks:
        for number, side in enumerate(SIDES):
            name = f"{placement}_{side}"
            alone = walk.recording._replace(sensors={name: walk.recording.sensors[name]})
            found, true = estimator.estimate(p, alone), walk.truth.strides
            counts = np.asarray(true.valid) & (np.asarray(true.side) == number) & (as_float(true.length) > SHORTEST)
            end, length = (as_float(values)[counts] for values in (true.end, true.length))
            for i, j in nearest(as_float(found.strides.end), end, SAME_S):
                error.append(float(found.strides.length[i]) - length[j] + deviation * rng.standard_normal())
                stated.append(np.hypot(float(found.strides_stddev.length[i]), deviation))
    return Compared(np.array(error), np.array(stated))


def distances(estimates: Sequence[Estimate], walks: Sequence[Walked], deviation: float) -> Compared:
    """Relative errors of distances, beside a reference that errs by a relative deviation."""
    rng = np.random.default_rng(8)
    ratio, stated = np.array([
        [float(value[-1]) / float(walk.truth.estimate.distance[-1])
         for value in (one.distance, one.diagnostics["distance_stddev"])]
        for one, walk in zip(estimates, walks, strict=True)
    ]).T  # fmt: skip
    return Compared(ratio - 1.0 + deviation * rng.standard_normal(len(walks)), np.hypot(stated, deviation))


def of_waist(walks: Sequence[Walked]) -> tuple[Compared, Compared]:
    """Times of contacts [s] and distances, with a constant that is learned on the other people."""
    estimates, late = [], []
    for walk in walks:
        p = waist.with_body(waist.WaistParams(), {"sensor_height": float(walk.person.body.sensor_height)})
        alone = walk.recording._replace(sensors={"lower_back": walk.recording.sensors["lower_back"]})
        estimates.append((alone, p, waist.estimate(p, alone)))
        true = walk.truth.strides
        pairs = nearest(as_float(estimates[-1][2].strides.end), as_float(true.end)[np.asarray(true.valid)], SAME_S)
        end = as_float(true.end)[np.asarray(true.valid)]
        late += [float(estimates[-1][2].strides.end[i]) - end[j] for i, j in pairs]
    ratio = np.array([float(w.truth.estimate.distance[-1]) / float(e.distance[-1])
                      for w, (*_, e) in zip(walks, estimates, strict=True)])  # fmt: skip
    learned = [float(np.exp(np.mean(np.log(np.delete(ratio, i))))) for i in range(len(walks))]
    again = [
        waist.estimate(p._replace(pendulum_constant=p.pendulum_constant * factor), alone)
        for factor, (alone, p, _) in zip(learned, estimates, strict=True)
    ]
    # As for the recordings, the median delay is no error.
    times = np.array(late) - np.median(late)
    return Compared(times, np.full(times.size, np.nan)), distances(again, walks, 0.0)


def of_legs(walks: Sequence[Walked]) -> tuple[list[Estimate], dict[str, float]]:
    """Estimates, and root mean square errors of hip and knee [°], medians over legs."""
    estimates, found = [], {"hip_deg": [], "knee_deg": []}
    for walk in walks:
        body, gait = walk.person
        lengths = {"thigh_length": body.thigh_length, "shank_length": body.shank_length}
        sensors = {name: walk.recording.sensors[name] for name in simulate.FOUR}
        p = leg_ekf.with_body(leg_ekf.LegParams(), lengths)
        estimates.append(leg_ekf.estimate(p, walk.recording._replace(sensors=sensors)))
        still = round(RATE_HZ * float(gait.quiet_before))
        judged = judge(estimates[-1], walk.truth.estimate, (still, walk.truth.estimate.time.size), (0, still))
        for name, values in found.items():
            values += [judged.rmse[side][name] for side in SIDES]
    return estimates, {name: float(np.median(values)) for name, values in found.items()}


class Line(NamedTuple):
    """A number of simulated people beside those of recordings, by their metrics in the table of all experiments."""

    estimator: str
    what: str
    unit: str
    value: float
    metrics: tuple[str, ...]
    coverage: bool = False


def within(found: Compared) -> float:
    """Share within two stated deviations [%]."""
    return 100.0 * float(np.mean(np.abs(found.error) <= 2.0 * found.stated))


def lines(people: int) -> list[Line]:
    """Of all estimators."""
    far, near = walked(people, LONG), walked(people, SHORT)
    foot, ankle = (foot_ins, foot_ins.FootParams()), (ankle_stride, ankle_stride.AnkleParams())
    sets: list[tuple[str, Callable[[], Compared], tuple[str, ...], tuple[str, ...]]] = [
        ("foot", lambda: strides(*foot, "foot", 0.0, far), ("gaitmap_example", "neura_sparse", "footprints"),
         ("foot_stride_mae_cm_{}", "within_two_sigma_pct_foot_ins_{}")),
        ("ankle", lambda: strides(*ankle, "ankle", 0.0, far), ("neura_ankle",), ("{}_stride_mae_cm",)),
        ("shank", lambda: strides(*ankle, "shank", 0.0, far), ("neura_shank",), ("{}_stride_mae_cm",)),
        ("shank, 5 m", lambda: strides(*ankle, "shank", REFERENCE_SD["walking5m"], near), ("walking5m",),
         ("{}_stride_mae_cm", "within_two_sigma_pct_ankle_stride_{}")),
    ]  # fmt: skip
    found = []
    for name, call, where, metrics in sets:
        one = call()
        mae = 100.0 * float(np.abs(one.error).mean())
        for metric in metrics:
            covers = metric.startswith("within")
            value = within(one) if covers else mae
            about = ("strides within 2σ", "%") if covers else ("stride length, mean error", "cm")
            found.append(Line(name, *about, value, tuple(metric.format(part) for part in where), covers))
    times, ways = of_waist(far)
    _, angles = of_legs(far)
    legs = distances(of_legs(near)[0], near, DISTANCE_SD)
    percent, sides = 100.0 * float(np.abs(ways.error).mean()), ("right", "left")
    return [
        *found,
        Line("waist", "contacts, mean error", "ms", 1e3 * float(np.abs(times.error).mean()), ("ic_mae_ms_ipol_gait",)),
        Line("waist", "distance, mean error", "%", percent, ("waist_distance_pct",)),
        Line("waist", "distance within 2σ", "%", within(ways), ("waist_two_sigma_pct",), True),
        *(Line("legs", f"{name[:-4]}, RMS error", "deg", value, tuple(f"default_straight_{name}_{s}" for s in sides))
          for name, value in angles.items()),
        Line("legs, 5 m", "distance, mean error", "%", 100.0 * float(np.abs(legs.error).mean()), ("leg_distance_pct",)),
        Line("legs, 5 m", "distance within 2σ", "%", within(legs), ("leg_within_two_sigma_both_pct",), True),
    ]  # fmt: skip


def rows(quick: bool) -> list[Row]:
    """Every number of simulated people over that of recordings; the largest factors."""
    people = 2 if quick else 16
    known = {row["metric"]: row["value"] for one in summary.load().values() for row in one["rows"]}
    cells, factors = [], {False: [], True: []}
    for line in lines(people):
        recorded = [known[metric] for metric in line.metrics if metric in known]
        if not recorded:
            continue
        mean = float(np.mean(recorded))
        cells.append([line.estimator, f"{line.what}, {line.unit}", line.value, mean, line.value / mean])
        factors[line.coverage].append((abs(np.log(line.value / mean)), f"{line.estimator}: {line.what}"))
    show(f"{people} simulated people and recorded ones", ["", "", "simulated", "recorded", "ratio"], cells)
    found = []
    for coverage, of in factors.items():
        size, which = max(of)
        metric, part = ("prediction_coverage_factor", "coverage") if coverage else ("prediction_factor", "error")
        split = f"{people} simulated people; worst of {len(of)}: {which}"
        row = Row(metric, float(np.exp(size)), "ratio", None, len(of), split)
        found.append(row.on("estimators on simulated people over recorded ones, worst factor", part, "numbers"))
        middle = float(np.exp(np.median([one for one, _ in of])))
        found.append(Row(f"{metric}_median", middle, "ratio", None, len(of), split).on(
            "estimators on simulated people over recorded ones, median factor", part, "numbers"))  # fmt: skip
    return found
