"""A state-space model: functions on tuples of named numbers and arrays, and distributions of such tuples.

States, observations and controls are NamedTuples whose fields are scalars, arrays, or tuples of these; a rotation may
be an object of another library that is a pytree of arrays. The same names address the entries of a covariance.
"""

from collections.abc import Callable
from typing import NamedTuple

from jaxtyping import PyTree

from jgait.filtering.covariance import Covariance, Tree
from jgait.notes import record


@record
class Belief(NamedTuple):
    """A distribution of a state: the mean, and the covariance of the error about the mean."""

    mean: PyTree
    cov: Covariance

    def joined(self) -> "Belief":
        """The same belief in the structure of a filter's results, for loops that begin with it."""
        return Belief(self.mean, Covariance.from_dense(self.cov.dense(), self.cov.layout))


@record
class Model(NamedTuple):
    """A state-space model; functions at module level, so that the model is hashable and compiles once.

    In a tuple of variances one number stands for all entries of an array. All Jacobians come from autodiff.
    """

    initial: Callable[..., Belief]  #: params → `Belief` one interval before the first sample.
    transition: Callable[..., Tree]  #: (params, state, control, dt) → state after dt.
    #: (params, state, control, dt) → `Covariance`, or an error tuple of independent variances; computed at the mean
    #: before the interval.
    transition_noise: Callable[..., Covariance | Tree]
    observation: Callable[..., Tree]  #: (params, state, control) → expected observation.
    #: (params, state, control) → `Covariance`, or an observation tuple of variances; computed at the predicted mean.
    observation_noise: Callable[..., Covariance | Tree]
    retract: Callable[..., Tree] | None = None  #: (state, error) → state, for states on a manifold; None: their sum.
    #: (reference, state) → error with retract(reference, local(reference, state)) = state; None: difference.
    local: Callable[..., Tree] | None = None
    #: (measured, predicted) → their difference, for angles that wrap; None: plain subtraction.
    residual: Callable[..., Tree] | None = None
