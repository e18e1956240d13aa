"""Strides of a leg by five detectors, matched with the reference."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.common import matching
from experiments.common.shanks import SHIFTED, Leg
from experiments.silva2017 import baselines
from jgait.events import shank as shank_events

TOLERANCE = 0.4  # [s] between a detection and the contact it is taken for; strides last 0.9 to 1.6 s
DETECTORS = ("swings", "machine", "paper's machine", "Jiménez", "Feliz")


class Score(NamedTuple):
    """Detections against contacts: found, not found, and what was no stride; and errors of time [s]."""

    hit: int
    missed: int
    extra: int
    late: np.ndarray
    stride_time: np.ndarray


def f1(scores: list[Score]) -> float:
    """F1 of all together."""
    return matching.f1(*(sum(score[k] for score in scores) for k in range(3)))


def padded(values: np.ndarray, least: int = 4096) -> np.ndarray:
    """The samples with the last repeated up to a power of two, so that few programs are compiled."""
    count = least
    while count < len(values):
        count *= 2
    return np.concatenate([values, np.repeat(values[-1:], count - len(values), axis=0)])


_swings = jax.jit(shank_events.swings, static_argnums=1)
_phases = jax.jit(shank_events.phases, static_argnums=1)
_jimenez = jax.jit(baselines.jimenez, static_argnums=1)
_feliz = jax.jit(baselines.feliz, static_argnums=1)


def strides_of(leg: Leg, detector: str = "swings") -> shank_events.ShankEvents:
    """What a detector found, strides only; the baselines' instants are both start and end."""
    rows = leg.axes.rows
    rate, count = np.asarray(leg.imu.gyr) @ rows[1], len(leg.imu.time)
    calls: dict[str, Callable[[], Any]] = {
        "swings": lambda: _swings(padded(rate), leg.rate_hz),
        "machine": lambda: _phases(padded(rate), leg.rate_hz),
        "paper's machine": lambda: _phases(padded(rate), leg.rate_hz, shank_events.PAPER),
        "Jiménez": lambda: _jimenez(padded(np.asarray(leg.imu.acc)), leg.rate_hz),
        "Feliz": lambda: _feliz(padded(np.asarray(leg.imu.gyr)), leg.rate_hz),
    }
    told = calls[detector]()
    if isinstance(told, shank_events.ShankEvents):
        there = np.flatnonzero(np.asarray(told.stride)[:count])
        return shank_events.ShankEvents(*(np.asarray(field)[there] for field in told))
    at = np.flatnonzero(np.asarray(told)[:count])
    none = np.zeros(len(at))
    return shank_events.ShankEvents(none == 0.0, at / leg.rate_hz, at / leg.rate_hz, at / leg.rate_hz, none, none)


def pairs(ours: np.ndarray, theirs: np.ndarray) -> list[tuple[int, int]]:
    """Rows of detections and contacts that belong together."""
    return matching.nearest(ours, theirs, TOLERANCE)


def score(leg: Leg, ends: np.ndarray, *, half_steps: bool) -> Score:
    """Detections against the reference, in its window.

    A detection that is taken for a stride which is not counted (a half-step, unless they are; a shifted foot) counts
    neither way.
    """
    reference = leg.reference
    first, last = reference.window
    ours = ends[(ends >= first) & (ends <= last)]
    counted = reference.length >= SHIFTED if half_steps else reference.full
    joined = pairs(ours, reference.contact)
    hits = [(i, j) for i, j in joined if counted[j]]
    late = np.array([ours[i] - reference.contact[j] for i, j in hits])
    following = [(late[k], late[k + 1]) for k in range(len(hits) - 1) if hits[k + 1][1] == hits[k][1] + 1]
    apart = np.array([b - a for a, b in following])
    return Score(len(hits), int(counted.sum()) - len(hits), len(ours) - len(joined), late, apart)


def table(legs: list[Leg], *, half_steps: bool) -> dict[str, list[Score]]:
    """Detector → score of each leg."""
    return {name: [score(leg, strides_of(leg, name).end, half_steps=half_steps) for leg in legs] for name in DETECTORS}
