"""Simulated walks on disk: each person has own legs, route and pace; a walk is a file, read back as a recording with
its truth.

`python -m experiments.cohort.walks FOLDER SEED FIRST LAST SHORTEST LONGEST` writes them, and
prints the reasons of people who cannot walk so as a JSON list.
"""

import functools
import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.common.people import check_person
from jgait import simulate
from jgait.simulate import Person, Route
from jgait.simulate.check import check_slack
from jgait.simulate.recorded import limits, room, samples_in
from jgait.simulate.sensors import MPU6000
from jgait.types import Estimate, Imu, Legs, LegTrajectory, Recording, Strides, Walk

RATE = 100.0
TURNS = {"straight": 0.0, "corner": 0.5 * math.pi, "back": math.pi}
"""Ways that people walk in turn, by the angle [rad] at their middle, left and right by turns."""

RADIUS = 0.8
"""Of the turns [m]."""

GROUP = 32
"""People who are simulated in one call."""


class Walker(NamedTuple):
    """A person, the way, and the duration of the walk [s]."""

    name: str
    key: Any
    person: Person
    along: Route
    seconds: float


def _way(kind: str, number: int, length: float) -> Route:
    """A way of a length [m] with the turn of its kind at the middle; all of three pieces, so that they stack."""
    turn = TURNS[kind] * (1.0 if number % 2 else -1.0)
    bend = max(abs(turn) * RADIUS, 0.5)
    half = {"length": max(0.5 * (length - bend), 0.5)}
    return simulate.route(half, {"length": bend, "turn": turn}, half)


def walkers(seed: int, first: int, last: int, seconds: tuple[float, float]) -> Iterator[Walker | str]:
    """People `first` to `last` of a population, each walking for about as long as drawn.

    For a person who cannot walk so, it yields the reason.
    """
    who, how = jax.random.split(jax.random.key(seed))
    drawn = jax.tree.map(np.asarray, simulate.population(who, last, recorded=False))
    keys = jax.vmap(lambda i: jax.random.fold_in(how, i))(jnp.arange(last))
    for number in range(first, last):
        person, kind = simulate.person_of(drawn, number), list(TURNS)[number % len(TURNS)]
        quiet = person.gait.quiet_before + person.gait.quiet_after
        wanted = np.random.default_rng([seed, number]).uniform(*seconds)
        # Both feet stand at either end: that takes about two steps.
        steps = max(2, round((wanted - quiet) / (0.5 * person.gait.stride_time)) - 2)
        along = _way(kind, number, 0.5 * steps * person.gait.stride_length)
        name = f"{number:05d}_{kind}"
        try:
            fit = simulate.covering(keys[number], person, along)
            check_person(fit)
            _, lasts, left = limits(keys[number], fit, along)
            check_slack(fit, left, f"on the way of {name}")
        except ValueError as error:
            yield f"{name}: {error}"
        else:
            yield Walker(name, keys[number], fit, along, lasts)


@functools.partial(jax.jit, static_argnames=("capacity",))
def _walked(keys: Any, people: Person, along: Route, time: Any, errors: Any, capacity: int) -> Any:
    def one(key: Any, person: Person, way: Route) -> Any:
        read, truth = simulate.walk(key, person, way, time, errors, capacity=capacity, placements=simulate.FOUR)
        sensors = jnp.stack([jnp.concatenate([imu.gyr, imu.acc], axis=1) for imu in read.values()])
        masks = jnp.stack([imu.mask for imu in read.values()])
        estimate = truth.estimate
        legs = jnp.stack([jnp.stack(leg) for leg in estimate.legs])
        return (
            sensors,
            masks,
            legs,
            estimate.distance,
            jnp.stack([v.astype(legs.dtype) for v in estimate.strides if v is not None]),
        )

    return jax.vmap(one)(keys, people, along)


def _save(folder: Path, group: list[Walker]) -> None:
    """Simulate a group, and write a file for each."""
    filled = [*group, *[group[-1]] * (GROUP - len(group))]
    people, along = (jax.tree.map(lambda *v: jnp.asarray(np.stack(v)), *part) for part in zip(
        *((one.person, one.along) for one in filled), strict=True))  # fmt: skip
    samples = [samples_in(one.seconds, RATE) for one in group]
    unit = 256 if max(samples) < 2048 else 1024
    time = jnp.asarray(np.arange(unit * math.ceil(max(samples) / unit)) / RATE)
    capacity = room(max(round(float(one.person.gait.steps)) for one in group))
    keys = jnp.stack([one.key for one in filled])
    made = jax.tree.map(np.asarray, _walked(keys, people, along, time, jax.tree.map(float, MPU6000), capacity))
    for row, (one, n) in enumerate(zip(group, samples, strict=True)):
        sensors, masks, legs, distance, strides = (leaf[row] for leaf in made)
        body = np.array([one.person.body.thigh_length, one.person.body.shank_length])
        np.savez(
            folder / f"{one.name}.npz", sensors=sensors[:, :n].astype(np.float32), masks=masks[:, :n],
            legs=legs[..., :n].astype(np.float32), distance=distance[:n].astype(np.float32),
            strides=strides[:, strides[-1] > 0.5].astype(np.float32), body=body,
        )  # fmt: skip


def simulated(folder: Path, seed: int, first: int, last: int, seconds: tuple[float, float]) -> list[str]:
    """Simulate people, write their walks, and return the reasons of people who cannot walk so."""
    groups: dict[tuple[int, int], list[Walker]] = {}
    refused = []
    for one in walkers(seed, first, last, seconds):
        if isinstance(one, str):
            refused.append(one)
            continue
        # Alike in steps and samples, so that few programs are compiled.
        alike = room(round(float(one.person.gait.steps))), math.ceil(samples_in(one.seconds, RATE) / 1024)
        group = groups.setdefault(alike, [])
        group.append(one)
        if len(group) == GROUP:
            _save(folder, groups.pop(alike))
    for group in groups.values():
        _save(folder, group)
    return refused


def read(folder: str, name: str) -> Walk:
    """A walk from its file."""
    with np.load(Path(folder) / f"{name}.npz") as stored:
        held = {key: stored[key] for key in stored.files}
    time = np.arange(held["distance"].size) / RATE
    signals = zip(simulate.FOUR, held["sensors"], held["masks"], strict=True)
    sensors = {place: Imu(time, values[:, :3], values[:, 3:], mask) for place, values, mask in signals}
    side, *times, valid = held["strides"].astype(np.float64)
    legs = Legs(*(LegTrajectory(*leg) for leg in held["legs"]))
    strides = Strides(side.astype(int), *times, valid > 0.5)
    known = np.ones(time.size, bool)
    body = dict(zip(("thigh_length", "shank_length"), map(float, held["body"]), strict=True))
    return Walk(
        Recording(sensors, RATE, name, f"subject_{name[:5]}"),
        Estimate(time, legs, None, held["distance"], known, {}, strides),
        body,
    )


def leg_lengths(walk: Walk) -> dict[str, Any]:
    """The walker's own leg lengths [m]."""
    return walk.info


if __name__ == "__main__":
    given = map(float, sys.argv[2:])
    number, start, stop = (int(next(given)) for _ in range(3))
    print(json.dumps(simulated(Path(sys.argv[1]), number, start, stop, (next(given), next(given)))))
