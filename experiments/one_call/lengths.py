"""Stride lengths of all sensors combined beside those of each source alone: a real walk, and simulated walks."""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from experiments.common import recordings
from experiments.common.row import Row, show
from jgait import analyse, simulate
from jgait.estimators.combined import Analysis
from jgait.simulate.sensors import OPAL
from jgait.types import SIDES, Recording, Strides, Walk

PLACEMENTS = (*simulate.SEVEN, "ankle_right", "ankle_left")
PEOPLE_KEY = 2302
PEOPLE = 40

SIMULATED = {"pendulum_constant": 1.05}
"""What is known of simulated people: the constant of their pendulum, see `docs/guide/one_sensor.md`."""

SAME_S = 0.2
"""[s] Largest difference of the ends of a stride and of its reference."""

SOURCES = ("feet", "ankles", "shanks", "waist")


def errors_of(analysis: Analysis, reference: list[float | None]) -> dict[str, np.ndarray]:
    """Error of each stride's length by each source, and combined [m]; NaN without reference or source."""
    known = np.array([np.nan if value is None else value for value in reference])
    told = analysis.strides
    found = {"combined": np.asarray(analysis.estimate.strides.length) - known}
    for source in analysis.sources:
        rows = told.rows.get(source.name)
        if rows is not None:
            lengths = np.asarray(source.estimate.strides.length)
            found[source.name] = np.where(rows >= 0, lengths[rows], np.nan) - known
    found["stddev"] = np.asarray(analysis.estimate.strides_stddev.length)
    found["turning"] = np.asarray(told.flags["turning"], float)
    return found


def of_truth(analysis: Analysis, truth: Strides) -> list[float | None]:
    """The true length of each stride of an analysis."""
    ours, valid = analysis.estimate.strides, np.asarray(truth.valid, bool)
    lengths: list[float | None] = []
    for side, end in zip(ours.side, ours.end, strict=True):
        near = np.flatnonzero(valid & (np.asarray(truth.side) == side) & (np.abs(np.asarray(truth.end) - end) < SAME_S))
        lengths.append(float(truth.length[near[0]]) if near.size == 1 else None)
    return lengths


def of_capture(analysis: Analysis, walk: Walk) -> list[float | None]:
    """The ankle's displacement between the stances of motion capture, of each stride of an analysis."""
    ours, rate = analysis.estimate.strides, walk.recording.sampling_rate_hz
    lengths: list[float | None] = []
    for side, start, end in zip(ours.side, ours.start, ours.end, strict=True):
        middle = 0.5 * (start + end) * rate
        inside = [row[2] for row in walk.info["ankle_strides"][SIDES[int(side)]] if row[0] <= middle <= row[1]]
        lengths.append(float(inside[0]) if inside else None)
    return lengths


def score(found: Sequence[dict[str, np.ndarray]], *, straight: bool) -> dict[str, float]:
    """Mean absolute error of each source on the strides that all of feet, ankles, shanks have [cm]; NEES; strides."""
    every = {name: np.concatenate([one[name] for one in found]) for name in found[0]}
    use = np.isfinite(every["feet"] + every["ankles"] + every["shanks"])
    use &= (every["turning"] < 0.5) | (not straight)
    made = {name: 100.0 * float(np.nanmean(np.abs(every[name][use]))) for name in (*SOURCES, "combined")}
    made["nees"] = float(np.mean((every["combined"][use] / every["stddev"][use]) ** 2))
    return {**made, "n": float(use.sum())}


def over_best(scored: dict[str, float]) -> float:
    """Error of the combined lengths over that of the best source [1]."""
    return scored["combined"] / min(scored[name] for name in SOURCES)


CONTRADICTIONS = ("distances_differ", "feet_of_contacts_differ")
"""Codes of notes that results contradict each other."""


def simulated(people: int) -> tuple[list[dict[str, np.ndarray]], int]:
    """Errors on walks of people drawn anew, 15 m out and back; walks with a note that results contradict each other."""
    found, alarms = [], 0
    walks: list[tuple[Recording, simulate.Truth]] = simulate.cohort(
        jax.random.key(PEOPLE_KEY), people, simulate.u_turn(15.0), OPAL, 100.0, PLACEMENTS, recorded=False
    )
    for recording, truth in walks:
        analysis = analyse(recording, SIMULATED)
        found.append(errors_of(analysis, of_truth(analysis, truth.strides)))
        alarms += any(note.code in CONTRADICTIONS for note in analysis.notes)
    return found, alarms


def _line(what: str, told: dict[str, float]) -> list[Any]:
    return [what, *(told[name] for name in (*SOURCES, "combined")), over_best(told), told["nees"], int(told["n"])]


def rows(quick: bool) -> list[Row]:
    """The real walk where it is there, and simulated walks."""
    lines, made = [], []
    if recordings.available("neura_sparse"):
        (walk,) = recordings.walks("neura_sparse")
        analysis = analyse(walk.recording)
        found = [errors_of(analysis, of_capture(analysis, walk))]
        for straight, metric in ((True, "combined_over_best_real"), (False, "combined_over_best_real_with_turn")):
            told = score(found, straight=straight)
            what = "neura_sparse, " + ("without the U-turn" if straight else "all strides")
            lines.append(_line(what, told))
            split = f"{what}; weights from other sets"
            made.append(Row(metric, over_best(told), "ratio", n=int(told["n"]), split=split).on(
                "stride length of all sensors over that of the best source, `neura_sparse`",
                "" if straight else "with the U-turn", "strides",
            ))  # fmt: skip
    people = 4 if quick else PEOPLE
    found, alarms = simulated(people)
    told = score(found, straight=False)
    lines.append(_line("simulated", told))
    line = "stride length of all sensors over that of the best source"
    split = "people drawn anew, 15 m out and back"
    made += [
        Row("combined_over_best_simulated", over_best(told), "ratio", n=int(told["n"]), split=split).on(
            line, "", "strides", simulated=True
        ),
        Row("combined_nees_simulated", told["nees"], "1", n=int(told["n"]), split=split).on(
            line, "squared error over stated variance", "strides", simulated=True
        ),
        Row("false_contradictions", float(alarms), "walks", n=people, split=split).on(
            "correct walks in which results of sensors are said to contradict", "", "walks", simulated=True
        ),
    ]
    show(
        "stride length, mean absolute error [cm]",
        ["walks", *SOURCES, "combined", "over best", "NEES", "strides"],
        lines,
    )
    return made
