"""The recordings that rules are judged on: public walks, simulated walks, movements and damaged readings."""

from collections.abc import Callable, Iterator
from functools import partial

import jax
import numpy as np

from experiments.common import recordings
from experiments.common.sets import datasets
from experiments.damage.harm import DAMAGES, Damage, Rows, read, rows_of
from experiments.damage.undamaged import SIMULATED
from experiments.unseen2 import legs_zero, movements
from jgait import simulate
from jgait.simulate.sensors import MPU6000
from jgait.types import Recording

WORN = (
    ("pelvis",), ("foot_right",), ("ankle_left",), ("shank_right",), ("thigh_left", "shank_left"),
    ("foot_right", "foot_left"), ("ankle_right", "ankle_left"), ("shank_right", "shank_left"),
    ("thigh_right", "shank_right", "thigh_left", "shank_left"), ("shank_right", "shank_left", "pelvis"),
)  # fmt: skip
"""Choices of sensors."""

DAMAGED = ("foot_right", "shank_right", "thigh_left", "pelvis")
"""The sensors that are damaged, one at a time."""


type Made = Callable[[], Recording]
"""Makes a recording; raises RecordingError where a reader refuses it."""


def panel(quick: bool, every: int = 1) -> Iterator[tuple[str, Made]]:
    """Name and maker of each walk, movement and damage, or of one in so many."""
    for number, (name, made) in enumerate(_all(quick)):
        if number % every == 0:
            yield name, made


def _all(quick: bool) -> Iterator[tuple[str, Made]]:
    for seed, (errors, rate, way) in enumerate(list(SIMULATED.values())[: 1 if quick else None]):
        for recording, _ in simulate.cohort(jax.random.key(700 + seed), 1 if quick else 5, way, errors, rate):
            yield f"simulated, {recording.name}", partial(_same, recording)
            for worn in WORN[:1] if quick else WORN:
                if set(worn) <= set(recording.sensors):
                    sensors = {name: recording.sensors[name] for name in worn}
                    yield f"simulated, {', '.join(worn)}", partial(_same, recording._replace(sensors=sensors))
    if quick:
        return
    for name in filter(recordings.available, datasets.list_datasets()):
        for walk in datasets.load(name, list(datasets.names(name))):
            yield f"{name}, {walk.recording.name}", partial(_same, walk.recording)
    for case in movements.cases(1, movements.PLACES):
        yield f"{case.kind}, {case.place}, {case.sensors}", partial(_same, case.recording)
    for one in legs_zero.simulated(4, 700):
        for start in legs_zero.STARTS:
            yield f"{start}, {one.group}", partial(_same, legs_zero.begun(one, start)[0])
    ((recording, _),) = simulate.cohort(jax.random.key(710), 1, simulate.straight(12.0), MPU6000, 100.0)
    rows = rows_of(recording, tuple(recording.sensors))
    for what, damage in DAMAGES.items():
        for placement in DAMAGED:
            yield f"{what}, {placement}", partial(_damaged, rows, damage, placement, what)


def _same(recording: Recording) -> Recording:
    return recording


def _damaged(rows: Rows, damage: Damage, placement: str, what: str) -> Recording:
    return read(damage.change(rows, placement, np.random.default_rng(0)), what)
