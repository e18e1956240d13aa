"""The zero of hip and knee angles: what a leg's pose is at rest and in the mean of walking, with its uncertainty.

A rest may be standing, sitting, lying or leaning. How far each segment is inclined then, over its mean inclination in
walking, gives the probability that the person stands. The pose in that standing is known from two sides: people stand
with nearly straight legs (`standing_hip`, `standing_knee` of an estimator), and walk with thighs and knees that are on
average bent alike. Who never stands has the second alone.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

DEGREE = math.pi / 180.0

WALKING_POSE = np.array([9.0, 23.0]) * DEGREE
"""[rad] Usual mean over strides of the hip's angle from the vertical, and of the knee's flexion: 8.5 and 18.6° from
standing on `walking5m`, 5 and 22° on `neura_sparse` (Vicon), 11 and 30° in simulated people."""

WALKING_SD, WALKING_CORRELATION = np.array([4.0, 6.0]) * DEGREE, 0.6
"""[rad], [1] Standard deviations between people and sets, and correlation, of these means."""

UNUSUAL, UNUSUAL_TIMES = 0.1, 3.0
"""[1] Share of people who walk with other mean angles, as crouched, and the factor on the deviations for them."""

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

    mean: np.ndarray  #: (2,) hip angle from the vertical and knee flexion [rad].
    precision: np.ndarray  #: (2, 2) inverse of their covariance [1/rad²]; 0 if nothing is known.
    stands: np.ndarray  #: probability that the person stands in that pose [1].


UNKNOWN_POSE = Pose(np.zeros(2), np.zeros((2, 2)), np.ones(()))
"""A standing of which walking states nothing."""


def standing_probability(inclinations: Sequence[tuple[str, float, float]]) -> float:
    """The probability that a person at rest stands, from segment ("thigh", "shank"), its inclination, and its
    inclination sideways [rad] for each sensor, over the usual pose of walking; 1 if there is none.
    """
    if not inclinations:
        return 1.0
    scores = []
    for prior, mean, spread in POSTURES.values():
        score = math.log(prior)
        for segment, forward, sideways in inclinations:
            row = 0 if segment == "thigh" else 1
            for value, at in ((forward, row), (sideways, 2)):
                away = math.remainder(value - mean[at] * DEGREE, 2.0 * math.pi) / DEGREE
                deviation = math.hypot(spread[at], 6.0)  # of the mean in walking
                score -= 0.5 * (away / deviation) ** 2 + math.log(deviation)
        scores.append(score)
    return float(np.exp(scores[0] - np.logaddexp.reduce(scores)))


def pose_from_walking(thigh: float | None, shank: float | None, stands: float, standing_sd: Sequence[float]) -> Pose:
    """What walking states of the pose from which the angles count.

    Args:
        thigh: mean inclination of the thigh in walking from that pose [rad]; None if it is not known.
        shank: the same of the shank.
        stands: probability that the person stands in that pose.
        standing_sd: usual standard deviations of hip and knee in standing [rad], which decide whether the person walks
            as usual.
    """
    if thigh is None or shank is None:
        return UNKNOWN_POSE
    mean = WALKING_POSE - np.array([thigh, thigh - shank])
    usual = np.diag(WALKING_SD**2)
    usual[0, 1] = usual[1, 0] = WALKING_CORRELATION * WALKING_SD[0] * WALKING_SD[1]
    scores = []
    for share, times in ((1.0 - UNUSUAL, 1.0), (UNUSUAL, UNUSUAL_TIMES)):
        score = math.log(share)
        if stands > 0.5:
            both = times**2 * usual + np.diag(np.square(standing_sd))
            score -= 0.5 * float(mean @ np.linalg.solve(both, mean)) + 0.5 * math.log(np.linalg.det(both))
        scores.append(score)
    likely = float(np.exp(scores[0] - np.logaddexp.reduce(scores)))
    # one normal density in place of the two
    return Pose(mean, np.linalg.inv(usual) / (likely + (1.0 - likely) * UNUSUAL_TIMES**2), np.asarray(stands))
