"""The trials of `pyshoe_vicon`: by speed and day, and as lessons in two halves, one for each core."""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.common.recordings import available, names, walks
from jgait import tune
from jgait.estimators import foot_ins
from jgait.tune import Lessons
from jgait.types import Walk

SET = "pyshoe_vicon"

KINDS = ("walking", "fast", "creeping")


def kind(speed: float | None) -> str:
    """Walking 0.6–1.3 m/s, fast and running from 1.3 m/s, creeping (slow steps, kneeling) below."""
    if speed is None or speed < 0.6:
        return "creeping"
    return "walking" if speed < 1.3 else "fast"


class Trials(NamedTuple):
    """The trials in the order of their names: walks, kind and day of each, and lessons in groups.

    `groups` are (rows of the trials, lessons) of each half, single precision.
    """

    walks: list[Walk]
    kinds: np.ndarray
    days: np.ndarray
    groups: list[tuple[np.ndarray, Lessons]]


@cache
def trials(quick: bool) -> Trials | None:
    """The trials that are here, prepared for the default options; None if the set is not here."""
    if not available(SET):
        return None
    found = list(walks(SET, names(SET)[::9] if quick else None))
    return Trials(
        found, np.array([kind(walk.info["speed"]) for walk in found]),
        np.array([walk.recording.name[:10] for walk in found]), groups(found),
    )  # fmt: skip


def groups(found: Sequence[Walk]) -> list[tuple[np.ndarray, Lessons]]:
    """Rows of the walks and their lessons, in halves of equal work; raises if a walk cannot be used.

    The lessons have one length and the halves one number of walks, so that they share a program.
    """
    estimator = foot_ins.estimator()
    samples = np.array([len(next(iter(walk.recording.sensors.values())).time) for walk in found])
    order = np.argsort(samples, kind="stable")
    made = tune.lessons(estimator, found)
    if made.failures:
        raise RuntimeError(f"trials that cannot be used: {made.failures}")
    data = jax.tree.map(_single, made.data)
    halves = (order[0::2], order[1::2]) if len(order) % 2 == 0 else (order,)
    return [(rows, made._replace(data=jax.tree.map(lambda leaf, rows=rows: leaf[rows], data))) for rows in halves]


def _single(values: Any) -> np.ndarray:
    array = np.asarray(values)
    return array.astype(np.float32) if array.dtype == np.float64 else array
