"""Whether errors on simulated people predict those on recorded ones: foot, ankle, shank, waist and legs.

Simulated people move as recorded ones do (`simulate.population(recorded=True)`) with sensors of `WORN`, on shoes those
of `ON_SHOE`, at the places and on the ways of the recorded ones; what is learned for recordings is learned here, too.
The same measures are taken of them as stand in the table of all experiments for the recordings. Where a reference has
an error of its own, the simulated one errs as much: the waist's distances are compared with those of the shoes, as in
`ipol_gait`. A factor is the larger of both numbers over the smaller.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.common import summary
from experiments.common.matching import nearest
from experiments.common.recordings import attempt, available
from experiments.common.row import Row, show
from experiments.common.sets import datasets
from experiments.common.shanks import Leg, Reference, rested
from experiments.common.windows import judge
from experiments.kose2011 import contacts
from experiments.kose2011.walks import Walk as WaistWalk
from experiments.kose2011.walks import there_and_back
from experiments.silva2017.lever import (
    AT_ANKLE,
    BOTH_LEVERS,
    LEVERS,
    REFERENCE_SD,
    lever_of,
    prepared,
    references,
    run,
    together,
)
from experiments.simulator.simulated import SETS, Set
from experiments.unseen import waist
from experiments.unseen.legs import REFERENCE_SD as DISTANCE_SD
from jgait import simulate
from jgait.estimators import foot_ins, leg_ekf
from jgait.geometry.vectors import GRAVITY
from jgait.mounting import shank as shank_axes
from jgait.simulate import Body, Person, Route, Truth
from jgait.simulate.sensors import ON_SHOE, OPAL
from jgait.types import SIDES, Estimate, Recording, Walk, as_float

SHOES = ("foot_right", "foot_left")
PLACEMENTS = ("thigh_right", "thigh_left", "shank_right", "shank_left", "ankle_right", "ankle_left", "lower_back")
RATE_HZ = 100.0
"""[Hz] Of most sets."""
LONG, SHORT = simulate.straight(20.0), simulate.straight(5.0)
"""Ways of most sets and of `walking5m`."""
BACK = simulate.about_turn(10.0)
"""The way of `ipol_gait`."""
TURN = {"length": 2.6, "turn": math.pi, "on_spot": 0.54}
NEURA, STANDS = simulate.route({"length": 3.3}, TURN, {"length": 4.2}), 9.0
"""The way of `neura_sparse`, whose pelvis moves 1.2 m in the turn; [s] standing before it."""
WORN = OPAL._replace(acc_noise=0.02, acc_bias=0.1, acc_range=16.0 * GRAVITY, acc_resolution=32.0 / 2**16 * GRAVITY)
"""Sensors on legs and back: accelerometers as recorded ones of `neura_sparse`, `walking5m` and `tripod` are at rest
(`at_rest`)."""
UNLIKE = 0.0275
"""[m] Standard deviation of the height of the shank's sensor over people of `walking5m` (`people.mounts`, young), taken
for that of the thigh's sensor, too, which changes no result: its gyroscope alone counts."""
CONTACT_SD, STATURE = 0.012, 1.75
"""[s] Standard deviation of the checked contacts of `ipol_gait` (`kose2011.contacts`); [m] of the usual body."""
STILL = 0.02
"""[rad/s] Deviation of the rate of a sensor that does not move."""
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


def at_rest() -> list[list[Any]]:
    """Of sets: sensors, how far the size of the specific force is from gravity, and its noise, in the stillest second
    (root of the mean square and median) [m/s²]."""
    found = []
    for name in filter(available, ("neura_sparse", "walking5m", "tripod")):
        bias, noise = [], []
        for walk in datasets.load(name):
            for imu in walk.recording.sensors.values():
                length, (acc, gyr) = round(walk.recording.sampling_rate_hz), map(np.asarray, (imu.acc, imu.gyr))
                parts = [slice(i, i + length) for i in range(0, len(acc) - length, length // 2)]
                still = min(parts, key=lambda part: np.nan_to_num(gyr[part].std(axis=0).max(), nan=np.inf))
                if gyr[still].std(axis=0).max() < STILL:
                    bias.append(np.linalg.norm(acc[still].mean(axis=0)) - GRAVITY)
                    noise.append(np.diff(acc[still], axis=0).std() / math.sqrt(2.0))
        found.append([name, len(bias), float(np.sqrt(np.mean(np.square(bias)))), float(np.median(noise))])
    return found


def places(number: int, body: Body, given: Set) -> dict[str, list[float]]:
    """Where a person wears the sensors on thighs and shanks: as people of a set do."""
    draws = iter(np.random.default_rng([33, number]).standard_normal(4))
    higher = UNLIKE if given.name == "walking5m" else 0.0
    usual = ("thigh", given.thigh, body.thigh_length), ("shank", given.shank, body.shank_length)
    return {
        f"{segment}_{side}": [ahead, 0.0, higher * float(next(draws)) - down * float(length)]
        for segment, (ahead, down), length in usual for side in SIDES
    }  # fmt: skip


def walked(people: int, along: Route, stands: float | None = None, given: Set | None = None) -> list[Walked]:
    """Walks of people drawn anew, who stand for a time before [s] and wear sensors on legs where those of a set do; one
    who cannot walk like that is left out, and printed."""
    drawn = simulate.population(jax.random.key(31), people, recorded=True)

    def one(i: int) -> Walked:
        key = jax.random.fold_in(jax.random.key(32), i)
        person = simulate.covering(key, simulate.person_of(drawn, i), along)
        if stands is not None:
            person = person._replace(gait=person.gait._replace(quiet_before=stands))
        worn = None if given is None else places(i, person.body, given)
        recording, truth = simulate.recording(key, person, along, WORN, RATE_HZ, placements=PLACEMENTS, places=worn)
        shoes, _ = simulate.recording(key, person, along, ON_SHOE, RATE_HZ, placements=SHOES)
        return Walked(person, recording._replace(sensors=recording.sensors | shoes.sensors), truth)

    found = (attempt(f"simulated person {i + 1}", lambda i=i: one(i)) for i in range(people))
    return [walk for walk in found if walk is not None]


def strides(walks: Sequence[Walked]) -> Compared:
    """Lengths [m] of strides by one sensor on each shoe."""
    error, stated = [], []
    for walk in walks:
        for number, side in enumerate(SIDES):
            name = f"foot_{side}"
            alone = walk.recording._replace(sensors={name: walk.recording.sensors[name]})
            found, true = foot_ins.estimate(foot_ins.FootParams(), alone), walk.truth.strides
            counts = np.asarray(true.valid) & (np.asarray(true.side) == number) & (as_float(true.length) > SHORTEST)
            end, length = (as_float(values)[counts] for values in (true.end, true.length))
            for i, j in nearest(as_float(found.strides.end), end, SAME_S):
                error.append(float(found.strides.length[i]) - length[j])
                stated.append(float(found.strides_stddev.length[i]))
    return Compared(np.array(error), np.array(stated))


def shanks(group: str, walks: Sequence[Walked], deviation: float = 0.0) -> Compared:
    """Lengths [m] of strides by one sensor on each shank or at each ankle, as those of a set (`silva2017.lever`).

    The lever is learned on the person's other leg, or on other people in `walking5m`; the reference errs by a
    deviation [m].
    """
    rng, legs = np.random.default_rng(7), []
    placement = "ankle" if group in AT_ANKLE else "shank"
    for person, walk in enumerate(walks):
        strides = walk.truth.strides
        for number, side in enumerate(SIDES):
            rows = np.asarray(strides.valid) & (np.asarray(strides.side) == number)
            begin, end, length = (as_float(part)[rows] for part in (strides.start, strides.end, strides.length))
            length = length + deviation * rng.standard_normal(length.size)
            imu = rested(walk.recording.sensors[f"{placement}_{side}"], RATE_HZ)
            axes = shank_axes.functional_axes(imu)
            if axes is not None:
                true = Reference(end, length, begin, None, (0.0, float(imu.time[-1])))
                legs.append(Leg(group, f"{person}", f"{person}", side, imu, axes, RATE_HZ, None, true, ()))
    inputs = together([prepared(leg, np.zeros(3), np.eye(3)) for leg in legs])
    true, full = references(legs, inputs)
    people, sides = (np.array([getattr(leg, name) for leg in legs]) for name in ("subject", "side"))
    same = people[:, None] == people
    teaches = ~same if group == "walking5m" else same & (sides[:, None] != sides)
    pair = LEVERS.get(group, BOTH_LEVERS)
    told = [run(group, np.full(len(legs), lever), inputs)["length"] for lever in pair]
    found = run(group, np.array([lever_of(pair, told, true, full & one[:, None]) for one in teaches]), inputs)
    return Compared((found["length"] - true)[full], np.hypot(found["sd"], deviation)[full])


def distances(estimates: Sequence[Estimate], walks: Sequence[Walked], deviation: float) -> Compared:
    """Relative errors of distances, beside a reference that errs by a relative deviation."""
    rng = np.random.default_rng(8)
    ratio, stated = np.array([
        [float(value[-1]) / float(walk.truth.estimate.distance[-1])
         for value in (one.distance, one.diagnostics["distance_stddev"])]
        for one, walk in zip(estimates, walks, strict=True)
    ]).T  # fmt: skip
    return Compared(ratio - 1.0 + deviation * rng.standard_normal(len(walks)), np.hypot(stated, deviation))


def checked(walk: Walked, number: int) -> WaistWalk:
    """A walk out and back as those of `ipol_gait`, with the stature as the only measure of the body."""
    strides, estimate = walk.truth.strides, walk.truth.estimate
    rows = np.asarray(strides.valid)
    side, leaves, lands = (np.asarray(each)[rows] for each in (strides.side, strides.final_contact, strides.end))
    lands = lands + CONTACT_SD * np.random.default_rng(number).standard_normal(lands.size)
    turned = np.abs(as_float(estimate.diagnostics["heading"])) / math.pi
    begins, ends = (float(np.interp(share, turned, as_float(estimate.time))) for share in (0.05, 0.95))
    bout = {"start": lands[:1], "end": lands[-1:]}
    info = {
        "initial_contacts": lands, "initial_contact_sides": side, "final_contacts": leaves,
        "final_contact_sides": side, "bouts": bout, "turns": {"start": np.array([begins]), "end": np.array([ends])},
        "straight_parts": np.array([(lands[0], begins), (ends, lands[-1])]),
        "height": STATURE * float(np.mean(np.divide(walk.person.body, Body()))),
    }  # fmt: skip
    sensors = {name: walk.recording.sensors[name] for name in ("lower_back", *SHOES)}
    recording = walk.recording._replace(sensors=sensors, subject=str(number))
    return there_and_back(Walk(recording, None, info))


def of_waist(walks: Sequence[WaistWalk]) -> dict[str, float]:
    """The numbers of `unseen` on walks, by their names there: of people left out."""
    return {
        "waist_ic_mae_ms": waist.timing(walks, [contacts.detected(walk) for walk in walks]).left_out,
        **{name: pair.left_out for name, pair in waist.ways(walks)[0].items()},
    }


def estimated(walk: Walked) -> Estimate:
    """By thighs and shanks, with the person's lengths."""
    body = walk.person.body
    lengths = {"thigh_length": body.thigh_length, "shank_length": body.shank_length}
    sensors = {name: walk.recording.sensors[name] for name in simulate.FOUR}
    p = leg_ekf.with_body(leg_ekf.LegParams(), lengths)
    return leg_ekf.estimate(p, walk.recording._replace(sensors=sensors))


def of_legs(walks: Sequence[Walked]) -> dict[str, float]:
    """Root mean square errors of hip and knee on the way out [°], medians over legs."""
    found: dict[str, list[float]] = {"hip_deg": [], "knee_deg": []}
    for walk in walks:
        estimate, true = estimated(walk), walk.truth.estimate
        still = round(RATE_HZ * float(walk.person.gait.quiet_before))
        turns = int(np.searchsorted(np.abs(as_float(true.diagnostics["heading"])), 0.05 * math.pi))
        judged = judge(estimate, true, (still, turns), (0, still))
        for name, values in found.items():
            values += [judged.rmse[side][name] for side in SIDES]
    return {name: float(np.median(values)) for name, values in found.items()}


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
    far, near = walked(people, LONG), walked(people, SHORT, given=SETS[-1])
    turning = walked(people, NEURA, STANDS, SETS[0])
    sets: list[tuple[str, Callable[[], Compared], tuple[str, ...], tuple[str, ...]]] = [
        ("foot", lambda: strides(far), ("gaitmap_example", "neura_sparse", "footprints"),
         ("foot_stride_mae_cm_{}", "within_two_sigma_pct_foot_ins_{}")),
        ("ankle", lambda: shanks("neura_ankle", turning), ("neura_ankle",), ("{}_stride_mae_cm",)),
        ("shank", lambda: shanks("neura_shank", turning), ("neura_shank",), ("{}_stride_mae_cm",)),
        ("shank, 5 m", lambda: shanks("walking5m", near, REFERENCE_SD["walking5m"]), ("walking5m",),
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
    back = of_waist([checked(walk, i) for i, walk in enumerate(walked(people, BACK))])
    angles = of_legs(turning)
    legs, sides = distances([estimated(walk) for walk in near], near, DISTANCE_SD), ("right", "left")
    return [
        *found,
        *(Line("waist", what, unit, back[name], (name,), "σ" in what) for name, what, unit in (
            ("waist_ic_mae_ms", "contacts, mean error", "ms"), ("waist_distance_pct", "distance, mean error", "%"),
            ("waist_two_sigma_pct", "distance within 2σ", "%"),
        )),
        *(Line("legs", f"{name[:-4]}, RMS error", "deg", value, tuple(f"default_straight_{name}_{s}" for s in sides))
          for name, value in angles.items()),
        Line("legs, 5 m", "distance, mean error", "%", 100.0 * float(np.abs(legs.error).mean()), ("leg_distance_pct",)),
        Line("legs, 5 m", "distance within 2σ", "%", within(legs), ("leg_within_two_sigma_both_pct",), True),
    ]  # fmt: skip


def rows(quick: bool) -> list[Row]:
    """Every number of simulated people over that of recordings; the largest factors."""
    people = 2 if quick else 48
    known = {row["metric"]: row["value"] for one in summary.load().values() for row in one["rows"]}
    if not quick:
        show("Recorded accelerometers at rest, m/s²", ["set", "n", "bias", "noise"], at_rest())
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
