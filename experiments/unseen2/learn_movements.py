"""Learn the numbers of `jgait.events.movement`: weights of evidence, from movements and walks whose kind is known.

`python -m experiments.unseen2.learn_movements` writes `jgait/events/movements.json`. Other movements are those of
`bodies.CHOSEN`, with seeds that the measurement does not use; walks are public ones, and simulated ones of all gaits,
down to creeping with steps of 0.1 m. Each kind beside walking, and in it each set and each recording, has the same
weight. A weight has the sign that `SIGNS` states, or is 0. One trial of `pyshoe_vicon`, whose foot stays in its
place, is left out.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from scipy.optimize import minimize

import jgait
from experiments.common.recordings import available, names, walks
from experiments.unseen2.bodies import CHOSEN, readings
from experiments.unseen2.movements import ACC_NOISE, GYR_BIAS, GYR_NOISE, RATE_HZ, SETS
from jgait import simulate
from jgait.events.movement import EVIDENCE, KINDS, LEVERS, of_leg, of_trunk, segment_of
from jgait.mounting.shank import filled
from jgait.simulate.gaits import GAITS
from jgait.simulate.sensors import MPU6000
from jgait.types import Imu, Strides, as_float

KIND_OF = {
    "stepping in place": "in_place", "knee bends": "without_steps", "chairs": "without_steps",
    "cycling": "cycling", "ride": "riding",
}  # fmt: skip
"""Movement of `CHOSEN` → its kind of `KINDS`."""

SIGNS = {"leg": (-1, -1, 1, -1, 0, -1, 1), "trunk": (-1, -1, 0, 1, 1, 0, -1, -1)}
"""Sign of what more of each evidence of `EVIDENCE` means for other movements beside walking; 0: either."""

SEEDS, PEOPLE, LONGEST_S = 5, 12, 90.0
"""Number of draws of each movement, and of simulated people; [s] part of a recording that is used."""

CREEPING = ((0.1, 0.2), (0.12, 0.25), (0.15, 0.3), (0.2, 0.3), (0.2, 0.4), (0.25, 0.4), (0.3, 0.5), (0.35, 0.45))
"""[m/s], [m] Speed and stride length of very slow walks."""

VERY_SLOW = "creeping below 0.2 m/s"
"""Walks that only a foot shows: a shank sways over a standing foot as far as they get ahead."""

IN_PLACE = "2018-02-09-11-16-53"
"""Trial of `pyshoe_vicon` whose foot stays in its place."""

GROUPS = {"foot": ("foot",), "leg": ("shank", "ankle"), "trunk": ("pelvis", "waist", "lower_back")}
"""Weights → the segments that share them."""

WALKS = 0.4
"""[1] Weight of all walks beside that of all other movements."""

PENALTY = 2e-3
"""[1] On the squares of weights of evidence in its standard deviations."""


class Seen(NamedTuple):
    """The evidence of one sensor in one recording."""

    source: str  #: movement, gait or public set.
    kind: int  #: number of the kind of `KINDS`.
    placement: str
    evidence: np.ndarray  #: (G, E) in the order of `EVIDENCE`.


def seen(source: str, kind: str, placement: str, imu: Imu, spans: np.ndarray | None) -> Seen | None:
    """The evidence of a sensor, in some spans (n, 2) [s] or everywhere; None without any."""
    segment = segment_of(placement)
    if not segment or imu.acc is None:
        return None
    time = as_float(imu.time)
    rate = 1.0 / float(np.median(np.diff(time)))
    imu = filled(Imu(*(values[: int(LONGEST_S * rate)] for values in (time, imu.gyr, imu.acc, imu.mask))))
    lever = LEVERS.get(placement.partition("_")[0], 0.0)
    at, evidence, known = of_leg(imu, rate, lever) if segment == "leg" else of_trunk(imu, rate)
    if spans is not None:
        at = at + time[0]
        known = known & ((at[:, None] >= spans[:, 0]) & (at[:, None] <= spans[:, 1])).any(axis=1)
    rows = np.stack([evidence[name] for name in EVIDENCE[segment]], axis=1)[known]
    return Seen(source, list(KINDS).index(kind), placement, rows) if len(rows) else None


def spans_of(strides: Strides | None) -> np.ndarray | None:
    """(n, 2) begin and end of the valid strides [s]."""
    if strides is None or strides.start is None or not len(strides.start):
        return None
    return np.stack([as_float(strides.start), as_float(strides.end)], axis=1)[np.asarray(strides.valid, bool)]


def simulated() -> Iterator[Seen | None]:
    """Movements that are no walking, and walks of all gaits."""
    for seed in range(SEEDS):
        for source, movement in CHOSEN.items():
            rng = np.random.default_rng(100 * seed + 7)
            for name, (gyr, acc) in readings(movement(rng)).items():
                bias, noise = GYR_BIAS * rng.normal(size=3), GYR_NOISE * rng.normal(size=gyr.shape)
                force = acc + ACC_NOISE * rng.normal(size=acc.shape)
                time = np.arange(len(gyr)) / RATE_HZ
                imu = Imu(time, gyr + bias + noise, force, np.ones(len(time), bool))
                yield seen(source, KIND_OF[source], name, imu, None)
    made = [("usual", *walk) for walk in simulate.cohort(jax.random.key(5), PEOPLE, simulate.straight(12.0))]
    for number, name in enumerate(GAITS):
        walker = simulate.walking(simulate.Person(), name)
        made.append((name, *simulate.recording(jax.random.key(50 + number), walker)))
    for number, (speed, length) in enumerate(CREEPING):
        gait = simulate.gait(speed=speed, stride_length=length, length_variability=0.03, time_variability=0.03)
        key, along = jax.random.key(1100 + number), simulate.straight(3.0)
        walker = simulate.covering(key, simulate.Person(gait=gait), along)
        made.append((VERY_SLOW if speed < 0.2 else "creeping", *simulate.recording(key, walker, along, MPU6000)))
    for source, recording, truth in made:
        spans = spans_of(truth.estimate.strides if hasattr(truth, "estimate") else truth.strides)
        for name, imu in recording.sensors.items():
            if source != VERY_SLOW or name.startswith("foot"):
                yield seen(source, "walking", name, imu, spans)


def public() -> Iterator[Seen | None]:
    """Walks of the public sets."""
    for source in filter(available, (*SETS, "gaitmap_example")):
        for walk in walks(source, names(source)):
            if walk.recording.name == IN_PLACE:
                continue
            spans = spans_of(walk.reference.strides) if walk.reference is not None else None
            for name, imu in walk.recording.sensors.items():
                yield seen(source, "walking", name, imu, spans)


def fitted(rows: list[Seen], signs: list[int]) -> np.ndarray:
    """(1 + E, K) intercepts and weights of the log odds over walking."""
    kinds, evidence = len(KINDS), np.concatenate([row.evidence for row in rows])
    kind = np.concatenate([np.full(len(row.evidence), row.kind) for row in rows])
    share = np.concatenate([np.full(len(row.evidence), 1.0 / len(row.evidence)) for row in rows])
    source = np.concatenate([np.full(len(row.evidence), row.source) for row in rows])
    for name in set(source):
        share[source == name] /= share[source == name].sum()
    for number in set(kind.tolist()):
        share[kind == number] *= ((1.0 - WALKS) / (kinds - 1) if number else WALKS) / share[kind == number].sum()
    mean = np.average(evidence, axis=0, weights=share)
    sd = np.sqrt(np.average((evidence - mean) ** 2, axis=0, weights=share)) + 1e-9
    columns = np.concatenate([np.ones((len(evidence), 1)), (evidence - mean) / sd], axis=1)
    true = np.eye(kinds)[kind]
    penalty = np.r_[1e-2 * PENALTY, np.full(len(signs), PENALTY)][:, None]

    def loss(free: np.ndarray) -> tuple[float, np.ndarray]:
        weights = np.concatenate([np.zeros((len(signs) + 1, 1)), free.reshape(-1, kinds - 1)], axis=1)
        odds = columns @ weights
        chance = np.exp(odds - odds.max(axis=1, keepdims=True))
        chance /= chance.sum(axis=1, keepdims=True)
        value = -np.sum(share * np.log(np.sum(chance * true, axis=1) + 1e-12)) + np.sum(penalty * weights**2)
        slope = columns.T @ ((chance - true) * share[:, None]) + 2.0 * penalty * weights
        return float(value), slope[:, 1:].ravel()

    bounds = [(0.0 if s > 0 else None, 0.0 if s < 0 else None) for s in (0, *signs) for _ in range(kinds - 1)]
    start = np.zeros(len(bounds))
    free = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 800}).x
    weights = np.concatenate([np.zeros((len(signs) + 1, 1)), free.reshape(-1, kinds - 1)], axis=1)
    weights[1:] /= sd[:, None]
    weights[0] -= mean @ weights[1:]
    return weights


def main() -> None:
    """Learn, and write the file."""
    jax.config.update("jax_enable_x64", True)
    rows = [row for row in (*simulated(), *public()) if row is not None]
    numbers = {}
    for group, segments in GROUPS.items():
        of = [row for row in rows if row.placement.startswith(segments)]
        signs = SIGNS["trunk" if group == "trunk" else "leg"]
        numbers[group] = [json.dumps(line) for line in np.round(fitted(of, signs), 3).tolist()]
    sources = sorted({row.source for row in rows})
    text = ",\n".join(
        f'  "{group}": [\n   ' + ",\n   ".join(lines) + "\n  ]" for group, lines in numbers.items()
    )  # fmt: skip
    path = Path(jgait.__file__).parent / "events" / "movements.json"
    path.write_text(f'{{\n "learned_from": {json.dumps(", ".join(sources))},\n "weights": {{\n{text}\n }}\n}}\n')


if __name__ == "__main__":
    main()
