"""The legs on `walking5m`: distances by the leg's kinematics, and by strapdown of the accelerometers on both shanks.

Of each way one scale is learned. The plain guess is the median distance of the other people. People walk from a mark
to a mark, and their distances have a standard deviation of 4 %.
"""

from typing import NamedTuple

import numpy as np

from experiments.bennett2013.neura_sparse import person
from experiments.bennett2013.walking5m import leave_one_out
from experiments.common.recordings import attempt, available, names, walks
from experiments.common.row import Row, show
from jgait.estimators import ankle_stride, leg_ekf
from jgait.types import Walk, as_float

SET = "walking5m"
WAYS = {"leg_distance": "leg_ekf", "shank_distance": "strapdown at the shanks"}


class Distances(NamedTuple):
    """Distances of one walk [m]: the reference's, by leg_ekf, and by ankle_stride at the shanks."""

    subject: str
    true: float
    leg: float
    shank: float


def measured(walk: Walk) -> Distances:
    """The distances of one walk."""
    leg = leg_ekf.estimate(person(walk), walk.recording)
    shank = ankle_stride.estimate(ankle_stride.AnkleParams(), walk.recording)
    assert walk.reference is not None
    told = (float(as_float(one.distance)[-1]) for one in (walk.reference, leg, shank))
    return Distances(walk.recording.subject, *told)


def rows(quick: bool) -> list[Row]:
    """On the people that are here."""
    if not available(SET):
        return []
    every = [walk for walk in walks(SET, names(SET)[:3] if quick else None) if walk.reference is not None]
    found = [attempt(walk.recording.name, lambda walk=walk: measured(walk)) for walk in every]
    return of_distances([one for one in found if one is not None])


def of_distances(found: list[Distances]) -> list[Row]:
    """Errors of known people and of people left out, the raw bias, and the correlation with the reference."""
    subjects, true, *ways = (np.array(values) for values in zip(*found, strict=True))

    def error(distance: np.ndarray) -> float:
        return 100.0 * float(np.mean(np.abs(distance / true - 1.0)))

    guess = error(leave_one_out(subjects, true, np.ones_like(true)))
    n, rows, lines = len(found), [], []
    for (key, title), raw in zip(WAYS.items(), ways, strict=True):
        known, left = error(raw * np.median(true / raw)), error(leave_one_out(subjects, true, raw))
        bias, alike = 100.0 * float(np.mean(raw / true - 1.0)), float(np.corrcoef(true, raw)[0, 1])
        line = f"{title}, `{SET}`, distance"
        rows += [
            Row(f"{key}_pct", left, "%", n=n, split="left out").on(f"{line}: mean error", "left out", "people"),
            Row(f"{key}_pct_known", known, "%", n=n, split="known").on(f"{line}: mean error", "known", "people"),
            Row(f"{key}_pct_guess", guess, "%", n=n, split="guess").on(f"{line}: mean error", "plain guess", "people"),
            Row(f"{key}_correlation", alike, "1", n=n, split="nothing learned").on(
                f"{line}: correlation with the reference", "", "people"
            ),
            Row(key.replace("distance", "raw_bias_pct"), abs(bias), "%", n=n, split="nothing learned").on(
                f"{line}: size of the bias without a learned scale", "", "people"
            ),
        ]
        lines.append([title, known, left, guess, bias, alike, "" if left < guess else "no better than a guess"])
    columns = ["mean |error| [%]", "known", "left out", "guess", "bias, nothing learned", "correlation", ""]
    show(f"Distances of the legs on {n} people of {SET}", columns, lines)
    return rows
