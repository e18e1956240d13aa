"""State estimation on named states, independent of gait.

A `Model` is a set of functions on NamedTuples of scalars, arrays and rotations. `kalman_filter` and `kalman_smoother`
run over a recording, `infer` runs the filter or the smoother, `step` filters one sample online. The argument `method`
selects the linearisation (`KF`, `EKF`, `IteratedEKF`, `UKF`, `CKF`).
"""

from jgait.filtering.covariance import Covariance, names_of
from jgait.filtering.filter import draw, infer, kalman_filter, kalman_smoother, step
from jgait.filtering.methods import CKF, EKF, KF, UKF, IteratedEKF, Method
from jgait.filtering.model import Belief, Model
from jgait.filtering.posterior import FIELDS, KEEP, SUMMARY, Inferred, Posterior
from jgait.geometry.arrays import compiled

__all__ = [
    "CKF", "EKF", "FIELDS", "KEEP", "KF", "SUMMARY", "UKF", "Belief", "Covariance", "Inferred", "IteratedEKF",
    "Method", "Model", "Posterior", "compiled", "draw", "infer",
    "kalman_filter", "kalman_smoother", "names_of", "step",
]  # fmt: skip
