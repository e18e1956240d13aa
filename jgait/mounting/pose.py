"""The zero of hip and knee angles: what a leg's pose is at rest and in the mean of walking, with its uncertainty.

A rest may be standing, sitting, lying or leaning; how far each segment is inclined then, over its mean inclination in
walking, gives the probability that the person stands. People stand with nearly straight legs (`standing_hip`,
`standing_knee` of an estimator), and walk with thighs and knees that are on average bent alike; who never stands has
the second alone.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jgait.geometry.arrays import xp
from jgait.types import Values

DEGREE = math.pi / 180.0

WALKING_POSE = np.array([9.0, 25.0]) * DEGREE
"""[rad] Usual mean over strides of the hip's angle from the vertical, and of the knee's flexion: 8.5 and 18.6° from
standing on `walking5m`, 5 and 22° on `neura_sparse` (Vicon), 11 and 30° in simulated people."""

WALKING_SD, WALKING_CORRELATION = (4.0 * DEGREE, 6.0 * DEGREE), 0.6
"""[rad], [1] Standard deviations between people and sets, and correlation, of these means."""

UNUSUAL, WALK_TIMES, STAND_TIMES = 0.1, 3.0, 4.0
"""[1] Share of people who walk with other mean angles, as crouched, or stand otherwise, with bent knees; and factors
on the deviations of walking and of standing for them. Chosen."""

POSTURES = {
    "stands": (0.6, (0.0, 0.0, 0.0), (8.0, 8.0, 8.0)),
    "sits": (0.2, (85.0, 0.0, 0.0), (15.0, 20.0, 20.0)),
    "lies": (0.1, (90.0, 80.0, 0.0), (30.0, 40.0, 60.0)),
    "leans": (0.1, (15.0, -5.0, 0.0), (30.0, 30.0, 30.0)),
}
"""Posture → prior probability; mean and standard deviation of the inclinations of thigh and shank, positive with the
distal end forward, and of both sideways [deg]. Chosen."""


class Pose(NamedTuple):
    """What walking states of a leg's hip and knee angle in the pose from which its sensors' angles count."""

    mean: np.ndarray  #: (2,) hip angle from the vertical and knee flexion [rad], with the deviations of walking.
    walks: np.ndarray  #: 1.0 if walking states them, else 0.0.
    stands: np.ndarray  #: probability that the person stands in that pose [1].


STANDING_POSE = Pose(np.zeros(2), np.zeros(()), np.ones(()))
"""A standing of which walking states nothing."""


def standing_probability(inclinations: Sequence[tuple[str, float, float]]) -> float:
    """The probability that a person at rest stands, from segment ("thigh", "shank"), its inclination, and its
    inclination sideways [rad] for each sensor, over the usual pose of walking; 1 if there is none. Shanks alone tell
    lying from standing: they are upright in a chair, too.
    """
    if not inclinations:
        return 1.0
    scores = []
    thighs = any(segment == "thigh" for segment, *_ in inclinations)
    for prior, mean, spread in (POSTURES[name] for name in (POSTURES if thighs else ("stands", "lies"))):
        score = math.log(prior)
        for segment, forward, sideways in inclinations:
            row = 0 if segment == "thigh" else 1
            for value, at in ((forward, row), (sideways, 2)):
                away = math.remainder(value - mean[at] * DEGREE, 2.0 * math.pi) / DEGREE
                deviation = math.hypot(spread[at], 6.0)  # of the mean in walking
                score -= 0.5 * (away / deviation) ** 2 + math.log(deviation)
        scores.append(score)
    return float(np.exp(scores[0] - np.logaddexp.reduce(scores)))


def pose_from_walking(thigh: float | None, shank: float | None, stands: float) -> Pose:
    """The pose from which angles count, from the mean inclinations of thigh and shank in walking over it [rad]; None if
    they are not known. `stands` is the probability that the person stands in that pose.
    """
    if thigh is None or shank is None:  # counted from the mean direction in walking, or from a standing
        return STANDING_POSE if stands else Pose(WALKING_POSE, np.ones(()), np.zeros(()))
    return Pose(WALKING_POSE - np.array([thigh, thigh - shank]), np.ones(()), np.asarray(stands))


type _Normal = tuple[tuple[Values, Values], tuple[Values, Values, Values]]
"""Mean of two variables, and their variances and covariance (first, both, second)."""


def posterior(pose: Pose, mean: tuple[Values, Values], deviation: tuple[Values, Values]) -> _Normal:
    """Mean [rad] and covariance [rad²] of hip and knee in the pose from which angles count, as one normal density.

    People stand at `mean` with a `deviation` [rad], or a few with a larger one, and walk with the usual mean angles, or
    a few with others: a mixture of normal densities, each weighed by how well standing and walking agree in it.
    """
    off = tuple(pose.mean[i] - mean[i] for i in range(2))
    walk = WALKING_SD[0] ** 2, WALKING_CORRELATION * WALKING_SD[0] * WALKING_SD[1], WALKING_SD[1] ** 2
    parts: list[tuple[Values, _Normal]] = []
    for share, stand_times, walk_times in (
        ((1.0 - UNUSUAL) ** 2, 1.0, 1.0),
        (UNUSUAL * (1.0 - UNUSUAL), 1.0, WALK_TIMES),
        (UNUSUAL * (1.0 - UNUSUAL), STAND_TIMES, 1.0),
    ):
        hip, knee = ((stand_times * each) ** 2 for each in deviation)
        a, b, c = hip + walk[0] * walk_times**2, walk[1] * walk_times**2, knee + walk[2] * walk_times**2
        size = a * c - b * b
        square = (c * off[0] ** 2 - 2.0 * b * off[0] * off[1] + a * off[1] ** 2) / size
        gain = (c * hip / size, -b * hip / size), (-b * knee / size, a * knee / size)
        at = tuple(mean[i] + gain[i][0] * off[0] + gain[i][1] * off[1] for i in range(2))
        cov = hip - gain[0][0] * hip, -gain[0][1] * knee, knee - gain[1][1] * knee
        parts.append((share * xp.exp(-0.5 * square) / xp.sqrt(size), ((at[0], at[1]), cov)))
    total = sum(weight for weight, _ in parts)
    zero = 0.0 * total
    wide = 1.0 + UNUSUAL * (WALK_TIMES**2 - 1.0)
    walked = (pose.mean[0] + zero, pose.mean[1] + zero), tuple(value * wide + zero for value in walk)
    stood = (mean[0] + zero, mean[1] + zero), (deviation[0] ** 2 + zero, zero, deviation[1] ** 2 + zero)
    likely = [(pose.walks * pose.stands * weight / total, part) for weight, part in parts]
    likely += [(pose.walks * (1.0 - pose.stands), walked), (1.0 - pose.walks, stood)]
    middle = tuple(sum(weight * part[0][i] for weight, part in likely) for i in range(2))

    def moment(i: int, j: int) -> Values:
        return sum(weight * (cov[i + j] + (at[i] - middle[i]) * (at[j] - middle[j])) for weight, (at, cov) in likely)

    return (middle[0], middle[1]), (moment(0, 0), moment(0, 1), moment(1, 1))
