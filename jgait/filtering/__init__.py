"""State estimation on named scalar states; knows nothing of gait.

A `Model` is a handful of functions on NamedTuples of scalars. `kalman_filter` and `kalman_smoother` run it over a
recording, `step` online over one sample; how they linearise is an argument (`KF`, `EKF`, `IteratedEKF`, `UKF`, `CKF`).
`particle_filter` and `particle_smoother` run the same model with weighted particles, for beliefs that no Gaussian
describes; how they resample is an argument (`Systematic`, `Soft`).
"""

from jgait.filtering.compile import compiled
from jgait.filtering.covariance import Covariance, names_of
from jgait.filtering.filter import FIELDS, KEEP, Posterior, Step, Updated, kalman_filter, predict, step, update
from jgait.filtering.methods import CKF, EKF, KF, UKF, IteratedEKF, Method
from jgait.filtering.model import Belief, Model
from jgait.filtering.particle import PARTICLE_FIELDS, PARTICLE_KEEP, ParticlePosterior, particle_filter
from jgait.filtering.particle_smoother import ParticleSmoothed, particle_smoother
from jgait.filtering.resampling import Resampling, Soft, Systematic, systematic_ancestors
from jgait.filtering.sample import draw
from jgait.filtering.smoother import Smoothed, kalman_smoother

__all__ = [
    "CKF",
    "EKF",
    "FIELDS",
    "KEEP",
    "KF",
    "PARTICLE_FIELDS",
    "PARTICLE_KEEP",
    "UKF",
    "Belief",
    "Covariance",
    "IteratedEKF",
    "Method",
    "Model",
    "ParticlePosterior",
    "ParticleSmoothed",
    "Posterior",
    "Resampling",
    "Smoothed",
    "Soft",
    "Step",
    "Systematic",
    "Updated",
    "compiled",
    "draw",
    "kalman_filter",
    "kalman_smoother",
    "names_of",
    "particle_filter",
    "particle_smoother",
    "predict",
    "step",
    "systematic_ancestors",
    "update",
]
