"""The legs on `walking5m`: distances by strapdown of the accelerometers on both shanks, and by the leg's kinematics.

Nothing is learned for the distance itself; beside it stands the distance with one scale learned on the other people.
The plain guess is the median distance of the other people. People walk from a mark to a mark, and their distances have
a standard deviation of 4 %. The reference, sensors on the feet, has an error of its own: the feet by `foot_ins`, the
reference and the shanks differ from each other by 3.3 to 3.6 %, so each of the three errs by some 2.5 %.
"""

from typing import NamedTuple

import numpy as np

from experiments.bennett2013.neura_sparse import person
from experiments.bennett2013.walking5m import leave_one_out
from experiments.common.recordings import attempt, available, names, walks
from experiments.common.row import Row, show
from jgait.estimators import leg_ekf
from jgait.types import Estimate, Walk, as_float

SET = "walking5m"
WAYS = {"leg": "leg_ekf", "kinematic": "leg_ekf by kinematics alone"}
REFERENCE_SD = 0.024
"""[1] Standard deviation of the reference's distance, from its differences to the shanks and to `foot_ins`."""


class Distances(NamedTuple):
    """Distances of one walk [m]: the reference's, and by both ways with their stated standard deviations."""

    subject: str
    true: float
    leg: tuple[float, float]
    kinematic: tuple[float, float]


def measured(walk: Walk) -> Distances:
    """The distances of one walk."""
    p, kinematics = person(walk), leg_ekf.DEFAULT._replace(distance="stance")
    assert walk.reference is not None
    true = float(as_float(walk.reference.distance)[-1])
    ways = (leg_ekf.estimate(p, walk.recording, options) for options in (leg_ekf.DEFAULT, kinematics))
    return Distances(walk.recording.subject, true, *map(stated, ways))


def stated(estimate: Estimate) -> tuple[float, float]:
    """The distance of a walk and its standard deviation [m]."""
    return float(as_float(estimate.distance)[-1]), float(as_float(estimate.diagnostics["distance_stddev"])[-1])


def rows(quick: bool) -> list[Row]:
    """On the people that are here."""
    if not available(SET):
        return []
    every = [walk for walk in walks(SET, names(SET)[:3] if quick else None) if walk.reference is not None]
    found = [attempt(walk.recording.name, lambda walk=walk: measured(walk)) for walk in every]
    return of_distances([one for one in found if one is not None])


def of_distances(found: list[Distances]) -> list[Row]:
    """Errors without and with a learned scale, bias, correlation with the reference, coverage of the deviations."""
    subjects, true = (np.array(values) for values in list(zip(*found, strict=True))[:2])

    def error(distance: np.ndarray) -> float:
        return 100.0 * float(np.mean(np.abs(distance / true - 1.0)))

    guess = error(leave_one_out(subjects, true, np.ones_like(true)))
    n, rows, lines = len(found), [], []
    for key, title in WAYS.items():
        raw, sd = np.array([getattr(one, key) for one in found]).T
        known, scaled, plain = error(raw * np.median(true / raw)), error(leave_one_out(subjects, true, raw)), error(raw)
        bias, alike = 100.0 * float(np.mean(raw / true - 1.0)), float(np.corrcoef(true, raw)[0, 1])
        spread = np.hypot(sd, REFERENCE_SD * true)
        inside = [100.0 * float(np.mean(np.abs(raw - true) <= 2.0 * one)) for one in (sd, spread)]
        line, of_error = f"{title}, `{SET}`, distance", f"{title}, `{SET}`, distance: mean error"
        nothing = "nothing learned"
        rows += [
            Row(f"{key}_distance_pct", plain, "%", n=n, split=nothing).on(of_error, nothing, "people"),
            Row(f"{key}_distance_pct_scaled", scaled, "%", n=n, split="left out").on(
                of_error, "scale learned on other people", "people"
            ),
            Row(f"{key}_distance_pct_known", known, "%", n=n, split="known").on(of_error, "scale, known", "people"),
            Row(f"{key}_distance_pct_guess", guess, "%", n=n, split="guess").on(of_error, "plain guess", "people"),
            Row(f"{key}_distance_correlation", alike, "1", n=n, split=nothing).on(
                f"{line}: correlation with the reference", "", "people"
            ),
            Row(f"{key}_raw_bias_pct", abs(bias), "%", n=n, split=nothing).on(
                f"{line}: size of the bias without a learned scale", "", "people"
            ),
            Row(f"{key}_within_two_sigma_pct", inside[0], "%", n=n, split=nothing).on(
                f"{line}: within two stated standard deviations", "", "people"
            ),
            Row(f"{key}_within_two_sigma_both_pct", inside[1], "%", n=n, split=nothing).on(
                f"{line}: within two stated standard deviations", "with the reference's own", "people"
            ),
        ]
        stated_sd = 100.0 * float(np.mean(sd / raw))
        words = "" if min(plain, scaled) < guess else "no better than a guess"
        lines.append([title, plain, scaled, known, guess, bias, alike, stated_sd, *inside, words])
    columns = [
        "mean |error| [%]", "scale, left out", "scale, known", "guess", "bias", "correlation", "stated sd [%]",
        "in 2 sd [%]", "reference's too", "",
    ]  # fmt: skip
    show(f"Distances of the legs on {n} people of {SET}", ["", *columns], lines)
    return rows
