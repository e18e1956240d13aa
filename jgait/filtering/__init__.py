"""State estimation on named scalar states, independent of gait.

A `Model` is a set of functions on NamedTuples of scalars. `kalman_filter` and `kalman_smoother` run over a
recording, `infer` runs the filter or the smoother, `step` filters one sample online. The argument `method` selects
the linearisation (`KF`, `EKF`, `IteratedEKF`, `UKF`, `CKF`, and for smoothers `IteratedSmoother`).
"""

from jgait.filtering.compile import compiled
from jgait.filtering.covariance import Covariance, names_of
from jgait.filtering.filter import FIELDS, KEEP, Posterior, Step, Updated, kalman_filter, step
from jgait.filtering.methods import CKF, EKF, KF, UKF, IteratedEKF, IteratedSmoother, Method
from jgait.filtering.model import Belief, Model
from jgait.filtering.sample import draw
from jgait.filtering.smoother import SUMMARY, Inferred, infer, kalman_smoother

__all__ = [
    "CKF",
    "EKF",
    "FIELDS",
    "KEEP",
    "KF",
    "SUMMARY",
    "UKF",
    "Belief",
    "Covariance",
    "Inferred",
    "IteratedEKF",
    "IteratedSmoother",
    "Method",
    "Model",
    "Posterior",
    "Step",
    "Updated",
    "compiled",
    "draw",
    "infer",
    "kalman_filter",
    "kalman_smoother",
    "names_of",
    "step",
]
